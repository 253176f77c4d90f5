"""The database: joins of continuum and rarefied tables, index by speed, uncertainties, files of the user."""

import numpy as np
import pytest

from edl_filter.aero.body import sphere_cone
from edl_filter.aero.database import Database, load_database
from edl_filter.aero.free_molecular import free_molecular_coefficients
from edl_filter.aero.surrogate import phoenix_surrogate
from edl_filter.aero.tables import read_table
from edl_filter.aero.transition import bridge
from edl_filter.errors import InputError
from edl_filter.io.csv_table import package_data

GRIDS = ("builtin:continuum_grid", "builtin:rarefied_grid")


def stacked(coefficients):
    return np.array([coefficients.ca, coefficients.cn, coefficients.cm_nose])


def test_rarefied_grid_equals_the_computed_coefficients():
    """To 2e-3 up to 16 degrees, where its continuum row (Phoenix's nodes) equals the surrogate; the panels to 1e-4."""
    grid = read_table(package_data("mevad_rarefied.csv"), "knudsen")
    computed = stacked(load_database().lookup(28.0, grid.nodes[:, None], grid.alpha))
    printed = np.array([grid.CA, grid.CN, grid.Cm])
    to_16 = grid.alpha < np.radians(16.5)
    np.testing.assert_allclose(computed[..., to_16], printed[..., to_16], atol=2e-3)
    to_25, free_molecular = grid.alpha < np.radians(25.5), grid.nodes >= 10.0
    np.testing.assert_allclose(
        computed[:, free_molecular][..., to_25], printed[:, free_molecular][..., to_25], atol=1e-4
    )


def test_bridge_starts_at_the_current_mach_number():
    alpha = np.radians(7.3)
    continuum = np.array(phoenix_surrogate().lookup(17.0, alpha)[:3])
    free = np.array(free_molecular_coefficients(sphere_cone("Phoenix"), alpha))
    computed = stacked(load_database().lookup(17.0, 0.03, alpha))
    np.testing.assert_allclose(computed, continuum + (free - continuum) * bridge(0.03), atol=1e-5)


@pytest.mark.parametrize("limit", [1e-3, 3e-3])
@pytest.mark.parametrize("tables", [("builtin:surrogate", "builtin:free_molecular"), GRIDS])
def test_continuous_join_is_continuous_at_the_limit(tables, limit):
    database = load_database(*tables, join="continuous", continuum_limit=limit)
    mach, alpha = np.array([[5.0], [18.0], [27.0]]), np.radians([0.0, 2.0, 8.0, 16.0])
    below, above = (stacked(database.lookup(mach, limit * k, alpha)) for k in (1.0, 1.0 + 1e-9))
    np.testing.assert_allclose(below, above, atol=1e-8)
    np.testing.assert_allclose(below, database.continuum.lookup(mach, alpha)[:3], atol=1e-12)


def test_both_continuous_joins_agree():
    """A table that was computed with the bridge, shifted to another Mach number, equals the bridge from that one."""
    alpha, knudsen = np.radians([0.0, 2.0, 6.0, 11.0]), np.array([[2e-3], [0.1], [1.0]])
    a = stacked(load_database().lookup(20.0, knudsen, alpha))
    b = stacked(load_database(*GRIDS, join="continuous").lookup(20.0, knudsen, alpha))
    np.testing.assert_allclose(a, b, atol=2e-3)


def test_switch_and_blend():
    switch, blend = (load_database(*GRIDS, join=join) for join in (None, "blend"))
    assert switch.join == "switch"
    alpha = 0.1
    continuum = np.array(switch.continuum.lookup(15.0, alpha)[:3])
    rarefied = np.array(switch.rarefied.lookup([1e-3 * (1.0 + 1e-9), 5e-3], alpha)[:3])
    np.testing.assert_allclose(stacked(switch.lookup(15.0, 1e-3, alpha)), continuum)
    np.testing.assert_allclose(stacked(switch.lookup(15.0, [1e-3 * (1.0 + 1e-9), 5e-3], alpha)), rarefied)
    np.testing.assert_allclose(stacked(blend.lookup(15.0, 1e-3, alpha)), 0.5 * (continuum + rarefied[:, 0]), atol=1e-9)
    np.testing.assert_allclose(stacked(blend.lookup(15.0, 3e-4, alpha)), continuum)
    np.testing.assert_allclose(stacked(blend.lookup(15.0, 5e-3, alpha)), rarefied[:, 1])


def test_outside_depends_only_on_the_tables_that_are_used():
    database = load_database()
    c = database.lookup([40.0, 40.0, 20.0, 20.0, 0.1], [1e-4, 20.0, 1e-4, 0.1, 1e-6], [0.1, 0.1, 0.5, 0.5, 0.1])
    np.testing.assert_array_equal(c.outside, [True, False, True, True, True])
    np.testing.assert_array_equal(c.rarefied, [False, True, False, True, False])
    assert np.isfinite(stacked(c)).all()
    assert np.isfinite(stacked(database.lookup(20.0, [0.0, np.inf], 0.1))).all()


def test_moment_about_the_centre_of_mass():
    c = load_database().lookup(20.0, 1e-5, np.array([0.0, 0.1]))
    np.testing.assert_allclose(c.cm_at(0.253), c.cm_nose + 0.253 * c.cn)
    assert c.cm_at(0.253)[0] == 0.0 and c.cm_at(0.253)[1] < 0.0


def test_indexed_by_speed():
    mer = load_database(family="MER", speed_per_mach=205.8)
    alpha, mach = 0.05, np.array([6.0, 8.0, 8.5, 9.0, 20.0])
    speed = 205.8 * (mach + 2.0)
    index = [6.0, 8.0, 9.5, 11.0, 22.0]
    np.testing.assert_allclose(
        stacked(mer.lookup(mach, 1e-6, alpha, speed)), stacked(load_database().lookup(index, 1e-6, alpha))
    )
    with pytest.raises(ValueError, match="indexed by speed"):
        mer.lookup(20.0, 1e-5, alpha)


def test_coefficients_have_three_sigma():
    c = load_database().lookup(20.0, [1e-5, 0.1], 0.05)
    np.testing.assert_allclose(c.three_sigma.ca, c.ca * [0.03, 0.05])
    np.testing.assert_allclose(c.three_sigma.cm, [0.002, 0.005])


def test_table_of_the_user(tmp_path):
    path = tmp_path / "own.csv"
    path.write_text(package_data("mevad_continuum.csv").read_text(encoding="utf-8"), encoding="utf-8")
    database = load_database(path, interpolation="pchip")
    assert isinstance(database, Database) and database.join == "continuous"
    np.testing.assert_allclose(
        stacked(database.lookup(18.1, 1e-5, 0.031)), stacked(load_database().lookup(18.1, 1e-5, 0.031)), atol=3e-4
    )


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"continuum": "builtin:phoenix"}, "continuum table: there is no 'builtin:phoenix'; accepted are builtin:surr"),
        ({"rarefied": "builtin:surrogate"}, "rarefied table: there is no 'builtin:surrogate'"),
        ({"continuum": "nowhere.csv"}, "nowhere.csv: the aerodynamic table cannot be read"),
        ({"family": "Viking"}, "no family 'Viking'"),
    ],
)
def test_invalid_arguments_raise(arguments, message):
    with pytest.raises(InputError, match=message):
        load_database(**arguments)
