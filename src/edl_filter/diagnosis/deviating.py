"""The flight's own air, tables and vehicle: what all differences say of them, and what they add to the differences.

The unknowns count from what the mission states, whatever the deviation in the model is, so that their prior stays as it
is; what the deviation has taken up is added to the differences again, by the slopes (`offset`).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from edl_filter.diagnosis.bins import Bins
from edl_filter.diagnosis.sensitivity import Slopes
from edl_filter.diagnosis.timeline import Order
from edl_filter.diagnosis.unknowns import Unknowns
from edl_filter.effects.deviation import CoefficientUnits, Deviation

Array = NDArray[np.float64]


def deviation(
    order: Order,
    bins: Bins,
    unknowns: Unknowns,
    sigma: dict[str, float],
    units: CoefficientUnits,
    rows: NDArray[np.int64],
    smoothed: Array,
) -> Deviation:
    """What the differences say of air, tables and vehicle, at the bins' ends: there the unknowns are met.

    Parameters
    ----------
    order : Order
    bins : Bins
    unknowns : Unknowns
    sigma : dict
        `sensitivity.one_sigma`.
    units : CoefficientUnits
        One sigma of the coefficients.
    rows : (K + 1,) array
        Where each step's rows begin.
    smoothed : (K, n) array
        The unknowns at every step, given all rows (`Whitener.smoothed`).
    """
    used, ends = np.flatnonzero(order.bin_rows[:, 0] >= 0), bins.edges[1:]
    step = np.searchsorted(rows, order.bin_rows[used, 0], side="right") - 1

    def along(name: str) -> Array:
        if name not in unknowns or not len(used):
            return np.zeros(len(ends))
        values = smoothed[step, unknowns[name].start]
        return np.interp(ends, ends[used], values) * sigma[name]

    return Deviation(
        time=ends,
        density=along("density"),
        wind=np.column_stack((along("wind_east"), along("wind_north"))),
        ca=along("ca"),
        cn=along("cn"),
        cm=along("cm"),
        mass=float(along("mass")[0]),
        inertia=float(along("inertia")[0]),
        units=units,
    )


def offset(order: Order, slope: Slopes, deviation: Deviation) -> Array:
    """What a deviation adds to the differences ``(R,)``, by the slopes; to a force as it is in the bin's middle."""
    out = np.zeros(order.count)
    table = np.zeros(order.bin_rows.shape)
    for name, values in by_name(deviation).items():
        at = slope.names[name].start
        middle = 0.5 * (values + np.concatenate((values[:1], values[:-1])))
        table[:, :3] += slope.force[:, :, at] * middle[:, None]
        table[:-1, 3:6] += slope.turn[:, :, at] * values[:-1, None]
    used = order.bin_rows >= 0
    out[order.bin_rows[used]] = table[used]
    return out


def by_name(deviation: Deviation) -> dict[str, Array]:
    """By the names of the unknowns, at the bins' ends ``(B,)``; coefficients in sigmas."""
    d, ones = deviation, np.ones(len(deviation.time))
    return {
        "density": d.density, "wind_east": d.wind[:, 0], "wind_north": d.wind[:, 1], "ca": d.ca, "cn": d.cn,
        "cm": d.cm, "mass": d.mass * ones, "inertia": d.inertia * ones,
    }  # fmt: skip


def moved(before: Deviation | None, after: Deviation | None, sigma: dict[str, float]) -> float:
    """Largest change of a deviation, in sigmas of what the mission states."""
    new, old = ({} if d is None else by_name(d) for d in (after, before))
    changes = [np.max(np.abs(new.get(n, 0.0) - old.get(n, 0.0)) / s, initial=0.0) for n, s in sigma.items() if s > 0.0]
    return float(max(changes, default=0.0))
