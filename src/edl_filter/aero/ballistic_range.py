"""Effective drag at the RMS angle, for ballistic-range data (thesis eq. 11.2).

In a range the total angle swings from station to station, so that only an effective drag of each section is
measured. The thesis's equation 11.2 was lost with its text; what the text keeps is that CD "is modeled using
(11.2)" because the angle changes, and that "when the total angle of attack is equal to root mean square of the
angle of attack the effective drag is equal to CD". The usual model of ballistic ranges does that,

    CD = CD0 + CD2 alpha²    so that    mean(CD) = CD0 + CD2 alpha_rms² = CD(alpha_rms),

and is what is taken for eq. 11.2 here: a reading, not a quotation.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike
from scipy.integrate import trapezoid

from edl_filter.aero.grid import Array, Bools


class _LookUp(Protocol):
    def lookup(self, x: ArrayLike, alpha: ArrayLike, /) -> tuple[Array, Array, Array, Bools]: ...


class DragModel(NamedTuple):
    """``CD = cd0 + cd2 alpha²``, alpha in rad."""

    cd0: float
    cd2: float

    def __call__(self, alpha_rms: ArrayLike) -> Array:
        """Effective drag of a section with this RMS angle, rad."""
        return self.cd0 + self.cd2 * np.asarray(alpha_rms, float) ** 2


def rms_angle(time: ArrayLike, alpha_total: ArrayLike) -> float:
    """RMS over time of the total angle, rad; trapezoidal, so that stations need no even spacing."""
    time, alpha = np.asarray(time, float), np.asarray(alpha_total, float)
    return float(np.sqrt(trapezoid(alpha**2, time) / (time[-1] - time[0])))


def fit_drag(alpha_rms: ArrayLike, cd_effective: ArrayLike) -> DragModel:
    """Least-squares drag model of sections with RMS angles in rad and their effective drag."""
    alpha = np.asarray(alpha_rms, float)
    columns = np.stack([np.ones_like(alpha), alpha**2], axis=1)
    cd0, cd2 = np.linalg.lstsq(columns, np.asarray(cd_effective, float), rcond=None)[0]
    return DragModel(float(cd0), float(cd2))


def effective_drag(table: _LookUp, mach: ArrayLike, alpha_rms: ArrayLike) -> Array:
    """Drag that a table predicts for sections with these RMS angles: ``CA cos + CN sin`` there."""
    alpha = np.asarray(alpha_rms, float)
    ca, cn, _, _ = table.lookup(mach, alpha)
    return ca * np.cos(alpha) + cn * np.sin(alpha)
