"""Reduction of curves: no peak, gap or end is lost."""

import numpy as np

from edl_filter.report.decimate import envelope, reduced
from edl_filter.report.description import Curve


class TestEnvelope:
    def test_keeps_peaks_and_ends(self):
        rng = np.random.default_rng(1)
        time = np.arange(120_000) / 200.0
        values = rng.standard_normal(len(time))
        values[[777, 54_321]] = 99.0, -99.0
        thin_time, thin = envelope(time, values, bins=500)
        assert len(thin) <= 1002
        assert {time[777], time[54_321], time[0], time[-1]} <= set(thin_time)
        assert thin.max() == 99.0 and thin.min() == -99.0
        assert np.all(np.diff(thin_time) > 0.0)
        np.testing.assert_array_equal(np.interp(thin_time, time, values), thin)

    def test_short_curves_stay(self):
        time = np.arange(10.0)
        assert envelope(time, time)[0] is time

    def test_gaps_stay_gaps(self):
        time = np.arange(10_000.0)
        values = np.sin(time)
        values[4000:6000] = np.nan
        values[::7] = np.nan
        thin_time, thin = envelope(time, values, bins=100)
        assert np.isnan(thin[(thin_time > 4100) & (thin_time < 5900)]).all()
        assert not np.isnan(thin[(thin_time > 10) & (thin_time < 3900)]).any()

    def test_nothing_but_nan(self):
        assert np.isnan(envelope(np.arange(9999.0), np.full(9999, np.nan), bins=10)[1]).all()


def test_a_curve_is_reduced_along_its_independent_coordinate():
    """A peak of the dependent coordinate remains; of a path, peaks of both; points with symbols all remain."""
    steady, peaked = np.linspace(0.0, 1.0, 9000), np.linspace(0.0, 1.0, 9000)
    peaked[4321] = 7.0
    for x, y, independent in ((steady, peaked, "x"), (peaked, steady, "y"), (peaked, steady, "none")):
        index = reduced(Curve(x, y, independent=independent), 100)
        assert 4321 in index and len(index) < 500
    assert len(reduced(Curve(steady, peaked, symbol="circle"), 100)) == 9000
