"""Which of two IMUs is at fault where they disagree; a constant error is left to the diagnosis."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from edl_filter.effects.base import EffectInstance
from edl_filter.effects.registry import find_effect
from edl_filter.mission import Mission
from edl_filter.pipeline import load, redundancy
from edl_filter.pipeline.load import read_atmosphere, read_telemetry
from edl_filter.pipeline.reconstruct import FlightInputs, assemble, reconstruct
from edl_filter.pipeline.redundancy import _gain, _hypotheses, _with_adjacent_spikes, undecided
from edl_filter.pipeline.trust import check_record, judge
from edl_filter.telemetry.mer_archive import read_mer_tables
from edl_filter.telemetry.record import SampleFinding
from edl_filter.telemetry.sample_repair import UNDECIDED, repaired

FORCE, RATE = "specific_force", "angular_rate"
PARACHUTE = 252.75


@pytest.fixture(scope="module")
def flight():
    mission = Mission.load("builtin:practice_mer")
    telemetry = read_telemetry(mission)
    return mission, telemetry, mission.planet_model(telemetry.prime_meridian_at_epoch), read_atmosphere(mission)


def faulty(telemetry, name, changes, start=120.0, end=np.inf):
    """Telemetry with changed readings of one IMU from a time on."""

    def changed(record):
        if record.name != name:
            return record
        rows = ((record.time > start) & (record.time <= end))[:, None]
        return replace(
            record, **{k: np.where(rows, f(getattr(record, k)), getattr(record, k)) for k, f in changes.items()}
        )

    checking = tuple(changed(r) for r in telemetry.checking)
    return repaired(replace(telemetry, driving=changed(telemetry.driving), checking=checking), parachute=PARACHUTE)


def checked(flight, telemetry):
    mission, _, planet, atmosphere = flight
    return check_record(mission, telemetry, planet, atmosphere, assemble(mission, telemetry, planet, atmosphere))


def noise(size):
    return lambda v: v + size * np.random.default_rng(0).standard_normal(v.shape)


@pytest.mark.parametrize(
    ("at_fault", "changes", "end"),
    [
        pytest.param("primary", {RATE: lambda v: v * [1.0, -1.0, 1.0]}, np.inf, marks=pytest.mark.slow),
        pytest.param("primary", {FORCE: lambda v: 1.01 * v}, np.inf, marks=pytest.mark.slow),
        ("primary", {RATE: noise(1e-3)}, 130.0),
        ("secondary", {RATE: lambda v: v + np.array([0.0, 1e-3, 0.0])}, np.inf),
    ],
    ids=["sign of a rate axis", "force scale", "noise", "bias of the second"],
)
def test_the_samples_of_the_imu_at_fault_are_replaced(at_fault, changes, end, flight, practice_06):
    mission, telemetry, _, atmosphere = flight
    inputs = FlightInputs(checked(flight, faulty(telemetry, at_fault, changes, end=end)), atmosphere)
    result = reconstruct(mission, leave_one_out=False, inputs=inputs, compare_imus=False)
    findings = [f for f in result.telemetry.findings if f.kind == "disagreement"]
    assert {f.imu for f in findings} == {at_fault} and all("the fault of" in f.repair for f in findings)
    assert len(result.telemetry.checking) == 1
    assert judge(result).trustworthy
    node = int(np.argmin([abs(n.time - PARACHUTE) for n in result.filter_pass.nodes]))
    state, sigma = result.smoothed.states[node].nav[:6], np.sqrt(np.diag(result.smoothed.covariance[node])[:6])
    flawless_node = int(np.argmin([abs(n.time - PARACHUTE) for n in practice_06.filter_pass.nodes]))
    flawless, covariance = (x[flawless_node] for x in (practice_06.smoothed.states, practice_06.smoothed.covariance))
    # the samples of two IMUs have independent noise
    assert np.all(np.abs(state - flawless.nav[:6]) < 3.0 * np.hypot(sigma, np.sqrt(np.diag(covariance)[:6])))


@pytest.mark.slow
def test_an_imu_that_is_separated_later_is_replaced_up_to_there(monkeypatch):
    """Spirit: the backshell's IMU drives up to its separation, the rover's IMU has no second one from there on."""
    mission = Mission.load("builtin:mer_a")
    deployed = 251.1
    complete = reconstruct(mission, leave_one_out=False)

    def read(path, spacecraft):
        tables = read_mer_tables(path, spacecraft)
        velocity = tables.highrate.backshell_velocity_increment.copy()
        velocity[tables.highrate.sclk - load.mer_setup(mission).epoch_sclk > 182.0, 1] *= -1.0
        return replace(tables, highrate=replace(tables.highrate, backshell_velocity_increment=velocity))

    monkeypatch.setattr(load, "read_mer_tables", read)
    result = reconstruct(mission, leave_one_out=False)
    (fault,) = [f for f in result.telemetry.findings if f.kind == "disagreement"]
    assert fault.imu == "driving" and "filled from rover; the fault of driving is shown by" in fault.repair
    assert fault.end == pytest.approx(mission.event_times()["backshell_separation"], abs=0.2)
    assert judge(result).trustworthy
    (state, covariance), (expected, _) = (
        (r.smoothed.states[k].nav[:6], r.smoothed.covariance[k][:6, :6])
        for r in (result, complete)
        for k in [int(np.argmin([abs(n.time - deployed) for n in r.filter_pass.nodes]))]
    )
    difference = state - expected
    assert difference @ np.linalg.solve(covariance, difference) < 20.06  # 99.73 % of chi-square, 6
    assert np.linalg.norm(difference[3:]) < 5.0  # 432 m/s if the rover's samples are replaced


def test_an_imu_that_cannot_be_replaced_is_sound_only_if_the_flight_with_it_is_consistent():
    """Else neither IMU is shown to be at fault."""
    likely, consistent, contradicted = (
        SimpleNamespace(likelihood=value, run=SimpleNamespace(consistent=flag))
        for value, flag in ((-10.0, False), (-40.0, True), (-40.0, False))
    )
    assert _gain(likely, consistent) == 30.0 and _gain(consistent, likely) == -30.0
    assert _gain(None, consistent) == -np.inf and _gain(consistent, None) == np.inf
    assert _gain(None, contradicted) == _gain(contradicted, None) == _gain(None, None) == 0.0


@pytest.mark.parametrize("name", ["primary", pytest.param("secondary", marks=pytest.mark.slow)])
def test_all_samples_of_a_stretch_of_noise_are_replaced(name, flight):
    """Near its end too few of the noisy samples that no test of single samples marks are left for a window."""
    changes = {FORCE: noise(0.9), RATE: noise(6e-3)}
    result = checked(flight, faulty(flight[1], name, changes, start=150.0, end=160.0))
    record = next(r for r in (result.driving, *result.checking) if r.name == name)
    noisy = (record.time > 150.0) & (record.time <= 160.0)
    assert record.force_fill_sigma[noisy].min() > 0.0 and record.rate_fill_sigma[noisy].min() > 0.0
    assert not record.filled[np.abs(record.time - 155.0) > 10.0].any()


@pytest.mark.parametrize(
    ("gain", "error", "consistent", "at_fault"),
    [
        (-60.0, 1e4, (False, False), "primary"),  # an effect that the model lacks contradicts both
        (-60.0, 1e4, (False, True), None),
        (-60.0, 1e4, (True, False), None),
        (60.0, -1e4, (False, False), "secondary"),
        (-60.0, 5.0, (False, False), "secondary"),
        (5.0, 5.0, (False, False), None),
        (60.0, 1e4, (True, False), "primary"),
    ],
)
def test_measurements_that_contradict_both_imus_do_not_contradict_an_error_of_one(
    gain, error, consistent, at_fault, flight, monkeypatch
):
    finding = SampleFinding("primary", "rate", 100.0, 110.0, 80, "disagreement", UNDECIDED)
    telemetry = replace(flight[1], findings=(finding,))
    first = redundancy.Run(telemetry, None, None)
    likelihood = {"primary": gain, "secondary": 0.0}
    runs = dict(zip(likelihood, consistent, strict=True))

    class FakeRun(redundancy.Run):
        consistent = None

    def best(_, name, *__):
        run = FakeRun(telemetry, None, name)
        object.__setattr__(run, "consistent", runs[name])
        return redundancy._Hypothesis(run, likelihood[name])

    monkeypatch.setattr(redundancy, "_best", best)
    monkeypatch.setattr(
        redundancy, "independent_error", lambda *_: {"primary": max(error, 0.0), "secondary": max(-error, 0.0)}
    )
    out = redundancy.arbitrated(
        first, lambda _: pytest.fail("no run is needed"), redundancy.Checks(None, PARACHUTE, True)
    )
    assert (None if out is first else out.filter_pass) == at_fault
    if gain == -60.0 and at_fault == "primary":
        assert "other measurements" not in out.telemetry.findings[0].repair


def test_noise_across_the_parachute_is_replaced(flight):
    """No window of the comparison contains its end: it lasts under the parachute."""
    mission, telemetry, _, atmosphere = flight
    changes = {RATE: noise(1e-3), FORCE: noise(0.15)}
    wrong = FlightInputs(checked(flight, faulty(telemetry, "primary", changes, start=235.0, end=265.0)), atmosphere)
    result = reconstruct(mission, leave_one_out=False, inputs=wrong, compare_imus=False)
    assert {(f.imu, f.kind) for f in result.telemetry.findings if f.samples > 8} >= {("primary", "disagreement")}
    assert not undecided(result.telemetry) and judge(result).trustworthy


def finding(triad, start, end, kind="disagreement"):
    return SampleFinding("primary", triad, start, end, 1, kind)


def test_a_stretch_has_its_spikes_up_to_a_window_away_and_what_is_between():
    stretches = {"force": [(100.0, 110.0), (140.0, np.inf)], "rate": [(100.0, 110.0), (113.0, 116.0)]}
    findings = [
        finding("force", 112.0, 113.0, "spike"),
        finding("force", 117.5, 118.0, "burst"),  # less than a window from the spike before it
        finding("force", 126.0, 127.0, "spike"),
        finding("force", 96.0, 97.0, "spike"),
        finding("rate", 90.0, 92.0, "spike"),
        finding("rate", 121.0, 124.0, "gap"),
        finding("rate y", 119.0, 119.5, "saturated"),
    ]
    expected = {"force": [(96.0, 118.0), (140.0, np.inf)], "rate": [(100.0, 119.5)]}
    assert _with_adjacent_spikes(stretches, findings) == expected


def test_a_stretch_of_one_triad_in_which_the_other_one_has_spikes_is_one_of_both():
    stretches = {"rate": [(100.0, 110.0), (140.0, 150.0)]}
    findings = [finding("force", 108.0, 109.0, "spike"), finding("force", 112.0, 113.0, "spike")]
    expected = {"force": [(100.0, 113.0)], "rate": [(100.0, 110.0), (140.0, 150.0)]}
    assert _with_adjacent_spikes(stretches, findings) == expected
    assert _with_adjacent_spikes(stretches, findings[1:]) == stretches


def test_a_fault_that_begins_in_both_triads_ends_with_the_later_one():
    inside, outside = _hypotheses([finding("force", 176.0, 206.0), finding("rate", 177.0, 252.0)], 0.0, PARACHUTE)
    assert inside == {"force": [(176.0, np.inf)], "rate": [(177.0, np.inf)]}
    assert outside == {"force": [(-np.inf, 181.0)], "rate": [(-np.inf, 182.0)]}


def test_faults_of_different_times_keep_their_ends():
    findings = [finding("force", 100.0, 130.0), finding("rate", 150.0, 160.0)]
    inside, _, onwards = _hypotheses(findings, 0.0, PARACHUTE)
    assert inside == {"force": [(100.0, 130.0)], "rate": [(150.0, 160.0)]}
    assert onwards == {"force": [(100.0, np.inf)], "rate": [(150.0, np.inf)]}


def test_stretches_that_a_common_end_makes_overlap_are_joined():
    findings = [finding("force", 100.0, 110.0), finding("force", 130.0, 140.0), finding("rate", 101.0, 150.0)]
    inside, *_ = _hypotheses(findings, 0.0, PARACHUTE)
    assert inside == {"force": [(100.0, 150.0)], "rate": [(101.0, 150.0)]}


@pytest.mark.parametrize(
    "changes",
    [
        {FORCE: lambda v: v + np.array([0.05, 0.0, 0.0])},
        pytest.param({FORCE: lambda v: 1.01 * v}, marks=pytest.mark.slow),
        pytest.param({RATE: lambda v: v + np.array([0.0, 1e-3, 0.0])}, marks=pytest.mark.slow),
    ],
    ids=["accelerometer bias", "accelerometer scale", "gyro bias"],
)
@pytest.mark.parametrize("name", [pytest.param("primary", marks=pytest.mark.slow), "secondary"])
def test_a_constant_error_is_not_arbitrated(name, changes, flight):
    mission, telemetry, _, atmosphere = flight
    wrong = faulty(telemetry, name, changes, start=-np.inf)
    result = reconstruct(mission, leave_one_out=False, inputs=FlightInputs(wrong, atmosphere), compare_imus=False)
    assert result.telemetry is wrong and result.telemetry.driving.name == "primary"
    assert [f for f in wrong.findings if f.kind == "disagreement"] == []
    # rest contradicts an error of the driving IMU: the result is marked, and the diagnosis names the error
    assert judge(result).trustworthy == (name == "secondary")


def test_imus_between_which_nothing_decides_are_not_trusted(flight, monkeypatch):
    mission, telemetry, _, atmosphere = flight
    finding = SampleFinding("primary", "rate", 100.0, 110.0, 80, "disagreement", UNDECIDED)
    both = replace(telemetry, findings=(finding,))
    result = reconstruct(mission, leave_one_out=False, inputs=FlightInputs(both, atmosphere), compare_imus=False)
    trust = judge(result)
    assert undecided(result.telemetry) == [finding] and result.telemetry.driving.name == "primary"
    assert not trust.trustworthy and "two IMUs disagree in their rate between 100.0 and 110.0 s" in trust.headline
    monkeypatch.setattr(redundancy, "_best", lambda *_: pytest.fail("arbitrated again"))
    bias = EffectInstance(find_effect("accelerometer_bias"), {"bx": 0.01})
    again = reconstruct(mission, (bias,), leave_one_out=False, recover=False, inputs=result.inputs)
    assert undecided(again.telemetry) == [finding]


def test_a_clean_flight_is_not_changed(flight):
    assert checked(flight, flight[1]) is flight[1]


def test_further_reconstructions_have_the_readings_of_the_first(flight, monkeypatch):
    """A diagnosis compares hypotheses: the samples of an IMU at fault are replaced once, and not for some of them."""
    mission, telemetry, *_ = flight
    wrong = faulty(telemetry, "primary", {RATE: noise(1e-3)}, end=130.0)
    first = reconstruct(mission, (), leave_one_out=False, recover=False, inputs=FlightInputs(wrong))
    assert not undecided(first.telemetry) and first.telemetry.driving is not wrong.driving
    monkeypatch.setattr(redundancy, "_best", lambda *_: pytest.fail("arbitrated again"))
    bias = EffectInstance(find_effect("accelerometer_bias"), {"bx": 0.01})
    again = reconstruct(mission, (bias,), leave_one_out=False, recover=False, inputs=first.inputs)
    assert again.telemetry is first.telemetry
