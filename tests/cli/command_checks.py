"""Checks of commands that refuse their input, and changed copies of shipped missions."""

from pathlib import Path

from edl_filter.mission import shipped_mission


def assert_input_error(result, *parts):
    """Exit code 2, no traceback, nothing on standard output, and a message with all `parts`."""
    assert result.exit_code == 2, result.output
    assert "Traceback" not in result.stderr
    assert result.stdout == ""
    for part in parts:
        assert part in result.stderr


def assert_refused(result, *parts):
    """As `assert_input_error`, and no output file in the current folder."""
    assert_input_error(result, *parts)
    assert [p for p in Path().rglob("*") if p.suffix in (".nc", ".json", ".png", ".h5")] == []
    assert not Path("out").exists()


def changed_mission(name, old, new):
    """Write a shipped mission with one change into the current folder."""
    text = shipped_mission(name).read_text()
    assert old in text
    Path("mission.yaml").write_text(text.replace(old, new, 1))
    return "mission.yaml"
