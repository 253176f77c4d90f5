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


def regress(y: Array, x: Array, sigma: Array, mean: Array | None = None) -> LinearFit:
    """Fit coefficients to white rows.

    Parameters
    ----------
    y : (R,) array
        White measurements.
    x : (R, k) array
        White regressors.
    sigma : (k,) array
        Prior standard deviations.
    mean : (k,) array, optional
        Prior means; zero if not given.
    """
    return fit_normal_equations(x.T @ x, x.T @ y, sigma, mean)


def fit_normal_equations(information: Array, projection: Array, sigma: Array, mean: Array | None = None) -> LinearFit:
    """Fit coefficients from the normal equations.

    Parameters
    ----------
    information : (k, k) array
        ``XᵀX``.
    projection : (k,) array
        ``Xᵀy``.
    sigma, mean : (k,) arrays
        As in `regress`.
    """
    prior = 1.0 / sigma**2
    shift = np.zeros_like(sigma) if mean is None else mean
    target = projection + prior * shift
    covariance = np.asarray(np.linalg.inv(information + np.diag(prior)), float)
    estimate = covariance @ target
    gain = 0.5 * float(target @ estimate - prior @ shift**2)
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
    """Coefficient whose expected gain is `gain` nats: ``0.5 s² A - 0.5 log(1 + A sigma²)``.

    Parameters
    ----------
    information : float
        A, squared norm of the white column, per unit of size squared.
    sigma : float
        Prior standard deviation.
    gain : float
        nats.

    Returns
    -------
    float
        Infinite where the data have no information.
    """
    if not information > 0.0:
        return float("inf")
    penalty = 0.5 * np.log1p(information * sigma**2)
    return float(np.sqrt(2.0 * (gain + penalty) / information))
