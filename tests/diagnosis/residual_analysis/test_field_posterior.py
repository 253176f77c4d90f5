"""Posterior of a discrepancy's amplitudes along the flow: the dense Gaussian conditional of the field on its knots."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from linear_problems import from_dense, joint_measurements, posterior_states

from edl_filter.aero.discrepancy import DiscrepancyPrior
from edl_filter.diagnosis.prediction.dead_reckoning import NODES_PER_BIN
from edl_filter.diagnosis.residual_analysis.field_posterior import (
    FlownPath,
    amplitude_covariance,
    knot_coordinates,
)
from edl_filter.estimation.kalman import whitening_filter
from edl_filter.estimation.linear_state_space import LinearStateSpace

STEPS, MODES = 25, 2
#: States: a constant with which no amplitude is correlated, then the values of both modes, then their derivatives.
VALUES = slice(1, 1 + MODES)


def matern(r):
    """Correlation ``(1 + √3 |r|) exp(-√3 |r|)`` at one distance."""
    return (1.0 + np.sqrt(3.0) * abs(r)) * np.exp(-np.sqrt(3.0) * abs(r))


def matern_slope(r):
    """Its derivative by the distance, of either sign, by a central difference."""
    return (matern(r + 1e-6) - matern(r - 1e-6)) / 2e-6


def constructed_flight(seed=1):
    """State space with two amplitudes, place of each row along the flow, and residuals.

    Two rows a step, with a derivative's loading as the mean over a bin has. The transition of one amplitude is the
    conditional mean of value and derivative, given those before, by finite differences of the correlation.
    """
    rng = np.random.default_rng(seed)
    distance = np.cumsum(rng.uniform(0.02, 0.3, STEPS))
    size = 1 + 2 * MODES
    transitions, noise = np.tile(np.eye(size), (STEPS, 1, 1)), np.zeros((STEPS, size, size))
    stationary = np.diag([1.0, 3.0])
    for k, step in enumerate(np.diff(distance, prepend=distance[0])):
        slope = matern_slope(step)
        curvature = (matern_slope(step + 1e-4) - matern_slope(step - 1e-4)) / 2e-4 if step else -3.0
        cross = np.array([[matern(step), -slope], [slope, -curvature]])  # with value and derivative a step before
        of_mode = cross @ np.linalg.inv(stationary)
        of_noise = stationary - of_mode @ stationary @ of_mode.T
        for j in range(MODES):
            places = np.ix_([1 + j, 1 + MODES + j], [1 + j, 1 + MODES + j])
            transitions[k][places], noise[k][places] = of_mode, of_noise
    model = LinearStateSpace(
        increment=from_dense(transitions - np.eye(size)),
        process_noise=from_dense(noise),
        row_start=np.arange(0, 2 * STEPS + 1, 2),
        design=rng.normal(size=(2 * STEPS, size)) * [1.0, 2.0, 0.5, -0.3, 0.2],
        row_noise=np.tile(0.1 * np.eye(2), (STEPS, 1)),
        initial_covariance=np.diag([0.5, 1.0, 1.0, 3.0, 3.0]),
    )
    return model, np.repeat(distance, 2), rng.normal(size=2 * STEPS)


def covariance_with_amplitudes(model, row_distance, knots):
    """Twin of `amplitude_covariance`, element by element: a derivative's loading moves the place of the value."""
    out = np.zeros((len(row_distance), len(knots), MODES))
    for r, place in enumerate(row_distance):
        for k, knot in enumerate(knots):
            for j in range(MODES):
                value, derivative = model.design[r, VALUES.start + j], model.design[r, VALUES.stop + j]
                out[r, k, j] = value * matern(place - knot) + derivative * matern_slope(place - knot)
    return out


def posterior_at(flight, knots):
    """Mean ``(K, J)`` and covariance ``(K, J, K, J)`` of the amplitudes at knots, by white rows and columns."""
    model, row_distance, residuals = flight
    whiten = whitening_filter(model)
    white = whiten(residuals[:, None], np.zeros((0, 1)))[:, 0]
    covariance = amplitude_covariance(model.design, VALUES, row_distance, knots).reshape(len(row_distance), -1)
    reduction, mean = whiten.normal_equations(lambda rows: covariance[rows], covariance.shape[1], white)
    prior = np.array([[matern(a - b) for b in knots] for a in knots])
    shape = (len(knots), MODES)
    covariance = np.kron(prior, np.eye(MODES)) - reduction
    return mean.reshape(shape), covariance.reshape(*shape, *shape)


def test_the_covariance_with_the_amplitudes_is_that_of_each_pair():
    """Knots between the rows, at a row, and beyond both ends: the derivative's sign depends on the side."""
    model, row_distance, _ = constructed_flight()
    knots = np.array([row_distance[0] - 0.7, row_distance[7], 0.5 * (row_distance[20] + row_distance[22]), 9.0])
    actual = amplitude_covariance(model.design, VALUES, row_distance, knots)
    np.testing.assert_allclose(actual, covariance_with_amplitudes(model, row_distance, knots), rtol=0.0, atol=1e-8)
    assert np.ptp(actual) > 1.0


def test_the_posterior_is_the_conditional_of_the_dense_joint_gaussian():
    """``C' S⁻¹ y`` and ``P - C' S⁻¹ C`` with the covariance S of all rows formed explicitly."""
    flight = constructed_flight()
    model, row_distance, residuals = flight
    knots = np.array([row_distance[30] + 0.01, 0.3, row_distance[-1] + 0.5, row_distance[4]])  # in no order
    mean, covariance = posterior_at(flight, knots)
    _, total = joint_measurements(model, np.zeros(model.size))
    cross = covariance_with_amplitudes(model, row_distance, knots).reshape(len(residuals), -1)
    prior = np.array([[matern(a - b) for b in knots] for a in knots])
    expected = np.kron(prior, np.eye(MODES)) - cross.T @ np.linalg.solve(total, cross)
    np.testing.assert_allclose(mean.ravel(), cross.T @ np.linalg.solve(total, residuals), rtol=0.0, atol=1e-7)
    np.testing.assert_allclose(covariance.reshape(expected.shape), expected, rtol=0.0, atol=1e-7)
    assert np.diag(expected).min() < 0.1 < 0.5 < np.diag(expected).max()  # some are resolved, some are not


def test_at_the_rows_it_is_the_posterior_of_the_states():
    """The dense twin of the state space knows the transitions alone, whose differences are rounded to 1e-6."""
    flight = constructed_flight(seed=4)
    model, row_distance, residuals = flight
    steps = [3, 11, 12, 24]
    mean, covariance = posterior_at(flight, row_distance[[2 * k for k in steps]])
    states, of_states = posterior_states(model, np.zeros(model.size), residuals)
    after = [k + 1 for k in steps]
    np.testing.assert_allclose(mean, states[after, VALUES], rtol=0.0, atol=3e-6)
    np.testing.assert_allclose(covariance, of_states[after, VALUES][:, :, after][..., VALUES], rtol=0.0, atol=3e-6)


def test_a_regime_far_away_keeps_its_prior():
    mean, covariance = posterior_at(constructed_flight(), np.array([110.0, 110.5]))
    prior = np.array([[1.0, matern(0.5)], [matern(0.5), 1.0]])
    np.testing.assert_allclose(mean, 0.0, atol=1e-60)
    np.testing.assert_allclose(covariance.reshape(4, 4), np.kron(prior, np.eye(MODES)), rtol=1e-12, atol=1e-60)


@given(st.integers(0, 100), st.lists(st.floats(-1.0, 6.0), min_size=1, max_size=4))
def test_a_knot_does_not_depend_on_those_that_are_asked_for_with_it(seed, knots):
    """The posterior is that of a process: a marginal is the same in any set of knots, and data only remove variance."""
    flight, knots = constructed_flight(seed), np.array(knots)
    mean, covariance = posterior_at(flight, knots)
    for k, knot in enumerate(knots):
        alone, alone_covariance = posterior_at(flight, np.array([knot]))
        np.testing.assert_allclose(mean[k], alone[0], rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(covariance[k, :, k], alone_covariance[0, :, 0], rtol=1e-9, atol=1e-12)
        variance = np.diag(alone_covariance[0, :, 0])
        assert np.all(variance > 0.0) and np.all(variance < 1.0)


# --- the flown path --------------------------------------------------------------------------------------------------

PRIOR = DiscrepancyPrior(scale=1.0, log_mach_length=0.4, log_knudsen_length=0.8)
LIMIT = 1e-3


def constructed_model(join="switch"):
    """What the path needs of a model: six bins, rarefied for two and a half bins and continuum afterwards."""
    count = 6 * NODES_PER_BIN + 1
    knudsen = np.where(np.arange(count) < 10, 1.0, 1e-2) * 10.0 ** (-0.1 * np.arange(count))
    bin_rows = np.full((6, 12), -1)
    bin_rows[0, 0] = 0
    bin_rows[1, 6:] = np.arange(1, 7)  # only the checking IMU is compared in this bin
    bin_rows[2, 3:6] = np.arange(7, 10)  # only the step of the rate
    bin_rows[3, 2] = 10
    bin_rows[5, :3] = np.arange(11, 14)
    edges = 20.0 + 0.5 * np.arange(7)
    flow = SimpleNamespace(
        mach=20.0 * np.exp(-0.03 * np.arange(count) + 0.1 * np.sin(np.arange(count))),
        knudsen=knudsen,
        speed=5e3 - 10.0 * np.arange(count),
        alpha_total=np.linspace(0.0, 0.1, count),
    )
    return SimpleNamespace(
        residuals=SimpleNamespace(flow=flow, nodes=SimpleNamespace(time=20.0 + 0.125 * np.arange(count))),
        inputs=SimpleNamespace(
            forward_model=SimpleNamespace(database=SimpleNamespace(continuum_limit=LIMIT, join=join))
        ),
        case=SimpleNamespace(uncertainty=SimpleNamespace(discrepancy=PRIOR)),
        index=SimpleNamespace(bin_rows=bin_rows, time=np.repeat(edges[[1, 2, 3, 4, 6]], [1, 6, 3, 1, 3]) - 0.05),
    )


@pytest.mark.parametrize("join", ["switch", "continuous"])
def test_the_path_of_a_flight_is_summed_node_by_node(join):
    """By the Knudsen number while both nodes are rarefied, else by the Mach number; far where one table ends."""
    model = constructed_model(join)
    flow, path = model.residuals.flow, FlownPath.of(model)
    distance = [0.0]
    for k in range(1, len(flow.mach)):
        before, after = flow.knudsen[k - 1] > LIMIT, flow.knudsen[k] > LIMIT
        if before and after:
            step = abs(np.log10(flow.knudsen[k]) - np.log10(flow.knudsen[k - 1])) / 0.8
        else:
            step = abs(np.log(flow.mach[k]) - np.log(flow.mach[k - 1])) / 0.4
        distance.append(distance[-1] + (100.0 if join == "switch" and before != after else step))
    np.testing.assert_allclose(path.distance, distance, rtol=1e-12)
    assert (distance[-1] > 100.0) == (join == "switch")
    for r, time in enumerate(model.index.time):
        place = (time - 20.0) / 0.125
        k, fraction = int(place), place - int(place)
        assert path.row_distance[r] == pytest.approx((1.0 - fraction) * distance[k] + fraction * distance[k + 1])
    for name in ("mach", "knudsen", "speed", "alpha_total"):
        np.testing.assert_array_equal(getattr(path, name), getattr(flow, name))


def test_nodes_are_compared_in_bins_of_which_the_driving_imu_is():
    """Not where only a checking IMU has rows, which say nothing of the air; the end of the last bin belongs to none."""
    path = FlownPath.of(constructed_model())
    by_bin = [True, False, True, True, False, True]
    np.testing.assert_array_equal(path.compared[:-1].reshape(6, NODES_PER_BIN), np.outer(by_bin, np.ones(4)))
    assert not path.compared[-1] and path.mach.shape == path.compared.shape
    np.testing.assert_array_equal(np.flatnonzero(path.inside("knudsen")), [0, 1, 2, 3, 8, 9])
    np.testing.assert_array_equal(np.flatnonzero(path.inside("mach")), [10, 11, 12, 13, 14, 15, 20, 21, 22, 23])


def path_of(coordinate, regime="mach", compared=None, distance=None):
    """A path through one regime with given coordinates at its nodes, all compared unless stated otherwise."""
    coordinate = np.asarray(coordinate, float)
    ones, rarefied = np.ones(len(coordinate)), regime == "knudsen"
    return FlownPath(
        distance=np.concatenate(([0.0], np.cumsum(np.abs(np.diff(coordinate))))) if distance is None else distance,
        row_distance=np.zeros(0),
        mach=ones if rarefied else np.exp(coordinate),
        knudsen=10.0**coordinate if rarefied else 1e-5 * ones,
        speed=1e3 * ones,
        alpha_total=0.0 * ones,
        rarefied=np.full(len(coordinate), rarefied),
        compared=np.ones(len(coordinate), bool) if compared is None else np.asarray(compared, bool),
    )


@pytest.mark.parametrize(("regime", "number"), [("mach", np.exp), ("knudsen", lambda x: 10.0**x)])
def test_the_flown_range_is_that_of_the_compared_nodes_of_the_regime(regime, number):
    path = path_of([3.0, 2.5, 2.8, 1.0, 0.5], regime, [False, True, True, True, False])
    assert path.flown_range(regime) == pytest.approx((1.0, 2.8))
    np.testing.assert_allclose(path.coordinate(regime), [3.0, 2.5, 2.8, 1.0, 0.5], rtol=1e-12)
    np.testing.assert_allclose(getattr(path, regime), number(np.array([3.0, 2.5, 2.8, 1.0, 0.5])))
    assert path.flown_range("knudsen" if regime == "mach" else "mach") is None
    single = path_of([3.0, 2.5, 2.8], regime, [False, True, False])
    assert single.flown_range(regime) is None


def last_passage(flown, distance, value):
    """Greatest distance at which the straight lines between the nodes have a value, line by line from the end."""
    for k in range(len(flown) - 2, -1, -1):
        a, b = flown[k], flown[k + 1]
        if a != b and min(a, b) <= value <= max(a, b):
            return distance[k] + (value - a) / (b - a) * (distance[k + 1] - distance[k])
    raise AssertionError("the value is not flown")


@given(st.integers(0, 10_000), st.integers(2, 40), st.floats(0.0, 1.0), st.sampled_from(["mach", "knudsen"]))
def test_a_number_that_only_falls_is_passed_once(seed, count, share, regime):
    flown = 3.0 - np.cumsum(np.random.default_rng(seed).uniform(1e-3, 0.2, count))
    path = path_of(flown, regime)
    value = flown[-1] + share * (flown[0] - flown[-1])
    expected = last_passage(flown, path.distance, value)
    assert path.distance_at(regime, np.array([value]))[0] == pytest.approx(expected, abs=1e-9)
    assert expected == pytest.approx(flown[0] - value, abs=1e-9)  # the distance is the fall since the beginning


@given(st.integers(0, 10_000), st.integers(3, 40))
def test_of_a_number_that_is_passed_several_times_it_is_the_last_passage(seed, count):
    """At every number that a node has for the last time; the lowest one of all is flown at the end."""
    flown = 3.0 - np.cumsum(np.random.default_rng(seed).normal(0.03, 0.1, count))
    path = path_of(flown)
    last = [k for k in range(count) if all(flown[k] > v for v in flown[k + 1 :])]
    assume(len(last) > 1)
    actual = path.distance_at("mach", flown[last])
    expected = [last_passage(flown, path.distance, flown[k]) for k in last[:-1]] + [path.distance[-1]]
    np.testing.assert_allclose(actual, expected, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(path.at_distance(actual)[0], np.exp(flown[last]), rtol=1e-9)
    assert np.all(np.diff(actual) > 0.0)


@pytest.mark.parametrize(
    ("flown", "value"),
    [
        ([5.0, 3.0, 4.0, 2.0], 4.5),  # passed once, on the first line; the number rises to 4 again afterwards
        ([5.0, 1.0, 2.0], 1.2),  # the flight ends above the smallest number, on the way up
    ],
)
def test_the_place_of_a_number_is_on_the_path(flown, value):
    """The flow at the place of a number has this number, wherever the last passage is."""
    path = path_of(flown)
    place = path.distance_at("mach", np.array([value]))
    assert place[0] == pytest.approx(last_passage(flown, path.distance, value), abs=1e-9)
    assert np.log(path.at_distance(place)[0]) == pytest.approx([value], abs=1e-9)


def test_only_compared_nodes_count_for_the_place():
    """The last passage is in bins that are not compared: it is the one before, of which the flight says something."""
    flown, compared = [3.0, 2.0, 1.0, 2.0, 1.5], [True, True, True, False, False]
    path = path_of(flown, compared=compared)
    np.testing.assert_allclose(path.distance_at("mach", np.array([2.0, 1.2])), [1.0, 1.8], rtol=1e-12)


def test_flow_at_a_distance_is_linear_in_the_logarithms():
    path = FlownPath(
        distance=np.array([0.0, 1.0, 3.0]),
        row_distance=np.zeros(0),
        mach=np.array([16.0, 4.0, 1.0]),
        knudsen=np.array([1e-2, 1e-4, 1e-5]),
        speed=np.array([4e3, 1e3, 3e2]),
        alpha_total=np.zeros(3),
        rarefied=np.zeros(3, bool),
        compared=np.ones(3, bool),
    )
    mach, knudsen, speed = path.at_distance(np.array([0.5, 1.0, 2.0]))
    np.testing.assert_allclose(mach, [8.0, 4.0, 2.0], rtol=1e-12)
    np.testing.assert_allclose(knudsen, [1e-3, 1e-4, 10.0**-4.5], rtol=1e-12)
    np.testing.assert_allclose(speed, [2500.0, 1000.0, 650.0], rtol=1e-12)


@given(st.floats(-3.0, 3.0), st.floats(0.0, 5.0), st.floats(0.1, 2.0), st.floats(0.1, 1.0))
def test_knots_reach_from_end_to_end_and_are_no_more_than_necessary(low, extent, length, spacing):
    high = low + extent
    knots = knot_coordinates(low, high, length, spacing)
    assert knots[0] == low and knots[-1] == pytest.approx(high, abs=1e-12) and len(knots) >= 2
    step = (high - low) / (len(knots) - 1)
    np.testing.assert_allclose(np.diff(knots), step, rtol=0.0, atol=1e-12)
    assert step <= spacing * length * (1.0 + 1e-12)
    if len(knots) > 2:  # one knot less would be too few
        assert (high - low) / (len(knots) - 2) > spacing * length * (1.0 - 1e-12)
