"""Smooth surrogate of Phoenix's continuum table: 33 × 9 numbers.

Input: Mach numbers and angles. Method: at each Mach number ``CA = a0 + a1 s² + a2 exp(−(s/sig)²)`` and, about a point
0.253 D behind the nose, ``CN, Cm = s (a0 + a1 s² + a2 exp(−(s/sig)²))`` with s = sin(alpha); the coefficients are
interpolated in Mach number by PCHIP. Output: CA, CN and Cm about the nose, exactly even or odd in the angle. The RMS
difference from the published curves is 0.0024 in CA, 0.0007 in CN and 0.0004 in Cm (``mevad_surrogate.csv``); beyond 16
degrees the surrogate is an extrapolation.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from edl_filter.aero.grid import Table, Weights, within
from edl_filter.aero.pchip import pchip_coefficients, piecewise_cubic
from edl_filter.io.csv_table import package_data, read_rows
from edl_filter.types import Array, BoolArray

#: Widths sig of the Gaussian term in sin(alpha), for CA, CN and Cm.
WIDTHS = np.array([0.115, 0.080, 0.110])
#: Moment reference point of the coefficients, diameters behind the nose (Phoenix's centre of mass).
X_REFERENCE = 0.253
#: Largest angle at which the surrogate is used, rad; its data end at 16 degrees.
ALPHA_MAX = float(np.radians(25.0))

COLUMNS = ("mach", *(f"{c}_{k}" for c in ("CA", "CN", "Cm_cg0253") for k in range(3)))


@dataclass(frozen=True, eq=False)
class Surrogate(Table):
    """Smooth coefficients over Mach number and angle.

    Attributes
    ----------
    mach : (M,) array
        Increasing.
    coefficients : (M, 9) array
        a0, a1, a2 of CA, of CN and of Cm about a point 0.253 D behind the nose.
    source : str
        Origin of the numbers.
    """

    mach: Array
    coefficients: Array
    source: str = "mevad_surrogate.csv: Phoenix (AIAA 2008-7219), fitted"

    @property
    def alpha_max(self) -> float:
        """Largest angle, rad."""
        return ALPHA_MAX

    def at(self, x: ArrayLike) -> SurrogateSlice:
        """Slice at Mach numbers (N,)."""
        x = np.asarray(x, float)
        clipped = np.clip(x, self.mach[0], self.mach[-1])
        return SurrogateSlice(piecewise_cubic(self.mach, self._pieces, clipped), ~within(x, self.mach))

    @cached_property
    def _pieces(self) -> Array:
        """Polynomials (4, M - 1, 9) between the Mach numbers."""
        return pchip_coefficients(self.mach, self.coefficients)


@dataclass(frozen=True, eq=False)
class SurrogateSlice:
    """Slice of a `Surrogate` at N Mach numbers.

    Attributes
    ----------
    coefficients : (N, 9) array
    outside : (N,) boolean array
    """

    coefficients: Array
    outside: BoolArray

    @property
    def alpha_nodes(self) -> Array:
        """Bounds of the angle (2,), rad; the curves are smooth in between."""
        return np.array([0.0, ALPHA_MAX])

    def evaluate(self, alpha: Array) -> Array:
        """CA, CN, Cm_nose (3, N), each curve at its own angle (N,), rad."""
        s = np.sin(np.clip(alpha, 0.0, ALPHA_MAX))
        s2 = s * s
        a = self.coefficients.T
        ca, cn, cm = (a[3 * k] + a[3 * k + 1] * s2 + a[3 * k + 2] * np.exp(-s2 / WIDTHS[k] ** 2) for k in range(3))
        cn = s * cn
        return np.stack([ca, cn, s * cm - X_REFERENCE * cn])

    def rows(self, alpha: Array, weights: Weights) -> Array:
        """Weighted sum of the coefficients (N, G) at common angles (G,), rad."""
        s = np.sin(np.clip(alpha, 0.0, ALPHA_MAX))
        ca, cn, cm = weights
        basis = [
            factor * function
            for factor, width in zip((ca, (cn - X_REFERENCE * cm) * s, cm * s), WIDTHS, strict=True)
            for function in (np.ones_like(s), s**2, np.exp(-((s / width) ** 2)))
        ]
        nonzero = [k for k, values in enumerate(basis) if np.any(values)]
        return self.coefficients[:, nonzero] @ np.array([basis[k] for k in nonzero])

    def take(self, index: NDArray[np.intp]) -> SurrogateSlice:
        """Slice of the samples at the indices (S,)."""
        return SurrogateSlice(self.coefficients[index], self.outside[index])


@lru_cache(maxsize=1)
def phoenix_surrogate() -> Surrogate:
    """Surrogate from the numbers that the package ships."""
    rows = read_rows(package_data("mevad_surrogate.csv"), COLUMNS, "aerodynamic table")
    values = np.array([row.values for row in rows])
    return Surrogate(values[:, 0], values[:, 1:])
