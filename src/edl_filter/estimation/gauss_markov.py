"""A first-order Gauss-Markov process that is observed in white noise: its values in a stretch without observations.

Input: observations of a process on one or on both sides of a stretch. Model: a Gauss-Markov process of mean zero with
the covariance ``v g(t) g(t') exp(-|t - t'| / τ)`` with a known amplitude g (Rasmussen & Williams, Gaussian Processes
for Machine Learning, MIT Press 2006, eq. 4.16, the Ornstein-Uhlenbeck process, and eq. 4.32 for the amplitude), and
white noise. Method: Gaussian process regression on the means of equal blocks of observations. The ratio of v to the
noise, τ, and which of several amplitudes applies are nuisance parameters: estimates are averaged over all of them,
weighted by the marginal likelihood (section 5.4 there) with Jeffreys' prior of the noise. Output: the posterior mean,
and the posterior variance of the mean over the stretch.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from edl_filter.types import Array, IntArray

#: Most blocks of observations, and fewest observations.
_BLOCKS, _FEWEST = 100, 3
#: Correlation times that are compared, in spans of the observations.
_TIMES = (0.03, 0.1, 0.3, 1.0, 3.0, 10.0)
#: Ratios of the process's variance to that of one block's noise that are compared. A smaller process has no effect.
_RATIOS = np.logspace(-1.5, 4.0, 12)


def estimate_in_stretch(
    time: Array, values: Array, wanted: Array, amplitudes: Sequence[tuple[Array, Array]] = ()
) -> tuple[Array, Array]:
    """Process at times between or beyond its observations.

    Parameters
    ----------
    time : (m,) array
        Times of the observations, increasing, s.
    values : (m, K) array
        Observations of K processes, each with parameters of its own, in any unit.
    wanted : (n,) array
        Equidistant times of the stretch, s.
    amplitudes : sequence of ((m,) array, (n,) array)
        Amplitudes at the observations and in the stretch that are compared with a constant one, in any unit.

    Returns
    -------
    mean : (n, K) array
        In the unit of the observations; zero if there are less than three of them.
    variance : (K,) array
        Of the mean over the stretch, in the squared unit; the mean square of one or two observations, zero without any.
    """
    if len(time) < _FEWEST:
        return np.zeros((len(wanted), values.shape[1])), np.sum(values**2, axis=0) / max(len(time), 1)
    blocks, parts = (np.array_split(np.arange(len(t)), min(_BLOCKS, len(t))) for t in (time, wanted))
    root = np.sqrt([len(block) for block in blocks])
    root /= root.max()
    at, centre = _block_means(time, blocks), _block_means(wanted, parts)
    observed = _block_means(values, blocks) * root[:, None]
    span = max(time[-1], wanted[-1]) - min(time[0], wanted[0])
    options = []
    for own, missing in ((np.ones(len(time)), np.ones(len(wanted))), *amplitudes):
        scale = np.sqrt(np.mean(own**2)) or 1.0
        weights = _block_means(own, blocks) / scale * root, missing / scale
        for fraction in _TIMES:
            options.append(_of_correlation_time(at, observed, wanted, centre, weights, parts, fraction * span))
    logs, means, variances = (np.concatenate(values) for values in zip(*options, strict=True))
    weight = np.exp(logs - logs.max(axis=0))
    weight /= weight.sum(axis=0)
    mean = np.einsum("gk,gnk->nk", weight, means)
    spread = np.einsum("gk,gk->k", weight, (means.mean(axis=1) - mean.mean(axis=0)) ** 2)
    return mean, np.sum(weight * variances, axis=0) + spread


def _block_means(values: Array, blocks: list[IntArray]) -> Array:
    return np.stack([values[block].mean(axis=0) for block in blocks])


def _of_correlation_time(
    at: Array,
    observed: Array,
    wanted: Array,
    centre: Array,
    weights: tuple[Array, Array],
    parts: list[IntArray],
    correlation_time: float,
) -> tuple[Array, Array, Array]:
    """Log marginal likelihood (G, K), mean (G, n, K) and variance of the mean (G, K) for each of the ratios.

    The blocks `observed` (B, K) have noise of one variance. With the correlation ``U diag(λ) Uᵀ`` of the process in
    them, weighted by amplitude, the covariance is ``s² U diag(1 + ρ λ) Uᵀ`` for each ratio ρ. The prior variance of the
    mean over the stretch is computed from the means over its `parts`, whose middles are `centre`.
    """

    def correlation(a: Array, b: Array) -> Array:
        return np.asarray(np.exp(-np.abs(np.subtract.outer(a, b)) / correlation_time))

    own, missing = weights
    eigenvalues, vectors = np.linalg.eigh(correlation(at, at) * np.outer(own, own))
    rotated = vectors.T @ observed
    cross = missing[:, None] * correlation(wanted, at) * own @ vectors
    diagonal = 1.0 + np.outer(_RATIOS, np.maximum(eigenvalues, 0.0))
    count = len(at)
    noise = np.maximum(np.einsum("gb,bk->gk", 1.0 / diagonal, rotated**2) / count, np.finfo(float).tiny)
    log = -0.5 * np.sum(np.log(diagonal), axis=1)[:, None] - 0.5 * count * np.log(noise)
    gain = _RATIOS[:, None] / diagonal
    mean = np.einsum("nb,gb,bk->gnk", cross, gain, rotated)
    share = np.array([missing[part].sum() for part in parts]) / len(wanted)
    prior = share @ correlation(centre, centre) @ share
    explained = np.sum(gain * cross.mean(axis=0) ** 2, axis=1)
    variance = (_RATIOS * np.maximum(prior - explained, 0.0))[:, None] * noise
    return log, mean, variance
