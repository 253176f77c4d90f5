"""Diagnoses of practice flights against the effects that were hidden in them."""

import pytest

from edl_filter.diagnosis.linear_model.credible_model import credible_model
from edl_filter.diagnosis.linear_model.flight_case import load_case
from edl_filter.diagnosis.linear_model.linearization import linearize
from edl_filter.diagnosis.residual_analysis.residual_map import failing_cells, residual_map
from edl_filter.diagnosis.residual_analysis.unexplained import describe_remainder
from edl_filter.diagnosis.selection.decision import decide
from edl_filter.diagnosis.selection.ranking import rank
from edl_filter.effects import EffectInstance
from edl_filter.effects.registry import find_effect
from edl_filter.mission import Mission
from edl_filter.simulation import Scenario, simulate

#: practice/answers.json: the misalignment, rad, and the jet's frequency (Hz) and span (s).
MISALIGNED = {"mx": 0.0, "my": 0.01127612, "mz": 0.00712172}
JET, JET_SPAN = 0.679365, (63.537, 164.025)
#: A layer of wind of the plausible size, m/s and m.
WIND = {"east": -38.54284418215444, "north": 41.405907336395416, "h_lo": 8761.228329379068, "h_hi": 21774.94477610613}


def case(path):
    return load_case(Mission.load("builtin:practice_mer", [f"telemetry.path={path}"]))


@pytest.mark.slow
def test_the_misalignment_of_practice_04(practice):
    ranking = rank(case(practice(4)), [find_effect(n) for n in ("accelerometer_misalignment", "gyro_bias")])
    verdict = decide(ranking)
    assert verdict.verdict == "missing" and verdict.leader.name == "accelerometer_misalignment"
    parameters = verdict.entries[0].hypothesis.fit.parameters(("accelerometer_misalignment", None))
    for name, true in MISALIGNED.items():
        value, sigma = parameters[name]
        # a rotation about the force's axis has little effect on the residuals
        assert 0.0 < sigma < (1e-2 if name == "mx" else 1e-3), name
        assert value == pytest.approx(true, abs=3.0 * sigma), name


@pytest.mark.slow
def test_a_wind_that_nuisance_parameters_have_absorbed_has_its_own_layer(tmp_path):
    """The model without it is most probable with a nuisance parameter 42 sigmas off, and fails there.

    With the nuisance parameters held at that point the wind is less probable than none, and a layer of 1.3 km with the
    opposite wind was the estimate, 84 sigmas off.
    """
    wind = find_effect("wind")
    path = simulate(Scenario.load("builtin:phoenix"), [EffectInstance(wind, WIND)], 16).write(tmp_path / "flight.h5")
    case = load_case(Mission.load("builtin:practice_phoenix", [f"telemetry.path={path}"]))
    model, _ = credible_model(case)
    assert not model.holds and model.largest_nuisance_sigmas > 20.0
    verdict = decide(rank(case, [wind]))
    assert verdict.verdict == "missing" and verdict.entries[0].hypothesis.at_floor
    for name, (value, sigma) in verdict.entries[0].hypothesis.fit.parameters(("wind", None)).items():
        assert value == pytest.approx(WIND[name], abs=4.0 * sigma), name
        assert 0.0 < sigma < (1.0 if name in ("east", "north") else 100.0), name


@pytest.mark.slow
def test_of_two_effects_one_is_seen_only_about_the_path_that_the_other_has_moved(tmp_path):
    """A gyro bias of thirty sigmas moves the path; the base pressure is not among the names about the first point."""
    base_pressure, gyro_bias = find_effect("base_pressure"), find_effect("gyro_bias")
    hidden = [
        EffectInstance(base_pressure, {"a": -0.15}),
        EffectInstance(gyro_bias, {"bx": -7.695188e-05, "by": -4.385637e-05, "bz": 5.436016e-05}),
    ]
    path = simulate(Scenario.load("builtin:phoenix"), hidden, 17).write(tmp_path / "flight.h5")
    case = load_case(Mission.load("builtin:practice_phoenix", [f"telemetry.path={path}"]))
    verdict = decide(rank(case, [base_pressure, gyro_bias]))
    assert verdict.verdict == "missing" and verdict.leader.name == "base_pressure"
    value, sigma = verdict.entries[0].hypothesis.fit.parameters(("base_pressure", None))["a"]
    assert 0.0 < sigma < 0.01 and value == pytest.approx(-0.15, abs=3.0 * sigma)


def test_a_jet_outside_the_catalogue_is_described(practice):
    model = linearize(case(practice(8)))
    remainder = describe_remainder(model)
    assert remainder.channel == "moment_y" and remainder.unit == "N m"
    assert remainder.frequency == pytest.approx(JET, abs=0.01)
    assert (remainder.t0, remainder.t1) == (pytest.approx(JET_SPAN[0], abs=8.0), pytest.approx(JET_SPAN[1], abs=8.0))
    assert f"it oscillates at {remainder.frequency:.3f} Hz" in remainder.description
    worst = failing_cells(residual_map(model))[0]
    assert worst.channel == "moment_y" and worst.t0 < JET_SPAN[1] and worst.t1 > JET_SPAN[0]
