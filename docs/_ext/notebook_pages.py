"""Pages of the notebooks: text, code and the stored outputs as Markdown; pictures are part of the page."""

from __future__ import annotations

import json
import re
from html import escape
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).parents[2] / "notebooks"
#: Fence that no code of a notebook contains.
_FENCE = "``````"


def notebook_text(name: str) -> str:
    """A notebook as Markdown.

    Parameters
    ----------
    name : str
        File name in ``notebooks`` without its suffix.
    """
    cells = json.loads((FOLDER / f"{name}.ipynb").read_text(encoding="utf-8"))["cells"]
    parts = [_code(cell) if cell["cell_type"] == "code" else _linked(_joined(cell["source"])) for cell in cells]
    return "\n\n".join(parts) + f"\n\n*The notebook: `notebooks/{name}.ipynb`.*\n"


def _linked(text: str) -> str:
    """Text with the links of a notebook as those of its page."""
    text = re.sub(r"\]\((\w+)\.ipynb\)", r"](\1.md)", text)
    return re.sub(r"\]\(\.\./docs/", "](../", text)


def _code(cell: dict[str, Any]) -> str:
    outputs = [text for output in cell["outputs"] if (text := _output(output))]
    return "\n\n".join([f"{_FENCE}python\n{_joined(cell['source'])}\n{_FENCE}", *outputs])


def _output(output: dict[str, Any]) -> str:
    """One output of a cell: its picture, its table, or its text."""
    data = output.get("data", {})
    if "image/png" in data:
        picture = _joined(data["image/png"]).replace("\n", "")
        return _raw(f'<p><img alt="output of the cell above" src="data:image/png;base64,{picture}"></p>')
    if "text/html" in data:
        return _raw(f'<div class="cell-output">{_joined(data["text/html"])}</div>')
    text = _joined(data.get("text/plain", output.get("text", ""))).rstrip()
    return _raw(f'<pre class="cell-output">{escape(text)}</pre>') if text else ""


def _raw(html: str) -> str:
    return f"{_FENCE}{{raw}} html\n{html}\n{_FENCE}"


def _joined(text: str | list[str]) -> str:
    return text if isinstance(text, str) else "".join(text)
