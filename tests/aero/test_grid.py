"""Grid tables: interpolation against that of scipy, and what holds beyond the edges."""

import numpy as np
import pytest
from scipy.interpolate import PchipInterpolator, RegularGridInterpolator

from edl_filter.aero.grid import GridTable


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
