"""Error-state unscented Kalman filter: filterpy's, with all sigma points propagated in one numba call.

The vector is the error about a propagated reference (`layout`). After every prediction and update the
reference moves to the mean and the vector is zero again, so filterpy's default unscented transform, with
plain means and differences, is valid for attitudes too.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter
from scipy.linalg import cholesky

from edl_filter.navigation import strapdown
from edl_filter.navigation.constraints import Constraint
from edl_filter.navigation.estimator import Innovation, Transition, statistical_jacobian
from edl_filter.navigation.increments import Samples
from edl_filter.navigation.layout import Layout, State, attitude_errors, sigma_states
from edl_filter.navigation.noise import process_noise
from edl_filter.navigation.propagation import propagate_states
from edl_filter.planet import Planet
from edl_filter.types import Array


class MerwePoints(MerweScaledSigmaPoints):
    """filterpy's scaled sigma points, drawn without a Python loop."""

    def sigma_points(self, x: Array, P: Array) -> Array:
        """Sigma points ``(2n + 1, n)`` of mean `x` (n,) and covariance `P` (n, n)."""
        scale = self.alpha**2 * (self.n + self.kappa)
        root = cholesky(scale * P, check_finite=False)  # upper: its rows are the offsets
        return np.concatenate((x[None], x + root, x - root))


class _Engine(UnscentedKalmanFilter):
    """filterpy's filter, with sigma points that are propagated outside and sums as matrix products."""

    x: Array
    P: Array
    Wm: Array
    Wc: Array

    def __init__(self, points: MerwePoints) -> None:
        super().__init__(points.n, 1, 0.0, hx=None, fx=None, points=points)

    def compute_process_sigmas(self, dt: float, fx: object = None, **fx_args: Any) -> None:
        """Take over the sigma points that were propagated already."""
        self.sigmas_f = fx_args["propagated"]

    def cross_variance(self, x: Array, z: Array, sigmas_f: Array, sigmas_h: Array) -> Array:
        """filterpy's sum over sigma points as one matrix product."""
        return ((sigmas_f - x) * self.Wc[:, None]).T @ (sigmas_h - z)


class ErrorStateUKF:
    """UKF about a reference.

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
        self._engine = _Engine(MerwePoints(layout.size, alpha, beta, kappa))
        self._engine.P = covariance.copy()
        self.draw_sigma_points()

    @property
    def covariance(self) -> Array:
        """Covariance of the error about the reference, ``(n, n)``."""
        return self._engine.P

    @property
    def sigma_points(self) -> Array:
        """Sigma points of the error, ``(2n + 1, n)``."""
        return self._engine.sigmas_f

    @property
    def weights(self) -> Array:
        """Weights of the sigma points in covariances, ``(2n + 1,)``."""
        return self._engine.Wc

    def draw_sigma_points(self) -> None:
        """Draw the sigma points of the present covariance about the reference."""
        self._engine.sigmas_f = self._engine.points_fn.sigma_points(self._engine.x, self._engine.P)

    def predict(self, samples: Samples) -> Transition:
        """Propagate estimate and covariance to the end of `samples`."""
        engine = self._engine
        points = engine.points_fn.sigma_points(engine.x, engine.P)
        engine.Q = process_noise(self.layout, samples, self.state.nav[6:10])
        self.state, propagated = self._propagated(points, samples)
        engine.predict(0.0, propagated=propagated)
        # filterpy draws its points again after the prediction; the propagated ones correlate with those before it
        cross = ((points - points[0]) * engine.Wc[:, None]).T @ (propagated - engine.x)
        self._move_reference()
        return Transition(cross, self.state, engine.P.copy())

    def innovation(self, constraint: Constraint) -> Innovation:
        """Predict a measurement at all sigma points and compare the mean with what was measured."""
        nav, errors = sigma_states(self.state, self.sigma_points, len(self.sigma_points))
        predicted = constraint.predict(nav, errors, self.layout)
        mean = self._engine.Wm @ predicted
        spread = predicted - mean
        covariance = (spread * self._engine.Wc[:, None]).T @ spread
        return Innovation.of(constraint.measured - mean, covariance, constraint.noise, predicted)

    def jacobian(self, innovation: Innovation) -> Array:
        """Jacobian ``(m, n)`` of a measurement by statistical linearisation at the present sigma points."""
        return statistical_jacobian(innovation.linearization, self.sigma_points)

    def update(self, constraint: Constraint, innovation: Innovation) -> None:
        """Update with a measurement; `innovation` holds its predictions at the present sigma points."""
        predictions = iter(innovation.linearization)
        self._engine.update(constraint.measured, R=innovation.noise_covariance, hx=lambda _: next(predictions))
        self._move_reference()
        self.draw_sigma_points()

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
        engine = self._engine
        cross = engine.P @ matrix.T
        engine.P = matrix @ engine.P @ matrix.T + noise
        self.state = State(self.state.nav, errors)
        self.draw_sigma_points()
        return Transition(cross, self.state, engine.P.copy())

    def _propagated(self, points: Array, samples: Samples) -> tuple[State, Array]:
        """Reference and sigma points ``(2n + 1, n)`` after `samples`: the centre is the new reference."""
        count = len(points)
        nav, errors = sigma_states(self.state, points, strapdown.padded(count))
        propagate_states(self.layout, self.planet, samples, nav, errors)
        centre = State(nav[:, 0].copy(), np.concatenate((np.zeros(9), errors[9:, 0])))
        propagated = errors[:, :count].T - centre.errors
        propagated[:, :6] = (nav[:6, :count] - centre.nav[:6, None]).T
        propagated[:, 6:9] = attitude_errors(centre.nav[6:10], nav[6:10, :count])
        if len(nav) == 14:
            propagated[:, -3:] = attitude_errors(centre.nav[10:], nav[10:, :count])
        return centre, propagated

    def _move_reference(self) -> None:
        """Move the reference to the mean."""
        engine = self._engine
        self.state = self.state.plus(engine.x)
        engine.sigmas_f -= engine.x
        engine.x = np.zeros_like(engine.x)
        engine.P = 0.5 * (engine.P + engine.P.T)
