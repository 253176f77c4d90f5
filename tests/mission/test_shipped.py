"""Missions that the package ships."""

import pytest

from edl_filter.errors import InputError
from edl_filter.mission import Mission


def test_an_unknown_name_lists_the_shipped_missions():
    with pytest.raises(InputError, match="builtin:mer_c: found no such mission; expected one of mer_a, mer_b"):
        Mission.load("builtin:mer_c")
