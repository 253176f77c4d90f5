"""Discrepancy of an aerodynamic database: the prior of its error as a random field over the flow.

The error of a coefficient is a function of the flow and not of time: a vehicle that swings through the same angle at
the same Mach number meets the same error again. It is a Gaussian process (Kennedy and O'Hagan, J. R. Statist. Soc. B 63
(2001) 425; in aerodynamic databases its realisations are called increments or dispersions),

    δC(flow) = σ_C(flow) g(x, α),   cov(g(x, α), g(x', α')) = k(x - x') s(α) s(α') exp(-(α - α')² / 2 l²),

with the database's own one sigma σ_C as marginal scale. x is the logarithm of the Mach number over its correlation
length in continuum flow, that of the Knudsen number in rarefied flow, and k the Matérn correlation of order 3/2
(`estimation.matern`), whose slope may change as that of a table does at its nodes. s(α) = tanh(α/α_0) for CN and Cm,
which vanish at zero angle by symmetry; s = 1 for CA.

A vehicle that is not exactly axisymmetric also has a lateral force and a lateral moment that are fixed to its body and
do not vanish at zero angle. The pressure over its irregularities changes with the shock, so that each of the four
coefficients is a Matérn process along x, the same at all angles. The uncertainties of the database are additive at any
angle (thesis tables 11.3 to 11.5), so their sigmas are the scale of these coefficients too, times a factor.

Along a trajectory x changes slowly and the angle oscillates. The kernel over the angle is therefore replaced by a few
modes (Karhunen–Loève expansion with respect to the information that the flight has at each angle: Rasmussen and
Williams, Gaussian Processes for Machine Learning, 2006, section 4.3), whose amplitudes are independent Matérn processes
along x. Modes about which the flight has less information than `NEGLIGIBLE_INFORMATION` are left out.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from edl_filter.estimation.matern import matern32_correlation
from edl_filter.estimation.random_fields import squared_exponential_correlation
from edl_filter.estimation.series import interpolate_columns
from edl_filter.types import Array, BoolArray

#: Coefficients with a field over Mach number and angle.
FIELD_COEFFICIENTS = ("ca", "cn", "cm")
#: Coefficients of a vehicle's asymmetry, which are fixed to its body, and the coefficient whose sigma they have: CY and
#: CN of a force at the centre of mass, Cm and Cn about it.
ASYMMETRIES = {"side_asymmetry": "cn", "normal_asymmetry": "cn", "pitch_asymmetry": "cm", "yaw_asymmetry": "cm"}
#: Product of prior variance and information of a mode below which it is left out: its posterior is its prior.
NEGLIGIBLE_INFORMATION = 1.0
#: Spacing of the angles at which modes are tabulated, and these angles, rad.
_MODE_STEP = np.radians(0.05)
_MODE_ANGLES = np.arange(0.0, np.radians(60.0), _MODE_STEP)
#: Distance, in correlation lengths, of two regimes with independent errors: their correlation is below 1e-70.
_INDEPENDENT = 100.0
#: Spacing of the angles in the eigenvalue problem, in correlation lengths.
_EIGEN_SPACING = 1.0 / 24.0
#: Spacing of the points of a low-rank factor along x and over the angle, in correlation lengths, and the eigenvalue
#: over the greatest one below which a mode of the kernel between those points is left out.
_POINT_SPACING, _NEGLIGIBLE_EIGENVALUE = 0.25, 1e-3


@dataclass(frozen=True)
class DiscrepancyPrior:
    """Correlation lengths and scale of a database's discrepancy.

    Attributes
    ----------
    scale : float
        Factor on the database's own sigma; 0: the database is exact.
    log_mach_length : float
        Correlation length in the natural logarithm of the Mach number.
    log_knudsen_length : float
        The same in the decimal logarithm of the Knudsen number.
    angle_length : float
        The same in the total angle of attack, rad.
    vanishing_angle : float
        α_0, rad.
    asymmetry : float
        Factor on the database's sigmas for the coefficients of the asymmetry; 0: an axisymmetric vehicle.
    """

    scale: float = 0.0
    log_mach_length: float = 0.5
    log_knudsen_length: float = 1.0
    angle_length: float = np.radians(6.0)
    vanishing_angle: float = np.radians(4.0)
    asymmetry: float = 0.0

    @property
    def is_exact(self) -> bool:
        """Whether neither the database nor the symmetry has an error."""
        return self.scale == 0.0 and self.asymmetry == 0.0

    def angle_kernel(self, coefficient: str, a: Array, b: Array) -> Array:
        """Covariance over the angle.

        Parameters
        ----------
        coefficient : str
            ``ca``, ``cn`` or ``cm``.
        a, b : (n,), (m,) arrays
            Total angles of attack, rad.

        Returns
        -------
        (n, m) array
            In squares of one sigma of the database.
        """
        kernel = squared_exponential_correlation(np.subtract.outer(a, b) / self.angle_length)
        if coefficient == "ca":
            return kernel
        return np.asarray(np.outer(self._symmetric(a), self._symmetric(b)) * kernel, float)

    def angle_modes(
        self, coefficient: str, angle: Array, information: Array, table_angles: tuple[Array, Array]
    ) -> AngleModes:
        """Modes of the field over the angle that a flight resolves.

        Parameters
        ----------
        coefficient : str
            ``ca``, ``cn`` or ``cm``.
        angle : (N,) array
            Total angle of attack of each datum, rad.
        information : (N,) array
            Information of each datum about the coefficient, in inverse squares of one sigma of the database.
        table_angles : (array, array)
            Angles between which the continuum and the rarefied table are linear, rad; empty for smooth tables. The
            error of such a table is linear between its angles too.
        """
        spacing = _EIGEN_SPACING * self.angle_length
        count = int(np.ceil(np.max(angle, initial=0.0) / spacing)) + 1
        nodes = spacing * np.arange(count, dtype=float)
        weight = np.bincount(np.round(angle / spacing).astype(int), information, count)
        used = weight > 0.0
        nodes, root = nodes[used], np.sqrt(weight[used])
        size, vectors = np.linalg.eigh(root[:, None] * self.angle_kernel(coefficient, nodes, nodes) * root)
        informative = size > NEGLIGIBLE_INFORMATION
        # Nyström extension of each eigenvector, so that the sum of squares is the prior variance
        extension = self.angle_kernel(coefficient, _MODE_ANGLES, nodes) * root
        smooth = extension @ (vectors[:, informative] / np.sqrt(size[informative]))[:, ::-1]
        continuum, rarefied = (_linear_between(_MODE_ANGLES, smooth, angles) for angles in table_angles)
        return AngleModes(continuum, rarefied)

    def flow_distance(self, mach: Array, knudsen: Array, continuum_limit: float, separate_regimes: bool) -> Array:
        """Distances along x between adjoining points of a trajectory, in correlation lengths.

        Parameters
        ----------
        mach, knudsen : (N,) arrays
            Mach number, and Knudsen number based on the diameter.
        continuum_limit : float
            Knudsen number above which the rarefied table applies.
        separate_regimes : bool
            Whether the tables of both regimes have independent errors.

        Returns
        -------
        (N - 1,) array
            From one regime to the other so large that the errors are independent, where they are.
        """
        rarefied = knudsen > continuum_limit
        both = rarefied[1:] & rarefied[:-1]
        by_knudsen = np.abs(np.diff(np.log10(knudsen))) / self.log_knudsen_length
        by_mach = np.abs(np.diff(np.log(mach))) / self.log_mach_length
        distance = np.where(both, by_knudsen, by_mach)
        if separate_regimes:
            distance[rarefied[1:] != rarefied[:-1]] = _INDEPENDENT
        return distance

    def axial_errors(
        self, mach: Array, knudsen: Array, angle: Array, continuum_limit: float, separate_regimes: bool
    ) -> tuple[Array, Array]:
        """Factors of the independent errors whose sum is the error of CA along a trajectory.

        With standard normal ξ, ``δCA/σ = Σ_jk ξ_jk along_j over_k`` has the correlation of the field between any two
        points, by the Nyström approximation from points at a quarter of a correlation length (Rasmussen and Williams
        2006, section 8.1). Each point keeps the field's variance. The field runs along log Mach number in continuum
        flow and along log Knudsen number above the limit; the two axes join at the greatest Mach number of the
        continuum.

        Parameters
        ----------
        mach, knudsen : (N,) arrays
            Mach number, and Knudsen number based on the diameter.
        angle : (N,) array
            Total angle of attack, rad.
        continuum_limit : float
            Knudsen number above which the rarefied table applies.
        separate_regimes : bool
            Whether the tables of both regimes have independent errors.

        Returns
        -------
        along : (J, N) array
            Factors along the Mach or Knudsen number; the sum of their squares is 1.
        over : (K, N) array
            Factors over the angle, likewise.
        """
        rarefied = knudsen > continuum_limit
        fastest = np.max(mach, where=~rarefied, initial=0.0)
        gap = _INDEPENDENT if separate_regimes else 0.0
        x = np.where(
            rarefied,
            gap + np.log10(np.maximum(knudsen / continuum_limit, 1.0)) / self.log_knudsen_length,
            np.log(mach / (fastest or 1.0)) / self.log_mach_length,
        )
        along = _low_rank(x, lambda d: matern32_correlation(d)[..., 0])
        return along, _low_rank(angle / self.angle_length, squared_exponential_correlation)

    def _symmetric(self, angle: Array) -> Array:
        return np.tanh(angle / self.vanishing_angle)


def _low_rank(x: Array, correlation: Callable[[Array], Array]) -> Array:
    """Factor ``(K, N)`` of the correlation between points ``(N,)``, in correlation lengths, from a grid of points.

    Its columns have unit length.
    """
    cells = np.unique(np.floor(x / _POINT_SPACING))
    grid = _POINT_SPACING * np.unique(np.concatenate((cells, cells + 1.0)))
    size, vectors = np.linalg.eigh(correlation(np.subtract.outer(grid, grid)))
    used = size > _NEGLIGIBLE_EIGENVALUE * size[-1]
    factor = (correlation(np.subtract.outer(x, grid)) @ (vectors[:, used] / np.sqrt(size[used]))).T
    return np.asarray(factor / np.sqrt(np.sum(factor**2, axis=0)), float)


def _linear_between(grid: Array, values: Array, angles: Array) -> Array:
    """Functions tabulated on a grid ``(A, J)``, made linear between some angles; unchanged if there are none."""
    if not len(angles) or not values.shape[1]:
        return values
    return interpolate_columns(grid, angles, interpolate_columns(angles, grid, values))


@dataclass(frozen=True)
class AngleModes:
    """Modes of a coefficient's field over the total angle of attack.

    Attributes
    ----------
    continuum, rarefied : (A, J) arrays
        Value of each mode in either regime at multiples of the tabulation's step, in sigmas of the database for a unit
        amplitude.
    """

    continuum: Array
    rarefied: Array

    @classmethod
    def constant(cls) -> AngleModes:
        """One mode, which is the same at all angles."""
        ones = np.ones((len(_MODE_ANGLES), 1))
        return cls(ones, ones)

    @property
    def count(self) -> int:
        """J, the number of modes."""
        return self.continuum.shape[1]

    def at(self, angle: Array, rarefied: BoolArray) -> Array:
        """Values of all modes, linear between the tabulated angles.

        Parameters
        ----------
        angle : (N,) array
            Total angle of attack, rad.
        rarefied : (N,) boolean array
            Whether the rarefied table applies.

        Returns
        -------
        (N, J) array
        """
        place = np.minimum(np.asarray(angle, float) / _MODE_STEP, len(self.continuum) - 1.001)
        index = place.astype(np.intp)
        fraction, regime = (place - index)[:, None], np.asarray(rarefied)[:, None]
        low, high = (np.where(regime, self.rarefied[i], self.continuum[i]) for i in (index, index + 1))
        return np.asarray((1.0 - fraction) * low + fraction * high)
