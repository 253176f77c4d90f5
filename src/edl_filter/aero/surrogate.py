"""The smooth surrogate of the Phoenix continuum table: 33 × 9 numbers.

Per Mach number ``CA = a0 + a1 s² + a2 exp(−(s/sig)²)`` and, about a point 0.253 D behind the nose,
``CN, Cm = s (a0 + a1 s² + a2 exp(−(s/sig)²))`` with s = sin(alpha); PCHIP of the coefficients in Mach.
Odd and even symmetry hold exactly. Against the published curves it is off by rms 0.0024 in CA, 0.0007 in CN
and 0.0004 in Cm (``mevad_surrogate.csv``); beyond 16 degrees it is extrapolated.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from importlib.resources import files
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import PchipInterpolator

from edl_filter.aero.grid import Array, Bools, Weights, look_up, within
from edl_filter.aero.tables import read_rows

#: Widths of the bump in sin(alpha), for CA, CN and Cm.
WIDTHS = np.array([0.115, 0.080, 0.110])
#: Moment reference point of the coefficients, diameters behind the nose (Phoenix's centre of mass).
X_REFERENCE = 0.253
#: The largest angle at which the surrogate is used, rad; its data end at 16 degrees.
ALPHA_MAX = float(np.radians(25.0))

COLUMNS = ("mach", *(f"{c}_{k}" for c in ("CA", "CN", "Cm_cg0253") for k in range(3)))


@dataclass(frozen=True, eq=False)
class Surrogate:
    """Smooth coefficients over Mach and angle.

    Attributes
    ----------
    mach : (M,) array
        Increasing.
    coefficients : (M, 9) array
        a0, a1, a2 of CA, of CN and of Cm about 0.253 D.
    source : str
        Where the numbers come from.
    """

    mach: Array
    coefficients: Array
    source: str = "mevad_surrogate.csv: Phoenix (AIAA 2008-7219), fitted"

    @property
    def alpha_max(self) -> float:
        """Largest angle, rad."""
        return ALPHA_MAX

    def lookup(self, mach: ArrayLike, alpha: ArrayLike) -> tuple[Array, Array, Array, Bools]:
        """CA, CN, Cm_nose and whether the point lies outside (`edl_filter.aero.grid.look_up`)."""
        return look_up(self, mach, alpha)

    def at(self, x: ArrayLike) -> SurrogateSlice:
        """The curves at Mach numbers (N,)."""
        x = np.asarray(x, float)
        return SurrogateSlice(self._in_mach(np.clip(x, self.mach[0], self.mach[-1])), ~within(x, self.mach))

    @cached_property
    def _in_mach(self) -> PchipInterpolator:
        return PchipInterpolator(self.mach, self.coefficients)


@dataclass(frozen=True, eq=False)
class SurrogateSlice:
    """A `Surrogate` cut at N Mach numbers: its nine coefficients (N, 9) there."""

    coefficients: Array
    outside: Bools

    @property
    def alpha_nodes(self) -> Array:
        """Bounds of the angle, rad; the curves are smooth between them."""
        return np.array([0.0, ALPHA_MAX])

    def evaluate(self, alpha: Array) -> Array:
        """(3, N) CA, CN, Cm_nose, each curve at its own angle."""
        s = np.sin(np.clip(alpha, 0.0, ALPHA_MAX))
        s2 = s * s
        a = self.coefficients.T
        ca, cn, cm = (a[3 * k] + a[3 * k + 1] * s2 + a[3 * k + 2] * np.exp(-s2 / WIDTHS[k] ** 2) for k in range(3))
        cn = s * cn
        return np.stack([ca, cn, s * cm - X_REFERENCE * cn])

    def rows(self, alpha: Array, weights: Weights) -> Array:
        """(N, G) weighted sum of the coefficients at common angles (G,)."""
        s = np.sin(np.clip(alpha, 0.0, ALPHA_MAX))
        ca, cn, cm = weights
        basis = [
            part * shape
            for part, width in zip((ca, (cn - X_REFERENCE * cm) * s, cm * s), WIDTHS, strict=True)
            for shape in (np.ones_like(s), s**2, np.exp(-((s / width) ** 2)))
        ]
        used = [k for k, b in enumerate(basis) if np.any(b)]
        return self.coefficients[:, used] @ np.array([basis[k] for k in used])

    def take(self, index: NDArray[np.intp]) -> SurrogateSlice:
        """The slice of some of the samples."""
        return SurrogateSlice(self.coefficients[index], self.outside[index])


@lru_cache(maxsize=1)
def phoenix_surrogate() -> Surrogate:
    """The surrogate that the package ships."""
    path = Path(str(files("edl_filter") / "data" / "mevad_surrogate.csv"))
    values = np.array([row.values for row in read_rows(path, COLUMNS)])
    return Surrogate(values[:, 0], values[:, 1:])
