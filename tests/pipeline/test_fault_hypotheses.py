"""Hypotheses on the input: each repair removes the error that its sentence states."""

import shutil
from dataclasses import replace

import h5py
import numpy as np
import pytest
from faulty_telemetry import SWAP_XY, turned, with_altimeter

from edl_filter import rotations
from edl_filter.mission import Mission
from edl_filter.pipeline.fault_hypotheses import errors_of_one_number, exchange_text, fault_hypotheses, sign_text
from edl_filter.pipeline.load import read_telemetry


def late(telemetry, **by):
    """Times of an IMU or of the altimeter that are too large, s."""
    return replace(
        telemetry, **{k: replace(getattr(telemetry, k), time=getattr(telemetry, k).time + v) for k, v in by.items()}
    )


def assert_same(repaired, telemetry):
    """Readings and entry state of two records are equal to rounding."""
    for name in ("time", "specific_force", "angular_rate"):
        np.testing.assert_allclose(getattr(repaired.driving, name), getattr(telemetry.driving, name), atol=1e-9)
    for name in ("time", "height"):
        np.testing.assert_allclose(getattr(repaired.altimeter, name), getattr(telemetry.altimeter, name), atol=1e-6)
    attitude = repaired.initial.inertial_from_body
    np.testing.assert_allclose(attitude, telemetry.initial.inertial_from_body, atol=1e-12)


@pytest.mark.parametrize(
    ("words", "error"),
    [
        ("the specific force of IMU primary is in ft/s^2", lambda t: turned(t, np.eye(3) / 0.3048, "specific_force")),
        ("the angular rate was multiplied by 0.01745", lambda t: turned(t, np.eye(3) * np.pi / 180, "angular_rate")),
        ("the altimeter is in km", lambda t: with_altimeter(t, t.altimeter.height * (1e-3 - 1.0))),
        ("x and y exchanged in the gyros, axes of the body", lambda t: turned(t, SWAP_XY, "angular_rate")),
        (
            "sign of z in the accelerometers, axes of the body",
            lambda t: turned(t, np.diag([1.0, 1.0, -1.0]), "specific_force"),
        ),
        (
            "has its scalar part first",
            lambda t: replace(
                t, initial=replace(t.initial, inertial_from_body=np.roll(t.initial.inertial_from_body, 1))
            ),
        ),
        (
            "turns from inertial axes to those of the body",
            lambda t: replace(
                t, initial=replace(t.initial, inertial_from_body=rotations.conjugate(t.initial.inertial_from_body))
            ),
        ),
    ],
)
def test_a_repair_removes_the_error_of_its_sentence(inputs, words, error):
    mission, telemetry, *_ = inputs
    faulty = error(telemetry)
    repair = next(h.repair for h in fault_hypotheses(mission, faulty) if words in h.sentence)
    assert_same(repair(faulty), telemetry)


@pytest.mark.parametrize(
    ("imus", "owner"), [(("primary",), " of IMU primary"), (("primary", "secondary"), "")], ids=["one", "both"]
)
def test_a_record_with_repaired_samples_is_read_again_in_the_unit_of_the_hypothesis(
    imus, owner, builtin_flight, tmp_path
):
    """In deg/s most rates are beyond the limit of a sample, so that their repair cannot be scaled."""
    path = shutil.copy(builtin_flight, tmp_path)
    with h5py.File(path, "a") as file:
        for imu in imus:
            file[f"imu/{imu}/angular_rate"][...] = np.degrees(file[f"imu/{imu}/angular_rate"][...])
    mission = Mission.load("builtin:practice_mer", [f"telemetry.path={path}"])
    truth = read_telemetry(Mission.load("builtin:practice_mer", [f"telemetry.path={builtin_flight}"]))
    records = [turned(truth, np.eye(3) / np.radians(1.0), "angular_rate").driving, *truth.checking]
    if len(imus) == 2:
        records[1] = replace(records[1], angular_rate=np.degrees(records[1].angular_rate))
    records[0].rate_fill_sigma[800] = 0.1  # a sample that was repaired
    faulty = replace(truth, driving=records[0], checking=tuple(records[1:]))
    units = {h.sentence: h.repair for h in fault_hypotheses(mission, faulty) if h.kind == "units"}
    repaired = units[f"units, the angular rate{owner} is in deg/s"](faulty)
    assert not any(r.filled.any() for r in (repaired.driving, *repaired.checking))
    for record, true in zip((repaired.driving, *repaired.checking), (truth.driving, *truth.checking), strict=True):
        np.testing.assert_allclose(record.angular_rate, true.angular_rate, atol=1e-12)
        np.testing.assert_array_equal(record.specific_force, true.specific_force)


@pytest.mark.parametrize(
    ("sentence", "error", "value", "word"),
    [
        ("times of the IMU", lambda t: late(t, driving=0.7), -0.7, "late"),
        ("times of the altimeter", lambda t: late(t, altimeter=-0.3), 0.3, "early"),
        ("its heights", lambda t: with_altimeter(t, 0.02 * t.altimeter.height), 0.02, "large"),
    ],
)
def test_an_error_of_one_number_is_removed_by_its_value(inputs, sentence, error, value, word):
    _, telemetry, *_ = inputs
    faulty = error(telemetry)
    (of_one,) = (e for e in errors_of_one_number(faulty) if sentence in e.sentence)
    assert_same(of_one.repair(value)(faulty), telemetry)
    assert of_one.words[int(value < 0.0)] == word
    assert of_one.resolution < min(abs(v) for v in of_one.values) < max(of_one.values) == -min(of_one.values)


def test_hypotheses_are_different_and_none_needs_an_altimeter(inputs):
    mission, telemetry, *_ = inputs
    sentences = [h.sentence for h in fault_hypotheses(mission, telemetry)]
    cyclic = [text for text in sentences if "x, y and z in another order" in text]  # both ways round
    assert len(cyclic) == 2 * len(set(cyclic)) == 12  # three groups of sensors, two sets of axes
    assert len(set(sentences)) == len(sentences) - 6 == 81
    without = replace(telemetry, altimeter=None)
    assert not any("altimeter" in h.sentence for h in fault_hypotheses(mission, without))
    assert [e.kind for e in errors_of_one_number(without)] == ["clock"]


def test_axes_that_are_exchanged_or_have_a_wrong_sign_in_words():
    orders = {(0, 1, 2): "", (1, 0, 2): "x and y exchanged", (2, 1, 0): "x and z exchanged"}
    assert {order: exchange_text(order) for order in orders} == orders
    assert exchange_text((1, 2, 0)) == exchange_text((2, 0, 1)) == "x, y and z in another order"
    signs = {(1, 1, 1): "", (1, -1, 1): "sign of y", (-1, 1, -1): "sign of x and z", (-1, -1, -1): "sign of all axes"}
    assert {s: sign_text(s) for s in signs} == signs
