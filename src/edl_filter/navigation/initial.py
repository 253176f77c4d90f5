"""The start of the filter: entry state, its covariance, and the states that explain its errors.

An entry state is stated for an epoch on the spacecraft's clock, in a frame, with an attitude from on board.
Each of the three can be off. Their errors are states of their own, constant, and correlated with position,
velocity and attitude at the start, so that the filter's estimate says which of them had to give.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from edl_filter import rotations
from edl_filter.navigation.layout import SENSOR_STATES, Layout, State
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
    onboard_covariance : (3, 3) array or None
        Of the on-board attitude's frame, rad², inertial axes; None: attitude does not come from on board.
    """

    epoch_sigma: float = 0.0
    frame_sigma: float = 0.0
    onboard_covariance: Array | None = None

    @property
    def states(self) -> dict[str, int]:
        """Names and lengths of the states that these are."""
        states = {}
        if self.epoch_sigma > 0.0:
            states["entry_epoch"] = 1
        if self.frame_sigma > 0.0:
            states["entry_frame"] = 3
        if self.onboard_covariance is not None:
            states["onboard_attitude"] = 3
        return states


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
    if "onboard_attitude" in layout:
        assert entry.onboard_covariance is not None
        where = layout["onboard_attitude"]
        prior[where, where] = entry.onboard_covariance
        # on board = exp(b) ⊗ true, so true = on board ⊗ exp(-Cᵀ b)
        effect[6:9, where] = -rotations.to_matrix(initial.inertial_from_body).T
    return State(nav, np.zeros(layout.size)), effect @ prior @ effect.T


def epoch_effect(initial: InitialState, planet: Planet) -> Array:
    """Change of the state at its nominal time per second by which the stated state is late: ``(6,)``."""
    return np.concatenate((initial.velocity, planet.gravity(initial.position)))


def frame_effect(initial: InitialState) -> Array:
    """Change of position and velocity per small rotation of the state's frame, ``(6, 3)``."""
    return np.concatenate(
        (-rotations.cross_matrix(initial.position), -rotations.cross_matrix(initial.velocity))
    )


def sensor_prior(layout: Layout, errors: SensorErrors) -> Array:
    """Prior covariance of the sensor errors of one instrument, in the order of `Layout.sensor`.

    A state that another instrument has and this one has not keeps a variance of next to nothing, so that
    the covariance stays positive definite.
    """
    sigmas = [max(getattr(errors, n), 1e-12) for n in SENSOR_STATES if n in layout]
    return np.diag(np.repeat(np.square(sigmas), 3))


def onboard_covariance(sun: Array, about_sun: float, across_sun: float) -> Array:
    """Covariance of an attitude that is known worse about the line to the Sun than across it.

    Parameters
    ----------
    sun : (3,) array
        Direction of the Sun, inertial axes.
    about_sun, across_sun : float
        One sigma, rad.
    """
    unit = np.asarray(sun, float) / np.linalg.norm(sun)
    along = np.outer(unit, unit)
    return about_sun**2 * along + across_sun**2 * (np.eye(3) - along)
