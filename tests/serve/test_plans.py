"""Which commands a click means."""

import json
import shutil

import pytest

from edl_filter.errors import InputError
from edl_filter.mission import Mission
from edl_filter.serve import plans
from edl_filter.serve.safety import ForbiddenError


@pytest.fixture
def diagnosis(made):
    """Function that writes the made-up diagnosis, its one effect renamed, beside a result."""
    told = json.loads((made / "results/flight/diagnosis.json").read_text())

    def write(folder, effect):
        told["ranking"][0]["effect"] = effect
        (folder / "diagnosis.json").write_text(json.dumps(told))

    return write


def test_running_a_mission(root):
    plan = plans.plan_run(root, "builtin:practice_mer")
    assert plan.lines() == [
        "edl-filter run builtin:practice_mer -o results/practice_mer",
        "edl-filter diagnose results/practice_mer",
    ]
    assert plan.result == "results/practice_mer"
    assert len(plans.plan_run(root, "builtin:practice_mer", diagnose=False).commands) == 1


def test_a_result_of_its_own_mission_is_made_again_and_no_other_is_replaced(made):
    assert plans.plan_run(made, "flight.yaml").result == "results/flight"
    (made / "more").mkdir()
    try:
        (made / "more" / "flight.yaml").write_text((made / "flight.yaml").read_text())
        assert plans.plan_run(made, "more/flight.yaml").result == "results/flight-2"
    finally:  # the folder serves other tests too
        shutil.rmtree(made / "more")


def test_names_that_look_like_options_or_need_quotes(root):
    for name, said in (("-o.yaml", "run ./-o.yaml -o results/-o"), ("a b.yaml", "run 'a b.yaml' -o 'results/a b'")):
        (root / name).write_text((root / "flight.yaml").read_text())
        assert plans.plan_run(root, name).lines()[0] == f"edl-filter {said}"


def test_adding_an_effect(made):
    plan = plans.plan_add(made.resolve(), "results/flight", "wind")
    assert plan.lines() == [
        "edl-filter add flight.yaml wind --from results/flight -o flight+wind.yaml",
        "edl-filter run flight+wind.yaml -o results/flight+wind",
        "edl-filter diagnose results/flight+wind",
    ]


def test_adding_another_name_of_a_hypothesis(made):
    plan = plans.plan_add(made.resolve(), "results/flight", "com_offset")
    assert plan.lines()[0] == "edl-filter add flight.yaml com_offset --from results/flight -o flight+com_offset.yaml"


def test_an_earlier_attempt_is_left_alone(made):
    (made / "flight+wind.yaml").write_text("an earlier attempt")
    try:
        assert plans.plan_add(made.resolve(), "results/flight", "wind").result == "results/flight+wind-2"
    finally:
        (made / "flight+wind.yaml").unlink()


def test_only_hypotheses_of_the_diagnosis_can_be_added(root, diagnosis):
    with pytest.raises(InputError, match="found no estimate of '--help'; it has estimates of com_offset, wind"):
        plans.plan_add(root, "results/flight", "--help")
    diagnosis(root / "results/flight", "mass")
    assert plans.plan_add(root, "results/flight", "mass").result == "results/flight+mass"


def test_a_mission_that_no_file_in_the_folder_says_is_written_beside_its_result(root):
    # the copy's result names the mission file that it was made from, which lies elsewhere
    plan = plans.plan_add(root, "results/flight", "wind")
    assert plan.lines()[0] == (
        "edl-filter add results/flight/mission_as_run.yaml wind --from results/flight "
        "-o results/flight/mission_as_run+wind.yaml"
    )
    assert not (root / "results/flight/mission_as_run.yaml").exists()
    plans.prepare_add(root, "results/flight")
    assert Mission.load(root / "results/flight/mission_as_run.yaml").name == "practice_mer"


@pytest.mark.parametrize("path", ["..", "/etc", "../served/results/flight"])
def test_paths_that_lead_out(root, path):
    for plan in (plans.plan_run, plans.plan_diagnose):
        with pytest.raises(ForbiddenError):
            plan(root, path)
    with pytest.raises(ForbiddenError):
        plans.plan_add(root, path, "wind")


def test_results_that_a_symlink_would_lead_out(made, tmp_path):
    root = tmp_path / "served"
    root.mkdir()
    (root / "flight.yaml").write_text((made / "flight.yaml").read_text())
    (root / "results").symlink_to(tmp_path)
    with pytest.raises(ForbiddenError, match="leads out"):
        plans.plan_run(root.resolve(), "flight.yaml")
