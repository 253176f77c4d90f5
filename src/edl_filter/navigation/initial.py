"""The start of the filter: entry state, its covariance, and the states that explain its errors.

An entry state is stated for an epoch on the spacecraft's clock and in a frame. Both can be off. Their errors are
states of their own, constant, and correlated with position and velocity at the start, so that the filter's
estimate says which of them had to give.

An attitude that is computed on board is carried along as what it is: a sum of the gyros' readings from a start that
may be wrong. Its readings are known, the vehicle's true turns are not quite; so it says nothing of the true attitude,
but all of what was lost in a gap of the telemetry.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from edl_filter import rotations
from edl_filter.navigation.layout import ONBOARD, SENSOR_STATES, Layout, State
from edl_filter.planet import Planet
from edl_filter.telemetry.record import InitialState, SensorErrors

Array = NDArray[np.float64]


@dataclass(frozen=True)
class EntryErrors:
    """What may be wrong with an entry state besides its own covariance.

    Attributes
    ----------
    epoch_sigma : float
        Of the state's time, s; zero: no such state.
    frame_sigma : float
        Of a rotation of position and velocity together, rad per inertial axis; zero: no such state.
    onboard_attitude : (4,) array or None
        Attitude computed on board at the state's time, if there is one to be carried along.
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
        """Names and lengths of the states that these are."""
        wanted = {
            "entry_epoch": (1, self.epoch_sigma > 0.0),
            "entry_frame": (3, self.frame_sigma > 0.0),
            "onboard_rate": (3, self.onboard_attitude is not None and self.onboard_rate_sigma > 0.0),
            "onboard_mounting": (3, self.onboard_attitude is not None and self.onboard_mounting_sigma > 0.0),
            ONBOARD: (3, self.onboard_attitude is not None),
        }
        return {name: size for name, (size, there) in wanted.items() if there}

    def instrument_prior(self, layout: Layout) -> dict[str, float]:
        """Sigmas of the states that belong to the instrument behind the on-board attitude, by name."""
        sigmas = {"onboard_rate": self.onboard_rate_sigma, "onboard_mounting": self.onboard_mounting_sigma}
        return {name: sigma for name, sigma in sigmas.items() if name in layout}


def start(
    layout: Layout, initial: InitialState, entry: EntryErrors, errors: SensorErrors, planet: Planet
) -> tuple[State, Array]:
    """Reference and covariance at the initial state's time.

    Parameters
    ----------
    layout : Layout
    initial : InitialState
        Its covariance is what is left without `entry`'s errors.
    entry : EntryErrors
    errors : SensorErrors
        Of the instrument that drives first.
    planet : Planet

    Returns
    -------
    State
    (n, n) array
    """
    nav = np.concatenate((initial.position, initial.velocity, initial.inertial_from_body))
    prior = np.zeros((layout.size, layout.size))
    prior[:9, :9] = initial.covariance
    prior[layout.sensor, layout.sensor] = sensor_prior(layout, errors)
    effect = np.eye(layout.size)
    if "entry_epoch" in layout:
        where = layout["entry_epoch"]
        prior[where, where] = entry.epoch_sigma**2
        effect[:6, where] = epoch_effect(initial, planet)[:, None]
    if "entry_frame" in layout:
        where = layout["entry_frame"]
        prior[where, where] = entry.frame_sigma**2 * np.eye(3)
        effect[:6, where] = frame_effect(initial)
    for name, sigma in entry.instrument_prior(layout).items():
        prior[layout[name], layout[name]] = sigma**2 * np.eye(3)
    if entry.onboard_attitude is not None:
        where = layout[ONBOARD]
        nav = np.concatenate((nav, entry.onboard_attitude))
        prior[where, where] = entry.onboard_sigma**2 * np.eye(3)
    return State(nav, np.zeros(layout.size)), effect @ prior @ effect.T


def epoch_effect(initial: InitialState, planet: Planet) -> Array:
    """Change of the state at its nominal time per second by which the stated state is late: ``(6,)``."""
    return np.concatenate((initial.velocity, planet.gravity(initial.position)))


def frame_effect(initial: InitialState) -> Array:
    """Change of position and velocity per small rotation of the state's frame, ``(6, 3)``."""
    return np.concatenate((-rotations.cross_matrix(initial.position), -rotations.cross_matrix(initial.velocity)))


def sensor_prior(layout: Layout, errors: SensorErrors) -> Array:
    """Prior covariance of the sensor errors of one instrument, in the order of `Layout.sensor`.

    A state that another instrument has and this one has not keeps a variance of next to nothing, so that
    the covariance stays positive definite.
    """
    sigmas = [max(getattr(errors, n), 1e-12) for n in SENSOR_STATES if n in layout]
    return np.diag(np.repeat(np.square(sigmas), 3))
