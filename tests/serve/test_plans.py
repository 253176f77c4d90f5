"""Commands of each action."""

import json
import shutil

import pytest

from edl_filter.errors import InputError
from edl_filter.mission import Mission
from edl_filter.serve import plans
from edl_filter.serve.safety import ForbiddenError


@pytest.fixture
def write_diagnosis(served_folder):
    """Function that writes the invented diagnosis, with its effect renamed, into a result's folder."""
    content = json.loads((served_folder / "results/flight/diagnosis.json").read_text())

    def write(folder, effect):
        content["ranking"][0] |= {"effect": effect, "label": effect}
        (folder / "diagnosis.json").write_text(json.dumps(content))

    return write


def test_running_a_mission(root):
    plan = plans.plan_run(root, "builtin:practice_mer")
    assert plan.lines() == [
        "edl-filter run builtin:practice_mer -o results/practice_mer",
        "edl-filter diagnose results/practice_mer",
    ]
    assert plan.result == "results/practice_mer"
    assert len(plans.plan_run(root, "builtin:practice_mer", diagnose=False).commands) == 1


def test_a_run_replaces_only_a_result_of_the_same_mission(served_folder):
    assert plans.plan_run(served_folder, "flight.yaml").result == "results/flight"
    (served_folder / "more").mkdir()
    try:
        (served_folder / "more" / "flight.yaml").write_text((served_folder / "flight.yaml").read_text())
        assert plans.plan_run(served_folder, "more/flight.yaml").result == "results/flight-2"
    finally:  # other tests use the folder
        shutil.rmtree(served_folder / "more")


def test_a_folder_without_files_is_free(root):
    (root / "more.yaml").write_text((root / "flight.yaml").read_text())
    (root / "results" / "more" / "figures").mkdir(parents=True)
    (root / "results" / "more" / ".edl-filter.x").mkdir()
    (root / "results" / "more" / ".edl-filter.x" / "half").touch()
    assert plans.plan_run(root, "more.yaml").result == "results/more"
    (root / "results" / "more" / "notes.txt").touch()
    assert plans.plan_run(root, "more.yaml").result == "results/more-2"


def test_improving_and_detectable_sizes(root):
    plan = plans.plan_improve(root, "flight.yaml")
    assert (plan.lines(), plan.result) == (
        ["edl-filter improve flight.yaml -o results/flight_improved"], "results/flight_improved"
    )  # fmt: skip
    plan = plans.plan_identifiability(root, "builtin:mer_a")
    assert (plan.lines(), plan.result) == (["edl-filter identifiability builtin:mer_a"], "")
    for make in (plans.plan_improve, plans.plan_identifiability):
        with pytest.raises(ForbiddenError):
            make(root, "../flight.yaml")


def test_names_that_look_like_options_or_need_quotes(root):
    for name, command in (("-o.yaml", "run ./-o.yaml -o results/-o"), ("a b.yaml", "run 'a b.yaml' -o 'results/a b'")):
        (root / name).write_text((root / "flight.yaml").read_text())
        assert plans.plan_run(root, name).lines()[0] == f"edl-filter {command}"


def test_adding_an_effect(served_folder):
    plan = plans.plan_add(served_folder.resolve(), "results/flight", "wind")
    assert plan.lines() == [
        "edl-filter add flight.yaml wind --from results/flight -o flight+wind.yaml",
        "edl-filter run flight+wind.yaml -o results/flight+wind",
        "edl-filter diagnose results/flight+wind",
    ]


def test_adding_an_effect_of_the_users_file(root):
    path = root / "results/flight/diagnosis.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | {"own_effects": {"wind": "my effect.py"}}))
    assert "--file" not in plans.plan_add(root, "results/flight", "wind").lines()[0]
    (root / "my effect.py").touch()
    assert " wind --file 'my effect.py' --from " in plans.plan_add(root, "results/flight", "wind").lines()[0]


def test_adding_another_name_of_a_hypothesis(served_folder):
    plan = plans.plan_add(served_folder.resolve(), "results/flight", "com_offset")
    assert plan.lines()[0] == "edl-filter add flight.yaml com_offset --from results/flight -o flight+com_offset.yaml"


def test_an_earlier_attempt_is_not_replaced(served_folder):
    (served_folder / "flight+wind.yaml").write_text("an earlier attempt")
    try:
        assert plans.plan_add(served_folder.resolve(), "results/flight", "wind").result == "results/flight+wind-2"
    finally:
        (served_folder / "flight+wind.yaml").unlink()


def test_only_hypotheses_of_the_diagnosis_can_be_added(root, write_diagnosis):
    with pytest.raises(InputError, match="found no estimate of '--help'; it has estimates of com_offset, wind"):
        plans.plan_add(root, "results/flight", "--help")
    write_diagnosis(root / "results/flight", "mass")
    assert plans.plan_add(root, "results/flight", "mass").result == "results/flight+mass"


def test_a_mission_without_accessible_file_is_written_to_its_results_folder(root):
    # the result in the copy names the mission file of the original folder
    plan = plans.plan_add(root, "results/flight", "wind")
    assert plan.lines()[0] == (
        "edl-filter add results/flight/mission_as_run.yaml wind --from results/flight "
        "-o results/flight/mission_as_run+wind.yaml"
    )
    assert not (root / "results/flight/mission_as_run.yaml").exists()
    plans.prepare_add(root, "results/flight")
    assert Mission.load(root / "results/flight/mission_as_run.yaml").name == "practice_mer"


@pytest.mark.parametrize("path", ["..", "/etc", "../served/results/flight"])
def test_paths_out_of_the_folder_are_refused(root, path):
    for plan in (plans.plan_run, plans.plan_diagnose):
        with pytest.raises(ForbiddenError):
            plan(root, path)
    with pytest.raises(ForbiddenError):
        plans.plan_add(root, path, "wind")


def test_results_behind_a_symlink_out_of_the_folder_are_refused(served_folder, tmp_path):
    root = tmp_path / "served"
    root.mkdir()
    (root / "flight.yaml").write_text((served_folder / "flight.yaml").read_text())
    (root / "results").symlink_to(tmp_path)
    with pytest.raises(ForbiddenError, match="leads out"):
        plans.plan_run(root.resolve(), "flight.yaml")
