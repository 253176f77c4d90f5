"""Molecules of the atmosphere: molar mass, hard-sphere diameter and heat capacity.

Heat capacity: statistical mechanics of a rigid rotor with harmonic vibrations in thermal equilibrium,

    cp/R = 5/2 + (1 for a linear molecule) + Σ E(θ/T),      E(x) = x² eˣ/(eˣ − 1)²

with one Einstein function for each vibration. From 200 to 700 K this agrees with the polynomials of McBride, Zehe and
Gordon to 0.35 %, up to 300 K to 0.1 % (the difference is the anharmonicity). The polynomials begin at 200 K, while the
air of Mars has 100 to 250 K; the formula is valid down to some 50 K, where the rotation is still classical, and needs
no join.

Diameter: that of the hard sphere whose gas has the measured viscosity at 273 K by the theory of Chapman and Enskog,
``μ = 1.016 (5/16) √(π m k T)/(π d²)``. For carbon dioxide it is the thesis's 4.64e-10 m.

Sources: B. J. McBride, M. J. Zehe and S. Gordon, *NASA Glenn Coefficients for Calculating Thermodynamic Properties of
Individual Species*, NASA/TP-2002-211556, 2002; wavenumbers: K. P. Huber and G. Herzberg, *Constants of Diatomic
Molecules*, 1979, and for CO2 the fundamentals, with the symmetric stretch freed of its Fermi resonance; viscosities:
G. A. Bird, *Molecular Gas Dynamics and the Direct Simulation of Gas Flows*, 1994, appendix A.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from edl_filter.types import Array

#: Boltzmann's constant, J/K, and Avogadro's, 1/mol (exact in the SI).
BOLTZMANN, AVOGADRO = 1.380649e-23, 6.02214076e23
#: Molar gas constant, J/(mol K).
MOLAR_GAS_CONSTANT = BOLTZMANN * AVOGADRO
#: Second radiation constant h c/k, K cm: temperature of a wavenumber.
_KELVIN_CM = 1.438776877
#: Temperature of the viscosities, K, and what higher approximations add to the first one for hard spheres.
_VISCOSITY_TEMPERATURE, _HARD_SPHERE_FACTOR = 273.0, 1.016


@dataclass(frozen=True)
class Species:
    """One kind of molecule.

    Attributes
    ----------
    molar_mass : float
        kg/mol.
    wavenumbers : tuple of float
        Of each vibration, 1/cm; empty for an atom.
    viscosity : float
        At 273 K, Pa s.
    """

    molar_mass: float
    wavenumbers: tuple[float, ...]
    viscosity: float

    @property
    def mass(self) -> float:
        """Mass of a molecule, kg."""
        return self.molar_mass / AVOGADRO

    @property
    def diameter(self) -> float:
        """Diameter of the hard sphere, m."""
        impulse = np.sqrt(np.pi * self.mass * BOLTZMANN * _VISCOSITY_TEMPERATURE)
        return float(np.sqrt(_HARD_SPHERE_FACTOR * 5.0 / 16.0 * impulse / (np.pi * self.viscosity)))

    def heat_capacity(self, temperature: ArrayLike) -> Array:
        """Heat capacity at constant pressure over the molar gas constant, ``cp/R``.

        Parameters
        ----------
        temperature : (...) array
            K.

        Returns
        -------
        (...) array
        """
        temperature = np.asarray(temperature, float)
        capacity = np.full(temperature.shape, 3.5 if self.wavenumbers else 2.5)
        for wavenumber in self.wavenumbers:
            x = _KELVIN_CM * wavenumber / temperature
            capacity += x**2 * np.exp(-x) / np.expm1(-x) ** 2
        return capacity


#: Molecules by formula.
SPECIES = {
    "CO2": Species(44.0095e-3, (667.3, 667.3, 1342.9, 2349.3), 1.380e-5),
    "N2": Species(28.0134e-3, (2330.0,), 1.656e-5),
    "Ar": Species(39.948e-3, (), 2.117e-5),
    "O2": Species(31.9988e-3, (1556.2,), 1.919e-5),
    "CO": Species(28.0101e-3, (2143.3,), 1.635e-5),
}
