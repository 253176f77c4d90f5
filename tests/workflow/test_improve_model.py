"""`edl-filter improve`, `compare` and the refit of a run, on the shipped flight with no oblateness in the mission."""

import json
from pathlib import Path
from types import SimpleNamespace

import pytest
from contents import diagnosis, unknown
from typer.testing import CliRunner

from edl_filter.cli import app
from edl_filter.diagnosis.stepwise import Step
from edl_filter.effects import EffectInstance
from edl_filter.effects.registry import find_effect
from edl_filter.mission import Mission
from edl_filter.mission.edit_effects import text_with_effects
from edl_filter.results.files import read_diagnosis, read_ledger, read_summary
from edl_filter.results.schema import DiagnosisContent
from edl_filter.workflow.improve_model import _why_stopped

pytestmark = pytest.mark.slow

POINT_MASS = ("--set", "planet.gravity.j2=0")
TRUE_J2 = 1.960454e-3


def call(*arguments):
    return CliRunner().invoke(app, [str(a) for a in arguments])


def assert_refused(result, *parts):
    """The command ends with an input error whose message has these parts."""
    assert result.exit_code == 2, result.output
    assert "Traceback" not in result.stderr
    for part in parts:
        assert part in result.stderr


@pytest.fixture(scope="module")
def improved(tmp_path_factory):
    """Folder of an improved mission without oblateness, and the text that was printed."""
    folder = tmp_path_factory.mktemp("improved")
    result = call("improve", "builtin:practice_mer", "-o", folder / "out", *POINT_MASS,
                  "--effect", "gravity_oblateness", "--effect", "gyro_bias")  # fmt: skip
    assert result.exit_code == 0, result.output
    return folder / "out", result.stdout


def test_improve_writes_every_step(improved):
    out, printed = improved
    lines = [json.loads(line) for line in (out / "ledger.jsonl").read_text().splitlines()]
    assert [line["added"] for line in lines] == ["gravity_oblateness", None]
    assert lines[1]["why"].startswith("Stopped: model and measurement agree")
    assert "Added gravity_oblateness (J2 0.00" in printed and "Stopped: model and measurement agree" in printed
    models = [[e.name for e in Mission.load(out / f"step_{k}" / "mission.yaml").effects] for k in (0, 1)]
    assert models == [[], ["gravity_oblateness"]]
    verdicts = [json.loads((out / f"step_{k}" / "diagnosis.json").read_text())["verdict"] for k in (0, 1)]
    assert verdicts == ["missing", "clean"]
    names = {p.name for p in out.iterdir()}
    assert {"mission.yaml", "result.nc", "summary.json", "diagnosis.json", "ledger.jsonl"} <= names
    assert (out / "figures" / "ledger.png").is_file()
    j2 = json.loads((out / "summary.json").read_text())["effects"]["gravity_oblateness"]["parameters"]["J2"]
    assert abs(j2["estimate"] - TRUE_J2) < 3.0 * j2["sigma"] and j2["unit"] == ""


def test_the_files_satisfy_their_schemas(improved):
    """The readers forbid unknown keys and miss none; written again, the contents are the same."""
    out, _ = improved
    for folder in (out, out / "step_0", out / "step_1"):
        content = json.loads((folder / "diagnosis.json").read_text())
        assert json.loads(read_diagnosis(folder).model_dump_json(exclude_unset=True)) == content
    lines = [json.loads(line) for line in (out / "ledger.jsonl").read_text().splitlines()]
    assert [json.loads(line.model_dump_json()) for line in read_ledger(out)] == lines
    assert json.loads(read_summary(out).model_dump_json(exclude_unset=True)) == json.loads(
        (out / "summary.json").read_text()
    )


def test_a_remainder_that_no_effect_explains_is_described():
    verdict = SimpleNamespace(verdict="unknown", leader=None, entries=[])
    last = Step((), SimpleNamespace(verdict=verdict), None, ())
    description = "moment_y from 62 to 170 s: 4.9 N m RMS; it oscillates at 0.680 Hz."
    remainder = unknown()["remainder"] | {"description": description}
    text = _why_stopped(last, DiagnosisContent.of(unknown() | {"remainder": remainder}), False)
    assert text.endswith(f"explains any of it. What is left: {description}")
    assert _why_stopped(last, DiagnosisContent.of(diagnosis(remainder=None)), False).endswith("explains any of it.")


def test_the_ledger_of_another_mission_is_refused(improved, tmp_path):
    out, _ = improved
    text = (out / "mission.yaml").read_text().replace("name: practice_mer", "name: other", 1)
    (tmp_path / "other.yaml").write_text(text)
    before = (out / "ledger.jsonl").read_text()
    assert_refused(
        call("improve", tmp_path / "other.yaml", "-o", out), "found the ledger of 'practice_mer'; expected none"
    )
    assert (out / "ledger.jsonl").read_text() == before


def test_a_run_refits_from_any_start_unless_switched_off(improved, tmp_path):
    out, _ = improved
    start = ("--set", "effects.0.parameters.J2=0.001")
    for name, more in (("fitted", ()), ("held", ("--no-refit",)), ("fixed", ("--set", "effects.0.fixed=true"))):
        result = call("run", out / "mission.yaml", "-o", tmp_path / name, "--no-figures", *start, *more)
        # a wrong J2 that is not fitted contradicts gravity at rest
        assert result.exit_code == (0 if name == "fitted" else 3), result.output
    summaries = {n: json.loads((tmp_path / n / "summary.json").read_text()) for n in ("fitted", "held", "fixed")}
    j2 = {n: s["effects"]["gravity_oblateness"]["parameters"]["J2"] for n, s in summaries.items()}
    assert abs(j2["fitted"]["estimate"] - TRUE_J2) < 3.0 * j2["fitted"]["sigma"] and j2["fitted"]["start"] == 1e-3
    for name in ("held", "fixed"):
        assert j2[name] == {"estimate": 1e-3, "sigma": None, "unit": "", "start": 1e-3}
    assert 0.8 < summaries["fitted"]["residuals"]["force_x"]["overall"] < 1.2
    assert "force_x" not in summaries["held"]["residuals"]

    result = call("compare", tmp_path / "held", tmp_path / "fitted", out, "--json")
    assert result.exit_code == 0, result.output
    comparison = json.loads(result.stdout)
    assert [r["verdict"] for r in comparison["results"]] == [None, None, "clean"]
    diagnosis = json.loads((out / "diagnosis.json").read_text())
    assert comparison["results"][2]["residuals"] == diagnosis["errors"]
    assert {r["minimum_rms"] for r in comparison["results"]} == {diagnosis["settings"]["cell_minimum_rms"]}
    first, last = (comparison["results"][k] for k in (0, 2))
    for channel, fall in comparison["fall_percent"].items():
        assert fall == pytest.approx(100.0 * (1.0 - last["residuals"][channel] / first["residuals"][channel]))
    assert last["nis_per_dof"].keys() == first["nis_per_dof"].keys() >= {"landing", "altimeter"}
    table = call("compare", tmp_path / "held", tmp_path / "fitted").stdout
    assert "Normalised RMS of the residuals, by channel" in table and "gravity_oblateness" in table


def test_an_effect_that_is_in_the_mission_twice_is_not_refitted(tmp_path):
    twice = "effects=[{name: gyro_bias}, {name: gyro_bias, imu: primary}]"
    assert_refused(call("run", "builtin:practice_mer", "--set", twice, "-o", tmp_path / "out"), "found gyro_bias twice",
            "--no-refit")  # fmt: skip
    assert not (tmp_path / "out").exists()


def test_only_results_of_one_flight_are_compared(improved, tmp_path):
    import h5py

    out, _ = improved
    (tmp_path / "other").mkdir()
    path = tmp_path / "other" / "result.nc"
    path.write_bytes((out / "result.nc").read_bytes())
    with h5py.File(path, "r+") as file:
        file.attrs["input_sha256"] = '{"flight.h5": "0123456789"}'
    assert_refused(call("compare", out, path), f"{path}: found another flight than in", "flight.h5 01234567 against")
    assert_refused(call("compare", out), "compare: found 1 result; two or more are expected")


def test_a_model_becomes_the_text_of_a_mission(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    mission = Mission.load("builtin:practice_mer", ["effects=[{name: mass, parameters: {k: 0.01}}, {name: wind}]"])
    Path("mine.py").write_text(
        "from edl_filter.effects import Effect, Parameter\n"
        "class Mine(Effect):\n"
        "    name = 'mine'\n"
        "    parameters = (Parameter('a', 'N', 'how much', 1.0, low=-9.0, high=9.0),)\n"
    )

    mass, wind = mission.active_effects()
    model = [
        EffectInstance(mass.effect, {"k": 0.02}),
        EffectInstance(wind.effect, wind.values | {"east": 12.0}),
        EffectInstance(find_effect("gyro_bias"), {"bx": 1e-5}, "secondary"),
        EffectInstance(find_effect("mine", Path("mine.py")), {"a": 2.0}),
    ]
    text, session = text_with_effects(mission, model)
    assert session == ()
    effects = Mission.from_text(text, "reread", mission.source).active_effects()
    assert [(a.name, a.values, a.imu) for a in effects] == [(a.name, a.values, a.imu) for a in model]
