"""A simulated flight in the form of the rovers' archive (PDS3 tables TRANSFORMED and HIGHRATE), and its mission."""

from pathlib import Path

import numpy as np
import yaml

from edl_filter import rotations
from edl_filter.mission import Mission, shipped_mission
from edl_filter.simulation.flight import Flight
from edl_filter.telemetry.record import ImuRecord
from edl_filter.telemetry.smoothing import batch_polynomial, differentiated_rates

#: Count of the spacecraft clock at entry; time (s) of the last row of TRANSFORMED before HIGHRATE begins.
EPOCH_SCLK, HIGHRATE_FROM = 126462085.5, 90.0
STEP = 0.125
#: Body axes from the archive's spacecraft axes, whose z is forward.
BODY_FROM_SPACECRAFT = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
#: Times after the parachute, s: gap of HIGHRATE, resets of the register, separation of the backshell, its IMU off.
GAP, RESETS, SEPARATION, OFF = (17.875, 18.75), (22.125, 27.125), 30.0, 60.0
#: Register: axes (rows) in J2000, and its value at entry, m/s.
REGISTER = np.array([[0.42660, -0.61253, 0.66545], [0.89454, 0.17721, -0.41035], [0.13343, 0.77033, 0.62353]])
REGISTER_START = (-1.5, 0.75, -0.25)
IMUS = {"backshell": "primary", "rover": "secondary"}
#: Shares of the axial force that the on-board transform adds to the forces along the archive's x and y, deg.
ALIGNMENT = {"backshell": (-0.295, -0.030), "rover": (0.073, 0.066)}


def write_archive(folder: Path, flight: Flight) -> Mission:
    """Write the four files of "Spirit" to ``folder/DATA`` and return a mission that reads them.

    Like the archive the tables have repeated rows, a gap, a register that is late and reset, angle increments under the
    name of rates, and rover columns in place of the backshell's after its IMU is off.
    """
    mission = _mission(folder, flight)
    records = _records(flight)
    (folder / "DATA").mkdir(parents=True)
    _write(folder / "DATA", "2TRANSFORMED", *_transformed(mission, flight, records))
    _write(folder / "DATA", "2HIGHRATE", *_highrate(mission, flight, records))
    return mission


def _records(flight: Flight) -> dict:
    telemetry = flight.telemetry()
    named = {r.name: r for r in (telemetry.driving, *telemetry.checking)}
    return {imu: named[name] for imu, name in IMUS.items()}


def _transformed(mission: Mission, flight: Flight, records: dict) -> tuple[list, np.ndarray]:
    """Columns and rows of TRANSFORMED: four rows per second, eight from the beginning of HIGHRATE on."""
    truth, rover, backshell = flight.contents.truth, records["rover"], records["backshell"]
    time, attitude = truth["time"], truth["attitude"]
    matrix = mission.planet.j2000_from_inertial_matrix
    quaternions = [_onboard(matrix, attitude[0], record) for record in (rover, backshell)]

    middle = rotations.multiply(attitude[1:], rotations.from_rotation_vector(-0.5 * STEP * rover.angular_rate))
    before = np.vstack(
        (np.zeros(3), _onboard_force(rover.specific_force[:-1], "rover"))
    )  # a cycle adds the increment of the one before
    gain = rotations.rotate(middle, before) * STEP @ matrix.T @ REGISTER.T
    register = np.vstack((np.zeros(3), np.cumsum(gain, axis=0))) + REGISTER_START
    parachute = mission.event_times()["parachute_deploy"]
    for reset in RESETS:
        after = time > parachute + reset
        register[after] -= register[after][0]
        register[np.flatnonzero(after)[0]] = 0.0

    rate = np.asarray(batch_polynomial(backshell.time - 0.5 * STEP, backshell.angular_rate, 5))
    turn = np.asarray(differentiated_rates(backshell.time - 0.5 * STEP, rate))
    place = backshell.position
    at_centre = backshell.specific_force - np.cross(turn, place) - np.cross(rate, np.cross(rate, place))
    pairs = 0.5 * (at_centre[1:] + at_centre[:-1])
    force = _onboard_force(np.vstack((at_centre[:1], at_centre[:1], pairs)), "backshell") @ BODY_FROM_SPACECRAFT

    rows = np.column_stack((EPOCH_SCLK + time, *quaternions, register, force))
    rows[time > parachute + SEPARATION + OFF, 5:9] = 0.0
    rows[time > parachute + SEPARATION + OFF, 12:] = 0.0
    quarter = np.abs(time / 0.25 - np.round(time / 0.25)) < 1e-6
    rows = rows[quarter | (time > HIGHRATE_FROM)]
    names = [f"{imu}_IMU_QUATERNION_{k}" for imu in ("ROVER", "BACKSHELL") for k in (1, 2, 3, 4)]
    columns = [("SPACECRAFT_CLOCK_START_COUNT", 13, 3), *((name, 14, 6) for name in names)]
    columns += [(f"{name}_{axis}", 14, 6) for name in ("ROVER_IMU_DELTA_VEL", "BACKSHELL_IMU_ACCEL") for axis in "XYZ"]
    return columns, np.repeat(rows, np.where(np.arange(len(rows)) % 100 == 50, 2, 1), axis=0)


def _onboard_force(force: np.ndarray, imu: str) -> np.ndarray:
    """Force (N, 3), body axes, with the alignment error of the on-board transform."""
    return force + force[:, :1] * np.array([0.0, *np.radians(ALIGNMENT[imu])])


def _onboard(j2000_from_inertial: np.ndarray, start: np.ndarray, record: ImuRecord) -> np.ndarray:
    """Quaternions of the archive: the integral of an IMU's own gyros, its errors included, with q4 >= 0."""
    angle = record.angular_rate * STEP
    before = np.vstack((angle[:1], angle[:-1]))
    turns = rotations.from_rotation_vector(angle + np.cross(before, angle) / 12.0)
    attitude = [start]
    for turn in turns:
        attitude.append(rotations.multiply(attitude[-1], turn))
    j2000_from_spacecraft = rotations.multiply(
        rotations.multiply(rotations.from_matrix(j2000_from_inertial), np.array(attitude)),
        rotations.from_matrix(BODY_FROM_SPACECRAFT),
    )
    return j2000_from_spacecraft * np.where(j2000_from_spacecraft[:, 3:] < 0.0, -1.0, 1.0)


def _highrate(mission: Mission, flight: Flight, records: dict) -> tuple[list, np.ndarray]:
    """Columns and rows of HIGHRATE: increments in the axes of each IMU."""
    columns, parts, parachute = [("SPACECRAFT_CLOCK_START_COUNT", 13, 3)], [], mission.event_times()["parachute_deploy"]
    time = records["rover"].time
    for imu in ("rover", "backshell"):
        body_from_imu = BODY_FROM_SPACECRAFT @ rotations.to_matrix(mission.telemetry.imus[imu].spacecraft_from_imu)
        for name, values in (("RATES", records[imu].angular_rate), ("DELTA_VEL", records[imu].specific_force)):
            columns += [(f"{imu.upper()}_IMU_{name}_{axis}", 14, 6) for axis in "XYZ"]
            parts.append(values @ body_from_imu * STEP)
    rows = np.column_stack((EPOCH_SCLK + time, *parts))
    off = time > parachute + SEPARATION + OFF
    rows[off, 7:] = rows[off, 1:7]
    missing = (time > parachute + GAP[0]) & (time < parachute + GAP[1])
    return columns, rows[(time > HIGHRATE_FROM) & ~missing]


def _write(folder: Path, product: str, columns: list, rows: np.ndarray) -> None:
    """Write the table and its detached label."""
    widths = [width for _, width, _ in columns]
    lines = ["".join(f"{v:{w}.{d}f}" for v, (_, w, d) in zip(row, columns, strict=True)) for row in rows]
    assert all(len(line) == sum(widths) for line in lines)
    (folder / f"{product}.TAB").write_text("".join(line + "\r\n" for line in lines), newline="")
    size, starts = sum(widths) + 2, 1 + np.cumsum([0, *widths[:-1]])
    objects = [
        ["  OBJECT = COLUMN", f'    NAME = "{name}"', "    DATA_TYPE = ASCII_REAL", f"    START_BYTE = {start}",
         f"    BYTES = {width}", f'    FORMAT = "F{width}.{decimals}"', "  END_OBJECT = COLUMN"]
        for (name, width, decimals), start in zip(columns, starts, strict=True)
    ]  # fmt: skip
    label = [
        "PDS_VERSION_ID = PDS3", "RECORD_TYPE = FIXED_LENGTH", f"RECORD_BYTES = {size}", f"FILE_RECORDS = {len(rows)}",
        f'^TABLE = "{product}.TAB"', 'DATA_SET_ID = "MER1/MER2-M-IMU-4-EDL-V1.0"',
        'INSTRUMENT_HOST_NAME = "MARS EXPLORATION ROVER 2"', f'PRODUCT_ID = "{product}"',
        "OBJECT = TABLE", "  INTERCHANGE_FORMAT = ASCII", f"  ROW_BYTES = {size}", f"  ROWS = {len(rows)}",
        f"  COLUMNS = {len(columns)}", *(line for item in objects for line in item), "END_OBJECT = TABLE", "END",
    ]  # fmt: skip
    (folder / f"{product}.LBL").write_text("".join(f"{line:<78}\r\n" for line in label), newline="")


def _mission(folder: Path, flight: Flight) -> Mission:
    """Mission of the simulated world that reads the archive's tables."""
    content, contents = yaml.safe_load(shipped_mission("practice_mer").read_text()), flight.contents
    parachute, landing = contents.events["parachute_deploy"][0], contents.landing
    x, y, z = landing.position
    radius = float(np.linalg.norm(landing.position))
    end = float(flight.telemetry().driving.time[-1])
    content["planet"]["prime_meridian_deg"] = float(np.degrees(contents.prime_meridian_at_epoch))
    content["planet"]["j2000_from_inertial"] = [
        [0.673307, -0.589580, 0.446154], [0.739363, 0.536906, -0.406294], [0.0, 0.603430, 0.797416]
    ]  # fmt: skip
    content["telemetry"] = {
        "format": "mer-imu", "path": str(folder), "spacecraft": 2, "epoch_sclk": EPOCH_SCLK,
        "clock": {"sclk": EPOCH_SCLK, "utc": "2004-01-04T04:19:52"}, "start_s": 0.0, "end_s": end,
        "velocity_register": {"frame": REGISTER.tolist(), "accelerometer_noise": 0.003, "gyro_noise": 2e-5},
        "imus": {imu: _imu(imu, contents.imus[name]) for imu, name in IMUS.items()},
    }  # fmt: skip
    rover = contents.imus[IMUS["rover"]].position @ BODY_FROM_SPACECRAFT
    content["vehicle"]["events"] = {
        "parachute_deploy": {"time_s": parachute, "sigma_s": 0.02},
        "backshell_separation": {
            "time_s": STEP * round((parachute + SEPARATION) / STEP), "sigma_s": 0.02, "position": rover.tolist()
        },
        "landing": {"time_s": landing.time, "sigma_s": 0.02},
    }  # fmt: skip
    variance = np.sqrt(np.diag(contents.initial.covariance))
    content["initial_state"] = {
        "time_s": 0.0, "position": contents.initial.position.tolist(), "velocity": contents.initial.velocity.tolist(),
        "position_sigma": float(variance[0]), "velocity_sigma": float(variance[3]),
        "attitude": "onboard", "attitude_sigma_deg": 0.01,
    }  # fmt: skip
    content["constraints"] = {
        # rounding of 80 increments to 1e-6 rad
        "onboard_attitude": {"interval_s": 10.0, "sigma_deg": 0.00015, "unit_change_sigma_deg": 0.2},
        "parachute": {
            "dynamic_pressure": contents.parachute.dynamic_pressure,
            "dynamic_pressure_sigma": contents.parachute.dynamic_pressure_sigma,
        },
        "landing": {
            "latitude_deg": float(np.degrees(np.arcsin(z / radius))),
            "longitude_deg": float(np.degrees(np.arctan2(y, x))),
            "radius": radius, "horizontal_sigma": 30.0, "vertical_sigma": 30.0,
        },
        "rest": {"start_s": landing.time + 2.0, "end_s": end - 0.5, "velocity_sigma": 0.05},
    }  # fmt: skip
    path = folder / "mission.yaml"
    path.write_text(yaml.safe_dump(content, sort_keys=False))
    return Mission.load(path)


def _imu(name: str, imu) -> dict:
    spacecraft_from_body = rotations.from_matrix(BODY_FROM_SPACECRAFT.T)
    errors = imu.errors
    return {
        "spacecraft_from_imu": rotations.multiply(spacecraft_from_body, imu.body_from_imu).tolist(),
        "position": (imu.position @ BODY_FROM_SPACECRAFT).tolist(), "transformed_alignment_deg": list(ALIGNMENT[name]),
        "accelerometer_noise": imu.accelerometer_noise, "gyro_noise": imu.gyro_noise,
        "accelerometer_bias_sigma": errors.accelerometer_bias,
        "accelerometer_scale_sigma": errors.accelerometer_scale,
        "accelerometer_misalignment_sigma": errors.accelerometer_misalignment,
        "gyro_bias_sigma": errors.gyro_bias, "gyro_scale_sigma": errors.gyro_scale,
    }  # fmt: skip
