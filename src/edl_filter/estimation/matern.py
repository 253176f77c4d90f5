"""Matérn processes of order 3/2: their correlation, their state-space form, and samples of them.

A stationary Gaussian process whose realisations are differentiable once. With r the distance over the correlation
length its correlation is ``(1 + √3 r) exp(-√3 r)`` (Rasmussen & Williams, Gaussian Processes for Machine Learning, MIT
Press 2006, eq. 4.17). As a state of value x and slope x' it is Markov,

    d(x, x')/dr = [[0, 1], [-3, -2√3]] (x, x') + white noise,

with stationary covariance diag(1, 3) (Särkkä & Solin, Applied Stochastic Differential Equations, Cambridge 2019,
section 12.3). The slope is by r, so its unit is that of the value.
"""

from __future__ import annotations

import numpy as np

from edl_filter.types import Array

#: Stationary covariance of value and slope, for unit variance.
MATERN32_COVARIANCE = np.diag([1.0, 3.0])
#: Added to the diagonal of the correlation matrix of a sample, so that it is positive definite in double precision.
_JITTER = 1e-9


def matern32_transition(distance: Array) -> tuple[Array, Array]:
    """Transition matrix and process noise of the state-space form, for unit variance.

    Parameters
    ----------
    distance : (...) array
        Steps over the correlation length, not negative.

    Returns
    -------
    transition, noise : (..., 2, 2) arrays
        Of value and slope; both in the unit of the value.
    """
    d = np.sqrt(3.0) * np.asarray(distance, float)
    e = np.exp(-d)
    transition = np.empty((*d.shape, 2, 2))
    transition[..., 0, 0], transition[..., 0, 1] = (1.0 + d) * e, distance * e
    transition[..., 1, 0], transition[..., 1, 1] = -np.sqrt(3.0) * d * e, (1.0 - d) * e
    stationary = MATERN32_COVARIANCE
    return transition, stationary - transition @ stationary @ np.swapaxes(transition, -1, -2)


def matern32_correlation(distance: Array) -> Array:
    """Correlations of a process of order 3/2 and its derivative with its value at another place, for unit variance.

    Parameters
    ----------
    distance : (...) array
        Place of the process less that of the value, over the correlation length; of either sign.

    Returns
    -------
    (..., 2) array
        Of value and derivative.
    """
    d = np.sqrt(3.0) * np.asarray(distance, float)
    size = np.abs(d)
    decay = np.exp(-size)
    return np.stack(((1.0 + size) * decay, -np.sqrt(3.0) * d * decay), axis=-1)


def sample_matern32(random: np.random.Generator, nodes: int, step: float, sigma: float, length: float) -> Array:
    """One realisation at equidistant nodes.

    Parameters
    ----------
    random : Generator
        Source of the normal deviates.
    nodes : int
        Number of nodes.
    step, length : float
        Distance of the nodes and correlation length, in one unit.
    sigma : float
        Standard deviation, in any unit.

    Returns
    -------
    (nodes,) array
        In the unit of `sigma`.
    """
    d = np.sqrt(3.0) * step / length * np.abs(np.subtract.outer(np.arange(nodes), np.arange(nodes)))
    root = np.linalg.cholesky((1.0 + d) * np.exp(-d) + _JITTER * np.eye(nodes))
    return sigma * root @ random.standard_normal(nodes)
