"""Names of missions as arguments of commands, and copies of mission files in other folders."""

from pathlib import Path

from edl_filter.mission import Mission, shipped_mission
from edl_filter.mission.files import matches_file, mission_argument, write_mission


def test_the_argument_of_a_mission_is_relative_to_the_current_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    shipped = Mission.load("builtin:practice_mer")
    assert mission_argument(shipped) == "builtin:practice_mer" and matches_file(shipped)
    Path("sub").mkdir()
    Path("sub/m.yaml").write_text(shipped.text)
    copy = Mission.load("sub/m.yaml")
    assert mission_argument(copy) == "sub/m.yaml" and matches_file(copy)
    monkeypatch.chdir("sub")
    assert mission_argument(Mission.load(tmp_path / "sub" / "m.yaml")) == "m.yaml"


def test_a_mission_with_overrides_does_not_match_its_file(tmp_path):
    changed = Mission.load("builtin:practice_mer", ["vehicle.mass=800"])
    assert not matches_file(changed)
    path = write_mission(changed, changed.text, tmp_path / "out" / "m.yaml")
    copy = Mission.load(path)
    assert copy.vehicle.mass == 800.0 and matches_file(copy)


def test_a_copy_in_another_folder_finds_the_telemetry(tmp_path, builtin_flight):
    (tmp_path / "flight.h5").symlink_to(builtin_flight)
    text = shipped_mission("practice_mer").read_text().replace("builtin:practice_06 ", "flight.h5 ")
    (tmp_path / "m.yaml").write_text(text)
    mission = Mission.load(tmp_path / "m.yaml")
    copy = Mission.load(write_mission(mission, mission.text, tmp_path / "out" / "m.yaml"))
    assert copy.telemetry_path().is_file()
