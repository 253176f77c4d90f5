"""Random errors of the air of one flight: smooth functions of the altitude, of squared exponential correlation.

`air_with_errors` changes a table of the air, `AirError` is the same as an effect, for models whose table is in use
already. `edl_filter.simulation.chance` has the errors that a scenario's ``weather`` states.
"""

from __future__ import annotations

import numpy as np

from edl_filter.effects.base import Effect
from edl_filter.effects.parameters import Values
from edl_filter.estimation.random_fields import smooth_profile
from edl_filter.estimation.series import interpolate_columns
from edl_filter.types import Array

#: Altitudes between which the errors of an effect are drawn, and distance of the nodes, m; constant outside.
LOW, HIGH, SPACING = -10e3, 200e3, 2000.0


def air_with_errors(
    random: np.random.Generator, air: Array, density_sigma: float, wind_sigma: float, length: float
) -> Array:
    """A table of the air with errors of density and wind.

    Parameters
    ----------
    random : Generator
        Source of the errors.
    air : (N, 5) array
        Columns of an atmosphere table (`edl_filter.planet.atmosphere.COLUMNS`).
    density_sigma, wind_sigma : float
        One sigma of the density, relative; of each component of the wind, m/s.
    length : float
        Correlation length in altitude, m.

    Returns
    -------
    (N, 5) array
    """
    density, east, north = (smooth_profile(random, air[:, 0], length) for _ in range(3))
    changed = air.copy()
    changed[:, 1] *= 1.0 + density_sigma * density
    changed[:, 3:] += wind_sigma * np.column_stack((east, north))
    return changed


class AirError(Effect):
    """Error of density and winds relative to the preflight table.

    Parameters
    ----------
    random : Generator
        Source of the errors.
    density_sigma, wind_sigma, length : float
        As in `air_with_errors`.
    """

    name = "drawn_air"
    family = "atmosphere"
    summary = "random error of density and winds relative to the preflight table"

    def __init__(self, random: np.random.Generator, density_sigma: float, wind_sigma: float, length: float) -> None:
        self.altitude = np.arange(LOW, HIGH + SPACING, SPACING)
        density, east, north = (smooth_profile(random, self.altitude, length) for _ in range(3))
        # a density is positive: an error of many sigmas must not change its sign
        self.factor = np.maximum(1.0 + density_sigma * density, 0.05)
        self.velocity = wind_sigma * np.column_stack((east, north))

    def density(self, p: Values, altitude: Array) -> Array:
        """Factor ``(N,)``, linear between nodes."""
        return np.interp(altitude, self.altitude, self.factor)

    def wind(self, p: Values, altitude: Array) -> Array:
        """Velocity towards east and north ``(N, 2)``, m/s, linear between nodes."""
        return interpolate_columns(altitude, self.altitude, self.velocity)
