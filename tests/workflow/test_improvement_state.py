"""An improvement that is killed between two steps goes on where it stopped, with the same model."""

import json
from functools import partial
from types import SimpleNamespace

import pytest
from contents import diagnosis as diagnosis_of
from contents import hypothesis, ledger_step

from edl_filter.diagnosis.stepwise import Step
from edl_filter.effects import EffectInstance
from edl_filter.effects.registry import find_effect
from edl_filter.mission import Mission
from edl_filter.results.files import DIAGNOSIS, LEDGER, RESIDUALS, RESULT
from edl_filter.results.schema import DiagnosisContent, LedgerStep
from edl_filter.workflow import diagnose_result, improve_model, improvement_state
from edl_filter.workflow.improvement_state import NextStep

NAMES = ("mass", "wind", "gyro_bias")


@pytest.fixture
def mission():
    return Mission.load("builtin:practice_mer")


class Killed(BaseException):
    """In place of a kill: nothing catches it."""


def kill(*_):
    raise Killed


@pytest.fixture
def selection(monkeypatch):
    """A forward selection in place of the diagnosis: three effects, one a step, with sizes that need all digits."""
    diagnosed = []

    def improve(mission, candidates, effects=None, progress=print):
        model = tuple(effects)
        while True:
            diagnosed.append([(a.name, a.values) for a in model])
            diagnosis = SimpleNamespace(
                verdict=SimpleNamespace(verdict="clean", leader=None, entries=[]),
                content=partial(content_of, [a.name for a in model]),
            )
            if len(model) == len(NAMES):
                yield Step(model, diagnosis, None, model)
                return
            effect = find_effect(NAMES[len(model)])
            added = EffectInstance(effect, {q.name: 0.1 / 3.0 * q.sigma for q in effect.sizes})
            yield Step(model, diagnosis, added, (*model, added))
            model = (*model, added)

    def content_of(names):
        name = NAMES[min(len(names), 2)]
        first = hypothesis(effect=name, label=name, parameters={}, gain=9.0, score_gain=8.0, errors_after={})
        return diagnosis_of(effects=names, errors={}, ranking=[first], where=[], map=[])

    monkeypatch.setattr(improve_model, "improve", improve)
    monkeypatch.setattr(improve_model, "_paragraph", lambda k, *_: f"Step {k}")
    return diagnosed


def improved(mission, folder, kill_in=None, monkeypatch=None):
    """Steps of an improvement; `kill_in` names a function of the module at whose call it ends."""
    if kill_in is not None:
        name, call = kill_in
        original, calls = getattr(improve_model, name), []

        def killed(*arguments):
            calls.append(arguments)
            if len(calls) == call:
                raise Killed
            return original(*arguments)

        with monkeypatch.context() as patch:
            patch.setattr(improve_model, name, killed)
            with pytest.raises(Killed):
                list(improve_model.improve_steps(mission, folder))
        return None
    return [step.paragraph for step in improve_model.improve_steps(mission, folder)]


def contents(folder):
    """Bytes of all files of the steps and of the ledger."""
    files = [p for p in sorted(folder.rglob("*")) if p.is_file() and p.name != improvement_state.NAME]
    return {str(p.relative_to(folder)): p.read_bytes() for p in files}


@pytest.mark.parametrize("kill_in", [("write_mission", 3), ("write_json", 3), ("_why_stopped", 3), ("write_json", 1)])
def test_a_killed_improvement_goes_on_with_the_same_files(mission, tmp_path, selection, monkeypatch, kill_in):
    assert improved(mission, tmp_path / "whole") == ["Step 0", "Step 1", "Step 2", "Step 3"]
    selection.clear()
    improved(mission, tmp_path / "killed", kill_in, monkeypatch)
    before = len(selection)
    complete = kill_in[1] - 1
    assert improved(mission, tmp_path / "killed") == [f"Step {k}" for k in range(complete, 4)]
    assert selection[before] == selection[before - 1]  # the incomplete step is diagnosed again, with all digits
    assert contents(tmp_path / "killed") == contents(tmp_path / "whole")


def test_a_kill_between_the_ledger_and_the_state_repeats_one_step(mission, tmp_path, selection, monkeypatch):
    with monkeypatch.context() as patch:
        patch.setattr(improvement_state, "write", kill)
        with pytest.raises(Killed):
            list(improve_model.improve_steps(mission, tmp_path))
    assert len((tmp_path / LEDGER).read_text().splitlines()) == 1
    assert improved(mission, tmp_path) == ["Step 0", "Step 1", "Step 2", "Step 3"]
    assert len((tmp_path / LEDGER).read_text().splitlines()) == 4


def test_a_kill_while_the_final_diagnosis_is_written_leaves_none_of_it(mission, tmp_path, monkeypatch):
    content = DiagnosisContent.of(diagnosis_of(effects=[], errors={}, ranking=[], where=[], map=[]))
    diagnosis = SimpleNamespace(update=None, ranking=SimpleNamespace(model=None))
    last = improve_model.StepFiles(Step((), diagnosis, None, ()), content, mission.text, "Step 0")
    monkeypatch.setattr("edl_filter.report.diagnosis.draw_diagnosis", lambda *_: [])
    monkeypatch.setattr(diagnose_result, "residual_series", kill)  # after diagnosis.json
    with pytest.raises(Killed):
        improve_model.write_final_model(mission, tmp_path, [last])
    assert (tmp_path / RESULT).is_file()
    assert not (tmp_path / DIAGNOSIS).exists() and not (tmp_path / RESIDUALS).exists()


def test_another_mission_or_catalogue_begins_at_the_first_step(mission, tmp_path):
    effects = [find_effect(name) for name in NAMES]
    model = (EffectInstance(effects[0], {"k": 0.1 / 3.0}), EffectInstance(effects[2], {"bx": 1e-7}, "secondary", True))
    mark = improvement_state.fingerprint(mission, effects)
    improvement_state.write(tmp_path, mark, NextStep(2, model))
    read = improvement_state.read(tmp_path, mark, effects)
    assert read is not None and read.number == 2
    assert [(a.key, a.values, a.fixed) for a in read.model] == [(a.key, a.values, a.fixed) for a in model]
    changed = Mission.load("builtin:practice_mer", ["planet.gravity.j2=0"])
    for changed_mark in (
        improvement_state.fingerprint(changed, effects),
        improvement_state.fingerprint(mission, effects[:2]),
    ):
        assert changed_mark != mark and improvement_state.read(tmp_path, changed_mark, effects) is None
    assert improvement_state.read(tmp_path, mark, effects[:1]) is None  # an effect that no longer exists
    (tmp_path / improvement_state.NAME).write_text("{")
    assert improvement_state.read(tmp_path, mark, effects) is None
    improvement_state.remove(tmp_path)
    assert improvement_state.read(tmp_path, mark, effects) is None


def test_a_step_that_was_deleted_is_not_gone_past(mission, tmp_path, selection, monkeypatch):
    improved(mission, tmp_path, ("write_mission", 3), monkeypatch)
    (tmp_path / "step_0" / "diagnosis.json").unlink()
    assert improved(mission, tmp_path)[0] == "Step 0"


def test_the_ledger_keeps_its_first_lines(tmp_path):
    for step in range(3):
        improve_model._append(tmp_path, LedgerStep.of(ledger_step(step=step)))
    improve_model._keep_lines(tmp_path, 2)
    assert [json.loads(x)["step"] for x in (tmp_path / LEDGER).read_text().splitlines()] == [0, 1]
    improve_model._keep_lines(tmp_path, 0)
    assert not (tmp_path / LEDGER).exists()
