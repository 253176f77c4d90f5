"""Table of the preflight atmosphere: density, temperature and wind against areodetic altitude.

Input: CSV with the columns of `COLUMNS`. Method: interpolation in altitude, linear in the logarithm of the density, in
the temperature and in the wind. Below the table its lowest values hold; above it the density falls with the scale
height of the last step, temperature and wind keep their last values. Output: densities, temperatures, speeds of sound
and winds at any altitudes.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from edl_filter.errors import InputError
from edl_filter.estimation.series import interpolate_columns
from edl_filter.io.csv_table import Row, check_monotonic, read_rows
from edl_filter.planet.gas import Gas
from edl_filter.types import Array

COLUMNS = ("altitude_m", "density", "temperature", "wind_east", "wind_north")


@dataclass(frozen=True)
class Atmosphere:
    """A preflight atmosphere.

    Attributes
    ----------
    altitude : (N,) array
        m above the ellipsoid, increasing.
    log_density : (N,) array
        Natural logarithm of the density in kg/m³.
    temperature : (N,) array
        K.
    wind : (N, 2) array
        Velocity of the air relative to the ground, towards east and north, m/s.
    gas : Gas
    """

    altitude: Array
    log_density: Array
    temperature: Array
    wind: Array
    gas: Gas

    @classmethod
    def read(cls, path: Path, gas: Gas, table_gas_constant: float | None = None) -> Atmosphere:
        """Read a CSV with the header ``altitude_m,density,temperature,wind_east,wind_north``.

        Parameters
        ----------
        path : Path
            File of altitudes (m), densities (kg/m³), temperatures (K) and winds (m/s).
        gas : Gas
            Of the atmosphere.
        table_gas_constant : float, optional
            Gas constant with which the temperatures of the table were computed, J/(kg K), if it is not that of `gas`.
            Temperatures are converted so that the pressure ``ρ R T``, which hydrostatic equilibrium gives whatever the
            gas is, stays that of the table.

        Returns
        -------
        Atmosphere

        Raises
        ------
        InputError
            Wrong header, a value that is no number, altitudes that do not increase or densities that do not
            decrease.
        """
        rows = read_rows(path, COLUMNS, "atmosphere table")
        if len(rows) < 2:
            raise InputError(f"{path}: {len(rows)} rows of values; at least 2 are needed.")
        check_monotonic(path, rows, 0, COLUMNS[0])
        check_monotonic(path, rows, 1, COLUMNS[1], decreasing=True)
        _check_positive(path, rows)
        values = np.array([row.values for row in rows])
        return cls(
            altitude=values[:, 0],
            log_density=np.log(values[:, 1]),
            temperature=values[:, 2] * (1.0 if table_gas_constant is None else table_gas_constant / gas.constant),
            wind=values[:, 3:],
            gas=gas,
        )

    def density(self, altitude: ArrayLike) -> Array:
        """Density.

        Parameters
        ----------
        altitude : (...) array
            Areodetic, m.

        Returns
        -------
        (...) array
            kg/m³.
        """
        h = np.asarray(altitude, float)
        inside = np.interp(h, self.altitude, self.log_density)
        return np.exp(inside + self._top_slope * np.maximum(h - self.altitude[-1], 0.0))

    @property
    def _top_slope(self) -> float:
        """Slope of the logarithm of the density over the last step, 1/m: minus one over the scale height."""
        return float(np.diff(self.log_density[-2:])[0] / np.diff(self.altitude[-2:])[0])

    def temperature_at(self, altitude: ArrayLike) -> Array:
        """Temperature.

        Parameters
        ----------
        altitude : (...) array
            Areodetic, m.

        Returns
        -------
        (...) array
            K.
        """
        return np.interp(np.asarray(altitude, float), self.altitude, self.temperature)

    def speed_of_sound(self, altitude: ArrayLike) -> Array:
        """Speed of sound of the gas.

        Parameters
        ----------
        altitude : (...) array
            Areodetic, m.

        Returns
        -------
        (...) array
            m/s.
        """
        return self.gas.speed_of_sound(self.temperature_at(altitude))

    def wind_at(self, altitude: ArrayLike) -> Array:
        """Velocity of the air relative to the ground, towards east and north.

        Parameters
        ----------
        altitude : (...) array
            Areodetic, m.

        Returns
        -------
        (..., 2) array
            m/s.
        """
        return interpolate_columns(altitude, self.altitude, self.wind)


def _check_positive(path: Path, rows: list[Row]) -> None:
    """Raise `InputError` if a density or a temperature is not positive."""
    for column in (1, 2):
        for row in rows:
            if row.values[column] <= 0.0:
                raise InputError(f"{path}, line {row.line}: {COLUMNS[column]} must be positive.")
