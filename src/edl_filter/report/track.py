"""Ground track, and landing position with its uncertainty."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from edl_filter.errors import InputError
from edl_filter.report.description import Axis, Curve, Element, Figure, Legend, Panel, Region, ellipse_outline
from edl_filter.report.trajectory import samples_within, time_axis
from edl_filter.results.reader import ResultReader
from edl_filter.types import Array

SIGMAS = 3.0
#: Interval of the time marks, s, and their least distance as a share of the length of the track.
_INTERVAL, _DISTANCE = 30.0, 0.09


@dataclass(frozen=True, eq=False)
class LocalMap:
    """Map about a point of the ground.

    Attributes
    ----------
    origin : (3,) array
        Planet-fixed position, m.
    matrix : (3, 3) array
        Rows are east, north and up (along the radius) in planet-fixed components.
    """

    origin: Array
    matrix: Array

    @classmethod
    def centred_at(cls, point: Array) -> LocalMap:
        """Map about a planet-fixed position ``(3,)``, m."""
        up = point / np.linalg.norm(point)
        east = np.array([-up[1], up[0], 0.0]) / np.hypot(up[0], up[1])
        return cls(point, np.array([east, np.cross(up, east), up]))

    def offset(self, positions: Array) -> Array:
        """East and north ``(..., 2)`` of planet-fixed positions ``(..., 3)``, m, along great circles."""
        local = np.asarray(positions, float) @ self.matrix.T
        horizontal = np.linalg.norm(local[..., :2], axis=-1, keepdims=True)
        angle = np.arctan2(horizontal, local[..., 2:])
        scale = np.divide(angle, horizontal, out=np.ones_like(horizontal), where=horizontal > 0.0)
        return float(np.linalg.norm(self.origin)) * local[..., :2] * scale

    def horizontal_covariance(self, covariance: Array) -> Array:
        """Covariance ``(2, 2)`` of east and north, m², from ``(3, 3)`` of a planet-fixed position, m²."""
        return (self.matrix @ covariance @ self.matrix.T)[:2, :2]


@dataclass(frozen=True, eq=False)
class LandingEstimate:
    """Landing position as estimated, as measured, and as predicted without the landing constraint; planet-fixed.

    Attributes
    ----------
    landed : bool
        Whether the vehicle landed within the record; else the position is that at its end.
    time : float
        s since the epoch.
    position, covariance : (3,) and (3, 3) arrays
        Smoothed, m and m²; NaN where the result has no covariance.
    site : (3,) array, optional
        Landing position as measured, m.
    predicted, predicted_covariance : (3,) and (3, 3) arrays, optional
        Prediction without the landing constraint, m and m².
    """

    landed: bool
    time: float
    position: Array
    covariance: Array
    site: Array | None
    predicted: Array | None
    predicted_covariance: Array | None

    @property
    def map(self) -> LocalMap:
        """Map about the site, or about the estimate if there is no site."""
        return LocalMap.centred_at(self.position if self.site is None else self.site)

    @property
    def origin(self) -> str:
        """Origin of the map, in words."""
        if self.site is not None:
            return "the site"
        return "the estimated landing" if self.landed else "the end of the record"


def fixed_track(reader: ResultReader) -> Array:
    """Planet-fixed positions ``(N, 3)``, m: the inertial ones rotated to their longitudes."""
    position, longitude = reader.required("trajectory", "position"), reader.longitude
    if longitude is None:
        raise InputError(f"{reader.title}: found no longitude in group /trajectory of the result.")
    distance = np.hypot(position[:, 0], position[:, 1])
    return np.column_stack((distance * np.cos(longitude), distance * np.sin(longitude), position[:, 2]))


def landing_estimate(reader: ResultReader) -> LandingEstimate:
    """Landing of a result; the end of the trajectory if there is no landing event."""
    time, track = reader.time, fixed_track(reader)
    landing_time = reader.events.get("landing", float(time[-1]))
    group = "constraints/landing"
    at_rest = reader.variable("constraints/rest_velocity", "time") is not None
    landed = "landing" in reader.events or at_rest or reader.variable(group, "time") is not None
    if (times := reader.variable(group, "time")) is not None:
        landing_time = float(np.atleast_1d(times)[0])
    k = int(np.argmin(np.abs(time - landing_time)))
    position, covariance = reader.required("trajectory", "position"), reader.trajectory("covariance")
    angle = np.arctan2(track[k, 1], track[k, 0]) - np.arctan2(position[k, 1], position[k, 0])
    c, s = np.cos(angle), np.sin(angle)
    matrix = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    smoothed = np.full((3, 3), np.nan) if covariance is None else matrix @ covariance[k, :3, :3] @ matrix.T
    site = predicted = predicted_covariance = None
    measured, difference = reader.variable(group, "measured"), reader.variable(group, "left_out")
    if measured is not None:
        site = measured.reshape(-1, 3)[0]
        if difference is not None:
            predicted = site - difference.reshape(-1, 3)[0]
        noise, total = reader.variable(group, "noise"), reader.variable(group, "left_out_covariance")
        if noise is not None and total is not None:
            predicted_covariance = total - noise.reshape(-1, 3, 3)[0]
    return LandingEstimate(landed, float(time[k]), track[k], smoothed, site, predicted, predicted_covariance)


def ground_track(reader: ResultReader) -> Panel:
    """Track over the ground to the landing, with a mark every 30 s, in km from the site."""
    landing = landing_estimate(reader)
    track, time = 1e-3 * landing.map.offset(fixed_track(reader)), reader.time
    inside = samples_within(time, time_axis(reader))
    east, north = track[inside].T
    length = float(np.hypot(np.ptp(east), np.ptp(north)))
    low, high = reader.span()
    marks: list[tuple[float, Array]] = []
    for t in np.arange(_INTERVAL * np.ceil(low / _INTERVAL), high, _INTERVAL):
        point = np.array([np.interp(t, time, track[:, i]) for i in (0, 1)])
        previous = marks[-1][1] if marks else np.full(2, np.inf)
        if min(np.hypot(*(point - previous)), np.hypot(*point)) >= _DISTANCE * length:
            marks.append((t, point))
    elements: list[Element] = [_curve(track[inside], "ground track", "blue", 1.3)]
    if marks:
        points = np.array([point for _, point in marks])
        notes = tuple(f"{t:.0f} s" for t, _ in marks)
        elements.append(_curve(points, "", "blue", 0.0, symbol="circle", notes=notes))
    elements += _site(landing)
    ranges = [_padded(values, share) for values, share in ((east, 0.06), (north, 0.25))]
    x, y = _axes(landing)
    return Panel(replace(x, range=ranges[0]), replace(y, range=ranges[1]), tuple(elements), aspect="equal")


def landing_ellipse(reader: ResultReader, near: bool = False) -> Panel:
    """Landing position as estimated, as predicted without the landing constraint, and as measured.

    Ellipses of 3 sigma contain 98.9 % in two dimensions. With `near` the panel has the extent of the estimate and the
    site only.
    """
    landing = landing_estimate(reader)
    local = landing.map
    elements: list[Element] = []
    corners = [np.zeros((1, 2))]
    if landing.predicted is not None:
        added, extent = _estimate(
            local, landing.predicted, landing.predicted_covariance, "orange", "without landing constraint", not near
        )
        elements += added
        corners += [] if near else [extent]
    added, extent = _estimate(local, landing.position, landing.covariance, "blue", "estimate", True)
    elements += added
    corners.append(extent)
    inside = (reader.time >= reader.span()[0]) & (reader.time <= landing.time)
    track = 1e-3 * local.offset(fixed_track(reader)[inside])
    path = _curve(track, "ground track", "muted", 1.2)
    elements = [path, *elements, *_site(landing)]
    parachute = reader.events.get("parachute_deploy", np.inf)
    if parachute < landing.time:
        k = int(np.searchsorted(reader.time[inside], parachute))
        label = "parachute opens"
        elements.append(_curve(track[k : k + 1], label, "ink", 0.0, symbol="diamond", size=6.0))
    points = np.concatenate(corners)
    centre = 0.5 * (points.min(axis=0) + points.max(axis=0))
    half = max(1.15 * 0.5 * float(np.ptp(points, axis=0).max()), 1e-3)
    x, y = (
        replace(axis, range=(float(c - half), float(c + half))) for axis, c in zip(_axes(landing), centre, strict=True)
    )
    return Panel(x, y, tuple(elements), aspect="square", legend=Legend("best", 1))


def track_figure(reader: ResultReader) -> Figure:
    """Ground track, and the landing with its ellipses."""
    track, far, near = ground_track(reader), landing_ellipse(reader), landing_ellipse(reader, near=True)
    landing = landing_estimate(reader)
    both = landing.site is not None or landing.predicted is not None
    rows = ((track,), tuple(replace(panel, legend=None) for panel in ((far, near) if both else (far,))))
    subject = "ground track and landing" if landing.landed else "ground track"
    return Figure(
        f"{reader.title}: {subject}", rows, (2.8, 3.75), (1.0, 1.0), margins=(0.95, 0.3, 1.2),
        gaps=(0.25, 0.26), legend=True,
    )  # fmt: skip


def _axes(landing: LandingEstimate) -> tuple[Axis, Axis]:
    return Axis(f"east of {landing.origin}", "km"), Axis("north", "km")


def _curve(points: Array, label: str, colour: str, width: float, **style: Any) -> Curve:
    """Path or symbols at points ``(N, 2)`` east and north, km."""
    return Curve(points[:, 0], points[:, 1], label, colour, "km", width, independent="none", **style)


def _padded(values: Array, share: float) -> tuple[float, float]:
    low, high = min(float(values.min()), 0.0), max(float(values.max()), 0.0)
    room = share * (high - low) or 1.0
    return low - room, high + room


def _site(landing: LandingEstimate) -> list[Element]:
    if landing.site is None:
        return []
    return [_curve(np.zeros((1, 2)), "landing site", "vermillion", 0.0, symbol="star", size=13.0)]


def _estimate(
    local: LocalMap, position: Array, covariance: Array | None, colour: str, label: str, filled: bool
) -> tuple[list[Element], Array]:
    """An estimate with its ellipse, and the corners ``(K, 2)`` of its extent, km."""
    centre = 1e-3 * local.offset(position)
    point = _curve(centre[None], "", colour, 0.0, symbol="circle", size=6.0)
    if covariance is None or not np.isfinite(covariance).all():
        return [replace(point, label=label)], centre[None]
    spread = 1e-6 * local.horizontal_covariance(covariance)
    outline = ellipse_outline(centre, spread, SIGMAS)
    region = Region(outline[0], outline[1], f"{label}, {SIGMAS:.0f} sigma", colour, filled)
    return [region, point], centre + np.array([[-1.0], [1.0]]) * SIGMAS * np.sqrt(np.diag(spread))
