"""Constraints: what each said against what was predicted for it."""

from __future__ import annotations

import math
from typing import Any

from edl_filter.report.html.blocks import Mark, Note, Section, Table
from edl_filter.report.html.source import Source

_KEY, _TITLE = "constraints", "Constraints"
_HEADS = ("constraint", "source", "accepted uses", "innovation (sigma)", "NIS", "dof", "99.9 % interval",
          "left out (sigma)", "its NIS (dof)", "verdict")  # fmt: skip


def constraints(source: Source) -> Section:
    """One row for each constraint."""
    found = source.summary.get("constraints", {})
    if not found:
        return Section(_KEY, _TITLE, [Note("The folder has no summary.json with constraints.", "muted")])
    rows = [_row(name, c) for name, c in found.items()]
    note = (
        "Innovations are components over their sigmas (many uses: their mean). NIS is the normalised innovation "
        "squared; it should lie in the interval. Left out: predicted from all other constraints alone, which is the "
        "fairer test."
    )
    return Section(_KEY, _TITLE, [Table("", _HEADS, rows, texts=2, wide=(9,)), Note(note, "muted")])


def _row(name: str, c: dict[str, Any]) -> list[str | Mark]:
    interval = c.get("nis_interval_99_9")
    return [
        name.replace("_", " "),
        str(c["source"]),
        f"{c['accepted_uses']} of {c['uses']}",
        _sigmas(c["innovation"], c["innovation_sigma"]),
        f"{c['nis']:.2f}" if c["dof"] else "–",
        str(c["dof"]),
        "–" if interval is None else f"{_limit(interval[0])} – {_limit(interval[1])}",
        _sigmas(c["left_out"], c["left_out_sigma"]),
        f"{c['left_out_nis']:.2f} ({c['left_out_dof']})" if c["left_out_dof"] else "–",
        _verdict(c),
    ]


def _sigmas(values: list[float | None], sigmas: list[float | None]) -> str:
    """Components over their sigmas; many of them as the largest."""
    pairs = zip(values, sigmas, strict=True)
    ratio = [v / s if v is not None and s and math.isfinite(s) else None for v, s in pairs]
    if len(ratio) <= 3:
        return "  ".join("–" if r is None else _signed(r) for r in ratio)
    known = [abs(r) for r in ratio if r is not None]
    return f"≤ {max(known):.1f}" if known else "–"


def _signed(ratio: float) -> str:
    return f"{round(ratio, 1) + 0.0:+.1f}".replace("-", "−")


def _limit(value: float) -> str:
    """A limit of the NIS as far as a person reads it; the lowest are as good as nothing."""
    return f"{value:.0f}" if value >= 100.0 else f"{value:.1f}" if value >= 10.0 else f"{value:.2f}"


def _verdict(c: dict[str, Any]) -> Mark:
    if not c["accepted"]:
        return Mark(f"✗ {c['uses'] - c['accepted_uses']} rejected", "bad")
    if c["consistent"] is None:
        return Mark("– not judged", "muted")
    return Mark("✓ accepted", "good") if c["consistent"] else Mark("▲ outside", "doubt")
