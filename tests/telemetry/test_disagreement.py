"""Two IMUs that differ by more than constant errors explain: found, and nothing is found where they do not."""

import warnings
from dataclasses import replace

import numpy as np
import pytest

from edl_filter.effects.sensors import delayed
from edl_filter.mission import Mission
from edl_filter.pipeline.load import read_telemetry
from edl_filter.simulation import Scenario, simulate
from edl_filter.telemetry.disagreement import _in_windows, disagreements, independent_error
from edl_filter.telemetry.flight_file import read_flight_file
from edl_filter.telemetry.parity import pair_of, parity_of
from edl_filter.telemetry.record import SampleFinding
from edl_filter.telemetry.sample_checks import CheckSettings
from edl_filter.telemetry.sample_repair import UNDECIDED, repaired, without_samples

FORCE, RATE = "specific_force", "angular_rate"
PARACHUTE = 252.75
END = PARACHUTE - 1.0
PROBABILITY = CheckSettings().false_alarm_probability


@pytest.fixture(scope="module")
def telemetry(builtin_flight):
    return read_flight_file(builtin_flight)


def with_change(record, key, change, start=-np.inf, end=np.inf):
    values = getattr(record, key).copy()
    rows = (record.time > start) & (record.time <= end)
    values[rows] = change(values[rows])
    return replace(record, **{key: values})


def noise(size):
    return lambda v: v + size * np.random.default_rng(0).standard_normal(v.shape)


FAULTS = {
    "sign of a force axis": (FORCE, lambda v: v * [-1.0, 1.0, 1.0], "force"),
    "sign of a rate axis": (RATE, lambda v: v * [1.0, -1.0, 1.0], "rate"),
    "exchanged rate axes": (RATE, lambda v: v[:, [1, 0, 2]], "rate"),
    "force scale": (FORCE, lambda v: 1.01 * v, "force"),
    "rate scale": (RATE, lambda v: 1.01 * v, "rate"),
    "force bias": (FORCE, lambda v: v + np.array([0.0, 0.1, 0.0]), "force"),
    "rate bias": (RATE, lambda v: v + np.array([0.0, 1e-3, 0.0]), "rate"),
    "force ramp": (FORCE, lambda v: v + np.linspace(0.0, 0.2, len(v))[:, None] * [1.0, 0.0, 0.0], "force"),
    "late rates": (RATE, lambda v: np.roll(v, 3, axis=0), "rate"),
}


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.slow) if name == "force scale" else name for name in FAULTS]
)
@pytest.mark.parametrize("at_fault", [0, 1])
def test_a_change_in_flight_is_detected_in_either_imu(name, at_fault, telemetry):
    key, change, channel = FAULTS[name]
    records = [telemetry.driving, telemetry.checking[0]]
    records[at_fault] = with_change(records[at_fault], key, change, start=120.0)
    findings = disagreements(*records, END, PROBABILITY)
    assert channel in {f.channel for f in findings} and {f.kind for f in findings} == {"disagreement"}


@pytest.mark.parametrize("size", [1.5e-4, 3e-4])
@pytest.mark.parametrize("at_fault", [0, 1])
def test_a_rate_bias_below_the_noise_is_found_in_the_mean_of_its_window(size, at_fault, telemetry):
    """For 100 s, 5 and 11 sigmas of the parity's noise, which the regression halves; the median has a limit of 6."""
    records = [telemetry.driving, telemetry.checking[0]]
    bias = np.array([0.0, size, 0.0])
    records[at_fault] = with_change(records[at_fault], RATE, lambda v: v + bias, start=100.0, end=200.0)
    (finding,) = disagreements(*records, END, PROBABILITY)
    assert (finding.channel, finding.kind) == ("rate", "disagreement")
    assert finding.start == pytest.approx(100.0, abs=12.0) and finding.end == pytest.approx(200.0, abs=12.0)


def test_the_mean_of_the_parity_has_the_errors_that_vary_and_not_the_noise(telemetry):
    """Of sound records the squared mean is below its limit by far, and above it with ten sigmas of a bias in a half."""
    pair = pair_of(telemetry.driving, telemetry.checking[0], END)
    assert not _in_windows(parity_of(pair, "rate", pair.usable, 0.0), pair, PROBABILITY).any()
    late = pair.reference.time > 150.0
    for key in ("noise", "varying"):
        parity = parity_of(pair, "rate", pair.usable, 0.0)
        shift = np.where(late[:, None], 10.0, 0.0) * np.sqrt(np.nanmedian(getattr(parity, key), axis=0))
        shifted = replace(parity, value=parity.value + shift)
        significant = _in_windows(shifted, pair, PROBABILITY)
        assert significant[late & pair.usable].all() and not significant[pair.reference.time < 130.0].any()


@pytest.mark.parametrize(("gyro", "accelerometer"), [(3e-4, 0.0), (1e-3, 0.03)])
def test_noise_that_is_stated_is_no_disagreement(gyro, accelerometer, telemetry):
    """Ten times the shipped one, and more: noise of a regressor biases its coefficient."""
    for seed in range(3):
        rng = np.random.default_rng(seed)
        noisy = [
            replace(
                r,
                angular_rate=r.angular_rate + gyro * rng.standard_normal(r.angular_rate.shape),
                specific_force=r.specific_force + accelerometer * rng.standard_normal(r.angular_rate.shape),
                rate_noise=np.hypot(r.rate_noise, gyro),
                force_noise=np.hypot(r.force_noise, accelerometer),
            )
            for r in (telemetry.driving, telemetry.checking[0])
        ]
        assert disagreements(*noisy, END, PROBABILITY) == []


@pytest.mark.parametrize(("seed", "offset"), [(1, -0.04), (3, 0.04)])
def test_an_oscillation_that_the_samples_do_not_resolve_is_no_disagreement(seed, offset, tmp_path):
    """A centre of mass 40 mm off the axis: at 1.2 Hz an interpolated lever-arm acceleration errs by 9 sigmas of noise.

    The samples about the peak of the deceleration do not determine the constant errors that all others are judged by.
    """
    scenario = Scenario.load("builtin:mer", [f"effects=[{{name: com_offset, parameters: {{dz: {offset}}}}}]"])
    flight = simulate(scenario, seed=seed)
    telemetry = read_flight_file(flight.write(tmp_path / "flight.h5"))
    end = flight.motion.deployed - 1.0
    assert disagreements(telemetry.driving, telemetry.checking[0], end, PROBABILITY) == []


def test_delays_are_not_compared_over_a_small_part_of_the_flight(telemetry):
    """Before the air decelerates the vehicle, the forces do not determine one; in the whole flight they do."""
    late = replace(telemetry.driving, angular_rate=delayed(telemetry.driving.time, telemetry.driving.angular_rate, 0.1))
    short = telemetry.checking[0].between(0.0, 60.0)
    assert disagreements(late, short, END, PROBABILITY) == []
    assert [f.kind for f in disagreements(late, telemetry.checking[0], END, PROBABILITY)] == ["delay"]


CONSTANT = {
    "accelerometer bias": (FORCE, lambda v: v + np.array([0.3, -0.2, 0.5])),
    "accelerometer scale": (FORCE, lambda v: v * [1.05, 0.95, 1.02]),
    "accelerometer misalignment": (FORCE, lambda v: v + np.cross(v, [0.03, -0.02, 0.05])),
    "gyro bias": (RATE, lambda v: v + np.array([1e-2, 0.0, 1e-2])),
    "gyro scale": (RATE, lambda v: v * [1.05, 1.0, 0.97]),
    "gyro misalignment": (RATE, lambda v: v + np.cross(v, [0.03, -0.02, 0.05])),
    "sign of a rate axis": (RATE, lambda v: v * [1.0, -1.0, 1.0]),
}


@pytest.mark.parametrize("name", CONSTANT)
@pytest.mark.parametrize("with_error", [0, 1])
def test_a_constant_error_is_no_disagreement(name, with_error, telemetry):
    records = [telemetry.driving, telemetry.checking[0]]
    records[with_error] = with_change(records[with_error], *CONSTANT[name])
    assert disagreements(*records, END, PROBABILITY) == []


@pytest.mark.parametrize("delay", [-0.3, 0.02, 0.3])
@pytest.mark.parametrize("with_error", [0, 1])
def test_a_constant_delay_is_no_disagreement(delay, with_error, telemetry):
    records = [telemetry.driving, telemetry.checking[0]]
    records[with_error] = replace(records[with_error], time=records[with_error].time + delay)
    assert disagreements(*records, END, PROBABILITY) == []


@pytest.mark.parametrize("with_error", [0, 1])
def test_lost_samples_of_an_imu_with_another_clock_are_no_disagreement(with_error, telemetry):
    """A spline that took a lost reading for zero would oscillate over ten samples on either side of it."""
    records = [telemetry.driving, telemetry.checking[0]]
    lost = np.random.default_rng(1).uniform(size=(len(records[with_error]), 1)) < 0.02
    force, rate = (np.where(lost, np.nan, getattr(records[with_error], key)) for key in (FORCE, RATE))
    records[with_error] = replace(
        records[with_error], specific_force=force, angular_rate=rate, time=records[with_error].time + 0.05
    )
    assert disagreements(*records, END, PROBABILITY) == []


@pytest.mark.parametrize("delay", [-0.4, 0.1])
@pytest.mark.parametrize("with_error", [0, 1])
def test_gyros_that_are_late_against_the_accelerometers_have_a_delay_and_are_no_disagreement(
    delay, with_error, telemetry
):
    records = [telemetry.driving, telemetry.checking[0]]
    late = delayed(records[with_error].time, records[with_error].angular_rate, delay)
    records[with_error] = replace(records[with_error], angular_rate=late)
    (finding,) = disagreements(*records, END, PROBABILITY)
    side = "later" if (delay > 0.0) == bool(with_error) else "earlier"
    assert finding.kind == "delay" and f"and the rate {abs(delay):.3f} s {side} than primary" in finding.repair
    assert (finding.imu, finding.samples) == ("primary", 0) and finding.end == pytest.approx(END, abs=0.2)


@pytest.mark.parametrize(("delay", "kinds"), [(-0.02, ["delay"]), (0.02, ["delay"]), (0.008, [])])
def test_forces_with_a_delay_of_their_own_are_found_from_a_tenth_of_a_sample_on(delay, kinds, telemetry):
    """0.125 s a sample."""
    first, second = telemetry.driving, telemetry.checking[0]
    late = replace(second, specific_force=delayed(second.time, second.specific_force, delay))
    assert [f.kind for f in disagreements(first, late, END, PROBABILITY)] == kinds


def test_another_lever_arm_is_no_disagreement(telemetry):
    moved = replace(telemetry.driving, position=telemetry.driving.position + np.array([0.5, -0.5, 0.5]))
    assert disagreements(moved, telemetry.checking[0], END, PROBABILITY) == []


@pytest.mark.parametrize("rover", ["mer_a", "mer_b"])
def test_the_imus_of_the_rovers_agree(rover):
    rovers = read_telemetry(Mission.load(f"builtin:{rover}"))
    end = rovers.events["parachute_deploy"] - 1.0
    for pair in ((rovers.driving, rovers.checking[0]), (rovers.checking[0], rovers.driving)):
        assert disagreements(*pair, end, PROBABILITY) == []


@pytest.mark.parametrize("rover", ["mer_a", "mer_b"])
@pytest.mark.parametrize("at_fault", [0, pytest.param(1, marks=pytest.mark.slow)])
def test_a_scale_that_changes_in_flight_is_no_misalignment(rover, at_fault):
    """A misalignment of 1 mrad, which the rovers state, gives 1e-3 of the axial force to the lateral axes only."""
    rovers = read_telemetry(Mission.load(f"builtin:{rover}"))
    end = rovers.events["parachute_deploy"] - 1.0
    for change, agree in ((1.01, False), (1.0003, True)):
        records = [rovers.driving, rovers.checking[0]]
        records[at_fault] = with_change(records[at_fault], FORCE, lambda v, change=change: change * v, start=151.0)
        assert (disagreements(*records, end, PROBABILITY) == []) is agree


def test_noise_that_is_stated_too_small_by_half_is_no_disagreement(telemetry):
    records = [
        replace(r, rate_noise=0.5 * r.rate_noise, shared_rate_noise=0.5 * r.shared_rate_noise)
        for r in (telemetry.driving, telemetry.checking[0])
    ]
    assert disagreements(*records, END, PROBABILITY) == []


@pytest.mark.parametrize("at_fault", [0, 1])
@pytest.mark.parametrize(
    ("key", "change", "end"),
    [(RATE, noise(6e-4), 130.0), (FORCE, noise(1.0), 130.0), (FORCE, lambda v: 1.01 * v, np.inf)],
    ids=["noise of the rates", "noise of the forces", "step of the scale"],
)
def test_the_imu_with_an_independent_error_is_identified(key, change, end, at_fault, telemetry):
    records = [telemetry.driving, telemetry.checking[0]]
    records[at_fault] = with_change(records[at_fault], key, change, 120.0, end)
    findings = disagreements(*records, END, PROBABILITY)
    evidence = list(independent_error(*records, findings, END).values())
    assert evidence[at_fault] > 30.0 and evidence[1 - at_fault] == 0.0


@pytest.mark.parametrize("begin", [-10.0, END + 10.0], ids=["before the record", "after the comparison"])
def test_a_disagreement_in_which_no_sample_is_compared_is_no_evidence(begin, telemetry):
    """Of single samples whose neighbours are lost, for example."""
    finding = SampleFinding("primary", "rate", begin, begin + 5.0, 40, "disagreement", UNDECIDED)
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # the mean of no values
        evidence = independent_error(telemetry.driving, telemetry.checking[0], [finding], END)
    assert evidence == {"primary": 0.0, "secondary": 0.0}


@pytest.mark.parametrize("at_fault", [0, 1])
def test_an_imu_that_is_smoother_than_the_motion_is_not_taken_for_the_sound_one(at_fault, telemetry):
    # an IMU that does not measure the motion any more: the difference is the motion of the other one
    records = [telemetry.driving, telemetry.checking[0]]
    records[at_fault] = with_change(records[at_fault], RATE, lambda v: 0.0 * v, 120.0, 140.0)
    findings = [f for f in disagreements(*records, END, PROBABILITY) if f.channel == "rate"]
    evidence = list(independent_error(*records, findings, END).values())
    assert findings and evidence[1 - at_fault] == 0.0


def test_a_disagreement_is_named_and_not_repaired_before_the_imu_at_fault_is_known(telemetry):
    driving = with_change(telemetry.driving, RATE, FAULTS["sign of a rate axis"][1], 120.0)
    outcome = repaired(replace(telemetry, driving=driving), parachute=PARACHUTE)
    assert {(f.kind, f.repair) for f in outcome.findings} == {("disagreement", UNDECIDED)}
    np.testing.assert_array_equal(outcome.driving.angular_rate, driving.angular_rate)


def test_samples_of_the_imu_at_fault_are_filled_from_the_other_one_with_its_constant_error(telemetry):
    bias = np.array([0.0, 0.01, 0.0])
    driving = with_change(telemetry.driving, FORCE, lambda v: v + bias)
    driving = with_change(driving, FORCE, lambda v: 1.1 * v, 150.0, 170.0)
    outcome = repaired(replace(telemetry, driving=driving), parachute=PARACHUTE)
    filled = without_samples(outcome, "primary", {"force": [(147.0, 173.0)]}, parachute=PARACHUTE)
    assert {(f.imu, f.kind, f.repair) for f in filled.findings} == {
        ("primary", "disagreement", "filled from secondary")
    }
    assert filled.as_read.driving is driving
    rows = (driving.time > 150.0) & (driving.time <= 170.0)
    error = (filled.driving.specific_force - telemetry.driving.specific_force - bias)[rows]
    assert np.all(np.abs(error.mean(axis=0)) < 2e-3)
