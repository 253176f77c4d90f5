"""Reader of the flight file: contents, gap filling, and every kind of error in a file."""

import shutil

import h5py
import numpy as np
import pytest

from edl_filter import rotations
from edl_filter.errors import InputError
from edl_filter.imu_model.sensor_errors import SensorErrors
from edl_filter.telemetry.flight_file import read_flight_file


@pytest.fixture
def flight(builtin_flight, tmp_path):
    """Copy of the built-in flight that a test may modify."""
    return shutil.copy(builtin_flight, tmp_path / "flight.h5")


def test_built_in_flight_is_read_in_body_axes(builtin_flight):
    telemetry = read_flight_file(builtin_flight)
    imu = telemetry.driving
    assert (imu.name, [c.name for c in telemetry.checking]) == ("primary", ["secondary"])
    np.testing.assert_allclose(imu.interval, 0.125, atol=1e-9)
    assert imu.start == pytest.approx(0.0, abs=1e-9)
    np.testing.assert_array_equal(imu.position, np.tile([0.25, -0.35, 0.28], (len(imu), 1)))
    assert imu.errors[0] == SensorErrors(0.0005, 0.0001, 0.0001, 2.42406840554768e-06, 5e-05)
    # Drag is along -x in body axes in both IMUs, independent of their mounting
    for record in (imu, *telemetry.checking):
        peak = np.argmax(np.linalg.norm(record.specific_force[:1900], axis=1))
        force = record.specific_force[peak]
        assert force[0] < -0.99 * np.linalg.norm(force)
    assert set(telemetry.events) == {"parachute_deploy", "landing"}
    assert telemetry.parachute.dynamic_pressure == pytest.approx(696.138, abs=1e-3)
    assert telemetry.altimeter.sigma == 5.0
    assert telemetry.landing.position_sigma.shape == (3,)
    assert telemetry.epoch_utc == "2004-01-04T04:19:52"
    assert telemetry.attitude is None
    assert telemetry.notes == ()
    assert [len(sha) for sha in telemetry.files.values()] == [64]


def test_rates_are_rotated_from_imu_to_body_axes(builtin_flight):
    telemetry = read_flight_file(builtin_flight)
    with h5py.File(builtin_flight) as file:
        group = file["imu/primary"]
        matrix = rotations.to_matrix(group.attrs["body_from_imu"])
        np.testing.assert_allclose(telemetry.driving.angular_rate, group["angular_rate"][()] @ matrix.T, atol=1e-8)


def test_truth_is_not_read(flight):
    before = read_flight_file(flight)
    with h5py.File(flight, "a") as file:
        file["truth/initial/position"] = np.full(3, np.nan)
        file["truth"].attrs["version"] = "nonsense"
    after = read_flight_file(flight)
    np.testing.assert_array_equal(after.initial.position, before.initial.position)


def test_practice_flights_are_read(practice):
    for n in range(1, 9):
        telemetry = read_flight_file(practice(n))
        expected = 0.05 if n in (3, 5) else 0.125
        np.testing.assert_allclose(telemetry.driving.interval, expected, atol=1e-9)


def test_missing_samples_are_rows_of_nan_and_a_finding(flight):
    without_gap = read_flight_file(flight).driving
    with h5py.File(flight, "a") as file:
        group = file["imu/primary"]
        for key in ("time", "specific_force", "angular_rate"):
            values = np.delete(group[key][()], slice(1500, 1507), axis=0)
            del group[key]
            group[key] = values
    telemetry = read_flight_file(flight)
    imu = telemetry.driving
    np.testing.assert_allclose(imu.time, without_gap.time, atol=1e-9)
    np.testing.assert_allclose(imu.interval, 0.125, atol=1e-9)
    lost = np.isnan(imu.specific_force).all(axis=1)
    np.testing.assert_array_equal(np.flatnonzero(lost), np.arange(1500, 1507))
    np.testing.assert_array_equal(np.isnan(imu.angular_rate).all(axis=1), lost)
    np.testing.assert_array_equal([imu.sources[k] == "gap" for k in imu.source], lost)
    (finding,) = telemetry.findings
    assert (finding.imu, finding.kind, finding.samples) == ("primary", "missing", 7)
    assert finding.start == pytest.approx(without_gap.time[1499])


def test_nearly_unit_quaternion_is_normalised(flight):
    with h5py.File(flight, "a") as file:
        file["initial/attitude"][...] *= 1.0 + 5e-4
    assert np.linalg.norm(read_flight_file(flight).initial.inertial_from_body) == pytest.approx(1.0, abs=1e-15)


def changed(key, change):
    def modify(file):
        values = change(file[key][()])
        del file[key]
        file[key] = values

    return modify


def element(index, value):
    def change(values):
        values[index] = value
        return values

    return change


def correlated(covariance):
    """Correlation of 2 between the first two states: symmetric, but no covariance."""
    covariance[0, 1] = covariance[1, 0] = 2.0 * np.sqrt(covariance[0, 0] * covariance[1, 1])
    return covariance


def attribute(key, name, value):
    def modify(file):
        file[key].attrs[name] = value

    return modify


def without(key, name=None):
    def modify(file):
        if name:
            del file[key].attrs[name]
        else:
            del file[key]

    return modify


@pytest.mark.parametrize(
    ("modify", "message"),
    [
        (attribute("/", "format", "netcdf"), r"format is 'netcdf'; 'edl-flight' is needed"),
        (without("/", "format"), r"format is None; 'edl-flight' is needed"),
        (attribute("/", "version", 2), r"version is .*2.*; version 1 is read"),
        (without("/", "epoch_utc"), r"/@epoch_utc \(attribute\) is missing"),
        (
            attribute("/", "epoch_utc", "yesterday"),
            r"flight\.h5: /@epoch_utc \(attribute\): 'yesterday' is no UTC time",
        ),
        (without("/", "planet"), r"/@planet \(attribute\) is missing"),
        (
            attribute("/", "prime_meridian_at_epoch", 50.0),
            r"/@prime_meridian_at_epoch is 50; rad .* \(is it in deg\?\)",
        ),
        (
            changed("initial/position", lambda v: 1e-3 * v),
            r"/initial/position is 3522.17; m between .* \(is it in km\?\)",
        ),
        (changed("initial/velocity", lambda v: 1e-3 * v), r"/initial/velocity is 5.62\d*; .* \(is it in km/s\?\)"),
        (attribute("initial", "time", 1e6), r"/initial/@time is 1e\+06; s between"),
        (
            changed("imu/primary/specific_force", lambda v: v / 9.80665),
            r"/imu/primary/specific_force in the median after the landing is 0.37\d*; .* \(is it in g\?\)",
        ),
        (
            changed("imu/primary/specific_force", lambda v: 1e3 * v / 9.8),
            r"specific_force row \d+ is .* \(is it in mg\?\)",
        ),
        (
            changed("imu/secondary/angular_rate", lambda v: np.degrees(v)),
            r"/imu/secondary/angular_rate row \d+ is 1\d\.\d+; rad/s between 0 and 12 is needed \(is it in deg/s\?\)",
        ),
        (
            attribute("imu/primary", "sample_interval", 0.2),
            r"/@sample_interval is 0.2 s, but the usual step of its time is 0.125 s",
        ),
        (changed("imu/primary/time", lambda v: v + 1e6), r"/imu/primary/time row 0 is 1e\+06; s between"),
        (attribute("imu/primary", "position", [250.0, 0.0, 0.0]), r"/@position is 250; m .* \(is it in cm\?\)"),
        (attribute("imu/primary", "accelerometer_noise", 3.0), r"/@accelerometer_noise is 3; m/s\^2 between"),
        (attribute("imu/primary", "accelerometer_bias_sigma", -1e-3), r"/@accelerometer_bias_sigma is -0.001; m/s"),
        (attribute("imu/primary", "gyro_scale_sigma", -1e-3), r"/@gyro_scale_sigma is -0.001; a number between"),
        (attribute("imu/primary", "accelerometer_misalignment_sigma", -1.0), r"misalignment_sigma is -1; rad between"),
        (
            changed("constraints/landing/position_sigma", lambda v: 0.0 * v),
            r"/position_sigma is \[0. 0. 0.\]; it must be",
        ),
        (changed("constraints/landing/position_sigma", element(1, -3.0)), r"/position_sigma is \[.*-3.*\]; it must be"),
        (
            changed("constraints/landing/position", lambda v: 1e-3 * v),
            r"/landing/position is 3392.\d*; .* \(is it in km\?\)",
        ),
        (
            attribute("constraints/parachute", "dynamic_pressure", 0.7),
            r"dynamic_pressure is 0.7; Pa .* \(is it in kPa\?\)",
        ),
        (attribute("altimeter", "surface_radius", 3392.3), r"/@surface_radius is 3392.3; m .* \(is it in km\?\)"),
        (attribute("altimeter", "sigma", -5.0), r"/altimeter/@sigma is -5.0; it must be positive"),
        (attribute("altimeter", "sigma", 1e-6), r"/altimeter/@sigma is 1e-06; m between 0.001 and 100000"),
        (changed("altimeter/height", element(3, 1e7)), r"/altimeter/height row 3 is 1e\+07; m between"),
        (attribute("events/landing", "time_sigma", -0.1), r"/events/landing/@time_sigma is -0.1; s between"),
        (without("imu/primary"), r"/imu/primary is missing; the flight file needs this group"),
        (without("imu/primary/time"), r"/imu/primary/time is missing; the flight file needs this dataset"),
        (without("imu/secondary", "gyro_noise"), r"/imu/secondary/@gyro_noise \(attribute\) is missing"),
        (attribute("imu/primary", "gyro_noise", -1.0), r"/imu/primary/@gyro_noise is -1.0; it must be"),
        (attribute("imu/primary", "position", [1.0, 2.0]), r"/@position has shape \(2,\); \(3,\) is needed"),
        (attribute("imu/primary", "gyro_noise", "small"), r"/@gyro_noise holds no numbers"),
        (
            attribute("imu/primary", "body_from_imu", [0.0, 0.0, 0.0, 1.01]),
            r"/imu/primary/@body_from_imu has norm 1.01; a unit quaternion",
        ),
        (
            changed("imu/primary/specific_force", lambda v: v[:, :2]),
            r"shape \(2910, 2\); \(2910, 3\) is needed",
        ),
        (changed("imu/primary/angular_rate", lambda v: v[:-1]), r"shape \(2909, 3\); \(2910, 3\) is needed"),
        (without("initial"), r"/initial is missing"),
        (changed("initial/attitude", lambda v: 1.01 * v), r"/initial/attitude has norm 1.01; a unit"),
        (changed("initial/covariance", element((0, 1), 1e9)), r"/initial/covariance is not symmetric"),
        (changed("initial/covariance", element((4, 4), -1.0)), r"covariance has -1 on its diagonal, row 4"),
        (
            changed("initial/covariance", correlated),
            r"covariance is not positive definite \(least eigenvalue of its correlations -",
        ),
        (changed("initial/covariance", lambda v: v[:6, :6]), r"has shape \(6, 6\); \(9, 9\) is needed"),
        (attribute("constraints/parachute", "dynamic_pressure_sigma", 0.0), r"sigma is 0.0; it must"),
        (without("altimeter/height"), r"/altimeter/height is missing"),
        (without("events/landing", "time"), r"/events/landing/@time \(attribute\) is missing"),
    ],
)
def test_bad_input_raises_one_line(flight, modify, message):
    with h5py.File(flight, "a") as file:
        modify(file)
    with pytest.raises(InputError, match=message) as raised:
        read_flight_file(flight)
    assert "\n" not in str(raised.value)


def test_missing_file_and_other_format_raise(tmp_path):
    with pytest.raises(InputError, match=r"none.h5: no such flight file"):
        read_flight_file(tmp_path / "none.h5")
    (tmp_path / "text.h5").write_text("not HDF5")
    with pytest.raises(InputError, match=r"text.h5: this is no HDF5 file"):
        read_flight_file(tmp_path / "text.h5")


def test_heights_that_repeat_or_are_not_finite_are_not_used(flight):
    with h5py.File(flight, "a") as file:
        height = file["altimeter/height"][()]
        height[20] = np.nan
        height[40:80] = height[40]
        file["altimeter/height"][...] = height
    telemetry = read_flight_file(flight)
    assert [(f.imu, f.kind, f.samples) for f in telemetry.findings] == [
        ("altimeter", "not_finite", 1), ("altimeter", "stuck", 39)
    ]  # fmt: skip
    assert len(telemetry.altimeter.height) == len(height) - 40
    assert np.isfinite(telemetry.altimeter.height).all()


def test_one_deployment_of_the_parachute_has_one_time(flight):
    with h5py.File(flight, "a") as file:
        file["events/parachute_deploy"].attrs["time"] += 5.0
    with pytest.raises(InputError, match=r"parachute/@time is 252\.75 s, but .* is at 257\.75 s"):
        read_flight_file(flight)
