"""Error-state extended Kalman filter: the linear error model of inertial navigation in place of sigma points.

The vector is the same error about a propagated reference as the unscented filter's (`layout`). The reference is
propagated by the same kernel; the covariance by the transition matrix that `error_dynamics` accumulates over the
samples. Measurement models are linearised by central differences of `Constraint.predict`, all columns in one call. The
update is `estimation.kalman.measurement_update`.
"""

from __future__ import annotations

import numpy as np

from edl_filter import rotations
from edl_filter.estimation.kalman import measurement_update
from edl_filter.estimation.small_matrices import symmetric_part
from edl_filter.imu_model.sensor_errors import SENSOR_STATES
from edl_filter.navigation.compiled_states import states_of_points
from edl_filter.navigation.constraints import Constraint
from edl_filter.navigation.error_dynamics import propagate_linearized
from edl_filter.navigation.estimator import Innovation, Transition
from edl_filter.navigation.increments import Samples
from edl_filter.navigation.layout import ONBOARD, Layout, State, sensor_maps
from edl_filter.navigation.noise import process_noise
from edl_filter.navigation.propagation import OnboardRotations
from edl_filter.planet import Planet
from edl_filter.types import Array

#: Half steps of the central differences, in the units of `layout.UNITS`: truncation and rounding are below 1e-5 of a
#: slope (tests/navigation/test_ekf.py).
DIFFERENCE_STEPS = {
    "position": 10.0, "velocity": 0.05, "attitude": 1e-5, "accelerometer_bias": 1e-4, "accelerometer_scale": 1e-5,
    "accelerometer_misalignment": 1e-5, "gyro_bias": 1e-7, "gyro_scale": 1e-6, "entry_epoch": 1e-2,
    "entry_frame": 1e-5, "onboard_rate": 1e-7, "onboard_mounting": 1e-6, ONBOARD: 1e-5,
}  # fmt: skip


class ErrorStateEKF:
    """EKF about a reference.

    Parameters
    ----------
    layout : Layout
        Of the filter's vector.
    state : State
        Reference at the start.
    covariance : (n, n) array
        Of the error about it, in the units of `layout.UNITS`.
    planet : Planet
        Gravity and rotation.
    """

    def __init__(self, layout: Layout, state: State, covariance: Array, planet: Planet) -> None:
        self.layout, self.state, self.planet = layout, state, planet
        self.covariance = covariance.copy()

    def predict(self, samples: Samples) -> Transition:
        """Propagate estimate and covariance to the end of `samples`."""
        noise = process_noise(self.layout, samples, self.state.nav[6:10])
        self.state, matrix = propagate_with_transition(self.layout, self.planet, samples, self.state)
        cross = self.covariance @ matrix.T
        self.covariance = symmetric_part(matrix @ cross + noise)
        return Transition(cross, self.state, self.covariance.copy())

    def innovation(self, constraint: Constraint) -> Innovation:
        """Predict a measurement at the reference and compare it with what was measured."""
        predicted, jacobian = linearized_measurement(constraint, self.state, self.layout)
        covariance = symmetric_part(jacobian @ self.covariance @ jacobian.T)
        return Innovation.of(constraint.measured - predicted, covariance, constraint.noise, jacobian)

    def jacobian(self, innovation: Innovation) -> Array:
        """Jacobian ``(m, n)`` of a measurement at the present reference."""
        return innovation.linearization

    def update(self, constraint: Constraint, innovation: Innovation) -> None:
        """Update with a measurement; `innovation` holds its Jacobian at the present reference."""
        gain, self.covariance = measurement_update(
            self.covariance, innovation.linearization, innovation.noise_covariance
        )
        self.state = self.state.plus(gain @ innovation.residual)

    def transform(self, matrix: Array, noise: Array, errors: Array) -> Transition:
        """Replace the error linearly, as `ErrorStateFilter.transform`.

        Parameters
        ----------
        matrix, noise : (n, n) arrays
            Transition, and covariance of the added noise.
        errors : (n,) array
            New values of `State.errors`.

        Returns
        -------
        Transition
        """
        cross = self.covariance @ matrix.T
        self.covariance = symmetric_part(matrix @ cross + noise)
        self.state = State(self.state.nav, errors)
        return Transition(cross, self.state, self.covariance.copy())


def propagate_with_transition(layout: Layout, planet: Planet, samples: Samples, state: State) -> tuple[State, Array]:
    """Propagate a state over `samples` and differentiate the error at the end with respect to that at the start.

    Parameters
    ----------
    layout : Layout
        Of the filter's vector.
    planet : Planet
        Gravity and rotation.
    samples : Samples
        Of the driving instrument.
    state : State
        Reference at the start.

    Returns
    -------
    state : State
        Reference at the end.
    transition : (n, n) array
        In the units of `layout.UNITS`.
    """
    force_map, rate_map = sensor_maps(layout, state.errors[:, None])
    name = "accelerometer_misalignment"
    misalignment = state.errors[layout[name]] if name in layout else np.zeros(3)
    end, derivatives = propagate_linearized(
        state.nav[:10],
        force_map[:, 0],
        rate_map[:, 0],
        rotations.to_matrix(rotations.from_rotation_vector(misalignment)),
        rotations.right_jacobian(misalignment),
        samples.interval,
        samples.force,
        samples.rate,
        planet.mu,
        planet.j2,
        planet.gravity_radius,
    )
    matrix = np.eye(layout.size)
    matrix[:9, :9] = derivatives[:, :9]
    for k, name in enumerate(SENSOR_STATES):
        if name in layout:
            matrix[:9, layout[name]] = derivatives[:, 9 + 3 * k : 12 + 3 * k]
    if ONBOARD in layout:
        turned, matrix[layout[ONBOARD]] = _onboard_transition(layout, samples, state)
        end = np.concatenate((end, turned))
    return State(end, state.errors.copy()), matrix


def _onboard_transition(layout: Layout, samples: Samples, state: State) -> tuple[Array, Array]:
    """Attitude computed on board after `samples`, and the rows (3, n) of the transition that belong to its error."""
    onboard = OnboardRotations.over_all(layout, samples)
    correction = onboard.correction_vectors(layout, state.errors[:, None])[0, 0]
    turn = rotations.multiply(onboard.net[0], rotations.from_rotation_vector(correction))
    rows = np.zeros((3, layout.size))
    rows[:, layout[ONBOARD]] = rotations.to_matrix(turn).T
    for name, jacobian in onboard.jacobians.items():
        rows[:, layout[name]] = rotations.right_jacobian(correction) @ jacobian[0]
    return rotations.multiply(state.nav[10:], turn), rows


def difference_steps(layout: Layout) -> Array:
    """Half steps ``(n,)`` of central differences with respect to the filter's vector, in its units."""
    return np.concatenate([np.full(s.stop - s.start, DIFFERENCE_STEPS[name]) for name, s in layout.slices.items()])


def linearized_measurement(constraint: Constraint, state: State, layout: Layout) -> tuple[Array, Array]:
    """Prediction of a constraint at a state, and its Jacobian by central differences.

    Parameters
    ----------
    constraint : Constraint
        Its `predict` is called once.
    state : State
        Linearisation point.
    layout : Layout
        Of the filter's vector.

    Returns
    -------
    predicted : (m,) array
        In the units that the constraint's `components` name.
    jacobian : (m, n) array
        Of those per the units of `layout.UNITS`.
    """
    n = layout.size
    steps = difference_steps(layout)
    offsets = np.concatenate((np.diag(steps), -np.diag(steps), np.zeros((1, n))))
    onboard = layout[ONBOARD].start if ONBOARD in layout else -1
    nav, errors = states_of_points(state.nav, state.errors, offsets, 2 * n + 1, onboard)
    values = constraint.predict(nav, errors, layout)
    return values[-1], ((values[:n] - values[n : 2 * n]) / (2.0 * steps[:, None])).T
