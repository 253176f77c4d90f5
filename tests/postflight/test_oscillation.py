"""Stiffness and damping by window: closed forms, sigmas, the damping of the practice flights and of the rovers."""

import json

import numpy as np
import pytest

from edl_filter.mission import Mission
from edl_filter.pipeline.forward_model import damping_of
from edl_filter.pipeline.reconstruct import reconstruct
from edl_filter.postflight.oscillation import oscillation
from edl_filter.results import Result

D, INERTIA, SPEED = 2.65, 300.0, 1500.0
STIFF, DAMPING = -0.09, 0.4


def swing(noise=None, slow=1e-3, frequency=0.5, end=24.0, dt=0.125, size=0.04):
    """Two planes that oscillate with a phase shift, moments of known slope and damping, and slow body-fixed moments."""
    t = np.arange(0.0, end, dt)
    w = 2.0 * np.pi * frequency
    angles = size * np.column_stack((np.sin(w * t), 0.6 * np.cos(w * t + 0.4)))
    # in small angles the pitch rate raises alpha, the yaw rate (nose right) lowers beta
    rates = size * w * np.column_stack((np.cos(w * t), 0.6 * np.sin(w * t + 0.4)))
    moments = STIFF * angles * (1.0, -1.0) + DAMPING * rates * D / (2.0 * SPEED)
    moments = moments + slow * np.column_stack((1.0 + 0.02 * t, -0.5 + 0.001 * t**2))
    if noise is not None:
        moments = moments + noise
    flat = np.ones(len(t))
    load = (w**2 / -STIFF) * INERTIA / (np.pi / 4.0 * D**3)  # so that the motion is consistent with the moments
    return oscillation(t, angles, rates, moments, SPEED * flat, load * flat, D, INERTIA)


def test_known_slope_and_damping_come_back_whatever_slow_torque_is_there():
    for slow in (0.0, 1e-3, 1e-2):
        rows = swing(slow=slow)
        np.testing.assert_allclose(rows.stiffness, STIFF, rtol=1e-6)
        np.testing.assert_allclose(rows.damping, DAMPING, rtol=1e-6)
    assert len(rows.time) == 4 and rows.time[0] == 4.0


def test_growth_is_that_of_the_equation_of_motion():
    """The amplitude of an oscillator with that damping grows at the rate `growth`."""
    rows = swing()
    w, growth = np.pi, rows.growth[0]
    # theta'' = 2 growth theta' - w^2 theta, over ten periods
    decay = np.array([[0.0, 1.0], [-(w**2), 2.0 * growth]])
    values, vectors = np.linalg.eig(decay)
    after = (vectors @ np.diag(np.exp(values * 20.0)) @ np.linalg.inv(vectors)).real
    load = (w**2 / -STIFF) * D / (2.0 * SPEED)
    assert 2.0 * growth == pytest.approx(DAMPING * load, rel=1e-6)
    assert np.log(abs(after[0, 0])) / 20.0 == pytest.approx(growth, abs=2e-3)


def test_sigmas_are_those_of_the_scatter_though_noise_is_correlated():
    rng = np.random.default_rng(3)
    scaled = []
    for _ in range(150):
        white = rng.standard_normal((192 + 50, 2))
        noise = np.zeros_like(white)
        for k in range(1, len(white)):
            noise[k] = 0.7 * noise[k - 1] + white[k]
        rows = swing(noise=1e-4 * noise[50:])
        scaled.append((rows.damping - DAMPING) / rows.damping_sigma)
    assert 0.9 < np.std(scaled) < 1.2
    assert abs(np.mean(scaled)) < 0.15


def test_too_few_swings_or_samples_are_not_judged():
    assert np.isnan(swing(frequency=0.15).damping).all()
    assert np.isnan(swing(size=0.0).damping).all()  # nothing swings
    assert np.isnan(swing(dt=1.0).damping).all()
    assert len(swing(end=6.0).time) == 0


def _against_truth(reconstruction, added=0.0):
    """Error of the damping and its sigma, where Mach is between 2.1 and 5, without windows over a step."""
    tree = Result(reconstruction).to_xarray()
    rows, path = tree["postflight/oscillation"].dataset, tree["trajectory"].dataset
    mach = np.interp(rows["time"], path["time"], path["mach"])
    truth = damping_of(reconstruction.mission).at(mach) + np.where(mach < 3.5, added, 0.0)
    part = (mach > 2.1) & (mach < 5.0) & (np.abs(mach - 3.5) > (0.35 if added else 0.0))
    value, sigma = rows["damping"].values[part], rows["damping_sigma"].values[part]
    assert len(value) >= 8
    return value - truth[part], sigma


def _agrees(error, sigma):
    assert np.abs(error).max() < 0.01
    assert np.sqrt(np.mean((error / sigma) ** 2)) < 1.3


def test_a_clean_flight_has_the_damping_of_its_table(practice_06):
    _agrees(*_against_truth(practice_06))


def test_a_hidden_damping_is_measured(practice):
    flight = reconstruct(Mission.load("builtin:practice_phoenix", [f"telemetry.path={practice(5)}"]))
    answers = json.loads(practice(5).with_name("answers.json").read_text())
    _agrees(*_against_truth(flight, answers["practice_05"]["sizes"]["pitch_damping"]["cmq"]))


def test_the_rovers_oscillations_are_fed_when_the_blanket_was_seen(spirit, opportunity):
    """Tolson (AAS 06-087): from Mach 6 on Spirit, right after peak pressure on Opportunity."""
    for flight, fed, quiet in ((spirit, (183.0, 191.0), (208.0, 240.0)), (opportunity, (131.0, 143.0), (160.0, 200.0))):
        rows = Result(flight).to_xarray()["postflight/oscillation"].dataset

        def part(span, rows=rows):
            time = rows["time"].values
            inside = (time > span[0]) & (time < span[1])
            return rows["growth"].values[inside], rows["growth_sigma"].values[inside]

        growth, sigma = part(fed)
        assert len(growth) >= 2 and np.all(growth > 2.0 * sigma) and growth.mean() > 0.05
        growth, sigma = part(quiet)
        assert len(growth) >= 8 and np.all(np.abs(growth) < 0.025)
