"""Entries appended to a list of a mission file, and relative paths for another folder."""

import yaml
from hypothesis import given
from hypothesis import strategies as st

from edl_filter.mission.yaml_edit import append_entry, hide_folders, rebase_paths, shorten_paths
from edl_filter.mission.yaml_text import parse


def test_an_entry_is_appended_to_a_list_in_brackets_or_an_empty_list():
    for effects in ("[]", "[{name: mass}]", "", "[ {name: mass}, # one\n  {name: wind} ]"):
        text = f"name: a\neffects: {effects}\nlast: 1  # preserved\n"
        new = parse(append_entry(text, "effects", {"name": "new"}, ["name: new"], "m"), "m")
        assert new == parse(text, "m") | {"effects": [*(parse(text, "m")["effects"] or []), {"name": "new"}]}


NAMES = st.sampled_from(["a", "b", "c"])
VALUES = st.integers() | st.none() | st.text("ab #:\n", max_size=6) | st.lists(st.integers(), max_size=2)
ENTRIES = st.lists(st.dictionaries(NAMES, VALUES | st.dictionaries(NAMES, VALUES, max_size=2), max_size=3), min_size=1)


@given(st.dictionaries(NAMES, VALUES, min_size=1), ENTRIES, st.dictionaries(NAMES, VALUES), st.integers(0, 2))
def test_appending_changes_only_the_list(first_keys, entries, last_keys, comments):
    def dump(data):
        return yaml.safe_dump(data, sort_keys=False, default_flow_style=False) if data else ""

    text = dump(first_keys) + dump({"effects": entries}) + "# comment\n\n" * comments
    text += dump({f"z{k}": v for k, v in last_keys.items()})
    expected = parse(text, "m")
    expected["effects"] = [*expected["effects"], {"name": "new", "parameters": {"k": 1}}]
    new = append_entry(text, "effects", expected["effects"][-1], ["name: new", "parameters:", "  k: 1  # unit"], "m")
    assert parse(new, "m") == expected
    assert new.count("# comment") == comments


def test_only_relative_paths_are_rebased(tmp_path):
    text = "a: builtin:x\nb: /abs\nc: ~/home\nd: rel/x.csv # table\ne: [{f: my.py}, {f: 3}]\n"
    keys = ("a", "b", "c", "d", "e.*.f", "g.h")
    assert rebase_paths(text, keys, tmp_path, tmp_path, "m") == text
    rebased = rebase_paths(text, keys, tmp_path, tmp_path / "sub", "m")
    assert rebased == text.replace("rel/x.csv", '"../rel/x.csv"').replace("my.py", '"../my.py"')


def test_absolute_paths_below_a_folder_are_shortened(tmp_path):
    text = f"a: {tmp_path}/sub/x.csv # table\nb: /elsewhere/y.csv\nc: rel.csv\nd: builtin:x\n"
    keys = ("a", "b", "c", "d")
    assert shorten_paths(text, keys, tmp_path, "m") == text.replace(f"{tmp_path}/sub/x.csv", '"sub/x.csv"')
    hidden = hide_folders(text, keys, "m")
    assert hidden == text.replace(f"{tmp_path}/sub/x.csv", '"x.csv"').replace("/elsewhere/y.csv", '"y.csv"')
