"""Properties of the gas: mean free path, Knudsen number, speed of sound and Mach number (thesis eqs. 4.3 to 4.6).

Input: density (kg/m³), temperature (K), pressure (Pa). Model: perfect gas whose molecules are hard spheres.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from edl_filter.types import Array


def speed_of_sound(temperature: ArrayLike, gas_constant: float, heat_capacity_ratio: float) -> Array:
    """Speed of sound of a perfect gas, ``√(γ R T)`` (thesis eq. 4.4).

    Parameters
    ----------
    temperature : (...) array
        K.
    gas_constant : float
        Specific gas constant R, J/(kg K).
    heat_capacity_ratio : float
        Ratio of specific heats γ.

    Returns
    -------
    (...) array
        m/s.
    """
    return np.sqrt(heat_capacity_ratio * gas_constant * np.asarray(temperature, float))


@dataclass(frozen=True)
class Gas:
    """A perfect gas of hard spheres.

    Attributes
    ----------
    constant : float
        Specific gas constant R, J/(kg K).
    heat_capacity_ratio : float
    molecule_diameter : float
        Diameter of the hard sphere, m.
    molecule_mass : float
        kg.
    """

    constant: float = 188.92
    heat_capacity_ratio: float = 1.3
    molecule_diameter: float = 4.64e-10
    molecule_mass: float = 7.3079e-26

    def mean_free_path(self, density: ArrayLike) -> Array:
        """Mean free path ``λ = 1/(√2 π d² n)`` with ``n = ρ/m`` (eq. 4.6).

        Parameters
        ----------
        density : (...) array
            kg/m³.

        Returns
        -------
        (...) array
            m.
        """
        number_density = np.asarray(density, float) / self.molecule_mass
        return 1.0 / (np.sqrt(2.0) * np.pi * self.molecule_diameter**2 * number_density)

    def knudsen(self, density: ArrayLike, diameter: float) -> Array:
        """Knudsen number: mean free path over reference length (eq. 4.5).

        Parameters
        ----------
        density : (...) array
            kg/m³.
        diameter : float
            Reference length, m.

        Returns
        -------
        (...) array
        """
        return self.mean_free_path(density) / diameter

    def temperature(self, pressure: ArrayLike, density: ArrayLike) -> Array:
        """Temperature ``T = p/(ρ R)``.

        Parameters
        ----------
        pressure, density : (...) arrays
            Pa and kg/m³.

        Returns
        -------
        (...) array
            K.
        """
        return np.asarray(pressure, float) / (np.asarray(density, float) * self.constant)

    def speed_of_sound(self, temperature: ArrayLike) -> Array:
        """Speed of sound (eq. 4.4).

        Parameters
        ----------
        temperature : (...) array
            K.

        Returns
        -------
        (...) array
            m/s.
        """
        return speed_of_sound(temperature, self.constant, self.heat_capacity_ratio)

    def mach(self, speed: ArrayLike, temperature: ArrayLike) -> Array:
        """Mach number: speed over the speed of sound (eq. 4.3).

        Parameters
        ----------
        speed, temperature : (...) arrays
            m/s and K.

        Returns
        -------
        (...) array
        """
        return np.asarray(speed, float) / self.speed_of_sound(temperature)
