"""Places narrowed down: from the scan's grid to where an effect explains most, one place after the other."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from edl_filter.diagnosis.linear import Linear
from edl_filter.diagnosis.regression import regress
from edl_filter.diagnosis.signatures import ordered, signature
from edl_filter.diagnosis.whitening import Whitens
from edl_filter.effects.effect import Active

#: An altitude's first step before it is halved, m: between the scan's finest and its coarsest.
_ALTITUDE_STEP = 4e3


def narrowed(linear: Linear, active: Active, whiten: Whitens, rounds: int = 6) -> Active:
    """Move an effect's places, one after the other and in ever smaller steps, to where it explains most."""
    scanned = [q for q in active.effect.places if q.scan > 1]
    if not scanned:
        return active
    y = linear.white(whiten)

    def tried(at: Active) -> tuple[float, Active]:
        s = signature(linear.ground, at.unsized())
        fit = regress(y, whiten(s.rows, s.start), s.sigma)
        return fit.gain, replace(at, values=at.values | dict(zip(s.names, fit.size.tolist(), strict=True)))

    gain, best = tried(active)
    spans = {}
    for q in scanned:
        low, high = (q.low, q.high) if np.isfinite([q.low, q.high]).all() else (0.0, linear.bins.edges[-1])
        step = (high - low) / (q.scan if q.kind == "phase" else q.scan - 1)
        spans[q.name] = _ALTITUDE_STEP if q.kind == "altitude" else step
    for _ in range(rounds):
        for name in spans:
            spans[name] *= 0.5
            for sign in (1.0, -1.0):
                other = replace(best, values=best.values | {name: best.values[name] + sign * spans[name]})
                if not (ordered(other) and _inside(other, name)):
                    continue
                g, fitted = tried(other)
                if g > gain:
                    gain, best = g, fitted
                    break
    return best


def _inside(active: Active, name: str) -> bool:
    """Whether a place is between its bounds; a phase may go round."""
    q = next(p for p in active.effect.parameters if p.name == name)
    return q.kind == "phase" or q.low <= active.values[name] <= q.high
