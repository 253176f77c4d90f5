"""The ledger of an improvement: one line of JSON for each effect that was added, with the fall of every residual.

``ledger.jsonl`` is in the folder of the results. Each line names the mission, the effect with its estimate, every
channel's normalised RMS before and after, and the held-out score; a person can read it and git can show its changes.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from edl_filter.io.atomic import replace_with
from edl_filter.results.files import LEDGER as NAME
from edl_filter.results.plain import finite


def added_line(step: int, content: dict[str, Any]) -> dict[str, Any]:
    """The line of the effect that a diagnosis (its ``content``) names first."""
    first = content["ranking"][0]
    return {
        "step": step,
        "mission": content["mission"],
        "model": content["effects"],
        "added": first["effect"],
        "imu": first["imu"],
        "same_as": first["same_as"],
        "parameters": first["parameters"],
        "gain": first["gain"],
        "held_out_score": first["score_gain"],
        "errors": {
            name: {"before": before, "after": first["errors_after"].get(name)}
            for name, before in content["errors"].items()
        },
    }


def last_line(step: int, content: dict[str, Any], why: str) -> dict[str, Any]:
    """The last line: nothing added, and why."""
    return {
        "step": step,
        "mission": content["mission"],
        "model": content["effects"],
        "added": None,
        "why": why,
        "errors": {name: {"before": before, "after": None} for name, before in content["errors"].items()},
    }


def append(folder: Path, line: dict[str, Any]) -> Path:
    """Append a line to the ledger in `folder`; the file is replaced as a whole, so that no part of a line remains."""
    path = folder / NAME
    before = path.read_text(encoding="utf-8") if path.is_file() else ""
    text = before + json.dumps(finite(line), ensure_ascii=False, allow_nan=False) + "\n"
    return replace_with(path, lambda temporary: temporary.write_text(text, encoding="utf-8"))


def keep(folder: Path, count: int) -> None:
    """Keep the first `count` lines of the ledger in `folder`; with none the file is removed."""
    path = folder / NAME
    lines = path.read_text(encoding="utf-8").splitlines(keepends=True) if path.is_file() else []
    if count == 0:
        path.unlink(missing_ok=True)
    elif len(lines) > count:
        replace_with(path, lambda temporary: temporary.write_text("".join(lines[:count]), encoding="utf-8"))
