"""Consensus of readings: against the sequential filter, and with outliers and wrong states by hand."""

import numpy as np
import pytest
import test_filter as flight

from edl_filter.navigation import consensus as module
from edl_filter.navigation.consensus import Consensus, JointPrediction, find_consensus, predict_jointly
from edl_filter.navigation.filter import Settings, new_filter, run_filter

GATE = 0.99999
TIME = np.arange(15) * 0.125


def line(height_error=0.0, speed_error=0.0, outliers=(), seed=0, sigma=5.0, state_sigma=(20.0, 1.0)):
    """Readings of a height that is a line in time, with state errors beyond their sigmas and outliers (index, size)."""
    residual = height_error + speed_error * TIME + sigma * np.random.default_rng(seed).standard_normal(len(TIME))
    for index, size in outliers:
        residual[index] += size
    sensitivity = np.zeros((len(TIME), 6))
    sensitivity[:, 0], sensitivity[:, 3] = 1.0, TIME
    noise = sigma**2 * np.eye(len(TIME))
    state = np.diag(np.square([state_sigma[0], 0.0, 0.0, state_sigma[1], 0.0, 0.0]))
    return JointPrediction(residual[:, None], sensitivity @ state @ sensitivity.T + noise, noise, sensitivity)


@pytest.mark.parametrize("seed", range(10))
def test_good_readings_agree_with_each_other_and_with_the_state(seed):
    consensus = find_consensus(line(seed=seed), GATE)
    assert consensus.agree.all() and consensus.majority
    assert consensus.directions == 2
    assert not consensus.state_outlier


@pytest.mark.parametrize("outliers", [[(0, 900.0)], [(0, 900.0), (7, 900.0), (14, 900.0)], [(0, -80.0), (1, 300.0)]])
def test_outliers_are_separated_wherever_they_are(outliers):
    consensus = find_consensus(line(outliers=outliers), GATE)
    assert np.flatnonzero(~consensus.agree).tolist() == [k for k, _ in outliers]
    assert not consensus.state_outlier


def test_readings_that_agree_make_the_state_the_outlier():
    consensus = find_consensus(line(height_error=400.0, speed_error=-20.0, outliers=[(3, 900.0)]), GATE)
    assert np.flatnonzero(~consensus.agree).tolist() == [3]
    assert consensus.state_outlier
    assert consensus.nis - consensus.free_nis > 100.0


def test_readings_without_a_majority_say_nothing():
    residual = line()
    scattered = JointPrediction(
        np.linspace(-1.0, 1.0, 15)[:, None] ** 3 * 1e4 * (-1.0) ** np.arange(15)[:, None],
        residual.covariance, residual.noise, residual.sensitivity,
    )  # fmt: skip
    consensus = find_consensus(scattered, GATE)
    assert not consensus.majority and not consensus.state_outlier


def test_half_of_the_readings_are_no_majority():
    """Seven of fourteen agree with each other, and contradict the state; the others agree with nothing."""
    scattered = [(k, (-1.0) ** k * 1e4 * 2.0**k) for k in range(7)]
    part = line(height_error=400.0, outliers=scattered)
    halves = JointPrediction(
        part.residual[:14], part.covariance[:14, :14], part.noise[:14, :14], part.sensitivity[:14]
    )  # fmt: skip
    for prediction, majority in ((halves, False), (part, True)):
        consensus = find_consensus(prediction, GATE)
        assert (consensus.majority, consensus.state_outlier) == (majority, majority)
        # without a majority no reading agrees with the state
        assert np.flatnonzero(consensus.agree).tolist() == (list(range(7, 15)) if majority else [])
        assert (consensus.nis - consensus.free_nis > 100.0) == majority


@pytest.mark.parametrize("seed", range(10))
def test_a_majority_with_a_common_error_is_not_the_state_of_all_others(seed):
    """Eight of fifteen readings are off by 50 m: the state, known to 2 m, and the seven others agree."""
    off = np.random.default_rng(seed).permutation(15)[:8]
    prediction = line(outliers=[(k, 50.0) for k in off], seed=seed, state_sigma=(2.0, 1.0))
    consensus = find_consensus(prediction, GATE)
    assert not consensus.state_outlier
    assert np.flatnonzero(~consensus.agree).tolist() == sorted(off)


@pytest.mark.parametrize("seed", range(10))
def test_readings_that_agree_by_chance_along_a_steep_line_are_not_a_state(seed):
    """Six of fifteen are off by 50 m: with a free velocity a line joins them with good readings."""
    off = np.random.default_rng(seed).permutation(15)[:6]
    prediction = line(outliers=[(k, 50.0) for k in off], seed=seed, state_sigma=(2.0, 1.0))
    consensus = find_consensus(prediction, GATE)
    assert not consensus.state_outlier and consensus.majority
    assert np.flatnonzero(~consensus.agree).tolist() == sorted(off)


@pytest.mark.parametrize("error", [15.0, 30.0, 400.0])
def test_a_wrong_state_is_the_outlier_also_with_readings_beyond_the_gate(error):
    """All readings agree on a height that is 7 to 200 sigmas off; two more are outliers."""
    consensus = find_consensus(
        line(height_error=error, outliers=[(2, 600.0), (9, -300.0)], sigma=2.0, state_sigma=(2.0, 0.1)), GATE
    )
    assert consensus.state_outlier
    assert np.flatnonzero(~consensus.agree).tolist() == [2, 9]


@pytest.mark.parametrize(("members", "majority"), [(6, False), (7, False), (8, True)])
def test_a_majority_is_more_than_half_of_the_readings(members, majority):
    assert Consensus(np.arange(14) < members, 1.0, 1.0, 2, False).majority == majority


@pytest.mark.parametrize(("outlier", "sets"), [(False, 1), (True, 105)])
def test_the_limit_of_the_likelihood_ratio_is_that_of_as_many_sets_as_were_compared(outlier, sets):
    """Two directions: -2 ln p is the quantile. With an outlier the set is the best one of all 105 pairs."""
    limit = -2.0 * np.log((1.0 - GATE) / sets)
    part = line()
    rows = np.arange(15) != 3 if outlier else np.ones(15, bool)
    state, free = (matrix[np.ix_(rows, rows)] for matrix in (part.covariance, part.free_covariance))
    ratio_of_one_metre = np.sum(np.linalg.inv(state)) - np.sum(np.linalg.inv(free))
    for share, expected in ((0.998, False), (1.002, True)):
        residual = np.where(rows, np.sqrt(share * limit / ratio_of_one_metre), 900.0)[:, None]
        consensus = find_consensus(JointPrediction(residual, part.covariance, part.noise, part.sensitivity), GATE)
        assert consensus.state_outlier == expected
        assert np.array_equal(consensus.agree, rows)


@pytest.mark.parametrize(("information", "directions"), [(0.7, 0), (1.5, 1), (2.5, 1)])
def test_directions_count_where_the_noise_is_below_the_unknown_position(information, directions):
    """Of a height with a mean that is known to 1e5 m over `information`; its slope is not known at all."""
    prediction = line(sigma=np.sqrt(len(TIME)) * 1e5 / information)
    consensus = find_consensus(prediction, GATE)
    assert consensus.directions == directions and not consensus.state_outlier


def test_unknown_position_and_velocity_add_their_variance_to_the_predictions():
    """100 km and 1 km/s: heights at 0 s and 1 s."""
    prediction = line(sigma=5.0, state_sigma=(0.0, 0.0))
    free = prediction.free_covariance[np.ix_([0, 8], [0, 8])]
    np.testing.assert_allclose(free, [[1e10 + 25.0, 1e10], [1e10, 1e10 + 1e6 + 25.0]], rtol=1e-14)


# --- readings of several components, whose predictions are correlated ---------------------------------------------


def correlated(seed, readings=6, components=2):
    """Residuals ``(K, m)`` of a random covariance ``(K m, K m)``, two of them outliers."""
    rng, size = np.random.default_rng(seed), readings * components
    root = rng.normal(size=(size, size))
    covariance = root @ root.T + 0.5 * np.eye(size)
    residual = (np.linalg.cholesky(covariance) @ rng.normal(size=size)).reshape(readings, components)
    residual[rng.choice(readings, 2, replace=False)] += 30.0
    return residual, covariance


def conditional(residual, covariance, reading, given):
    """NIS of a reading and log determinant of its covariance, given others: the density of the dense Gaussian."""
    components = residual.shape[1]
    predicted = np.arange(components) + components * reading
    rows = np.concatenate([np.arange(components) + components * k for k in given])
    both = np.concatenate((rows, predicted))

    def moments(selected):
        r, c = residual.ravel()[selected], covariance[np.ix_(selected, selected)]
        return np.array([r @ np.linalg.inv(c) @ r, np.linalg.slogdet(c)[1]])

    return moments(both) - moments(rows)  # chain rule


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("components", [1, 2, 3])
def test_readings_are_predicted_by_others_as_the_joint_gaussian_says(seed, components):
    residual, covariance = correlated(seed, components=components)
    members = [0, 2, 5]
    nis, log_spread = module._predicted(residual, covariance, members)
    for k in (1, 3, 4):
        np.testing.assert_allclose((nis[k], log_spread[k]), conditional(residual, covariance, k, members), rtol=1e-6)
    left_out = module._left_out(residual, covariance, members)
    expected = [conditional(residual, covariance, k, [j for j in members if j != k])[0] for k in members]
    np.testing.assert_allclose(left_out, expected, rtol=1e-6)


@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize("limit", [3.0, 20.0])
def test_the_first_pair_has_the_largest_truncated_likelihood(seed, limit):
    residual, covariance = correlated(seed)
    cost = {}
    for i in range(6):
        for j in range(i + 1, 6):
            predictions = [conditional(residual, covariance, k, [i, j]) for k in range(6) if k not in (i, j)]
            cost[i, j] = sum(min(nis, limit) + log_spread for nis, log_spread in predictions)
    assert tuple(module._first_pair(residual, covariance, limit)) == min(cost, key=cost.get)


@pytest.mark.parametrize(
    ("residual", "start", "expected"),
    [
        ([0.0, 0.0, 9.0, 0.0], [0, 2], [0, 1, 3]),  # a wrong member of the pair is removed after others are added
        ([0.0, 0.0, 9.0], [0, 2], [0, 1]),
        ([1.0, 0.0, -1.0, 1.5], [0, 1], [0, 1, 2, 3]),
        ([9.0, -9.0], [0, 1], [0, 1]),  # of two readings, neither is the outlier
        ([0.0, 9.0, 0.0, -8.0, 7.0, 0.0, 0.0, 1.0], [3, 4], [0, 2, 5, 6, 7]),
    ],
)
def test_a_set_of_independent_readings_grows_to_those_within_the_gate(residual, start, expected):
    residual = np.array(residual)[:, None]
    assert module._refine(residual, np.eye(len(residual)), start, 4.0) == expected


@pytest.mark.parametrize("smallest", [0.5, -1e-3])
def test_the_transition_follows_from_the_covariances_also_with_an_indefinite_one(smallest):
    rng = np.random.default_rng(3)
    axes, _ = np.linalg.qr(rng.normal(size=(4, 4)))
    covariance, matrix = axes @ np.diag([4.0, 2.0, 1.0, smallest]) @ axes.T, rng.normal(size=(4, 4))
    matrix[2] = np.eye(4)[2]  # a state that the step leaves as it is
    cross = covariance @ matrix.T
    cross[:, 2] = covariance[:, 2]
    rows, index = module._transition_rows(covariance, cross)
    np.testing.assert_array_equal(index, [0, 1, 3])
    np.testing.assert_allclose(rows, matrix[index], rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("method", ["ukf", "ekf"])
def test_sensitivities_are_the_derivatives_of_the_predictions(method):
    """With respect to position and velocity at the beginning, by moving the filter's state."""
    readings = [flight.height(t) for t in (2.0, 2.0, 4.5, 9.0)]
    problem = flight.build(readings, settings=Settings(longest_interval=2.0, method=method))
    start = run_filter(problem).nodes[0]

    def residuals(errors):
        moved = start.state.plus(errors)
        tight = 1e-6 * start.covariance  # the mean of the UKF's prediction is that of the state itself
        estimator = new_filter(problem, moved, tight)
        return predict_jointly(estimator, problem.samples, problem.constraints).residual.ravel()

    joint = predict_jointly(new_filter(problem, start.state, start.covariance), problem.samples, problem.constraints)
    assert joint.sensitivity.shape == (4, 6)
    for column, step in enumerate(np.repeat([100.0, 1.0], 3)):
        errors = np.zeros(problem.layout.size)
        errors[column] = step
        derivative = -(residuals(errors) - residuals(-errors)) / (2.0 * step)
        np.testing.assert_allclose(joint.sensitivity[:, column], derivative, rtol=1e-2, atol=1e-3)


@pytest.mark.parametrize("method", ["ukf", "ekf"])
def test_the_joint_prediction_has_the_likelihood_of_the_filter(method):
    """Chain rule: the joint density of all readings is the product of the filter's predictions with updates."""
    readings = [flight.height(t, 20.0, 30.0) for t in (2.0, 3.0, 4.5, 7.0, 9.0)]
    settings = Settings(longest_interval=2.0, gate_probability=1.0, method=method)
    problem = flight.build(readings, settings=settings)
    filter_pass = run_filter(problem)
    start = filter_pass.nodes[0]
    joint = predict_jointly(new_filter(problem, start.state, start.covariance), problem.samples, problem.constraints)
    r = joint.residual.ravel()
    sequential = [f.innovation for f in filter_pass.fused]
    assert r @ np.linalg.solve(joint.covariance, r) == pytest.approx(sum(i.nis for i in sequential), rel=2e-3)
    spreads = [np.linalg.slogdet(i.predicted_covariance + i.noise_covariance)[1] for i in sequential]
    assert np.linalg.slogdet(joint.covariance)[1] == pytest.approx(sum(spreads), rel=2e-3)
