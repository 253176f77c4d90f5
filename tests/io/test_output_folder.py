"""Output folders: checked before the work, locked while it lasts, left as they were."""

import resource
import shutil
from pathlib import Path

import pytest

from edl_filter.errors import InputError, InterruptedCommandError
from edl_filter.io import output_folder as output_folder_module
from edl_filter.io.atomic import replace_with, write_through_memory
from edl_filter.io.output_folder import STAGING, complete_output, interrupted, output_folder, staged_output


def test_a_second_command_is_refused_until_the_first_has_ended(tmp_path):
    folder = tmp_path / "out"
    with output_folder(folder):
        with (
            pytest.raises(InputError, match="out: another edl-filter command writes this folder"),
            output_folder(folder),
        ):
            pass
        assert folder.is_dir()
    with output_folder(folder):
        (folder / "file").write_text("x")
    assert [p.name for p in folder.iterdir()] == ["file"]


def test_a_folder_into_which_nothing_was_written_is_removed(tmp_path):
    with pytest.raises(RuntimeError), output_folder(tmp_path / "a" / "b"):
        raise RuntimeError
    assert not list(tmp_path.iterdir())


def test_a_folder_that_cannot_be_written_is_reported_before_the_computation(tmp_path):
    (tmp_path / "file").write_text("x")
    for place in (tmp_path / "file", tmp_path / "file" / "out"):
        with pytest.raises(InputError, match="cannot be written"), output_folder(place):
            pytest.fail("the work has begun")


def test_unfinished_output_of_a_killed_command_is_removed(tmp_path):
    (tmp_path / f"{STAGING}abc").mkdir()
    (tmp_path / f"{STAGING}abc" / "result.nc").write_text("x")
    with output_folder(tmp_path):
        assert not list(tmp_path.iterdir())


def test_a_full_disk_is_one_sentence_and_the_old_file_stays(tmp_path):
    path = tmp_path / "result.nc"
    path.write_text("old")

    def write(temporary):
        write_through_memory(temporary, lambda file: file.create_dataset("x", data=[0.0] * 9999))

    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (10_000, before[1]))
    try:
        with pytest.raises(InputError, match=r"result\.nc: cannot be written \(File too large\)"):
            replace_with(path, write)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert path.read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["result.nc"]


def files_of(folder):
    return {str(p.relative_to(folder)): p.read_text() for p in sorted(folder.rglob("*")) if p.is_file()}


OLD = {"result.nc": "old", "summary.json": "old", "figures/a.png": "old", "diagnosis.json": "old"}
NEW = {"result.nc": "new", "summary.json": "new", "tables/t.csv": "new"}


class Killed(BaseException):
    pass


@pytest.mark.parametrize("operation", range(40))
def test_output_is_old_or_new_whatever_operation_is_the_last(operation, tmp_path, monkeypatch):
    for name, text in OLD.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    count = [0]

    def counted(function):
        def call(*args, **options):
            if count[0] >= operation:
                raise Killed
            count[0] += 1
            return function(*args, **options)

        return call

    with monkeypatch.context() as patch:  # a killed program runs no cleaning up either
        for method in ("write_text", "rename", "replace", "unlink", "mkdir"):
            patch.setattr(Path, method, counted(getattr(Path, method)))
        patch.setattr(output_folder_module.shutil, "rmtree", counted(shutil.rmtree))
        try:
            with staged_output(tmp_path, lambda _: ["figures/a.png", "diagnosis.json"]) as staged:
                for name, text in NEW.items():
                    (staged / name).parent.mkdir(exist_ok=True)
                    (staged / name).write_text(text)
        except Killed:
            assert operation < 30
    committed = (tmp_path / f"{STAGING}commit").is_dir() or (count[0] == operation and operation >= 30)
    complete_output(tmp_path)
    with output_folder(tmp_path):
        pass
    assert files_of(tmp_path) in ((NEW,) if committed or operation >= 30 else (OLD, NEW))


@pytest.mark.parametrize("outcome", ["All of it is kept.", lambda: "All of it is kept."])
def test_ctrl_c_says_what_was_kept_and_other_exceptions_pass(outcome):
    with pytest.raises(InterruptedCommandError, match="All of it is kept"), interrupted(outcome):
        raise KeyboardInterrupt
    with pytest.raises(InputError, match="wrong"), interrupted(outcome):
        raise InputError("wrong")
