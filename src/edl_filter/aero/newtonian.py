"""Modified Newtonian coefficients of a forebody.

Input: geometry of the forebody, angles of attack, stagnation-point pressure coefficient Cp_max. Method: the pressure
coefficient is Cp = Cp_max sin² θ where the surface faces the stream, and 0 elsewhere. For a body of revolution the
integral around the axis has a closed form; the integral along the meridian is a Gauss sum. Output: CA, CN and Cm about
the nose, or a table of them.

Sources: L. Lees, "Hypersonic Flow", 1955 (Cp_max at the stagnation point); Lord Rayleigh's pitot formula as in
NACA Report 1135, 1953, eq. 100.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from edl_filter.aero.body import SphereCone
from edl_filter.aero.grid import GridTable
from edl_filter.errors import InputError
from edl_filter.types import Array

__all__ = ["newtonian_coefficients", "newtonian_table", "rayleigh_pitot_cp_max"]

#: Effective ratio of specific heats of the shocked CO2 up to Mach 9, and Cp_max above Mach 10, where it dissociates.
_GAMMA, _CP_MAX = 1.33, 1.94
#: Nodes of the table: Mach numbers and angles in degrees.
_MACH = np.concatenate((np.arange(0.4, 3.0, 0.1), np.arange(3.0, 9.1, 0.5), [10.0, 40.0]))
_ALPHA_DEG = np.arange(0.0, 30.5, 0.5)


def rayleigh_pitot_cp_max(mach: ArrayLike, gamma: ArrayLike) -> Array:
    """Pressure coefficient at the stagnation point in a perfect gas.

    At Mach 1 and above behind a normal shock (Rayleigh's pitot formula), below Mach 1 isentropic.

    Parameters
    ----------
    mach : (...) array
        Mach number, positive.
    gamma : (...) array
        Ratio of specific heats, above 1; broadcast against `mach`.

    Returns
    -------
    (...) array

    Raises
    ------
    InputError
        A Mach number is not positive, or a ratio is not above 1.
    """
    m, g = np.broadcast_arrays(np.asarray(mach, dtype=float), np.asarray(gamma, dtype=float))
    if not np.all(np.isnan(m) | (m > 0.0)):
        raise InputError(f"Mach number must be positive for a stagnation pressure, found {np.nanmin(m):g}")
    if not np.all(np.isnan(g) | (g > 1.0)):
        raise InputError(f"the ratio of specific heats gamma must be above 1, found {np.nanmin(g):g}")
    supersonic = np.maximum(m, 1.0)  # each formula is evaluated in its own range only, so that neither overflows
    subsonic = np.minimum(m, 1.0)
    power = g / (g - 1.0)
    total_ratio = ((g + 1.0) ** 2 * supersonic**2 / (4.0 * g * supersonic**2 - 2.0 * (g - 1.0))) ** power
    behind_shock = total_ratio * (1.0 - g + 2.0 * g * supersonic**2) / (g + 1.0) - 1.0
    # The pressure ratio minus 1 is of order M²: expm1 and log1p avoid the cancellation at small Mach numbers
    isentropic = np.expm1(power * np.log1p(0.5 * (g - 1.0) * subsonic**2))
    return np.where(m < 1.0, isentropic, behind_shock) * 2.0 / (g * m**2)


def newtonian_coefficients(
    body: SphereCone, alpha: ArrayLike, cp_max: ArrayLike = 2.0, *, meridian_points: int = 24
) -> tuple[Array, Array, Array]:
    """Axial-force, normal-force and pitching-moment coefficients by modified Newtonian theory.

    Parameters
    ----------
    body : SphereCone
        The forebody; the base and the pressure on it are not included.
    alpha : (...) array
        Angle of attack, rad.
    cp_max : (...) array
        Pressure coefficient at the stagnation point, broadcast against `alpha`; 2 is classical Newtonian theory.
    meridian_points : int
        Number of Gauss points on each of the nose, the cone and the shoulder.

    Returns
    -------
    ca, cn, cm_nose : (...) arrays
        Reference area π D²/4 and length D; the moment is about the nose, nose-up positive.
    """
    angles, cp_max = np.broadcast_arrays(np.asarray(alpha, dtype=float), np.asarray(cp_max, dtype=float))
    meridian = body.meridian(meridian_points)
    # sin θ = a + b cos φ, with φ from the windward side
    a = np.cos(angles)[..., None] * meridian.normal_x
    b = np.abs(np.sin(angles))[..., None] * meridian.normal_r
    even, odd = _ring_integrals(a, b)
    ring = meridian.radius * meridian.length / body.reference_area
    arm = (meridian.x * meridian.normal_r - meridian.radius * meridian.normal_x) / body.diameter
    sign = np.sign(np.sin(angles))
    ca = even @ (ring * meridian.normal_x)
    cn = sign * (odd @ (ring * meridian.normal_r))
    cm = sign * (odd @ (ring * arm))
    return (cp_max * ca)[()], (cp_max * cn)[()], (cp_max * cm)[()]


def newtonian_table(body: SphereCone) -> GridTable:
    """Continuum table of modified Newtonian coefficients of a forebody, Mach 0.4 to 40, 0 to 30 degrees.

    Cp_max is Rayleigh's for a ratio of specific heats of 1.33 up to Mach 9 and 1.94 above Mach 10, with a linear
    transition in between. Compared with the Phoenix table, CA differs by 0.5 to 3 %, CN is too large by 30 to 80 %, and
    the table has no bounded instability.
    """
    cp_max = np.where(_MACH < 9.5, rayleigh_pitot_cp_max(_MACH, _GAMMA), _CP_MAX)[:, None]
    alpha = np.radians(_ALPHA_DEG)
    ca, cn, cm = newtonian_coefficients(body, alpha, cp_max)
    return GridTable("mach", _MACH, alpha, ca, cn, cm, "pchip", "modified Newtonian, forebody only")


def _ring_integrals(a: Array, b: Array) -> tuple[Array, Array]:
    """∫ f² dφ and ∫ f² cos φ dφ around the axis, where f = max(a + b cos φ, 0) and b ≥ 0."""
    ratio = np.divide(-a, b, out=np.where(a > 0.0, -1.0, 1.0), where=np.abs(a) < b)
    edge = np.arccos(ratio)  # the surface faces the stream for |φ| < edge
    sine = np.sqrt(1.0 - ratio**2)
    half = (edge + sine * ratio) / 2.0
    even = 2.0 * (a**2 * edge + 2.0 * a * b * sine + b**2 * half)
    odd = 2.0 * (a**2 * sine + 2.0 * a * b * half + b**2 * (sine - sine**3 / 3.0))
    return even, odd
