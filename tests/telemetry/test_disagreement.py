"""Two IMUs that disagree for seconds: found, and nothing is found where they do not."""

from dataclasses import replace

import numpy as np
import pytest

from edl_filter.mission import Mission
from edl_filter.pipeline.load import read_telemetry
from edl_filter.telemetry.disagreement import disagreements
from edl_filter.telemetry.flight_file import read_flight_file
from edl_filter.telemetry.sample_repair import alone, repaired

FORCE, RATE = "specific_force", "angular_rate"
PARACHUTE = 252.75


@pytest.fixture(scope="module")
def telemetry(builtin_flight):
    return read_flight_file(builtin_flight)


def with_fault(record, key, change, start=120.0):
    values = getattr(record, key).copy()
    rows = record.time > start
    values[rows] = change(values[rows])
    return replace(record, **{key: values})


FAULTS = {
    "sign of a force axis": (FORCE, lambda v: v * [-1.0, 1.0, 1.0], "force"),
    "sign of a rate axis": (RATE, lambda v: v * [1.0, -1.0, 1.0], "rate"),
    "exchanged rate axes": (RATE, lambda v: v[:, [1, 0, 2]], "rate"),
    "rate scale": (RATE, lambda v: 1.01 * v, "rate"),
    "rate bias": (RATE, lambda v: v + np.array([0.0, 1e-3, 0.0]), "rate"),
    "late rates": (RATE, lambda v: np.roll(v, 3, axis=0), "rate"),
}


@pytest.mark.parametrize("name", FAULTS)
@pytest.mark.parametrize("at_fault", [0, 1])
def test_a_fault_that_lasts_is_found_in_either_imu(name, at_fault, telemetry):
    key, change, channel = FAULTS[name]
    records = [telemetry.driving, telemetry.checking[0]]
    records[at_fault] = with_fault(records[at_fault], key, change)
    findings = disagreements(*records, PARACHUTE - 1.0)
    assert channel in {f.channel for f in findings} and {f.kind for f in findings} == {"disagreement"}


def test_sound_imus_agree(telemetry):
    assert disagreements(telemetry.driving, telemetry.checking[0], PARACHUTE - 1.0) == []


@pytest.mark.parametrize("rover", ["mer_a", "mer_b"])
def test_the_imus_of_the_rovers_agree(rover):
    rovers = read_telemetry(Mission.load(f"builtin:{rover}"))
    end = rovers.events["parachute_deploy"] - 1.0
    assert disagreements(rovers.driving, rovers.checking[0], end) == []


def test_noise_that_is_stated_too_small_by_half_is_no_disagreement(telemetry):
    records = [
        replace(r, rate_noise=0.5 * r.rate_noise, shared_rate_noise=0.5 * r.shared_rate_noise)
        for r in (telemetry.driving, telemetry.checking[0])
    ]
    assert disagreements(*records, PARACHUTE - 1.0) == []


def test_imus_that_disagree_are_repaired_apart(telemetry):
    driving = with_fault(telemetry.driving, RATE, FAULTS["sign of a rate axis"][1])
    lost = (driving.time > 150.0) & (driving.time <= 151.0)
    driving = replace(driving, specific_force=np.where(lost[:, None], np.nan, driving.specific_force))
    faulty = replace(telemetry, driving=driving)
    outcome = repaired(faulty, parachute=PARACHUTE)
    assert {f.kind for f in outcome.findings} >= {"disagreement"} and outcome.as_read is faulty
    assert outcome.checking[0].specific_force is telemetry.checking[0].specific_force
    assert not np.isnan(outcome.driving.specific_force).any()
    single = alone(outcome, "secondary", parachute=PARACHUTE)
    assert single.driving is telemetry.checking[0] and single.checking == () and single.findings == ()
