"""Tables of a database in files: both formats, and errors in them."""

import numpy as np
import pytest

from edl_filter.aero.tables import move_moment_to_nose, read_printed_table, read_table
from edl_filter.errors import InputError

HEADER = "mach,alpha_deg,CA,CN,Cm"
ROWS = ["2,0,1.5,0,0", "2,4,1.4,0.02,-0.02", "2,10,1.3,0.05,-0.04", "6,0,1.6,0,0", "6,4,1.5,0.03,-0.02", "6,10,1.2,0,0"]


def write_table(tmp_path, rows, header=HEADER):
    path = tmp_path / "table.csv"
    path.write_text("\n".join(("# a comment", header, *rows)) + "\n", encoding="utf-8")
    return path


def test_read_table(tmp_path):
    table = read_table(write_table(tmp_path, ROWS), "mach")
    np.testing.assert_array_equal(table.nodes, [2.0, 6.0])
    np.testing.assert_allclose(table.alpha, np.radians([0.0, 4.0, 10.0]))
    assert table.CA[1, 2] == 1.2 and table.CN[0, 1] == 0.02 and table.Cm[0, 2] == -0.04


def test_printed_table_in_any_order_has_its_moment_about_the_nose(tmp_path):
    path = write_table(tmp_path, ROWS[::-1], HEADER.replace("alpha_deg", "alpha_total_deg"))
    printed, ordered = read_printed_table(path, "mach", 0.25), read_table(write_table(tmp_path, ROWS), "mach")
    np.testing.assert_array_equal(printed.CA, ordered.CA)
    np.testing.assert_allclose(printed.Cm, ordered.Cm - 0.25 * ordered.CN)
    # A normal force at the reference point has no moment about it and a nose-down one about the nose
    assert move_moment_to_nose(0.0, 0.1, 0.25) == pytest.approx(-0.025)


@pytest.mark.parametrize(
    ("rows", "header", "message"),
    [
        (ROWS, "mach,alpha,CA,CN,Cm", r"the header must be mach,alpha_deg,CA,CN,Cm; found 'mach,alpha,CA.*line 2"),
        (ROWS, "knudsen,alpha_deg,CA,CN,Cm", "the header must be mach,alpha_deg"),
        ([], HEADER, "a header but no rows"),
        ([*ROWS[:2], "2,10,1.3,nan,-0.04"], HEADER, "line 5: expected 5 finite numbers, found '2,10,1.3,nan"),
        ([*ROWS[:2], "2,10,1.3,five,0"], HEADER, "line 5: expected 5 finite numbers"),
        ([*ROWS[:2], "2,10,1.3,0"], HEADER, "line 5: expected 5 finite numbers"),
        (ROWS[3:] + ROWS[:3], HEADER, "line 6: mach must increase, but 2 follows 6"),
        ([ROWS[0], ROWS[2], ROWS[1]], HEADER, "line 5: alpha_deg must increase within mach 2, but 4 follows 10"),
        ([*ROWS[:2], ROWS[1]], HEADER, "line 5: mach 2, alpha_deg 4 is there twice"),
        (ROWS[:4] + ROWS[5:], HEADER, "line 7: the grid has a hole: mach 6 has no row for 4 degrees"),
        (ROWS[:3], HEADER, "at least 2 values of mach and 2 angles are needed; found 1 and 3"),
        (["-1,0,1,0,0"], HEADER, "line 3: mach must be positive, found -1"),
        (["1,-2,1,0,0"], HEADER, "line 3: the total angle must lie in 0 to 180 degrees, found -2"),
        (["1,0,0,0,0"], HEADER, "line 3: CA must be positive for a vehicle that flies nose first"),
        (["1,0,-1.5,0,0"], HEADER, "found -1.5; drag gives the density"),
    ],
)
def test_invalid_table_raises(tmp_path, rows, header, message):
    with pytest.raises(InputError, match=message):
        read_table(write_table(tmp_path, rows, header), "mach")


def test_invalid_file_raises(tmp_path):
    with pytest.raises(InputError, match="cannot be read"):
        read_table(tmp_path / "none.csv", "mach")
    with pytest.raises(InputError, match="line 9: mach 6, alpha_total_deg 10 is there twice"):
        read_printed_table(write_table(tmp_path, [*ROWS, ROWS[5]], HEADER.replace("_deg", "_total_deg")), "mach", 0.2)
    (tmp_path / "table.csv").write_bytes(b"\xff\xfe")
    with pytest.raises(InputError, match="no text file"):
        read_table(tmp_path / "table.csv", "mach")
