"""Reader of damping tables."""

import numpy as np
import pytest

from edl_filter.aero.damping import read_damping
from edl_filter.errors import InputError
from edl_filter.mission import Mission
from edl_filter.pipeline.forward_model import damping_of


def test_interpolation_is_linear_and_constant_beyond_the_edges(tmp_path):
    path = tmp_path / "d.csv"
    path.write_text("# a comment\nmach,Cmq\n0.5,-0.1\n1.5,0.3\n4,-0.2\n")
    damping = read_damping(path)
    np.testing.assert_allclose(damping.at(np.array([0.0, 1.0, 1.5, 9.0])), [-0.1, 0.1, 0.3, -0.2])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("mach,cmq\n1,2\n", "the header must be mach,Cmq; found 'mach,cmq' in line 1"),
        ("mach,Cmq\n", "a header but no rows"),
        ("mach,Cmq\n1,2\n1,3\n", "line 3: mach must increase, but 1 follows 1"),
        ("mach,Cmq\n-1,2\n", "line 2: mach must not be negative, found -1"),
        ("mach,Cmq\n1,two\n", "line 2: expected 2 finite numbers"),
    ],
)
def test_invalid_table_raises(tmp_path, text, message):
    (tmp_path / "d.csv").write_text(text)
    with pytest.raises(InputError, match=message):
        read_damping(tmp_path / "d.csv")


def test_practice_missions_use_the_shipped_table(practice):
    damping = damping_of(Mission.load("builtin:practice_mer"))
    expected = np.loadtxt(practice(1).with_name("damping.csv"), delimiter=",", skiprows=2)
    np.testing.assert_array_equal(np.stack((damping.mach, damping.cmq), axis=1), expected)
    without_table = damping_of(Mission.load("builtin:practice_mer", ["aerodynamics.damping=null"]))
    assert not without_table.at(np.array([0.0, 2.0, 20.0])).any()
