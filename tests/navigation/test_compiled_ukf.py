"""The compiled filter and smoother against those on filterpy and scipy, which are their readable twins.

Differences are in sigmas of the state. Where a state is known to 1e-8 rad, the rounding of a unit quaternion alone
exceeds 1e-9 sigma, in the reference as well; there the tolerance is ten times the reference's own rounding: its change
when every angular rate changes by its last bit.
"""

from dataclasses import replace

import numpy as np
import pytest
import twins
from compiled_cases import EVERY, FEW, filled, random_state, uneven_samples
from hypothesis import given, settings
from hypothesis import strategies as st

from edl_filter import rotations
from edl_filter.estimation.parallel import one_blas_thread
from edl_filter.imu_model.sensor_errors import SensorErrors
from edl_filter.mission import Mission
from edl_filter.navigation.compiled_ukf import CompiledUKF, smooth_node
from edl_filter.navigation.constraints import Altimeter, LandingSite, OnboardAttitude, RestVelocity
from edl_filter.navigation.filter import Settings, build_problem, new_filter, run_filter
from edl_filter.navigation.initial import EntryErrors
from edl_filter.navigation.layout import State
from edl_filter.navigation.leave_one_out import check_constraints
from edl_filter.navigation.recovery import first_pass, run_with_recovery
from edl_filter.navigation.smoother import smooth
from edl_filter.navigation.ukf import ErrorStateUKF
from edl_filter.pipeline.reconstruct import reconstruct
from edl_filter.telemetry.record import InitialState

TOLERANCE = 1e-9
POSITION, VELOCITY = np.array([3.4e6, 1e5, -2e5]), np.array([-300.0, 900.0, 100.0])
SIZES = {
    "accelerometer_bias": 0.02, "accelerometer_scale": 1e-3, "accelerometer_misalignment": 2e-3, "gyro_bias": 1e-3,
    "gyro_scale": 2e-3,
}  # fmt: skip


@pytest.fixture(scope="module", autouse=True)
def one_thread():
    with one_blas_thread():
        yield


def with_engine(problem, engine):
    return replace(problem, settings=replace(problem.settings, engine=engine))


def difference(states, covariances, reference_states, reference_covariances):
    """Largest difference of states and of covariances, in sigmas."""
    worst = 0.0
    for state, covariance, reference, expected in zip(
        states, covariances, reference_states, reference_covariances, strict=True
    ):
        sigma = np.sqrt(np.diag(expected))
        sigma = np.where(sigma > 0.0, sigma, 1.0)
        change = np.max(np.abs(state.minus(reference)) / sigma)
        worst = max(worst, change, np.max(np.abs(covariance - expected) / np.outer(sigma, sigma)))
    return worst


def difference_of_passes(filter_pass, reference):
    nodes, expected = filter_pass.nodes, reference.nodes
    return difference(
        [n.state for n in nodes], [n.covariance for n in nodes], [n.state for n in expected],
        [n.covariance for n in expected],
    )  # fmt: skip


def own_rounding(problem, reference, run=run_filter):
    """Change of the reference when the angular rates change by their last bit, in sigmas."""
    samples, random = problem.samples, np.random.default_rng(0)
    direction = random.choice([-np.inf, np.inf], samples.rate.shape)
    changed = replace(problem, samples=replace(samples, rate=np.nextafter(samples.rate, direction)))
    return difference_of_passes(run(changed), reference)


def assert_engines_agree(problem, exact=False):
    """Filter, gate and smoother of both engines; returns both passes."""
    compiled, filterpy = (with_engine(problem, engine) for engine in ("compiled", "filterpy"))
    filter_pass, reference = run_filter(compiled), run_filter(filterpy)
    tolerance = TOLERANCE if exact else max(TOLERANCE, 10.0 * own_rounding(filterpy, reference))
    assert tolerance < 2e-6  # of sigma: with outliers the last bits of the rates move the reference by 1e-7
    assert difference_of_passes(filter_pass, reference) < tolerance
    for fused, expected in zip(filter_pass.fused, reference.fused, strict=True):
        assert fused.accepted == expected.accepted
        assert fused.weight == pytest.approx(expected.weight, rel=max(1e-9, tolerance))
        assert fused.innovation.nis == pytest.approx(expected.innovation.nis, rel=tolerance, abs=tolerance)
    assert filter_pass.divergence == reference.divergence or filter_pass.divergence.names == reference.divergence.names
    smoothed, expected = smooth(filter_pass), smooth(reference)
    args = expected.states, expected.covariance
    assert difference(smoothed.states, smoothed.covariance, *args) < tolerance
    alone = smooth(replace(reference, engine="compiled"))
    assert difference(alone.states, alone.covariance, *args) < tolerance
    return filter_pass, reference


def random_problem(seed):
    """A random flight of 4 to 12 s: states, samples, constraints, gaps, changes of the instrument, and settings."""
    random = np.random.default_rng(seed)
    count = int(random.integers(32, 96))
    change = random.random() < 0.4
    instruments = tuple(
        SensorErrors(**{name: size for name, size in SIZES.items() if random.random() < 0.6}) for _ in range(1 + change)
    )
    samples = twins.samples(
        np.full(count, 0.125),
        np.array([-20.0, 1.0, -2.0]) + random.standard_normal((count, 3)),
        [0.3, 0.1, -0.2] + 0.1 * random.standard_normal((count, 3)),
        force_noise=0.1,
        rate_noise=2e-3,
        shared=1.5e-3,
        unit=(np.arange(count) >= count // 2).astype(int) if change else None,
    )
    if random.random() < 0.4:
        inside = (np.arange(count) // 5 == 3)[:, None]
        samples = replace(
            samples,
            force_fill_sigma=inside * random.uniform(0.0, 0.5, (count, 3)),
            rate_fill_sigma=inside * random.uniform(0.0, 0.02, (count, 3)),
            coning_corrected=inside[:, 0],
        )
    onboard = random.random() < 0.5
    attitude = rotations.normalise(random.standard_normal(4))
    entry = EntryErrors(
        random.choice([0.0, 0.05]), random.choice([0.0, 1e-3]), attitude if onboard else None, 1e-2 if onboard else 0.0,
        random.choice([0.0, 1e-4]), random.choice([0.0, 1e-3]),
    )  # fmt: skip
    end = samples.time[-1]
    times = np.sort(random.uniform(0.5, end, 6))
    constraints = []
    for time in times:
        place = POSITION + time * VELOCITY
        radius = np.linalg.norm(POSITION)
        kind = random.integers(4 if onboard else 3)
        error = random.standard_normal(3) * random.choice([1.0, 1.0, 1.0, 30.0])
        if kind == 0:
            constraints.append(Altimeter(time, np.linalg.norm(place) - radius + 300.0 * error[0], 300.0, radius))
        elif kind == 1:
            fixed = twins.MARS.rotation.to_fixed(time, place[None])[0] + 1000.0 * error
            constraints.append(LandingSite(time, fixed, 1e6 * np.eye(3), twins.MARS))
        elif kind == 2:
            constraints.append(RestVelocity(time, 2e3, twins.MARS))
        else:
            constraints.append(OnboardAttitude(time, attitude, 2.0))
    sigma = np.repeat([100.0, 2.0, 0.01], 3)
    return build_problem(
        samples,
        InitialState(0.0, POSITION, VELOCITY, attitude, np.diag(sigma**2)),
        entry,
        instruments,
        constraints,
        twins.MARS,
        Settings(
            alpha=random.uniform(0.3, 1.0),
            beta=random.uniform(0.0, 3.0),
            kappa=random.uniform(0.0, 2.0),
            longest_interval=random.uniform(0.5, 5.0),
            gate_probability=random.choice([0.999, 0.99999]),
            robust=str(random.choice(["none", "huber", "student_t"])),
        ),
        unit_change_sigma=1e-3,
    )


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 10_000))
def test_random_problems(seed):
    assert_engines_agree(random_problem(seed), exact=True)


@pytest.mark.slow
def test_two_hundred_random_problems():
    for seed in range(10_000, 10_200):
        assert_engines_agree(random_problem(seed), exact=True)


def with_slow_rest(problem):
    """A velocity at rest of at least 2 mm/s, with which the rounding of the update is small.

    The velocity has a sigma of 0.8 m/s before it. The difference ``P - K S Kᵀ`` has the rounding of P, and a variance
    that is 10⁻⁶ of P is rounded to 10⁻⁷.
    """
    slow = (replace(c, sigma=max(c.sigma, 0.002)) if c.name == "rest_velocity" else c for c in problem.constraints)
    return replace(problem, constraints=tuple(slow))


@pytest.mark.parametrize("name", ["spirit", "opportunity", "practice_06"])
def test_shipped_missions(name, request):
    """Filter, smoother, and each constraint against all others."""
    problem = with_slow_rest(request.getfixturevalue(name).problem)
    filter_pass, reference = assert_engines_agree(problem)
    compiled, filterpy = (with_engine(problem, engine) for engine in ("compiled", "filterpy"))
    checks = zip(check_constraints(compiled, filter_pass), check_constraints(filterpy, reference), strict=True)
    for check, expected in checks:
        assert np.max(np.abs(check.left_out - expected.left_out) / expected.left_out_sigma) < 1e-8
        np.testing.assert_allclose(check.left_out_sigma, expected.left_out_sigma, rtol=1e-7)
        assert check.left_out_information == pytest.approx(expected.left_out_information, rel=1e-7, abs=1e-9)


def with_outliers(problem):
    """Every twentieth height of the altimeter, and three in a row, wrong by kilometres."""
    heights = [c for c in problem.constraints if c.name == "altimeter"]
    wrong = {id(c) for k, c in enumerate(heights) if k % 20 == 7 or 100 <= k < 103}
    assert len(wrong) > 10
    changed = (replace(c, height=c.height + 4e3) if id(c) in wrong else c for c in problem.constraints)
    return replace(problem, constraints=tuple(changed))


@pytest.mark.parametrize("robust", ["none", "huber", "student_t"])
def test_outliers_are_screened_and_weighted_alike(practice_06, robust):
    problem = with_outliers(with_slow_rest(practice_06.problem))
    filter_pass, _ = assert_engines_agree(replace(problem, settings=replace(problem.settings, robust=robust)))
    assert sum(not f.accepted for f in filter_pass.fused) > 10
    assert robust == "none" or any(f.weight < 1.0 for f in filter_pass.fused)


@pytest.mark.slow
def test_recovery_is_the_same():
    """From an entry state that is wrong by 40 sigmas.

    The rest on the surface is known to 5 cm/s here: beside the inflated entry state, the 2 mm/s of the format leave
    covariances whose rounding is some 1e-5 sigma in either engine. The engines differ by no more than ten times what
    the reference differs from itself when the last bits of its input change.
    """
    rest = "constraints.rest={from: telemetry, velocity_sigma: 0.05}"
    problem = reconstruct(Mission.load("builtin:practice_mer", [rest]), leave_one_out=False).problem
    shift = 40.0 * np.sqrt(np.diag(problem.initial.covariance))[:3]
    problem = replace(problem, initial=replace(problem.initial, position=problem.initial.position + shift))
    results = [run_with_recovery(with_engine(problem, engine)) for engine in ("compiled", "filterpy")]
    (_, filter_pass, recovery), (changed, reference, expected) = results
    assert expected is not None and recovery.cause == expected.cause == "entry_state"
    assert recovery.size == expected.size and recovery.gain == pytest.approx(expected.gain, rel=1e-7)
    tolerance = max(TOLERANCE, 10.0 * own_rounding(changed, reference, first_pass))
    assert difference_of_passes(filter_pass, reference) < tolerance < 1e-5


def test_the_engine_is_that_of_the_settings():
    problem = random_problem(1)
    for engine, filter_class in (("compiled", CompiledUKF), ("filterpy", ErrorStateUKF)):
        chosen = with_engine(problem, engine)
        state, covariance = run_filter(chosen).nodes[0].state, run_filter(chosen).nodes[0].covariance
        assert isinstance(new_filter(chosen, state, covariance), filter_class)
        assert run_filter(chosen).engine == engine


def test_weights_are_those_of_the_reference():
    problem = random_problem(2)
    node = run_filter(problem).nodes[0]
    s = problem.settings
    args = problem.layout, node.state, node.covariance, problem.planet, s.alpha, s.beta, s.kappa
    compiled, reference = CompiledUKF(*args), ErrorStateUKF(*args)
    np.testing.assert_allclose(compiled.weights, reference.weights, rtol=1e-13)
    scale = np.sqrt(np.diag(node.covariance))
    np.testing.assert_allclose(compiled.sigma_points / scale, reference.sigma_points / scale, atol=1e-13)


def test_a_covariance_that_is_not_positive_is_refused():
    problem = random_problem(3)
    node = run_filter(problem).nodes[0]
    covariance = node.covariance.copy()
    covariance[2, 2] = -1.0
    for filter_class in (CompiledUKF, ErrorStateUKF):
        with pytest.raises(np.linalg.LinAlgError):
            filter_class(problem.layout, node.state, covariance, problem.planet)


def both_filters(layout, seed, sigma=1.0, **transform):
    """The compiled filter and its reference at one state, with random correlations; `sigma` multiplies the turns'."""
    random = np.random.default_rng(seed)
    sizes = {"position": 100.0, "velocity": 2.0, "attitude": 0.02 * sigma, "onboard_attitude": 0.03 * sigma}
    sigmas = np.full(layout.size, 2e-3)
    for name, size in sizes.items():
        if name in layout:
            sigmas[layout[name]] = size
    covariance = twins.random_covariance(random, sigmas)
    state = random_state(random, layout)
    attitudes = [rotations.normalise(a) for a in np.split(state.nav[6:], len(state.nav[6:]) // 4)]
    errors = 2e-3 * state.errors
    for name in sizes:
        if name in layout:
            errors[layout[name]] = 0.0
    state = State(np.concatenate((state.nav[:6], *attitudes)), errors)
    return [kind(layout, state, covariance, twins.MARS, **transform) for kind in (CompiledUKF, ErrorStateUKF)]


def assert_filters_agree(compiled, reference):
    """State, covariance and sigma points."""
    scale = np.sqrt(np.diag(reference.covariance))
    np.testing.assert_allclose(compiled.state.minus(reference.state) / scale, 0.0, atol=TOLERANCE)
    np.testing.assert_allclose(
        (compiled.covariance - reference.covariance) / np.outer(scale, scale), 0.0, atol=TOLERANCE
    )
    np.testing.assert_allclose((compiled.sigma_points - reference.sigma_points) / scale, 0.0, atol=TOLERANCE)


def assert_transitions_agree(transition, expected, before):
    """`before`: sigmas before the step."""
    scale = np.sqrt(np.diag(expected.covariance))
    np.testing.assert_allclose(transition.state.minus(expected.state) / scale, 0.0, atol=TOLERANCE)
    scaled = (transition.covariance - expected.covariance) / np.outer(scale, scale)
    np.testing.assert_allclose(scaled, 0.0, atol=TOLERANCE)
    scaled = (transition.cross_covariance - expected.cross_covariance) / np.outer(before, scale)
    np.testing.assert_allclose(scaled, 0.0, atol=TOLERANCE)


@pytest.mark.parametrize("layout", [EVERY, FEW])
def test_each_step_is_that_of_the_reference(layout):
    """Prediction, update and change of the instrument, the numbers that each leaves for the smoother included."""
    random = np.random.default_rng(8)
    compiled, reference = both_filters(layout, 9, alpha=0.7, beta=1.0, kappa=2.0)
    samples = filled(uneven_samples(random), random, 0.3, 0.02)
    fixed = twins.MARS.rotation.to_fixed(1.0, reference.state.nav[None, :3])[0]
    spread = twins.random_covariance(random, [80.0, 120.0, 50.0])
    constraints = [
        LandingSite(1.0, fixed + np.array([50.0, -60.0, 70.0]), spread, twins.MARS),
        Altimeter(1.0, np.linalg.norm(reference.state.nav[:3]) - 3.3e6 + 40.0, 30.0, 3.3e6),
        RestVelocity(1.0, 1e3, twins.MARS),
        *([OnboardAttitude(1.0, reference.state.nav[10:], 0.01)] if "onboard_attitude" in layout else []),
    ]
    for _ in range(2):
        before = np.sqrt(np.diag(reference.covariance))
        transitions = compiled.predict(samples), reference.predict(samples)
        assert_transitions_agree(*transitions, before)
        assert_filters_agree(compiled, reference)
        for constraint in constraints:
            innovation, expected = compiled.innovation(constraint), reference.innovation(constraint)
            sigma = np.sqrt(np.diag(expected.predicted_covariance + expected.noise_covariance))
            np.testing.assert_allclose((innovation.residual - expected.residual) / sigma, 0.0, atol=TOLERANCE)
            scaled = (innovation.predicted_covariance - expected.predicted_covariance) / np.outer(sigma, sigma)
            np.testing.assert_allclose(scaled, 0.0, atol=TOLERANCE)
            np.testing.assert_array_equal(innovation.noise_covariance, constraint.noise)
            assert innovation.nis == pytest.approx(expected.nis, rel=1e-9, abs=1e-9)
            scale = np.sqrt(np.diag(reference.covariance)) / sigma[:, None]
            jacobians = compiled.jacobian(innovation), reference.jacobian(expected)
            np.testing.assert_allclose(jacobians[0] * scale, jacobians[1] * scale, atol=TOLERANCE)
            compiled.update(constraint, innovation)
            reference.update(constraint, expected)
            assert_filters_agree(compiled, reference)
            np.testing.assert_array_equal(compiled.covariance, compiled.covariance.T)
        matrix = np.eye(layout.size) + 0.2 * np.diag(random.standard_normal(layout.size))
        matrix[3:6, :3] = 1e-3 * random.standard_normal((3, 3))
        scale = np.sqrt(np.diag(reference.covariance))
        noise = 0.01 * twins.random_covariance(random, scale)
        errors = 0.5 * reference.state.errors
        transitions = [f.transform(matrix, noise, errors) for f in (compiled, reference)]
        assert_transitions_agree(*transitions, scale)
        assert_filters_agree(compiled, reference)


def test_the_transform_without_a_statement_is_that_of_the_reference():
    compiled, reference = both_filters(FEW, 10)
    np.testing.assert_allclose(compiled.weights, reference.weights, rtol=1e-13)
    assert_filters_agree(compiled, reference)


def test_a_filter_does_not_change_what_it_was_given():
    """Covariance and state at the start, and the transitions of earlier steps."""
    random = np.random.default_rng(11)
    samples = uneven_samples(random)
    compiled, reference = both_filters(EVERY, 12)
    covariance = reference.covariance.copy()
    fresh = CompiledUKF(EVERY, compiled.state, covariance, twins.MARS)
    transition = fresh.predict(samples)
    kept = transition.covariance.copy(), transition.state.nav.copy()
    np.testing.assert_array_equal(covariance, reference.covariance)
    fresh.covariance[:] = 0.0
    np.testing.assert_array_equal(transition.covariance, kept[0])
    np.testing.assert_array_equal(transition.state.nav, kept[1])


def assert_refused(step, filters):
    """A step of each filter raises what a covariance without a Cholesky factor raises."""
    for estimator in filters:
        with pytest.raises(np.linalg.LinAlgError):
            step(estimator)


def test_a_prediction_from_a_covariance_that_is_not_positive_is_refused():
    filters = both_filters(FEW, 14)
    for estimator in filters:
        estimator.covariance[-1, -1] *= -1.0
    assert_refused(lambda f: f.predict(uneven_samples(np.random.default_rng(13))), filters)


def test_a_prediction_to_a_covariance_that_is_not_positive_is_refused():
    """With a large negative weight of the centre, and attitudes whose spread moves the mean away from it."""
    filters = both_filters(FEW, 14, sigma=30.0, beta=-1e6)
    assert_refused(lambda f: f.predict(uneven_samples(np.random.default_rng(13))), filters)


def test_an_update_to_a_covariance_that_is_not_positive_is_refused():
    """By a reading with a negative variance."""
    constraint = Altimeter(0.0, np.linalg.norm(POSITION) - 3.3e6, 30.0, 3.3e6)

    def update(estimator):
        innovation = estimator.innovation(constraint)
        estimator.update(constraint, replace(innovation, noise_covariance=-0.9 * innovation.predicted_covariance))

    assert_refused(update, both_filters(FEW, 14))


def test_a_change_of_the_instrument_to_a_covariance_that_is_not_positive_is_refused():
    assert_refused(lambda f: f.transform(np.eye(FEW.size), -2.0 * f.covariance, f.state.errors), both_filters(FEW, 14))


@pytest.mark.parametrize("bad", [0, 2, 4])
def test_a_predicted_covariance_that_is_not_positive_is_refused_by_the_smoother(bad):
    problem = random_problem(1)
    nodes = list(run_filter(problem).nodes)[:6]
    transition = nodes[bad + 1].transition
    covariance = transition.covariance.copy()
    covariance[2, 2] *= -1.0
    nodes[bad + 1] = replace(nodes[bad + 1], transition=replace(transition, covariance=covariance))
    for engine in ("compiled", "filterpy"):
        with pytest.raises(np.linalg.LinAlgError):
            smooth(replace(run_filter(problem), nodes=nodes, engine=engine))


def test_a_reading_at_the_last_epoch_is_smoothed_as_by_the_reference():
    """The gains too, from each node to the next one."""
    filter_pass, reference = assert_engines_agree(twins.short_descent(Settings(longest_interval=2.0)), exact=True)
    smoothed, expected = smooth(filter_pass), smooth(reference)
    sigma = np.sqrt([np.diag(c) for c in expected.covariance])
    filtered = np.sqrt(np.diag(filter_pass.nodes[-2].covariance))
    assert np.all(sigma[-2, :3] < 0.9 * filtered[:3])
    unit = sigma[:-1, :, None] / sigma[1:, None, :]
    np.testing.assert_allclose(smoothed.gain / unit, expected.gain / unit, atol=1e-8)


@pytest.mark.parametrize("layout", [EVERY, FEW])
def test_states_that_do_not_move_keep_their_covariance_and_their_gain(layout):
    """Sensor errors are constant: a prediction leaves their covariance as it is, and the smoother's gain is one."""
    estimator, _ = both_filters(layout, 15)
    before = estimator.covariance.copy()
    transition = estimator.predict(uneven_samples(np.random.default_rng(16)))
    constant = slice(9, layout.size - 3 if "onboard_attitude" in layout else layout.size)
    np.testing.assert_array_equal(transition.covariance[constant, constant], before[constant, constant])
    np.testing.assert_array_equal(transition.cross_covariance[constant], transition.covariance[constant])
    state = estimator.state
    covariance, smoothed_gain = np.empty_like(before), np.empty_like(before)
    onboard = layout.size - 3 if "onboard_attitude" in layout else -1
    smooth_node((state, before), transition, (state, 0.5 * before), onboard, covariance, smoothed_gain)
    gain = np.linalg.solve(transition.covariance, transition.cross_covariance.T).T
    scale = np.sqrt(np.diag(before))
    np.testing.assert_allclose(smoothed_gain * scale / scale[:, None], gain * scale / scale[:, None], atol=1e-9)
    np.testing.assert_array_equal(smoothed_gain[constant], np.eye(layout.size)[constant])
    expected = before + gain @ (0.5 * before - transition.covariance) @ gain.T
    np.testing.assert_allclose((covariance - expected) / np.outer(scale, scale), 0.0, atol=1e-9)
    np.testing.assert_array_equal(covariance, covariance.T)
