"""What nobody knows beforehand: the true density and winds against the preflight atmosphere, drawn anew per seed.

They are effects like others, so that the world that was flown in is one object; the catalogue does not list them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from edl_filter.effects.effect import Active, Effect, Values

Array = NDArray[np.float64]

#: Altitudes between which the errors are drawn, and their distance, m.
LOW, HIGH, SPACING = -10e3, 200e3, 500.0


def gauss_markov(random: np.random.Generator, nodes: int, step: float, sigma: float, length: float) -> Array:
    """A first-order Gauss-Markov sequence ``(nodes,)``, stationary: correlation ``exp(-distance / length)``."""
    keep = np.exp(-step / length)
    drawn = random.standard_normal(nodes)
    out = np.empty(nodes)
    out[0] = drawn[0]
    for k in range(1, nodes):
        out[k] = keep * out[k - 1] + np.sqrt(1.0 - keep * keep) * drawn[k]
    return sigma * out


class DensityError(Effect):
    """Density against the preflight table: a factor that wanders with altitude."""

    name = "density_error"
    family = "atmosphere"
    summary = "the true density's own error against the preflight table"

    def __init__(self, random: np.random.Generator, sigma: float, length: float) -> None:
        self.altitude = np.arange(LOW, HIGH + SPACING, SPACING)
        self.relative = gauss_markov(random, len(self.altitude), SPACING, sigma, length)

    def density(self, p: Values, altitude: Array) -> Array:
        """Factor, linear between nodes."""
        return 1.0 + np.interp(altitude, self.altitude, self.relative)


class WindError(Effect):
    """Small winds that wander with altitude, towards east and north."""

    name = "wind_error"
    family = "atmosphere"
    summary = "the true winds' own error against the preflight table"

    def __init__(self, random: np.random.Generator, sigma: float, length: float) -> None:
        self.altitude = np.arange(LOW, HIGH + SPACING, SPACING)
        drawn = [gauss_markov(random, len(self.altitude), SPACING, sigma, length) for _ in range(2)]
        self.velocity = np.column_stack(drawn)

    def wind(self, p: Values, altitude: Array) -> Array:
        """Velocity, m/s, linear between nodes."""
        return np.column_stack([np.interp(altitude, self.altitude, v) for v in self.velocity.T])


def weather(
    random: np.random.Generator, density_sigma: float, wind_sigma: float, length: float
) -> tuple[Active, Active]:
    """Errors of density (relative) and wind (m/s) with a correlation length (m)."""
    return Active(DensityError(random, density_sigma, length), {}), Active(WindError(random, wind_sigma, length), {})
