from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from scipy.stats import chi2, kstest

from edl_filter.mission import Mission
from edl_filter.pipeline.load import read_telemetry
from edl_filter.pipeline.reconstruct import reconstruct
from edl_filter.telemetry import rest_drift as module
from edl_filter.telemetry.flight_file import read_flight_file
from edl_filter.telemetry.rest_drift import drift_at_rest, with_rest_drift
from edl_filter.telemetry.sample_repair import repaired

INTERVAL, NOISE, START = 0.125, 3e-3, 100.0
#: Rate of the planet and specific force at rest, body axes.
PLANET, SUPPORT = np.array([2e-5, -5.8e-5, 3.4e-5]), np.array([-3.71, -0.07, -0.08])


@pytest.fixture(scope="module")
def clean(builtin_flight):
    return read_flight_file(builtin_flight)


def at_rest(imu, seed, direction_held=False, slope=(0.0, 0.0, 0.0), seconds=20.0, noise=NOISE):
    """A record of a vehicle that rests from `START` on, with the constants of another one."""
    random = np.random.default_rng(seed)
    count = int(seconds / INTERVAL) + 40
    time = START + INTERVAL * (np.arange(count) - 39)
    elapsed = np.maximum(time - 0.5 * INTERVAL - START, 0.0)[:, None]
    force = SUPPORT + elapsed * np.array(slope)
    if direction_held:
        force = Rotation.from_rotvec(-elapsed * PLANET).apply(force)
    force[time <= START] = [-60.0, 3.0, 2.0]
    full = {"time": time, "interval": np.full(count, INTERVAL)}
    full["specific_force"] = force + noise * random.standard_normal((count, 3))
    full["angular_rate"] = PLANET + 2e-5 * random.standard_normal((count, 3))
    full |= {key: np.full(count, noise) for key in ("force_noise",)}
    full |= {key: np.full(count, 2e-5) for key in ("rate_noise", "shared_rate_noise")}
    full |= {key: np.zeros(count, bool) for key in ("coning_corrected", "sculling_corrected")}
    full |= {key: np.zeros(count, int) for key in ("unit", "source")}
    full |= {key: np.zeros((count, 3)) for key in ("position", "force_fill_sigma", "rate_fill_sigma")}
    full |= {key: np.zeros((count, 2, 3)) for key in ("partial_force", "partial_rate")}
    return replace(imu, **full)


def test_the_slope_is_that_of_a_line_fitted_to_each_imu_weighted_with_its_variance(clean):
    records = [at_rest(clean.driving, 1, slope=(0.0, 1e-3, 0.0)), at_rest(clean.driving, 2, noise=2.0 * NOISE)]
    records[1] = replace(records[1], specific_force=records[1].specific_force + np.array([0.01, -0.02, 0.03]))
    slopes, weights = [], []
    for record in records:
        rows = record.time > START + 1e-9
        fits = [np.polyfit(record.time[rows], column[rows], 1, cov="unscaled") for column in record.specific_force.T]
        scatter = [
            np.sum((column[rows] - np.polyval(fit, record.time[rows])) ** 2) / (rows.sum() - 2)
            for column, (fit, _) in zip(record.specific_force.T, fits, strict=True)
        ]
        slopes.append([fit[0] for fit, _ in fits])
        noise = [
            max(record.force_noise[0], 1.4826 * np.median(np.abs(np.diff(column[rows]))) / np.sqrt(2.0)) ** 2
            for column in record.specific_force.T
        ]
        scatter = np.maximum(scatter, noise)
        variance = [s * cov[0, 0] for s, (_, cov) in zip(scatter, fits, strict=True)]
        weights.append(1.0 / np.array(variance))
    expected = np.sum(np.array(slopes) * weights, axis=0) / np.sum(weights, axis=0)
    drift = drift_at_rest(records, START)
    assert np.allclose(drift.slope, expected, rtol=1e-7, atol=1e-12)
    assert np.allclose(drift.sigma, 1.0 / np.sqrt(np.sum(weights, axis=0)), rtol=1e-7)
    assert (drift.start, drift.end) == (START, records[0].time[-1]) and not drift.held_in_inertial_axes
    assert drift.change == pytest.approx(np.linalg.norm(expected) * (drift.end - START))
    along = abs(drift.slope @ SUPPORT) / np.linalg.norm(SUPPORT)
    across = np.sqrt(np.linalg.norm(drift.slope) ** 2 - along**2)
    half = 0.5 * (drift.end - drift.start)
    assert np.allclose(drift.mean_sigma, (half * along, half * across), rtol=0.02, atol=1e-5)


def noise_free(imu, slope, rate=(0.0, 0.0, 0.0)):
    """A record at rest whose force is a line, with a constant rate and the stated noise but without noise."""
    record = at_rest(imu, 0, slope=slope)
    rows = record.time > START
    elapsed = np.where(rows, record.time - 0.5 * INTERVAL - START, 0.0)[:, None]
    force = np.where(rows[:, None], SUPPORT + elapsed * np.array(slope), record.specific_force)
    return replace(record, specific_force=force, angular_rate=np.tile(np.array(rate), (len(rows), 1)))


def slope_sigma(record):
    """Sigma of the slope of one axis, of a line through readings with the stated noise."""
    time = record.time[record.time > START]
    return NOISE / np.sqrt(np.sum((time - time.mean()) ** 2))


@pytest.mark.parametrize(("square", "named"), [(20.0, False), (22.0, True)])
def test_a_slope_is_a_drift_beyond_the_quantile_of_three_axes(clean, square, named):
    """1e-4 of the slopes by chance are beyond 21.1; of two axes they would be beyond 18.4."""
    size = np.sqrt(square) * slope_sigma(noise_free(clean.driving, (0.0, 0.0, 0.0)))
    drift = drift_at_rest([noise_free(clean.driving, size * np.array([2.0, -1.0, 2.0]) / 3.0)], START)
    assert (drift is not None) == named
    if drift is not None:
        assert drift.change / drift.change_sigma == pytest.approx(np.sqrt(square), rel=1e-6)


def test_the_sigma_of_a_change_is_that_along_the_change():
    drift = module.RestDrift(100.0, 120.0, np.array([0.0, 3e-4, 4e-4]), np.array([9.0, 1e-4, 2e-4]), SUPPORT, False)
    assert drift.change == pytest.approx(0.01)
    assert drift.change_sigma == pytest.approx(20.0 * np.hypot(0.6e-4, 1.6e-4))


@pytest.mark.parametrize(("square", "held"), [(10.5, True), (12.0, False)])
def test_a_direction_is_held_within_the_quantile_of_three_axes(clean, square, held):
    """One in a hundred differs from it by more than 11.3, with two axes by more than 9.2."""
    sigma = slope_sigma(noise_free(clean.driving, (0.0, 0.0, 0.0)))
    rate = np.array([0.0, 1e-4, 0.0])
    along_vertical = np.sqrt(square) * sigma * SUPPORT / np.linalg.norm(SUPPORT)
    # the turn is that of the mean force, which the slope changes by a thousandth
    slope = -np.cross(rate, SUPPORT) + along_vertical
    assert drift_at_rest([noise_free(clean.driving, slope, rate)], START).held_in_inertial_axes == held


def test_the_variance_of_white_noise_follows_from_neighbours(clean):
    """Also in a force that changes slowly, as a slope does."""
    noise = np.random.default_rng(8).standard_normal((20000, 3)) * np.array([1.0, 2.0, 5.0])
    variance = module._noise_variance(noise + np.linspace(0.0, 100.0, 20000)[:, None])
    np.testing.assert_allclose(variance, [1.0, 4.0, 25.0], rtol=0.05)


def test_a_direction_that_is_held_in_inertial_axes_is_recognised(clean):
    records = [at_rest(clean.driving, seed, direction_held=True) for seed in (1, 2)]
    drift = drift_at_rest(records, START)
    assert drift.held_in_inertial_axes
    assert np.all(np.abs(drift.slope + np.cross(PLANET, SUPPORT)) < 4.0 * drift.sigma)
    # the mean over the window is off by half of the turn
    off = np.linalg.norm(np.cross(PLANET, SUPPORT)) * 10.0
    assert drift.mean_sigma == (0.0, pytest.approx(off, rel=0.25))


def test_a_constant_force_has_a_slope_by_chance_only(clean, monkeypatch):
    monkeypatch.setattr(module, "FALSE_ALARM", 1.0)  # every slope is returned
    drifts = [drift_at_rest([at_rest(clean.driving, seed)], START) for seed in range(300)]
    squares = [float(np.sum((d.slope / d.sigma) ** 2)) for d in drifts]
    assert kstest(squares, chi2(3).cdf).pvalue > 1e-3
    # the larger of stated noise and scatter is used: the test is slightly conservative
    assert 2.0 < np.mean(squares) < 3.0 + 4.0 * np.sqrt(6.0 / 300)


@settings(max_examples=25, deadline=None)
@given(
    bias=st.tuples(*[st.floats(-0.05, 0.05)] * 3),
    turn=st.tuples(*[st.floats(-3.0, 3.0)] * 3),
)
def test_neither_a_bias_nor_the_axes_change_the_drift(clean, bias, turn):
    record = at_rest(clean.driving, 5, direction_held=True)
    second = at_rest(clean.driving, 6, direction_held=True)
    axes = Rotation.from_rotvec(turn)
    changed = [
        replace(
            r, specific_force=axes.apply(r.specific_force + np.array(bias)), angular_rate=axes.apply(r.angular_rate)
        )
        for r in (record, second)
    ]
    before, after = drift_at_rest([record, second], START), drift_at_rest(changed, START)
    # the scatter of each axis differs by chance, and with it the weights
    assert np.allclose(after.slope, axes.apply(before.slope), atol=0.5 * float(before.sigma.max()))
    assert after.change == pytest.approx(before.change, rel=0.1)


def test_lost_and_filled_samples_are_not_used(clean):
    record = at_rest(clean.driving, 3, slope=(0.0, 1e-3, 0.0))
    force, fill = record.specific_force.copy(), record.force_fill_sigma.copy()
    force[60:80] += 5.0
    fill[60:80] = 1.0
    force[90:100] = np.nan
    read = np.ones(len(record), bool)
    read[60:80] = read[90:100] = False
    drift = drift_at_rest([replace(record, specific_force=force, force_fill_sigma=fill)], START)
    expected = drift_at_rest([record.select(read)], START)
    assert np.array_equal(drift.slope, expected.slope) and np.array_equal(drift.sigma, expected.sigma)


def test_an_imu_without_a_stated_noise_is_not_used(clean):
    """Readings without noise have a slope of zero or of rounding, with a sigma of zero."""
    exact, drifting = at_rest(clean.driving, 1, noise=0.0), at_rest(clean.driving, 2, slope=(0.0, 1e-3, 0.0))
    assert drift_at_rest([exact], START) is None
    both, alone = drift_at_rest([exact, drifting], START), drift_at_rest([drifting], START)
    assert np.array_equal(both.slope, alone.slope) and np.isfinite(both.sigma).all()


@pytest.mark.parametrize("seconds", [0.0, 1.75])
def test_too_few_samples_at_rest_have_no_slope(clean, seconds):
    assert drift_at_rest([at_rest(clean.driving, 3, slope=(0.0, 1.0, 0.0), seconds=seconds)], START) is None


def test_impacts_of_a_wrong_landing_time_do_not_enlarge_the_sigma(clean):
    """With a time of rest that is too early the mean force is wrong: that must contradict gravity, not widen it."""
    record = at_rest(clean.driving, 4)
    for samples in range(1, 39):
        assert drift_at_rest([record], START - samples * INTERVAL) is None


def test_the_finding_says_what_was_found_and_the_sigma_follows(clean):
    landing = replace(clean.landing, time=START)
    records = [at_rest(r, seed, direction_held=True) for seed, r in enumerate((clean.driving, *clean.checking))]
    telemetry = replace(clean, driving=records[0], checking=tuple(records[1:]), landing=landing)
    outcome = with_rest_drift(telemetry)
    (finding,) = outcome.findings
    drift = drift_at_rest(records, START)
    assert outcome.rest_force_sigma == drift.mean_sigma > (-1.0, 1e-3)
    assert (finding.kind, finding.channel, finding.start, finding.samples) == ("rest_drift", "force", START, 160)
    assert "held in inertial axes" in finding.repair
    assert f"changes by {1e3 * drift.change:.1f} ± {1e3 * drift.change_sigma:.1f} mm/s²" in finding.repair
    assert finding.repair.endswith(f"a sigma of {1e3 * drift.mean_sigma[1]:.1f} mm/s² horizontally")
    moving = [at_rest(r, seed, slope=(0.0, 0.0, 2e-3)) for seed, r in enumerate((clean.driving, *clean.checking))]
    outcome = with_rest_drift(replace(telemetry, driving=moving[0], checking=tuple(moving[1:])))
    assert "the vehicle moves, or its accelerometers drift" in outcome.findings[0].repair
    assert f"a sigma of {1e3 * outcome.rest_force_sigma[0]:.1f} mm/s² vertically and " in outcome.findings[0].repair
    assert with_rest_drift(replace(telemetry, landing=None)).findings == ()


def test_telemetry_without_a_drift_is_returned_as_it_is(clean):
    records = [at_rest(r, seed) for seed, r in enumerate((clean.driving, *clean.checking))]
    landing = replace(clean.landing, time=START)
    telemetry = replace(clean, driving=records[0], checking=tuple(records[1:]), landing=landing)
    assert with_rest_drift(telemetry) is telemetry


def test_a_repair_keeps_the_finding_and_has_nothing_to_repair(clean):
    telemetry = with_rest_drift(clean)
    assert repaired(telemetry, parachute=250.0) is telemetry
    lost = telemetry.driving.specific_force.copy()
    lost[800:802] = np.nan
    damaged = replace(telemetry, driving=replace(telemetry.driving, specific_force=lost))
    outcome = repaired(damaged, parachute=250.0)
    assert outcome.findings == telemetry.findings and outcome.rest_force_sigma == telemetry.rest_force_sigma


def test_a_mission_without_checks_of_samples_has_no_drift(clean):
    off = read_telemetry(Mission.load("builtin:practice_mer", ["sample_checks.enabled=false"]))
    assert off.findings == () and off.rest_force_sigma == (0.0, 0.0)


def test_the_force_at_rest_of_the_practice_flights_does_not_turn_with_the_planet(practice):
    """Independent of any filter: the force drifts as ``-ω × f``, and without that drift gravity at rest agrees."""
    mission = Mission.load("builtin:practice_mer", [f"telemetry.path={practice(6)}"])
    telemetry = read_telemetry(mission)
    (finding,) = telemetry.findings
    assert finding.kind == "rest_drift" and "held in inertial axes" in finding.repair
    along, across = telemetry.rest_force_sigma
    turn = 0.5 * 7.088218e-5 * (finding.end - finding.start) * 3.71
    assert along == 0.0 and 0.6 * turn < across < turn * 1.4
    gravity = next(c for c in reconstruct(mission).problem.constraints if c.name == "rest_gravity")
    up = Rotation.from_rotvec([0.0, 0.0, 7.088218e-5 * gravity.time + telemetry.prime_meridian_at_epoch]).apply(
        telemetry.landing.position
    )
    up /= np.linalg.norm(up)
    east = np.cross([0.0, 0.0, 1.0], up) / np.hypot(up[0], up[1])
    stated = 5e-4 / gravity.duration
    assert np.sqrt(east @ gravity.noise @ east) == pytest.approx(np.hypot(across, stated))
    assert np.sqrt(up @ gravity.noise @ up) == pytest.approx(stated, abs=0.01 * across)  # the vertical is not radial
