"""Error-state unscented Kalman filter: filterpy's, with all sigma points propagated in one numba call.

The vector is the error about a propagated reference (`layout`). After every prediction and update the
reference takes the mean over and the vector is zero again, so filterpy's default unscented transform, with
plain means and differences, is valid for attitudes too.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter
from numpy.typing import NDArray
from scipy.linalg import cholesky

from edl_filter import rotations
from edl_filter.navigation import strapdown
from edl_filter.navigation.increments import Samples
from edl_filter.navigation.layout import Layout, State, attitude_errors, sensor_maps, sigma_states
from edl_filter.navigation.noise import net_turn, onboard_turn, process_noise
from edl_filter.planet import Planet

Array = NDArray[np.float64]


class MerwePoints(MerweScaledSigmaPoints):
    """filterpy's scaled sigma points, drawn without a Python loop."""

    def sigma_points(self, x: Array, P: Array) -> Array:
        """Sigma points ``(2n + 1, n)`` of mean `x` and covariance `P`."""
        scale = self.alpha**2 * (self.n + self.kappa)
        root = cholesky(scale * P, check_finite=False)  # upper: its rows are the offsets
        return np.concatenate((x[None], x + root, x - root))


@dataclass(frozen=True)
class Transition:
    """One step forwards, as the smoother needs it.

    Attributes
    ----------
    cross : (n, n) array
        Covariance of the error before the step with the error after it.
    state : State
        Predicted reference.
    covariance : (n, n) array
        Predicted covariance.
    """

    cross: Array
    state: State
    covariance: Array


@dataclass(frozen=True)
class Innovation:
    """What a measurement said against its prediction.

    Attributes
    ----------
    residual : (m,) array
        Measured minus predicted.
    predicted_covariance, noise_covariance : (m, m) arrays
        Of the prediction, and of the measurement.
    nis : float
        Normalised innovation squared, chi-square with m degrees of freedom.
    """

    residual: Array
    predicted_covariance: Array
    noise_covariance: Array
    nis: float


class ErrorStateUKF(UnscentedKalmanFilter):
    """UKF about a reference.

    Parameters
    ----------
    layout : Layout
    state : State
        Reference at the start.
    covariance : (n, n) array
    planet : Planet
    alpha, beta, kappa : float
        Of the scaled unscented transform. An alpha below 0.1 costs digits.
    """

    x: Array
    P: Array
    Wm: Array
    Wc: Array

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
        n = layout.size
        super().__init__(n, 1, 0.0, hx=None, fx=None, points=MerwePoints(n, alpha, beta, kappa))
        self.layout, self.state, self.planet = layout, state, planet
        self.P = covariance.copy()
        self.redraw()

    def redraw(self) -> None:
        """Draw the sigma points anew about the reference."""
        self.sigmas_f = self.points_fn.sigma_points(self.x, self.P)

    def _recentre(self) -> None:
        """Let the reference take the mean over."""
        self.state = self.state.plus(self.x)
        self.sigmas_f -= self.x
        self.x = np.zeros_like(self.x)
        self.P = 0.5 * (self.P + self.P.T)

    def compute_process_sigmas(self, dt: float, fx: object = None, **fx_args: Any) -> None:
        """Propagate all sigma points over `samples` in one call; the centre becomes the reference."""
        samples = fx_args["samples"]
        self.sigmas_start = self.points_fn.sigma_points(self.x, self.P)
        count = len(self.sigmas_start)
        nav, errors = sigma_states(self.state, self.sigmas_start, strapdown.padded(count))
        propagate_states(self.layout, self.planet, samples, nav, errors)
        centre = State(nav[:, 0].copy(), np.concatenate((np.zeros(9), errors[9:, 0])))
        sigmas = errors[:, :count].T - centre.errors
        sigmas[:, :6] = (nav[:6, :count] - centre.nav[:6, None]).T
        sigmas[:, 6:9] = attitude_errors(centre.nav[6:10], nav[6:10, :count])
        if len(nav) == 14:
            sigmas[:, -3:] = attitude_errors(centre.nav[10:], nav[10:, :count])
        self.sigmas_f, self.state = sigmas, centre
        self.sigmas_propagated = sigmas  # filterpy draws sigmas_f anew; these correlate with the start

    def advance(self, samples: Samples) -> Transition:
        """Predict to the end of `samples`."""
        self.Q = process_noise(self.layout, samples, self.state.nav[6:10])
        self.predict(0.0, samples=samples)
        start = self.sigmas_start - self.sigmas_start[0]
        cross = (start * self.Wc[:, None]).T @ (self.sigmas_propagated - self.x)
        self._recentre()
        return Transition(cross, self.state, self.P.copy())

    def states(self, sigmas: Array) -> tuple[Array, Array]:
        """Sigma points in full: navigation states ``(10, S)`` and other states ``(n, S)``."""
        return sigma_states(self.state, sigmas, len(sigmas))

    def innovate(self, measured: Array, noise: Array, predicted: Array) -> Innovation:
        """Innovation of a measurement, without using it.

        Parameters
        ----------
        measured : (m,) array
        noise : (m, m) array
        predicted : (2n + 1, m) array
            Of the sigma points `sigmas_f`.
        """
        mean = self.Wm @ predicted
        spread = predicted - mean
        covariance = (spread * self.Wc[:, None]).T @ spread
        residual = measured - mean
        nis = float(residual @ np.linalg.solve(covariance + noise, residual))
        return Innovation(residual, covariance, noise, nis)

    def absorb(self, measured: Array, noise: Array, predicted: Array) -> None:
        """Update with a measurement; arguments as in `innovate`."""
        rows = iter(predicted)
        self.update(measured, R=noise, hx=lambda _: next(rows))
        self._recentre()
        self.redraw()

    def cross_variance(self, x: Array, z: Array, sigmas_f: Array, sigmas_h: Array) -> Array:
        """filterpy's sum over sigma points as one matrix product."""
        return ((sigmas_f - x) * self.Wc[:, None]).T @ (sigmas_h - z)

    def replace(self, transition: Array, noise: Array, errors: Array) -> Transition:
        """Change states at once: error ← transition @ error + noise; other states become `errors`."""
        cross = self.P @ transition.T
        self.P = transition @ self.P @ transition.T + noise
        self.state = State(self.state.nav, errors)
        self.redraw()
        return Transition(cross, self.state, self.P.copy())


def propagate_states(layout: Layout, planet: Planet, samples: Samples, nav: Array, errors: Array) -> None:
    """Propagate full states over `samples`, in place; what was computed on board turns as the gyros read.

    Parameters
    ----------
    layout : Layout
    planet : Planet
    samples : Samples
    nav : (10 or 14, S) array, changed in place
        S a multiple of `strapdown.LANES`.
    errors : (n, S) array
    """
    if len(nav) == 14:
        net, turn = onboard_steps(layout, samples, errors)
        nav[10:] = rotations.multiply(rotations.multiply(nav[10:].T, net), turn).T
    force_map, rate_map = sensor_maps(layout, errors)
    strapdown.propagate(
        nav[:10],
        force_map,
        rate_map,
        samples.interval,
        samples.force,
        samples.rate,
        planet.mu,
        planet.j2,
        planet.gravity_radius,
    )


def onboard_steps(layout: Layout, samples: Samples, errors: Array) -> tuple[Array, Array]:
    """Turn of on-board attitudes: as the gyros read ``(4,)``, then less what they were computed with ``(S, 4)``."""
    names = [n for n in ("onboard_rate", "onboard_mounting") if n in layout]
    turn = np.zeros((3, errors.shape[1]))
    if names:
        effect = dict(zip(("onboard_rate", "onboard_mounting"), onboard_turn(samples), strict=True))
        turn = sum((effect[n] @ errors[layout[n]] for n in names), turn)
    return net_turn(samples), rotations.from_rotation_vector(turn.T)
