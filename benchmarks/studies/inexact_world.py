"""A world that nothing states exactly: tables, air, mass and inertia that differ from the nominal model of a mission.

The errors of CA, CN and Cm are one smooth Gaussian field a flight over the flow
(`edl_filter.simulation.database_errors`). Density and winds differ from the preflight table by smooth functions of the
altitude (`edl_filter.simulation.air_errors`), mass and inertia by constant factors. `draw_world` draws a world,
`World.write` writes what the scenario of `World.scenario` flies, and `STATED_UNCERTAINTY` is what a mission may know:
the nominal model and its sigmas.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from edl_filter import Mission
from edl_filter.aero.database import load_database
from edl_filter.aero.grid import GridTable
from edl_filter.io.csv_table import read_rows
from edl_filter.mission.yaml_text import set_key
from edl_filter.planet.atmosphere import COLUMNS
from edl_filter.simulation import Scenario
from edl_filter.simulation.air_errors import air_with_errors
from edl_filter.simulation.database_errors import table_with_errors

#: Relative sigma of the density, sigma of each wind component (m/s), and their correlation length in altitude (m).
DENSITY_SIGMA, WIND_SIGMA, ALTITUDE_LENGTH = 0.10, 10.0, 10e3
#: Relative sigmas.
MASS_SIGMA, INERTIA_SIGMA = 0.005, 0.03
#: What a mission of the nominal model states of it; `Mission.load` takes it, and ``--set``.
STATED_UNCERTAINTY = (
    "aerodynamics.coefficient_sigma=1.0", "atmosphere.density_sigma=0.10", "atmosphere.wind_sigma=10.0",
    "vehicle.mass_sigma=4.0", "vehicle.inertia_sigma=0.03",
)  # fmt: skip


def nominal_mission(vehicle):
    """The mission of the nominal model."""
    return Mission.load(f"builtin:practice_{vehicle}", ["telemetry.path=flight.h5"])


@dataclass(frozen=True, eq=False)
class World:
    """What is flown.

    Attributes
    ----------
    vehicle : str
        Name of the scenario, and of the mission after ``practice_``.
    continuum, rarefied : GridTable
        The flown tables, Cm about the nose.
    air : (N, 5) array
        The flown air, in the columns of an atmosphere table.
    mass_factor, inertia_factor : float
        True over nominal; the second one is that of the whole tensor.
    """

    vehicle: str
    continuum: GridTable
    rarefied: GridTable
    air: np.ndarray
    mass_factor: float
    inertia_factor: float

    def write(self, folder):
        """Write the flown tables and the mission of the flown world; the path of the latter."""
        folder = Path(folder).resolve()
        paths = {
            "aerodynamics.continuum": folder / "flown_continuum.csv",
            "aerodynamics.rarefied": folder / "flown_rarefied.csv",
            "atmosphere.table": folder / "flown_air.csv",
        }
        for table, path in zip((self.continuum, self.rarefied), paths.values(), strict=False):
            node, angle = (x.ravel() for x in np.meshgrid(table.nodes, np.degrees(table.alpha), indexing="ij"))
            rows = np.column_stack((node, angle, *(c.ravel() for c in (table.CA, table.CN, table.Cm))))
            write_table(path, (table.kind, "alpha_deg", "CA", "CN", "Cm"), rows, "Cm about the nose")
        write_table(paths["atmosphere.table"], COLUMNS, self.air, "air")
        mission = nominal_mission(self.vehicle)
        changes = {key: str(path) for key, path in paths.items()}
        changes["vehicle.mass"] = mission.vehicle.mass * self.mass_factor
        for name in ("xx", "yy", "zz", "xy", "xz", "yz"):
            changes[f"vehicle.inertia.{name}"] = getattr(mission.vehicle.inertia, name) * self.inertia_factor
        text = mission.text
        for key, value in changes.items():
            text = set_key(text, key, value)
        out = folder / "flown_world.yaml"
        out.write_text(text, encoding="utf-8")
        return out

    def scenario(self, folder):
        """Write the world to a folder; the scenario that flies it, which draws no weather of its own."""
        changes = (f"mission={self.write(folder)}", "weather.density_sigma=0.0", "weather.wind_sigma=0.0")
        return Scenario.load(f"builtin:{self.vehicle}", changes)

    def mission(self, path, changes=()):
        """The mission that a user would have of a flight file: the nominal model and its sigmas."""
        return Mission.load(
            f"builtin:practice_{self.vehicle}", [f"telemetry.path={path}", *STATED_UNCERTAINTY, *changes]
        )


def draw_world(vehicle, random):
    """Draw a world from a generator."""
    mission = nominal_mission(vehicle)
    aero = mission.aerodynamics
    database = load_database(aero.continuum, aero.rarefied, family=aero.family, join=aero.join)
    continuum, rarefied = (table_with_errors(random, t, aero.family) for t in (database.continuum, database.rarefied))
    air = np.array([row.values for row in read_rows(mission.atmosphere_path(), COLUMNS, "atmosphere table")])
    air = air_with_errors(random, air, DENSITY_SIGMA, WIND_SIGMA, ALTITUDE_LENGTH)
    mass, inertia = random.standard_normal(2)
    return World(
        vehicle, continuum, rarefied, air, float(1.0 + MASS_SIGMA * mass), float(1.0 + INERTIA_SIGMA * inertia)
    )


def write_table(path, columns, rows, description):
    """Write a CSV with a comment line, a header and numbers of eight digits."""
    text = "\n".join(",".join(f"{value:.8g}" for value in row) for row in rows)
    header = f"# Flown in a simulated flight of the study of an inexact world: {description}."
    path.write_text(f"{header}\n{','.join(columns)}\n{text}\n", encoding="utf-8")
