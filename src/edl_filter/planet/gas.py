"""The gas: mean free path, Knudsen number, speed of sound and Mach number (thesis eqs. 4.3 to 4.6)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Gas:
    """A perfect gas of hard spheres.

    Attributes
    ----------
    constant : float
        Specific gas constant R, J/(kg K).
    heat_capacity_ratio : float
    molecule_diameter : float
        Of the hard sphere, m.
    molecule_mass : float
        kg.
    """

    constant: float = 188.92
    heat_capacity_ratio: float = 1.3
    molecule_diameter: float = 4.64e-10
    molecule_mass: float = 7.3079e-26

    def mean_free_path(self, density: ArrayLike) -> Array:
        """``λ = 1/(√2 π d² n)`` with ``n = ρ/m`` (eqs. 4.5 and 4.6), m; density in kg/m³."""
        number = np.asarray(density, float) / self.molecule_mass
        return 1.0 / (np.sqrt(2.0) * np.pi * self.molecule_diameter**2 * number)

    def knudsen(self, density: ArrayLike, diameter: float) -> Array:
        """Mean free path over the reference length."""
        return self.mean_free_path(density) / diameter

    def temperature(self, pressure: ArrayLike, density: ArrayLike) -> Array:
        """``T = p/(ρ R)``, K."""
        return np.asarray(pressure, float) / (np.asarray(density, float) * self.constant)

    def speed_of_sound(self, temperature: ArrayLike) -> Array:
        """``√(γ R T)`` (eq. 4.4), m/s."""
        return np.sqrt(self.heat_capacity_ratio * self.constant * np.asarray(temperature, float))

    def mach(self, speed: ArrayLike, temperature: ArrayLike) -> Array:
        """Speed over the speed of sound (eq. 4.3)."""
        return np.asarray(speed, float) / self.speed_of_sound(temperature)
