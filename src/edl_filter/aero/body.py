"""Sphere-cone forebodies: geometry, surface panels, and the forebodies of vehicles by name.

Input: diameter, radii and cone angle, or the name of a vehicle. Output: Gauss points on the meridian or panels on the
surface. The forebody is a body of revolution: a spherical nose, a cone tangent to it, and a rounded shoulder that is
tangent to the cone and ends at the largest diameter, where its tangent is parallel to the axis. The base is not part of
it. Lengths are in metres, in body axes with the nose at the origin and x forward, so that the body is at x ≤ 0; y is
right and z down.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from edl_filter.aero.conventions import reference_area
from edl_filter.errors import InputError
from edl_filter.io.csv_table import package_data, read_records
from edl_filter.types import Array

__all__ = ["Meridian", "Panels", "SphereCone", "sphere_cone"]

#: Relative tolerance of the tangency conditions, for bodies that are given in rounded decimals.
_TOLERANCE = 1e-9

_COLUMNS = ("vehicle", "D_m", "Rn_m", "Rc_m", "cone_half_angle_deg")


class Meridian(NamedTuple):
    """Gauss points on the meridian, for integrals over rings of the surface.

    Attributes
    ----------
    x, radius : (M,) arrays
        Axial coordinate (x ≤ 0) and distance from the axis, m.
    normal_x, normal_r : (M,) arrays
        Axial and radial component of the outward unit normal.
    length : (M,) array
        Gauss weight: arc length, m.
    """

    x: Array
    radius: Array
    normal_x: Array
    normal_r: Array
    length: Array


class Panels(NamedTuple):
    """Surface panels in body axes, nose at the origin, x forward.

    Attributes
    ----------
    centre, normal : (P, 3) arrays
        Points of the panels, m, and outward unit normals at them.
    area : (P,) array
        m². With Gauss weights along the meridian sums converge much faster than with flat facets.
    """

    centre: Array
    normal: Array
    area: Array


@dataclass(frozen=True)
class SphereCone:
    """Forebody of revolution: spherical nose, cone, rounded shoulder up to the largest diameter.

    A cone half-angle of π/2 with no shoulder is a flat disc; one of 0 with a nose radius of half the diameter is a
    hemisphere; a nose radius of 0 is a sharp cone.

    Parameters
    ----------
    diameter : float
        Largest diameter D, m.
    nose_radius, shoulder_radius : float
        Radii of the nose and of the shoulder, m; 0 is sharp.
    cone_half_angle : float
        Angle between the axis and the cone, rad.

    Raises
    ------
    InputError
        A length is not a valid number, or the three parts cannot be tangent.
    """

    diameter: float
    nose_radius: float
    shoulder_radius: float
    cone_half_angle: float

    def __post_init__(self) -> None:
        if not (math.isfinite(self.diameter) and self.diameter > 0.0):
            raise InputError(f"diameter must be a positive length in metres, found {self.diameter}")
        for name in ("nose_radius", "shoulder_radius"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0.0):
                raise InputError(f"{name} must be a length in metres, zero or more, found {value}")
        if not 0.0 <= self.cone_half_angle <= math.pi / 2.0:
            raise InputError(f"cone_half_angle must lie between 0 and π/2 radians, found {self.cone_half_angle}")
        half = self.diameter / 2.0
        if self.shoulder_radius > half * (1.0 + _TOLERANCE):
            raise InputError(f"shoulder_radius {self.shoulder_radius:g} m is larger than half the diameter, {half:g} m")
        nose_end, shoulder_start = self._tangency()
        if nose_end > shoulder_start + _TOLERANCE * self.diameter:
            raise InputError(
                f"the nose and the shoulder overlap: nose_radius {self.nose_radius:g} m meets the cone at a radius of "
                f"{nose_end:g} m, the shoulder begins at {shoulder_start:g} m, so no "
                "cone fits between them"
            )
        if math.sin(self.cone_half_angle) < _TOLERANCE and nose_end < shoulder_start - _TOLERANCE * self.diameter:
            raise InputError(
                f"cone_half_angle is 0, so the body cannot widen from nose_radius {self.nose_radius:g} m to half the "
                f"diameter, {half:g} m"
            )

    @property
    def reference_area(self) -> float:
        """Reference area π D²/4, m²."""
        return reference_area(self.diameter)

    @property
    def length(self) -> float:
        """Length along the axis from the nose to the largest diameter, m."""
        return -self._shoulder_x()

    def meridian(self, points: int) -> Meridian:
        """Gauss points along the meridian, from the nose outward.

        Parameters
        ----------
        points : int
            Number of points on each of the nose, the cone and the shoulder; a part of zero length has none.

        Returns
        -------
        Meridian
        """
        if points < 1:
            raise InputError(f"a meridian needs at least one point per segment, found {points}")
        abscissa, weight = np.polynomial.legendre.leggauss(points)
        fraction, weight = (abscissa + 1.0) / 2.0, weight / 2.0
        theta, nose_arc = self.cone_half_angle, math.pi / 2.0 - self.cone_half_angle
        nose_end, shoulder_start = self._tangency()
        parts = []
        if self.nose_radius * nose_arc > 1e-12 * self.diameter:
            polar, radius = nose_arc * fraction, self.nose_radius
            # 1 − cos(polar) = 2 sin²(polar / 2), without cancellation near the axis
            x = -2.0 * radius * np.sin(polar / 2.0) ** 2
            parts.append((x, radius * np.sin(polar), np.cos(polar), np.sin(polar), radius * nose_arc * weight))
        if shoulder_start - nose_end > _TOLERANCE * self.diameter:
            rise = shoulder_start - nose_end
            x = -self._nose_depth() - rise * fraction / math.tan(theta)
            r, ones = nose_end + rise * fraction, np.ones(points)
            parts.append((x, r, math.sin(theta) * ones, math.cos(theta) * ones, rise / math.sin(theta) * weight))
        if self.shoulder_radius * theta > 1e-12 * self.diameter:
            polar, radius = nose_arc + theta * fraction, self.shoulder_radius
            x = self._shoulder_x() + radius * np.cos(polar)
            r = self.diameter / 2.0 - radius + radius * np.sin(polar)
            parts.append((x, r, np.cos(polar), np.sin(polar), radius * theta * weight))
        return Meridian(*(np.concatenate(column) for column in zip(*parts, strict=True)))

    def panels(self, meridian_points: int = 24, azimuths: int = 48) -> Panels:
        """Panels of the surface.

        Parameters
        ----------
        meridian_points : int
            Number of Gauss points on each of the nose, the cone and the shoulder.
        azimuths : int
            Number of equal steps around the axis; with an even number the symmetry between α and −α is exact to
            rounding.

        Returns
        -------
        Panels
            In rings from the nose; within a ring by azimuth from +z (down) towards +y (right).
        """
        if azimuths < 3:
            raise InputError(f"panels need at least 3 azimuths, found {azimuths}")
        meridian = self.meridian(meridian_points)
        azimuth = 2.0 * math.pi * (np.arange(azimuths) + 0.5) / azimuths
        radial = np.stack([np.zeros(azimuths), np.sin(azimuth), np.cos(azimuth)], axis=-1)
        axial = np.array([1.0, 0.0, 0.0])
        centre = meridian.x[:, None, None] * axial + meridian.radius[:, None, None] * radial
        normal = meridian.normal_x[:, None, None] * axial + meridian.normal_r[:, None, None] * radial
        area = np.repeat(meridian.radius * meridian.length * (2.0 * math.pi / azimuths), azimuths)
        return Panels(centre.reshape(-1, 3), normal.reshape(-1, 3), area)

    def _tangency(self) -> tuple[float, float]:
        """Distances from the axis at which the nose ends and the shoulder begins, m."""
        cosine = math.cos(self.cone_half_angle)
        return self.nose_radius * cosine, self.diameter / 2.0 - self.shoulder_radius * (1.0 - cosine)

    def _nose_depth(self) -> float:
        """Axial length of the nose, m."""
        return self.nose_radius * (1.0 - math.sin(self.cone_half_angle))

    def _shoulder_x(self) -> float:
        """Coordinate x of the shoulder's centre of curvature and of the largest diameter, m."""
        nose_end, shoulder_start = self._tangency()
        rise = max(shoulder_start - nose_end, 0.0)
        cone = rise / math.tan(self.cone_half_angle) if rise > _TOLERANCE * self.diameter else 0.0
        return -self._nose_depth() - cone - self.shoulder_radius * math.sin(self.cone_half_angle)


def sphere_cone(name: str) -> SphereCone:
    """Forebody of a vehicle by its name, such as ``"MER"``, in upper or lower case.

    Parameters
    ----------
    name : str
        A vehicle in the package's table.

    Returns
    -------
    SphereCone

    Raises
    ------
    InputError
        There is no such vehicle.
    """
    bodies = _package_bodies()
    if name.casefold() not in bodies:
        raise InputError(
            f"no forebody named {name!r}; known are {', '.join(vehicle for vehicle, _ in bodies.values())}"
        )
    return bodies[name.casefold()][1]


@cache
def _package_bodies() -> dict[str, tuple[str, SphereCone]]:
    """Bodies of the package's table, which is read once."""
    return _bodies(package_data("vehicle_geometry.csv"))


def _bodies(table: Path) -> dict[str, tuple[str, SphereCone]]:
    """Name in lower case → (name in the table, body) of a CSV ``vehicle, D_m, Rn_m, Rc_m, cone_half_angle_deg``."""
    bodies = {}
    for row in read_records(table, _COLUMNS):
        try:
            diameter, nose, shoulder, angle = (float(row[column]) for column in _COLUMNS[1:])
            body = SphereCone(diameter, nose, shoulder, math.radians(angle))
        except (TypeError, ValueError) as error:
            raise InputError(f"{table.name}: the row of {row['vehicle']} has a size that is not a number") from error
        except InputError as error:
            raise InputError(f"{table.name}, {row['vehicle']}: {error}") from error
        bodies[row["vehicle"].casefold()] = (row["vehicle"], body)
    return bodies
