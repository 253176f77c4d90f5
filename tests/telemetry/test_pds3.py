"""Reader of PDS3 tables on a small constructed one and on the real ones."""

import shutil
import time

import numpy as np
import pytest

from edl_filter.errors import InputError
from edl_filter.telemetry.pds3 import read_label, read_table

LABEL = """PDS_VERSION_ID = PDS3 /* a comment with KEY = VALUE
   over two lines */
RECORD_TYPE = FIXED_LENGTH
RECORD_BYTES = 18
FILE_RECORDS = 3
^TABLE = "small.tab"
PRODUCER = {"A", "B"}
OBJECT = TABLE
  INTERCHANGE_FORMAT = ASCII
  ROW_BYTES = 18 <BYTES>
  ROWS = 3
  COLUMNS = 2
  OBJECT = COLUMN
    NAME = "TIME"
    DATA_TYPE = ASCII_REAL
    START_BYTE = 1
    BYTES = 7
    UNIT = SECOND
    DESCRIPTION = "Time, with an = and
                   a /* no comment */ in it"
  END_OBJECT = COLUMN
  OBJECT = COLUMN
    NAME = SPEED
    DATA_TYPE = ASCII_REAL
    START_BYTE = 9
    BYTES = 8
  END_OBJECT
END_OBJECT = TABLE
END
"""
ROWS = ["   1.25   -2.500", "   1.50    3.000", "   1.75    1.0e2"]


def write_table(folder, label=LABEL, rows=ROWS, table="SMALL.TAB", end="\r\n"):
    (folder / "SMALL.LBL").write_text(label, newline="")
    if rows is not None:
        (folder / table).write_text("".join(row + end for row in rows), newline="")
    return folder / "SMALL.LBL"


def test_label_with_nested_objects_comments_and_multiline_strings(tmp_path):
    label = read_label(write_table(tmp_path))
    assert label["RECORD_BYTES"] == 18
    assert label["PRODUCER"] == ["A", "B"]
    columns = label["TABLE"][0]["COLUMN"]
    assert [c["NAME"] for c in columns] == ["TIME", "SPEED"]
    assert columns[0]["DESCRIPTION"] == "Time, with an = and a /* no comment */ in it"


def test_columns_are_read_by_their_bytes_and_the_file_name_in_any_case(tmp_path):
    table = read_table(write_table(tmp_path))
    assert table.path.name == "SMALL.TAB"
    np.testing.assert_array_equal(table.columns["TIME"], [1.25, 1.5, 1.75])
    np.testing.assert_array_equal(table.stack("SPEED", "TIME")[:, 0], [-2.5, 3.0, 100.0])
    assert table.units == {"TIME": "SECOND", "SPEED": ""}
    assert sorted(len(sha) for sha in table.files.values()) == [64, 64]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"rows": None}, r"its table small.tab is not in"),
        ({"rows": ROWS[:2]}, r"36 bytes in 2 lines, but SMALL.LBL says 3 rows of 18 bytes = 54; .*truncated"),
        ({"rows": [*ROWS, ROWS[0]]}, r"72 bytes in 4 lines.*the label disagrees with its table"),
        ({"end": "\n"}, r"CR-LF line ends were changed to LF"),
        ({"rows": [ROWS[0] + " ", ROWS[1][:-1], ROWS[2]]}, r"row 1: no line end after ROW_BYTES = 18"),
        ({"rows": [ROWS[0], "   1.50   broken", ROWS[2]]}, r"SMALL.TAB, row 2, column SPEED: found 'broken'"),
        ({"rows": [ROWS[0], ROWS[1], "   1.75         "]}, r"row 3, column SPEED: found ''"),
        ({"rows": [ROWS[0], "    NaN    3.000", ROWS[2]]}, r"row 2, column TIME: found 'NaN'; a finite"),
        (
            {"label": LABEL.replace("FILE_RECORDS = 3", "FILE_RECORDS = 4")},
            r"FILE_RECORDS is 4, but ROWS is 3",
        ),
        (
            {"label": LABEL.replace("RECORD_BYTES = 18", "RECORD_BYTES = 20")},
            r"RECORD_BYTES is 20, but ROW_BYTES",
        ),
        ({"label": LABEL.replace("COLUMNS = 2", "COLUMNS = 5")}, r"COLUMNS is 5, but it describes 2 columns"),
        (
            {"label": LABEL.replace("BYTES = 8", "BYTES = 18")},
            r"column SPEED ends at byte 26, beyond ROW_BYTES",
        ),
        ({"label": LABEL.replace("ROWS = 3", "ROWS = three")}, r"ROWS is 'three'; a positive integer"),
        ({"label": LABEL.replace("= PDS3", "= PDS4")}, r"PDS_VERSION_ID is 'PDS4', not PDS3"),
        ({"label": LABEL.replace("^TABLE", "^IMAGE")}, r"no \^TABLE pointer"),
        ({"label": LABEL.replace("END_OBJECT = TABLE\n", "")}, r"OBJECT = TABLE is never closed"),
        ({"label": LABEL.replace("\nEND\n", "\n")}, r"line \d+: found 'the end of the file'"),
        ({"label": LABEL.replace("FIXED_LENGTH", "FIXED LENGTH")}, r"line 3: found 'LENGTH'"),
        ({"label": LABEL.replace('"TIME"', "SPEED")}, r"two columns are called SPEED"),
    ],
)
def test_bad_input_raises_one_line(tmp_path, change, message):
    with pytest.raises(InputError, match=message) as raised:
        read_table(write_table(tmp_path, **change))
    assert str(tmp_path) in str(raised.value)
    assert "\n" not in str(raised.value)


def test_missing_label_and_missing_column_raise(tmp_path):
    with pytest.raises(InputError, match=r"NONE.LBL: no such label"):
        read_table(tmp_path / "NONE.LBL")
    with pytest.raises(InputError, match=r"no column MASS; the label has TIME, SPEED"):
        read_table(write_table(tmp_path)).stack("TIME", "MASS")


def test_real_tables_equal_loadtxt(mer_folder):
    for label in sorted((mer_folder / "DATA").glob("*.LBL")):
        table = read_table(label)
        expected = np.loadtxt(table.path)
        np.testing.assert_array_equal(table.stack(*table.columns), expected)
        assert len(expected) == table.label["FILE_RECORDS"]


def test_reading_takes_at_most_twice_as_long_as_loadtxt(mer_folder):
    """Both are timed alternately, so that the result is independent of the machine."""
    label = mer_folder / "DATA" / "2TRANSFORMED.LBL"
    path = read_table(label).path

    def duration(read, file):
        start = time.perf_counter()
        read(file)
        return time.perf_counter() - start

    durations = np.array([(duration(read_table, label), duration(np.loadtxt, path)) for _ in range(7)])
    fastest_read_table, fastest_loadtxt = durations.min(axis=0)
    assert fastest_read_table < 2.0 * fastest_loadtxt


def test_label_of_another_table_raises(mer_folder, tmp_path):
    shutil.copy(mer_folder / "DATA" / "2HIGHRATE.LBL", tmp_path)
    shutil.copy(mer_folder / "DATA" / "1HIGHRATE.TAB", tmp_path / "2HIGHRATE.TAB")
    with pytest.raises(InputError, match=r"2476 lines, but 2HIGHRATE.LBL says 2495 rows"):
        read_table(tmp_path / "2HIGHRATE.LBL")
