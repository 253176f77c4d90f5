"""A sphere-cone forebody, its surface cut into panels, and the bodies that are known by name.

The forebody is a body of revolution: a spherical nose, a cone tangent to it, and a rounded shoulder that is
tangent to the cone and ends at the largest diameter, where its tangent is parallel to the axis. The base is not
part of it. Lengths are in metres, in body axes with the nose at the origin and x forward, so the body lies at
x ≤ 0; y is right and z down.
"""

from __future__ import annotations

import csv
import math
from dataclasses import dataclass
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from edl_filter.errors import InputError

__all__ = ["Meridian", "Panels", "SphereCone", "centre_of_pressure", "sphere_cone"]

#: Relative slack for tangency, so that a body given by rounded decimals is not refused for round-off.
_SLACK = 1e-9

_COLUMNS = ("vehicle", "D_m", "Rn_m", "Rc_m", "cone_half_angle_deg")


class Meridian(NamedTuple):
    """Gauss points on the meridian: everything a ring integral needs.

    Attributes
    ----------
    x, radius : (M,)
        Place on the meridian, m; x ≤ 0.
    normal_x, normal_r : (M,)
        Outward unit normal, forward and radial part.
    length : (M,)
        Arc length that the point stands for, m.
    """

    x: NDArray[np.float64]
    radius: NDArray[np.float64]
    normal_x: NDArray[np.float64]
    normal_r: NDArray[np.float64]
    length: NDArray[np.float64]


class Panels(NamedTuple):
    """Surface panels in body axes, nose at the origin, x forward.

    Attributes
    ----------
    centre, normal : (P, 3)
        Points of the panels, m, and outward unit normals there.
    area : (P,)
        Areas, m²; Gauss weights along the meridian, so sums converge much faster than with flat facets.
    """

    centre: NDArray[np.float64]
    normal: NDArray[np.float64]
    area: NDArray[np.float64]


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
        If a length is not a usable number or the three pieces cannot be tangent.
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
        if self.shoulder_radius > half * (1.0 + _SLACK):
            raise InputError(f"shoulder_radius {self.shoulder_radius:g} m is larger than half the diameter, {half:g} m")
        nose_end, shoulder_start = self._tangency()
        if nose_end > shoulder_start + _SLACK * self.diameter:
            raise InputError(
                f"the nose and the shoulder overlap: nose_radius {self.nose_radius:g} m meets the cone at a radius of "
                f"{nose_end:g} m, the shoulder begins at {shoulder_start:g} m, so no "
                "cone fits between them"
            )
        if math.sin(self.cone_half_angle) < _SLACK and nose_end < shoulder_start - _SLACK * self.diameter:
            raise InputError(
                f"cone_half_angle is 0, so the body cannot widen from nose_radius {self.nose_radius:g} m to half the "
                f"diameter, {half:g} m"
            )

    @property
    def reference_area(self) -> float:
        """Reference area π D²/4, m²."""
        return math.pi * self.diameter**2 / 4.0

    @property
    def length(self) -> float:
        """Length along the axis from the nose to the largest diameter, m."""
        return -self._shoulder_x()

    def meridian(self, points: int) -> Meridian:
        """Gauss points along the meridian, from the nose outward.

        Parameters
        ----------
        points : int
            Points on each of the nose, the cone and the shoulder; a piece of no length has none.
        """
        if points < 1:
            raise InputError(f"a meridian needs at least one point per segment, found {points}")
        abscissa, gauss = np.polynomial.legendre.leggauss(points)
        fraction, gauss = (abscissa + 1.0) / 2.0, gauss / 2.0
        theta, turn = self.cone_half_angle, math.pi / 2.0 - self.cone_half_angle
        nose_end, shoulder_start = self._tangency()
        pieces = []
        if self.nose_radius * turn > 1e-12 * self.diameter:
            polar, radius = turn * fraction, self.nose_radius
            # 1 − cos = 2 sin² of the half: no cancellation beside the axis
            x = -2.0 * radius * np.sin(polar / 2.0) ** 2
            pieces.append((x, radius * np.sin(polar), np.cos(polar), np.sin(polar), radius * turn * gauss))
        if shoulder_start - nose_end > _SLACK * self.diameter:
            rise = shoulder_start - nose_end
            x = -self._nose_depth() - rise * fraction / math.tan(theta)
            r, one = nose_end + rise * fraction, np.ones(points)
            pieces.append((x, r, math.sin(theta) * one, math.cos(theta) * one, rise / math.sin(theta) * gauss))
        if self.shoulder_radius * theta > 1e-12 * self.diameter:
            polar, radius = turn + theta * fraction, self.shoulder_radius
            x = self._shoulder_x() + radius * np.cos(polar)
            r = self.diameter / 2.0 - radius + radius * np.sin(polar)
            pieces.append((x, r, np.cos(polar), np.sin(polar), radius * theta * gauss))
        return Meridian(*(np.concatenate(column) for column in zip(*pieces, strict=True)))

    def panels(self, meridian_points: int = 24, azimuths: int = 48) -> Panels:
        """The surface as panels, in metres.

        Parameters
        ----------
        meridian_points : int
            Gauss points on each of the nose, the cone and the shoulder.
        azimuths : int
            Equal steps around the axis; an even number keeps the symmetry between α and −α to round-off.

        Returns
        -------
        Panels
            Ring by ring from the nose; in a ring by azimuth from +z (down) towards +y (right).
        """
        if azimuths < 3:
            raise InputError(f"panels need at least 3 azimuths, found {azimuths}")
        line = self.meridian(meridian_points)
        azimuth = 2.0 * math.pi * (np.arange(azimuths) + 0.5) / azimuths
        around = np.stack([np.zeros(azimuths), np.sin(azimuth), np.cos(azimuth)], axis=-1)
        forward = np.array([1.0, 0.0, 0.0])
        centre = line.x[:, None, None] * forward + line.radius[:, None, None] * around
        normal = line.normal_x[:, None, None] * forward + line.normal_r[:, None, None] * around
        area = np.repeat(line.radius * line.length * (2.0 * math.pi / azimuths), azimuths)
        return Panels(centre.reshape(-1, 3), normal.reshape(-1, 3), area)

    def _tangency(self) -> tuple[float, float]:
        """Radii at which the nose ends and the shoulder begins."""
        cosine = math.cos(self.cone_half_angle)
        return self.nose_radius * cosine, self.diameter / 2.0 - self.shoulder_radius * (1.0 - cosine)

    def _nose_depth(self) -> float:
        return self.nose_radius * (1.0 - math.sin(self.cone_half_angle))

    def _shoulder_x(self) -> float:
        """Coordinate x of the shoulder's centre, which is that of the largest diameter."""
        nose_end, shoulder_start = self._tangency()
        rise = max(shoulder_start - nose_end, 0.0)
        cone = rise / math.tan(self.cone_half_angle) if rise > _SLACK * self.diameter else 0.0
        return -self._nose_depth() - cone - self.shoulder_radius * math.sin(self.cone_half_angle)


def sphere_cone(name: str, table: Path | None = None) -> SphereCone:
    """The forebody of a vehicle known by name, such as ``"MER"``; capitals do not matter.

    Parameters
    ----------
    name : str
        A vehicle in the table.
    table : Path, optional
        CSV with the columns ``vehicle, D_m, Rn_m, Rc_m, cone_half_angle_deg``; the package's own if not given.
    """
    bodies = _bodies(table)
    found = bodies.get(name.casefold())
    if found is None:
        raise InputError(f"no forebody named {name!r}; known are {', '.join(known for known, _ in bodies.values())}")
    return found[1]


def centre_of_pressure(cn: ArrayLike, cm_nose: ArrayLike) -> NDArray[np.float64]:
    """Distance of the centre of pressure behind the nose, in diameters.

    At a small angle (a degree or less) this is the ratio of the slopes, −Cmα/CNα. Where CN is 0 it is NaN.
    """
    normal, moment = np.broadcast_arrays(np.asarray(cn, dtype=float), np.asarray(cm_nose, dtype=float))
    ratio = np.full(normal.shape, np.nan)
    return np.divide(-moment, normal, out=ratio, where=normal != 0.0)[()]


def _bodies(table: Path | None) -> dict[str, tuple[str, SphereCone]]:
    """Folded name → (name as printed, body)."""
    source: Traversable = table or resources.files("edl_filter") / "data" / "vehicle_geometry.csv"
    lines = [line for line in source.read_text(encoding="utf-8").splitlines() if not line.startswith("#")]
    rows = csv.DictReader(lines)
    missing = [column for column in _COLUMNS if column not in (rows.fieldnames or ())]
    if missing:
        raise InputError(f"{source.name}: the columns {', '.join(missing)} are missing")
    bodies = {}
    for row in rows:
        try:
            diameter, nose, shoulder, angle = (float(row[column]) for column in _COLUMNS[1:])
            body = SphereCone(diameter, nose, shoulder, math.radians(angle))
        except (TypeError, ValueError) as wrong:
            raise InputError(f"{source.name}: the row of {row['vehicle']} has a size that is not a number") from wrong
        except InputError as wrong:
            raise InputError(f"{source.name}, {row['vehicle']}: {wrong}") from wrong
        bodies[row["vehicle"].casefold()] = (row["vehicle"], body)
    return bodies
