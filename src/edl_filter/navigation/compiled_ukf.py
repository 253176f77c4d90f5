"""Compiled error-state unscented Kalman filter and smoother: the arithmetic of `ukf` and `smoother` in numba.

`ErrorStateUKF` runs on filterpy and is the readable reference. `CompiledUKF` has the same interface, states and
results, to rounding (tests/navigation/test_compiled_ukf.py). One call computes a prediction: with the Cholesky factor
``U`` of ``α² (n + κ) P``, ``UᵀU``, whose rows are the offsets χ of the sigma points about the reference (Julier &
Uhlmann 2004, Proc. IEEE 92, 401; scaled as by van der Merwe 2004, chapter 3; Särkkä 2013, section 5.5)::

    x = Σ Wm f(χ)       P⁻ = Σ Wc (f(χ) - x)(f(χ) - x)ᵀ + Q       C = Σ Wc χ (f(χ) - x)ᵀ

f propagates full states through `strapdown.propagate` and expresses them as errors about the propagated centre; Q is
`noise.process_noise`, of which the covariance by rate noise is written with ``[p]ₓ[q]ₓᵀ = (p·q) 1 - q pᵀ``. A second
call updates, with S the covariance of the innovation y and D that of error and prediction::

    K = D S⁻¹           x = K y           P = P⁻ - K S Kᵀ

and a third one smooths a node: ``G = C (P⁻)⁻¹``, ``P_s = P + G (P_s⁺ - P⁻) Gᵀ`` (Särkkä 2008, IEEE Trans. Autom.
Control 53, 845). Sensor errors are constant over an interval: their covariance stays as it is, and their covariance
with position, velocity and attitudes is the same in P⁻ and C. Only what belongs to the latter states is computed. A
row of C that is that of P⁻ has a row of the unit matrix as its gain. After each step the reference moves by x and the
mean of the error is zero. Measurement models are Python and are evaluated at all sigma points at once, so that a new
constraint needs no compiled code.

A matrix that has no Cholesky factor raises `numpy.linalg.LinAlgError`, as scipy does for the reference.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from edl_filter.estimation.small_matrices import (
    matrix_product,
    regression_rows,
    solve_few,
    symmetric_part,
    upper_cholesky,
    weighted_mean,
    weighted_product,
    weighted_square,
)
from edl_filter.imu_model.compiled_corrections import sensor_correction_maps
from edl_filter.imu_model.sensor_errors import SENSOR_STATES
from edl_filter.navigation import strapdown
from edl_filter.navigation.compiled_noise import in_body_axes, noise_of_samples, onboard_rotation_jacobians
from edl_filter.navigation.compiled_states import (
    error_between,
    moved_state,
    moving_errors,
    states_of_points,
)
from edl_filter.navigation.constraints import Constraint
from edl_filter.navigation.estimator import Innovation, Transition, statistical_jacobian
from edl_filter.navigation.increments import Samples
from edl_filter.navigation.layout import ONBOARD, Layout, State
from edl_filter.navigation.noise import IDENTITY, sample_attitudes, variances_of_increments
from edl_filter.planet import Planet
from edl_filter.rotation_kernels import product, quaternion
from edl_filter.types import Array, IntArray

COMPILED = njit(cache=True, error_model="numpy", nogil=True)


def state_places(layout: Layout) -> IntArray:
    """First index in the vector of each sensor error, the on-board rate, mounting and attitude, ``(8,)``; -1: none."""
    names = (*SENSOR_STATES, "onboard_rate", "onboard_mounting", ONBOARD)
    return np.array([layout[name].start if name in layout else -1 for name in names])


class CompiledUKF:
    """UKF about a reference, compiled.

    Parameters
    ----------
    layout : Layout
        Of the filter's vector.
    state : State
        Reference at the start.
    covariance : (n, n) array
        Of the error about it, in the units of `layout.UNITS`.
    planet : Planet
        Gravity and rotation.
    alpha, beta, kappa : float
        Of the scaled unscented transform. An alpha below 0.1 costs digits.
    """

    def __init__(
        self,
        layout: Layout,
        state: State,
        covariance: Array,
        planet: Planet,
        alpha: float = 0.5,
        beta: float = 2.0,
        kappa: float = 0.0,
    ) -> None:
        self.layout, self.state, self.planet = layout, state, planet
        self.covariance = np.ascontiguousarray(covariance, np.float64).copy()
        self._places = state_places(layout)
        self._scale = alpha**2 * (layout.size + kappa)
        centre = 1.0 - layout.size / self._scale
        self._weights = np.array([centre, centre + 1.0 - alpha**2 + beta, 0.5 / self._scale])
        self.draw_sigma_points()

    @property
    def weights(self) -> Array:
        """Weights of the sigma points in covariances, ``(2n + 1,)``."""
        return np.concatenate((self._weights[1:2], np.full(2 * self.layout.size, self._weights[2])))

    def draw_sigma_points(self) -> None:
        """Draw the sigma points of the present covariance about the reference: ``(2n + 1, n)``."""
        points, valid = _sigma_points(self.covariance, self._scale)
        _check(valid)
        self.sigma_points = points

    def predict(self, samples: Samples) -> Transition:
        """Propagate estimate and covariance to the end of `samples`."""
        s, p = samples, self.planet
        nav, errors, covariance, cross, points, valid = _predict(
            self.state.nav, self.state.errors, self.covariance, self.sigma_points, self._places, self._scale,
            self._weights, s.interval, s.force, s.rate, s.force_noise, s.force_fill_sigma, s.rate_noise,
            s.rate_fill_sigma, s.shared_rate_noise, s.coning_corrected, s.onboard_rate, p.mu, p.j2, p.gravity_radius,
        )  # fmt: skip
        _check(valid)
        self.state, self.covariance, self.sigma_points = State(nav, errors), covariance, points
        return Transition(cross, self.state, covariance.copy())

    def innovation(self, constraint: Constraint) -> Innovation:
        """Predict a measurement at all sigma points and compare the mean with what was measured."""
        nav, errors = states_of_points(
            self.state.nav, self.state.errors, self.sigma_points, len(self.sigma_points), self._places[7]
        )
        predicted = np.ascontiguousarray(constraint.predict(nav, errors, self.layout))
        noise = constraint.noise
        residual, covariance, nis = _innovation(predicted, constraint.measured, noise, self._weights)
        return Innovation(residual, covariance, noise, nis, predicted)

    def jacobian(self, innovation: Innovation) -> Array:
        """Jacobian ``(m, n)`` of a measurement by statistical linearisation at the present sigma points."""
        return statistical_jacobian(innovation.linearization, self.sigma_points)

    def update(self, constraint: Constraint, innovation: Innovation) -> None:
        """Update with a measurement; `innovation` holds its predictions at the present sigma points."""
        i = innovation
        nav, errors, covariance, points, valid = _update(
            self.state.nav, self.state.errors, self.covariance, self.sigma_points, self._places[7], self._scale,
            self._weights, i.linearization, i.residual, i.predicted_covariance, i.noise_covariance,
        )  # fmt: skip
        _check(valid)
        self.state, self.covariance, self.sigma_points = State(nav, errors), covariance, points

    def transform(self, matrix: Array, noise: Array, errors: Array) -> Transition:
        """Replace the error linearly, as `ErrorStateFilter.transform`.

        Parameters
        ----------
        matrix, noise : (n, n) arrays
            Transition, and covariance of the added noise.
        errors : (n,) array
            New values of `State.errors`.

        Returns
        -------
        Transition
        """
        cross = self.covariance @ matrix.T
        self.covariance = matrix @ self.covariance @ matrix.T + noise
        self.state = State(self.state.nav, errors)
        self.draw_sigma_points()
        return Transition(cross, self.state, self.covariance.copy())


def smooth_node(
    node: tuple[State, Array],
    predicted: Transition,
    following: tuple[State, Array],
    onboard: int,
    covariance: Array,
    gain: Array,
) -> State:
    """Smooth one node of a filter pass, given the next one.

    Parameters
    ----------
    node : tuple of State and (n, n) array
        The filter's estimate at the node and its covariance, in the units of `layout.UNITS`.
    predicted : Transition
        From the node to the next one.
    following : tuple of State and (n, n) array
        The smoothed estimate at the next node and its covariance.
    onboard : int
        First index of the error of the on-board attitude; -1: none.
    covariance, gain : (n, n) arrays, overwritten
        Covariance of the smoothed estimate, and gain of the smoother.

    Returns
    -------
    State
        Smoothed.
    """
    (state, filtered), (later, smoothed) = node, following
    nav, errors, valid = _smooth(
        state.nav, state.errors, filtered, predicted.state.nav, predicted.state.errors, predicted.covariance,
        predicted.cross_covariance, later.nav, later.errors, smoothed, onboard, covariance, gain,
    )  # fmt: skip
    _check(valid)
    return State(nav, errors)


def _check(valid: bool) -> None:
    if not valid:
        raise np.linalg.LinAlgError("a covariance is not positive definite")


@COMPILED
def _sigma_points(covariance, scale):
    """Sigma points ``(2n + 1, n)`` about zero, and whether the covariance has a Cholesky factor."""
    n = len(covariance)
    root, valid = upper_cholesky(covariance, scale)
    points = np.zeros((2 * n + 1, n))
    for i in range(n):
        for j in range(i, n):
            points[1 + i, j] = root[i, j]
            points[1 + n + i, j] = -root[i, j]
    return points, valid


@COMPILED
def _propagated_states(
    nav, errors, points, places, interval, force, rate, coning_corrected, onboard_rate, middle, end, mu, j2, radius
):  # fmt: skip
    """Full states of the sigma points after the samples; as `propagation.propagate_states`."""
    blocks = (len(points) + strapdown.LANES - 1) // strapdown.LANES
    states, full = states_of_points(nav, errors, points, blocks * strapdown.LANES, places[7])
    if places[7] >= 0:
        by_rate, by_mounting = onboard_rotation_jacobians(interval, rate, coning_corrected, middle, end)
        net = sample_attitudes(interval, onboard_rate, IDENTITY)[1]
        for s in range(states.shape[1]):
            x, y, z = 0.0, 0.0, 0.0
            for place, jacobian in ((places[5], by_rate), (places[6], by_mounting)):
                if place >= 0:
                    for k in range(3):
                        x += jacobian[0, k] * full[place + k, s]
                        y += jacobian[1, k] * full[place + k, s]
                        z += jacobian[2, k] * full[place + k, s]
            turned = product(product(states[10:, s], net), quaternion(x, y, z))
            for k in range(4):
                states[10 + k, s] = turned[k]
    force_map, rate_map = sensor_correction_maps(full, places)
    strapdown.propagate(states[:10], force_map, rate_map, interval, force, rate, mu, j2, radius)
    return states


@COMPILED
def _cross_covariance(points, rows, weight):
    """Covariance ``(n, k)`` of the sigma points with `rows`; they are symmetric, and half of their numbers are zero."""
    n, columns = points.shape[1], rows.shape[1]
    out, difference = np.zeros((n, columns)), np.empty(columns)
    for s in range(1, n + 1):
        for j in range(columns):
            difference[j] = weight * (rows[s, j] - rows[s + n, j])
        for i in range(s - 1, n):
            factor = points[s, i]
            for j in range(columns):
                out[i, j] += factor * difference[j]
    return out


@COMPILED
def _predict(
    nav, errors, covariance, points, places, scale, weights, interval, force, rate, force_noise, force_fill_sigma,
    rate_noise, rate_fill_sigma, shared_rate_noise, coning_corrected, onboard_rate, mu, j2, radius,
):  # fmt: skip
    """One prediction: state, covariance, cross-covariance, sigma points, and whether the covariance is positive."""
    n, onboard = len(errors), places[7]
    middle, end = sample_attitudes(interval, rate, nav[6:10])
    states = _propagated_states(
        nav, errors, points, places, interval, force, rate, coning_corrected, onboard_rate, middle, end, mu, j2, radius
    )
    rows = moving_errors(states, len(points))
    mean = weighted_mean(rows, weights[0], weights[2])
    rows -= mean
    with_moving = _cross_covariance(points, rows, weights[2])
    of_moving = weighted_square(rows, weights[1], weights[2])
    velocity_variance, rotation_variance, unshared_variance = variances_of_increments(
        interval, force_noise, force_fill_sigma, rate_noise, rate_fill_sigma, shared_rate_noise
    )
    noise, unshared = noise_of_samples(interval, middle, force, velocity_variance, rotation_variance, unshared_variance)
    of_moving[:9, :9] += in_body_axes(noise, end)
    if onboard >= 0:
        common = in_body_axes(unshared, end)
        of_moving[9:, :9] += common[6:]
        of_moving[:9, 9:] += common[:, 6:]
        of_moving[9:, 9:] += common[6:, 6:]
    change, cross, out = np.zeros(n), covariance.copy(), covariance.copy()
    for k in range(len(mean)):
        place = k if k < 9 else onboard + k - 9
        change[place] = mean[k]
        for i in range(n):
            cross[i, place] = out[i, place] = out[place, i] = with_moving[i, k]
    for k in range(len(mean)):
        place = k if k < 9 else onboard + k - 9
        for i in range(len(mean)):
            out[place, i if i < 9 else onboard + i - 9] = 0.5 * (of_moving[k, i] + of_moving[i, k])
    new_points, positive = _sigma_points(out, scale)
    moved, moved_errors = moved_state(states[:, 0].copy(), errors, change, onboard)
    return moved, moved_errors, out, cross, new_points, positive


@COMPILED
def _innovation(predicted, measured, noise, weights):
    """Residual, covariance of the prediction and NIS from predictions ``(2n + 1, m)`` at the sigma points."""
    mean = weighted_mean(predicted, weights[0], weights[2])
    spread = predicted - mean
    covariance = weighted_product(spread, spread, weights[1], weights[2])
    residual = measured - mean
    weighted = solve_few(covariance + noise, residual.reshape(-1, 1))
    nis = 0.0
    for k in range(len(residual)):
        nis += residual[k] * weighted[k, 0]
    return residual, covariance, nis


@COMPILED
def _update(nav, errors, covariance, points, onboard, scale, weights, predicted, residual, predicted_covariance, noise):
    """One update, given the predictions at the sigma points: state, covariance, sigma points, and their validity."""
    total = predicted_covariance + noise
    spread = predicted - weighted_mean(predicted, weights[0], weights[2])
    with_prediction = weighted_product(spread, points, weights[1], weights[2])
    gain = solve_few(total.T.copy(), with_prediction)  # (m, n): transposed
    n, m = len(errors), len(residual)
    change, out = np.zeros(n), covariance.copy()
    for a in range(m):
        for i in range(n):
            change[i] += gain[a, i] * residual[a]
    for a in range(m):
        for i in range(n):
            factor = 0.0
            for b in range(m):
                factor += gain[b, i] * total[b, a]
            for j in range(n):
                out[i, j] -= factor * gain[a, j]
    out = symmetric_part(out)
    moved, moved_errors = moved_state(nav, errors, change, onboard)
    new_points, valid = _sigma_points(out, scale)
    return moved, moved_errors, out, new_points, valid


@COMPILED
def _smooth(
    nav, errors, covariance, predicted_nav, predicted_errors, predicted_covariance, cross_covariance, next_nav,
    next_errors, next_covariance, onboard, smoothed_covariance, gain,
):  # fmt: skip
    """One node: state, and whether the predicted covariance is positive definite; arguments as of `smooth_node`."""
    rows, moving, valid = regression_rows(cross_covariance, predicted_covariance)
    if not valid:
        return nav, errors, False
    gain[:] = 0.0
    for i in range(len(errors)):
        gain[i, i] = 1.0
    change = error_between(next_nav, next_errors, predicted_nav, predicted_errors, onboard)
    error = change.copy()
    for i in range(len(moving)):
        gain[moving[i]] = rows[i]
        error[moving[i]] = 0.0
        for j in range(len(change)):
            error[moving[i]] += rows[i, j] * change[j]
    added = _gained(rows, moving, next_covariance - predicted_covariance)
    smoothed_covariance[:] = symmetric_part(covariance + added)
    moved, moved_errors = moved_state(nav, errors, error, onboard)
    return moved, moved_errors, True


@COMPILED
def _gained(gain, moving, difference):
    """``G D Gᵀ`` with a smoother gain of which all rows but those of `moving` are of the unit matrix.

    Parameters
    ----------
    gain : (k, n) array
        Rows of G.
    moving : (k,) array of int
        Their indices.
    difference : (n, n) array
        D, symmetric to rounding.

    Returns
    -------
    (n, n) array
        Symmetric to rounding.
    """
    product = matrix_product(gain, difference)
    square = matrix_product(product, gain.T.copy())
    out = difference.copy()
    for i in range(len(moving)):
        for j in range(len(difference)):
            out[moving[i], j] = out[j, moving[i]] = product[i, j]
    for i in range(len(moving)):
        for j in range(len(moving)):
            out[moving[i], moving[j]] = square[i, j]
    return out
