"""Where a model fails: every channel in every regime, and when it begins.

A channel's innovations come from a filter that takes failures for noise (`roughness`), so that one failure does not
look like ten; they are judged by the noise that is stated, so that it does look like one.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri, ndtr

from edl_filter.diagnosis.linear import Linear
from edl_filter.diagnosis.path import PER_BIN
from edl_filter.navigation.constraints import Constraint

Array = NDArray[np.float64]

#: Mach numbers that part the continuum regimes (the thesis's 25, 15 and 5; and 3.5, the dynamic instability's).
MACH = (25.0, 15.0, 5.0, 3.5)
#: Knudsen numbers that part the flow's.
KNUDSEN = (10.0, 1e-3)
AXES = ("x", "y", "z")
#: Normalised RMS beyond which a cell fails, where chance allows less: sigmas of chance.
CHANCE = 5.0
#: Samples on either side of an onset, and the evidence that it needs, nats.
_SHORTEST, _BEGINS = 10, 12.0
#: And a size below which nobody cares: a tenth more than the noise.
_LEAST = 1.1


@dataclass(frozen=True)
class Cell:
    """A channel in a regime.

    Attributes
    ----------
    channel, regime : str
    t0, t1 : float
        s.
    rms : float
        Normalised: 1 where the model holds.
    bias : float
        Mean in sigmas of one sample.
    autocorrelation : float
        At one sample's distance, of the normalised innovations.
    physical : float
        RMS beyond noise in the channel's own unit.
    unit : str
    matters : float
        The same over the database's one sigma; NaN where the database says nothing of the channel.
    count : int
    fails : bool
    """

    channel: str
    regime: str
    t0: float
    t1: float
    rms: float
    bias: float
    autocorrelation: float
    physical: float
    unit: str
    matters: float
    count: int
    fails: bool

    @property
    def sentence(self) -> str:
        """The failure in words."""
        begin, end = f"{self.t0:.0f}", f"{self.t1:.0f}"
        size = f"{self.physical:.2g}" if self.physical < 100.0 else f"{self.physical:.0f}"
        text = (
            f"{self.channel} in {self.regime} ({begin if begin == end else f'{begin} to {end}'} s): "
            f"{self.rms:.3g} times its sigma, {size} {self.unit} beyond noise"
        )
        if np.isfinite(self.matters):
            text += f", {self.matters:.2g} of the database's sigma"
        return text + "."


def channels(linear: Linear) -> list[tuple[str, str]]:
    """Names and units of the bins' channels, in the order of their rows."""
    found = [(f"force_{a}", "m/s^2") for a in AXES] + [(f"moment_{a}", "rad/s^2") for a in AXES]
    for record in linear.ground.setup.checking:
        found += [(f"{record.name}_force_{a}", "m/s^2") for a in AXES]
        found += [(f"{record.name}_rate_{a}", "rad/s") for a in AXES]
    return found


def regimes(linear: Linear) -> list[tuple[str, NDArray[np.bool_]]]:
    """Regimes of the flight and the bins ``(B,)`` in them, in order of time."""
    flow = linear.ground.found.flow
    middle = slice(PER_BIN // 2, None, PER_BIN)
    mach, knudsen = flow.mach[middle], flow.knudsen[middle]
    rare = knudsen >= KNUDSEN[0]
    between = ~rare & (knudsen >= KNUDSEN[1])
    found = [("free-molecular flow", rare), ("transitional flow", between)]
    dense = ~rare & ~between
    edges = (np.inf, *MACH, 0.0)
    for high, low in pairwise(edges):
        name = f"Mach {high:g} to {low:g}" if np.isfinite(high) else f"Mach above {low:g}"
        found.append((name if low > 0.0 else f"Mach below {high:g}", dense & (mach < high) & (mach >= low)))
    return [(name, inside) for name, inside in found if inside.any()]


def normalised(linear: Linear) -> Array:
    """Innovations ``(R,)`` in sigmas of what is stated."""
    soft = linear.soft
    return soft.innovations(linear.white(soft)) / linear.plain.innovation_sigma


def survey(linear: Linear) -> list[Cell]:
    """All cells: bins' channels by regime, then the constraints by name."""
    scaled = normalised(linear)
    unit_of = channels(linear)
    order, bins = linear.ground.order, linear.bins
    limits = _database_sigma(linear)
    cells = []
    for regime, inside in regimes(linear):
        for c, (channel, unit) in enumerate(unit_of):
            used = np.flatnonzero(inside & (order.bin_rows[:, c] >= 0))
            if len(used) < 5:
                continue
            rows = order.bin_rows[used, c]
            scale = 1.0 / bins.interval[used] if 3 <= c < 6 else np.ones(len(used))
            cells.append(
                _cell(
                    channel, regime, bins.edges[used[0]], bins.edges[used[-1] + 1], scaled[rows],
                    linear.plain.innovation_sigma[rows] * scale, unit, limits[used, c] if c < 6 else None,
                )
            )  # fmt: skip
    by_name: dict[str, list[int]] = {}
    problem = linear.ground.setup.problem
    for i, constraint in enumerate(problem.constraints):
        by_name.setdefault(constraint.name, []).append(i)
    for name, which in by_name.items():
        rows = np.concatenate([np.arange(order.constraint_rows[i].start, order.constraint_rows[i].stop) for i in which])
        cells.append(
            _cell(
                name, "constraints", order.time[rows[0]], order.time[rows[-1]], scaled[rows],
                linear.plain.innovation_sigma[rows], _unit(problem.constraints[which[0]]), None,
            )
        )  # fmt: skip
    return cells


@dataclass(frozen=True)
class Onset:
    """When a channel begins to fail.

    Attributes
    ----------
    channel : str
    time : float
        s.
    gain : float
        Log-likelihood over one noise throughout, nats.
    """

    channel: str
    time: float
    gain: float


def onsets(linear: Linear) -> list[Onset]:
    """When each channel begins to fail, by a likelihood-ratio scan; channels without a beginning are left out."""
    scaled, order = normalised(linear), linear.ground.order
    found = []
    for c, (channel, _) in enumerate(channels(linear)):
        used = np.flatnonzero(order.bin_rows[:, c] >= 0)
        if len(used) < 2 * _SHORTEST:
            continue
        at, gain = louder_from(scaled[order.bin_rows[used, c]])
        if gain > _BEGINS:
            found.append(Onset(channel, float(linear.bins.edges[used[at]]), gain))
    return sorted(found, key=lambda o: -o.gain)


def louder_from(scaled: Array) -> tuple[int, float]:
    """Index from which normal numbers are louder, and the log-likelihood that this explains (0: from nowhere).

    Two variances with a step between them stand against one; none is below the stated 1, and the later is the larger.
    """
    n, square = len(scaled), np.concatenate(([0.0], np.cumsum(scaled**2)))
    k = np.arange(_SHORTEST, n - _SHORTEST + 1)
    first = np.maximum(square[k] / k, 1.0)
    second = np.maximum((square[-1] - square[k]) / (n - k), 1.0)
    whole = max(square[-1] / n, 1.0)

    gain = (
        _cost(np.array(n), whole, square[-1])
        - _cost(k, first, square[k])
        - _cost(n - k, second, square[-1] - square[k])
    )
    gain = np.where(second > first, gain, 0.0)
    best = int(np.argmax(gain))
    return int(k[best]), float(max(gain[best], 0.0))


def _cost(count: NDArray[np.int64], variance: Array, total: Array) -> Array:
    """Minus the log-likelihood of normal numbers, up to a constant."""
    return np.asarray(0.5 * (count * np.log(variance) + total / variance), float)


def _unit(constraint: Constraint) -> str:
    """Unit of a constraint, which its components' names end with in brackets."""
    return constraint.components[0].rpartition("(")[2].rstrip(")")


def failures(cells: list[Cell]) -> list[Cell]:
    """Cells that fail, worst first."""
    return sorted((c for c in cells if c.fails), key=lambda c: -c.rms)


def _cell(
    channel: str, regime: str, t0: float, t1: float, scaled: Array, sigma: Array, unit: str, limit: Array | None
) -> Cell:
    n = len(scaled)
    square = float(np.mean(scaled**2))
    rms = np.sqrt(square)
    physical = float(np.sqrt(max(float(np.mean((scaled * sigma) ** 2 - sigma**2)), 0.0)))
    lag = float(np.mean(scaled[1:] * scaled[:-1])) / max(square, 1e-30) if n > 2 else 0.0
    return Cell(
        channel=channel,
        regime=regime,
        t0=float(t0),
        t1=float(t1),
        rms=float(rms),
        bias=float(np.mean(scaled)),
        autocorrelation=lag,
        physical=physical,
        unit=unit,
        matters=physical / float(np.sqrt(np.mean(limit**2))) if limit is not None else float("nan"),
        count=n,
        fails=bool(rms**2 > chdtri(n, ndtr(-CHANCE)) / n and rms > _LEAST),
    )


def _database_sigma(linear: Linear) -> Array:
    """The database's one sigma in the first six channels, ``(B, 6)``: m/s² and rad/s²."""
    world, flow = linear.ground.setup.world, linear.ground.found.flow
    m = slice(PER_BIN // 2, None, PER_BIN)
    limit = world.database.lookup(flow.mach[m], flow.knudsen[m], flow.alpha_total[m], flow.speed[m]).three_sigma
    push = flow.dynamic_pressure[m] * world.area
    inertia = np.diag(world.rigid_body.inertia)
    force = push[:, None] * np.stack((limit.ca, limit.cn, limit.cn), axis=1) / world.rigid_body.mass
    moment = push[:, None] * world.diameter * np.stack((limit.cl, limit.cm, limit.cm), axis=1) / inertia
    return np.maximum(np.concatenate((force, moment), axis=1) / 3.0, 1e-30)
