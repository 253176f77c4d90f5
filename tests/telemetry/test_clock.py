"""Spacecraft clock to UTC, and the clock references of the MER missions against the UTC in the PDS labels."""

import numpy as np
import pytest

from edl_filter.errors import InputError
from edl_filter.telemetry.clock import SclkClock, parse_utc
from edl_filter.telemetry.pds3 import read_label

# By spacecraft number. The reference is the start of each HIGHRATE table: the only count of each label that is a whole
# second, at which both interpretations of the fraction agree.
MER_CLOCKS = {
    1: SclkClock(128278284.0, "2004-01-25T04:50:11.164"),
    2: SclkClock(126462175.0, "2004-01-04T04:21:21.532"),
}

# (spacecraft, count, UTC) in the four labels; the eighth time is wrong, see below
LABELS = [
    (1, "128278284.000", "2004-01-25T04:50:11.164"),
    (1, "128277294.125", "2004-01-25T04:33:41.653"),
    (1, "128279154.875", "2004-01-25T05:04:44.582"),
    (2, "126462175.000", "2004-01-04T04:21:21.532"),
    (2, "126462487.500", "2004-01-04T04:26:35.485"),
    (2, "126461185.125", "2004-01-04T04:04:52.022"),
    (2, "126463048.125", "2004-01-04T04:35:55.020"),
]


def label_utc(clock, count):
    """UTC that MER's PDS labels state for a clock count such as ``"126461185.125"``.

    The tables' clock column is in decimal seconds. The software that wrote the labels' UTC interpreted the digits after
    the point as a number of ticks of 1/256 s (NAIF's convention for this clock): .125 became 125/256 s, .500 became
    500/256 s = 1.953 s. UTC in the labels is therefore up to 2.5 s late.
    """
    seconds, ticks = count.split(".")
    return clock.to_utc(int(seconds) + int(ticks) / 256.0)


def milliseconds_apart(a, b):
    return abs((parse_utc(a) - parse_utc(b)).total_seconds()) * 1e3


@pytest.mark.parametrize(("spacecraft", "count", "utc"), LABELS)
def test_labels_interpret_the_fraction_as_ticks_of_1_256_s(spacecraft, count, utc):
    assert milliseconds_apart(label_utc(MER_CLOCKS[spacecraft], count), utc) <= 2.0


def test_eighth_label_time_is_that_of_another_count():
    # The stop count in 1HIGHRATE's label is ...594.500; its UTC is that of ...594.000, the last row of the table
    stop = "2004-01-25T04:55:21.164"
    assert milliseconds_apart(label_utc(MER_CLOCKS[1], "128278594.000"), stop) <= 2.0
    assert milliseconds_apart(label_utc(MER_CLOCKS[1], "128278594.500"), stop) > 1900.0


def test_list_of_label_times_is_complete(mer_folder):
    times = []
    for path in sorted((mer_folder / "DATA").glob("*.LBL")):
        label = read_label(path)
        for edge in ("START", "STOP"):
            count = label[f"SPACECRAFT_CLOCK_{edge}_COUNT"]
            times.append((int(path.name[0]), count, label[f"{edge}_TIME"]))
    assert set(times) - set(LABELS) == {(1, "128278594.500", "2004-01-25T04:55:21.164")}
    assert len(times) == 8


def test_utc_of_a_fractional_count():
    assert MER_CLOCKS[2].to_utc(126461185.125) == "2004-01-04T04:04:51.657"
    assert MER_CLOCKS[1].to_utc(128277294.125) == "2004-01-25T04:33:41.289"


def test_utc_across_midnight():
    clock = SclkClock(1000.0, "2004-01-04T23:59:59.500")
    assert clock.to_utc(1001.0) == "2004-01-05T00:00:00.500"
    with_time_zone = SclkClock(1000.0, "2004-01-05T00:59:59.500+01:00")
    assert with_time_zone.to_utc(1001.0) == "2004-01-05T00:00:00.500"
    expected = np.array(["2004-01-04T23:59:58.500", "2004-01-05T00:00:01.750"], "datetime64[us]")
    np.testing.assert_array_equal(clock.to_datetime64([999.0, 1002.25]), expected)


def test_reference_that_is_no_time_raises():
    with pytest.raises(InputError, match="is no UTC time; ISO 8601"):
        SclkClock(0.0, "the fourth of January")


@pytest.mark.parametrize("text", ["2031-05-04T12:00:00" + "9" * 5000, "0001-01-01T00:00:00+14:00"])
def test_a_time_that_is_too_long_or_before_the_calendar_is_refused_in_one_sentence(text):
    with pytest.raises(InputError, match="is no UTC time; ISO 8601") as raised:
        parse_utc(text)
    assert len(str(raised.value)) < 200
