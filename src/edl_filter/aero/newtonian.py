"""Modified Newtonian coefficients of a forebody given by its geometry.

The pressure coefficient is Cp = Cp_max sin² θ where the surface faces the stream and 0 in its shadow. For a body of
revolution the integral around the axis is known in closed form, so only the meridian is summed.

Sources: L. Lees, "Hypersonic Flow", 1955 (Cp_max at the stagnation point); Lord Rayleigh's pitot formula as in
NACA Report 1135, 1953, eq. 100.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from edl_filter.aero.body import SphereCone
from edl_filter.aero.grid import GridTable
from edl_filter.errors import InputError

__all__ = ["newtonian_coefficients", "newtonian_table", "rayleigh_pitot_cp_max"]

#: Effective ratio of specific heats of the shocked CO2 up to Mach 9, and Cp_max above Mach 10, where it dissociates.
_GAMMA, _CP_MAX = 1.33, 1.94
#: Nodes of the table: Mach and deg.
_MACH = np.concatenate((np.arange(0.4, 3.0, 0.1), np.arange(3.0, 9.1, 0.5), [10.0, 40.0]))
_ALPHA_DEG = np.arange(0.0, 30.5, 0.5)


def rayleigh_pitot_cp_max(mach: ArrayLike, gamma: ArrayLike) -> NDArray[np.float64]:
    """Pressure coefficient at the stagnation point of a perfect gas.

    Behind a normal shock for Mach 1 and above (Rayleigh's pitot formula), isentropic below.

    Parameters
    ----------
    mach : array_like
        Mach number, positive.
    gamma : array_like
        Ratio of specific heats, above 1; broadcast against `mach`.

    Raises
    ------
    InputError
        If a Mach number is not positive or a ratio not above 1.
    """
    m, g = np.broadcast_arrays(np.asarray(mach, dtype=float), np.asarray(gamma, dtype=float))
    if not np.all(np.isnan(m) | (m > 0.0)):
        raise InputError(f"Mach number must be positive for a stagnation pressure, found {np.nanmin(m):g}")
    if not np.all(np.isnan(g) | (g > 1.0)):
        raise InputError(f"the ratio of specific heats gamma must be above 1, found {np.nanmin(g):g}")
    over = np.maximum(m, 1.0)  # each branch is worked out on its own side, so neither overflows on the other's
    under = np.minimum(m, 1.0)
    power = g / (g - 1.0)
    shock = ((g + 1.0) ** 2 * over**2 / (4.0 * g * over**2 - 2.0 * (g - 1.0))) ** power
    shocked = shock * (1.0 - g + 2.0 * g * over**2) / (g + 1.0) - 1.0
    # expm1 and log1p: the difference from 1 is of order M², which a plain power loses when slow
    smooth = np.expm1(power * np.log1p(0.5 * (g - 1.0) * under**2))
    return np.where(m < 1.0, smooth, shocked) * 2.0 / (g * m**2)


def newtonian_coefficients(
    body: SphereCone, alpha: ArrayLike, cp_max: ArrayLike = 2.0, *, meridian_points: int = 24
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Axial, normal and pitching-moment coefficients by modified Newtonian theory.

    Parameters
    ----------
    body : SphereCone
        The forebody; its base is left out, and so is the pressure on it.
    alpha : array_like
        Angle of attack, rad; any shape.
    cp_max : array_like
        Pressure coefficient at the stagnation point, broadcast against `alpha`; 2 is plain Newtonian.
    meridian_points : int
        Gauss points on each of the nose, the cone and the shoulder.

    Returns
    -------
    ca, cn, cm_nose : ndarray
        Coefficients in the common shape; reference π D²/4 and D, the moment about the nose, nose-up positive.
    """
    angles, peak = np.broadcast_arrays(np.asarray(alpha, dtype=float), np.asarray(cp_max, dtype=float))
    line = body.meridian(meridian_points)
    # sin θ = a + b cos φ, with φ from the windward side
    a = np.cos(angles)[..., None] * line.normal_x
    b = np.abs(np.sin(angles))[..., None] * line.normal_r
    even, odd = _ring_integrals(a, b)
    ring = line.radius * line.length / body.reference_area
    arm = (line.x * line.normal_r - line.radius * line.normal_x) / body.diameter
    side = np.sign(np.sin(angles))
    ca = even @ (ring * line.normal_x)
    cn = side * (odd @ (ring * line.normal_r))
    cm = side * (odd @ (ring * arm))
    return (peak * ca)[()], (peak * cn)[()], (peak * cm)[()]


def newtonian_table(body: SphereCone) -> GridTable:
    """Modified Newtonian coefficients of a forebody as a continuum table, Mach 0.4 to 40, 0 to 30 degrees.

    Cp_max is Rayleigh's for a ratio of specific heats of 1.33 up to Mach 9 and 1.94 above Mach 10, linear between.
    Against the Phoenix table: CA to 0.5 to 3 %, CN too large by 30 to 80 %, and no bounded instability.
    """
    peak = np.where(_MACH < 9.5, rayleigh_pitot_cp_max(_MACH, _GAMMA), _CP_MAX)[:, None]
    alpha = np.radians(_ALPHA_DEG)
    ca, cn, cm = newtonian_coefficients(body, alpha, peak)
    return GridTable("mach", _MACH, alpha, ca, cn, cm, "pchip", "modified Newtonian, forebody only")


def _ring_integrals(a: NDArray[np.float64], b: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """∫ f² dφ and ∫ f² cos φ dφ around the axis, where f = max(a + b cos φ, 0) and b ≥ 0."""
    ratio = np.divide(-a, b, out=np.where(a > 0.0, -1.0, 1.0), where=np.abs(a) < b)
    edge = np.arccos(ratio)  # light for |φ| < edge
    sine = np.sqrt(1.0 - ratio**2)
    half = (edge + sine * ratio) / 2.0
    even = 2.0 * (a**2 * edge + 2.0 * a * b * sine + b**2 * half)
    odd = 2.0 * (a**2 * sine + 2.0 * a * b * half + b**2 * (sine - sine**3 / 3.0))
    return even, odd
