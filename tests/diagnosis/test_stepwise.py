"""Stepwise selection with a constructed diagnosis: what is added, what is removed again, and where it ends."""

from types import SimpleNamespace

import pytest

from edl_filter.diagnosis import stepwise as module
from edl_filter.diagnosis.stepwise import Step, improve
from edl_filter.effects import EffectInstance
from edl_filter.effects.registry import find_effect
from edl_filter.mission.decision_settings import DecisionSettings

WIND, ROTATION, TORQUE = (
    EffectInstance(find_effect(name), {}) for name in ("wind", "atmosphere_rotation", "remnant_torque")
)


@pytest.fixture
def selection(monkeypatch):
    """Run a selection: names in the order of their diagnoses, and gains over zero by (effect, number of effects)."""

    def run(named, gains, own=(), limit=12, progress=lambda _: None):
        queue = list(named)

        def diagnose(case, candidates, progress):
            leader = queue.pop(0) if queue else None
            entries = [
                SimpleNamespace(hypothesis=SimpleNamespace(fit=SimpleNamespace(effects=(*case, effect))))
                for effect in (leader, TORQUE)
            ]
            return SimpleNamespace(verdict=SimpleNamespace(leader=leader, entries=entries))

        def fit_effects(mission, progress, effects):
            sizes = {a.key: gains.get((a.name, len(effects)), 100.0) for a in effects}
            return SimpleNamespace(reconstruction=SimpleNamespace(effects=tuple(effects)), gain_over_zero=sizes)

        monkeypatch.setattr(module, "load_case", lambda mission, model: tuple(model))
        monkeypatch.setattr(module, "diagnose", diagnose)
        monkeypatch.setattr(module, "fit_effects", fit_effects)
        mission = SimpleNamespace(
            active_effects=lambda: tuple(own), diagnosis=DecisionSettings().model_copy(update={"max_effects": limit})
        )
        return [
            ([a.name for a in s.model], s.added and s.added.name, [a.name for a in s.removed])
            for s in improve(mission, [], progress=progress)
        ]

    return run


def test_an_effect_that_the_next_one_replaces_is_removed(selection):
    """With the rotation in the model a wind is no longer needed; the rotation itself stays, whatever its gain."""
    steps = selection([WIND, ROTATION], {("wind", 2): 5.9, ("atmosphere_rotation", 2): 1.0})
    assert steps == [
        ([], "wind", []), (["wind"], "atmosphere_rotation", ["wind"]), (["atmosphere_rotation"], None, [])
    ]  # fmt: skip


def test_an_effect_with_the_evidence_of_a_name_stays(selection):
    gain = DecisionSettings().named_gain_nats
    assert selection([WIND, ROTATION], {("wind", 2): gain})[-1] == (["wind", "atmosphere_rotation"], None, [])


def test_the_least_needed_is_removed_first_and_the_others_are_fitted_again(selection):
    """Without it the other one may have the evidence."""
    gains = {("wind", 3): 3.0, ("remnant_torque", 3): -2.0}
    steps = selection([WIND, TORQUE, ROTATION], gains)
    assert steps[2] == (["wind", "remnant_torque"], "atmosphere_rotation", ["remnant_torque"])
    assert steps[-1][0] == ["wind", "atmosphere_rotation"]
    steps = selection([WIND, TORQUE, ROTATION], gains | {("wind", 2): 1.0})
    # wind is alone with the torque in the second step
    assert steps[1] == (["wind"], "remnant_torque", ["wind"])


def test_removal_is_reported(selection):
    messages = []
    selection([WIND, ROTATION], {("wind", 2): 0.0}, progress=messages.append)
    assert messages == ["removing wind"]


def test_the_model_has_at_most_the_largest_number_of_effects(selection):
    steps = selection([WIND, TORQUE, ROTATION], {}, limit=2)
    assert [added for _, added, _ in steps] == ["wind", "remnant_torque", None]
    assert steps[-1][0] == ["wind", "remnant_torque"]


def test_effects_of_the_mission_are_never_removed(selection):
    steps = selection([ROTATION], {("wind", 2): -50.0}, own=[WIND])
    assert steps[0] == (["wind"], "atmosphere_rotation", [])


def test_an_effect_that_comes_back_stays(selection):
    """Otherwise two names could replace each other without end."""
    gains = {("wind", 2): 0.0, ("atmosphere_rotation", 2): 0.0}
    steps = selection([WIND, ROTATION, WIND, ROTATION], gains, limit=3)
    assert [added for _, added, _ in steps[:3]] == ["wind", "atmosphere_rotation", "wind"]
    assert [removed for *_, removed in steps[:3]] == [[], ["wind"], ["atmosphere_rotation"]]
    assert steps[3] == (["wind"], "atmosphere_rotation", [])
    assert steps[4][1:] == (None, [])


def test_the_last_step_says_why_it_is_the_last():
    """The noise is reached, no effect explains the remainder, or the largest number of effects is in the model."""
    best, second = (
        SimpleNamespace(hypothesis=SimpleNamespace(label=label, gain=gain, score_gain=19.0))
        for label, gain in (("wind", 20.0), ("mass", 18.0))
    )

    def why(label, leader, entries, model=(), added=None):
        verdict = SimpleNamespace(verdict=label, leader=leader, entries=entries)
        return Step(model, SimpleNamespace(verdict=verdict), added, ()).why_stopped

    assert why("clean", None, [best]) == "Stopped: model and measurement agree to the stated noise."
    assert why("unknown", None, [best, second]) == (
        "Stopped: something is missing that no effect of the catalogue explains; the best, wind, would gain 20.0 nats "
        "and 19.0 on held-out data."
    )
    assert why("unknown", None, []).endswith("no effect of the catalogue explains any of it.")
    last = why("missing", "wind", [best, second], (TORQUE, ROTATION))
    assert last.startswith("Stopped: the model still fails with 2 effects, the largest number allowed; the next would ")
    assert "would be wind (gain 20.0 nats)" in last
    assert why("missing", "wind", [best], added=WIND) == ""
