"""The kernel's tables against the database and the world that they come from."""

import numpy as np
import pytest

from edl_filter.aero.database import load_database
from edl_filter.effects.base import EffectInstance
from edl_filter.effects.registry import find_effect
from edl_filter.simulation import dynamics
from edl_filter.simulation.parachute import Parachute
from edl_filter.simulation.tables import air_table, tabulate

GRIDS = {"continuum": "builtin:continuum_grid", "rarefied": "builtin:rarefied_grid"}
DATABASES = {
    "grids, switch": (lambda: load_database(**GRIDS, join="switch"), 1e-12),
    "grids, blend": (lambda: load_database(**GRIDS, join="blend"), 2e-4),
    "grids, cubic in the angle": (lambda: load_database(**GRIDS, interpolation="pchip"), 1e-5),
    "surrogate and bridge": (load_database, 1e-4),
    "grids by speed": (lambda: load_database(**GRIDS, join="switch", speed_per_mach=205.8), 1e-12),
    "surrogate by speed": (lambda: load_database(family="MER", speed_per_mach=205.8), 1e-4),
}


def from_kernel(tables, mach, speed, knudsen, alpha):
    rows = zip(mach, speed, knudsen, alpha, strict=True)
    return np.array([dynamics.coefficients(tables, *row) for row in rows]).T


@pytest.mark.parametrize("name", DATABASES)
def test_coefficients_are_the_databases(nominal, name):
    make, tolerance = DATABASES[name]
    database = make()
    from dataclasses import replace

    tables = tabulate(replace(nominal, database=database), Parachute(15.0))
    random = np.random.default_rng(3)
    mach, alpha = random.uniform(0.3, 31.0, 400), random.uniform(0.0, np.radians(25.0), 400)
    speed, knudsen = mach * random.uniform(190.0, 230.0, 400), 10.0 ** random.uniform(-6.0, 1.0, 400)
    entry = database.lookup(mach, knudsen, alpha, speed)
    expected = np.array([entry.ca, entry.cn, entry.cm_nose])
    np.testing.assert_allclose(from_kernel(tables, mach, speed, knudsen, alpha), expected, rtol=0.0, atol=tolerance)


def test_air_has_the_effects_on_it(nominal):
    on = (
        EffectInstance(find_effect("density_wave"), {"A": 0.1, "L": 10e3, "phase": 0.4}),
        EffectInstance(find_effect("wind"), {"east": 30.0, "north": -10.0, "h_lo": 10e3, "h_hi": 50e3}),
    )
    forward_model = nominal.with_effects(on)
    tables = tabulate(forward_model, Parachute(15.0))
    heights = np.random.default_rng(4).uniform(-5e3, 140e3, 300)
    expected = air_table(forward_model, heights)
    for h, (log_density, square, east, north) in zip(heights, expected, strict=True):
        density, sound, *wind = dynamics.air_at(tables, h)
        assert density == pytest.approx(np.exp(log_density), rel=1e-6)
        assert sound**2 == pytest.approx(square, rel=1e-9)
        assert wind == pytest.approx([east, north], abs=1e-3)
