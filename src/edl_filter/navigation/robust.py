"""Weights of measurements in a robust update: a reading far from its prediction is given more noise.

A Gaussian update moves the estimate in proportion to the innovation, however large. Two robust ones divide the
covariance R of a measurement by a weight w, 0 < w ≤ 1:

- **huber**: ``w = min(1, c √m / γ)``, with γ the length of the whitened posterior residual and m its components. It
  minimises Huber's function (Huber & Ronchetti 2009, *Robust Statistics*, sections 4.5 and 7.8; in a Kalman filter for
  entry: Karlgaard & Schaub 2007, J. Guidance 30, 885). c = 1.345 keeps 95 % of the efficiency with Gaussian noise;
- **student_t**: ``w = (ν + m) / (ν + E[eᵀ R⁻¹ e])`` with ν = 4 degrees of freedom and the posterior expectation: the
  noise is Student's, and w is the mean of its latent precision (variational Bayes; Särkkä 2013, *Bayesian Filtering and
  Smoothing*, and Särkkä & Nummenmaa 2009, IEEE Trans. Autom. Control 54, 596; Roth, Özkan & Gustafsson 2013, ICASSP).

Both follow from residual, prediction covariance and noise alone, so that the UKF and the EKF share them. A first
reading that is wrong is not recognised by its weight where the prediction is uncertain: `consensus` examines it with
those that follow.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np

from edl_filter.navigation.estimator import Innovation

Robust = Literal["none", "huber", "student_t"]

#: Huber's constant, in sigmas.
HUBER = 1.345
#: Degrees of freedom of Student's distribution.
STUDENT_DOF = 4.0
#: Pairs of fixed-point iterations of the weight, each with an extrapolation (Aitken's; Burden & Faires 2011, *Numerical
#: Analysis*, section 2.5), and the relative change at which they end.
ITERATIONS, TOLERANCE = 50, 1e-6


def measurement_weight(innovation: Innovation, robust: Robust) -> float:
    """Weight by which the noise covariance of a measurement is divided.

    Parameters
    ----------
    innovation : Innovation
        With the stated noise covariance.
    robust : str
        ``none``, ``huber`` or ``student_t``.

    Returns
    -------
    float
        Between 0 (excluded) and 1.
    """
    if robust == "none":
        return 1.0
    weight = 1.0
    for _ in range(ITERATIONS):
        first = _next_weight(innovation, robust, weight)
        second = _next_weight(innovation, robust, first)
        if abs(second - first) < TOLERANCE * first:
            return second
        # Weights fall towards the fixed point, slowly where the prediction is much less certain than the reading
        bend = second - 2.0 * first + weight
        limit = weight - (first - weight) ** 2 / bend if bend > 0.0 else 0.0
        beyond = limit <= 0.0 or _next_weight(innovation, robust, limit) > (1.0 + TOLERANCE) * limit
        weight = second if beyond else limit
    return weight


def _next_weight(innovation: Innovation, robust: Robust, weight: float) -> float:
    """Weight by the posterior residual that follows from a `weight`."""
    noise, spread, residual = innovation.noise_covariance, innovation.predicted_covariance, innovation.residual
    count = len(residual)
    total = spread + noise / weight
    posterior = (noise / weight) @ np.linalg.solve(total, residual)
    square = float(posterior @ np.linalg.solve(noise, posterior))
    if robust == "huber":
        return min(1.0, HUBER * float(np.sqrt(count / square))) if square > 0.0 else 1.0
    remaining = spread - spread @ np.linalg.solve(total, spread)
    square += float(np.trace(np.linalg.solve(noise, remaining)))
    return min(1.0, (STUDENT_DOF + count) / (STUDENT_DOF + square))


def weighted(innovation: Innovation, weight: float) -> Innovation:
    """Innovation with the noise covariance divided by `weight`; the same object where the weight is 1."""
    if weight == 1.0:
        return innovation
    return replace(innovation, noise_covariance=innovation.noise_covariance / weight)
