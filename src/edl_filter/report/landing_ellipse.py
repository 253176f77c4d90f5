"""Estimate, prediction and measurement of the landing position, on a map about it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from edl_filter.errors import InputError
from edl_filter.results.reader import ResultReader
from edl_filter.types import Array


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
    time : float
        s since the epoch.
    position, covariance : (3,) and (3, 3) arrays
        Smoothed, m and m²; NaN where the result has no covariance.
    site : (3,) array, optional
        Landing position as measured, m.
    predicted, predicted_covariance : (3,) and (3, 3) arrays, optional
        Prediction without the landing constraint, m and m².
    """

    time: float
    position: Array
    covariance: Array
    site: Array | None
    predicted: Array | None
    predicted_covariance: Array | None

    @property
    def map(self) -> LocalMap:
        """Map about the site, or about the estimated landing if there is no site."""
        return LocalMap.centred_at(self.position if self.site is None else self.site)


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
    return LandingEstimate(float(time[k]), track[k], smoothed, site, predicted, predicted_covariance)
