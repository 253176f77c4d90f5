"""Bayesian regression on white rows: size, evidence and held-out score of an effect.

Rows are independent with unit variance, sizes have independent Gaussian priors about zero (their plausible sizes); so
everything has a closed form. `y` are white differences, `x` white signatures.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: Length of the blocks that are held out, s, and number of parts that they are dealt to.
BLOCK, FOLDS = 5.0, 5


@dataclass(frozen=True)
class Fit:
    """Posterior of the sizes.

    Attributes
    ----------
    size, covariance : (k,), (k, k) arrays
    gain : float
        Logarithm of the evidence over that of no effect, nats: fit and prior together.
    data_share : (k,) array
        Part of each size's information that comes from the data, not from the prior.
    """

    size: Array
    covariance: Array
    gain: float
    data_share: Array


def regress(y: Array, x: Array, sigma: Array, mean: Array | None = None) -> Fit:
    """Fit sizes with prior one sigma `sigma` ``(k,)`` about `mean` (zero)."""
    return from_moments(x.T @ x, x.T @ y, sigma, mean)


def from_moments(information: Array, projection: Array, sigma: Array, mean: Array | None = None) -> Fit:
    """The same from ``xᵀx`` and ``xᵀy``."""
    prior = 1.0 / sigma**2
    shift = np.zeros_like(sigma) if mean is None else mean
    target = projection + prior * shift
    covariance = np.asarray(np.linalg.inv(information + np.diag(prior)), float)
    size = covariance @ target
    gain = 0.5 * float(target @ size - prior @ shift**2)
    gain -= 0.5 * np.linalg.slogdet(np.eye(len(sigma)) + information * sigma**2)[1]
    return Fit(size, covariance, gain, 1.0 - np.diag(covariance) * prior)


def held_out(y: Array, x: Array, sigma: Array, time: Array) -> float:
    """Gain in log predictive density of rows that were not fitted, nats, over no effect.

    Blocks of time are dealt to `FOLDS` parts in turn; each part is predicted from all others, with the uncertainty of
    what they say.
    """
    part = np.floor((time - time[0]) / BLOCK).astype(int) % FOLDS
    inside = [(x[part == f], y[part == f]) for f in range(FOLDS)]
    moments = [(a.T @ a, a.T @ b) for a, b in inside]
    whole = sum(m[0] for m in moments), sum(m[1] for m in moments)
    score = 0.0
    for g, c in moments:
        fit = from_moments(whole[0] - g, whole[1] - c, sigma)
        left = c - g @ fit.size
        # r'r - y'y with r = y - x size, and Woodbury for the covariance I + x V x'
        change = float(-2.0 * c @ fit.size + fit.size @ g @ fit.size)
        inner = np.linalg.inv(np.linalg.inv(fit.covariance) + g)
        change -= float(left @ inner @ left)
        score -= 0.5 * change + 0.5 * np.linalg.slogdet(np.eye(len(sigma)) + fit.covariance @ g)[1]
    return score
