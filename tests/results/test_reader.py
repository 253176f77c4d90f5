"""The reader of a result: the same contents from folder, tree and groups, and messages for bad inputs."""

import json
import re
import shutil

import h5py
import numpy as np
import pytest
from contents import diagnosis, ledger_end, ledger_step

from edl_filter.errors import InputError
from edl_filter.results import Result, hdf5, write
from edl_filter.results.files import write_json
from edl_filter.results.groups import Group
from edl_filter.results.reader import AFTER_LANDING, ResultReader
from edl_filter.results.residual_series import ResidualSeries


@pytest.fixture(scope="module")
def result(practice_06):
    return Result(practice_06)


@pytest.fixture(scope="module")
def written(result, tmp_path_factory):
    """A folder with ``result.nc``, ``summary.json`` and ``diagnosis.json``; tests must not change it."""
    folder = tmp_path_factory.mktemp("written")
    write(result.groups, folder / "result.nc")
    write_json(result.summary(), folder / "summary.json")
    write_json(diagnosis(), folder / "diagnosis.json")
    return folder


@pytest.fixture
def folder(written, tmp_path):
    return shutil.copytree(written, tmp_path / "result")


def residuals(path, **changes):
    group = Group()
    group.add("time", ("time",), np.arange(3.0), "s", "time")
    group.label("channel", ["force_x", "force_y"], "channel")
    group.text("unit", "channel", ["m/s^2", "m/s^2"], "unit")
    for name in ("residual", "sigma", "normalised"):
        if name not in changes.get("without", ()):
            group.add(name, ("channel", "time"), np.ones((2, 3)), "1", name)
    write({"/": group}, path)


def test_folder_tree_and_groups_have_the_same_contents(result, written):
    with ResultReader.open(written) as from_folder:
        for reader in (ResultReader.of(result.to_xarray()), ResultReader.of(result.groups)):
            assert reader.title == from_folder.title and reader.events == from_folder.events
            assert reader.phases == from_folder.phases == ("entry", "descent")
            assert sorted(reader.constraints) == sorted(from_folder.constraints)
            for path, name in (
                ("trajectory", "altitude"),
                ("imu/driving", "specific_force"),
                ("postflight/motion", "rolling_spin"),
            ):
                np.testing.assert_array_equal(reader.variable(path, name), from_folder.variable(path, name))
                assert reader.units(path, name) == from_folder.units(path, name) != ""
            assert reader.domain.mach_times == from_folder.domain.mach_times
            assert reader.text("events", "event") == from_folder.text("events", "event")
            assert from_folder.variable("events", "event") is None  # text is no number
            assert reader.groups["/trajectory"].variables["position"].dims == ("time", "axis")
            assert from_folder.groups["/trajectory"].variables["position"].dims == ("time", "axis")


def test_files_are_read_through_their_schemas(folder):
    residuals(folder / "residuals.nc")
    with ResultReader.open(folder / "result.nc") as reader:
        assert reader.summary.landing.miss_m > 0.0 and reader.diagnosis.ranking[0].effect == "remnant_torque"
        assert reader.residuals.channels == ("force_x", "force_y") and reader.ledger == () and reader.problems == {}


def test_spans_of_the_phases(written):
    with ResultReader.open(written) as reader:
        parachute, landing = reader.events["parachute_deploy"], reader.events["landing"]
        assert reader.span("entry") == (reader.time[0], parachute)
        assert reader.span("descent") == (parachute, landing + AFTER_LANDING)
        assert list(reader.events.values()) == sorted(reader.events.values())


def test_what_a_result_lacks_is_none_or_empty():
    reader = ResultReader({"/": Group(attrs={"effects": "[1]"}), "/trajectory": Group()})
    reader.groups["/trajectory"].add("time", ("time",), np.arange(3.0), "s", "time")
    assert (reader.title, reader.mission, reader.epoch_utc, reader.events, reader.domain) == ("Entry", "", "", {}, None)
    assert reader.variable("trajectory", "mach") is None and reader.variable("nothing", "mach") is None
    assert not reader.has("trajectory:mach") and reader.has("trajectory:time")
    assert reader.summary is None and reader.diagnosis is None and reader.residuals is None
    assert reader.phases == ("entry",) and reader.span() == (0.0, 2.0) and reader.constraints == {}
    assert reader.mapping("", "effects") == {} and reader.number("", "effects_none", 3.0) == 3.0
    with pytest.raises(InputError, match="Entry: found no numbers in variable 'mach' of group /trajectory"):
        reader.required("trajectory", "mach")


def test_a_longitude_in_degrees_is_returned_in_radians():
    group = Group()
    group.add("longitude", ("time",), np.array([180.0]), "degrees_east", "longitude")
    assert ResultReader({"/trajectory": group}).longitude == pytest.approx(np.pi)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda path: path.unlink(), r"result\.nc: no such result; expected the result\.nc that 'edl-filter run' wri"),
        (lambda path: path.write_bytes(b"no HDF5"), r"this is no HDF5 file, or a damaged one"),
        (lambda path: _attribute(path, "format", "notes"), r"attribute format is 'notes'; expected 'edl-result'"),
        (lambda path: _attribute(path, "format_version", 1), r"a result of version 1; .* Run the mission again"),
    ],
)
def test_a_folder_without_a_valid_result(folder, change, message):
    change(folder / "result.nc")
    with pytest.raises(InputError, match=message):
        ResultReader.open(folder)
    with ResultReader.open(folder, required=False) as reader:
        assert not reader.has_result and re.search(message, reader.problems["result.nc"])
        assert reader.title == reader.summary.title and list(reader.events)[-1] == "landing"


def test_damage_in_a_part_that_is_read_later_is_one_message(folder, monkeypatch):
    def damaged(dataset):
        raise OSError("Can't read data")

    monkeypatch.setattr(hdf5, "_values", damaged)
    with ResultReader.open(folder) as reader, pytest.raises(InputError, match=r"result\.nc: this HDF5 file is damaged"):
        reader.required("trajectory", "altitude")


def test_a_result_may_have_another_name(folder):
    copy = (folder / "result.nc").rename(folder / "spirit.nc")
    with ResultReader.open(copy) as reader:
        assert reader.has("trajectory:altitude") and reader.folder == folder


def _attribute(path, name, value):
    with h5py.File(path, "a") as file:
        file.attrs[name] = value


def test_an_invalid_file_is_none_and_its_problem_is_stated(folder):
    (folder / "diagnosis.json").write_text('{"verdict": "clean"}')
    (folder / "summary.json").write_text("{")
    (folder / "ledger.jsonl").write_text("3\n")
    with ResultReader.open(folder) as reader:
        assert (reader.summary, reader.diagnosis, reader.residuals, reader.ledger) == (None, None, None, ())
        assert "diagnosis.json: sentence: found nothing" in reader.problems["diagnosis.json"]
        assert "summary.json: found no JSON" in reader.problems["summary.json"]
        assert "ledger.jsonl, line 1: found no object" in reader.problems["ledger.jsonl"]


def test_residuals_without_a_variable(folder):
    residuals(folder / "residuals.nc", without=("sigma",))
    with ResultReader.open(folder) as reader:
        assert reader.residuals is None
        assert "residuals.nc cannot be read (KeyError('sigma')); diagnose" in reader.problems["residuals.nc"]
    with pytest.raises(InputError, match=r"found no residuals\.nc; diagnose the result again"):
        ResidualSeries.from_file(folder / "nothing.nc")


def test_a_channel_that_was_not_compared(tmp_path):
    residuals(tmp_path / "residuals.nc")
    with pytest.raises(InputError, match="residual: found 'mass'; accepted: force_x, force_y"):
        ResidualSeries.from_file(tmp_path / "residuals.nc").index("mass")


def test_the_ledger_of_another_mission_or_model_is_not_the_results(folder):
    summary = json.loads((folder / "summary.json").read_text())
    effect = {"remnant_torque": {"imu": None, "fixed": False, "parameters": {}}}
    for effects, mission, count in ((effect, "practice_mer", 2), ({}, "practice_mer", 0), (effect, "spirit", 0)):
        write_json(summary | {"effects": effects}, folder / "summary.json")
        lines = (ledger_step(mission=mission), ledger_end(mission=mission))
        (folder / "ledger.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines))
        with ResultReader.open(folder) as reader:
            assert len(reader.ledger) == count
