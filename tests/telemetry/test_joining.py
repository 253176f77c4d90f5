"""Gap filling within a segment, and joining of segments."""

import numpy as np
import pytest

from edl_filter.errors import InputError
from edl_filter.imu_model.sensor_errors import SensorErrors
from edl_filter.telemetry.joining import GAP, Segment, fill_gaps, interpolated_between, join


def segment(times, unit="backshell", source="HIGHRATE", slope=1.0):
    times = np.asarray(times, float)
    n = len(times)
    return Segment(
        source=source,
        unit=unit,
        time=times,
        interval=np.full(n, 0.125),
        force=np.outer(slope * times, [1.0, 0.0, 0.0]),
        rate=np.outer(slope * times, [0.0, 0.1, 0.0]),
        position=np.tile([0.1, 0.2, 0.3], (n, 1)),
        force_noise=np.full(n, 0.003),
        rate_noise=np.full(n, 1e-5),
        shared_rate_noise=np.full(n, 1e-5),
    )


def sample_times(start, count):
    return start + 0.125 * np.arange(1, count + 1)


def test_gap_is_filled_with_linearly_interpolated_samples():
    times = np.concatenate((sample_times(0.0, 40), sample_times(5.875, 40)))  # a gap of 0.875 s after t = 5
    segments = fill_gaps(segment(times))
    assert [p.source for p in segments] == ["HIGHRATE", GAP, "HIGHRATE"]
    gap = segments[1]
    assert len(gap.time) == 7
    np.testing.assert_allclose(gap.time, sample_times(5.0, 7))
    inside = gap.force[:, 0]
    assert np.all(np.diff(inside) > 0.0) and inside[0] > 5.0 and inside[-1] < 6.0
    assert np.all(gap.force_noise > 0.003) and np.all(gap.shared_rate_noise == 0.0)


def test_sigma_in_a_gap_is_proportional_to_the_change_of_the_signal():
    times = np.concatenate((sample_times(0.0, 40), sample_times(5.875, 40)))
    small, large = (fill_gaps(segment(times, slope=slope))[1] for slope in (0.1, 10.0))
    np.testing.assert_allclose(large.force_noise, 100.0 * small.force_noise)


def test_segment_without_a_gap_is_unchanged():
    unbroken = segment(sample_times(0.0, 16))
    assert len(fill_gaps(unbroken)) == 1
    np.testing.assert_array_equal(fill_gaps(unbroken)[0].time, unbroken.time)


def test_joined_record_has_units_sources_and_adjoining_intervals():
    errors = (SensorErrors(0.1), SensorErrors(0.2))
    a, b = segment(sample_times(0.0, 8)), segment(sample_times(1.0, 8), unit="rover", source="register")
    record = join("driving", [a, b], ("backshell", "rover"), errors)
    assert record.sources == ("HIGHRATE", "register")
    np.testing.assert_array_equal(record.unit, [0] * 8 + [1] * 8)
    np.testing.assert_allclose(record.time[1:] - record.interval[1:], record.time[:-1])
    np.testing.assert_array_equal(record.edges, np.append(record.start, record.time))
    assert record.errors == errors


def test_segments_that_do_not_adjoin_raise():
    separated = [segment(sample_times(0.0, 8)), segment(sample_times(1.5, 8), unit="rover")]
    with pytest.raises(InputError, match=r"HIGHRATE of the backshell ends at 1\.0000 s .* begins at 1\.5000 s"):
        join("x", separated, ("backshell", "rover"), (SensorErrors(),) * 2)


def test_between_selects_whole_samples():
    np.testing.assert_allclose(segment(sample_times(0.0, 16)).between(0.5, 1.05).time, sample_times(0.5, 4))


@pytest.mark.parametrize("missing", [0.0, 0.125])
def test_one_sample_between_two_products_is_linear_in_time(missing):
    """Of a force and rate that are linear in time, by samples of 0.25 s before and of 0.125 s after it."""

    def linear(source, start, step, count):
        end = start + step * np.arange(1, count + 1)
        middle = (end - 0.5 * step)[:, None]
        noise = np.full(count, 1e-3)
        return Segment(
            source, "rover", end, np.full(count, step), -20.0 - 2.0 * middle * [1.0, 0.1, 0.0],
            0.2 + 0.05 * middle * np.ones(3), np.tile([0.1, 0.2, 0.3], (count, 1)), noise, noise, noise,
        )  # fmt: skip

    before, after = linear("register", 88.0, 0.25, 4), linear("HIGHRATE", 89.0 + missing, 0.125, 8)
    between = interpolated_between(before, after)
    if not missing:
        assert between == []
        return
    (sample,) = between
    assert (sample.time, sample.interval) == (pytest.approx([89.125]), pytest.approx([0.125]))
    assert sample.source == "gap" and sample.coning_corrected
    np.testing.assert_allclose(sample.force, [-20.0 - 2.0 * 89.0625 * np.array([1.0, 0.1, 0.0])], atol=1e-9)
    np.testing.assert_allclose(sample.rate, [np.full(3, 0.2 + 0.05 * 89.0625)], atol=1e-9)
    np.testing.assert_allclose(sample.force_noise, [2.0 * 0.3125], atol=1e-9)
    np.testing.assert_array_equal(sample.position, after.position[:1])
