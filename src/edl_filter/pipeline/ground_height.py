"""Height of the ground at the landing above the surface to which the altimeter's heights refer: it is that surface.

Input: a reconstruction with an altimeter and a landing. An error that all heights have in common, an offset or late
times while the vehicle descends at a constant speed, moves the whole path with it, and no reading is rejected. The
landing site contradicts it only beyond its own sigma, of three axes. But the vehicle touches the ground that the
altimeter measures. A reading h at the smoothed position r, and the position at the touchdown, give the common error b:

    (h - |r| + R) + (|r_touchdown| - R) = b + g + v,

with the surface's radius R, the reading's noise v, and the relief g, which is the height of the ground at the landing
above that below the reading. The relief is a random walk in the horizontal distance from the landing (Hurst exponent
0.5), with the rms slope of `_SLOPE` over `_BASELINE`. b is the generalised least-squares estimate, in which the last
readings, close to the landing, have most of the weight. Where the mission states
`AltimeterFromTelemetryConfig.relief_sigma`, g is a constant with that sigma instead. Output: b with its sigma, which
contains that of the height at the touchdown, and those of its time as stated and to one sample (uniform within it).
Readings that the gate rejected are not used.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from edl_filter.navigation.consensus import quantile
from edl_filter.navigation.constraints import Altimeter
from edl_filter.pipeline.load import event_time_sigma
from edl_filter.pipeline.reconstruct import Reconstruction
from edl_filter.types import Array

#: Rms slope, and the baseline to which it belongs (m): the requirement on the landing sites of the Mars Exploration
#: Rovers (Golombek et al. 2003, Journal of Geophysical Research 108, E12, 8072).
_SLOPE = np.tan(np.radians(5.0))
_BASELINE = 100.0


@dataclass(frozen=True)
class GroundHeight:
    """Height of the ground at the landing above the surface of the altimeter's heights.

    Attributes
    ----------
    height : float
        Common error of the heights, m; positive: they are too large.
    sigma : float
        One sigma, m, with that of the relief.
    significant : bool
        Whether it is beyond the gate of the mission's filter.
    """

    height: float
    sigma: float
    significant: bool


def ground_height(reconstruction: Reconstruction) -> GroundHeight | None:
    """Common error of the altimeter's heights; None without an altimeter that is used, or without a landing.

    Parameters
    ----------
    reconstruction : Reconstruction
        With its smoothed states.

    Returns
    -------
    GroundHeight or None
    """
    r = reconstruction
    stated, smoothed = r.mission.constraints.altimeter, r.smoothed
    uses = [(use.constraint, use.node) for use in r.filter_pass.fused if use.accepted]
    readings = [(c, node) for c, node in uses if isinstance(c, Altimeter)]
    landing = r.event_times.get("landing", None if r.telemetry.landing is None else r.telemetry.landing.time)
    if stated is None or not readings or landing is None or not smoothed.time[0] <= landing <= smoothed.time[-1]:
        return None
    touchdown = int(np.argmin(np.abs(smoothed.time - landing)))
    nodes = np.array([*(node for _, node in readings), touchdown])
    positions = np.array([smoothed.states[k].nav[:3] for k in nodes])
    fixed = r.problem.planet.rotation.to_fixed(smoothed.time[nodes], positions)
    radius = np.linalg.norm(fixed, axis=1)
    measured = np.array([c.height + c.surface_radius for c, _ in readings])
    height, variance = common_error(
        measured - radius[:-1],
        np.array([c.sigma for c, _ in readings]),
        np.linalg.norm(np.cross(fixed[:-1], fixed[-1] / radius[-1]), axis=1),
        stated.relief_sigma,
    )
    height += float(radius[-1]) - readings[-1][0].surface_radius
    up = positions[-1] / radius[-1]
    variance += float(up @ smoothed.covariance[touchdown][:3, :3] @ up)
    sample = float(np.median(r.telemetry.driving.interval))
    time_variance = event_time_sigma(r.mission, r.telemetry, "landing") ** 2 + sample**2 / 12.0
    variance += time_variance * float(up @ smoothed.states[touchdown].nav[3:6]) ** 2
    gate = quantile(r.problem.settings.gate_probability, 1)
    return GroundHeight(height, float(np.sqrt(variance)), height**2 > gate * variance)


def common_error(error: Array, sigma: Array, distance: Array, relief_sigma: float | None = None) -> tuple[float, float]:
    """Error that the readings of an altimeter have in common, by generalised least squares.

    Parameters
    ----------
    error : (N,) array
        Of each reading, m.
    sigma : (N,) array
        One sigma of the noise of each, m.
    distance : (N,) array
        Horizontal distance of each from the landing, m.
    relief_sigma : float, optional
        One sigma of a relief that all readings have in common, m. Default: that of a random walk in the distance.

    Returns
    -------
    estimate : float
        m.
    variance : float
        m².
    """
    relief = np.zeros((len(error), len(error)))
    if relief_sigma is None:
        relief = _SLOPE**2 * _BASELINE * np.minimum.outer(distance, distance)
    weights = np.linalg.solve(np.diag(sigma**2) + relief, np.ones(len(error)))
    variance = 1.0 / float(weights.sum())
    return variance * float(weights @ error), variance + (0.0 if relief_sigma is None else relief_sigma**2)
