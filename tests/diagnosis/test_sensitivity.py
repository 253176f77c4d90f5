"""What a lever arm's acceleration may be wrong by: about what it is where a torque sets in, nothing elsewhere."""

import numpy as np
import pytest

from edl_filter.diagnosis.bins import Bins
from edl_filter.diagnosis.sensitivity import lever_error
from edl_filter.navigation.increments import edge_values

DT, N, ARM = 0.125, 80, np.array([-0.8, 0.5, -0.6])
EDGES = DT * np.arange(N + 1)
BINS = Bins(EDGES, np.ones(N, bool), 1)
AXIS = np.array([0.0, 0.3, 0.2])


def swing(t):
    """A slow swing, and its integral."""
    return 0.1 * np.sin(1.5 * t), -0.1 / 1.5 * np.cos(1.5 * t)


def wrong_and_stated(onset):
    """Errors of the tangential part with a torque from `onset` on, and what is stated of them, ``(N,)``, m/s²."""
    late = np.maximum(EDGES - onset, 0.0)
    rate, angle = (s + extra for s, extra in zip(swing(EDGES), (0.5 * late, 0.25 * late**2), strict=True))
    mean = np.outer(np.diff(angle) / DT, AXIS)
    off = edge_values(np.full(N, DT), mean) - np.outer(rate, AXIS)
    wrong = np.cross(np.diff(off, axis=0), ARM) / DT
    return np.linalg.norm(wrong, axis=1)[8:-8], np.linalg.norm(lever_error(BINS, mean, ARM), axis=1)[8:-8]


@pytest.mark.parametrize("phase", np.linspace(0.0, 1.0, 9))
def test_a_bend_of_the_rate_is_covered(phase):
    wrong, stated = wrong_and_stated(DT * (40 + phase))
    large = wrong > 0.1 * wrong.max()
    assert large.any() and np.all(wrong[large] < 1.5 * stated[large])  # stated as one sigma
    assert np.count_nonzero(stated) < 12  # about the bend alone


def test_a_smooth_swing_has_nothing_to_cover():
    wrong, stated = wrong_and_stated(1e3)
    assert wrong.max() < 1e-6 and not stated.any()
