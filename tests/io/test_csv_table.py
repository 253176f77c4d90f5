"""Tables in CSV: comments, headers, and errors that name the line."""

import pytest

from edl_filter.errors import InputError
from edl_filter.io.csv_table import Row, check_monotonic, package_data, read_records, read_rows

TEXT = "# a comment\n\nx, y\n1, 20  # another comment\n2,30\n"


@pytest.fixture
def path(tmp_path):
    path = tmp_path / "table.csv"
    path.write_text(TEXT)
    return path


def test_rows_have_their_line_numbers_and_no_comments(path):
    assert read_rows(path, ("x", "y"), "table") == [Row(4, [1.0, 20.0]), Row(5, [2.0, 30.0])]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "the header must be x,y; found an empty file"),
        ("y,x\n1,2\n", "the header must be x,y; found 'y,x' in line 1"),
        ("x,y\n", "the table has a header but no rows"),
        (TEXT + "3,four\n", "line 6: expected 2 finite numbers, found '3,four'"),
        (TEXT + "3,inf\n", "line 6: expected 2 finite numbers"),
        (TEXT + "3\n", "line 6: expected 2 finite numbers"),
    ],
)
def test_invalid_table_raises(path, text, message):
    path.write_text(text)
    with pytest.raises(InputError, match=message):
        read_rows(path, ("x", "y"), "table")


def test_unreadable_file_raises_with_the_kind_of_table(tmp_path):
    with pytest.raises(InputError, match=r"none.csv: the damping table cannot be read \(No such file"):
        read_rows(tmp_path / "none.csv", ("x", "y"), "damping table")
    (tmp_path / "binary.csv").write_bytes(b"\xff\xfe")
    with pytest.raises(InputError, match="the damping table is no text file"):
        read_rows(tmp_path / "binary.csv", ("x", "y"), "damping table")


def test_monotonic_columns(path):
    rows = read_rows(path, ("x", "y"), "table")
    check_monotonic(path, rows, 1, "y")
    with pytest.raises(InputError, match="line 5: y must decrease, but 30 follows 20"):
        check_monotonic(path, rows, 1, "y", decreasing=True)
    with pytest.raises(InputError, match="line 5: y must increase, but 20 follows 20"):
        check_monotonic(path, [Row(4, [1.0, 20.0]), Row(5, [2.0, 20.0])], 1, "y")


def test_records_need_their_columns(path):
    path.write_text("# a comment\nname,size\nA,1\nB\n")
    assert read_records(path, ("name",)) == [{"name": "A", "size": "1"}, {"name": "B", "size": None}]
    with pytest.raises(InputError, match=r"table.csv: the columns mass, area are missing"):
        read_records(path, ("name", "mass", "area"))


def test_package_data_exists():
    assert package_data("mars_reference.csv").is_file()
