"""Mission files with an effect of a user's Python file."""

from pathlib import Path

import pytest
from user_effects import BUMP

from edl_filter.errors import InputError
from edl_filter.mission import Mission
from edl_filter.workflow.add_effect import add_effect


def test_an_effect_of_a_file_is_written_with_its_file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("bump.py").write_text(BUMP)
    path = add_effect("builtin:practice_mer", "bump", Path("m.yaml"), ["a=0.5"], file="bump.py")
    (bump,) = Mission.load(path).active_effects()
    assert bump.values == {"a": 0.5}
    with pytest.raises(InputError, match=r"effects.0.parameters.a: found 2; expected m/s\^2 between -1 and 1"):
        add_effect("builtin:practice_mer", "bump", Path("x/m.yaml"), ["a=2"], file="bump.py")
