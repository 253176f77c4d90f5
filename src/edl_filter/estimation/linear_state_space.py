"""A linear-Gaussian state-space model, and models that are derived from one.

For the steps k = 1 … K::

    x_k = (I + D_k) x_{k-1} + w_k,   w_k ~ N(0, Q_k)
    y_k = H_k x_k + v_k,             v_k ~ N(0, R_k),   x_0 ~ N(m, P_0)

(Durbin and Koopman, Time Series Analysis by State Space Methods, 2012, ch. 4). A derived model has further states,
known states or less noise; arrays that do not change are shared, not copied.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from edl_filter.estimation.block_sparse import BlockSparse, from_blocks, merge
from edl_filter.types import Array, IntArray


@dataclass(frozen=True)
class LinearStateSpace:
    """A linear-Gaussian state-space model of K steps, n states and R measurement rows.

    Attributes
    ----------
    increment : BlockSparse
        ``D_k``, transition matrix less identity, of each step.
    process_noise : BlockSparse
        ``Q_k`` of each step.
    row_start : (K + 1,) array of int
        Index of the first measurement row of each step, and R.
    design : (R, n) array
        ``H``, all rows.
    row_noise : (R, w) array
        ``R``: each row of its step's covariance block, whose first column belongs to the step's first row.
    initial_covariance : (n, n) array
        ``P_0``.
    """

    increment: BlockSparse
    process_noise: BlockSparse
    row_start: IntArray
    design: Array
    row_noise: Array
    initial_covariance: Array

    @property
    def size(self) -> int:
        """Number of states."""
        return len(self.initial_covariance)

    def initial_mean(self, leading: Array) -> Array:
        """Initial means ``(n, ...)`` whose first components are given; the others are zero."""
        out = np.zeros((self.size, *leading.shape[1:]))
        out[: len(leading)] = leading
        return out


def append_constant_states(model: LinearStateSpace, design: Array, sigma: Array) -> LinearStateSpace:
    """The model with further states that are constant and a priori independent, as its last ones.

    Parameters
    ----------
    model : LinearStateSpace
        n states.
    design : (R, c) array
        Derivatives of the measurements with respect to them.
    sigma : (c,) array
        Prior standard deviations.
    """
    n = model.size + design.shape[1]
    covariance = np.zeros((n, n))
    covariance[: model.size, : model.size] = model.initial_covariance
    covariance[model.size :, model.size :] = np.diag(sigma**2)
    return replace(
        model,
        increment=replace(model.increment, size=n),
        process_noise=replace(model.process_noise, size=n),
        design=np.ascontiguousarray(np.concatenate((model.design, design), axis=1)),
        initial_covariance=covariance,
    )


def with_gauss_markov_states(
    model: LinearStateSpace, interval: Array, memory: Array, variance: Array
) -> LinearStateSpace:
    """The model whose last states, constant so far, are independent first-order Gauss–Markov processes instead.

    Stationary, with the correlation ``exp(-t / memory)`` (Tapley, Schutz and Born, Statistical Orbit Determination,
    2004, section 4.9). The design matrix is that of `model`, not a copy.

    Parameters
    ----------
    model : LinearStateSpace
        n states, the last of them by `append_constant_states`.
    interval : (K,) array
        Time between a step and the one before.
    memory, variance : (c,) arrays
        Correlation time, in the unit of `interval`, and variance of each process.
    """
    n, part = model.size, slice(model.size - len(memory), model.size)
    decay = np.exp(-interval[:, None] / memory)
    increment, noise = (
        from_blocks(n, [(part, part, v[:, :, None] * np.eye(len(memory)))])
        for v in (decay - 1.0, variance * (1.0 - decay**2))
    )
    covariance = model.initial_covariance.copy()
    covariance[part, part] = np.diag(variance)
    return replace(
        model,
        increment=merge(model.increment, increment, n),
        process_noise=merge(model.process_noise, noise, n),
        initial_covariance=covariance,
    )


def with_known_states(model: LinearStateSpace, states: Sequence[int] | IntArray) -> LinearStateSpace:
    """The model with some states known: no initial variance, no process noise, no prior correlation with others.

    What other states add to them in a transition stays uncertain.

    Parameters
    ----------
    model : LinearStateSpace
        n states.
    states : (c,) sequence or array of int
        Indices of the states.
    """
    covariance = model.initial_covariance.copy()
    covariance[states], covariance[:, states] = 0.0, 0.0
    q = model.process_noise
    keep = ~(np.isin(q.row, states) | np.isin(q.column, states))
    noise = BlockSparse(q.size, q.row[keep], q.column[keep], q.values[:, keep])
    return replace(model, initial_covariance=covariance, process_noise=noise)


def with_less_noise(model: LinearStateSpace, rows: IntArray, factor: float) -> LinearStateSpace:
    """The model with the sigma of the noise of some rows divided by a factor.

    Parameters
    ----------
    model : LinearStateSpace
        R rows.
    rows : (r,) array of int
        Indices of the rows; where the noise of several rows is correlated, all of them or none.
    factor : float
        More than zero.
    """
    noise = model.row_noise.copy()
    noise[rows] /= factor**2
    return replace(model, row_noise=noise)
