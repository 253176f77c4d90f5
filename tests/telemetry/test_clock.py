import numpy as np
import pytest

from edl_filter.errors import InputError
from edl_filter.telemetry.clock import SclkClock, label_utc, parse_utc
from edl_filter.telemetry.pds3 import read_label

# By spacecraft number. The reference is the start of each HIGHRATE table: the one count of each label that is a
# whole second, where both readings of the fraction agree.
MER_CLOCKS = {
    1: SclkClock(128278284.0, "2004-01-25T04:50:11.164"),
    2: SclkClock(126462175.0, "2004-01-04T04:21:21.532"),
}

# (spacecraft, count, UTC) as the eight times in the four labels have them
LABELS = [
    (1, "128278284.000", "2004-01-25T04:50:11.164"),
    (1, "128277294.125", "2004-01-25T04:33:41.653"),
    (1, "128279154.875", "2004-01-25T05:04:44.582"),
    (2, "126462175.000", "2004-01-04T04:21:21.532"),
    (2, "126462487.500", "2004-01-04T04:26:35.485"),
    (2, "126461185.125", "2004-01-04T04:04:52.022"),
    (2, "126463048.125", "2004-01-04T04:35:55.020"),
]


def milliseconds_apart(a, b):
    return abs((parse_utc(a) - parse_utc(b)).total_seconds()) * 1e3


@pytest.mark.parametrize(("spacecraft", "count", "utc"), LABELS)
def test_labels_read_the_fraction_in_ticks_of_1_256(spacecraft, count, utc):
    assert milliseconds_apart(label_utc(MER_CLOCKS[spacecraft], count), utc) <= 2.0


def test_the_eighth_label_time_belongs_to_another_count():
    # 1HIGHRATE's stop label writes ...594.500; its UTC is that of ...594.000, the last row of the table
    stop = "2004-01-25T04:55:21.164"
    assert milliseconds_apart(label_utc(MER_CLOCKS[1], "128278594.000"), stop) <= 2.0
    assert milliseconds_apart(label_utc(MER_CLOCKS[1], "128278594.500"), stop) > 1900.0


def test_the_list_above_is_what_the_real_labels_say(mer_folder):
    found = []
    for path in sorted((mer_folder / "DATA").glob("*.LBL")):
        label = read_label(path)
        for edge in ("START", "STOP"):
            count = label[f"SPACECRAFT_CLOCK_{edge}_COUNT"]
            found.append((int(path.name[0]), count, label[f"{edge}_TIME"]))
    assert set(found) - set(LABELS) == {(1, "128278594.500", "2004-01-25T04:55:21.164")}
    assert len(found) == 8


def test_the_true_time_of_a_fractional_count():
    assert MER_CLOCKS[2].to_utc(126461185.125) == "2004-01-04T04:04:51.657"
    assert MER_CLOCKS[1].to_utc(128277294.125) == "2004-01-25T04:33:41.289"


def test_there_and_back():
    clock = SclkClock(1000.0, "2004-01-04T23:59:59.500")
    assert clock.to_utc(1001.0) == "2004-01-05T00:00:00.500"
    assert clock.from_utc("2004-01-05T00:00:00.500") == 1001.0
    assert clock.from_utc("2004-01-05T01:00:00.500+01:00") == 1001.0
    np.testing.assert_array_equal(clock.since("2004-01-04T23:59:59.500", [999.0, 1002.25]), [-1.0, 2.25])
    expected = np.array(["2004-01-04T23:59:58.500", "2004-01-05T00:00:01.750"], "datetime64[us]")
    np.testing.assert_array_equal(clock.to_datetime64([999.0, 1002.25]), expected)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: SclkClock(0.0, "the fourth of January"), "is no UTC time; ISO 8601"),
        (lambda: label_utc(MER_CLOCKS[1], "12x.5"), "'12x.5' is no spacecraft clock count"),
        (lambda: label_utc(MER_CLOCKS[1], "125"), "'125' is no spacecraft clock count"),
    ],
)
def test_bad_input(make, message):
    with pytest.raises(InputError, match=message):
        make()
