"""Free-molecular coefficients of a forebody, from Schaaf and Chambré's flat-panel formulas.

Input: geometry of the forebody, angles of attack, speed ratio, wall temperature, accommodation. Method: sum over
panels. Output: CA, CN and Cm about the nose.

With the speed ratio s (speed over the most probable thermal speed √(2RT)), the angle θ between the stream and the
panel's plane, the wall's temperature T_w, and the normal and tangential accommodation both equal to σ:

    Cp = { [(2−σ) s_n/√π + (σ/2) √(T_w/T)] exp(−s_n²)
           + [(2−σ)(s_n² + ½) + (σ/2) √(π T_w/T) s_n] (1 + erf s_n) } / s²
    Cτ = σ cos θ { exp(−s_n²) + √π s_n (1 + erf s_n) } / (√π s),          s_n = s sin θ

The formulas hold for panels that face away from the stream too (sin θ < 0): the pressure of the few molecules that
reach them decays with 1 + erf s_n. The body is convex, so that no panel is shadowed by another.

Sources: S. A. Schaaf and P. L. Chambré, *Flow of Rarefied Gases*, Princeton University Press, 1961;
F. J. Regan and S. M. Anandakrishnan, *Dynamics of Atmospheric Re-Entry*, AIAA, 1993 (rarefied-flow chapter).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import erfc

from edl_filter.aero.body import Panels, SphereCone
from edl_filter.errors import InputError
from edl_filter.types import Array

__all__ = ["free_molecular_coefficients", "panel_coefficients"]

#: Angles processed at once; limits the memory to about ten megabytes.
_CHUNK = 64


def panel_coefficients(
    sin_incidence: ArrayLike, speed_ratio: float, wall_temperature_ratio: float, accommodation: float = 1.0
) -> tuple[Array, Array]:
    """Pressure and shear coefficients on one side of a flat panel.

    Parameters
    ----------
    sin_incidence : (...) array
        sin θ: the cosine of the angle between the outward normal and the direction from which the stream comes.
    speed_ratio : float
        Speed over √(2RT) of the free stream.
    wall_temperature_ratio : float
        Temperature of the wall over that of the free stream.
    accommodation : float
        Normal and tangential accommodation: 1 diffuse, 0 specular.

    Returns
    -------
    pressure, shear_over_cosine : (...) arrays
        Cp and Cτ/cos θ; the latter is smooth where the stream is normal to the panel.

    Raises
    ------
    InputError
        A parameter is out of its range.
    """
    _check(speed_ratio, wall_temperature_ratio, accommodation)
    s, sigma = speed_ratio, accommodation
    wall = math.sqrt(wall_temperature_ratio)
    normal = s * np.asarray(sin_incidence, dtype=float)
    gaussian = np.exp(-(normal**2))
    one_plus_erf = erfc(-normal)  # without cancellation on the leeward side
    # Flux of molecules on the panel over s/√π, for the shear and the pressure of the re-emitted molecules
    flux = gaussian + math.sqrt(math.pi) * normal * one_plus_erf
    incident = normal * gaussian / math.sqrt(math.pi) + (normal**2 + 0.5) * one_plus_erf
    pressure = ((2.0 - sigma) * incident + 0.5 * sigma * wall * flux) / s**2
    return pressure, sigma * flux / (math.sqrt(math.pi) * s)


def free_molecular_coefficients(
    body: SphereCone,
    alpha: ArrayLike,
    speed_ratio: float = 24.0,
    wall_temperature_ratio: float = 2.1,
    accommodation: float = 1.0,
    *,
    meridian_points: int = 24,
    azimuths: int = 48,
) -> tuple[Array, Array, Array]:
    """Axial-force, normal-force and pitching-moment coefficients of a forebody in free-molecular flow.

    Parameters
    ----------
    body : SphereCone
        The forebody; the base is not included.
    alpha : (...) array
        Angle of attack, rad.
    speed_ratio, wall_temperature_ratio, accommodation : float
        As for `panel_coefficients`.
    meridian_points, azimuths : int
        As for `SphereCone.panels`. With the defaults the error is below 1e-6 for blunt cones up to 40 degrees at
        s ≤ 24. The transition between the windward and the leeward side is 1/s wide, so that large angles or speed
        ratios need more points.

    Returns
    -------
    ca, cn, cm_nose : (...) arrays
        Reference area π D²/4 and length D; the moment is about the nose, nose-up positive.

    Raises
    ------
    InputError
        A parameter is out of its range.
    """
    _check(speed_ratio, wall_temperature_ratio, accommodation)
    angles = np.asarray(alpha, dtype=float)
    flat = angles.ravel()
    panels = body.panels(meridian_points, azimuths)
    out = np.empty((3, flat.size))
    for start in range(0, flat.size, _CHUNK):
        chunk = slice(start, start + _CHUNK)
        out[:, chunk] = _sums(panels, flat[chunk], speed_ratio, wall_temperature_ratio, accommodation)
    out /= body.reference_area
    out[2] /= body.diameter
    ca, cn, cm = (row.reshape(angles.shape)[()] for row in out)
    return ca, cn, cm


def _sums(
    panels: Panels, alpha: Array, speed_ratio: float, wall_temperature_ratio: float, accommodation: float
) -> Array:
    """CA and CN times the reference area, Cm times reference area and length (3, A), m² and m³.

    The force on a panel over the dynamic pressure is −(Cp − μ Cτ/cos θ) n − (Cτ/cos θ) w, where w is the direction from
    which the stream comes and μ = n·w = sin θ.
    """
    upstream_x, upstream_z = np.cos(alpha), np.sin(alpha)
    x, z = panels.centre[:, 0], panels.centre[:, 2]
    normal_x, normal_z = panels.normal[:, 0], panels.normal[:, 2]
    incidence = upstream_x[:, None] * normal_x + upstream_z[:, None] * normal_z
    pressure, shear = panel_coefficients(incidence, speed_ratio, wall_temperature_ratio, accommodation)
    along_normal = pressure - incidence * shear
    along_stream = shear @ panels.area
    axial = along_normal @ (panels.area * normal_x) + upstream_x * along_stream
    normal = along_normal @ (panels.area * normal_z) + upstream_z * along_stream
    # Nose-up moment z Fx − x Fz
    moment = along_normal @ (panels.area * (x * normal_z - z * normal_x))
    moment += upstream_z * (shear @ (panels.area * x)) - upstream_x * (shear @ (panels.area * z))
    return np.stack([axial, normal, moment])


def _check(speed_ratio: float, wall_temperature_ratio: float, accommodation: float) -> None:
    """Raise if a parameter is out of its range."""
    if not (math.isfinite(speed_ratio) and speed_ratio > 0.0):
        raise InputError(f"speed_ratio must be positive, found {speed_ratio}")
    if not (math.isfinite(wall_temperature_ratio) and wall_temperature_ratio >= 0.0):
        raise InputError(f"wall_temperature_ratio must be zero or more, found {wall_temperature_ratio}")
    if not 0.0 <= accommodation <= 1.0:
        raise InputError(f"accommodation must lie between 0 (specular) and 1 (diffuse), found {accommodation}")
