"""The ledger: what was added to a model, one plain line of JSON after the other, and how the error fell.

``ledger.jsonl`` lies beside the results. Each line names the mission, the effect with its estimate, every channel's
normalised RMS before and after, and the held-out score; a person can read it and git can show its changes.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from edl_filter.errors import InputError
from edl_filter.results.outputs import LEDGER as NAME
from edl_filter.results.outputs import finite


def entry(step: int, content: dict[str, Any]) -> dict[str, Any]:
    """Line of the effect that a diagnosis (its ``content``) names first."""
    first = content["ranking"][0]
    return {
        "step": step,
        "mission": content["mission"],
        "model": content["effects"],
        "added": first["effect"],
        "same_as": first["same_as"],
        "parameters": first["parameters"],
        "gain": first["gain"],
        "held_out_score": first["score_gain"],
        "errors": {
            name: {"before": before, "after": first["errors_after"].get(name)}
            for name, before in content["errors"].items()
        },
    }


def append(folder: Path, line: dict[str, Any]) -> Path:
    """Add a line to the ledger in `folder`."""
    path = folder / NAME
    with path.open("a", encoding="utf-8") as file:
        file.write(json.dumps(finite(line), ensure_ascii=False, allow_nan=False) + "\n")
    return path


def read(folder: Path) -> list[dict[str, Any]]:
    """Lines of the ledger in `folder`, none if there is none.

    Raises
    ------
    InputError
        A line is not JSON.
    """
    path = folder / NAME
    if not path.is_file():
        return []
    found = []
    for n, text in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
        try:
            found.append(json.loads(text))
        except json.JSONDecodeError as error:
            raise InputError(f"{path}, line {n}: found no JSON ({error.msg}); remove the line.") from None
    return found
