"""Conversion of the documented example log, unit factors, and errors in log or specification."""

from pathlib import Path

import numpy as np
import pytest

from edl_filter.errors import InputError
from edl_filter.telemetry.csv_log import _imu, _Log, convert
from edl_filter.telemetry.csv_spec import read_spec
from edl_filter.telemetry.flight_file import read_flight_file

EXAMPLES = Path(__file__).parents[2] / "docs" / "examples"


@pytest.fixture
def texts():
    return (EXAMPLES / "imu_log.csv").read_text(), (EXAMPLES / "imu_log.spec.yaml").read_text()


def convert_and_read(folder, log, spec):
    (folder / "log.csv").write_text(log)
    (folder / "spec.yaml").write_text(spec)
    return read_flight_file(convert(folder / "log.csv", folder / "spec.yaml", folder / "flight.h5"))


def test_example_is_converted_to_si_and_body_axes(texts, tmp_path):
    telemetry = convert_and_read(tmp_path, *texts)
    columns = np.genfromtxt(texts[0].splitlines(), delimiter=",", skip_header=2, comments="#")
    imu = telemetry.driving
    np.testing.assert_allclose(imu.time, (columns[:, 0] - 500000) / 1000.0, atol=1e-12)
    np.testing.assert_allclose(imu.interval, 0.05, atol=1e-12)
    x, y, z = 9.80665 * columns[:, 1:4].T  # z of the IMU is x of the body, x of the IMU is -z of the body
    np.testing.assert_allclose(imu.specific_force, np.column_stack((z, y, -x)), atol=1e-12)
    assert imu.angular_rate[:, 0].mean() == pytest.approx(np.radians(12.04), rel=1e-3)
    np.testing.assert_allclose(telemetry.altimeter.height, 1000.0 * columns[3::4, 7])
    np.testing.assert_allclose(telemetry.altimeter.time, imu.time[3::4])
    np.testing.assert_allclose(np.diag(telemetry.initial.covariance)[[0, 3, 6]], [1e6, 1.0, 1e-6])
    assert telemetry.events == {"parachute_deploy": 1.8}
    assert telemetry.parachute.dynamic_pressure == 700.0


@pytest.mark.parametrize(
    ("unit", "replacement", "factor"),
    [
        ("unit: g", "unit: mg", 1e-3),
        ("unit: g", "unit: m/s^2", 1.0 / 9.80665),
        ("unit: g", "unit: m/s", 1.0 / 9.80665 / 0.05),
        ("unit: deg/s", "unit: deg/h", 1.0 / 3600.0),
        ("unit: deg/s", "unit: rad/s", 180.0 / np.pi),
        ("unit: deg/s", "unit: deg", 20.0),
        ("unit: deg/s", "unit: rad", 20.0 * 180.0 / np.pi),
    ],
)
def test_units_and_increments(texts, tmp_path, unit, replacement, factor):
    """Without the flight file's limits, which values in a wrong unit exceed."""
    key = "specific_force" if unit == "unit: g" else "angular_rate"
    log, spec = tmp_path / "log.csv", tmp_path / "spec.yaml"
    log.write_text(texts[0])

    def read(text):
        spec.write_text(text)
        return getattr(_imu(_Log(log), read_spec(spec).imu["primary"], spec, "primary"), key)

    np.testing.assert_allclose(
        read(texts[1].replace(unit + " ", replacement + " ", 1)), factor * read(texts[1]), rtol=1e-12
    )


def test_wrong_unit_raises_and_writes_nothing(texts, tmp_path):
    log, spec = texts
    with pytest.raises(InputError, match=r"/imu/primary/angular_rate row 0 is 240\.\d+; .* \(is it in deg/s\?\)"):
        convert_and_read(tmp_path, log, spec.replace("unit: deg/s ", "unit: rad ", 1))
    assert not (tmp_path / "flight.h5").exists()


def test_quaternion_is_accepted_instead_of_a_matrix(texts, tmp_path):
    log, spec = texts
    with_matrix = convert_and_read(tmp_path, log, spec).driving.specific_force
    half = np.sqrt(0.5)
    spec = spec.replace("[[0, 0, 1], [0, 1, 0], [-1, 0, 0]]", f"[0, {half}, 0, {half}]")
    np.testing.assert_allclose(convert_and_read(tmp_path, log, spec).driving.specific_force, with_matrix, atol=1e-12)


def replace_line(text, number, line):
    lines = text.splitlines()
    lines[number - 1] = line
    return "\n".join(lines)


VALID_LINE = "500200,0,0,0,0,0,0,"


@pytest.mark.parametrize(
    ("log", "spec", "message"),
    [
        (
            lambda s: replace_line(s, 6, "500200,x,0,0,0,0,0,"),
            None,
            r"log.csv, line 6, column 'ax': found 'x'; a finite",
        ),
        (lambda s: replace_line(s, 6, "500200,0,nan,0,0,0,0,"), None, r"line 6, column 'ay': found 'nan'"),
        (lambda s: replace_line(s, 6, "500200,0,0,,0,0,0,"), None, r"line 6, column 'az': found ''"),
        (
            lambda s: replace_line(s, 6, '500200,"0,0,0,0,0,0,'),
            None,
            r"log.csv, line 6: a quotation mark is not closed",
        ),
        (lambda s: replace_line(s, 6, "500200,0,0"), None, r"log.csv, line 6: 3 fields; the header has 8"),
        (
            lambda s: replace_line(s, 6, VALID_LINE.replace("200", "100")),
            None,
            r"line 6, .*time must increase.* 500150 to 500100",
        ),
        (
            lambda s: s.replace("height_km", "h"),
            None,
            r"column 'height_km' is not in the header: clock_ms, ax",
        ),
        (lambda s: s.replace("gx", "ax"), None, r"column 'ax' is in the header twice"),
        (lambda s: "a,b\n1,2\n", None, r"log.csv: 2 lines; a header and at least two samples"),
        (None, lambda s: s.replace("planet:", "world:"), r"spec.yaml: planet is missing"),
        (None, lambda s: s + "\ncolour: red\n", r"spec.yaml: colour is an unknown key"),
        (
            None,
            lambda s: s.replace("unit: g ", "unit: ft/s^2 "),
            r"specific_force.unit is 'ft/s\^2'; Input should be",
        ),
        (
            None,
            lambda s: s.replace("clock_ms\n      unit: ms", "clock_ms\n      unit: s"),
            r"sample_interval_s is 0.05",
        ),
        (None, lambda s: s.replace("primary:", "main:"), r"imu has main; one IMU must be called primary"),
        (
            None,
            lambda s: s.replace("[[0, 0, 1]", "[[0, 0, 2]"),
            r"imu.primary.body_from_imu is no rotation matrix",
        ),
        (None, lambda s: s.replace("0.6396]", "0.9]"), r"flight.h5: /initial/attitude has norm"),
        (
            None,
            lambda s: s.replace("planet: mars", "planet: [mars"),
            r"spec.yaml, line \d+: this is not YAML",
        ),
        (None, lambda s: "just words", r"spec.yaml: the file is 'just words'"),
        (
            None,
            lambda s: s.replace("2031-05-04T12", "2031-15-04T12"),
            r"'2031-15-04T12:00:00' is no UTC time",
        ),
        (
            None,
            lambda s: s.replace("sigma_m: 5.0", "sigma_m: -5.0"),
            r"altimeter.sigma_m is -5.0; Input should be",
        ),
    ],
)
def test_bad_input_raises_one_line_and_writes_nothing(texts, tmp_path, log, spec, message):
    log_text, spec_text = texts
    with pytest.raises(InputError, match=message) as raised:
        convert_and_read(tmp_path, log(log_text) if log else log_text, spec(spec_text) if spec else spec_text)
    assert "\n" not in str(raised.value)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["log.csv", "spec.yaml"]


def test_missing_files_raise(tmp_path):
    with pytest.raises(InputError, match=r"none.csv: the log cannot be read \(No such file"):
        convert(tmp_path / "none.csv", EXAMPLES / "imu_log.spec.yaml", tmp_path / "o.h5")
    with pytest.raises(InputError, match=r"none.yaml: the specification cannot be read \(No such file"):
        convert(EXAMPLES / "imu_log.csv", tmp_path / "none.yaml", tmp_path / "o.h5")
