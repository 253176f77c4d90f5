"""The linear error dynamics: against closed forms, and against differences of the propagation kernel itself.

One twin multiplies the matrices of every sample. The other is the transition that the diagnosis computes by central
differences of propagated states. On a planet of Mars's size the rounding of positions, 5e-10 m, is larger than some
differences; so the comparison to 1e-7 is made about a body of a kilometre with Mars's surface gravity, where the
gradient of gravity is 3000 times as large as well.
"""

from dataclasses import replace

import numpy as np
import pytest
import twins
from hypothesis import given
from hypothesis import strategies as st
from short_flights import error_vector

from edl_filter import rotations
from edl_filter.diagnosis.jacobians.transitions import PropagationDifferences
from edl_filter.imu_model.sensor_errors import SENSOR_STATES, SensorErrors
from edl_filter.navigation import strapdown
from edl_filter.navigation.ekf import DIFFERENCE_STEPS, propagate_with_transition
from edl_filter.navigation.error_dynamics import gravity_gradient, propagate_linearized
from edl_filter.navigation.filter import EntryErrors, Settings, build_problem
from edl_filter.navigation.layout import State
from edl_filter.navigation.propagation import OnboardRotations, propagate_states
from edl_filter.planet import Planet
from edl_filter.planet.gravity import gravity_vector
from edl_filter.telemetry.record import InitialState

ALL = SensorErrors(1.0, 1.0, 1.0, 1.0, 1.0)
MOON = Planet("moon", 3.7e6, 0.02, 1000.0, 1000.0, 0.0, 1e-4, 0.5)
#: Steps of the differences about the small body: larger where the problem is nearly linear.
STEPS = {
    "position": 1e-2, "velocity": 1e-2, "attitude": 1e-4, "accelerometer_bias": 1e-2, "accelerometer_scale": 1e-4,
    "accelerometer_misalignment": 1e-4, "gyro_bias": 1e-5, "gyro_scale": 1e-4, "entry_epoch": 1.0, "entry_frame": 1.0,
    "onboard_rate": 1e-5, "onboard_mounting": 1e-4, "onboard_attitude": 1e-4,
}  # fmt: skip


def problem(planet, radius, speed, onboard=True, count=64, seed=3):
    """A turning, braking vehicle with every state of the filter, and sensor errors far from zero."""
    rng = np.random.default_rng(seed)
    samples = twins.samples(
        rng.uniform(0.05, 0.15, count),
        np.array([-20.0, 3.0, 5.0]) + 5.0 * rng.standard_normal((count, 3)),
        np.array([0.4, -0.3, 0.2]) + 0.3 * rng.standard_normal((count, 3)),
        force_noise=0.1,
        rate_noise=1e-3,
    )
    samples = replace(samples, coning_corrected=np.arange(count) % 5 == 0)
    quaternion = rotations.normalise(rng.standard_normal(4))
    start = InitialState(
        0.0, radius * np.array([0.6, 0.5, np.sqrt(0.39)]), speed * rng.standard_normal(3), quaternion, np.eye(9)
    )
    attitude = rotations.normalise(rng.standard_normal(4)) if onboard else None
    entry = EntryErrors(1.0, 1.0, attitude, 1.0, 1.0, 1.0)
    built = build_problem(samples, start, entry, (ALL,), [], planet, Settings())
    errors = error_vector(
        built.layout,
        dict(
            zip(
                SENSOR_STATES,
                np.array([[0.5], [0.03], [0.08], [0.02], [0.03]]) * rng.standard_normal((5, 3)),
                strict=True,
            )
        ),
    )
    for name, size in (("entry_epoch", 1.0), ("entry_frame", 1.0), ("onboard_rate", 0.02), ("onboard_mounting", 0.05)):
        if name in built.layout:
            block = built.layout[name]
            errors[block] = size * rng.standard_normal(block.stop - block.start)
    nav = np.concatenate((start.position, start.velocity, quaternion, *([attitude] if onboard else [])))
    return built, State(nav, errors)


def differenced(built, state, steps, begin, end):
    """The transition over samples by central differences of the propagation kernel."""
    layout = built.layout
    vector = np.concatenate([np.full(s.stop - s.start, steps[name]) for name, s in layout.slices.items()])
    differences = PropagationDifferences.at_state(built, state, vector)
    begins, ends = np.array([begin]), np.array([end])
    onboard = OnboardRotations.over(layout, built.samples, begins, ends) if len(state.nav) == 14 else None
    return differences.transitions(state.nav[None], begins, ends, onboard)[0]


@pytest.mark.parametrize("onboard", [True, False])
def test_transition_is_the_slope_of_the_propagation_in_every_block(onboard):
    """To 1e-7 of each block of states, about a small body."""
    built, state = problem(MOON, 1100.0, 10.0, onboard)
    _, matrix = propagate_with_transition(built.layout, MOON, built.samples, state)
    twin = differenced(built, state, STEPS, 0, len(built.samples.time))
    names = (
        set(DIFFERENCE_STEPS) if onboard else set(DIFFERENCE_STEPS) - {n for n in DIFFERENCE_STEPS if "onboard" in n}
    )
    assert set(built.layout.slices) == names
    for rows in built.layout.slices.values():
        for columns in built.layout.slices.values():
            scale = np.max(np.abs(matrix[rows, columns]))
            assert np.max(np.abs(twin[rows, columns] - matrix[rows, columns])) <= 1e-7 * scale
    coupled = ["position", "velocity", "attitude"]
    for name in coupled:  # no block of navigation and sensors is zero but the attitude's by forces
        for column in (*coupled, *SENSOR_STATES):
            block = matrix[built.layout[name], built.layout[column]]
            zero = name == "attitude" and (column in ("position", "velocity") or column.startswith("accelerometer"))
            assert np.any(block) != zero


def test_transition_is_the_slope_of_the_propagation_on_mars():
    """To 1e-5 of what one step of the differences changes, with the rounding of positions in it."""
    built, state = problem(twins.MARS, 3.5e6, 3000.0)
    _, matrix = propagate_with_transition(built.layout, twins.MARS, built.samples, state)
    large = DIFFERENCE_STEPS | {"attitude": 1e-4, "gyro_bias": 1e-5, "gyro_scale": 1e-4, "accelerometer_bias": 1e-2}
    twin = differenced(built, state, large, 0, len(built.samples.time))
    for name, columns in built.layout.slices.items():
        np.testing.assert_allclose(
            twin[:, columns] * large[name], matrix[:, columns] * large[name], rtol=1e-5, atol=3e-9
        )


def left_jacobian(phi):
    """Left Jacobian of the rotation group: the series ``Σ [phi]ₓᵏ / (k + 1)!``."""
    term = total = np.eye(3)
    for k in range(1, 40):
        term = term @ rotations.cross_matrix(phi) / (k + 1)
        total = total + term
    return total


def gradient_of_gravity(position, planet):
    """Derivatives of gravity by complex steps, which are exact to rounding."""

    def gravity(r):
        x, y, z = r
        square = x * x + y * y + z * z
        oblate, polar = 1.5 * planet.j2 * planet.gravity_radius**2 / square, 5.0 * z * z / square
        shape = np.array([1.0 + oblate * (1.0 - polar)] * 2 + [1.0 + oblate * (3.0 - polar)])
        return -planet.mu / square**1.5 * shape * r

    step = 1e-20
    return np.stack([gravity(position + 1j * step * axis).imag / step for axis in np.eye(3)], axis=1)


def linearized_twin(start, errors, interval, force, rate, planet):
    """Transition ``(9, 24)``, sample by sample: errors of position, velocity and attitude in inertial axes.

    `errors` are bias, scale and misalignment of the accelerometers, and bias and scale of the gyros, ``(5, 3)``.
    """
    bias, scale, misalignment, gyro_bias, gyro_scale = errors
    alignment = rotations.to_matrix(rotations.from_rotation_vector(misalignment))
    correction = alignment.T @ np.diag(1.0 / (1.0 + scale))
    nav, attitude = start, rotations.to_matrix(start[6:])
    change = np.zeros((9, 24))
    change[:6, :6], change[6:, 6:9] = np.eye(6), attitude
    position, velocity, turned = change[:3], change[3:6], change[6:]
    for dt, measured_force, measured_rate in zip(interval, force, rate, strict=True):
        f, w = correction @ (measured_force - bias), (measured_rate - gyro_bias) / (1.0 + gyro_scale)
        force_change, rate_change = np.zeros((3, 24)), np.zeros((3, 24))
        force_change[:, 9:12] = -correction
        force_change[:, 12:15] = -correction @ np.diag(alignment @ f)
        force_change[:, 15:18] = rotations.cross_matrix(f) @ left_jacobian(misalignment).T
        rate_change[:, 18:21] = -np.diag(1.0 / (1.0 + gyro_scale))
        rate_change[:, 21:24] = -np.diag(w / (1.0 + gyro_scale))
        middle_turned = turned + attitude @ left_jacobian(0.5 * dt * w) @ (0.5 * dt * rate_change)
        middle = attitude @ rotations.to_matrix(rotations.from_rotation_vector(0.5 * dt * w))
        position = position + 0.5 * dt * velocity
        gradient = gradient_of_gravity(nav[:3] + 0.5 * dt * nav[3:6], planet)
        inertial = middle @ force_change - rotations.cross_matrix(middle @ f) @ middle_turned
        velocity = velocity + dt * (inertial + gradient @ position)
        position = position + 0.5 * dt * velocity
        turned = turned + attitude @ left_jacobian(dt * w) @ (dt * rate_change)
        maps = np.concatenate((np.eye(3).ravel(), np.zeros(3))), np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])
        gravity = planet.mu, planet.j2, planet.gravity_radius
        nav = twins.propagate(nav, *maps, np.array([dt]), f[None], w[None], *gravity)
        attitude = rotations.to_matrix(nav[6:])
    return nav, np.concatenate((position, velocity, attitude.T @ turned))


@given(st.integers(0, 2**32 - 1), st.integers(0, 25), st.booleans())
def test_transition_is_the_product_of_the_matrices_of_the_samples(seed, count, small_planet):
    rng = np.random.default_rng(seed)
    planet, radius, speed = (MOON, 1100.0, 10.0) if small_planet else (twins.MARS, 3.5e6, 3000.0)
    direction, attitude = rotations.normalise(rng.standard_normal(3)), rotations.normalise(rng.standard_normal(4))
    start = np.concatenate((radius * direction, speed * rng.standard_normal(3), attitude))
    errors = np.array([[0.5], [0.03], [0.08], [0.02], [0.03]]) * rng.standard_normal((5, 3))
    bias, scale, misalignment, gyro_bias, gyro_scale = errors
    alignment = rotations.to_matrix(rotations.from_rotation_vector(misalignment))
    correction = alignment.T @ np.diag(1.0 / (1.0 + scale))
    force_map = np.concatenate((correction.ravel(), -correction @ bias))
    rate_map = np.concatenate((1.0 / (1.0 + gyro_scale), -gyro_bias / (1.0 + gyro_scale)))
    samples = rng.uniform(0.05, 0.125, count), 20.0 * rng.standard_normal((count, 3)), rng.standard_normal((count, 3))
    end, transition = propagate_linearized(
        start, force_map, rate_map, alignment, rotations.right_jacobian(misalignment), *samples,
        planet.mu, planet.j2, planet.gravity_radius,
    )  # fmt: skip
    expected_end, expected = linearized_twin(start, errors, *samples, planet)
    for rows in (slice(0, 3), slice(3, 6), slice(6, 9)):
        scale = np.linalg.norm(expected_end[rows])
        np.testing.assert_allclose(end[rows], expected_end[rows], rtol=0, atol=1e-12 * scale)
        for columns in (slice(3 * k, 3 * k + 3) for k in range(8)):
            scale = np.max(np.abs(expected[rows, columns]), initial=0.0)
            np.testing.assert_allclose(
                transition[rows, columns], expected[rows, columns], rtol=0, atol=1e-12 * scale + 1e-15
            )


@given(st.integers(0, 2**32 - 1), st.booleans())
def test_state_is_that_of_the_propagation_kernel(seed, onboard):
    built, state = problem(twins.MARS, 3.5e6, 3000.0, onboard, count=20, seed=seed)
    end, _ = propagate_with_transition(built.layout, twins.MARS, built.samples, state)
    nav = np.repeat(state.nav[:, None], strapdown.LANES, axis=1)
    errors = np.repeat(state.errors[:, None], strapdown.LANES, axis=1)
    propagate_states(built.layout, twins.MARS, built.samples, nav, errors)
    np.testing.assert_allclose(end.nav, nav[:, 0], rtol=1e-13, atol=1e-12)
    np.testing.assert_array_equal(end.errors, state.errors)


def test_transitions_of_adjoining_intervals_multiply():
    """With the on-board computation's own errors at zero, about which its correction is linear."""
    built, state = problem(MOON, 1100.0, 10.0)
    for name in ("onboard_rate", "onboard_mounting"):
        state.errors[built.layout[name]] = 0.0
    first, second = built.samples.part(0, 25), built.samples.part(25, len(built.samples.time))
    middle, before = propagate_with_transition(built.layout, MOON, first, state)
    _, after = propagate_with_transition(built.layout, MOON, second, middle)
    _, combined = propagate_with_transition(built.layout, MOON, built.samples, state)
    np.testing.assert_allclose(after @ before, combined, rtol=1e-11, atol=1e-11 * np.max(np.abs(combined)))


def test_closed_form_without_rotation_and_gravity():
    """Constant force for t seconds: t²/2 and t of a bias, ``-[C f]ₓ t²/2`` of an attitude error."""
    count, dt, force = 40, 0.1, np.array([-10.0, 2.0, 3.0])
    quaternion = rotations.normalise([0.2, 0.1, -0.4, 0.8])
    start = np.concatenate((np.full(3, 1e3), np.zeros(3), quaternion))
    force_map, rate_map = (m[:, 0] for m in twins.no_maps(1))
    eye = np.eye(3)
    _, matrix = propagate_linearized(
        start, force_map, rate_map, eye, eye, np.full(count, dt), np.tile(force, (count, 1)), np.zeros((count, 3)),
        0.0, 0.0, 1.0,
    )  # fmt: skip
    t, c = count * dt, rotations.to_matrix(quaternion)
    expected = np.zeros((9, 24))
    expected[:3, :3] = expected[3:6, 3:6] = expected[6:, 6:9] = eye
    expected[:3, 3:6] = t * eye
    errors = np.concatenate((-eye, -np.diag(force), rotations.cross_matrix(force)), axis=1)
    for rows, factor in ((slice(0, 3), 0.5 * t**2), (slice(3, 6), t)):
        expected[rows, 6:9] = -factor * c @ rotations.cross_matrix(force)
        expected[rows, 9:18] = factor * c @ errors
    expected[6:, 18:21] = -t * eye
    gained = c @ rotations.cross_matrix(force)  # of an attitude error that grows with time, at mid-sample of each kick
    middles = dt * (np.arange(count) + 0.5)
    expected[3:6, 18:21] = gained * np.sum(dt * middles)
    expected[:3, 18:21] = gained * np.sum(dt * middles * (t - middles))
    np.testing.assert_allclose(matrix, expected, atol=1e-9)


@given(st.integers(0, 2**32 - 1))
def test_gravity_gradient_is_the_slope_of_gravity(seed):
    position = 1100.0 * rotations.normalise(np.random.default_rng(seed).standard_normal(3))
    out = np.empty((3, 3))
    gravity_gradient(out, *position, MOON.mu, 1.5 * MOON.j2 * MOON.gravity_radius**2)
    step = 1e-2
    slopes = np.stack(
        [
            (MOON.gravity(position + step * e) - gravity_vector(position - step * e, MOON.mu, MOON.j2, 1000.0))
            / (2 * step)
            for e in np.eye(3)
        ],
        axis=1,
    )
    np.testing.assert_allclose(out, slopes, atol=1e-9 * np.max(np.abs(out)))
    np.testing.assert_allclose(out, out.T, atol=1e-15)
    assert abs(np.trace(out)) < 1e-15  # Laplace
