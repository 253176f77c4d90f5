import numpy as np
import pytest

from edl_filter.errors import InputError
from edl_filter.telemetry.joining import GAP, Piece, fill_gaps, join
from edl_filter.telemetry.record import SensorErrors


def piece(times, unit="backshell", source="HIGHRATE", slope=1.0):
    times = np.asarray(times, float)
    n = len(times)
    return Piece(
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


def grid(start, count):
    return start + 0.125 * np.arange(1, count + 1)


def test_a_gap_is_bridged_by_samples_on_the_line_between_its_sides():
    times = np.concatenate((grid(0.0, 40), grid(5.875, 40)))  # 0.875 s missing after t = 5
    pieces = fill_gaps(piece(times))
    assert [p.source for p in pieces] == ["HIGHRATE", GAP, "HIGHRATE"]
    gap = pieces[1]
    assert len(gap.time) == 7
    np.testing.assert_allclose(gap.time, grid(5.0, 7))
    inside = gap.force[:, 0]
    assert np.all(np.diff(inside) > 0.0) and inside[0] > 5.0 and inside[-1] < 6.0
    assert np.all(gap.force_noise > 0.003) and np.all(gap.shared_rate_noise == 0.0)


def test_the_bridges_sigma_grows_with_how_much_the_signal_changes():
    times = np.concatenate((grid(0.0, 40), grid(5.875, 40)))
    calm, wild = (fill_gaps(piece(times, slope=s))[1] for s in (0.1, 10.0))
    np.testing.assert_allclose(wild.force_noise, 100.0 * calm.force_noise)


def test_no_gap_leaves_the_piece_alone():
    whole = piece(grid(0.0, 16))
    assert len(fill_gaps(whole)) == 1
    np.testing.assert_array_equal(fill_gaps(whole)[0].time, whole.time)


def test_join_keeps_units_sources_and_adjoining_intervals():
    errors = (SensorErrors(0.1), SensorErrors(0.2))
    a, b = piece(grid(0.0, 8)), piece(grid(1.0, 8), unit="rover", source="register")
    record = join("driving", [a, b], ("backshell", "rover"), errors)
    assert record.sources == ("HIGHRATE", "register")
    np.testing.assert_array_equal(record.unit, [0] * 8 + [1] * 8)
    np.testing.assert_allclose(record.time[1:] - record.interval[1:], record.time[:-1])
    assert record.errors == errors


def test_pieces_that_do_not_adjoin_are_named():
    apart = [piece(grid(0.0, 8)), piece(grid(1.5, 8), unit="rover")]
    with pytest.raises(InputError, match=r"HIGHRATE of the backshell ends at 1\.0000 s .* begins at 1\.5000 s"):
        join("x", apart, ("backshell", "rover"), (SensorErrors(),) * 2)


def test_between_takes_whole_samples():
    np.testing.assert_allclose(piece(grid(0.0, 16)).between(0.5, 1.05).time, grid(0.5, 4))
