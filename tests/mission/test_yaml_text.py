"""YAML of mission files to data, overrides, and changes of single keys."""

import json
import math

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from shipped_missions import error_of

from edl_filter.errors import InputError
from edl_filter.mission import Mission
from edl_filter.mission.yaml_text import parse, parse_override, set_key


def test_unreadable_files_are_refused(tmp_path):
    with pytest.raises(InputError, match=r"none\.yaml: No such file.*; the path of a mission file is expected"):
        Mission.load(tmp_path / "none.yaml")
    with pytest.raises(InputError, match="the path of a mission file is expected"):
        Mission.load(tmp_path)
    (tmp_path / "m.yaml").write_bytes(b"name: \xff\xfe")
    with pytest.raises(InputError, match="byte 6 is no UTF-8 text"):
        Mission.load(tmp_path / "m.yaml")


def test_scalars_follow_yaml_1_2():
    text = "[1e13, 1.5e-3, 010, 0x1F, 2004-01-04T04:21:21.532, yes, 12:30, ~, true, -.inf, '1e3', 1_0]"
    assert parse(text, "m") == [
        1e13, 1.5e-3, 10, 31, "2004-01-04T04:21:21.532", "yes", "12:30", None, True, -math.inf, "1e3", "1_0",
    ]  # fmt: skip


@pytest.mark.parametrize("override", ["planet", "=1", "planet..j2=1", ".=1"])
def test_an_override_without_key_or_value_is_refused(override):
    assert "found no KEY=VALUE; expected for example planet.gravity.j2=0" in error_of(override)


def test_an_override_below_a_value_is_refused():
    assert error_of("name.x=1") == "--set name.x: name is no section, no key can be below it."
    assert "--set planet.name: line 1" in error_of("planet.name=[")


NUMBERS = st.integers() | st.floats(allow_nan=False, allow_infinity=False)
TEXT = st.text(st.characters(codec="utf-8", categories=("L", "N", "P", "Zs")), max_size=8)
SCALARS = st.none() | st.booleans() | NUMBERS | TEXT
NAMES = st.sampled_from(["a", "b", "c", "d_1"])
TREES = st.recursive(
    SCALARS,
    lambda below: st.lists(below, max_size=2) | st.dictionaries(NAMES, below, max_size=3),
    max_leaves=8,
)


@pytest.mark.parametrize(
    ("override", "value"),
    [
        ("telemetry.path=a.h5", "HERE/a.h5"),
        ("telemetry={path: a.h5, driving: a.h5}", {"path": "HERE/a.h5", "driving": "a.h5"}),
        ("effects=[{name: jet, file: jet.py}]", [{"name": "jet", "file": "HERE/jet.py"}]),
        ("effects.0.file=jet.py", "HERE/jet.py"),
        ("telemetry.path=builtin:practice_06", "builtin:practice_06"),
        ("name=a.h5", "a.h5"),
    ],
)
def test_relative_paths_start_from_the_current_folder(override, value, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    expected = json.loads(json.dumps(value).replace("HERE", str(tmp_path)))
    assert parse_override(override, ("telemetry.path", "effects.*.file"))[1] == expected


@settings(max_examples=60, deadline=None)
@given(st.dictionaries(NAMES, TREES, min_size=1), st.lists(NAMES, min_size=1, max_size=3), TREES, st.booleans())
def test_set_key_changes_only_one_key(tree, path, value, flow):
    text = (
        json.dumps(tree, ensure_ascii=False)
        if flow
        else yaml.safe_dump(tree, default_flow_style=False, allow_unicode=True)
    )
    tree = parse(text, "m")
    section = expected = json.loads(json.dumps(tree))
    for part in path[:-1]:
        if section.get(part) is None:
            section[part] = {}
        section = section[part]
        if not isinstance(section, dict):
            with pytest.raises(InputError, match="is no section"):
                set_key(text, ".".join(path), value)
            return
    section[path[-1]] = value
    assert parse(set_key(text, ".".join(path), value), "m") == expected
