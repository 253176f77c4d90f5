"""Missions and results of the served folder."""

import pytest

from edl_filter.errors import InputError
from edl_filter.mission import shipped_mission
from edl_filter.serve import library
from edl_filter.serve.library import ServedResult
from edl_filter.serve.safety import ForbiddenError


def names(root):
    return [m["name"] for m in library.missions(root) if not m["shipped"]]


def test_only_missions_are_listed(root, tmp_path):
    (root / "notes.yaml").write_text("a: 1\n")
    (root / "broken.yaml").write_text("a: [\n")
    (root / ".hidden.yaml").write_text((root / "flight.yaml").read_text())
    (root / "more").mkdir()
    (root / "more" / "second.yml").write_text((root / "flight.yaml").read_text())
    (tmp_path / "secret.yaml").write_text((root / "flight.yaml").read_text())
    (root / "out.yaml").symlink_to(tmp_path / "secret.yaml")
    assert names(root) == ["flight.yaml", "more/second.yml"]
    shipped = [m for m in library.missions(root) if m["shipped"]]
    title = "Practice flight, MER-like vehicle"
    assert {"name": "builtin:practice_mer", "title": title, "shipped": True, "problems": []} in shipped


def test_broken_missions_are_listed_with_their_problems(root):
    text = (root / "flight.yaml").read_text()
    (root / "syntax.yaml").write_text(text.replace("mass: 832.0 ", "mass: [832.0 "))
    wrong = text.replace("mass: 832.0 ", "mass: -1.0 ").replace("builtin:practice_06 ", "gone.h5 ")
    (root / "wrong.yaml").write_text(wrong)
    listed = {m["name"]: m for m in library.missions(root)}
    assert listed["flight.yaml"]["problems"] == []
    (syntax,) = listed["syntax.yaml"]["problems"]
    assert syntax.startswith("syntax.yaml: line ") and listed["syntax.yaml"]["title"] == "syntax.yaml"
    mass, telemetry = listed["wrong.yaml"]["problems"]
    assert mass.startswith("wrong.yaml: vehicle.mass: found -1.0")
    assert telemetry.startswith("wrong.yaml: telemetry.path: found 'gone.h5'")
    (phoenix,) = listed["builtin:phoenix"]["problems"]
    assert "which edl-filter cannot read yet" in phoenix
    (root / "wrong.yaml").write_text(wrong.replace("mass: -1.0 ", "mass: 832.0 "))
    (root / "gone.h5").touch()  # a file that appears mends the mission though it is unchanged
    assert {m["name"]: m for m in library.missions(root)}["wrong.yaml"]["problems"] == []


def test_a_changed_title_is_read_again(root):
    assert library.missions(root)[0]["title"] == "Practice flight, MER-like vehicle"
    text = (root / "flight.yaml").read_text()
    (root / "flight.yaml").write_text(text.replace("Practice flight, MER-like vehicle", "Another title of it"))
    assert library.missions(root)[0]["title"] == "Another title of it"


def test_find_mission(root):
    assert library.find_mission(root, "flight.yaml") == root / "flight.yaml"
    assert library.find_mission(root, "builtin:mer_a") == shipped_mission("mer_a")
    for name in ("none.yaml", "builtin:../../pyproject", "builtin:none"):
        with pytest.raises(InputError, match="found no such mission"):
            library.find_mission(root, name)
    with pytest.raises(ForbiddenError):
        library.find_mission(root, "../flight.yaml")


def test_results(root):
    (root / "results" / "bad").mkdir()
    (root / "results" / "bad" / "result.nc").write_bytes(b"no HDF5")
    results = library.results(root)
    assert [(r.path, r.verdict, r.effects) for r in results] == [("results/flight", "missing", {})]


def test_an_invalid_diagnosis_is_an_error(root):
    (root / "results/flight/diagnosis.json").write_text('{"verdict": "clean"}')
    with pytest.raises(InputError, match=r"diagnosis.json: sentence: found nothing; .*run 'edl-filter diagnose' again"):
        library.find_result(root, "results/flight")


def result(path, *effects, flight="first", changed=0.0):
    return ServedResult(path, "", "m", flight, {name: {} for name in effects}, None, None, changed)


def test_lineage_has_results_of_the_same_flight_with_fewer_effects():
    first, second, third = result("a"), result("a+wind", "wind"), result("a+wind+mass", "wind", "mass")
    candidates = [result("b", "mass", flight="second"), result("c", "drag"), third, first, second]
    assert [r.path for r in library.lineage(third, candidates)] == ["a", "a+wind", "a+wind+mass"]
    assert [r.path for r in library.lineage(first, candidates)] == ["a"]


def test_lineage_prefers_the_folder_whose_name_is_continued():
    old, new, last = result("a", changed=1.0), result("b", changed=9.0), result("a+wind", "wind")
    assert [r.path for r in library.lineage(last, [old, new])] == ["a", "a+wind"]
    assert [r.path for r in library.lineage(result("x", "wind"), [old, new])] == ["b", "x"]
