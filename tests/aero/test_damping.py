"""Reading of damping tables."""

import numpy as np
import pytest

from edl_filter.aero.damping import read_damping
from edl_filter.effects.world import Damping
from edl_filter.errors import InputError
from edl_filter.mission import Mission
from edl_filter.modelling import damping_of


def test_a_table_is_linear_and_held_at_its_edges(tmp_path):
    path = tmp_path / "d.csv"
    path.write_text("# mine\nmach,Cmq\n0.5,-0.1\n1.5,0.3\n4,-0.2\n")
    damping = Damping(*read_damping(path))
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
def test_a_table_that_cannot_be_used(tmp_path, text, message):
    (tmp_path / "d.csv").write_text(text)
    with pytest.raises(InputError, match=message):
        read_damping(tmp_path / "d.csv")


def test_the_practice_missions_name_the_shipped_table(practice):
    damping = damping_of(Mission.load("builtin:practice_mer"))
    shared = np.loadtxt(practice(6).parent / "damping.csv", delimiter=",", skiprows=2)
    np.testing.assert_array_equal(np.stack((damping.mach, damping.cmq), axis=1), shared)
    none = damping_of(Mission.load("builtin:practice_mer", ["aerodynamics.damping=null"]))
    assert not none.at(np.array([0.0, 2.0, 20.0])).any()
