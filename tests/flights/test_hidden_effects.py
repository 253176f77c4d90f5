"""Each effect of the catalogue, hidden in a simulated flight, is named by a diagnosis with the whole catalogue.

`make test-effects` runs this file with the tests that are marked as slow; `make test` runs what is marked as
representative.

The flights follow a rule that was fixed before any of them was diagnosed. The size is the plausible one, in a random
direction; the seed is 1; vehicles alternate in the order of the catalogue. Where the effect is not detectable on that
flight, i.e. the gain expected with the truth known is below 6 nats, or the vehicle tumbles, the other vehicle follows,
then the next seed. The rule never looks at the outcome of a diagnosis.
"""

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from identification import OUTSIDE, PAIRS, VEHICLES, expected_gains, random_instance, simulated_mission
from outside_effects import OUTSIDE_EFFECTS
from scipy.stats import chi2
from typer.testing import CliRunner

from edl_filter import Mission
from edl_filter.cli import app
from edl_filter.diagnosis.diagnosis import diagnose
from edl_filter.diagnosis.linear_model.flight_case import load_case
from edl_filter.diagnosis.residual_analysis.residual_map import failing_cells
from edl_filter.diagnosis.selection.decision import decide
from edl_filter.diagnosis.selection.outer_loop import fit_effects
from edl_filter.diagnosis.selection.ranking import rank
from edl_filter.diagnosis.stepwise import improve
from edl_filter.effects.base import EffectInstance
from edl_filter.effects.registry import catalogue, find_effect
from edl_filter.mission.edit_effects import text_with_effects
from edl_filter.mission.files import write_mission
from edl_filter.simulation import Scenario, simulate

pytestmark = pytest.mark.effects

SEED = 1
#: Gain above which an effect is detectable, nats (design of the diagnosis).
DETECTABLE_NATS = 6.0
#: Probability with which the estimate of a correct diagnosis is rejected.
REJECTION = 1e-4
#: Effect → vehicle and seed. With pitch_damping both vehicles tumble at seed 1; with normal_force_scale Phoenix does.
FLIGHTS = {name: (VEHICLES[i % 2], SEED) for i, name in enumerate(catalogue())} | {
    "pitch_damping": ("mer", 2),
    "normal_force_scale": ("mer", 1),
}
#: Those that `make test` runs as well: among the quickest, of three families and both vehicles.
REPRESENTATIVE = ("base_pressure", "density_scale", "gravity_oblateness")


def hidden_effect(name, seed):
    """The effect with sizes and places of the seed, drawn as in the study of identification."""
    return random_instance(name, 1.0, np.random.default_rng([seed, sum(map(ord, name)), 10]))


def true_effect(mission, instance):
    """What the mission's model lacks: an oblateness is hidden by reducing that of the mission."""
    if instance.name != "gravity_oblateness":
        return instance.canonical_phase()
    j2 = catalogue()["gravity_oblateness"].parameters[0].name
    return EffectInstance(instance.effect, {j2: 1.960454e-3 - mission.planet.gravity.j2})


def leading_hypothesis(diagnosis, key):
    """The hypothesis of `key` in the leading entry: its first or one that the flight does not distinguish from it."""
    assert diagnosis.verdict.verdict == "missing", diagnosis.verdict.sentence
    entry = diagnosis.verdict.entries[0]
    named = {h.key: h for h in (entry.hypothesis, *entry.indistinguishable)}
    assert key in named, diagnosis.verdict.sentence
    return named[key]


def squared_distance(fit, truth):
    """Squared Mahalanobis distance of the estimate from the truth, and the number of parameters fitted.

    The estimate is the maximum of the posterior under a prior from which sizes are drawn, so the distance is
    chi-square distributed.
    """
    (estimate,) = (a for a in fit.effects if a.key == truth.key)
    used = [i for i, (key, _) in enumerate(fit.names) if key == truth.key]
    phases = {q.name: q.high - q.low for q in truth.effect.parameters if q.kind == "phase"}
    error = np.array([estimate.values[fit.names[i][1]] - truth.values[fit.names[i][1]] for i in used])
    for k, i in enumerate(used):
        turn = phases.get(fit.names[i][1])
        if turn is not None and math.isfinite(turn):
            error[k] = math.remainder(error[k], turn)
    return float(error @ np.linalg.solve(fit.covariance[np.ix_(used, used)], error)), len(used)


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=[pytest.mark.representative] if n in REPRESENTATIVE else []) for n in FLIGHTS]
)
def test_a_hidden_effect_is_named_with_its_parameters(name, tmp_path, record_property):
    """The gain that is expected and the one that is computed are properties in the file of ``--junitxml``."""
    vehicle, seed = FLIGHTS[name]
    hidden = hidden_effect(name, seed)
    mission = simulated_mission(vehicle, seed, [hidden], tmp_path)
    expected = expected_gains(load_case(mission, ()), [hidden])[hidden.name]
    record_property("expected_gain", float(expected))
    assert expected > DETECTABLE_NATS
    diagnosis = diagnose(load_case(mission, ()), catalogue().values())
    diagnosis.content()  # checked by the session's fixture
    hypothesis = leading_hypothesis(diagnosis, (name, None))
    record_property("gain", float(hypothesis.gain))
    distance, count = squared_distance(hypothesis.fit, true_effect(mission, hidden))
    record_property("squared_distance", f"{distance:.2f} of {count} parameters")
    assert distance < chi2.isf(REJECTION, count), hypothesis.fit.parameters((name, None))


@pytest.mark.parametrize("vehicle", [pytest.param("mer", marks=pytest.mark.representative), "phoenix"])
def test_a_flight_without_hidden_effects_is_clean(vehicle, tmp_path):
    mission = simulated_mission(vehicle, SEED, [], tmp_path)
    diagnosis = diagnose(load_case(mission, ()), catalogue().values())
    assert diagnosis.content()["verdict"] == "clean", diagnosis.verdict.sentence


def test_a_lifting_entry_without_hidden_effects_is_clean(tmp_path):
    """It oscillates about 7 degrees at 1.2 Hz and is sampled at 8 Hz: attitudes inside a bin are wrong by 0.2 mrad.

    The lever-arm accelerations are a tenth of the axial force, and the checking IMU's misalignment acts on them too.
    """
    offset = EffectInstance(find_effect("com_offset"), {"dz": 0.04})
    path = simulate(Scenario.load("builtin:mer"), [offset], 3).write(tmp_path / "flight.h5")
    stated = "effects=[{name: com_offset, fixed: true, parameters: {dz: 0.04}}]"
    mission = Mission.load("builtin:practice_mer", [f"telemetry.path={path}", stated])
    diagnosis = diagnose(load_case(mission), catalogue().values())
    assert diagnosis.content()["verdict"] == "clean", diagnosis.verdict.sentence


def test_two_hidden_effects_are_named_one_after_the_other(tmp_path):
    pair = PAIRS[0]
    random = np.random.default_rng([SEED, sum(map(ord, "".join(pair))), 10])
    mission = simulated_mission(VEHICLES[0], SEED, [random_instance(name, 1.0, random) for name in pair], tmp_path)
    steps = list(improve(mission, list(catalogue().values())))
    assert sorted(step.added.name for step in steps[:-1]) == sorted(pair)
    assert steps[-1].diagnosis.verdict.verdict == "clean", steps[-1].why_stopped


def test_a_second_torque_is_named_and_both_are_fitted(tmp_path):
    """Two torques that begin at different times: the second is named with the first in the model."""
    first = {"Cl": 0.0, "Cm": 8e-4, "Cn": -5e-4, "t0": 120.0}
    second = {"Cl": 2e-6, "Cm": -6e-4, "Cn": 9e-4, "t0": 180.0}
    torque, second_torque = find_effect("remnant_torque"), find_effect("remnant_torque_2")
    both = (EffectInstance(torque, first), EffectInstance(second_torque, second))
    path = simulate(Scenario.load("builtin:mer"), both, 12).write(tmp_path / "flight.h5")
    mission = Mission.load("builtin:practice_mer", [f"telemetry.path={path}"])
    verdict = decide(rank(load_case(mission, both[:1]), [torque, find_effect("mass")]))
    assert verdict.verdict == "missing" and verdict.leader.name == "remnant_torque_2"
    # and both are a mission file that runs, in which they are fitted together
    text, _ = text_with_effects(mission, verdict.entries[0].hypothesis.fit.effects)
    fitted = fit_effects(Mission.load(write_mission(mission, text, tmp_path / "both.yaml")))
    for instance, true in zip(fitted.reconstruction.effects, (first, second), strict=True):
        sigma = fitted.sigma[instance.name]
        for name, value in true.items():
            assert instance.values[name] == pytest.approx(value, abs=4.0 * sigma[name]), (instance.name, name)


@pytest.mark.representative
def test_an_effect_outside_the_catalogue_is_unknown(tmp_path):
    assert not OUTSIDE.keys() & catalogue().keys()
    mission = simulated_mission("mer", SEED, [random_instance("oscillating_jet", 1.0, None)], tmp_path)
    diagnosis = diagnose(load_case(mission, ()), catalogue().values())
    content = diagnosis.content()
    assert content["verdict"] == "unknown", content["sentence"]
    assert content["remainder"]["channel"] == "moment_y"
    assert content["remainder"]["frequency_hz"] == pytest.approx(OUTSIDE["oscillating_jet"][1]["f"], abs=0.01)


@pytest.mark.parametrize(
    ("name", "regressor"),
    [("jet_damping", "angular rate"), ("spinning_wheel", "angular rate"), ("magnus_moment", "angle of attack")],
)
def test_a_moment_that_follows_the_motion_is_unknown_where_the_model_holds(name, regressor, tmp_path):
    """A tenth of the typical size: in no channel the residuals exceed the noise, and only the phase is significant."""
    effect, values = OUTSIDE_EFFECTS[name]
    small = EffectInstance(effect, {parameter: 0.1 * value for parameter, value in values.items()})
    mission = simulated_mission("mer", SEED, [small], tmp_path)
    diagnosis = diagnose(load_case(mission, ()), catalogue().values())
    failing = {cell.channel for cell in failing_cells(diagnosis.cells)}
    assert diagnosis.ranking.model.holds and not any(c.startswith(("force", "moment")) for c in failing)
    verdict = diagnosis.verdict
    assert verdict.verdict == "unknown", verdict.sentence
    assert f" moment in proportion to the {regressor}" in verdict.sentence
    assert diagnosis.ranking.unmodelled.form == regressor


def test_a_misaligned_second_imu_is_named_and_added_by_commands(tmp_path, monkeypatch):
    """Run, diagnose, add, run, diagnose, with the commands that the first diagnosis prints."""
    monkeypatch.chdir(tmp_path)

    def call(*arguments):
        result = CliRunner().invoke(app, [str(a) for a in arguments])
        assert result.exit_code == 0, result.output
        return result.stdout

    name = "accelerometer_misalignment"
    hidden = replace(hidden_effect(name, SEED), imu="secondary")
    mission = simulated_mission("mer", SEED, [hidden], tmp_path)
    assert expected_gains(load_case(mission, ()), [hidden])[hidden.name] > DETECTABLE_NATS
    call("run", "builtin:practice_mer", "--set", f"telemetry.path={mission.telemetry_path()}", "-o", "first",
         "--no-figures")  # fmt: skip
    first = json.loads(call("diagnose", "first", "--json"))
    assert first["verdict"] == "missing", first["sentence"]
    leader = first["ranking"][0]
    assert (leader["effect"], leader["imu"]) == (name, "secondary")
    assert leader["label"] == f"{name} in secondary"
    assert first["sentence"].startswith(f"Missing: {name} in secondary")
    for parameter, estimate in leader["parameters"].items():
        assert abs(estimate["estimate"] - hidden.values[parameter]) < 4.0 * estimate["sigma"], parameter
    assert {cell["channel"] for cell in first["where"]} <= {f"secondary_force_{axis}" for axis in "xyz"}

    add, run = (command.split() for command in first["next"])
    assert add[:2] == ["edl-filter", "add"] and add[3:] == [name, "--from", "first", "--imu", "secondary"]
    call(*add[1:])
    call(*run[1:], "--no-figures")
    summary = json.loads(Path(f"first+{name}/summary.json").read_text())
    (refit,) = summary["effects"].values()
    assert refit["imu"] == "secondary"
    second = json.loads(call("diagnose", f"first+{name}", "--json"))
    assert second["verdict"] == "clean", second["sentence"]
    assert second["effects"] == [f"{name} in secondary"] and second["where"] == []
