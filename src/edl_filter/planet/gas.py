"""Properties of the gas: mean free path, Knudsen number, speed of sound and Mach number (thesis eqs. 4.3 to 4.6).

Input: density (kg/m³), temperature (K), pressure (Pa). Model: perfect gas whose molecules are hard spheres; its ratio
of specific heats is a constant (`Gas`), or follows from a composition of `SPECIES` and the temperature (`mixture`).

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

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from math import fsum

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
#: Mole fractions of the air of Mars near the surface, means over the year: M. G. Trainer et al., Seasonal Variations
#: in Atmospheric Composition as Measured in Gale Crater, Mars, Journal of Geophysical Research: Planets 124, 2019.
MARS = {"CO2": 0.951, "N2": 0.0259, "Ar": 0.0194, "O2": 0.0016, "CO": 0.0006}
#: Temperatures of the table of the ratio of specific heats, K, in steps of 1 K; outside, its values at the ends hold.
_TABLE = np.arange(20.0, 3001.0)


@dataclass(frozen=True)
class Gas:
    """A perfect gas of hard spheres. The default is the thesis's: carbon dioxide with a constant γ.

    Attributes
    ----------
    name : str
        For people.
    constant : float
        Specific gas constant R, J/(kg K).
    molecule_diameter : float
        Diameter of the hard sphere, m.
    molecule_mass : float
        Mean mass, kg.
    constant_ratio : float
        Ratio of specific heats γ where there is no composition.
    composition : tuple of (str, float)
        Mole fractions by the names of `SPECIES`, with the sum 1, from which γ follows; empty: γ is constant.
    """

    name: str = "thesis"
    constant: float = 188.92
    molecule_diameter: float = 4.64e-10
    molecule_mass: float = 7.3079e-26
    constant_ratio: float = 1.3
    composition: tuple[tuple[str, float], ...] = ()

    def heat_capacity_ratio(self, temperature: ArrayLike) -> Array:
        """Ratio of specific heats ``γ = cp/(cp − R)``.

        Parameters
        ----------
        temperature : (...) array
            K. With a composition the ratio is interpolated in a table of 1 K (error below 2e-6), since models look it
            up for every sample of every prediction.

        Returns
        -------
        (...) array
        """
        temperature = np.asarray(temperature, float)
        if not self.composition:
            return np.full(temperature.shape, self.constant_ratio)
        table = _ratio_table(self.composition)
        # the nodes are equidistant, so that no search is needed as in np.interp
        place = np.clip(temperature - _TABLE[0], 0.0, len(_TABLE) - 1.0)
        node = np.minimum(place.astype(np.intp), len(_TABLE) - 2)
        return np.asarray(table[node] + (place - node) * (table[node + 1] - table[node]))

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
        """Speed of sound ``√(γ R T)`` (eq. 4.4).

        Parameters
        ----------
        temperature : (...) array
            K.

        Returns
        -------
        (...) array
            m/s.
        """
        temperature = np.asarray(temperature, float)
        return np.sqrt(self.heat_capacity_ratio(temperature) * self.constant * temperature)

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

    @property
    def description(self) -> str:
        """Name, composition, gas constant and γ in words, for reports."""
        parts = ", ".join(f"{name} {100.0 * share:.3g} %" for name, share in self.composition)
        low, high = self.heat_capacity_ratio([200.0, 300.0])
        ratio = f"γ {low:.3f} at 200 K and {high:.3f} at 300 K" if parts else f"γ {low:.4g} constant"
        name = "carbon dioxide as in Thomas (2011)" if self.name == "thesis" else self.name
        return f"{name}{f' ({parts})' if parts else ''}: R {self.constant:.2f} J/(kg K), {ratio}"


def gas_of_constants(
    constant: float, heat_capacity_ratio: float, molecule_diameter: float | None, molecule_mass: float | None
) -> Gas:
    """A gas whose constants are stated.

    Parameters
    ----------
    constant : float
        Specific gas constant, J/(kg K).
    heat_capacity_ratio : float
        Ratio of specific heats at all temperatures.
    molecule_diameter : float or None
        m; None: the thesis's, of carbon dioxide.
    molecule_mass : float or None
        kg; None: Boltzmann's constant over the gas constant.

    Returns
    -------
    Gas
    """
    diameter = Gas().molecule_diameter if molecule_diameter is None else molecule_diameter
    mass = BOLTZMANN / constant if molecule_mass is None else molecule_mass
    return Gas("stated constants", constant, diameter, mass, heat_capacity_ratio)


def mixture(composition: Mapping[str, float], name: str = "mixture") -> Gas:
    """The gas of a composition.

    The mean free path of a mixture of hard spheres is the mean over its molecules of
    ``1/Σ_j n_j π d_ij² √(1 + m_i/m_j)`` with ``d_ij = (d_i + d_j)/2``; the diameter of the gas is that of a simple gas
    with the same mean free path.

    Parameters
    ----------
    composition : mapping
        Mole fractions by the names of `SPECIES`, not negative; they are divided by their sum.
    name : str
        For people.

    Returns
    -------
    Gas
    """
    total = fsum(composition.values())
    fractions = tuple((species, x / total) for species, x in composition.items() if x > 0.0)
    share = np.array([x for _, x in fractions])
    mass = np.array([SPECIES[species].mass for species, _ in fractions])
    diameter = np.array([SPECIES[species].diameter for species, _ in fractions])
    cross_section = np.pi * (0.5 * (diameter[:, None] + diameter)) ** 2 * np.sqrt(1.0 + mass[:, None] / mass)
    path_times_density = float(share @ (1.0 / (cross_section @ share)))
    mean_mass = float(share @ mass)
    return Gas(
        name=name,
        constant=MOLAR_GAS_CONSTANT / (mean_mass * AVOGADRO),
        molecule_diameter=float(np.sqrt(1.0 / (np.sqrt(2.0) * np.pi * path_times_density))),
        molecule_mass=mean_mass,
        composition=fractions,
    )


#: Gases that a mission can name.
NAMED_GASES = {"thesis": Gas(), "mars": mixture(MARS, "Martian air")}


def heat_capacity_ratio(composition: tuple[tuple[str, float], ...], temperature: ArrayLike) -> Array:
    """Ratio of specific heats of a composition, by the formula of `Species.heat_capacity`.

    Parameters
    ----------
    composition : tuple of (str, float)
        Mole fractions by the names of `SPECIES`, with the sum 1.
    temperature : (...) array
        K.

    Returns
    -------
    (...) array
    """
    capacity = np.zeros(np.shape(temperature))
    for species, fraction in composition:
        capacity = capacity + fraction * SPECIES[species].heat_capacity(temperature)
    return capacity / (capacity - 1.0)


@lru_cache(maxsize=16)
def _ratio_table(composition: tuple[tuple[str, float], ...]) -> Array:
    """`heat_capacity_ratio` at `_TABLE`."""
    return heat_capacity_ratio(composition, _TABLE)
