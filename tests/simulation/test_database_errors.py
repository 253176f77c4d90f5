"""Random errors of gridded tables: their sigma, symmetry, and what is refused."""

import numpy as np
import pytest

from edl_filter.aero.database import load_database
from edl_filter.aero.uncertainty import three_sigma
from edl_filter.errors import InputError
from edl_filter.simulation.database_errors import database_with_errors, table_with_errors


@pytest.mark.parametrize("family", ["MER", "Phoenix"])
@pytest.mark.parametrize("regime", ["continuum", "rarefied"])
def test_errors_of_tables_have_the_sigma_of_the_database(family, regime):
    database = load_database("builtin:continuum_grid", "builtin:rarefied_grid", family=family)
    table = getattr(database, regime)
    knudsen = 0.0 if regime == "continuum" else 1.0
    sigma = three_sigma(family, table.nodes[:, None], knudsen, table.CA)
    random = np.random.default_rng(4)
    tables = [table_with_errors(random, table, family) for _ in range(300)]
    odd = np.tanh(np.degrees(table.alpha) / 4.0)
    for name, three, shape in (("CA", sigma.ca, 1.0), ("CN", sigma.cn, odd), ("Cm", sigma.cm, odd)):
        errors = np.array([getattr(t, name) for t in tables]) - getattr(table, name)
        expected = np.broadcast_to(three / 3.0 * shape, table.CA.shape)
        spread = np.sqrt(np.mean(errors**2, axis=0))
        assert spread[expected > 0.0] == pytest.approx(expected[expected > 0.0], rel=5.0 / np.sqrt(600.0))
        assert np.all(errors[:, expected == 0.0] == 0.0)
        assert (name == "CA") == bool(np.all(expected > 0.0))


def test_errors_of_a_database_scale_and_both_tables_have_them():
    database = load_database("builtin:continuum_grid", "builtin:rarefied_grid", family="MER")
    single_errors, double_errors = (
        database_with_errors(np.random.default_rng(1), database, "MER", "m", scale) for scale in (1.0, 2.0)
    )
    for regime in ("continuum", "rarefied"):
        nominal, single, double = (getattr(d, regime).CN for d in (database, single_errors, double_errors))
        assert np.abs(single - nominal).max() > 0.0
        np.testing.assert_allclose(double - nominal, 2.0 * (single - nominal), rtol=1e-12, atol=1e-15)


def test_a_surrogate_is_refused():
    database = load_database("builtin:surrogate", "builtin:free_molecular", family="MER")
    with pytest.raises(InputError, match=r"mer_a: aerodynamics\.continuum: found a table that is no grid"):
        database_with_errors(np.random.default_rng(1), database, "MER", "mer_a")
