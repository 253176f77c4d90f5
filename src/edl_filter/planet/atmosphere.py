"""Atmosphere table: density, temperature and wind against areodetic altitude.

Log-linear in density, linear in the rest; held at the lower edge, and above the upper edge the density goes
on with the last step's scale height.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from edl_filter.errors import InputError

Array = NDArray[np.float64]
COLUMNS = ("altitude_m", "density", "temperature", "wind_east", "wind_north")


@dataclass(frozen=True)
class Atmosphere:
    """A preflight atmosphere.

    Attributes
    ----------
    altitude : (N,) array
        m above the ellipsoid, increasing.
    log_density : (N,) array
        Of kg/m³.
    temperature : (N,) array
        K.
    wind : (N, 2) array
        Towards east and north, m/s.
    gas_constant : float
        J/(kg K).
    heat_capacity_ratio : float
    """

    altitude: Array
    log_density: Array
    temperature: Array
    wind: Array
    gas_constant: float
    heat_capacity_ratio: float

    @classmethod
    def read(cls, path: Path, gas_constant: float, heat_capacity_ratio: float) -> Atmosphere:
        """Read a CSV with the header ``altitude_m,density,temperature,wind_east,wind_north``.

        Raises
        ------
        InputError
            Wrong header, a value that is no number, altitudes that do not increase or densities that do not
            decrease.
        """
        try:
            lines = path.read_text(encoding="utf-8").splitlines()
        except OSError as error:
            raise InputError(f"{path}: the atmosphere table cannot be read ({error.strerror}).") from None
        rows = [(n, line) for n, line in enumerate(lines, 1) if line.strip() and not line.startswith("#")]
        if not rows or tuple(c.strip() for c in rows[0][1].split(",")) != COLUMNS:
            found = rows[0][1] if rows else "an empty file"
            raise InputError(f"{path}: the header must be {','.join(COLUMNS)}; found {found}.")
        values = np.array([_numbers(path, n, line) for n, line in rows[1:]])
        if len(values) < 2:
            raise InputError(f"{path}: {len(values)} rows of values; at least 2 are needed.")
        _check_monotonic(path, [n for n, _ in rows[1:]], values)
        return cls(
            altitude=values[:, 0],
            log_density=np.log(values[:, 1]),
            temperature=values[:, 2],
            wind=values[:, 3:],
            gas_constant=gas_constant,
            heat_capacity_ratio=heat_capacity_ratio,
        )

    def density(self, altitude: ArrayLike) -> Array:
        """kg/m³ at areodetic altitudes in m."""
        h = np.asarray(altitude, float)
        top, slope = self.altitude[-1], self._top_slope
        inside = np.interp(h, self.altitude, self.log_density)
        return np.exp(inside + slope * np.maximum(h - top, 0.0))

    @property
    def _top_slope(self) -> float:
        return float(np.diff(self.log_density[-2:])[0] / np.diff(self.altitude[-2:])[0])

    def temperature_at(self, altitude: ArrayLike) -> Array:
        """K at areodetic altitudes in m."""
        return np.interp(np.asarray(altitude, float), self.altitude, self.temperature)

    def speed_of_sound(self, altitude: ArrayLike) -> Array:
        """m/s at areodetic altitudes in m, ``sqrt(gamma R T)``."""
        return np.sqrt(self.heat_capacity_ratio * self.gas_constant * self.temperature_at(altitude))

    def wind_at(self, altitude: ArrayLike) -> Array:
        """Velocity of the air against the ground towards east and north, ``(..., 2)``, m/s."""
        h = np.asarray(altitude, float)
        return np.stack([np.interp(h, self.altitude, w) for w in self.wind.T], axis=-1)


def _numbers(path: Path, row: int, line: str) -> list[float]:
    try:
        values = [float(c) for c in line.split(",")]
    except ValueError:
        values = []
    if len(values) != len(COLUMNS) or not np.all(np.isfinite(values)):
        raise InputError(f"{path}, line {row}: expected {len(COLUMNS)} finite numbers, found '{line}'.")
    return values


def _check_monotonic(path: Path, rows: list[int], values: Array) -> None:
    for column, sign, must in ((0, 1.0, "increase"), (1, -1.0, "decrease")):
        wrong = np.flatnonzero(sign * np.diff(values[:, column]) <= 0.0)
        if len(wrong):
            i = int(wrong[0]) + 1
            raise InputError(
                f"{path}, line {rows[i]}: {COLUMNS[column]} must {must}, but {values[i, column]:g} follows "
                f"{values[i - 1, column]:g}."
            )
    for column in (1, 2):
        if np.any(values[:, column] <= 0.0):
            i = int(np.flatnonzero(values[:, column] <= 0.0)[0])
            raise InputError(f"{path}, line {rows[i]}: {COLUMNS[column]} must be positive.")
