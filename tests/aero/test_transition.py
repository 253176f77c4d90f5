"""The sin² bridge: its ends, its shape, and the Huygens database that was computed with it."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from edl_filter.aero.regimes import CONTINUUM_KNUDSEN, FREE_MOLECULAR_KNUDSEN
from edl_filter.aero.transition import bridge


def test_ends_and_middle():
    np.testing.assert_allclose(bridge([0.0, 1e-9, 1e-3, 0.1, 10.0, 1e6, np.inf]), [0, 0, 0, 0.5, 1, 1, 1], atol=1e-15)
    assert np.isnan(bridge(np.nan))
    assert np.ndim(bridge(0.1)) == 0


@given(st.floats(-3.0, 1.0), st.floats(-3.0, 1.0))
def test_increases_and_is_symmetric_in_the_logarithm(first, second):
    low, high = sorted((first, second))
    assert bridge(10.0**low) <= bridge(10.0**high) + 1e-15
    assert bridge(10.0**first) + bridge(10.0 ** (-2.0 - first)) == pytest.approx(1.0, abs=1e-12)


def test_slope_is_continuous_at_the_ends():
    for end in (CONTINUUM_KNUDSEN, FREE_MOLECULAR_KNUDSEN):
        step = 1e-4
        assert abs(bridge(end * (1 + step)) - bridge(end * (1 - step))) < 1e-8


def test_huygens_transitional_numbers(mevad):
    path = mevad / "huygens_aedb_transitional_CA.csv"
    lines = [line for line in path.read_text().splitlines() if not line.startswith("#")]
    log_knudsen, alpha, ca = np.array([line.split(",") for line in lines[1:]], dtype=float).T
    checked = 0
    for angle in np.unique(alpha):
        rows = alpha == angle
        continuum, free = ca[rows & (log_knudsen == -3.0)], ca[rows & (log_knudsen == 1.0)]
        assert continuum.size == free.size == 1
        bridged = continuum + (free - continuum) * bridge(10.0 ** log_knudsen[rows])
        np.testing.assert_allclose(bridged, ca[rows], rtol=0, atol=1e-4)
        checked += rows.sum()
    assert checked == 104
