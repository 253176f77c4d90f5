"""Look-up of aerodynamic coefficients against scipy, and its growth.

Run: ``python benchmarks/bench_lookup.py``
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from measuring import Grid, Section, interleaved, run
from scipy.interpolate import RegularGridInterpolator

from edl_filter.aero.database import load_database
from edl_filter.aero.grid import GridTable
from edl_filter.types import Array

COUNTS = (1, 100, 10_000, 1_000_000)
COMPARED = 10_000


def flight(count: int) -> tuple[Array, Array, Array]:
    """Mach numbers, Knudsen numbers and angles (rad)."""
    rng = np.random.default_rng(0)
    return rng.uniform(2.0, 25.0, count), 10.0 ** rng.uniform(-6.0, 1.0, count), rng.uniform(0.0, 0.15, count)


def by_scipy(table: GridTable, mach: Array, alpha: Array) -> Callable[[], Array]:
    """CA, CN and Cm ``(3, N)`` by scipy's linear interpolator of a grid, at the edges where outside."""
    values = np.stack([table.CA, table.CN, table.Cm], axis=-1)
    interpolate = RegularGridInterpolator((table.nodes, table.alpha), values)

    def lookup() -> Array:
        where = np.clip(mach, table.nodes[0], table.nodes[-1]), np.clip(alpha, table.alpha[0], table.alpha[-1])
        return np.asarray(interpolate(np.stack(where, axis=1))).T

    return lookup


def measure() -> list[Section]:
    """All sections."""
    database = load_database("builtin:continuum_grid")
    table = database.continuum
    assert isinstance(table, GridTable)
    mach, knudsen, alpha = flight(COMPARED)
    scipy = by_scipy(table, mach, alpha)
    difference = np.max(np.abs(np.array(table.lookup(mach, alpha)[:3]) - scipy()))
    assert difference < 1e-12, difference
    functions: dict[str, Callable[[], Any]] = {
        "scipy": scipy,
        "table": lambda: table.lookup(mach, alpha),
        "database": lambda: database.lookup(mach, knudsen, alpha),
    }
    growth = {f"{n}": partial(database.lookup, *flight(n)) for n in COUNTS}
    times = interleaved(functions | growth, rounds=7)
    unit = times.least(f"{COUNTS[2]}") / COUNTS[2]
    rows = [
        times.row(
            f"scipy `RegularGridInterpolator`, {COMPARED} points",
            "`GridTable.lookup`",
            "scipy",
            "table",
            agreement=f"equal to {difference:.0e} (asserted: 1e-12)",
        ),
        times.row("`Database.lookup`: both regimes, joined, and 3 sigma", "`GridTable.lookup`", "database", "table"),
    ]
    lines = {"time a point": [times.least(f"{n}") / n / unit for n in COUNTS]}
    return [
        Section(
            "Look-up", f"Growth: relative to {COUNTS[2]} points.", rows, Grid("points", [f"{n}" for n in COUNTS], lines)
        )
    ]


if __name__ == "__main__":
    run(measure)
