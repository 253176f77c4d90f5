"""Where the vehicle landed, on a map about that place: from trajectory and landing constraint alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from xarray import DataTree

from edl_filter.report import view
from edl_filter.types import Array


@dataclass(frozen=True)
class Local:
    """Map about a point of the ground, from the trajectory alone.

    Attributes
    ----------
    origin : (3,) array
        Planet-fixed position, m.
    matrix : (3, 3) array
        Its rows are east, north and up (along the radius) in planet-fixed components.
    """

    origin: Array
    matrix: Array

    def offset(self, fixed: Array) -> Array:
        """East and north ``(..., 2)`` of planet-fixed positions ``(..., 3)``, m, along great circles."""
        local = np.asarray(fixed, float) @ self.matrix.T
        across = np.linalg.norm(local[..., :2], axis=-1, keepdims=True)
        angle = np.arctan2(across, local[..., 2:])
        radius = float(np.linalg.norm(self.origin))
        return radius * local[..., :2] * np.divide(angle, across, out=np.ones_like(across), where=across > 0.0)

    def spread(self, covariance: Array) -> Array:
        """Covariance ``(2, 2)`` of east and north from one of a planet-fixed position."""
        return (self.matrix @ covariance @ self.matrix.T)[:2, :2]


@dataclass(frozen=True)
class Landing:
    """Where the vehicle landed, as estimated and as all other knowledge predicts it; planet-fixed, m.

    Attributes
    ----------
    time : float
    position, covariance : (3,) and (3, 3) arrays
        Smoothed.
    site : (3,) array or None
        Landing place as measured.
    predicted, predicted_covariance : (3,), (3, 3) arrays or None
        Without the landing constraint.
    """

    time: float
    position: Array
    covariance: Array
    site: Array | None
    predicted: Array | None
    predicted_covariance: Array | None


def about(point: Array) -> Local:
    """Map about a planet-fixed point."""
    up = point / np.linalg.norm(point)
    east = np.array([-up[1], up[0], 0.0]) / np.hypot(up[0], up[1])
    return Local(point, np.array([east, np.cross(up, east), up]))


def fixed_track(tree: DataTree) -> Array:
    """Planet-fixed positions ``(N, 3)``, m: the inertial ones turned to their longitudes."""
    position, longitude = view.trajectory(tree, "position"), view.longitude(tree)
    assert position is not None and longitude is not None
    across = np.hypot(position[:, 0], position[:, 1])
    return np.column_stack((across * np.cos(longitude), across * np.sin(longitude), position[:, 2]))


def landing(tree: DataTree) -> Landing:
    """Find the landing in a run's results; without a landing event the trajectory's end."""
    time, fixed = view.time(tree), fixed_track(tree)
    constraint = view.constraints(tree).get("landing")
    when = view.event(tree, "landing")
    if constraint is not None and "time" in constraint:
        when = float(np.atleast_1d(constraint["time"].values)[0])
    k = len(time) - 1 if when is None else int(np.argmin(np.abs(time - when)))
    inertial, covariance = view.trajectory(tree, "position"), view.trajectory(tree, "covariance")
    assert inertial is not None
    turn = np.arctan2(fixed[k, 1], fixed[k, 0]) - np.arctan2(inertial[k, 1], inertial[k, 0])
    c, s = np.cos(turn), np.sin(turn)
    matrix = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    known = np.full((3, 3), np.nan) if covariance is None else matrix @ covariance[k, :3, :3] @ matrix.T
    site = predicted = spread = None
    if constraint is not None and "measured" in constraint:
        site = np.asarray(constraint["measured"].values, float).reshape(-1, 3)[0]
        predicted = site - np.asarray(constraint["left_out"].values, float).reshape(-1, 3)[0]
        if "noise" in constraint:
            noise = np.asarray(constraint["noise"].values, float).reshape(-1, 3, 3)[0]
            spread = np.asarray(constraint["left_out_covariance"].values, float) - noise
    return Landing(float(time[k]), fixed[k], known, site, predicted, spread)
