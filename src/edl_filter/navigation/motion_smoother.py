"""Smoothing of a vehicle's rotational motion across lost readings, and prediction of these readings.

Input: readings on both sides of a lost stretch, and those within it of axes that are not lost, with the stochastic
model of the motion (`motion_model`), whose disturbances contain the errors of the database: the motion in the stretch
has forces and moments of the size that the readings around it have. Method:

- most probable motion by the iterated extended Kalman smoother, which is the Gauss-Newton method (Bell, SIAM J. Optim.
  4 (1994) 626);
- sizes of the disturbances by the largest marginal likelihood of these readings, with log-normal priors;
- scale of the covariance by cross-validation: stretches of the same length on both sides are predicted without their
  own readings;
- where the readings within the stretch do not fit the motion, their mean square residual is a further scale;
- where a prediction from one side alone differs from that from both by more than its sigma explains, the motion changes
  in the stretch, and the difference is added to the covariance.

Output: the readings of the stretch with their covariance.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize

from edl_filter.estimation.autoregression import Interpolation, trial_stretches
from edl_filter.estimation.kalman import measurement_update
from edl_filter.estimation.smoothing import smoothed_joint_covariance, smoothed_moments, smoother_gain
from edl_filter.navigation.motion_model import (
    MEDIANS,
    WIDTHS,
    Covariances,
    LinearisedMotion,
    Window,
    covariances,
    linearise_window,
    log_posterior,
    propagated_states,
)
from edl_filter.navigation.rotational_dynamics import ERROR_SIZE, add_errors
from edl_filter.types import Array, BoolArray

#: Range of the hyperparameters, in widths.
_BELOW, _ABOVE = 1.5, 3.0
#: Iterations of a search for the hyperparameters, its step, most searches, and the change, in widths, below which the
#: hyperparameters are those of the search before.
_SEARCH_ITERATIONS, _SEARCH_STEP, _MOST_SEARCHES, _SAME_SIZES = 12, 0.05, 6, 0.3
#: Most Gauss-Newton steps between two searches, the number of steps after which a step that is more than half as large
#: as the one before is halved, the least part of a step, and the change of a prediction, in its sigmas, below which it
#: has converged. The change of a reading that is observed is weighted by `_READ_SHARE`: coefficients are linear between
#: the nodes of a table, and whole steps can alternate about a node.
_MOST_STEPS, _HALVED_FROM, _LEAST_FACTOR, _CONVERGED, _READ_SHARE = 14, 5, 0.25, 0.1, 0.2
#: Weight of the model's own covariance against the cross-validation, in stretches, as in the autoregression.
_PRIOR_STRETCHES = 2.0
#: Sigmas by which a prediction from one side may differ from that from both.
_SIDE_SIGMAS = 3.0


@dataclass(frozen=True)
class Solution:
    """Most probable motion.

    Attributes
    ----------
    motion : LinearisedMotion
        The window linearised about it.
    log_sizes : (11,) array
        Logarithms of the hyperparameters (see `motion_model`).
    log_posterior : float
        Of the hyperparameters, nats, without a constant.
    """

    motion: LinearisedMotion
    log_sizes: Array
    log_posterior: float


def estimate_sizes(window: Window, motion: LinearisedMotion, start: Array) -> Array:
    """Hyperparameters with the largest marginal likelihood of the readings, times their prior.

    Parameters
    ----------
    window : Window
        Readings around the stretch.
    motion : LinearisedMotion
        The window linearised.
    start : (11,) array
        Logarithms from which the search starts.

    Returns
    -------
    (11,) array
        Logarithms.
    """
    density = log_posterior(window, motion)

    def cost(log_sizes: Array) -> float:
        value = density(log_sizes)
        return -value if np.isfinite(value) else 1e300

    bounds = list(zip(MEDIANS - _BELOW * WIDTHS, MEDIANS + _ABOVE * WIDTHS, strict=True))
    options = {"maxiter": _SEARCH_ITERATIONS, "eps": _SEARCH_STEP}
    return np.asarray(minimize(cost, start, method="L-BFGS-B", bounds=bounds, options=options).x)


def smooth_errors(motion: LinearisedMotion, c: Covariances, observed: BoolArray) -> tuple[Array, Array, Array]:
    """Errors given the observed readings, by the Rauch-Tung-Striebel smoother.

    Parameters
    ----------
    motion : LinearisedMotion
        The linearised window.
    c : Covariances
        Its covariances.
    observed : (T, 6) boolean array
        Readings that are used.

    Returns
    -------
    mean : (T, 19) array
        Of e (`LinearisedMotion`).
    covariance : (T, 19, 19) array
    gain : (T - 1, 19, 19) array
        Of the smoother, from each bin to the next.

    Raises
    ------
    LinAlgError
        A covariance is not positive definite to working precision.
    """
    count = len(observed)
    mean, covariance = np.empty((count, ERROR_SIZE)), np.empty((count, ERROR_SIZE, ERROR_SIZE))
    predicted_mean, predicted = np.empty_like(mean), np.empty_like(covariance)
    x, p = motion.initial, c.initial
    for t in range(count):
        predicted_mean[t], predicted[t] = x, p
        rows = observed[t]
        if rows.any():
            design = motion.design[t, rows]
            gain, p = measurement_update(p, design, np.diag(c.row_variance[t, rows]))
            x = x + gain @ (motion.residual[t, rows] - design @ x)
        mean[t], covariance[t] = x, p
        f = motion.transition[t]
        x, p = f @ x, f @ p @ f.T + c.process_noise[t]
    gains = np.empty((count - 1, ERROR_SIZE, ERROR_SIZE))
    for t in range(count - 2, -1, -1):
        if not np.all(np.diag(predicted[t + 1]) > 0.0):
            raise np.linalg.LinAlgError("a predicted covariance is not positive definite")
        unit = np.sqrt(np.diag(predicted[t + 1]))  # the states' sizes differ by many orders
        cross = covariance[t] @ motion.transition[t].T / unit
        gains[t] = smoother_gain(cross, predicted[t + 1] / np.outer(unit, unit)) / unit
        changes = mean[t + 1] - predicted_mean[t + 1], covariance[t + 1] - predicted[t + 1]
        mean[t], covariance[t] = smoothed_moments(mean[t], covariance[t], gains[t], *changes)
    return mean, covariance, gains


def most_probable_motion(window: Window, before: Solution | None = None) -> Solution | None:
    """Most probable motion of a window with the most probable hyperparameters.

    The posterior has several maxima. The search starts from disturbances of usual size and from very small ones, and
    from motions that obey Euler's equations in the stretch: from the approximate motion at its start and, where
    readings are within the stretch, from the motion that is most probable without them. The best result counts.

    Parameters
    ----------
    window : Window
        Readings around the stretch.
    before : Solution, optional
        That of a slightly different path, from which the only search starts.

    Returns
    -------
    Solution or None
        None where no search converges.
    """
    if before is not None:
        return _search(window, before.motion.states, before.log_sizes)
    starts = [
        (window.states, MEDIANS),
        (window.states, MEDIANS - _BELOW * WIDTHS),
        (propagated_states(window, window.states), MEDIANS),
    ]
    if window.observed[window.first : window.last].any():
        outside = window.observed.copy()
        outside[window.first : window.last] = False
        alone = most_probable_motion(replace(window, observed=outside))
        if alone is not None:
            starts.append((propagated_states(window, alone.motion.states), MEDIANS))
    solutions = [s for start in starts if (s := _search(window, *start)) is not None]
    return max(solutions, key=lambda s: s.log_posterior, default=None)


def _search(window: Window, states: Array, log_sizes: Array) -> Solution | None:
    """Motion and hyperparameters in turns, from a start: the most probable of converged motions, None without any."""
    best = None
    try:
        for _ in range(_MOST_SEARCHES):
            step = _gauss_newton(window, states, log_sizes)
            if step is None:
                break
            (states, converged), used = step, log_sizes
            motion = linearise_window(window, states)
            log_sizes = estimate_sizes(window, motion, used)
            if not converged:
                continue
            solution = Solution(motion, used, log_posterior(window, motion)(used))
            if best is None or solution.log_posterior >= best.log_posterior:
                best = solution
            if np.max(np.abs(log_sizes - used) / WIDTHS) < _SAME_SIZES:
                break
    except np.linalg.LinAlgError:  # a covariance is singular to working precision
        pass
    return best


def _gauss_newton(window: Window, states: Array, log_sizes: Array) -> tuple[Array, bool] | None:
    """States (T, 20) after some steps under given hyperparameters, and whether the prediction has converged."""
    factor, previous, part = 1.0, np.inf, slice(window.first, window.last)
    for iteration in range(_MOST_STEPS):
        motion = linearise_window(window, states)
        if not (np.isfinite(motion.residual[window.observed]).all() and np.isfinite(motion.transition).all()):
            return None
        mean, covariance, _ = smooth_errors(motion, covariances(window, motion, log_sizes), window.observed)
        change, design = mean + motion.offset, motion.design[part]
        sigma = np.sqrt(np.einsum("tij,tjk,tik->ti", design, covariance[part], design))
        ratio = np.abs(np.einsum("tij,tj->ti", design, change[part])) / sigma
        size = float(np.max(np.where(window.observed[part], _READ_SHARE, 1.0) * ratio))
        if not np.isfinite(size):
            return None
        if iteration > _HALVED_FROM and size > 0.5 * previous:
            factor = max(0.5 * factor, _LEAST_FACTOR)
        previous = size
        states = add_errors(states, factor * change)
        if size < _CONVERGED:
            return states, True
    return states, False


def predict_stretch(window: Window, before: Solution | None = None) -> tuple[list[Interpolation], Solution] | None:
    """Readings of the lost stretch by rotational dynamics.

    Parameters
    ----------
    window : Window
        Readings around it.
    before : Solution, optional
        As in `most_probable_motion`.

    Returns
    -------
    fills : list of six Interpolation
        Rates (rad/s) and specific force (m/s²) along the window's axes, with their noise; forces where they are read.
    solution : Solution
        None instead of both where no search for the most probable motion converges.
    """
    with np.errstate(invalid="ignore", over="ignore", divide="ignore"):  # a search that diverges is given up
        solution = most_probable_motion(window, before)
        if solution is None:
            return None
        try:
            return _validated(window, solution.motion, solution.log_sizes), solution
        except np.linalg.LinAlgError:
            return None


def _validated(window: Window, motion: LinearisedMotion, log_sizes: Array) -> list[Interpolation]:
    """Prediction of the stretch with its covariance scaled by cross-validation."""
    c, part = covariances(window, motion, log_sizes), (window.first, window.last)
    values, covariance = _prediction(window, motion, c, window.observed, *part)
    read = window.observed[slice(*part)]
    ratios = []
    for a, b in trial_stretches(window.complete, *part):
        without = window.observed.copy()
        without[a:b] = read
        trial, spread = _prediction(window, motion, c, without, a, b)
        ratios.append(np.sum(trial - window.readings[a:b], axis=0) ** 2 / spread.sum(axis=(1, 2)))
    # not less than one: the hyperparameters were estimated from the same readings
    scale = np.maximum(1.0, (_PRIOR_STRETCHES + np.sum(ratios, axis=0)) / (_PRIOR_STRETCHES + len(ratios)) * np.ones(6))
    scale = scale * _misfit(window, motion, c)
    covariance = covariance * scale[:, None, None]
    both = covariance.sum(axis=(1, 2))
    for side in (slice(0, window.first), slice(window.last, None)):
        alone = np.zeros_like(window.observed)
        alone[side] = window.observed[side]
        if not alone.any():
            continue
        alone[slice(*part)] = read
        from_side, spread = _prediction(window, motion, c, alone, *part)
        difference = (from_side - values).T
        expected = np.maximum(scale * spread.sum(axis=(1, 2)) - both, 0.0)
        beyond = difference.sum(axis=1) ** 2 > _SIDE_SIGMAS**2 * expected
        covariance = covariance + 0.5 * beyond[:, None, None] * difference[:, :, None] * difference[:, None, :]
    return [Interpolation(v, p, 0, float(np.sqrt(s))) for v, p, s in zip(values.T, covariance, scale, strict=True)]


def _misfit(window: Window, motion: LinearisedMotion, c: Covariances) -> float:
    """Mean square of the standardised residuals of the readings within the stretch, if above one; one without any."""
    inside = np.zeros_like(window.observed)
    inside[window.first : window.last] = window.observed[window.first : window.last]
    if not inside.any():
        return 1.0
    mean, _, _ = smooth_errors(motion, c, window.observed)
    residual = motion.residual - np.einsum("tij,tj->ti", motion.design, mean)
    return max(1.0, float(np.mean((residual**2 / c.row_variance)[inside])))


def _prediction(
    window: Window, motion: LinearisedMotion, c: Covariances, observed: BoolArray, first: int, last: int
) -> tuple[Array, Array]:
    """Readings (n, 6) of a stretch given the observed ones, and their covariances (6, n, n), noise included."""
    mean, covariance, gain = smooth_errors(motion, c, observed)
    part, steps = slice(first, last), range(last - first)
    design = motion.design[part]
    values = window.readings[part] - motion.residual[part] + np.einsum("tij,tj->ti", design, mean[part])
    spread = [
        smoothed_joint_covariance(covariance[part], gain[first : last - 1], steps, list(design[:, k : k + 1]))
        + np.diag(c.row_variance[part, k])
        for k in range(6)
    ]
    return values, np.array(spread)
