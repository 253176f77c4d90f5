"""Bridging function between continuum and free-molecular coefficients.

Input: Knudsen numbers. Output: weights of the free-molecular coefficient, from 0 to 1.

Source: R. G. Wilmoth, R. A. Mitcheltree and J. N. Moss, "Low-Density Aerodynamics of the Stardust Sample Return
Capsule", AIAA 97-2510, 1997.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from edl_filter.types import Array

__all__ = ["CONTINUUM_KNUDSEN", "FREE_MOLECULAR_KNUDSEN", "bridge"]

#: Knudsen numbers, based on the diameter, at which the function reaches 0 and 1.
CONTINUUM_KNUDSEN = 1e-3
FREE_MOLECULAR_KNUDSEN = 10.0


def bridge(knudsen: ArrayLike) -> Array:
    """Weight of the free-molecular coefficient, sin²[π(3/8 + log₁₀(Kn)/8)].

    A coefficient between the regimes is ``continuum + (free_molecular − continuum) · bridge(knudsen)``. The weight and
    its slope are continuous at both ends.

    Parameters
    ----------
    knudsen : (...) array
        Knudsen number based on the diameter.

    Returns
    -------
    (...) array
        0 below Kn = 1e-3, 1 above 10, the formula in between; NaN where the Knudsen number is NaN.
    """
    inside = np.clip(np.asarray(knudsen, dtype=float), CONTINUUM_KNUDSEN, FREE_MOLECULAR_KNUDSEN)
    return np.sin(np.pi * (3.0 + np.log10(inside)) / 8.0) ** 2
