"""Consensus of readings: against the sequential filter, and with outliers and wrong states by hand."""

import numpy as np
import pytest
import test_filter as flight

from edl_filter.navigation.consensus import JointPrediction, find_consensus, predict_jointly
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
