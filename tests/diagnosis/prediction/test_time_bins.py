"""Time bins: means against overlaps that are summed one by one; which bins are compared."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from edl_filter.diagnosis.prediction.time_bins import bin_means, make_time_bins
from edl_filter.mission.decision_settings import DecisionSettings
from edl_filter.navigation.increments import Samples

LENGTH, END = DecisionSettings().bin_length_s, DecisionSettings().excluded_end_bins


def samples_of(edges):
    """A body at rest, sampled between `edges`."""
    n = len(edges) - 1
    zero, no_noise = np.zeros((n, 3)), np.zeros(n)
    return Samples(
        time=edges[1:],
        interval=np.diff(edges),
        force=zero,
        rate=zero,
        mean_force=zero.copy(),
        mean_rate=zero,
        force_noise=no_noise,
        rate_noise=no_noise,
        shared_rate_noise=no_noise,
        coning_corrected=np.zeros(n, bool),
        unit=np.zeros(n, np.int64),
    )


def make_bins(samples, edges, end):
    """Bins with the default settings."""
    return make_time_bins(samples, edges, end, LENGTH, END)


def samples_per_bin(bins, rate):
    """Number of samples in a bin between gaps."""
    return round(np.median(bins.interval) * rate)


def regular_edges(rate, length=10.0, begin=50.0):
    return begin + np.arange(round(length * rate) + 1) / rate


def slow_means(edges, grid, values):
    """Sum of the overlaps of every bin with every interval."""
    out = np.zeros((len(edges) - 1, *values.shape[1:]))
    for b in range(len(edges) - 1):
        for i in range(len(grid) - 1):
            overlap = min(edges[b + 1], grid[i + 1]) - max(edges[b], grid[i])
            if overlap > 0.0:
                out[b] += values[i] * overlap / (edges[b + 1] - edges[b])
    return out


@given(
    st.lists(st.floats(1e-3, 2.0), min_size=1, max_size=12),
    st.lists(st.floats(0.0, 1.0), min_size=2, max_size=8, unique=True),
    st.sampled_from([(), (3,), (2, 2)]),
    st.integers(0, 1000),
)
def test_means_are_sums_of_overlaps(lengths, shares, shape, seed):
    grid = -5.0 + np.concatenate(([0.0], np.cumsum(lengths)))
    edges = grid[0] + np.sort(shares) * (grid[-1] - grid[0])
    edges = edges[np.concatenate(([True], np.diff(edges) > 1e-4))]
    values = np.random.default_rng(seed).normal(size=(len(lengths), *shape))
    means = bin_means(edges, grid[1:], np.diff(grid), values)
    np.testing.assert_allclose(means, slow_means(edges, grid, values), atol=1e-9)


def test_means_of_a_sampled_sine():
    """Samples are means of a sine; the means over bins of two samples are the sine's means over both."""
    grid = np.linspace(0.0, 4.0, 41)
    samples = -np.diff(np.cos(grid)) / np.diff(grid)
    means = bin_means(grid[::2], grid[1:], np.diff(grid), samples)
    np.testing.assert_allclose(means, -np.diff(np.cos(grid[::2])) / 0.2, atol=1e-12)


def test_bins_that_are_not_covered_have_no_mean():
    grid = np.arange(11.0)
    means = bin_means(np.array([-1.0, 0.5, 1.0, 9.0, 10.0, 10.5]), grid[1:], np.diff(grid), np.ones((10, 3)))
    np.testing.assert_array_equal(np.isnan(means).all(axis=1), [True, False, False, False, True])
    np.testing.assert_allclose(means[1:4], 1.0)


def test_a_rounding_error_of_an_edge_leaves_the_bin_covered():
    grid = np.arange(4.0)
    assert bin_means(np.array([-1e-9, 3.0 + 1e-9]), grid[1:], np.diff(grid), np.ones(3)) == pytest.approx(1.0)


@pytest.mark.parametrize(("rate", "per_bin"), [(8, 1), (20, 2), (50, 4), (200, 20)])
def test_bins_are_about_a_tenth_of_a_second(rate, per_bin):
    edges = regular_edges(rate)
    bins = make_bins(samples_of(edges), edges, 60.0)
    np.testing.assert_allclose(bins.interval, per_bin / rate, rtol=1e-9)
    np.testing.assert_allclose(bins.edges, edges[::per_bin])
    np.testing.assert_allclose(bins.middle, bins.edges[:-1] + 0.5 * per_bin / rate)


@given(st.floats(1.0, 1000.0))
def test_a_bin_has_one_sample_or_the_even_number_nearest_to_a_tenth_of_a_second(rate):
    edges = regular_edges(rate, length=max(4.0, 40.0 / rate))
    bins = make_bins(samples_of(edges), edges, edges[-1])
    if 1.0 / rate > 0.75 * LENGTH:
        assert samples_per_bin(bins, rate) == 1
    else:
        assert samples_per_bin(bins, rate) % 2 == 0
        assert abs(samples_per_bin(bins, rate) - LENGTH * rate) <= 1.0 + 1e-9  # no other even number is nearer


@pytest.mark.parametrize("rate", [8, 20, 200])
def test_all_bins_but_those_at_the_ends_are_valid(rate):
    edges = regular_edges(rate)
    valid = make_bins(samples_of(edges), edges, 60.0).valid
    assert not valid[:END].any() and not valid[-END:].any() and valid[END:-END].all()


@pytest.mark.parametrize("rate", [8, 50])
def test_the_last_bin_ends_before_the_end(rate):
    edges = regular_edges(rate)
    bins = make_bins(samples_of(edges), edges, 57.03)
    assert bins.edges[-1] <= 57.03 < bins.edges[-1] + samples_per_bin(bins, rate) / rate
    assert not bins.valid[-END:].any()


def invalid_bins(bins):
    """Bins between the ends that are not compared."""
    return list(np.flatnonzero(~bins.valid[END:-END]) + END)


@pytest.mark.parametrize(("rate", "per_bin"), [(8, 1), (20, 2)])
def test_a_gap_is_one_bin_that_is_not_compared(rate, per_bin):
    edges = regular_edges(rate)
    gap = (edges > 55.0 + 1e-6) & (edges < 56.0 - 1e-6)
    bins = make_bins(samples_of(edges[~gap]), edges[~gap], 60.0)
    (invalid,) = invalid_bins(bins)
    assert bins.edges[invalid] <= 55.0 + 1e-9 and bins.edges[invalid + 1] >= 56.0 - 1e-9
    assert bins.interval[invalid] == pytest.approx(1.0 + (per_bin - 1) / rate)


@pytest.mark.parametrize(("rate", "expected"), [(8, [40, 41, 42]), (20, [20, 21])])
def test_net_turns_other_units_and_missing_forces_are_not_compared(rate, expected):
    """Samples 40 to 42 of 80 or 200."""
    edges = regular_edges(rate)
    valid_samples = samples_of(edges)
    affected = np.zeros(len(valid_samples.time), bool)
    affected[40:43] = True
    force = valid_samples.mean_force.copy()
    force[affected, 1] = np.nan
    for samples in (
        replace(valid_samples, coning_corrected=affected),
        replace(valid_samples, unit=affected.astype(np.int64)),
        replace(valid_samples, mean_force=force),
    ):
        assert invalid_bins(make_bins(samples, edges, 60.0)) == expected


def test_samples_of_the_first_instrument_are_compared():
    edges = regular_edges(8)
    unit = np.where(np.arange(80) < 60, 1, 0)
    assert invalid_bins(make_bins(replace(samples_of(edges), unit=unit), edges, 60.0)) == list(range(60, 77))


@given(st.lists(st.floats(50.0, 60.0), max_size=6))
def test_samples_cut_at_further_times_have_the_same_bins(times):
    edges = regular_edges(20)
    samples = replace(samples_of(edges), coning_corrected=np.arange(200) == 77)
    uncut, cut = (make_bins(s, edges, 59.0) for s in (samples, samples.split(np.array(times))))
    np.testing.assert_array_equal(uncut.edges, cut.edges)
    np.testing.assert_array_equal(uncut.valid, cut.valid)


def test_length_and_excluded_ends_are_settings():
    edges = regular_edges(20)
    bins = make_time_bins(samples_of(edges), edges, 60.0, 0.2, 1)
    assert samples_per_bin(bins, 20) == 4
    assert list(np.flatnonzero(~bins.valid)) == [0, len(bins.valid) - 1]


@pytest.mark.parametrize(
    ("event", "expected"),
    [
        (55.0, range(37, 43)),  # at an edge: three bins before and three after
        (55.01, range(37, 43)),  # a time that is stated a little late
        (55.1, range(38, 44)),  # near the next edge
        (49.0, ()),
        (61.0, ()),
    ],
)
def test_bins_near_an_event_that_changes_the_vehicle_are_not_compared(event, expected):
    edges = regular_edges(8)
    bins = make_time_bins(samples_of(edges), edges, 70.0, LENGTH, END, [event])
    ends = {*range(END), *range(80 - END, 80)}
    assert set(np.flatnonzero(~bins.valid)) - ends == set(expected)


@given(st.floats(-0.06, 0.06))
def test_a_smooth_quantity_is_interpolated_between_the_ends_of_the_samples(offset):
    """Two instruments whose samples end at different times."""
    grid, w = 0.125 * np.arange(81), 2.0 * np.pi * 0.7
    integral = -np.cos(w * grid) / w
    values = np.diff(integral)[:, None] / 0.125
    edges = grid[5:-5] + offset
    true = np.diff(-np.cos(w * edges) / w) / 0.125
    smooth, constant = (bin_means(edges, grid[1:], np.diff(grid), values, smooth=s)[:, 0] for s in (True, False))
    assert np.abs(smooth - true).max() < (1e-5 if abs(offset) < 0.0025 else 2e-4)
    if abs(offset) > 1e-4:  # below it both have the interpolation's own error of 1e-6
        assert np.abs(constant - true).max() >= np.abs(smooth - true).max()
    if abs(offset) > 0.002:
        assert np.abs(constant - true).max() > 1e-3


def test_next_to_a_gap_a_bin_that_ends_inside_a_sample_is_nan():
    grid = np.concatenate((0.125 * np.arange(20), 0.125 * np.arange(30, 50)))
    values = np.ones((39, 3))
    values[19] = np.nan
    edges = 0.125 * np.arange(1, 19)
    for offset, lost in ((0.0, []), (0.05, [0, 15, 16]), (0.005, [])):
        means = bin_means(edges + offset, grid[1:], np.diff(grid), values, smooth=True)
        np.testing.assert_array_equal(np.flatnonzero(np.isnan(means[:, 0])), lost)
        np.testing.assert_allclose(np.delete(means, lost, axis=0), 1.0)


def test_a_value_that_is_nan_is_lost_in_its_bins_only():
    time, interval = np.arange(1, 41) * 0.5, np.full(40, 0.5)
    values = np.sin(time)[:, None] * np.ones(3)
    lost = values.copy()
    lost[17] = np.nan
    edges = np.arange(0.0, 20.1, 1.0)
    complete, means = bin_means(edges, time, interval, values), bin_means(edges, time, interval, lost)
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(means).any(axis=1)), [8])
    np.testing.assert_allclose(np.delete(means, 8, axis=0), np.delete(complete, 8, axis=0), atol=1e-12)
    smooth = bin_means(edges + 0.2, time, interval, lost, smooth=True)
    expected = bin_means(edges + 0.2, time, interval, values, smooth=True)
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(expected).any(axis=1)), [0, 18, 19])
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(smooth).any(axis=1)), [0, 7, 8, 9, 18, 19])
    both = ~np.isnan(smooth)
    np.testing.assert_allclose(smooth[both], expected[both], atol=1e-4)


@given(st.integers(3, 30), st.integers(3, 30), st.floats(0.01, 0.24))
def test_excluded_samples_interpolate_those_next_to_them(first, length, offset):
    """Samples of 4 Hz and bins of 8 Hz that end within them; the closed form of a sine."""
    grid, w = 0.25 * np.arange(41), 2.0 * np.pi * 0.5
    values = (-np.diff(np.cos(w * grid)) / w / 0.25)[:, None]
    excluded = np.zeros(40, bool)
    excluded[first : first + length] = True
    edges = np.arange(1.0 + offset, 9.0, 0.125)
    true = (-np.diff(np.cos(w * edges)) / w / 0.125)[:, None]
    means = bin_means(edges, grid[1:], np.diff(grid), values, smooth=True, excluded=excluded)
    touched = (edges[:-1] < 0.25 * (first + length) - 1e-9) & (edges[1:] > 0.25 * first + 1e-9)
    np.testing.assert_array_equal(np.isnan(means[:, 0]), touched)
    complete = bin_means(edges, grid[1:], np.diff(grid), values, smooth=True)
    np.testing.assert_array_equal(means[~touched], complete[~touched])
    assert np.abs(complete - true).max() < 0.003
    values[excluded] = np.nan
    alone = bin_means(edges, grid[1:], np.diff(grid), values, smooth=True)
    nearest = np.abs(edges[:, None] - grid[:-1][excluded]).min(axis=1)
    near = np.minimum(nearest[:-1], nearest[1:]) < 0.75
    assert np.isnan(alone[touched]).all() and not np.isnan(alone[~near]).any()


def test_a_jump_after_the_last_bin_is_not_in_it():
    """A parachute opens three samples after the last edge; the samples end between those of the bins."""
    grid = 0.125 * np.arange(81)
    values = np.where(grid[1:, None] > 8.5, 100.0, grid[1:, None] - 0.0625)
    edges = 0.125 * np.arange(8, 66) + 0.05
    means = bin_means(edges, grid[1:], np.diff(grid), values, smooth=True)[:, 0]
    np.testing.assert_allclose(means, 0.5 * (edges[1:] + edges[:-1]), atol=1e-9)


def test_bins_with_filled_samples_are_not_compared():
    edges = regular_edges(20.0)
    samples = samples_of(edges)
    filled = np.zeros((len(samples.time), 3))
    filled[101, 1] = 1e-3
    bins = make_bins(samples, edges, edges[-1])
    changed = make_bins(replace(samples, rate_fill_sigma=filled), edges, edges[-1])
    np.testing.assert_array_equal(np.flatnonzero(bins.valid != changed.valid), [101 // samples_per_bin(bins, 20)])


def test_no_bin_is_excluded_at_the_ends_where_the_setting_is_zero():
    edges = regular_edges(20)
    assert make_time_bins(samples_of(edges), edges, 60.0, 0.2, 0).valid.all()
    assert not make_time_bins(samples_of(edges), edges, 60.0, 0.2, 1000).valid.any()
