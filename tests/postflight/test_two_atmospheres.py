"""Effect of the choice of the atmosphere."""

from types import SimpleNamespace

import numpy as np
import pytest

from edl_filter.postflight.two_atmospheres import atmosphere_differences, changes
from edl_filter.postflight.windows import Window

TIME = np.arange(5.0)


def side(scale):
    """Coefficients 1 to 5 times `scale`, 3 sigma of 0.5 each."""
    values = dict.fromkeys(("CA", "CN", "CY", "Cl", "Cm", "Cn"), scale * (1.0 + TIME))
    database = SimpleNamespace(value=values, three_sigma={name: np.full(5, 0.5) for name in values})
    atmosphere = SimpleNamespace(mach=scale * np.full(5, 10.0), knudsen=np.full(5, 1e-3) / scale)
    return SimpleNamespace(atmosphere=atmosphere, database=database, coefficients=SimpleNamespace(value=values))


def test_percent_of_the_preflight_value_and_of_three_sigma():
    differences = atmosphere_differences(side(1.1), side(1.0))
    np.testing.assert_allclose(differences.atmosphere["mach"], 10.0)
    np.testing.assert_allclose(differences.atmosphere["knudsen"], 100.0 * (1.0 / 1.1 - 1.0))
    np.testing.assert_allclose(differences.flight["Cl"], 20.0 * (1.0 + TIME))
    assert list(differences.database) == ["CA", "CN", "CY", "Cm", "Cn"]
    assert list(differences.flight) == ["CA", "CN", "CY", "Cl", "Cm", "Cn"]


def test_averages_keep_the_sign_of_the_largest_and_say_when_there_is_nothing():
    differences = atmosphere_differences(side(0.9), side(1.0))
    differences.flight["CN"][2] = np.nan  # the arrays are independent
    rows = {
        (r.window, r.of, r.quantity): r
        for r in changes(TIME, differences, (Window("all", 0.0, 4.0), Window("none", 9.0, 10.0)))
    }
    row = rows["all", "flight", "CN"]
    assert (row.largest, row.samples) == (pytest.approx(-100.0), 4)
    assert row.mean == pytest.approx(-20.0 * (1 + 2 + 4 + 5) / 4)
    assert row.rms == pytest.approx(20.0 * np.sqrt((1 + 4 + 16 + 25) / 4))
    assert rows["none", "flight", "CN"].samples == 0 and np.isnan(rows["none", "database", "CA"].rms)
