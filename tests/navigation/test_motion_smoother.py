"""Smoothing of the rotational motion across a lost stretch: dense twins, consistency, and what is refused."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from motion_windows import INTERVAL, NOISE, a_window, dense, flown, partly_read, small_window, uneven_window
from scipy.stats import chi2

from edl_filter.navigation import motion_smoother
from edl_filter.navigation.motion_model import MEDIANS, WIDTHS, covariances, linearise_window, propagated_states
from edl_filter.navigation.motion_smoother import (
    Solution,
    estimate_sizes,
    most_probable_motion,
    predict_stretch,
    smooth_errors,
)
from edl_filter.navigation.rotational_dynamics import ERROR_SIZE, SIZE, add_errors


@pytest.fixture(scope="module")
def small():
    return small_window()


@pytest.fixture(scope="module")
def uneven():
    """Seven bins of different lengths, of which three are lost, linearised off the true motion."""
    window, states = uneven_window()
    window.observed[2] = False
    window, states = replace(window, first=2), states[:-1]
    moved = add_errors(states, 1e-4 * np.random.default_rng(0).standard_normal((len(states), ERROR_SIZE)))
    motion = linearise_window(window, moved)
    return window, motion, covariances(window, motion, MEDIANS)


@pytest.fixture(scope="module")
def part_read(small):
    """The small window with readings within its stretch."""
    window = partly_read(small[0], np.append(small[0].states[:, 4:7], small[0].states[-1:, 4:7], axis=0))
    motion = linearise_window(window, small[1].states)
    return window, motion, covariances(window, motion, MEDIANS)


@pytest.mark.parametrize("stretch", ["lost", "partly read"])
def test_the_smoothed_errors_are_those_of_dense_conditioning(small, part_read, stretch):
    window, motion, c = small if stretch == "lost" else part_read
    mean, covariance, design = dense(window, motion, c)
    rows = window.observed.ravel()
    h = design[rows]
    unit = np.sqrt(np.diag(covariance))
    scaled, h = covariance / np.outer(unit, unit), h * unit
    innovation = h @ scaled @ h.T + np.diag(c.row_variance.ravel()[rows])
    gain = np.linalg.solve(innovation, h @ scaled).T
    expected = mean + unit * (gain @ (motion.residual.ravel()[rows] - h @ (mean / unit)))
    posterior = (scaled - gain @ h @ scaled) * np.outer(unit, unit)
    smoothed, spread, _ = smooth_errors(motion, c, window.observed)
    sigma = np.sqrt(np.diag(posterior))
    np.testing.assert_allclose((smoothed.ravel() - expected) / sigma, 0.0, atol=1e-6)
    blocks = posterior.reshape(8, ERROR_SIZE, 8, ERROR_SIZE)[range(8), :, range(8)]
    scale = sigma.reshape(8, ERROR_SIZE)
    np.testing.assert_allclose((spread - blocks) / (scale[:, :, None] * scale[:, None, :]), 0.0, atol=1e-5)


@pytest.mark.parametrize("bins", ["equal", "different"])
def test_a_prediction_is_that_of_dense_conditioning(small, uneven, bins):
    window, motion, c = small if bins == "equal" else uneven
    mean, covariance, design = dense(window, motion, c)
    rows = window.observed.ravel()
    joint = design @ covariance @ design.T + np.diag(c.row_variance.ravel())
    known, lost = np.flatnonzero(rows), np.flatnonzero(~rows)
    scale = np.sqrt(np.diag(joint))
    joint = joint / np.outer(scale, scale)
    gain = np.linalg.solve(joint[np.ix_(known, known)], joint[np.ix_(known, lost)]).T
    expected = joint[np.ix_(lost, lost)] - gain @ joint[np.ix_(known, lost)]
    expected *= np.outer(scale[lost], scale[lost])
    prior, residual = design @ mean, motion.residual.ravel()
    linearised = (window.readings - motion.residual).ravel()
    centre = linearised[lost] + prior[lost] + scale[lost] * (gain @ ((residual - prior) / scale)[known])
    values, spread = motion_smoother._prediction(window, motion, c, window.observed, window.first, window.last)
    np.testing.assert_allclose((values.ravel() - centre) / np.sqrt(np.diag(expected)), 0.0, atol=1e-6)
    for axis in range(6):
        np.testing.assert_allclose(spread[axis], expected[axis::6, axis::6], rtol=1e-6)


@pytest.mark.parametrize("places", [slice(None), slice(-2, None)])
def test_a_covariance_that_is_not_positive_definite_is_refused(small, places):
    window, motion, c = small
    noise, observed = c.process_noise.copy(), window.observed.copy()
    noise[places, 3, 3] = -1.0  # of a rate, at the end of all bins or of the last but one
    observed[1:] = False
    with pytest.raises(np.linalg.LinAlgError, match="a predicted covariance is not positive definite"):
        smooth_errors(motion, replace(c, process_noise=noise), observed)


def test_sizes_are_those_of_the_largest_posterior_density_within_their_range(small, monkeypatch):
    """A density that is known: its maximum in the range, and the nearest sizes of the range otherwise."""
    window, motion, _ = small
    places = np.array([-9.0, 9.0, 0.0, 0.4, -0.7, 1.0, 2.0, -1.0, 0.5, -0.2, 0.1])

    def density(log_sizes):
        widths = (log_sizes - MEDIANS) / WIDTHS
        return -0.5 * np.sum((widths - places) ** 2) if widths[3] < 2.0 else np.nan

    monkeypatch.setattr(motion_smoother, "log_posterior", lambda *_: density)
    sizes = estimate_sizes(window, motion, MEDIANS)
    expected = np.clip(places, -motion_smoother._BELOW, motion_smoother._ABOVE)
    np.testing.assert_allclose((sizes - MEDIANS) / WIDTHS, expected, atol=0.06)


def test_the_best_of_three_searches_counts(small, monkeypatch):
    window, motion, _ = small
    places = []
    starts, densities = [], [None] * 3

    def search(_, states, log_sizes):
        starts.append(log_sizes)
        places.append(states)
        density = densities[len(starts) - 1]
        return None if density is None else Solution(motion, log_sizes, density)

    monkeypatch.setattr(motion_smoother, "_search", search)
    for densities[:], best in (
        ([-3.0, -2.0, -4.0], 1),
        ([-2.0, -3.0, None], 0),
        ([None, -3.0, -2.5], 2),
        ([None, None, -3.0], 2),
        ([-2.0, None, None], 0),
        ([None] * 3, None),
    ):
        starts.clear()
        places.clear()
        solution = most_probable_motion(window)
        assert solution is None if best is None else solution.log_sizes is starts[best]
    # usual sizes, and small ones that are equally improbable
    np.testing.assert_array_equal(starts[0], MEDIANS)
    widths = (starts[1] - MEDIANS) / WIDTHS
    np.testing.assert_allclose(widths, widths[0])
    assert widths[0] < -1.0
    # and usual ones about a motion that obeys Euler's equations in the stretch
    np.testing.assert_array_equal(starts[2], MEDIANS)
    assert places[0] is places[1] is window.states
    np.testing.assert_array_equal(places[2], propagated_states(window, window.states))


def test_with_readings_within_the_stretch_a_search_starts_from_the_motion_without_them(part_read, monkeypatch):
    """Propagated through the stretch; the motion without them is the best of its own three searches."""
    window, motion, _ = part_read
    shifted = add_errors(window.states, np.full((8, ERROR_SIZE), 1e-3))
    calls = []

    def search(w, states, log_sizes):
        calls.append((w.observed[w.first : w.last].any(), states))
        return Solution(replace(motion, states=shifted), log_sizes, -1.0)

    monkeypatch.setattr(motion_smoother, "_search", search)
    most_probable_motion(window)
    assert [within for within, _ in calls] == [False] * 3 + [True] * 4
    np.testing.assert_array_equal(calls[-1][1], propagated_states(window, shifted))


def test_a_search_continues_from_an_earlier_solution(small, monkeypatch):
    window, motion, _ = small
    before = Solution(motion, MEDIANS + WIDTHS, 0.0)
    monkeypatch.setattr(motion_smoother, "_search", lambda *start: start)
    assert most_probable_motion(window, before) == (window, motion.states, before.log_sizes)


def searched(monkeypatch, window, converged, moves, density=lambda: 7.0):
    """Result of a search whose motion converges or not, and whose sizes move by some widths; number of turns."""
    turns = []

    def gauss_newton(_, states, log_sizes):
        turns.append(log_sizes)
        state = converged[min(len(turns), len(converged)) - 1]
        if state == "singular":
            raise np.linalg.LinAlgError
        return None if state is None else (states, state)

    monkeypatch.setattr(motion_smoother, "_gauss_newton", gauss_newton)
    monkeypatch.setattr(motion_smoother, "linearise_window", lambda _, states: states)
    monkeypatch.setattr(motion_smoother, "log_posterior", lambda *_: lambda _: density())
    monkeypatch.setattr(motion_smoother, "estimate_sizes", lambda _, _motion, start: start + moves * WIDTHS)
    return motion_smoother._search(window, window.states, MEDIANS), turns


def test_a_search_ends_where_motion_and_sizes_remain(small, monkeypatch):
    window, still, drift = small[0], np.zeros(11), np.zeros(11)
    drift[3] = -1.0
    solution, turns = searched(monkeypatch, window, [True], still + 0.2)  # less than matters
    assert len(turns) == 1
    assert solution.log_posterior == 7.0
    np.testing.assert_array_equal(solution.log_sizes, MEDIANS)
    # sizes that the likelihood belongs to: those with which the motion was smoothed
    solution, turns = searched(monkeypatch, window, [True], drift)
    assert len(turns) == motion_smoother._MOST_SEARCHES
    assert solution.log_sizes is turns[-1]
    np.testing.assert_allclose(turns[-1] - MEDIANS, (len(turns) - 1) * drift * WIDTHS)
    solution, turns = searched(monkeypatch, window, [False, False, True], still)
    assert (len(turns), solution is None) == (3, False)


@pytest.mark.parametrize("state", [False, None, "singular"])
def test_a_search_that_diverges_has_the_best_of_the_converged_motions(small, monkeypatch, state):
    """None if no motion has converged."""
    window, drift = small[0], np.zeros(11)
    drift[3] = -1.0
    assert searched(monkeypatch, window, [state], drift)[0] is None
    solution, turns = searched(monkeypatch, window, [True, state], drift)
    assert solution.log_sizes is turns[0]
    densities = [1.0, 3.0, 2.0]
    solution, turns = searched(monkeypatch, window, [True] * 3 + [state], drift, lambda: densities.pop(0))
    assert solution.log_posterior == 3.0
    assert solution.log_sizes is turns[1]


def stepped(monkeypatch, window, start, ratio, covariance=1e-4, residual=0.0, transition=0.0):
    """Gauss-Newton steps of a motion whose errors of rates are multiplied by a ratio in each whole step."""
    count, rates = len(window.observed), slice(3, 6)
    design = np.zeros((count, 6, ERROR_SIZE))
    design[:, range(6), range(6)] = 1.0

    def linearised(_, states):
        offset = np.zeros((count, ERROR_SIZE))
        offset[:, rates] = 0.3 * (ratio - 1.0) * states[:, 4:7]
        residuals, transitions = np.zeros((count, 6)), np.zeros((count, ERROR_SIZE, ERROR_SIZE))
        residuals[-1, 0], transitions[1, 2, 3] = residual, transition
        return SimpleNamespace(states=states, offset=offset, design=design, residual=residuals, transition=transitions)

    def smoothed(motion, *_):
        return motion.offset * 0.7 / 0.3, np.tile(covariance * np.eye(ERROR_SIZE), (count, 1, 1)), None

    monkeypatch.setattr(motion_smoother, "linearise_window", linearised)
    monkeypatch.setattr(motion_smoother, "smooth_errors", smoothed)
    monkeypatch.setattr(motion_smoother, "covariances", lambda *_: None)
    states = np.zeros((count, SIZE))
    states[:, 3] = 1.0
    states[window.first, 5] = start  # the largest of all errors counts
    return motion_smoother._gauss_newton(window, states, MEDIANS)


def test_steps_that_do_not_become_smaller_are_halved(small, monkeypatch):
    window = small[0]
    states, converged = stepped(monkeypatch, window, 0.01, -0.8)  # whole steps: 0.8 to the seventh, not converged
    assert converged
    assert np.abs(states[window.first, 5]) < 1e-3 * 0.1
    _, converged = stepped(monkeypatch, window, 0.9, 0.4)  # half a step: 0.7 instead of 0.4, not converged
    assert converged
    states, converged = stepped(monkeypatch, window, 0.04, 0.55)  # whole steps at first, also if they are slow
    assert converged
    assert states[window.first, 5] == pytest.approx(0.04 * 0.55**6)
    _, converged = stepped(monkeypatch, window, 0.9, 0.9)
    assert not converged
    states, converged = stepped(monkeypatch, window, 0.9, 0.0)
    assert converged
    assert states[window.first, 5] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("broken", ["residual", "transition", "covariance"])
def test_a_motion_that_diverges_is_given_up(small, monkeypatch, broken):
    assert stepped(monkeypatch, small[0], 0.9, 0.5, **{broken: np.nan}) is None


def predicted_by(monkeypatch, window, prediction):
    """Fills of the stretch, of a function of the observed bins and a stretch that gives errors and variance."""

    def stub(_, _motion, _c, observed, first, last):
        assert not observed[first:last].any()
        assert observed.any()
        errors, variance = prediction(observed, first, last)
        return window.readings[first:last] + errors, np.tile(variance * np.eye(last - first), (6, 1, 1))

    monkeypatch.setattr(motion_smoother, "_prediction", stub)
    monkeypatch.setattr(motion_smoother, "covariances", lambda *_: None)
    return motion_smoother._validated(window, None, MEDIANS)


def test_the_covariance_is_scaled_by_the_errors_of_trial_stretches(small, monkeypatch):
    window, variance = small[0], 0.04
    sigmas, trials = np.array([0.5, 1.0, 2.0, 3.0, 0.0, 1.5]), []

    def prediction(observed, first, last):
        if (first, last) == (window.first, window.last):
            return 0.0, variance
        trials.append((first, last))
        kept = np.ones_like(observed)
        kept[first:last] = False
        np.testing.assert_array_equal(observed, window.observed & kept)
        return sigmas * np.sqrt(2.0 * variance) / 2.0, variance

    fills = predicted_by(monkeypatch, window, prediction)
    assert sorted(trials) == [(0, 2), (1, 3), (5, 7), (6, 8)]
    weight = motion_smoother._PRIOR_STRETCHES
    for k, fill in enumerate(fills):
        scale = max(1.0, (weight + 4.0 * sigmas[k] ** 2) / (weight + 4.0))
        np.testing.assert_allclose(fill.covariance, scale * variance * np.eye(2))
        np.testing.assert_array_equal(fill.values, window.readings[window.first : window.last, k])
        assert fill.scale == pytest.approx(np.sqrt(scale))
        assert fill.order == 0


def test_trial_stretches_and_predictions_from_one_side_have_what_is_read_within(part_read, monkeypatch):
    window, motion, _ = part_read
    part, used = slice(window.first, window.last), []

    def stub(_, _motion, _c, observed, first, last):
        used.append((first, observed))
        return window.readings[first:last], np.tile(0.04 * np.eye(last - first), (6, 1, 1))

    monkeypatch.setattr(motion_smoother, "_prediction", stub)
    motion_smoother._validated(window, motion, MEDIANS)
    assert sorted(first for first, _ in used) == [0, 1, 3, 3, 3, 5, 6]
    for k, (first, observed) in enumerate(used):
        expected = window.observed.copy()
        expected[first : first + 2] = window.observed[part]
        if k >= len(used) - 2:
            expected[slice(window.last, None) if k == len(used) - 2 else slice(0, window.first)] = False
        np.testing.assert_array_equal(observed, expected)


def test_the_covariance_of_a_prediction_is_scaled_by_the_misfit(part_read, monkeypatch):
    window, motion, _ = part_read
    covariances_of = []
    for misfit in (1.0, 4.0):
        monkeypatch.setattr(motion_smoother, "_SIDE_SIGMAS", np.inf)
        monkeypatch.setattr(motion_smoother, "_misfit", lambda *_, misfit=misfit: misfit)
        covariances_of.append([f.covariance for f in motion_smoother._validated(window, motion, MEDIANS)])
    np.testing.assert_allclose(covariances_of[1], 4.0 * np.array(covariances_of[0]), rtol=1e-12)


@pytest.mark.parametrize(("size", "expected"), [(0.5, 1.0), (3.0, 9.0)])
def test_readings_within_the_stretch_that_do_not_fit_enlarge_the_covariance(part_read, size, expected):
    """A motion that is known: its residuals are the readings', here one number of sigmas in the stretch."""
    window, motion, c = part_read
    least = 1e-26 * np.eye(ERROR_SIZE)
    known = replace(c, process_noise=np.tile(least, (8, 1, 1)), initial=least)
    still = replace(motion, initial=np.zeros(ERROR_SIZE), residual=size * np.sqrt(c.row_variance))
    still.residual[~window.observed] = 1e3
    still.residual[: window.first] = 1e3
    assert motion_smoother._misfit(window, still, known) == pytest.approx(expected)
    nothing = replace(window, observed=np.where(np.arange(8)[:, None] == 3, False, window.observed))
    nothing.observed[window.first : window.last] = False
    assert motion_smoother._misfit(nothing, still, known) == 1.0


def test_without_trial_stretches_the_covariance_is_that_of_the_model(small, monkeypatch):
    window = replace(small[0], observed=np.zeros((8, 6), bool))
    window.observed[[1, 6]] = True
    for fill in predicted_by(monkeypatch, window, lambda *_: (0.0, 0.04)):
        np.testing.assert_allclose(fill.covariance, 0.04 * np.eye(2))


@pytest.mark.parametrize("sides", ["both", "left", "right"])
def test_what_one_side_alone_predicts_otherwise_enlarges_the_covariance(small, monkeypatch, sides):
    window = replace(small[0], observed=small[0].observed.copy())
    bins = np.arange(8)[:, None]
    if sides != "both":
        window.observed[(bins >= window.last if sides == "left" else bins < window.first).ravel()] = False
    multiples, predicted = np.array([0.0, 1.0, 2.9, 3.1, -4.0, 9.0]), []
    # from one side: as uncertain that the difference has a variance of the sum of 0.36 (both: 0.16)
    part, sigma = np.array([0.2, 0.8]), 0.6
    observed_at = {
        "left": window.observed & (bins < window.first),
        "right": window.observed & (bins >= window.last),
    }
    trials = len(motion_smoother.trial_stretches(window.complete, window.first, window.last))

    def prediction(observed, first, last):
        if (first, last) != (window.first, window.last):  # trials whose errors give a scale of two
            weight = motion_smoother._PRIOR_STRETCHES
            square = (2.0 * (weight + trials) - weight) / trials
            return np.full(6, np.sqrt(square * 2.0 * 0.04) / 2.0), 0.04
        for side, sign in (("left", 1.0), ("right", -1.0)):
            if sides == "both" and np.array_equal(observed, observed_at[side]):
                predicted.append(side)
                return sign * sigma * part[:, None] * multiples, 0.13
        np.testing.assert_array_equal(observed, window.observed)
        predicted.append("both")
        return 0.0, 0.04

    fills = predicted_by(monkeypatch, window, prediction)
    assert predicted == (["both", "left", "right"] if sides == "both" else ["both"] * 2)
    for fill, multiple in zip(fills, multiples, strict=True):
        beyond = sides == "both" and abs(multiple) > motion_smoother._SIDE_SIGMAS
        added = (sigma * multiple) ** 2 * np.outer(part, part) if beyond else 0.0  # half of each side
        np.testing.assert_allclose(fill.covariance, 0.08 * np.eye(2) + added)


def test_a_prediction_with_a_singular_covariance_is_given_up(small, monkeypatch):
    window, motion, _ = small

    solution = Solution(motion, MEDIANS, 0.0)

    def singular(*_):
        raise np.linalg.LinAlgError

    monkeypatch.setattr(motion_smoother, "most_probable_motion", lambda *_: solution)
    monkeypatch.setattr(motion_smoother, "_validated", lambda *_: "fills")
    assert predict_stretch(window) == ("fills", solution)
    monkeypatch.setattr(motion_smoother, "_validated", singular)
    assert predict_stretch(window) is None


def sums(window, truth, fills):
    """Errors of the sums over the stretch in sigmas (6,), and the errors (6,)."""
    part = slice(window.first, window.last)
    error = np.array([f.values.sum() for f in fills]) - truth[part].sum(axis=0)
    return error / np.sqrt([f.covariance.sum() for f in fills]), error


@pytest.mark.parametrize(
    "disturbances", [pytest.param((), marks=pytest.mark.slow), (0.2, 1e-5, 2e-4, -1e-4, 0.03, 0.1)]
)
def test_a_stretch_of_several_oscillations_is_predicted_within_its_sigmas(disturbances):
    squares = []
    for seed in range(2):
        window, truth = a_window(160, 70, 94, disturbances, np.random.default_rng(seed))
        fills, _ = predict_stretch(window)
        ratio, error = sums(window, truth, fills)
        # the rotation across 3 s: an interpolation of the rates is wrong by degrees
        assert np.all(np.abs(error[:3]) * INTERVAL < np.radians(0.1))
        squares.append(ratio @ ratio)
    # not more than the chi-square distribution allows; less, since the least disturbances of the prior are not in it
    assert sum(squares) < chi2.ppf(0.999, 12)


def gust(t, state):
    """A state with a wind of 100 m/s from the 80th to the 92nd bin."""
    return state + np.eye(SIZE)[18] * {80: 100.0, 92: -100.0}.get(t, 0.0)


@pytest.mark.slow
@pytest.mark.parametrize("rates", ["one axis is lost", "all are lost"])
def test_what_is_read_within_a_stretch_determines_the_motion_there(rates):
    """A gust within the stretch, which the readings on both sides do not show.

    Two rates and the forces determine the third rate. Forces alone show the flow, in which a wind is as good as an
    attitude: the angles are then no better known, and their sigma has it.
    """
    squares, errors = [], []
    for seed in range(3):
        random = np.random.default_rng(seed)
        window, truth = a_window(180, 70, 102, random=random, change=gust)
        part = slice(window.first, window.last)
        window.readings[part] = truth[part] + NOISE * random.standard_normal((32, 6))
        states = flown(180, (), gust)[1]
        within = partly_read(window, np.append(states[:, 4:7], states[-1:, 4:7], axis=0))
        if rates == "all are lost":
            within.observed[part, :3] = False
        values = []
        for w in (window, within):
            fills, _ = predict_stretch(w)
            values.append(np.stack([f.values for f in fills[:3]], axis=1) @ w.axes[:3, :3])
        errors.append([INTERVAL * np.abs(np.cumsum(v - truth[part, :3], axis=0)).max() for v in values])  # rad
        error = (values[1] - truth[part, :3]) @ within.axes[:3, :3].T
        lost = [0] if rates == "one axis is lost" else [0, 1, 2]
        squares += [error[:, k].sum() ** 2 / fills[k].covariance.sum() for k in lost]
    without, given = np.sum(errors, axis=0)
    assert given < (0.05 if rates == "one axis is lost" else 1.0) * without
    assert sum(squares) < chi2.ppf(0.999, len(squares))


def kick(t, state):
    """A state, whose rate an impulse changes at the 82nd bin."""
    return state + np.eye(SIZE)[5] * 0.02 if t == 82 else state


def test_a_moment_that_begins_in_the_stretch_enlarges_its_sigma():
    steady, _ = a_window(160, 70, 94, random=np.random.default_rng(0))
    kicked, truth = a_window(160, 70, 94, random=np.random.default_rng(0), change=kick)
    fills = [predict_stretch(w)[0] for w in (steady, kicked)]
    sigma = [np.sqrt([f.covariance.sum() for f in fill]) for fill in fills]
    assert np.all(sigma[1][1:3] > 3.0 * sigma[0][1:3])
    ratio, _ = sums(kicked, truth, fills[1])
    assert np.all(np.abs(ratio) < 3.0)


def test_the_same_window_gives_the_same_bits():
    window, _ = a_window(100, 40, 56, random=np.random.default_rng(3))
    first, second = (predict_stretch(window)[0] for _ in range(2))
    for a, b in zip(first, second, strict=True):
        np.testing.assert_array_equal(a.values, b.values)
        np.testing.assert_array_equal(a.covariance, b.covariance)


def test_readings_that_no_motion_explains_give_no_prediction():
    window, _ = a_window(60, 25, 33, random=np.random.default_rng(4))
    window.readings[:20] = np.nan
    assert predict_stretch(window) is None
