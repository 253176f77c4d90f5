"""Simulated flights in the forms that telemetry comes in: the rovers' archive, and a plain log of 200 Hz for Phoenix.

The archive's form of Phoenix is not public, so that no reader of it can be tested (docs/thesis-claims.md).
"""

import numpy as np
import pytest
import yaml
from archive_form import GAP, OFF, SEPARATION, write_archive

from edl_filter import rotations
from edl_filter.mission import Mission
from edl_filter.pipeline.reconstruct import reconstruct
from edl_filter.simulation import Scenario, simulate
from edl_filter.telemetry.csv_log import convert

PHOENIX_STEP = 0.005


def errors_over_sigma(reconstruction, truth, time):
    """Errors of position, velocity and attitude against the truth at a time, each component over its sigma."""
    trajectory = reconstruction.trajectory
    k, true = np.searchsorted(trajectory.time, time - 1e-6), np.searchsorted(truth["time"], time - 1e-6)
    assert trajectory.time[k] == pytest.approx(truth["time"][true], abs=1e-6)
    turn = rotations.multiply(truth["attitude"][true], rotations.conjugate(trajectory.inertial_from_body[k]))
    error = np.concatenate((
        truth["position"][true] - trajectory.position[k],
        truth["velocity"][true] - trajectory.velocity[k],
        rotations.to_rotation_vector(turn),
    ))  # fmt: skip
    return error / np.sqrt(np.diag(trajectory.covariance[k]))


@pytest.fixture(scope="module")
def rover():
    return simulate(Scenario.load("builtin:mer"), [], 7)


@pytest.fixture(scope="module")
def archived(rover, tmp_path_factory):
    """The mission that reads the archive, and its reconstruction."""
    mission = write_archive(tmp_path_factory.mktemp("volume"), rover)
    return reconstruct(mission)


def test_the_archive_is_read_with_its_defects(rover, archived):
    telemetry, parachute = archived.telemetry, archived.event_times["parachute_deploy"]
    notes = " ".join(telemetry.notes)
    assert "2TRANSFORMED.TAB" in notes and "rows with the time of another removed" in notes
    assert "the velocity register was reset 2 times" in notes
    assert "1 gap (0.875 s" in notes or "1 gap (1 s" in notes
    assert "rows whose backshell columns repeat the rover's marked missing" in notes
    sources = telemetry.driving.sources
    times = {name: telemetry.driving.time[telemetry.driving.source == k] for k, name in enumerate(sources)}
    assert times["TRANSFORMED"][-1] == pytest.approx(90.0) and times["HIGHRATE"][0] == pytest.approx(90.125)
    assert np.all((times["gap"] > parachute + GAP[0]) & (times["gap"] < parachute + GAP[1] + 0.125))
    assert parachute + SEPARATION + OFF < times["HIGHRATE"][-1]


def test_samples_of_the_archive_are_those_of_the_flight(rover, archived):
    """HIGHRATE to the rounding of its six decimals; before it the mean force at the centre of mass."""
    flown, read = rover.telemetry().driving, archived.telemetry.driving
    separation = archived.event_times["backshell_separation"]
    highrate = (read.source == read.sources.index("HIGHRATE")) & (read.time < separation)
    same = np.searchsorted(flown.time, read.time[highrate] - 1e-6)
    np.testing.assert_allclose(read.specific_force[highrate], flown.specific_force[same], rtol=0, atol=1e-5)
    np.testing.assert_allclose(read.angular_rate[highrate], flown.angular_rate[same], rtol=0, atol=1e-5)
    np.testing.assert_allclose(read.position[highrate], flown.position[same], rtol=0, atol=1e-6)
    early = read.source == read.sources.index("TRANSFORMED")
    assert early.sum() == 360
    last = np.searchsorted(flown.time, read.time[early] - 1e-6)
    rate = 0.5 * (flown.angular_rate[last] + flown.angular_rate[last - 1])
    difference = np.abs(read.angular_rate[early] - rate)  # the net rotation has the coning that a mean rate lacks
    assert np.median(difference) < 3e-5
    # across a quaternion with a large rounding error the rate is a mean, whose sigma is stated
    assert np.all(difference.max(axis=1) < 2e-3 + 3.0 * read.rate_noise[early])


def test_the_checking_imu_before_highrate_is_the_register(rover, archived):
    (checking,) = archived.telemetry.checking
    early = checking.time < 80.0
    secondary = rover.telemetry().checking[0]
    total = (checking.specific_force * checking.interval[:, None])[early].sum(axis=0)
    flown = (secondary.specific_force * secondary.interval[:, None])[
        (secondary.time > checking.start + 1e-6) & (secondary.time < checking.time[early][-1] + 1e-6)
    ].sum(axis=0)
    assert total[0] == pytest.approx(flown[0], rel=2e-3)


def test_the_archived_flight_is_reconstructed(rover, archived):
    truth = rover.contents.truth
    for time in (0.0, 60.0, 120.0, 180.0, archived.event_times["parachute_deploy"] - 0.2):
        step = 0.25 if time < 90.0 else 0.125
        z = errors_over_sigma(archived, truth, step * round(time / step))
        assert np.max(np.abs(z)) < 4.0, (time, z)
    for check in archived.constraint_checks:
        assert check.consistent and np.all(check.accepted), check.name


@pytest.fixture(scope="module")
def phoenix():
    fine = [f"sampling.interval_s={PHOENIX_STEP}", "sampling.substeps=1"]
    return simulate(Scenario.load("builtin:phoenix", fine), [], 5)


def write_log(folder, flight):
    """Log of increments of both IMUs in the recorder's microseconds, and its specification."""
    contents, epoch = flight.contents, 211_604_460_000_000
    imus = contents.imus
    time = imus["primary"].time
    columns = {"clock_us": epoch + np.round(1e6 * time)}
    spec = {
        "name": "phoenix_like", "planet": contents.planet, "epoch_utc": contents.epoch_utc,
        "prime_meridian_at_epoch_rad": float(contents.prime_meridian_at_epoch), "imu": {},
    }  # fmt: skip
    for name, imu in imus.items():
        for axis, v, w in zip("xyz", imu.specific_force.T, imu.angular_rate.T, strict=True):
            columns |= {f"{name}_dv{axis}": v * PHOENIX_STEP, f"{name}_da{axis}": w * PHOENIX_STEP}
        e = imu.errors
        spec["imu"][name] = {
            "time": {"column": "clock_us", "unit": "us", "epoch": epoch}, "sample_interval_s": PHOENIX_STEP,
            "specific_force": {"columns": [f"{name}_dv{a}" for a in "xyz"], "unit": "m/s"},
            "angular_rate": {"columns": [f"{name}_da{a}" for a in "xyz"], "unit": "rad"},
            "body_from_imu": imu.body_from_imu.tolist(), "position_m": imu.position.tolist(),
            "accelerometer_noise_m_s2": imu.accelerometer_noise, "gyro_noise_rad_s": imu.gyro_noise,
            "accelerometer_bias_sigma_m_s2": e.accelerometer_bias, "accelerometer_scale_sigma": e.accelerometer_scale,
            "accelerometer_misalignment_sigma_rad": e.accelerometer_misalignment,
            "gyro_bias_sigma_rad_s": e.gyro_bias, "gyro_scale_sigma": e.gyro_scale,
        }  # fmt: skip
    initial, sigma = contents.initial, np.sqrt(np.diag(contents.initial.covariance))
    spec["initial"] = {
        "time_s": float(initial.time), "position_m": initial.position.tolist(),
        "velocity_m_s": initial.velocity.tolist(),
        "inertial_from_body": initial.inertial_from_body.tolist(), "position_sigma_m": sigma[:3].tolist(),
        "velocity_sigma_m_s": sigma[3:6].tolist(), "attitude_sigma_rad": sigma[6:].tolist(),
    }  # fmt: skip
    spec["events"] = {k: {"time_s": float(t), "time_sigma_s": float(s)} for k, (t, s) in contents.events.items()}
    spec["parachute"] = {
        "time_s": float(contents.parachute.time), "dynamic_pressure_pa": float(contents.parachute.dynamic_pressure),
        "dynamic_pressure_sigma_pa": float(contents.parachute.dynamic_pressure_sigma),
    }  # fmt: skip
    spec["landing"] = {
        "time_s": float(contents.landing.time), "position_m": contents.landing.position.tolist(),
        "position_sigma_m": contents.landing.position_sigma.tolist(),
    }  # fmt: skip
    (folder / "log.spec.yaml").write_text(yaml.safe_dump(spec))
    table = np.column_stack(list(columns.values()))
    np.savetxt(folder / "log.csv", table, "%.12g", ",", header=",".join(columns), comments="")
    (folder / "log.csv").write_text(_exact_clock(folder / "log.csv", columns["clock_us"]))
    return folder / "log.csv", folder / "log.spec.yaml"


def _exact_clock(path, clock):
    """Text of the table with all digits of the clock."""
    head, *lines = path.read_text().splitlines()
    rows = (f"{int(c)},{line.partition(',')[2]}" for c, line in zip(clock, lines, strict=True))
    return "\n".join([head, *rows]) + "\n"


@pytest.mark.slow
def test_phoenix_at_200_hz_from_a_plain_log(phoenix, tmp_path):
    """The log, converted, gives the flight of the file that the simulator writes, and its truth."""
    log, spec = write_log(tmp_path, phoenix)
    changes = ["constraints.altimeter=null"]
    paths = convert(log, spec, tmp_path / "log.h5"), phoenix.write(tmp_path / "flight.h5")
    by_log, by_file = (
        reconstruct(Mission.load("builtin:practice_phoenix", [f"telemetry.path={p}", *changes]), leave_one_out=False)
        for p in paths
    )
    assert len(by_log.trajectory.time) > 60_000
    deploy = by_log.event_times["parachute_deploy"]
    before = by_log.trajectory.time < deploy
    np.testing.assert_allclose(
        by_log.trajectory.position[before], by_file.trajectory.position[before], rtol=0, atol=0.01
    )
    for time in (0.0, 60.0, 120.0, 180.0, deploy - 0.2):
        z = errors_over_sigma(by_log, phoenix.contents.truth, PHOENIX_STEP * round(time / PHOENIX_STEP))
        assert np.max(np.abs(z)) < 4.0, (time, z)
