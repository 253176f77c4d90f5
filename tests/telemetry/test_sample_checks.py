"""Samples of zeros: readings where the step explains them, lost where the readings are many steps."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from edl_filter.telemetry.sample_checks import (
    CheckSettings,
    _repeated_extremes,
    _repeated_rows,
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


def checked(readings):
    """Findings of readings at 100 Hz."""
    time = 0.01 * np.arange(1, len(readings) + 1)
    return lost_readings(time, readings, 0.01, "a", (1e3, 10.0), CheckSettings())


def test_the_other_limit_of_a_symmetric_range_is_one_too():
    """One run at the upper limit, and single samples at the lower one."""
    readings = np.random.default_rng(1).standard_normal((4000, 6))
    readings[:, 1] = np.clip(readings[:, 1], -3.0, np.inf)
    readings[2000:2040, 1] = 3.0
    readings[2100, 1] = -3.0
    readings[:, 1] = np.clip(readings[:, 1], -3.0, 3.0)
    out, findings = checked(readings)
    assert {f.limit for f in findings} == {(0.0, 3.0, 0.0), (0.0, -3.0, 0.0)}
    np.testing.assert_array_equal(np.isnan(out[:, 1]), np.abs(readings[:, 1]) == 3.0)
    asymmetric = readings.copy()
    asymmetric[:, 1] = np.maximum(asymmetric[:, 1], -2.9)
    assert {f.limit for f in checked(asymmetric)[1]} == {(0.0, 3.0, 0.0), (0.0, -2.9, 0.0)}  # in several samples
    asymmetric[:, 1] = np.where(asymmetric[:, 1] == -2.9, -2.8, asymmetric[:, 1])  # within the other values
    assert {f.limit for f in checked(asymmetric)[1]} == {(0.0, 3.0, 0.0)}


@pytest.mark.parametrize("step", [0.0, 1e-6, 1e-3])
@pytest.mark.parametrize("count", [2, 8])
def test_peaks_at_the_limits_of_a_range_are_saturated_however_short(step, count):
    """An oscillation of 20 samples whose amplitude exceeds the range in some periods, by one or two samples each."""
    phase = 2.0 * np.pi * np.arange(4000) / 20.3
    amplitude = np.where(np.arange(4000) < 20.3 * count, 1.02, 0.9)
    rate = amplitude * np.sin(phase) + 1e-3 * np.random.default_rng(3).standard_normal(4000)
    readings = np.random.default_rng(2).standard_normal((4000, 6))
    readings[:, 4] = np.clip(rate, -1.0, 1.0)
    if step:
        readings[:, 4] = step * np.round(readings[:, 4] / step)
    out, findings = checked(readings)
    at_limit = np.abs(readings[:, 4]) == np.abs(readings[:, 4]).max()
    if count == 2 and step == 1e-3:  # too few: other values may recur as often
        assert findings == []
    else:
        assert {(f.channel, f.kind) for f in findings} == {("rate y", "saturated")}
        np.testing.assert_array_equal(np.isnan(out[:, 4]), at_limit)


@pytest.mark.parametrize(("low", "expected"), [(-1.0, [-1.0, 1.0]), (-2.0, [1.0])])
def test_an_extreme_in_several_runs_is_a_limit_where_nothing_else_recurs(low, expected):
    """An oscillation of 60 samples that is beyond the range for up to 12 of them, on both sides or on one."""
    rate = 1.2 * np.sin(2.0 * np.pi * np.arange(3000) / 60.3) + 1e-3 * np.random.default_rng(3).standard_normal(3000)
    readings = np.random.default_rng(2).standard_normal((3000, 6))
    readings[:, 4] = np.clip(rate, low, 1.0)
    assert _repeated_extremes(readings[:, 4], 1e-6) == expected
    out, findings = checked(readings)
    assert {(f.channel, f.kind) for f in findings} == {("rate y", "saturated")}
    np.testing.assert_array_equal(np.isnan(out[:, 4]), np.isin(readings[:, 4], expected))
    readings[:, 4] = np.where(rate > 1.0, np.nan, rate)  # without the samples beyond the range nothing recurs
    assert _repeated_extremes(readings[:, 4], 1e-6) == []


@pytest.mark.parametrize(
    ("rows", "steps", "quantum", "marked"),
    [
        (400, 4, 0.0, True),
        (40, 4, 0.0, True),
        (400, 4, 0.5, False),  # a coarse quantisation
        (400, 200, 0.0, False),  # nothing acts on the vehicle
        (3000, 2, 0.0, False),  # each reading is held for two samples
    ],
)
def test_held_readings_are_repeated_rows(rows, steps, quantum, marked):
    readings = np.random.default_rng(2).standard_normal((3000, 6))
    if quantum:
        readings = quantum * np.round(readings / quantum)
    place = 3000 - rows + np.arange(rows)
    readings[place] = readings[3000 - rows + np.arange(rows) // steps * steps]
    repeated = np.zeros(3000, bool)
    repeated[place[np.arange(rows) % steps > 0]] = True
    readings[:, 1] = 0.5 * np.round(readings[:, 1] / 0.5)  # one coarse channel says nothing of the others
    np.testing.assert_array_equal(_repeated_rows(readings), repeated & marked)


@given(
    st.integers(0, 10**6), st.sampled_from([0.0, 1e-6, 1e-3, 0.1, 0.5]), st.sampled_from(["normal", "sine", "uniform"])
)
@settings(max_examples=60, deadline=None)
def test_extremes_of_a_sound_axis_are_no_limits(seed, step, shape):
    """Symmetric about zero, quantised or not; also a sine whose samples recur exactly in every period."""
    rng = np.random.default_rng(seed)
    values = {
        "normal": rng.standard_normal(3000), "uniform": rng.uniform(-1.0, 1.0, 3000),
        "sine": np.tile(np.sin(2.0 * np.pi * np.arange(20 + seed % 40) / (20 + seed % 40)), 60),
    }[shape]  # fmt: skip
    values = step * np.round(values / step) if step else values
    values = np.append(values[values >= -values.max()], -values.max())
    readings = np.random.default_rng(0).standard_normal((len(values), 6))
    readings[:, 2] = values
    assert [f for f in checked(readings)[1] if f.channel == "force z" and f.kind == "saturated"] == []


@pytest.mark.parametrize("signal", [
    0.1 * np.sin(2.0 * np.pi * 0.125 * np.arange(4000)),  # equal at its peaks only, elsewhere to rounding
    np.clip(2.0 * np.sin(0.01 * np.arange(4000)), -1.0, 1.0),  # a command that is limited for seconds
    np.where(np.arange(4000) % 50 == 0, 1.0, np.random.default_rng(4).uniform(-1.0, 0.9, 4000)),  # one side only
])  # fmt: skip
def test_values_that_recur_for_another_reason_are_no_limits(signal):
    readings = np.random.default_rng(0).standard_normal((4000, 6))
    readings[:, 3] = signal
    readings[7, 3] = -readings[:, 3].max()
    assert _repeated_extremes(readings[:, 3], 1e-6) == []


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


def with_noise(readings):
    """Findings of readings at 100 Hz of sensors whose stated noise is one."""
    time = 0.01 * np.arange(1, len(readings) + 1)
    return lost_readings(time, readings, 0.01, "a", (1e3, 50.0), CheckSettings(), (1.0, 1.0))


@pytest.mark.parametrize("value", [0.0, 0.7])
@pytest.mark.parametrize(("columns", "names"), [([4], ["rate y"]), ([0, 1, 2], ["force x", "force y", "force z"])])
def test_an_axis_that_reads_one_value_throughout_is_dead(value, columns, names):
    readings = np.random.default_rng(2).standard_normal((4000, 6))
    readings[:, columns] = value
    out, findings = with_noise(readings)
    assert [(f.channel, f.kind, f.samples) for f in findings] == [(name, "stuck", 4000) for name in names]
    assert np.isnan(out[:, columns]).all() and np.isfinite(np.delete(out, columns, axis=1)).all()
    assert checked(readings)[1] == []  # without a stated noise nothing is known


def test_an_axis_whose_motion_is_within_one_step_of_its_quantisation_is_not_dead():
    """The accelerometers show their noise, the gyros nothing: they are coarse."""
    readings = np.random.default_rng(2).standard_normal((4000, 6))
    readings[:, 3] = 20.0 * np.round(2.0 * np.sin(0.01 * np.arange(4000)))
    readings[:, 4:] = 0.0
    assert [f for f in with_noise(readings)[1] if f.samples == 4000] == []


@pytest.mark.parametrize("at_rest", [0, 800])
def test_an_axis_on_which_nothing_acts_in_a_simulation_without_noise_is_not_dead(at_rest):
    """Also where the others have the oscillations of a whole flight, and are at rest for a part of it."""
    phase = np.cumsum(np.geomspace(0.01, 2.5, 4000 - at_rest))
    motion = np.concatenate((30.0 * np.sin(phase), np.zeros(at_rest)))
    readings = np.stack([motion * k for k in (1.0, 0.0, 0.5, 0.0, 0.2, 0.0)], axis=1)
    assert [f for f in with_noise(readings)[1] if f.kind == "stuck" and f.samples == 4000] == []


@pytest.mark.parametrize(("value", "kind"), [(9.0, "saturated"), (0.5, "stuck"), (0.0, "stuck")])
def test_an_axis_that_reads_one_value_in_most_of_the_record_is_lost_there(value, kind):
    """A spin rate beyond the range until the landing, and single samples within it: no run has other values nearby."""
    readings = np.random.default_rng(2).standard_normal((4000, 6))
    held = np.arange(4000) < 3000
    held[[1500, 1501, 2200]] = False
    readings[held, 3] = value
    out, findings = with_noise(readings)
    assert {(f.channel, f.kind) for f in findings} == {("rate x", kind)} and sum(f.samples for f in findings) == 2997
    np.testing.assert_array_equal(np.isnan(out[:, 3]), held)
    assert np.isfinite(np.delete(out, 3, axis=1)).all()
    assert all((f.limit is not None) == (kind == "saturated") for f in findings)


def test_an_axis_that_reads_one_value_in_most_of_a_coarse_record_is_not_lost():
    """A few steps of the quantisation contain the motion of all its axes."""
    phase = np.cumsum(np.geomspace(0.001, 0.05, 4000))
    readings = np.random.default_rng(2).standard_normal((4000, 6))
    readings[:, 3:] = 20.0 * np.round(np.outer(np.sin(phase), [1.4, 0.51, 0.2]))
    assert with_noise(readings)[1] == []


def test_a_record_of_which_no_axis_changes_has_nothing_to_compare_with():
    assert with_noise(np.tile([1.0, 2.0, 3.0, 0.1, 0.2, 0.3], (400, 1)))[1] == []
