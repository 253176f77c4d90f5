"""Declarations of effects as plain data and as text."""

from __future__ import annotations

import math
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
