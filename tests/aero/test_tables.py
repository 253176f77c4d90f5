"""Grid tables: interpolation against scipy's, edges, the two file formats, and errors in files."""

import numpy as np
import pytest
from scipy.interpolate import PchipInterpolator, RegularGridInterpolator

from edl_filter.aero.grid import GridTable
from edl_filter.aero.tables import move_moment_to_nose, read_printed_table, read_table
from edl_filter.errors import InputError

HEADER = "mach,alpha_deg,CA,CN,Cm"
ROWS = ["2,0,1.5,0,0", "2,4,1.4,0.02,-0.02", "2,10,1.3,0.05,-0.04", "6,0,1.6,0,0", "6,4,1.5,0.03,-0.02", "6,10,1.2,0,0"]


def write_table(tmp_path, rows, header=HEADER):
    path = tmp_path / "table.csv"
    path.write_text("\n".join(("# a comment", header, *rows)) + "\n", encoding="utf-8")
    return path


def random_table(kind="mach", interpolation="linear"):
    rng = np.random.default_rng(1)
    nodes = np.array([0.5, 2.0, 3.0, 11.0]) if kind == "mach" else np.array([1e-3, 2e-2, 1.0, 10.0])
    alpha = np.radians([0.0, 1.0, 4.0, 9.0, 16.0])
    ca, cn, cm = rng.normal(size=(3, 4, 5))
    cn[:, 0] = cm[:, 0] = 0.0
    return GridTable(kind, nodes, alpha, ca, cn, cm, interpolation)


@pytest.mark.parametrize("kind", ["mach", "knudsen"])
def test_bilinear_interpolation_equals_scipys(kind):
    table = random_table(kind)
    rng = np.random.default_rng(2)
    scale = np.log10 if kind == "knudsen" else np.asarray
    x = rng.uniform(table.nodes[0], table.nodes[-1], 500)
    a = rng.uniform(0.0, table.alpha_max, 500)
    for coefficient, values in zip(table.lookup(x, a), (table.CA, table.CN, table.Cm), strict=False):
        expected = RegularGridInterpolator((scale(table.nodes), table.alpha), values)
        np.testing.assert_allclose(coefficient, expected((scale(x), a)), atol=1e-13)


def test_pchip_equals_scipys_on_the_mirrored_curve():
    table = random_table(interpolation="pchip")
    a = np.linspace(0.0, table.alpha_max, 200)
    both_signs = np.concatenate([-table.alpha[:0:-1], table.alpha])
    for coefficient, values, sign in zip(
        table.lookup(5.0, a), (table.CA, table.CN, table.Cm), (1, -1, -1), strict=False
    ):
        rows = [PchipInterpolator(both_signs, np.concatenate([sign * v[:0:-1], v]))(a) for v in values[2:]]
        np.testing.assert_allclose(coefficient, 0.75 * rows[0] + 0.25 * rows[1], atol=1e-13)


@pytest.mark.parametrize("interpolation", ["linear", "pchip"])
def test_rows_equal_the_look_up(interpolation):
    table = random_table(interpolation=interpolation)
    x, a = np.array([0.7, 2.0, 10.9]), np.radians([0.0, 0.3, 5.0, 16.0])
    ca, cn, cm, _ = table.lookup(x[:, None], a)
    np.testing.assert_allclose(table.at(x).rows(a, (1.0, -2.0, 3.0)), ca - 2.0 * cn + 3.0 * cm, atol=1e-13)


def test_values_beyond_the_edges_are_constant_and_flagged():
    table = random_table()
    *at_edge, outside_at_edge = table.lookup([0.5, 11.0, 3.0], [0.0, 0.1, table.alpha_max])
    *beyond, outside_beyond = table.lookup([0.2, 40.0, 3.0], [0.0, 0.1, 1.0])
    np.testing.assert_array_equal(at_edge, beyond)
    assert not outside_at_edge.any() and outside_beyond.all()
    assert table.lookup(np.nan, 0.1)[3] and np.isnan(table.lookup(np.nan, 0.1)[0])
    assert np.isfinite(random_table("knudsen").lookup([0.0, np.inf], 0.1)[0]).all()


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
