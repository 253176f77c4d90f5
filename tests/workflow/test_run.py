"""Files of a run, and `run_into_folder`: the order of what a caller displays, with the process that draws figures."""

from contextlib import contextmanager
from pathlib import Path

import pytest

from edl_filter import results
from edl_filter.errors import InputError, InterruptedCommandError
from edl_filter.io.output_folder import output_folder
from edl_filter.results import Result
from edl_filter.workflow import run
from edl_filter.workflow.run import run_into_folder, write_outputs

MISSION = "builtin:practice_mer"


class Display:
    """Records what is displayed."""

    def __init__(self):
        self.calls = []

    @contextmanager
    def task(self, name):
        self.calls.append(f"begin {name}")
        yield lambda step: self.calls.append(f"step {step}")
        self.calls.append(f"end {name}")

    def replaces(self, sentence):
        self.calls.append(sentence)

    def written(self, outputs):
        assert outputs["result"].is_file() and outputs["report"].is_file() and outputs["figures"] == []
        self.calls.append("written")


@pytest.fixture
def display(monkeypatch, practice_06):
    """Record of a run whose reconstruction and figures are at hand."""
    shown = Display()

    class Figures:
        """Stands for `FigureProcess`."""

        def __enter__(self):
            shown.calls.append("process begins")
            return self

        def __exit__(self, *_):
            shown.calls.append("process ends")

        def start(self, result, folder, formats):
            shown.calls.append(f"draw {formats}")
            self.folder = folder

        def wait(self):
            return [self.folder / "altitude.png"]

    def run_mission(mission, refit, progress):
        with (
            pytest.raises(InputError, match="another edl-filter command writes this folder"),
            output_folder(Path("out")),
        ):
            pass
        progress(f"{mission.name} {refit} {mission.vehicle.mass}")
        return Result(practice_06)

    monkeypatch.setattr("edl_filter.report.figure_process.FigureProcess", Figures)
    monkeypatch.setattr(run, "run_mission", run_mission)
    return shown


def test_a_run_is_displayed_in_the_order_of_its_work(tmp_path, monkeypatch, display):
    monkeypatch.chdir(tmp_path)
    outputs = run_into_folder(MISSION, Path("out"), ["vehicle.mass=800"], True, False, ("svg",), display)
    task = "Reconstructing Practice flight, MER-like vehicle"
    assert display.calls == [
        "process begins", f"begin {task}", "step practice_mer False 800.0", f"end {task}",
        "begin Writing results", "draw ('svg',)", "end Writing results", "written",
        "begin Drawing figures", "end Drawing figures", "process ends",
    ]  # fmt: skip
    assert outputs["figures"] == [Path("out/figures/altitude.png")] and outputs["result"] == Path("out/result.nc")


def test_a_second_run_without_figures_says_first_what_it_replaces(tmp_path, monkeypatch, display):
    monkeypatch.chdir(tmp_path)
    for figures, changes in ((False, []), (True, ["outputs.figures=false"])):
        display.calls.clear()
        assert run_into_folder(MISSION, Path("out"), changes, figures, True, ("png",), display)["figures"] == []
        assert not any("process" in call or "figures" in call for call in display.calls)
    assert display.calls[0] == "out holds an earlier result; it is replaced."
    assert display.calls[1].startswith("begin Reconstructing")


def test_an_interrupted_run_has_kept_the_result_if_it_was_written(tmp_path, monkeypatch, display):
    monkeypatch.chdir(tmp_path)

    def interrupt(*_):
        raise KeyboardInterrupt

    arguments = MISSION, Path("out"), (), False, True, ("png",), display
    with monkeypatch.context() as patch:
        patch.setattr(display, "written", interrupt)
        with pytest.raises(InterruptedCommandError, match=r"^The result is complete; .*: edl-filter figures out$"):
            run_into_folder(*arguments)
    monkeypatch.setattr(run, "run_mission", interrupt)
    with pytest.raises(InterruptedCommandError, match=r"^Nothing was written; what out held before is unchanged\.$"):
        run_into_folder(*arguments)


def test_the_folder_is_the_missions_own_if_none_is_named(tmp_path, monkeypatch, display):
    monkeypatch.chdir(tmp_path)

    def check_output_names(folder):
        raise InputError(str(folder))

    monkeypatch.setattr(run, "check_output_names", check_output_names)
    with pytest.raises(InputError, match=r"^results/practice_mer$"):
        run_into_folder(MISSION, None, (), False, True, ("png",), display)
    assert not Path("results").exists()


def test_old_figures_do_not_stay_beside_a_new_result(practice_06, tmp_path):
    figures = tmp_path / "figures"
    figures.mkdir()
    for name in ("leave_one_out.png", "mine.png"):
        (figures / name).touch()
    write_outputs(Result(practice_06), tmp_path, figures=False)
    assert {p.name for p in figures.iterdir()} == {"mine.png"}
    (figures / "mine.png").rename(figures / "leave_one_out.png")
    write_outputs(Result(practice_06), tmp_path, figures=False)
    assert {p.name for p in tmp_path.iterdir()} == {
        "result.nc",
        "summary.json",
        "report.html",
        "plotly.min.js",
        "tables",
    }


def test_a_failed_writing_leaves_the_earlier_run(practice_06, tmp_path, monkeypatch):
    (tmp_path / "figures").mkdir()
    old = [tmp_path / name for name in ("result.nc", "summary.json", "figures/leave_one_out.png")]
    for path in old:
        path.write_text("old")

    def broken(*_):
        raise RuntimeError("no tables")

    monkeypatch.setattr("edl_filter.results.postflight.tables", broken)
    with pytest.raises(RuntimeError, match="no tables"):
        write_outputs(Result(practice_06), tmp_path, figures=True)
    assert {p for p in tmp_path.rglob("*") if p.is_file()} == set(old)
    assert {p.read_text() for p in old} == {"old"}


def test_the_result_is_complete_before_the_figures(practice_06, tmp_path, monkeypatch):
    complete = []

    def broken(self):
        complete.extend(sorted(p.name for p in tmp_path.iterdir()))
        raise RuntimeError("no font")

    monkeypatch.setattr("edl_filter.report.figure_process.FigureProcess.wait", broken)
    with pytest.raises(RuntimeError, match="no font"):
        write_outputs(Result(practice_06), tmp_path, figures=True)
    assert {"plotly.min.js", "report.html", "result.nc", "summary.json", "tables"} <= set(complete)
    assert results.read(tmp_path).attrs["mission"] == "practice_mer"
