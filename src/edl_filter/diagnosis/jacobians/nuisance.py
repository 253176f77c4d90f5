"""What the model does not know exactly, as one vector: the errors that the comparison allows for.

First comes the filter's own vector (`navigation.layout`): navigation and the driving instrument's errors. Then what
only the comparison knows of, in units of one sigma where that is said:

rate_before, rate_after
    Gyro noise of the bin that ends and of the one that begins (rad/s): the same numbers turn the attitude and stand in
    the step of the rate.
other
    Errors of the checking IMUs.
density, wind_east, wind_north
    Relative error of the preflight density and of the winds, in sigmas; they change with altitude. Each is a pair,
    value and slope: a Matérn process of order 3/2, which is as smooth as air is (a first-order one, of the same
    correlation length, would be let jump by a tenth of its sigma in a hundred metres).
ca, cn, cm
    Errors of the database in sigmas, pairs of the same kind; they change with time. Exact tables leave what numbers
    cannot do better.
mass, inertia
    Relative errors, in sigmas.

What no effect explains (`missing`) comes behind all of them where it is allowed for.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from edl_filter.navigation.layout import SENSOR_STATES, Layout
from edl_filter.telemetry.record import ImuRecord

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Allowance:
    """How well the model is known.

    Attributes
    ----------
    density, density_correlation : float
        Relative one sigma of the preflight density, and the altitude over which it changes, m.
    wind : float
        One sigma of the wind towards east and towards north, m/s.
    coefficients : float
        How many of the database's own sigmas it may be off; 0: exact.
    coefficient_memory : float
        s.
    numerical : float
        Relative one sigma of a prediction from exact tables: what sampling, interpolation and small angles leave.
    mass, inertia : float
        Relative one sigma.
    """

    density: float
    density_correlation: float = 10e3
    wind: float = 0.0
    coefficients: float = 0.0
    coefficient_memory: float = 20.0
    numerical: float = 2e-4
    mass: float = 0.0
    inertia: float = 0.0


@dataclass(frozen=True)
class Unknowns:
    """Where each unknown stands in the vector.

    Attributes
    ----------
    layout : Layout
        Of the filter's vector, which comes first.
    slices : dict
        Name → slice, for the rest.
    size : int
    """

    layout: Layout
    slices: dict[str, slice]
    size: int

    def __contains__(self, name: str) -> bool:
        return name in self.slices

    def __getitem__(self, name: str) -> slice:
        return self.slices[name]


def lay_out(layout: Layout, checking: tuple[ImuRecord, ...], allowance: Allowance) -> Unknowns:
    """Decide what is unknown."""
    sizes = {"rate_before": 3, "rate_after": 3}
    for i, record in enumerate(checking):
        sizes |= {f"other{i}_{n}": 3 for n in SENSOR_STATES if getattr(record.errors[0], n) > 0.0}
    smooth = ["density"] if allowance.density > 0.0 else []
    smooth += ["wind_east", "wind_north"] if allowance.wind > 0.0 else []
    smooth += ["ca", "cn", "cm"]
    sizes |= dict.fromkeys(smooth, 2)
    if allowance.mass > 0.0:
        sizes["mass"] = 1
    if allowance.inertia > 0.0:
        sizes["inertia"] = 1
    slices, at = {}, layout.size
    for name, size in sizes.items():
        slices[name] = slice(at, at + size)
        at += size
    return Unknowns(layout, slices, at)


def distances(allowance: Allowance, time: Array, altitude: Array) -> dict[str, Array]:
    """What passes of the correlation length of every smooth unknown, with steps of time (s) and altitude (m)."""
    air = dict.fromkeys(("density", "wind_east", "wind_north"), np.abs(altitude) / allowance.density_correlation)
    return air | dict.fromkeys(("ca", "cn", "cm"), time / allowance.coefficient_memory)


def smooth_step(passed: Array) -> tuple[Array, Array]:
    """Transition and noise ``(..., 2, 2)`` of a Matérn process of order 3/2 and unit variance.

    Parameters
    ----------
    passed : (...) array
        Distance over correlation length; the correlation is ``(1 + √3 d) exp(-√3 d)``.

    Returns
    -------
    The pair is the value and its slope over the correlation length (Särkkä, Bayesian Filtering and Smoothing, 12.3).
    """
    d = np.sqrt(3.0) * np.asarray(passed, float)
    e = np.exp(-d)
    move = np.empty((*d.shape, 2, 2))
    move[..., 0, 0], move[..., 0, 1] = (1.0 + d) * e, passed * e
    move[..., 1, 0], move[..., 1, 1] = -np.sqrt(3.0) * d * e, (1.0 - d) * e
    rest = np.diag([1.0, 3.0])
    return move, rest - move @ rest @ np.swapaxes(move, -1, -2)
