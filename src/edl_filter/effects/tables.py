"""Declarations of effects as plain data and as text, and the catalogue as the table of the documentation."""

from __future__ import annotations

import math
from collections.abc import Iterable
from itertools import groupby
from typing import Any

from edl_filter.effects.base import Effect
from edl_filter.effects.parameters import Parameter


def as_plain(effect: Effect) -> dict[str, Any]:
    """The declaration of an effect as plain data; infinite bounds are None."""

    def finite(value: float) -> float | None:
        return value if math.isfinite(value) else None

    return {
        "name": effect.name,
        "family": effect.family,
        "summary": effect.summary,
        "shows": effect.shows,
        "region": effect.region,
        "source": effect.source,
        "parameters": [
            {
                "name": q.name,
                "unit": q.unit,
                "description": q.description,
                "kind": q.kind,
                "sigma": q.sigma if q.kind == "size" else None,
                "low": finite(q.low),
                "high": finite(q.high),
                "default": finite(q.default),
            }
            for q in effect.parameters
        ],
    }


def size_text(q: Parameter) -> str:
    """Plausible size of a parameter with its unit, or its range for kinds other than ``size``."""
    unit = f" {q.unit}" if q.unit else ""
    if q.kind == "size":
        return f"± {q.sigma:g}{unit}"
    if math.isinf(q.low) or math.isinf(q.high):
        return f"{q.unit}, in the flight" if math.isfinite(q.default) else f"{q.unit}, or never"
    return f"{q.low:.6g} to {q.high:.6g}{unit}"


def parameters_text(effect: Effect, quote: str = "") -> str:
    """Parameters with plausible sizes, those of equal size together: ``bx, by, bz ± 0.005 m/s^2``."""
    parts = []
    for size, group in groupby(effect.parameters, key=size_text):
        names = ", ".join(f"{quote}{q.name}{quote}" for q in group)
        parts.append(f"{names} {size}" if size.startswith("±") else f"{names} ({size})")
    return "; ".join(parts)


def markdown(effects: Iterable[Effect]) -> str:
    """Markdown table of effects for the documentation, one row each."""
    rows = ["| effect | what it is | parameters, plausible size (1 sigma) or range | how it shows | source |"]
    rows.append("|---|---|---|---|---|")
    for e in effects:
        cells = (f"`{e.name}`", e.summary, parameters_text(e, "`"), e.shows, e.source)
        rows.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    return "\n".join(rows) + "\n"
