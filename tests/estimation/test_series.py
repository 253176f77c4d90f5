"""Runs of a condition, against a loop over its values."""

from itertools import groupby

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from edl_filter.estimation.series import runs


@given(st.lists(st.booleans(), max_size=20))
def test_runs_are_those_of_a_loop(values):
    expected, start = [], 0
    for value, group in groupby(values):
        end = start + len(list(group))
        if value:
            expected.append((start, end))
        start = end
    assert runs(np.array(values, bool)) == expected
