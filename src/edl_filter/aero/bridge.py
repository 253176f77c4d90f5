"""The bridge between continuum and free-molecular coefficients.

Source: R. G. Wilmoth, R. A. Mitcheltree and J. N. Moss, "Low-Density Aerodynamics of the Stardust Sample Return
Capsule", AIAA 97-2510, 1997.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["CONTINUUM_KNUDSEN", "FREE_MOLECULAR_KNUDSEN", "bridge"]

#: Knudsen numbers, on the diameter, at which the bridge begins and ends.
CONTINUUM_KNUDSEN = 1e-3
FREE_MOLECULAR_KNUDSEN = 10.0


def bridge(knudsen: ArrayLike) -> NDArray[np.float64]:
    """Share of the free-molecular coefficient, sin²[π(3/8 + log₁₀(Kn)/8)].

    A coefficient between the regimes is ``continuum + (free_molecular − continuum) · bridge(knudsen)``. The share and
    its slope are continuous at both ends.

    Parameters
    ----------
    knudsen : array_like
        Knudsen number on the diameter; any shape.

    Returns
    -------
    ndarray
        0 below Kn = 1e-3, 1 above 10, between them the formula; NaN where the Knudsen number is NaN.
    """
    inside = np.clip(np.asarray(knudsen, dtype=float), CONTINUUM_KNUDSEN, FREE_MOLECULAR_KNUDSEN)
    return np.sin(np.pi * (3.0 + np.log10(inside)) / 8.0) ** 2
