"""How a mission is named at a shell, and written elsewhere."""

from pathlib import Path

from edl_filter.mission import Mission, shipped_mission
from edl_filter.mission.naming import name_of, unchanged, write_mission


def test_a_mission_is_named_as_a_person_would(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    shipped = Mission.load("builtin:practice_mer")
    assert name_of(shipped) == "builtin:practice_mer" and unchanged(shipped)
    Path("here").mkdir()
    Path("here/m.yaml").write_text(shipped.text)
    mine = Mission.load("here/m.yaml")
    assert name_of(mine) == "here/m.yaml" and unchanged(mine)
    monkeypatch.chdir("here")
    assert name_of(Mission.load(tmp_path / "here" / "m.yaml")) == "m.yaml"


def test_a_changed_mission_is_not_its_file(tmp_path):
    changed = Mission.load("builtin:practice_mer", ["vehicle.mass=800"])
    assert not unchanged(changed)
    path = write_mission(changed, changed.text, tmp_path / "out" / "m.yaml")
    again = Mission.load(path)
    assert again.vehicle.mass == 800.0 and unchanged(again)


def test_paths_are_found_from_the_new_place(tmp_path, builtin_flight):
    (tmp_path / "flight.h5").symlink_to(builtin_flight)
    text = shipped_mission("practice_mer").read_text().replace("builtin:practice_06 ", "flight.h5 ")
    (tmp_path / "m.yaml").write_text(text)
    mission = Mission.load(tmp_path / "m.yaml")
    again = Mission.load(write_mission(mission, mission.text, tmp_path / "out" / "m.yaml"))
    assert again.telemetry_path().is_file()
