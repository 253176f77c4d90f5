"""Samples of zeros: readings where the step explains them, lost where the readings are many steps."""

import numpy as np
import pytest

from edl_filter.telemetry.sample_checks import (
    CheckSettings,
    in_body_axes,
    interpolation_error,
    lost_readings,
)


def _quantised_flight(seed=0, count=4000, step=0.05):
    """Readings that grow from far below one step to many: most rows of the first part are zero in all channels."""
    rng = np.random.default_rng(seed)
    size = step * np.concatenate((np.full(count // 2, 0.3), np.geomspace(0.3, 30.0, count - count // 2)))
    return step * np.round(size[:, None] * rng.standard_normal((count, 6)) / step)


def test_zeros_that_the_step_explains_are_readings():
    readings = _quantised_flight()
    assert 0.2 < np.mean(np.all(readings == 0.0, axis=1)) < 0.9
    _, findings = lost_readings(0.01 * np.arange(1, 4001), readings, 0.01, "a", (1e3, 10.0), CheckSettings())
    assert findings == []


@pytest.mark.parametrize("row, count", [(3900, 1), (3850, 40)])
def test_packets_of_zeros_where_the_readings_are_many_steps_are_lost(row, count):
    readings = _quantised_flight()
    readings[row : row + count] = 0.0
    out, (finding,) = lost_readings(0.01 * np.arange(1, 4001), readings, 0.01, "a", (1e3, 10.0), CheckSettings())
    assert (finding.kind, finding.samples) == ("all_zero", count)
    assert np.isnan(out[row : row + count]).all()
    assert np.isfinite(np.delete(out, slice(row, row + count), axis=0)).all()


@pytest.mark.parametrize(
    ("centre", "low", "high", "limit"),
    [(4.0, -np.inf, 5.0, 5.0), (-4.0, -5.0, np.inf, -5.0), (4.0, 3.0, np.inf, None), (0.5, 0.0, np.inf, None)],
)
def test_a_saturated_axis_has_a_limit_where_its_reading_is_the_farthest_from_zero(centre, low, high, limit):
    """The true value is beyond it; an axis that is stuck at its value nearest to zero has no such bound."""
    count = 4000
    readings = np.random.default_rng(1).standard_normal((count, 6))
    motion = centre + 1.5 * np.sin(0.01 * np.arange(count)) + 0.01 * readings[:, 1]
    readings[:, 1] = np.clip(motion, low, high)
    _, findings = lost_readings(0.01 * np.arange(1, count + 1), readings, 0.01, "a", (1e3, 10.0), CheckSettings())
    assert {(f.channel, f.kind) for f in findings} == {("force y", "saturated")}
    expected = None if limit is None else (0.0, limit, 0.0)
    assert {f.limit for f in findings} == {expected}
    turned = in_body_axes(findings, np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]))
    assert {f.limit for f in turned} == {None if limit is None else (limit, 0.0, 0.0)}


def test_a_sample_is_interpolated_as_the_cubic_through_its_four_neighbours():
    x = np.arange(9.0)
    values = np.stack((x**3 - 2.0 * x, np.where(x == 4.0, 6.0, 1.0), x**2), axis=1)
    error = interpolation_error(values)
    np.testing.assert_allclose(error[:, [0, 2]], 0.0, atol=1e-12)
    np.testing.assert_allclose(error[2:-2, 1], [5.0 / 6.0, -20.0 / 6.0, 5.0, -20.0 / 6.0, 5.0 / 6.0])


@pytest.mark.parametrize("column", [1, 5])
def test_a_stuck_axis_is_lost_alone(column):
    """The other axes of its triad are read, and so is the other triad."""
    readings = np.random.default_rng(2).standard_normal((4000, 6))
    stuck = readings.copy()
    stuck[1000:1040, column] = stuck[1000, column]
    out, (finding,) = lost_readings(0.01 * np.arange(1, 4001), stuck, 0.01, "a", (1e3, 10.0), CheckSettings())
    assert (finding.kind, finding.samples) == ("stuck", 40)
    assert np.isnan(out[1000:1040, column]).all()
    out[1000:1040, column] = readings[1000:1040, column]
    np.testing.assert_array_equal(out, readings)
