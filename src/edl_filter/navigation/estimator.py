"""The interface that the filters share, and what they return.

A filter holds a reference `State` and the covariance of the error about it. After every step the reference is the
estimate, so that the mean of the error is zero. `ukf` and `ekf` implement the interface; the run through the epochs,
the smoother and the leave-one-out checks use nothing else of them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from edl_filter.estimation.small_matrices import back_substitution
from edl_filter.navigation.constraints import Constraint
from edl_filter.navigation.increments import Samples
from edl_filter.navigation.layout import Layout, State
from edl_filter.types import Array


@dataclass(frozen=True)
class Transition:
    """One step forwards, as the smoother needs it.

    Attributes
    ----------
    cross_covariance : (n, n) array
        Covariance of the error before the step with the error after it.
    state : State
        Predicted reference.
    covariance : (n, n) array
        Predicted covariance.
    """

    cross_covariance: Array
    state: State
    covariance: Array


@dataclass(frozen=True)
class Innovation:
    """A measurement against its prediction.

    Attributes
    ----------
    residual : (m,) array
        Measured minus predicted.
    predicted_covariance, noise_covariance : (m, m) arrays
        Of the prediction, and of the measurement.
    nis : float
        Normalised innovation squared, chi-square with m degrees of freedom.
    linearization : array
        What the update of the filter that made this needs of the measurement model: the predictions at the sigma points
        (2n + 1, m), or the Jacobian (m, n).
    """

    residual: Array
    predicted_covariance: Array
    noise_covariance: Array
    nis: float
    linearization: Array

    @classmethod
    def of(cls, residual: Array, predicted_covariance: Array, noise: Array, linearization: Array) -> Innovation:
        """Innovation with its normalised square, from a residual ``(m,)``; all arguments are as the attributes."""
        nis = float(residual @ np.linalg.solve(predicted_covariance + noise, residual))
        return cls(residual, predicted_covariance, noise, nis, linearization)


class ErrorStateFilter(Protocol):
    """A Kalman filter of the error about a reference state."""

    layout: Layout

    @property
    def state(self) -> State:
        """Reference: the estimate."""

    @property
    def covariance(self) -> Array:
        """Covariance of the error about the reference, ``(n, n)``, in the units of `layout.UNITS`."""

    def predict(self, samples: Samples) -> Transition:
        """Propagate estimate and covariance to the end of `samples`."""

    def innovation(self, constraint: Constraint) -> Innovation:
        """Predict a measurement and compare it with what was measured; the estimate stays as it is."""

    def jacobian(self, innovation: Innovation) -> Array:
        """Jacobian ``(m, n)`` of the measurement of an `innovation` of the present estimate."""

    def update(self, constraint: Constraint, innovation: Innovation) -> None:
        """Update estimate and covariance with a measurement, given its `innovation` of the present estimate."""

    def transform(self, matrix: Array, noise: Array, errors: Array) -> Transition:
        """Replace the error linearly, ``error ← matrix @ error + noise``, at one time.

        Parameters
        ----------
        matrix, noise : (n, n) arrays
            Transition, and covariance of the noise that is added.
        errors : (n,) array
            New values of `State.errors`.

        Returns
        -------
        Transition
        """


def statistical_jacobian(predictions: Array, points: Array) -> Array:
    """Jacobian of a measurement by the regression of its predictions on the sigma points (statistical linearisation).

    Särkkä 2013, section 5.2. The covariance of state and prediction is ``Uᵀ D / scale``, with U the factor of
    ``scale * P`` and D half the difference of the predictions at the points of each pair; with ``P = UᵀU / scale`` the
    Jacobian is ``(U⁻¹ D)ᵀ``.

    Parameters
    ----------
    predictions : (2n + 1, m) array
        At the sigma points.
    points : (2n + 1, n) array
        Zero, the rows of the upper Cholesky factor U, and their negatives.

    Returns
    -------
    (m, n) array
    """
    n = points.shape[1]
    half_difference = 0.5 * (predictions[1 : n + 1] - predictions[n + 1 :])
    return np.asarray(back_substitution(points[1 : n + 1], half_difference), np.float64).T
