"""The measurements decide which of two IMUs is at fault; wrong statements on a whole record are refused by name."""

from dataclasses import replace

import numpy as np
import pytest

from edl_filter.errors import InputError
from edl_filter.mission import Mission
from edl_filter.pipeline.load import read_atmosphere, read_telemetry
from edl_filter.pipeline.reconstruct import FlightInputs, assemble, reconstruct
from edl_filter.pipeline.redundancy import UNDECIDED
from edl_filter.pipeline.trust import check_record, judge
from edl_filter.telemetry.record import SampleFinding
from edl_filter.telemetry.sample_repair import repaired

FORCE, RATE = "specific_force", "angular_rate"
PARACHUTE = 252.75


@pytest.fixture(scope="module")
def flight():
    mission = Mission.load("builtin:practice_mer")
    telemetry = read_telemetry(mission)
    return mission, telemetry, mission.planet_model(telemetry.prime_meridian_at_epoch), read_atmosphere(mission)


def faulty(telemetry, name, changes, start=120.0):
    """Telemetry with changed readings of one IMU from a time on."""

    def changed(record):
        if record.name != name:
            return record
        rows = (record.time > start)[:, None]
        return replace(
            record, **{k: np.where(rows, f(getattr(record, k)), getattr(record, k)) for k, f in changes.items()}
        )

    checking = tuple(changed(r) for r in telemetry.checking)
    return repaired(replace(telemetry, driving=changed(telemetry.driving), checking=checking), parachute=PARACHUTE)


def checked(flight, telemetry):
    mission, _, planet, atmosphere = flight
    return check_record(mission, telemetry, planet, atmosphere, assemble(mission, telemetry, planet, atmosphere))


@pytest.mark.parametrize(
    ("at_fault", "changes", "kind"),
    [
        ("primary", {RATE: lambda v: v * [1.0, -1.0, 1.0]}, "disagreement"),
        ("primary", {FORCE: lambda v: 1.01 * v}, "contradiction"),
        ("secondary", {RATE: lambda v: v + np.array([0.0, 1e-3, 0.0])}, "disagreement"),
    ],
    ids=["sign of a rate axis", "force scale", "bias of the second"],
)
def test_the_sound_imu_drives(at_fault, changes, kind, flight, practice_06):
    mission, telemetry, _, atmosphere = flight
    inputs = FlightInputs(checked(flight, faulty(telemetry, at_fault, changes)), atmosphere)
    result = reconstruct(mission, leave_one_out=False, inputs=inputs, compare_imus=False)
    assert result.telemetry.driving.name == ({"primary", "secondary"} - {at_fault}).pop()
    assert [(f.imu, f.kind) for f in result.telemetry.findings] == [(at_fault, kind)]
    assert "drives the reconstruction alone" in result.telemetry.findings[0].repair
    assert judge(result).trustworthy
    node = int(np.argmin([abs(n.time - PARACHUTE) for n in result.filter_pass.nodes]))
    state, sigma = result.smoothed.states[node].nav[:6], np.sqrt(np.diag(result.smoothed.covariance[node])[:6])
    other = int(np.argmin([abs(n.time - PARACHUTE) for n in practice_06.filter_pass.nodes]))
    assert np.all(np.abs(state - practice_06.smoothed.states[other].nav[:6]) < 3.0 * sigma)


@pytest.mark.parametrize("name", ["primary", "secondary"])
def test_exchanged_axes_of_a_whole_record_are_refused_by_the_name_of_the_imu(name, flight):
    # an exchange of body axes may be a sign in the axes of an IMU that is mounted obliquely: the same statement
    change = {k: lambda v: v[:, [0, 2, 1]] for k in (FORCE, RATE)}
    with pytest.raises(InputError, match=f"axes of the .* in the accelerometers and gyros of IMU {name}"):
        checked(flight, faulty(flight[1], name, change, start=-np.inf))


def test_imus_between_which_no_measurement_decides_are_not_trusted(flight):
    mission, telemetry, _, atmosphere = flight
    both = replace(telemetry, findings=(SampleFinding("primary", "rate", 100.0, 200.0, 800, "disagreement"),))
    result = reconstruct(mission, leave_one_out=False, inputs=FlightInputs(both, atmosphere), compare_imus=False)
    trust = judge(result)
    assert result.telemetry.findings[0].repair == UNDECIDED and result.telemetry.driving.name == "primary"
    assert not trust.trustworthy and "two IMUs disagree in their rate from 100.0 to 200.0 s" in trust.headline


def test_a_clean_flight_is_not_changed(flight):
    assert checked(flight, flight[1]) is flight[1]
