"""The filter's initial estimate: entry state, its covariance, and the states that explain its errors.

An entry state is stated for an epoch on the spacecraft's clock and in a frame. Both can be wrong. Their errors are
constant states of their own, correlated with position and velocity at the start, so that the filter estimates how much
of the correction of position and velocity is due to each.

An attitude that is computed on board is propagated as such: the sum of the gyros' readings from an initial attitude
that may be wrong. Its readings are known exactly, the vehicle's true rotation is not. It therefore contains no
information on the true attitude, except over a gap of the telemetry, where it contains the rotation that the samples
lack.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from edl_filter import rotations
from edl_filter.imu_model.sensor_errors import SENSOR_STATES, SensorErrors
from edl_filter.navigation.layout import ONBOARD, Layout, State
from edl_filter.planet import Planet
from edl_filter.telemetry.record import InitialState
from edl_filter.types import Array


@dataclass(frozen=True)
class EntryErrors:
    """Errors of an entry state in addition to its own covariance.

    Attributes
    ----------
    epoch_sigma : float
        Of the state's time, s; zero: no such state.
    frame_sigma : float
        Of a rotation of position and velocity together, rad per inertial axis; zero: no such state.
    onboard_attitude : (4,) array or None
        Attitude computed on board at the state's time, if there is one to be propagated.
    onboard_sigma : float
        Of that number itself, rad: its rounding.
    onboard_rate_sigma, onboard_mounting_sigma : float
        How far the rates and the mounting that it was computed with differ from the gyro samples', rad/s and rad per
        body axis; zero: no such state.
    """

    epoch_sigma: float = 0.0
    frame_sigma: float = 0.0
    onboard_attitude: Array | None = None
    onboard_sigma: float = 0.0
    onboard_rate_sigma: float = 0.0
    onboard_mounting_sigma: float = 0.0

    @property
    def states(self) -> dict[str, int]:
        """Names and lengths of the states that these errors are."""
        onboard = self.onboard_attitude is not None
        candidates = {
            "entry_epoch": (1, self.epoch_sigma > 0.0),
            "entry_frame": (3, self.frame_sigma > 0.0),
            "onboard_rate": (3, onboard and self.onboard_rate_sigma > 0.0),
            "onboard_mounting": (3, onboard and self.onboard_mounting_sigma > 0.0),
            ONBOARD: (3, onboard),
        }
        return {name: size for name, (size, present) in candidates.items() if present}

    def instrument_prior(self, layout: Layout) -> dict[str, float]:
        """Sigmas of the states that belong to the instrument behind the on-board attitude, by name."""
        sigmas = {"onboard_rate": self.onboard_rate_sigma, "onboard_mounting": self.onboard_mounting_sigma}
        return {name: sigma for name, sigma in sigmas.items() if name in layout}


def initial_estimate(
    layout: Layout, initial: InitialState, entry: EntryErrors, errors: SensorErrors, planet: Planet
) -> tuple[State, Array]:
    """Reference state and covariance at the initial state's time.

    Parameters
    ----------
    layout : Layout
        Of the filter's vector.
    initial : InitialState
        Its covariance is that of the errors which `entry` does not contain.
    entry : EntryErrors
        Errors of the entry state in addition to its covariance.
    errors : SensorErrors
        Of the instrument that drives first.
    planet : Planet
        Gravity and rotation.

    Returns
    -------
    state : State
    covariance : (n, n) array
        In the units of `layout.UNITS`.
    """
    nav = np.concatenate((initial.position, initial.velocity, initial.inertial_from_body))
    prior = np.zeros((layout.size, layout.size))
    prior[:9, :9] = initial.covariance
    prior[layout.sensor, layout.sensor] = sensor_prior(layout, errors)
    jacobian = np.eye(layout.size)
    if "entry_epoch" in layout:
        block = layout["entry_epoch"]
        prior[block, block] = entry.epoch_sigma**2
        jacobian[:6, block] = epoch_jacobian(initial, planet)[:, None]
    if "entry_frame" in layout:
        block = layout["entry_frame"]
        prior[block, block] = entry.frame_sigma**2 * np.eye(3)
        jacobian[:6, block] = frame_jacobian(initial)
    for name, sigma in entry.instrument_prior(layout).items():
        prior[layout[name], layout[name]] = sigma**2 * np.eye(3)
    if entry.onboard_attitude is not None:
        block = layout[ONBOARD]
        nav = np.concatenate((nav, entry.onboard_attitude))
        prior[block, block] = entry.onboard_sigma**2 * np.eye(3)
    return State(nav, np.zeros(layout.size)), jacobian @ prior @ jacobian.T


def epoch_jacobian(initial: InitialState, planet: Planet) -> Array:
    """Derivative of the true state at the stated time with respect to the error of that time, in free fall.

    Parameters
    ----------
    initial : InitialState
        Stated state and covariance.
    planet : Planet
        Gravity and rotation.

    Returns
    -------
    (6,) array
        Position (m/s) and velocity (m/s²) per second by which the stated state is late.
    """
    return np.concatenate((initial.velocity, planet.gravity(initial.position)))


def frame_jacobian(initial: InitialState) -> Array:
    """Derivative of position (m) and velocity (m/s) with respect to a rotation (rad) of their frame, ``(6, 3)``."""
    return np.concatenate((-rotations.cross_matrix(initial.position), -rotations.cross_matrix(initial.velocity)))


def sensor_prior(layout: Layout, errors: SensorErrors) -> Array:
    """Prior covariance of the sensor errors of one instrument, in the order of `Layout.sensor`, ``(3 k, 3 k)``.

    A state that another instrument has and this one does not keeps a variance of 1e-24, so that the covariance stays
    positive definite.
    """
    sigmas = [max(getattr(errors, n), 1e-12) for n in SENSOR_STATES if n in layout]
    return np.diag(np.repeat(np.square(sigmas), 3))
