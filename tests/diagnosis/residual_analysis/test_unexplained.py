"""The unexplained remainder: a spectral line in noise, the interval of a failure, what it follows.

The smoothed unmodelled force and moment are compared with the simulated ones.

A remainder of a real flight is in the tests of the flights.
"""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from unmodelled_flights import flight, residuals_of, simulated_process

from edl_filter.diagnosis.noise.unmodelled_acceleration import UnmodelledAcceleration, accelerations, augment
from edl_filter.diagnosis.prediction.dead_reckoning import NODES_PER_BIN
from edl_filter.diagnosis.residual_analysis.unexplained import (
    _correlation,
    _description,
    _failing_span,
    _spectral_line,
    estimate_latent_force,
)
from edl_filter.effects.types import Body
from edl_filter.mission.decision_settings import DecisionSettings
from edl_filter.results.verdicts import Form

SETTINGS = DecisionSettings()
DT = 0.125
TIME = 60.0 + DT * np.arange(800)
PIECE = SETTINGS.unexplained_piece_s
MASS = 800.0
INERTIA = np.array([[250.0, 5.0, -3.0], [5.0, 180.0, 4.0], [-3.0, 4.0, 200.0]])
BODY = Body(MASS, INERTIA)


def line_of(time, series):
    return _spectral_line(time, series, SETTINGS)


@settings(max_examples=12)
@given(st.floats(0.1, 3.5), st.floats(0.0, 6.0), st.integers(0, 100))
def test_frequency_of_a_sine_in_noise(frequency, phase, seed):
    """To a fifth of 1/span, with noise of half its power."""
    noise = np.random.default_rng(seed).normal(size=len(TIME))
    sine = np.sqrt(2.0) * np.sin(2.0 * np.pi * frequency * TIME + phase)
    assert line_of(TIME, 5.0 + sine + 0.7 * noise) == pytest.approx(frequency, abs=0.2 / (TIME[-1] - TIME[0]))


def test_a_line_is_recognised_in_spite_of_gaps():
    used = (np.arange(800) % 40 > 12) | (np.arange(800) < 100)
    assert line_of(TIME[used], np.sin(2.0 * np.pi * 0.7 * TIME[used])) == pytest.approx(0.7, abs=2e-3)


@pytest.mark.parametrize(("cycles", "is_line"), [(0.5, False), (1.0, False), (2.0, False), (4.0, True)])
def test_a_trend_is_not_a_line(cycles, is_line):
    """One or two cycles within the span are a trend."""
    frequency = line_of(TIME, np.sin(2.0 * np.pi * cycles * (TIME - TIME[0]) / (TIME[-1] - TIME[0])))
    assert (frequency is not None) == is_line


def test_noise_has_no_line():
    rng = np.random.default_rng(2)
    assert not any(line_of(TIME, rng.normal(size=len(TIME))) for _ in range(15))


def test_fifteen_samples_have_no_line():
    assert line_of(TIME[:15], np.sin(TIME[:15])) is None


def span_of(normalised, used=None):
    """Failing interval of a channel that is compared in the bins `used`."""
    edges = np.append(TIME, TIME[-1] + DT)
    rows = np.arange(len(TIME)) if used is None else np.where(used, np.cumsum(used) - 1, -1)
    values = normalised if used is None else normalised[used]
    return _failing_span(rows, values, TIME + 0.5 * DT, edges, SETTINGS)


@pytest.mark.parametrize("used", [None, np.arange(800) % 7 > 0])
def test_interval_of_a_failure(used):
    """To the length of a piece."""
    failing = (TIME > 90.0) & (TIME < 125.0)
    normalised = np.random.default_rng(3).normal(size=800) * np.where(failing, 6.0, 1.0)
    t0, t1, rms = span_of(normalised, used)
    assert (t0, t1) == (pytest.approx(90.0, abs=PIECE + 0.1), pytest.approx(125.0, abs=PIECE + 0.1))
    assert rms == pytest.approx(6.0, rel=0.15)


def test_of_two_failures_the_one_with_the_larger_sum_of_squares():
    normalised = np.random.default_rng(4).normal(size=800)
    normalised[(TIME > 70.0) & (TIME < 80.0)] *= 20.0
    normalised[(TIME > 100.0) & (TIME < 130.0)] *= 4.0
    t0, t1, rms = span_of(normalised)
    assert t0 == pytest.approx(70.0, abs=PIECE + 0.1) and t1 == pytest.approx(80.0, abs=PIECE + 0.1) and rms > 15.0


def test_one_piece_that_holds_does_not_divide_a_failure():
    normalised = np.full(800, 5.0)
    normalised[160:180] = 0.1  # one whole piece
    assert span_of(normalised)[:2] == (pytest.approx(60.0), pytest.approx(160.0))


def test_noise_has_no_failing_interval():
    rng = np.random.default_rng(5)
    none = [span_of(rng.normal(size=800)) is None for _ in range(100)]
    assert np.mean(none) > 0.95


def test_a_channel_that_is_not_compared_has_no_failing_interval():
    edges = np.append(TIME, 160.0)
    assert _failing_span(np.full(800, -1), np.zeros(0), TIME, edges, SETTINGS) is None


def test_correlation():
    x = np.linspace(-1.0, 1.0, 101)
    assert _correlation(3.0 * x + 2.0, x) == pytest.approx(1.0)
    assert _correlation(x**2, x) == pytest.approx(0.0, abs=1e-12)
    assert np.isnan(_correlation(np.ones(101), x))


def test_the_description_names_what_is_followed_and_what_acts_at_the_same_time():
    text = _description(
        "moment_y", (63.0, 164.0, 116.4), 4.9, "N m", 0.6794, {"q": 0.6, "Mach": -0.9}, ("force_z",), SETTINGS
    )
    assert text == (
        "moment y from 63 to 164 s: 4.9 N m RMS, 116 times its sigma; it oscillates at 0.679 Hz; "
        "it follows Mach (correlation -0.90); force z acts at the same time."
    )
    text = _description("force_x", (1.0, 2.0, 3.0), 4.0, "N", None, {"q": 0.2}, (), SETTINGS)
    assert "Hz" not in text and text.endswith("it follows none of q, angle of attack and Mach number.")


def model_of(case, residuals):
    """What a linearised model must have."""
    state_space, index, bins, flow = case
    return SimpleNamespace(
        index=index,
        bins=bins,
        residuals=SimpleNamespace(flow=flow),
        inputs=SimpleNamespace(forward_model=SimpleNamespace(bodies=lambda time: [(slice(None), BODY)])),
        initial_mean=np.zeros(0),
        state_space_with_unmodelled=lambda u: augment(state_space, index, bins, flow, u),
        white_residuals=lambda whiten: whiten(residuals[:, None], np.zeros((0, 1)))[:, 0],
    )


def sample_model(model, rng):
    """States ``(K, n)`` and measurements ``(R,)`` that are drawn from a state-space model."""
    x = np.linalg.cholesky(model.initial_covariance) @ rng.normal(size=model.size)
    states, measurements = [], []
    for k in range(len(model.increment)):
        x = x + model.increment[k] @ x + np.sqrt(np.diag(model.process_noise[k])) * rng.normal(size=model.size)
        rows = slice(model.row_start[k], model.row_start[k + 1])
        sigma = np.sqrt(np.diag(model.row_noise[rows]))
        measurements.append(model.design[rows] @ x + sigma * rng.normal(size=rows.stop - rows.start))
        states.append(x)
    return np.array(states), np.concatenate(measurements)


@pytest.mark.parametrize(
    ("with_pressure", "form"),
    [(False, Form.BODY), (True, Form.BODY), (False, Form.RATE), (False, Form.ANGLE)],
)
def test_errors_have_the_stated_sigmas(with_pressure, form):
    """Of force and moment, in N and N m in body axes, drawn from the model; the errors of bins are correlated."""
    unmodelled = UnmodelledAcceleration(0.1, 0.02, 2.0, with_pressure, form)
    case, rng, standardised = flight(300), np.random.default_rng(2), []
    shape = accelerations(case[3], unmodelled)[NODES_PER_BIN // 2 :: NODES_PER_BIN]
    state_space = augment(*case, unmodelled)
    for _ in range(5):
        states, residuals = sample_model(state_space, rng)
        latent = estimate_latent_force(model_of(case, residuals), unmodelled)
        true = np.einsum("bij,bj->bi", shape, states)
        force, moment = MASS * true[:, :3], true[:, 3:] @ INERTIA.T
        lateral = slice(0, 3) if form is Form.BODY else slice(1, 3)
        standardised.append(
            (
                ((latent.force - force) / np.where(latent.force_sigma > 0.0, latent.force_sigma, 1.0))[:, lateral],
                ((latent.moment - moment) / latent.moment_sigma)[:, lateral],
            )
        )
    for errors in np.swapaxes(standardised, 0, 1):
        assert np.sqrt(np.mean(np.square(errors))) == pytest.approx(1.0, abs=0.1)
    np.testing.assert_allclose(latent.time, case[2].middle)


def test_a_continuous_force_and_moment_are_recovered():
    """The process varies within the bins, which the model neglects."""
    case, rng = flight(300), np.random.default_rng(2)
    process = simulated_process(case, rng, 0.1, 0.02, 10.0)
    residuals = residuals_of(case, rng, process)
    latent = estimate_latent_force(model_of(case, residuals), UnmodelledAcceleration(0.1, 0.02, 10.0))
    middle = process[NODES_PER_BIN // 2 :: NODES_PER_BIN]
    for estimate, true in ((latent.force, MASS * middle[:, :3]), (latent.moment, middle[:, 3:] @ INERTIA.T)):
        assert np.sqrt(np.mean((estimate - true) ** 2)) < 0.15 * np.sqrt(np.mean(true**2))


@pytest.mark.parametrize("unmodelled", [UnmodelledAcceleration(), UnmodelledAcceleration(1e-3, 1e-5, form=Form.IMU)])
def test_there_is_none_where_the_process_is_no_force(unmodelled):
    case = flight(20)
    assert estimate_latent_force(model_of(case, np.zeros(case[1].count)), unmodelled) is None


def test_a_failure_of_one_piece_does_not_hide_a_longer_one():
    """Neither if its sum of squares is larger."""
    normalised = np.full(800, 0.5)
    normalised[80:100] = 60.0
    normalised[200:300] = 4.0
    edges = TIME[0] + np.array([200, 300]) * DT
    assert span_of(normalised)[:2] == (pytest.approx(edges[0]), pytest.approx(edges[1]))


def test_the_last_piece_is_no_neighbour_of_the_first():
    normalised = np.full(800, 0.5)
    normalised[20:40] = normalised[-20:] = 4.0
    assert span_of(normalised) is None
    normalised[60:80] = 4.0
    assert span_of(normalised)[:2] == (pytest.approx(TIME[20]), pytest.approx(TIME[80]))


def test_a_record_too_short_for_the_least_number_of_cycles_has_no_line():
    time = 0.1 * np.arange(20)
    settings = SETTINGS.model_copy(update={"line_cycles": 12.0})
    assert _spectral_line(time, np.sin(9.0 * time), settings) is None
