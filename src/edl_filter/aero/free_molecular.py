"""Free-molecular coefficients of a forebody, from Schaaf and Chambré's flat-panel formulas.

With the speed ratio s (speed over the most probable thermal speed √(2RT)), the angle θ between the stream and the
panel's plane, the wall's temperature T_w, and the normal and tangential accommodation both equal to σ:

    Cp = { [(2−σ) s_n/√π + (σ/2) √(T_w/T)] exp(−s_n²)
           + [(2−σ)(s_n² + ½) + (σ/2) √(π T_w/T) s_n] (1 + erf s_n) } / s²
    Cτ = σ cos θ { exp(−s_n²) + √π s_n (1 + erf s_n) } / (√π s),          s_n = s sin θ

A panel that faces away (sin θ < 0) is not switched off: the formulas fade out themselves, through 1 + erf, as the
few molecules that catch up with it do. The body is convex, so no other shadow exists.

Sources: S. A. Schaaf and P. L. Chambré, *Flow of Rarefied Gases*, Princeton University Press, 1961;
F. J. Regan and S. M. Anandakrishnan, *Dynamics of Atmospheric Re-Entry*, AIAA, 1993 (rarefied-flow chapter).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import erfc

from edl_filter.aero.body import Panels, SphereCone
from edl_filter.errors import InputError

__all__ = ["free_molecular_coefficients", "panel_coefficients"]

#: Angles worked on at once; bounds the memory to about ten megabytes.
_CHUNK = 64


def panel_coefficients(
    sin_incidence: ArrayLike, speed_ratio: float, wall_temperature_ratio: float, accommodation: float = 1.0
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Pressure and shear coefficients of a flat panel, one side.

    Parameters
    ----------
    sin_incidence : array_like
        sin θ, the cosine of the angle between the outward normal and the direction the stream comes from.
    speed_ratio : float
        Speed over √(2RT) of the free stream.
    wall_temperature_ratio : float
        Temperature of the wall over that of the free stream.
    accommodation : float
        Normal and tangential accommodation: 1 diffuse, 0 specular.

    Returns
    -------
    pressure, shear_over_cosine : ndarray
        Cp and Cτ/cos θ; the second stays smooth where the stream is normal to the panel.
    """
    _check(speed_ratio, wall_temperature_ratio, accommodation)
    s, sigma = speed_ratio, accommodation
    wall = math.sqrt(wall_temperature_ratio)
    normal = s * np.asarray(sin_incidence, dtype=float)
    hot = np.exp(-(normal**2))
    caught = erfc(-normal)  # 1 + erf without cancellation on the lee side
    # flux of molecules on the panel, over s/√π: enters the shear and the re-emitted pressure
    flux = hot + math.sqrt(math.pi) * normal * caught
    incident = normal * hot / math.sqrt(math.pi) + (normal**2 + 0.5) * caught
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
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Axial, normal and pitching-moment coefficients of a forebody in free-molecular flow.

    Parameters
    ----------
    body : SphereCone
        The forebody; its base is left out.
    alpha : array_like
        Angle of attack, rad; any shape.
    speed_ratio, wall_temperature_ratio, accommodation : float
        As in `panel_coefficients`.
    meridian_points, azimuths : int
        As in `SphereCone.panels`. The defaults are converged to 1e-6 for blunt cones up to 40 degrees at s ≤ 24; the
        rim of light and shadow is 1/s wide, so large angles or speed ratios want more.

    Returns
    -------
    ca, cn, cm_nose : ndarray
        Coefficients in the shape of `alpha`; reference π D²/4 and D, the moment about the nose, nose-up positive.
    """
    _check(speed_ratio, wall_temperature_ratio, accommodation)
    angles = np.asarray(alpha, dtype=float)
    flat = angles.ravel()
    panels = body.panels(meridian_points, azimuths)
    result = np.empty((3, flat.size))
    for start in range(0, flat.size, _CHUNK):
        part = slice(start, start + _CHUNK)
        result[:, part] = _sums(panels, flat[part], speed_ratio, wall_temperature_ratio, accommodation)
    result /= body.reference_area
    result[2] /= body.diameter
    ca, cn, cm = (row.reshape(angles.shape)[()] for row in result)
    return ca, cn, cm


def _sums(
    panels: Panels, alpha: NDArray[np.float64], speed_ratio: float, wall_temperature_ratio: float, accommodation: float
) -> NDArray[np.float64]:
    """CA, CN and Cm times area (and length): (3, A).

    The force on a panel over the dynamic pressure is −(Cp − μ Cτ/cos θ) n − (Cτ/cos θ) w, with w the direction the
    stream comes from and μ = n·w = sin θ.
    """
    upstream_x, upstream_z = np.cos(alpha), np.sin(alpha)
    x, z = panels.centre[:, 0], panels.centre[:, 2]
    normal_x, normal_z = panels.normal[:, 0], panels.normal[:, 2]
    incidence = upstream_x[:, None] * normal_x + upstream_z[:, None] * normal_z
    pressure, shear = panel_coefficients(incidence, speed_ratio, wall_temperature_ratio, accommodation)
    along_normal = pressure - incidence * shear
    drag = shear @ panels.area
    axial = along_normal @ (panels.area * normal_x) + upstream_x * drag
    sideways = along_normal @ (panels.area * normal_z) + upstream_z * drag
    # nose-up moment z Fx − x Fz
    moment = along_normal @ (panels.area * (x * normal_z - z * normal_x))
    moment += upstream_z * (shear @ (panels.area * x)) - upstream_x * (shear @ (panels.area * z))
    return np.stack([axial, sideways, moment])


def _check(speed_ratio: float, wall_temperature_ratio: float, accommodation: float) -> None:
    if not (math.isfinite(speed_ratio) and speed_ratio > 0.0):
        raise InputError(f"speed_ratio must be positive, found {speed_ratio}")
    if not (math.isfinite(wall_temperature_ratio) and wall_temperature_ratio >= 0.0):
        raise InputError(f"wall_temperature_ratio must be zero or more, found {wall_temperature_ratio}")
    if not 0.0 <= accommodation <= 1.0:
        raise InputError(f"accommodation must lie between 0 (specular) and 1 (diffuse), found {accommodation}")
