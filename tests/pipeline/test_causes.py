"""Causes of a flight whose record or measurements contradict it: which one is named first."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from faulty_telemetry import SWAP_XY, SWAP_XZ, turned, with_altimeter

from edl_filter import rotations
from edl_filter.navigation.outlier_screening import Divergence
from edl_filter.navigation.recovery import Recovery
from edl_filter.pipeline.causes import (
    _curvature_sigma,
    _evaluate,
    _is_significant,
    _with_sigma,
    rank_causes,
)
from edl_filter.pipeline.reconstruct import assemble


@pytest.mark.parametrize(
    ("matrix", "quantity", "kind"),
    [
        (SWAP_XY, "specific_force", "axes"),
        pytest.param(SWAP_XZ, "angular_rate", "axes", marks=pytest.mark.slow),
        pytest.param(np.diag([1.0, 1.0, -1.0]), "specific_force", "sign", marks=pytest.mark.slow),
        pytest.param(-np.eye(3), "angular_rate", "sign", marks=pytest.mark.slow),
        pytest.param(np.eye(3) / 0.3048, "specific_force", "units", marks=pytest.mark.slow),
        pytest.param(np.eye(3) * np.pi / 180.0, "angular_rate", "units", marks=pytest.mark.slow),
    ],
)
def test_the_cause_is_named(inputs, matrix, quantity, kind):
    mission, telemetry, planet, atmosphere = inputs
    causes = rank_causes(mission, turned(telemetry, matrix, quantity), planet, atmosphere, ())
    assert causes[0].kind == kind and causes[0].consistent
    assert causes[0].gain > 100.0


@pytest.mark.parametrize(
    ("repair", "text"),
    [
        pytest.param(
            lambda t: with_altimeter(t, t.altimeter.height * (1.0 / 0.3048 - 1.0)),
            "the altimeter is in ft",
            marks=pytest.mark.slow,
        ),
        pytest.param(
            lambda t: replace(t, altimeter=replace(t.altimeter, time=t.altimeter.time + 3.3)),
            "the times of the altimeter are about ",
            marks=pytest.mark.slow,
        ),
        (lambda t: replace(t, landing=replace(t.landing, position=t.landing.position + 5e4)), "measurement 'landing'"),
    ],
    ids=["feet", "clock", "site"],
)
def test_a_wrong_measurement_is_named(inputs, repair, text):
    mission, telemetry, planet, atmosphere = inputs
    causes = rank_causes(mission, repair(telemetry), planet, atmosphere, ())
    assert text in causes[0].sentence and causes[0].consistent
    if "times" in text:
        estimate, sigma = causes[0].sentence.split(text)[1].split(" s late")[0].split(" ± ")
        assert abs(float(estimate) - 3.3) < min(0.5, 2.0 * float(sigma)) and 0.1 < float(sigma) < 0.4


@pytest.mark.slow
@pytest.mark.parametrize(("factor", "side"), [(1.01, "large"), (0.98, "small")], ids=["1%", "-2%"])
def test_heights_with_a_wrong_scale_are_named_with_its_size(inputs, factor, side):
    mission, telemetry, planet, atmosphere = inputs
    faulty = with_altimeter(telemetry, telemetry.altimeter.height * (factor - 1.0))
    cause = rank_causes(mission, faulty, planet, atmosphere, ())[0]
    assert cause.kind == "measurement" and cause.consistent
    estimate, sigma = cause.sentence.split("its heights are ")[1].split(f" % too {side}")[0].split(" ± ")
    assert abs(float(estimate) - 100.0 * abs(factor - 1.0)) < 3.0 * float(sigma) and 0.05 < float(sigma) < 0.2


@pytest.mark.parametrize(
    ("value", "sigma", "expected"),
    [(0.5, 0.2, True), (0.3, 0.2, False), (-0.5, 0.2, True), (0.015, 1e-6, False), (0.5, np.nan, True)],
)
def test_an_estimate_is_a_cause_from_two_sigmas_and_from_its_resolution_on(value, sigma, expected):
    assert _is_significant(value, sigma, 0.01) == expected


def test_the_sigma_of_an_estimate_is_that_of_the_curvature():
    """Of a Gaussian, exactly; a cost without a minimum has none."""
    assert _curvature_sigma(lambda x: 0.5 * ((x - 3.0) / 0.2) ** 2 + 7.0, 3.0, 5.0) == pytest.approx(0.2)
    for cost in (lambda x: 0.0, lambda x: -(x**2)):
        assert np.isnan(_curvature_sigma(cost, 0.0, 1.0))


@pytest.mark.parametrize(
    ("size", "sigma", "text"),
    [
        (3.04, 0.37, "3.04 ± 0.37"), (99.6, 3.2, "99.6 ± 3.2"), (412.3, 14.0, "412 ± 14"),
        (0.5123, 1e-5, "0.512 ± 0.001"), (2.91, np.nan, "2.9"),
    ],
)  # fmt: skip
def test_a_number_has_the_digits_of_its_sigma(size, sigma, text):
    assert _with_sigma(size, sigma) == text


@pytest.mark.parametrize(
    ("convention", "text"),
    [
        pytest.param(lambda q: np.roll(q, 1), "its quaternion has its scalar part first", marks=pytest.mark.slow),
        pytest.param(
            rotations.conjugate, "its quaternion turns from inertial axes to those of the body", marks=pytest.mark.slow
        ),
    ],
    ids=["scalar first", "conjugated"],
)
def test_another_convention_of_the_quaternion_at_entry_is_named(inputs, convention, text):
    mission, telemetry, planet, atmosphere = inputs
    attitude = convention(telemetry.initial.inertial_from_body)
    faulty = replace(telemetry, initial=replace(telemetry.initial, inertial_from_body=attitude))
    causes = rank_causes(mission, faulty, planet, atmosphere, ())
    assert causes[0].kind == "entry_state" and text in causes[0].sentence and causes[0].consistent


@pytest.mark.slow
def test_a_record_whose_repair_overflows_is_refused(inputs):
    mission, telemetry, planet, atmosphere = inputs

    def in_degrees(record):
        return replace(record, angular_rate=np.degrees(record.angular_rate))

    both = replace(
        telemetry, driving=in_degrees(telemetry.driving), checking=(in_degrees(telemetry.checking[0]),)
    )  # the rates agree
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        causes = rank_causes(mission, both, planet, atmosphere, ())
    assert causes[0].kind == "units" and "deg/s" in causes[0].sentence


def test_a_run_that_ends_is_no_cause(inputs):
    """Of the flight with what the filter added, with a position that is not known to the planet's size."""
    mission, telemetry, planet, atmosphere = inputs
    problem = assemble(mission, telemetry, planet, atmosphere)
    unknown = replace(problem, initial=replace(problem.initial, covariance=1e10 * problem.initial.covariance))
    assert _evaluate(unknown) is None and _evaluate(problem)[1]
    divergence = Divergence(100.0, ("altimeter",), 8, 900.0, 8.0, 3)
    addition = Recovery(divergence, "process_noise", 1.0, 0.1, 1e-3, 100.0, 110.0, 0.0)
    faulty = with_altimeter(telemetry, 3000.0)
    causes = rank_causes(mission, faulty, planet, atmosphere, (), addition, (unknown, True))
    assert causes and addition.cause not in {cause.kind for cause in causes}
    lost = replace(faulty, initial=replace(telemetry.initial, covariance=unknown.initial.covariance))
    assert rank_causes(mission, lost, planet, atmosphere, ()) == []
