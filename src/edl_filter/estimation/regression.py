"""Bayesian linear regression on white rows: posterior, marginal likelihood and held-out predictive density.

Model: ``y = X b + e`` with independent rows of unit variance and independent Gaussian priors of the coefficients b. All
results have a closed form (Gelman et al., Bayesian Data Analysis, 2013, ch. 14; Bishop, Pattern Recognition and Machine
Learning, 2006, sections 3.3 and 3.5).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from edl_filter.types import Array


@dataclass(frozen=True)
class LinearFit:
    """Posterior of the coefficients.

    Attributes
    ----------
    estimate, covariance : (k,), (k, k) arrays
        Posterior mean and covariance.
    gain : float
        Log Bayes factor over the model without regressors, nats.
    data_share : (k,) array
        Share of each coefficient's posterior information that comes from the data, 0 to 1.
    """

    estimate: Array
    covariance: Array
    gain: float
    data_share: Array


def regress(y: Array, x: Array, sigma: Array) -> LinearFit:
    """Fit coefficients to white rows.

    Parameters
    ----------
    y : (R,) array
        White measurements.
    x : (R, k) array
        White regressors.
    sigma : (k,) array
        Prior standard deviations; prior means are zero.
    """
    return fit_normal_equations(x.T @ x, x.T @ y, sigma)


def fit_normal_equations(information: Array, projection: Array, sigma: Array) -> LinearFit:
    """Fit coefficients from the normal equations.

    Parameters
    ----------
    information : (k, k) array
        ``XᵀX``.
    projection : (k,) array
        ``Xᵀy``.
    sigma : (k,) array
        As in `regress`.
    """
    prior = 1.0 / sigma**2
    covariance = np.asarray(np.linalg.inv(information + np.diag(prior)), float)
    estimate = covariance @ projection
    gain = 0.5 * float(projection @ estimate)
    gain -= 0.5 * np.linalg.slogdet(np.eye(len(sigma)) + information * sigma**2)[1]
    return LinearFit(estimate, covariance, gain, 1.0 - np.diag(covariance) * prior)


def held_out_gain(y: Array, x: Array, sigma: Array, time: Array, block: float, folds: int) -> float:
    """Gain in log predictive density by cross-validation on blocks of time, over the model without regressors, nats.

    Blocks are dealt to the folds in turn. Each fold is predicted from all others; the predictive covariance contains
    the posterior covariance of the coefficients (Gelman, Hwang and Vehtari, Stat. Comput. 24 (2014) 997).

    Parameters
    ----------
    y : (R,) array
        White measurements.
    x : (R, k) array
        White regressors.
    sigma : (k,) array
        Prior standard deviations; prior means are zero.
    time : (R,) array
        Time of each row, s.
    block : float
        Length of a block, s.
    folds : int
        Number of folds.
    """
    fold = np.floor((time - time[0]) / block).astype(int) % folds
    parts = [(x[fold == f], y[fold == f]) for f in range(folds)]
    moments = [(a.T @ a, a.T @ b) for a, b in parts]
    total = sum(m[0] for m in moments), sum(m[1] for m in moments)
    score = 0.0
    for g, c in moments:
        fit = fit_normal_equations(total[0] - g, total[1] - c, sigma)
        residual = c - g @ fit.estimate
        # r'r - y'y with r = y - x b, and the Woodbury identity for the covariance I + x V x'
        change = float(-2.0 * c @ fit.estimate + fit.estimate @ g @ fit.estimate)
        inner = np.linalg.inv(np.linalg.inv(fit.covariance) + g)
        change -= float(residual @ inner @ residual)
        score -= 0.5 * change + 0.5 * np.linalg.slogdet(np.eye(len(sigma)) + fit.covariance @ g)[1]
    return score


def smallest_size(information: float, sigma: float, gain: float) -> float:
    """Coefficient at which the expected log Bayes factor of its regressor is `gain`.

    With the column x, its squared norm A and rows ``y = s x + e``, the log Bayes factor is ``(xᵀy)² V / 2 - log(1 + A
    sigma²) / 2``, with the posterior variance ``V = 1 / (A + 1 / sigma²)`` (Bishop, section 3.5). Since the mean of
    ``(xᵀy)²`` is ``A² s² + A``, its expectation is ``r (A s² + 1) / 2 - log(1 + A sigma²) / 2`` with the share of the
    data ``r = A V``.

    Parameters
    ----------
    information : float
        A, squared norm of the white column, per unit of size squared.
    sigma : float
        Prior standard deviation.
    gain : float
        nats; positive.

    Returns
    -------
    float
        Infinite where the measurements have no information.
    """
    ratio = information * sigma**2
    if not ratio > 0.0:
        return float("inf")
    price = np.log1p(ratio)
    return float(np.sqrt(((2.0 * gain + price) * (1.0 + 1.0 / ratio) - 1.0) / information))
