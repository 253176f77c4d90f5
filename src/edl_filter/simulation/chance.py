"""Random errors of the preflight atmosphere: the true density and winds of a simulated flight, drawn once per seed.

They are effects, so that one `ForwardModel` has everything that the simulated flight encounters; the catalogue does not
list them.
"""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline

from edl_filter.effects.base import Effect, EffectInstance
from edl_filter.effects.parameters import Values
from edl_filter.estimation.matern import sample_matern32
from edl_filter.types import Array

#: Altitudes between which the errors are drawn, and distance of the nodes, m.
LOW, HIGH, SPACING = -10e3, 200e3, 1000.0


def _profiles(random: np.random.Generator, count: int, sigma: float, length: float) -> CubicSpline:
    """Cubic spline by altitude (m) through `count` Matérn processes of order 3/2.

    The density of the practice flights is at least as smooth: a first-order process of the same length, which changes
    by a tenth of its sigma within a hundred metres, has a likelihood there that is lower by hundreds of nats.
    """
    altitude = np.arange(LOW, HIGH + SPACING, SPACING)
    processes = [sample_matern32(random, len(altitude), SPACING, sigma, length) for _ in range(count)]
    return CubicSpline(altitude, np.column_stack(processes), extrapolate=False)


class DensityError(Effect):
    """Error of the density relative to the preflight table: a factor that varies smoothly with altitude."""

    name = "density_error"
    family = "atmosphere"
    summary = "random error of the density relative to the preflight table"

    def __init__(self, random: np.random.Generator, sigma: float, length: float) -> None:
        self.relative = _profiles(random, 1, sigma, length)

    def density(self, p: Values, altitude: Array) -> Array:
        """Factor ``(N,)``, cubic between nodes."""
        return 1.0 + self.relative(np.clip(altitude, LOW, HIGH))[:, 0]


class WindError(Effect):
    """Error of the winds relative to the preflight table: velocities that vary smoothly with altitude."""

    name = "wind_error"
    family = "atmosphere"
    summary = "random error of the winds relative to the preflight table"

    def __init__(self, random: np.random.Generator, sigma: float, length: float) -> None:
        self.velocity = _profiles(random, 2, sigma, length)

    def wind(self, p: Values, altitude: Array) -> Array:
        """Velocity towards east and north ``(N, 2)``, m/s, cubic between nodes."""
        return self.velocity(np.clip(altitude, LOW, HIGH))


def weather(
    random: np.random.Generator, density_sigma: float, wind_sigma: float, length: float
) -> tuple[EffectInstance, EffectInstance]:
    """Random errors of density and wind.

    Parameters
    ----------
    random : Generator
        Source of the normal deviates.
    density_sigma, wind_sigma : float
        One sigma of the density, relative; of each component of the wind, m/s.
    length : float
        Correlation length in altitude, m.

    Returns
    -------
    tuple of EffectInstance
        `DensityError` and `WindError`.
    """
    return (
        EffectInstance(DensityError(random, density_sigma, length), {}),
        EffectInstance(WindError(random, wind_sigma, length), {}),
    )
