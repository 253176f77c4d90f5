"""Small linear-Gaussian state-space models, and the dense joint Gaussian of all their states and measurements."""

import numpy as np

from edl_filter.estimation.block_sparse import from_blocks
from edl_filter.estimation.linear_state_space import LinearStateSpace


def from_dense(matrices):
    """The sparse form of dense matrices ``(K, n, n)``."""
    n = matrices.shape[1]
    return from_blocks(n, [(slice(0, n), slice(0, n), matrices)])


def random_model(seed=3, steps=40, size=7, moving=3):
    """A model whose first states move while the others are constant; some steps have no measurement rows."""
    rng = np.random.default_rng(seed)
    transitions = np.tile(np.eye(size), (steps, 1, 1))
    transitions[:, :moving, :moving] += 0.1 * rng.normal(size=(steps, moving, moving))
    process_noise = np.zeros((steps, size, size))
    for k in range(steps):
        root = 0.1 * rng.normal(size=(moving, moving))
        process_noise[k, :moving, :moving] = root @ root.T
    counts = rng.integers(0, 4, steps)
    row_start = np.concatenate(([0], np.cumsum(counts)))
    design = rng.normal(size=(row_start[-1], size))
    row_noise = np.zeros((row_start[-1], 3))
    for k in range(steps):
        root = rng.normal(size=(counts[k], counts[k]))
        row_noise[row_start[k] : row_start[k + 1], : counts[k]] = root @ root.T + 0.5 * np.eye(counts[k])
    root = rng.normal(size=(size, size))
    return LinearStateSpace(
        increment=from_dense(transitions - np.eye(size)),
        process_noise=from_dense(process_noise),
        row_start=row_start,
        design=design,
        row_noise=row_noise,
        initial_covariance=root @ root.T,
    )


def whiten_column(whiten, measurements, initial_mean):
    """White rows ``(R,)`` of one column."""
    return whiten(measurements[:, None], initial_mean[:, None])[:, 0]


def transition(model, k):
    """``I + D`` of step k, ``(n, n)``."""
    return np.eye(model.size) + model.increment[k]


def step_rows(model):
    """Slice of the measurement rows of each step."""
    return [slice(a, b) for a, b in zip(model.row_start[:-1], model.row_start[1:], strict=True)]


def joint_states(model, initial_mean):
    """Mean and covariance of the states at the beginning and after the transition of every step.

    Returns
    -------
    mean : (K + 1, n) array
    covariance : (K + 1, n, K + 1, n) array
    """
    n, steps = model.size, len(model.increment)
    mean, covariance = np.zeros((steps + 1, n)), np.zeros((steps + 1, n, steps + 1, n))
    mean[0], covariance[0, :, 0] = initial_mean, model.initial_covariance
    for k in range(steps):
        f = transition(model, k)
        mean[k + 1] = f @ mean[k]
        covariance[k + 1, :, : k + 1] = np.einsum("ij,jkl->ikl", f, covariance[k, :, : k + 1])
        covariance[: k + 1, :, k + 1] = np.einsum("ikl->kli", covariance[k + 1, :, : k + 1])
        covariance[k + 1, :, k + 1] = f @ covariance[k, :, k] @ f.T + model.process_noise[k]
    return mean, covariance


def joint_design(model):
    """Derivative ``(R, K + 1, n)`` of all measurements with respect to the states of `joint_states`."""
    out = np.zeros((model.row_start[-1], len(model.increment) + 1, model.size))
    for k, rows in enumerate(step_rows(model)):
        out[rows, k + 1] = model.design[rows]
    return out


def joint_noise(model):
    """Covariance ``(R, R)`` of the measurement noise of all rows."""
    out = np.zeros((model.row_start[-1], model.row_start[-1]))
    for rows in step_rows(model):
        out[rows, rows] = model.row_noise[rows, : rows.stop - rows.start]
    return out


def joint_measurements(model, initial_mean):
    """Mean ``(R,)`` and covariance ``(R, R)`` of all measurements."""
    mean, covariance = joint_states(model, initial_mean)
    h, n = joint_design(model).reshape(model.row_start[-1], -1), mean.size
    return h @ mean.ravel(), h @ covariance.reshape(n, n) @ h.T + joint_noise(model)


def posterior_states(model, initial_mean, measurements):
    """Mean ``(K + 1, n)`` and covariance ``(K + 1, n, K + 1, n)`` of the states, given all measurements ``(R,)``."""
    mean, covariance = joint_states(model, initial_mean)
    shape, n = covariance.shape, mean.size
    h, prior = joint_design(model).reshape(len(measurements), -1), covariance.reshape(n, n)
    gain = np.linalg.solve(h @ prior @ h.T + joint_noise(model), h @ prior).T
    posterior_mean = mean.ravel() + gain @ (measurements - h @ mean.ravel())
    return posterior_mean.reshape(mean.shape), (prior - gain @ h @ prior).reshape(shape)
