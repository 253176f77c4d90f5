"""What would part two names that this flight cannot tell apart: one more thing measured or known.

Each remedy is tried on the linear problem of the flight: an error that the mission allows is taken away, or a
constraint made ten times better. What the one effect does that no size of the other can imitate is then counted in
nats, the evidence by which they would be parted.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from edl_filter.diagnosis.linear import Linear
from edl_filter.diagnosis.signatures import signature
from edl_filter.diagnosis.sparse import Sparse
from edl_filter.diagnosis.whitening import Steps, whitener
from edl_filter.effects.effect import Active

Array = NDArray[np.float64]

#: Evidence that parts two names, nats.
ENOUGH = 6.0
#: How much better a constraint is made.
_BETTER = 10.0

#: What could be known, and the unknowns that this takes away.
KNOWN = {
    "the air's density": ("density",),
    "the winds": ("wind_east", "wind_north"),
    "the mass": ("mass",),
    "the inertia": ("inertia",),
    "the coefficients, by a database without error": ("ca", "cn", "cm"),
    "the attitude at entry": ("attitude", "entry_frame", "onboard_attitude", "onboard_mounting"),
    "the entry state's position and velocity": ("position", "velocity", "entry_epoch"),
    "the accelerometers' errors": ("accelerometer_bias", "accelerometer_scale", "accelerometer_misalignment"),
    "the gyros' errors": ("gyro_bias", "gyro_scale", "onboard_rate"),
}


@dataclass(frozen=True)
class Parting:
    """A remedy.

    Attributes
    ----------
    remedy : str
    evidence : float
        By which the two would be parted, nats.
    """

    remedy: str
    evidence: float


def parting(linear: Linear, one: Active, other: Active) -> Parting | None:
    """The remedy that parts two effects best, about their values; None where none is enough."""
    columns = [signature(linear.ground, replace(a, values=a.values | _nothing(a))) for a in (one, other)]
    sizes = [np.array([a.values[n] for n in s.names]) for a, s in zip((one, other), columns, strict=True)]
    rows = np.concatenate([s.rows for s in columns], axis=1)
    start = np.concatenate([s.start for s in columns], axis=1)
    width = len(sizes[0])
    found = []
    for remedy, made in remedies(linear):
        white = whitener(made(linear.soft.steps))(rows, start)
        a, b = white[:, :width], white[:, width:]
        found.append(Parting(remedy, min(_beyond(a @ sizes[0], b), _beyond(b @ sizes[1], a))))
    best = max(found, key=lambda p: p.evidence)
    return best if best.evidence > ENOUGH else None


def remedies(linear: Linear) -> list[tuple[str, Callable[[Steps], Steps]]]:
    """All remedies that this flight leaves room for."""
    layout, unknowns = linear.unknowns.layout, linear.unknowns
    slices = layout.slices | unknowns.slices
    found: list[tuple[str, Callable[[Steps], Steps]]] = []
    for what, names in KNOWN.items():
        there = [slices[n] for n in names if n in slices]
        if there:
            at = np.concatenate([np.arange(s.start, s.stop) for s in there])
            found.append((f"knowing {what}", partial(known, at=at)))
    constraints = zip(linear.ground.setup.problem.constraints, linear.ground.order.constraint_rows, strict=True)
    by_name: dict[str, list[Array]] = {}
    for constraint, rows in constraints:
        by_name.setdefault(constraint.name, []).append(np.arange(rows.start, rows.stop))
    for name, parts in by_name.items():
        at = np.concatenate(parts)
        text = f"a constraint {name} {_BETTER:.0f} times better"
        found.append((text, partial(better, rows=at)))
    return found


def known(steps: Steps, at: Sequence[int] | NDArray[np.int64]) -> Steps:
    """The problem with some unknowns known: no variance at the beginning, and no noise."""
    start = steps.start.copy()
    start[at], start[:, at] = 0.0, 0.0
    noise = steps.noise
    keep = ~(np.isin(noise.row, at) | np.isin(noise.column, at))
    kept = Sparse(noise.size, noise.row[keep], noise.column[keep], noise.values[:, keep])
    return replace(steps, start=start, noise=kept)


def better(steps: Steps, rows: NDArray[np.int64]) -> Steps:
    """The problem with less noise in some rows."""
    noise = steps.row_noise.copy()
    noise[rows] /= _BETTER**2
    return replace(steps, row_noise=noise)


def _nothing(active: Active) -> dict[str, float]:
    return {q.name: 0.0 for q in active.effect.sizes}


def _beyond(made: Array, other: Array) -> float:
    """Half the square of what no size of the other imitates, nats."""
    least = np.linalg.lstsq(other, made, rcond=None)[0]
    return 0.5 * float(np.sum((made - other @ least) ** 2))
