"""What nobody knows beforehand: the true density and winds against the preflight atmosphere, drawn anew per seed.

They are effects like others, so that the world that was flown in is one object; the catalogue does not list them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from edl_filter.effects.effect import Active, Effect, Values

Array = NDArray[np.float64]

#: Altitudes between which the errors are drawn, and their distance, m.
LOW, HIGH, SPACING = -10e3, 200e3, 1000.0


def smooth_noise(random: np.random.Generator, nodes: int, step: float, sigma: float, length: float) -> Array:
    """A stationary Gauss-Markov sequence of second order ``(nodes,)``: correlation ``(1 + √3 d) exp(-√3 d)``.

    With d the distance over `length`. The practice flights' density is at least as smooth: one of first order with the
    same length, which jumps by a tenth of its sigma in a hundred metres, is less likely there by hundreds of nats.
    """
    d = np.sqrt(3.0) * step / length * np.abs(np.subtract.outer(np.arange(nodes), np.arange(nodes)))
    root = np.linalg.cholesky((1.0 + d) * np.exp(-d) + 1e-9 * np.eye(nodes))
    return sigma * root @ random.standard_normal(nodes)


class DensityError(Effect):
    """Density against the preflight table: a factor that wanders with altitude."""

    name = "density_error"
    family = "atmosphere"
    summary = "the true density's own error against the preflight table"

    def __init__(self, random: np.random.Generator, sigma: float, length: float) -> None:
        self.altitude = np.arange(LOW, HIGH + SPACING, SPACING)
        self.relative = CubicSpline(
            self.altitude, smooth_noise(random, len(self.altitude), SPACING, sigma, length), extrapolate=False
        )

    def density(self, p: Values, altitude: Array) -> Array:
        """Factor, cubic between nodes."""
        return 1.0 + self.relative(np.clip(altitude, LOW, HIGH))


class WindError(Effect):
    """Small winds that wander with altitude, towards east and north."""

    name = "wind_error"
    family = "atmosphere"
    summary = "the true winds' own error against the preflight table"

    def __init__(self, random: np.random.Generator, sigma: float, length: float) -> None:
        self.altitude = np.arange(LOW, HIGH + SPACING, SPACING)
        drawn = [smooth_noise(random, len(self.altitude), SPACING, sigma, length) for _ in range(2)]
        self.velocity = CubicSpline(self.altitude, np.column_stack(drawn), extrapolate=False)

    def wind(self, p: Values, altitude: Array) -> Array:
        """Velocity, m/s, cubic between nodes."""
        return self.velocity(np.clip(altitude, LOW, HIGH))


def weather(
    random: np.random.Generator, density_sigma: float, wind_sigma: float, length: float
) -> tuple[Active, Active]:
    """Errors of density (relative) and wind (m/s) with a correlation length (m)."""
    return Active(DensityError(random, density_sigma, length), {}), Active(WindError(random, wind_sigma, length), {})
