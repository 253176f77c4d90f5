"""Writer of the flight file: contents are read back, and invalid ones are not written."""

from dataclasses import replace

import h5py
import numpy as np
import pytest

from edl_filter import rotations
from edl_filter.errors import InputError
from edl_filter.imu_model.sensor_errors import SensorErrors
from edl_filter.telemetry.flight_file import read_flight_file
from edl_filter.telemetry.flight_file_writer import FlightContents, FlightImu, write_flight_file
from edl_filter.telemetry.record import InitialState, LandingFix, ParachuteFix


def example_contents():
    rng = np.random.default_rng(5)
    imu = FlightImu(
        time=0.1 * np.arange(1, 31),
        specific_force=rng.standard_normal((30, 3)),
        angular_rate=rng.standard_normal((30, 3)),
        sample_interval=0.1,
        body_from_imu=np.array([0.6, 0.0, 0.0, 0.8]),
        position=np.array([0.1, 0.2, 0.3]),
        accelerometer_noise=0.01,
        gyro_noise=1e-4,
        errors=SensorErrors(1e-3, 1e-4, 2e-4, 1e-6, 3e-5),
    )
    return {
        "name": "example",
        "planet": "mars",
        "epoch_utc": "2004-01-04T04:19:52",
        "prime_meridian_at_epoch": 0.5,
        "imus": {"primary": imu},
        "initial": InitialState(
            0.0, np.array([3.5e6, 0, 0]), np.array([0, 5e3, 0]), np.array([0, 0, 0.6, 0.8]), np.eye(9)
        ),
        "events": {"landing": (2.5, 0.02)},
        "parachute": ParachuteFix(1.0, 700.0, 20.0),
        "landing": LandingFix(2.5, np.array([3.39e6, 0, 0]), np.full(3, 500.0)),
        "truth": {"effect": {"name": "none", "size": 1.5, "series": np.arange(4.0)}},
    }


def test_contents_are_written_and_read_back(tmp_path):
    contents = example_contents()
    path = write_flight_file(tmp_path / "example.h5", FlightContents(**contents))
    telemetry, imu = read_flight_file(path), contents["imus"]["primary"]
    np.testing.assert_array_equal(telemetry.driving.time, imu.time)
    np.testing.assert_allclose(
        rotations.rotate(rotations.conjugate(imu.body_from_imu), telemetry.driving.specific_force),
        imu.specific_force,
        atol=1e-14,
    )
    assert telemetry.driving.errors == (imu.errors,)
    assert telemetry.parachute == contents["parachute"]
    assert telemetry.events == {"landing": 2.5}
    assert telemetry.altimeter is None
    np.testing.assert_array_equal(telemetry.landing.position_sigma, np.full(3, 500.0))
    with h5py.File(path) as file:
        assert file["truth/effect"].attrs["size"] == 1.5
        assert file["events/landing"].attrs["time_sigma"] == 0.02
    assert [p.name for p in tmp_path.iterdir()] == ["example.h5"]


def test_invalid_contents_are_not_written_and_an_old_file_is_unchanged(tmp_path):
    path = write_flight_file(tmp_path / "example.h5", FlightContents(**example_contents()))
    old = path.read_bytes()
    invalid = example_contents()
    invalid["initial"] = replace(invalid["initial"], covariance=-np.eye(9))
    with pytest.raises(InputError, match=r"example.h5: /initial/covariance has -1 on its diagonal"):
        write_flight_file(path, FlightContents(**invalid))
    assert path.read_bytes() == old
    assert [p.name for p in tmp_path.iterdir()] == ["example.h5"]
    in_new_folder = tmp_path / "new" / "folder" / "example.h5"
    assert read_flight_file(write_flight_file(in_new_folder, FlightContents(**example_contents()))).planet == "mars"
    with pytest.raises(InputError, match=r"new: cannot be written \(it is a folder; a file's name is needed\)"):
        write_flight_file(tmp_path / "new", FlightContents(**example_contents()))
    with pytest.raises(InputError, match=r"cannot be written"):
        write_flight_file(path / "example.h5", FlightContents(**example_contents()))
