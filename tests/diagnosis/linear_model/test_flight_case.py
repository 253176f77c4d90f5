"""A flight prepared for diagnosis: model and readings with effects, and the determinant of the readings' map."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from edl_filter.diagnosis.linear_model import flight_case as flight_case_module
from edl_filter.diagnosis.linear_model.flight_case import (
    constraints_after,
    end_of_linear_attitude,
    flight_case,
    load_case,
    rejected_readings,
    without_coarse_checking,
)
from edl_filter.effects.base import EffectInstance
from edl_filter.effects.registry import find_effect
from edl_filter.pipeline import reconstruct as reconstruct_module
from edl_filter.telemetry.record import SampleFinding


@pytest.fixture(scope="module")
def case(practice_06):
    return flight_case(practice_06)


def instance(name, **values):
    return EffectInstance(find_effect(name), values)


def test_without_effects_the_samples_are_those_of_the_reconstruction(case, practice_06):
    inputs = case.model_inputs(())
    for name in ("time", "force", "rate", "force_noise"):
        expected = getattr(practice_06.problem.samples, name)
        np.testing.assert_array_equal(getattr(inputs.problem.samples, name), expected)
    assert inputs.driving is practice_06.telemetry.driving
    assert [r.name for r in inputs.checking] == [r.name for r in practice_06.telemetry.checking]


@pytest.mark.parametrize(
    ("effect", "in_readings", "in_model"),
    [
        (instance("accelerometer_scale", sx=1e-2), True, False),
        (instance("wind", east=20.0, low=1e4, high=2e4), False, True),
        (instance("com_offset", dy=5e-3), False, True),
    ],
)
def test_an_error_of_an_imu_changes_readings_and_every_other_effect_the_forward_model(
    case, effect, in_readings, in_model
):
    """The centre of mass also moves the place at which the readings are evaluated."""
    plain, inputs = case.model_inputs(()), case.model_inputs((effect,))
    assert (inputs.forward_model.effects == (effect,)) == in_model and plain.forward_model.effects == ()
    assert (not np.array_equal(inputs.driving.specific_force, plain.driving.specific_force)) == in_readings


def test_the_noise_of_unresolved_motion_does_not_depend_on_effects(case):
    """Else an effect that makes the readings smoother would be more probable for it."""
    halved = case.model_inputs((instance("gyro_scale", sx=0.2, sy=0.2, sz=0.2),))
    np.testing.assert_array_equal(
        halved.problem.samples.shared_rate_noise, case.model_inputs(()).problem.samples.shared_rate_noise
    )


def test_readings_divided_by_a_scale_have_its_determinant_in_every_compared_bin(case):
    """By the change of variables, of each bin's mean that the driving IMU covers; no other effect has one."""
    scale = instance("accelerometer_scale", sx=1e-2, sy=-2e-3)
    expected = -int(case.bins.valid.sum()) * (np.log1p(1e-2) + np.log1p(-2e-3))
    assert case.log_abs_det_jacobian((scale,)) == pytest.approx(expected, rel=1e-6)
    assert case.log_abs_det_jacobian((instance("accelerometer_bias", bx=0.01),)) == pytest.approx(0.0, abs=1e-6)
    assert case.log_abs_det_jacobian((instance("mass", k=0.01),)) == 0.0


def test_the_comparison_ends_before_the_parachute(case, practice_06):
    deployment = practice_06.event_times["parachute_deploy"]
    margin = case.settings.parachute_margin_s
    assert deployment - margin - 2.0 < case.end <= deployment - margin
    assert case.bins.edges[0] == pytest.approx(practice_06.problem.initial.time)


def test_a_case_is_reconstructed_with_other_effects_without_its_files(monkeypatch, practice_06):
    """As `load_case` reconstructs it; what compares the IMUs, which no diagnosis reads, is left out."""
    effects = (instance("accelerometer_bias", bx=0.01), instance("wind", east=20.0, low=1e4, high=2e4))
    case, expected = load_case(practice_06.mission), load_case(practice_06.mission, effects)
    monkeypatch.setattr(reconstruct_module, "read_telemetry", lambda *_: pytest.fail("read again"))
    monkeypatch.setattr(reconstruct_module, "read_atmosphere", lambda *_: pytest.fail("read again"))
    again = case.reconstruct_with(effects)
    assert again.effects == effects and case.effects == ()
    for name in ("position", "velocity", "inertial_from_body", "covariance", "specific_force"):
        actual, value = (getattr(c.reconstruction.trajectory, name) for c in (again, expected))
        np.testing.assert_array_equal(actual, value)
    np.testing.assert_array_equal(again.bins.edges, expected.bins.edges)
    assert again.reconstruction.recovery is None and again.reconstruction.inputs is not None


def test_a_reconstruction_for_a_diagnosis_adds_no_noise_where_it_diverges(monkeypatch, practice_06):
    """More noise would hide a missing effect."""
    calls = []

    def reconstructed(mission, effects, leave_one_out, **options):
        calls.append((mission, effects, leave_one_out, options))
        return practice_06

    monkeypatch.setattr(flight_case_module, "reconstruct", reconstructed)
    case = load_case(practice_06.mission, ())
    assert calls == [(practice_06.mission, (), False, {"recover": False})]
    assert case.reconstruction is practice_06 and case.discrepancy_estimate is None


def uses_of(name, *accepted):
    """Uses of an instrument at 0, 1, … s, each accepted or not."""
    return [
        SimpleNamespace(constraint=SimpleNamespace(name=name, time=float(k)), accepted=a)
        for k, a in enumerate(accepted)
    ]


def test_rejected_readings_of_an_instrument_that_agrees_are_outliers():
    """Not those of an instrument most of whose readings are rejected, or of which there are few."""
    fused = [
        *uses_of("altimeter", True, False, True, True, False),
        *uses_of("onboard_attitude", True, False, False, False, True, True),
        *uses_of("rest_velocity", True, False, True),
        *uses_of("landing", False),
    ]
    assert rejected_readings(SimpleNamespace(fused=fused)) == {("altimeter", 1.0), ("altimeter", 4.0)}


def test_outliers_are_not_compared_whatever_effects_the_model_has(case):
    constraints = case.reconstruction.problem.constraints
    heights = [c for c in constraints if c.name == "altimeter"][3:5]
    without = replace(case, excluded_constraints=frozenset((c.name, c.time) for c in heights))
    remaining = [c.time for c in constraints if c not in heights]
    effect = instance("com_offset", dy=5e-3)
    for inputs in (without.model_inputs(()), without.model_inputs((effect,)), without.denoised_inputs(())):
        assert [c.time for c in inputs.problem.constraints] == remaining
    assert without.reconstruct_with([effect]).excluded_constraints == without.excluded_constraints
    assert case.excluded_constraints == frozenset()


def test_a_checking_imu_with_coarse_steps_is_compared_only_if_an_effect_acts_on_it(practice_06):
    """The error of rounding is neither white nor constant, as the noise and the errors of a sensor are."""
    assert without_coarse_checking(practice_06) is practice_06
    driving, second = (r.name for r in (practice_06.telemetry.driving, *practice_06.telemetry.checking))

    def with_coarse(imu, *effects):
        coarse = SampleFinding(imu, "force", 0.0, 300.0, 2400, "coarse", "")
        telemetry = replace(practice_06.telemetry, findings=(*practice_06.telemetry.findings, coarse))
        return replace(practice_06, telemetry=telemetry, effects=effects)

    assert [r.name for r in without_coarse_checking(with_coarse(driving)).telemetry.checking] == [second]
    case = flight_case(with_coarse(second))
    assert case.reconstruction.telemetry.checking == () and case.model_inputs(()).checking == ()
    assert case.reconstruction.telemetry.driving is practice_06.telemetry.driving
    bias = EffectInstance(find_effect("accelerometer_bias"), {"bx": 0.01}, imu=second)
    assert [r.name for r in without_coarse_checking(with_coarse(second, bias)).telemetry.checking] == [second]


def test_constraints_after_lost_rates_that_leave_the_attitude_unknown_are_not_compared(practice_06):
    """The errors of the filled samples are independent: their variances add up."""
    problem = practice_06.problem
    samples = problem.samples
    assert end_of_linear_attitude(samples, 0.05) == np.inf
    assert constraints_after(problem, np.inf) == frozenset()
    deployed = practice_06.event_times["parachute_deploy"]
    lost = np.flatnonzero((samples.time > deployed - 1.0) & (samples.time <= deployed + 1.0))
    sigma = np.zeros_like(samples.rate)
    sigma[lost, 1] = 0.05 / np.sqrt(11.5) / samples.interval[lost]  # the twelfth lost sample exceeds it
    filled = replace(samples, rate_fill_sigma=sigma, force_fill_sigma=np.zeros_like(sigma))
    time = end_of_linear_attitude(filled, 0.05)
    assert time == pytest.approx(samples.time[lost[11]] - samples.interval[lost[11]])
    expected = {(c.name, c.time) for c in problem.constraints if c.time > time}
    assert len(expected) < len(problem.constraints)
    assert flight_case(replace(practice_06, problem=replace(problem, samples=filled))).excluded_constraints == expected
