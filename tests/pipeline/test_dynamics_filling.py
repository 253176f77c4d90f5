"""Lost stretches of a flight's only IMU are filled by rotational dynamics, against the readings that were taken out."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from edl_filter.navigation.motion_smoother import predict_stretch
from edl_filter.navigation.rotational_dynamics import SIZE, linearise
from edl_filter.pipeline import dynamics_filling
from edl_filter.pipeline.dynamics_filling import path_loads, window_around
from edl_filter.pipeline.forward_model import forward_model_of
from edl_filter.pipeline.reconstruct import FlightInputs, assemble, first_run, reconstruct
from edl_filter.pipeline.redundancy import Run
from edl_filter.telemetry.record import SampleFinding
from edl_filter.telemetry.sample_filling import BY_AUTOREGRESSION, BY_DYNAMICS
from edl_filter.telemetry.sample_repair import repaired

PARACHUTE = 252.75


def with_gap(telemetry, start, length, two=False):
    """Telemetry without the samples of the driving IMU in a stretch, repaired; with one IMU or two."""
    record = telemetry.driving
    lost = (record.time > start) & (record.time <= start + length)
    values = {k: np.where(lost[:, None], np.nan, getattr(record, k)) for k in ("specific_force", "angular_rate")}
    begin = float(record.time[lost][0] - record.interval[lost][0])
    finding = SampleFinding(record.name, "all", begin, float(record.time[lost][-1]), int(lost.sum()), "not_finite")
    checking = telemetry.checking if two else ()
    changed = replace(telemetry, driving=replace(record, **values), checking=checking, findings=(finding,))
    return repaired(changed, parachute=PARACHUTE), lost


def rotation_error(run, truth, lost):
    """Error of the rotation across the stretch (3,), rad, its sigma, and the same of the velocity, m/s."""
    record, step = run.telemetry.driving, truth.interval[lost][0]
    errors, sigmas = [], []
    for values, fill, noise in (
        ("angular_rate", record.rate_fill_sigma, truth.rate_noise),
        ("specific_force", record.force_fill_sigma, truth.force_noise),
    ):
        errors.append(np.sum(getattr(record, values)[lost] - getattr(truth, values)[lost], axis=0) * step)
        sigmas.append(np.sqrt(np.sum(fill[lost] ** 2 + noise[lost, None] ** 2, axis=0)) * step)
    return errors[0], sigmas[0], errors[1], sigmas[1]


@pytest.fixture(scope="module")
def filled(inputs):
    """Runs with three seconds lost at a time, by the autoregression and by dynamics, and the lost samples."""
    mission, telemetry, planet, atmosphere = inputs

    @cache
    def run(start, length=3.0, two=False):
        changed, lost = with_gap(telemetry, start, length, two)
        return first_run(mission, changed, planet, atmosphere, ()), changed, lost

    return run


@pytest.mark.parametrize(
    "start", [pytest.param(88.0, marks=pytest.mark.slow), 118.0, pytest.param(170.0, marks=pytest.mark.slow)]
)
def test_the_rotation_across_a_stretch_is_known_to_a_hundredth_of_a_degree(start, filled, inputs):
    run, before, lost = filled(start)
    truth = inputs[1].driving
    rate, rate_sigma, force, force_sigma = rotation_error(run, truth, lost)
    assert np.all(np.abs(rate) < 4.0 * rate_sigma)
    assert np.all(np.abs(force) < 4.0 * force_sigma)
    assert np.all(np.abs(rate) < np.radians(0.01))
    # the sigma of a sample is at least half of its noise
    lateral = before.driving.rate_fill_sigma[lost][:, 1:]
    assert np.all(run.telemetry.driving.rate_fill_sigma[lost][:, 1:] < 0.7 * lateral)
    assert [f.repair for f in run.telemetry.findings] == [BY_DYNAMICS]


AXIS = np.array([0.0, 1.0, -1.0]) / np.sqrt(2.0)  # oblique to those of the body


def without_axis(record, key, start, end):
    """Change of a record: readings of a triad without those along `AXIS` in a stretch, and which samples these are."""
    lost, values = (record.time > start) & (record.time <= end), getattr(record, key)
    across = values - np.outer(values @ AXIS, AXIS)
    pair = np.stack((across, np.tile(AXIS, (len(record), 1))), axis=1)
    partial = "partial_rate" if key == "angular_rate" else "partial_force"
    return {key: np.where(lost[:, None], np.nan, values), partial: np.where(lost[:, None, None], pair, 0.0)}, lost


@pytest.mark.parametrize(
    ("key", "largest"), [pytest.param("angular_rate", 5e-4, marks=pytest.mark.slow), ("specific_force", 0.03)]
)
def test_axes_that_are_read_are_kept_where_one_axis_is_lost(key, largest, inputs):
    """Of rates of 0.1 rad/s, which the database alone predicts to 0.02 rad/s; of lateral forces."""
    mission, telemetry, planet, atmosphere = inputs
    truth = telemetry.driving
    changed, lost = without_axis(truth, key, 126.5, 131.5)
    channel = "rate x" if key == "angular_rate" else "force x"
    finding = SampleFinding(truth.name, channel, 126.5, 131.5, int(lost.sum()), "stuck")
    gap = replace(telemetry, driving=replace(truth, **changed), checking=(), findings=(finding,))
    run = first_run(mission, repaired(gap, parachute=PARACHUTE), planet, atmosphere, ())
    outcome = run.telemetry.driving
    assert [f.repair for f in run.telemetry.findings] == [BY_DYNAMICS]
    fill, noise = (
        (outcome.rate_fill_sigma, truth.rate_noise)
        if key == "angular_rate"
        else (outcome.force_fill_sigma, truth.force_noise)
    )
    error, sigma = (getattr(outcome, key) - getattr(truth, key))[lost], fill[lost]
    np.testing.assert_allclose(error - np.outer(error @ AXIS, AXIS), 0.0, atol=1e-9)
    total_sigma = np.sqrt(np.sum(sigma**2 + noise[lost, None] ** 2, axis=0))
    assert np.all(np.abs(error.sum(axis=0)) <= 4.0 * total_sigma)
    assert np.abs(error).max() < largest
    other = "specific_force" if key == "angular_rate" else "angular_rate"
    np.testing.assert_array_equal(getattr(outcome, other), getattr(truth, other))


@pytest.mark.slow
def test_axes_that_are_read_within_a_stretch_of_the_other_triad_are_kept(inputs):
    """All rates are lost for longer than one axis of the force."""
    mission, telemetry, planet, atmosphere = inputs
    truth = telemetry.driving
    changed, lost = without_axis(truth, "specific_force", 128.0, 128.375)
    rates = (truth.time > 126.5) & (truth.time <= 131.5)
    changed["angular_rate"] = np.where(rates[:, None], np.nan, truth.angular_rate)
    findings = (
        SampleFinding(truth.name, "rate", 126.5, 131.5, int(rates.sum()), "not_finite"),
        SampleFinding(truth.name, "force x", 128.0, 128.375, int(lost.sum()), "stuck"),
    )
    gap = replace(telemetry, driving=replace(truth, **changed), checking=(), findings=findings)
    outcome = first_run(mission, repaired(gap, parachute=PARACHUTE), planet, atmosphere, ()).telemetry.driving
    error = outcome.specific_force - truth.specific_force
    np.testing.assert_allclose(error - np.outer(error @ AXIS, AXIS), 0.0, atol=1e-9)
    assert np.all(outcome.rate_fill_sigma[rates] > 0.0) and lost.sum() == 3


def test_the_sigmas_of_the_samples_are_those_of_the_prediction(inputs):
    """Independent errors of the filled samples have, with the noise, the variance of the predicted sums."""
    mission, telemetry, planet, atmosphere = inputs
    changed, lost = with_gap(telemetry, 118.0, 3.0)
    result = reconstruct(mission, leave_one_out=False, inputs=FlightInputs(replace(telemetry, checking=()), atmosphere))
    run = Run(changed, assemble(mission, changed, planet, atmosphere, ()), result.filter_pass)
    model = forward_model_of(mission, planet, atmosphere)
    window = window_around(
        changed.findings[0].interpolated[0], changed.driving, run, result.trajectory, model, PARACHUTE - 1.0
    )
    fills, _ = predict_stretch(window)
    driving = changed.driving
    record = dynamics_filling._with_fills(driving, driving, driving, window, fills)
    for column, sigma, noise in (
        (0, record.rate_fill_sigma, record.rate_noise), (3, record.force_fill_sigma, record.force_noise)
    ):  # fmt: skip
        for axis in (1, 2):  # that of roll contains coning
            total = np.sum(sigma[lost, axis] ** 2 + noise[lost] ** 2)
            predicted = fills[column + axis].covariance.sum()
            assert predicted * (1.0 - 1e-6) < total < 1.3 * predicted


def test_samples_outside_the_stretch_stay_as_they_were_read(filled, inputs):
    run, _, lost = filled(118.0)
    for values in ("angular_rate", "specific_force", "time", "interval"):
        read, record = getattr(inputs[1].driving, values), getattr(run.telemetry.driving, values)
        np.testing.assert_array_equal(record[~lost], read[~lost])
    assert not run.telemetry.driving.filled[~lost].any()


def rates_lost(telemetry, start, end, axis=None):
    """Telemetry without the second IMU, with all rates lost in a stretch or with one axis alone, and these samples."""
    truth = telemetry.driving
    lost = (truth.time > start) & (truth.time <= end)
    changed = {"angular_rate": np.where(lost[:, None], np.nan, truth.angular_rate)}
    if axis is not None:
        across = truth.angular_rate - np.outer(truth.angular_rate @ axis, axis)
        pair = np.stack((across, np.tile(axis, (len(truth), 1))), axis=1)
        changed["partial_rate"] = np.where(lost[:, None, None], pair, 0.0)
    finding = SampleFinding(truth.name, "rate" if axis is None else "rate z", start, end, int(lost.sum()), "stuck")
    gap = replace(telemetry, driving=replace(truth, **changed), checking=(), findings=(finding,))
    return repaired(gap, parachute=PARACHUTE), lost


@pytest.mark.parametrize(
    ("axis", "lateral"), [pytest.param(None, [1, 2], marks=pytest.mark.slow), (np.array([0.0, 0.0, 1.0]), [1])]
)
def test_rates_that_are_lost_leave_the_forces_as_they_are_read(axis, lateral, inputs):
    """All gyros, or one along a body axis: angles within five seconds, and the velocity's sigma by their errors."""
    mission, telemetry, planet, atmosphere = inputs
    changed, lost = rates_lost(telemetry, 118.0, 123.0, axis)
    truth, record = telemetry.driving, first_run(mission, changed, planet, atmosphere, ()).telemetry.driving
    np.testing.assert_array_equal(record.specific_force, truth.specific_force)
    error = (record.angular_rate - truth.angular_rate)[lost]
    angles = np.cumsum(error * truth.interval[lost, None], axis=0)
    assert np.abs(angles).max() < np.radians(0.02)
    turned = np.sum(np.cross(angles, truth.specific_force[lost]) * truth.interval[lost, None], axis=0)
    assert np.all((record.force_fill_sigma[lost, 1:] > 0.0) == np.isin([1, 2], lateral))
    sigma = np.sqrt(np.sum((record.force_fill_sigma[lost] * truth.interval[lost, None]) ** 2, axis=0))
    assert np.all(np.abs(turned)[lateral] < 4.0 * sigma[lateral])


@pytest.mark.slow
def test_a_window_has_the_force_where_it_is_read_while_rates_are_lost(inputs):
    """Readings, their axes and the lever arm; a sample whose values do not contain its readings is lost whole."""
    mission, telemetry, planet, atmosphere = inputs
    axis = np.array([0.6, 0.0, 0.8])
    changed, lost = rates_lost(telemetry, 118.0, 123.0, axis)
    base = changed.driving
    place = base.position.copy()
    place[:] = [0.3, -0.4, 0.2]
    base = replace(base, position=place)
    changed = replace(changed, driving=base)
    result = reconstruct(mission, leave_one_out=False, inputs=FlightInputs(changed, atmosphere))
    run = Run(changed, assemble(mission, changed, planet, atmosphere, ()), result.filter_pass)
    model, stretch = forward_model_of(mission, planet, atmosphere), changed.findings[0].interpolated[0]
    around = stretch, base, run, result.trajectory, model, PARACHUTE - 1.0
    window = window_around(*around)
    part = slice(window.first, window.last)
    np.testing.assert_array_equal(window.observed[part], np.tile([False] + [True] * 5, (lost.sum(), 1)))
    assert window.complete.sum() == len(window.observed) - lost.sum()
    np.testing.assert_allclose(window.axes[0, :3], axis)
    np.testing.assert_allclose(window.axes @ window.axes.T, np.eye(6), atol=1e-12)
    np.testing.assert_array_equal(window.axes[3:, 3:], np.eye(3))
    np.testing.assert_array_equal(window.arm[part], place[lost])
    assert not window.arm[: window.first].any() and not window.arm[window.last :].any()
    # sensor errors of the filter's estimate are the rest: biases of the accelerometers
    rest = window.readings[part, 3:] - base.specific_force[lost]
    assert np.abs(rest - rest.mean(axis=0)).max() < 2e-3 * np.abs(base.specific_force[lost]).max()
    read = base.angular_rate[lost] @ window.axes[1:3, :3].T
    np.testing.assert_allclose(window.readings[part, 1:3], read, atol=5e-5)
    other = base.partial_rate.copy()
    other[np.flatnonzero(lost)[3], 0] += 1e-3  # axes that were read, and were not used
    window = window_around(stretch, replace(base, partial_rate=other), *around[2:])
    expected = np.tile([False] + [True] * 5, (lost.sum(), 1))
    expected[3, :3] = False
    np.testing.assert_array_equal(window.observed[part], expected)


def lost_rates_and(telemetry, changes, findings):
    """Telemetry without the second IMU whose driving record has changes and findings, repaired."""
    driving = replace(telemetry.driving, **changes)
    return repaired(replace(telemetry, driving=driving, checking=(), findings=findings), parachute=PARACHUTE)


@pytest.mark.slow
def test_a_triad_of_which_all_axes_are_lost_in_a_part_is_filled_whole(inputs):
    """One oblique axis of the rates is lost for ten seconds, and all axes for one second within."""
    mission, telemetry, planet, atmosphere = inputs
    truth = telemetry.driving
    changed, lost = without_axis(truth, "angular_rate", 118.0, 128.0)
    whole = (truth.time > 121.0) & (truth.time <= 122.0)
    changed["angular_rate"] = np.where(whole[:, None], np.nan, changed["angular_rate"])
    changed["partial_rate"] = np.where(whole[:, None, None], 0.0, changed["partial_rate"])
    findings = (
        SampleFinding(truth.name, "rate x", 118.0, 128.0, int(lost.sum()), "stuck"),
        SampleFinding(truth.name, "rate", 121.0, 122.0, int(whole.sum()), "not_finite"),
    )
    gap = lost_rates_and(telemetry, changed, findings)
    record = first_run(mission, gap, planet, atmosphere, ()).telemetry.driving
    errors = [
        np.abs(np.cumsum((r.angular_rate - truth.angular_rate)[lost] * 0.125, axis=0)).max()
        for r in (record, gap.driving)
    ]
    assert errors[0] < 1e-3 < errors[1]


@pytest.mark.slow
def test_the_sigma_of_a_triad_is_that_of_the_samples_in_which_it_is_lost(inputs):
    """Rates are lost for ten seconds, forces for three samples within: the sigma of their sum is the prediction's."""
    mission, telemetry, planet, atmosphere = inputs
    truth = telemetry.driving
    rates, forces = ((truth.time > a) & (truth.time <= b) for a, b in ((115.0, 125.0), (120.0, 120.375)))
    changed = {
        "angular_rate": np.where(rates[:, None], np.nan, truth.angular_rate),
        "specific_force": np.where(forces[:, None], np.nan, truth.specific_force),
    }
    findings = (
        SampleFinding(truth.name, "rate", 115.0, 125.0, int(rates.sum()), "not_finite"),
        SampleFinding(truth.name, "force", 120.0, 120.375, int(forces.sum()), "not_finite"),
    )
    base = lost_rates_and(telemetry, changed, findings)
    result = reconstruct(mission, leave_one_out=False, inputs=FlightInputs(base, atmosphere))
    run = Run(base, assemble(mission, base, planet, atmosphere, ()), result.filter_pass)
    model = forward_model_of(mission, planet, atmosphere)
    window = window_around((115.0, 125.0), base.driving, run, result.trajectory, model, PARACHUTE - 1.0)
    fills, _ = predict_stretch(window)
    record = dynamics_filling._with_fills(base.driving, base.driving, base.driving, window, fills)
    assert (
        np.flatnonzero(~window.observed[:, 3]).tolist()
        == (np.flatnonzero(forces) - np.argmax(rates) + window.first).tolist()
    )
    bins = ~window.observed[window.first : window.last, 3]
    predicted = fills[3].covariance[np.ix_(bins, bins)].sum()
    total = np.sum(record.force_fill_sigma[forces, 0] ** 2 + truth.force_noise[forces] ** 2)
    assert predicted * (1.0 - 1e-6) < total < 1.3 * predicted


def test_nested_stretches_are_predicted_as_one(inputs, monkeypatch):
    """All rates are lost for ten seconds, and forces for one second within."""
    mission, telemetry, planet, atmosphere = inputs
    truth = telemetry.driving
    rates, forces = ((truth.time > a) & (truth.time <= b) for a, b in ((115.0, 125.0), (120.0, 121.0)))
    changed = {
        "angular_rate": np.where(rates[:, None], np.nan, truth.angular_rate),
        "specific_force": np.where(forces[:, None], np.nan, truth.specific_force),
    }
    findings = (
        SampleFinding(truth.name, "rate", 115.0, 125.0, int(rates.sum()), "not_finite"),
        SampleFinding(truth.name, "force", 120.0, 121.0, int(forces.sum()), "not_finite"),
    )
    spans = []

    def predict(window, _):
        spans.append((window.time[window.first], window.time[window.last]))

    monkeypatch.setattr(dynamics_filling, "predict_stretch", predict)
    first_run(mission, lost_rates_and(telemetry, changed, findings), planet, atmosphere, ())
    assert spans == [(pytest.approx(115.0), pytest.approx(125.0))]


def test_stretches_that_overlap_are_one():
    merged = dynamics_filling._merged({(100.0, 125.0), (111.5, 113.5), (125.0, 126.0), (130.0, 132.0), (131.0, 133.0)})
    assert merged == [(100.0, 125.0), (125.0, 126.0), (130.0, 133.0)]


def test_what_dynamics_have_filled_is_not_filled_again(filled, inputs):
    mission, _, planet, atmosphere = inputs
    run, _, _ = filled(118.0)
    assert first_run(mission, run.telemetry, planet, atmosphere, ()).telemetry is run.telemetry


@pytest.mark.parametrize(("start", "length"), [(118.0, 0.25), (PARACHUTE - 1.5, 1.0), (PARACHUTE - 4.0, 3.5)])
def test_short_stretches_and_those_at_the_parachute_stay_as_the_autoregression_filled_them(start, length, filled):
    run, before, _ = filled(start, length)
    assert run.telemetry is before
    assert [f.repair for f in before.findings] == [BY_AUTOREGRESSION]


def test_a_second_imu_fills_where_it_has_samples(filled):
    run, before, _ = filled(118.0, two=True)
    assert run.telemetry is before
    assert BY_DYNAMICS not in before.findings[0].repair


def test_without_aerodynamics_the_autoregression_fills(inputs):
    mission, telemetry, planet, atmosphere = inputs
    changed, _ = with_gap(telemetry, 118.0, 3.0)
    without = mission.model_copy(update={"aerodynamics": None})
    assert first_run(without, changed, planet, atmosphere, ()).telemetry is changed


@pytest.mark.slow
def test_the_path_after_ten_lost_seconds_is_within_its_sigmas_and_nearer(inputs, monkeypatch):
    mission, telemetry, _, atmosphere = inputs
    changed, _ = with_gap(telemetry, 105.0, 10.0)
    alone = replace(telemetry, checking=())
    results = [reconstruct(mission, leave_one_out=False, inputs=FlightInputs(t, atmosphere)) for t in (alone, changed)]
    monkeypatch.setattr(dynamics_filling, "PASSES", 0)
    results.append(reconstruct(mission, leave_one_out=False, inputs=FlightInputs(changed, atmosphere)))
    states = []
    for result in results:
        node = int(np.argmin([abs(n.time - PARACHUTE) for n in result.filter_pass.nodes]))
        states.append((result.smoothed.states[node].nav[:6], result.smoothed.covariance[node][:6, :6]))
    expected = states[0][0]
    difference = states[1][0] - expected
    assert difference @ np.linalg.solve(states[1][1], difference) / 6.0 < 1.0
    by_autoregression = states[2][0] - expected
    assert np.linalg.norm(difference[3:]) < 0.5 * np.linalg.norm(by_autoregression[3:])


def test_loads_along_the_path_are_those_of_the_forward_model(inputs):
    """A sample's readings of the compiled dynamics at its beginning, against force and moment of the forward model."""
    mission, telemetry, planet, atmosphere = inputs
    model = forward_model_of(mission, planet, atmosphere)
    model = replace(model, body=replace(model.body, offset=np.array([0.0, 0.003, -0.002])))
    reconstruction = reconstruct(mission, leave_one_out=False, inputs=FlightInputs(telemetry, atmosphere))
    path = reconstruction.trajectory
    for time in (90.0, 118.0, 200.0):
        k = int(np.searchsorted(path.time, time))
        short = 1e-5
        twice = [k, k]
        edges = path.time[k] + np.array([0.0, short])
        loads = path_loads(model, edges, path.position[twice], path.velocity[twice], 1)
        state = np.zeros((1, SIZE))
        state[0, :4], state[0, 4:7] = path.inertial_from_body[k], path.angular_rate[k]
        ends, readings, _, _ = linearise(state, loads, np.array([short]), 1)
        at = slice(k, k + 1)
        place = path.time[at], path.position[at], path.velocity[at], path.inertial_from_body[at]
        flow = model.flow(*place, state[:, 4:7])
        force, moment = model.loads(flow)
        # the table of coefficients has a node at each degree
        np.testing.assert_allclose(readings[0, 3:], model.specific_force(flow.time, force)[0], rtol=1e-3, atol=1e-4)
        acceleration = model.angular_acceleration(flow.time, flow.rate, moment)[0]
        np.testing.assert_allclose((ends[0, 4:7] - state[0, 4:7]) / short, acceleration, rtol=2e-3, atol=2e-4)


def test_bins_of_a_window_have_the_means_and_the_noise_of_their_samples(inputs, monkeypatch):
    mission, telemetry, planet, atmosphere = inputs
    changed, lost = with_gap(telemetry, 118.0, 3.0)
    problem = assemble(mission, changed, planet, atmosphere, ())
    result = reconstruct(mission, leave_one_out=False, inputs=FlightInputs(changed, atmosphere))
    run, model = Run(changed, problem, result.filter_pass), forward_model_of(mission, planet, atmosphere)
    stretch = changed.findings[0].interpolated[0]
    windows = []
    for length in (0.125, 0.25):
        monkeypatch.setattr(dynamics_filling, "_BIN", length)
        windows.append(window_around(stretch, changed.driving, run, result.trajectory, model, PARACHUTE - 1.0))
    single, double = windows
    assert single.last - single.first == lost.sum() == 2 * (double.last - double.first)
    fine, coarse = single.readings[single.first :], double.readings[double.first :]
    count = 2 * min(len(fine) // 2, len(coarse))
    np.testing.assert_allclose(coarse[: count // 2], 0.5 * (fine[0:count:2] + fine[1:count:2]), atol=1e-12)
    np.testing.assert_allclose(double.noise[1] * np.sqrt(2.0), single.noise[1], rtol=1e-6)
    for window in windows:
        assert not window.observed[window.first : window.last].any()
        assert window.complete.sum() == len(window.observed) - (window.last - window.first)
        assert window.time[window.first] == pytest.approx(stretch[0], abs=1e-6)
        assert window.time[window.last] == pytest.approx(stretch[1], abs=1e-6)


@pytest.mark.slow
def test_coarse_bins_fill_the_samples_with_the_same_sums(inputs, monkeypatch):
    """Telemetry with more than 20 samples a second is smoothed in bins: here two samples of 8 Hz to a bin."""
    mission, telemetry, planet, atmosphere = inputs
    changed, lost = with_gap(telemetry, 170.0, 3.0)
    sums = []
    for length in (0.125, 0.25):
        monkeypatch.setattr(dynamics_filling, "_BIN", length)
        record = first_run(mission, changed, planet, atmosphere, ()).telemetry.driving
        sums.append(np.concatenate((record.angular_rate[lost].sum(axis=0), record.specific_force[lost].sum(axis=0))))
        sigma = np.sqrt(np.sum(np.hstack((record.rate_fill_sigma, record.force_fill_sigma))[lost] ** 2, axis=0))
    assert np.all(np.abs(sums[1] - sums[0]) < 2.0 * sigma)
