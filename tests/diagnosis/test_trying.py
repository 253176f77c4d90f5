"""Trying the catalogue: which signatures look alike."""

import numpy as np
import pytest

from edl_filter.diagnosis.trying import likeness


def test_likeness():
    a, b = np.array([3.0, 4.0]), np.array([4.0, 3.0])
    assert likeness(a, b) == pytest.approx(24.0 / 25.0) and likeness(b, a) == likeness(a, b)
    assert likeness(a, -2.0 * a) == pytest.approx(1.0)
    assert likeness(a, np.zeros(2)) == 0.0
    assert likeness(a, np.array([3.0, 4.0, 0.0])) == 0.0  # about another path
