"""Information gain of measurements: by how much they reduce the entropy of the flight's states, in nats.

For Gaussian errors the mutual information of a measurement with covariance R and the states, from which it is
predicted with covariance ``C = H P Hᵀ``, is

    I = ½ ln( det(C + R) / det R )

(Cover & Thomas 2006, theorem 8.4.1 and section 8.5). It equals half the reduction of the logarithm of the determinant
of the states' covariance. Two gains are computed:

- **in order**: C of the filter's own prediction, from all that was measured before. By the chain rule (theorem 2.5.2)
  these gains sum to the information of all measurements together, and a measurement gains more the earlier it comes;
- **beyond all others**: C predicted by the smoother from all other measurements, earlier and later. This is the
  conditional mutual information; it is what the estimate would lose without the measurement.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.linalg import block_diag, cholesky, solve_triangular

from edl_filter.estimation.smoothing import smoothed_joint_covariance
from edl_filter.navigation.ekf import linearized_measurement
from edl_filter.navigation.filter import FilterPass, Fused
from edl_filter.navigation.smoother import Smoothed
from edl_filter.types import Array


def mutual_information(prediction: Array, noise: Array) -> float:
    """Mutual information ``½ ln(det(C + R) / det R)`` of a measurement and the states, nats.

    Parameters
    ----------
    prediction : (m, m) array
        C, covariance of the prediction, in the squared units of the measurement.
    noise : (m, m) array
        R, covariance of the measurement. Positive definite.

    Returns
    -------
    float
        Zero or more; negative eigenvalues of C, which rounding leaves, count as zero.
    """
    root = cholesky(noise, lower=True)
    whitened = solve_triangular(root, solve_triangular(root, prediction, lower=True).T, lower=True)
    ratios = np.linalg.eigvalsh(0.5 * (whitened + whitened.T))
    return float(0.5 * np.sum(np.log1p(np.maximum(ratios, 0.0))))


def information_in_order(uses: Sequence[Fused]) -> Array:
    """Information that each use of a constraint added to all measurements before it, ``(K,)``, nats.

    Parameters
    ----------
    uses : sequence of Fused
        K uses; one that failed the gate gains nothing.

    Returns
    -------
    (K,) array
    """
    return np.array(
        [
            mutual_information(use.innovation.predicted_covariance, use.noise_covariance) if use.accepted else 0.0
            for use in uses
        ]
    )


def added_information(uses: Sequence[Fused], without: FilterPass, smoothed: Smoothed) -> float:
    """Information that all uses of a constraint together add to all other measurements, nats.

    Parameters
    ----------
    uses : sequence of Fused
        Of one constraint, in the order of time; those that failed the gate gain nothing.
    without : FilterPass
        Filter pass without this constraint.
    smoothed : Smoothed
        That pass, smoothed; its first node is that of the first use, its last one that of the pass.

    Returns
    -------
    float
    """
    accepted = [use for use in uses if use.accepted]
    if not accepted:
        return 0.0
    noise = block_diag(*(use.noise_covariance for use in accepted))
    return mutual_information(joint_prediction_covariance(accepted, without, smoothed), noise)


def joint_prediction_covariance(uses: Sequence[Fused], without: FilterPass, smoothed: Smoothed) -> Array:
    """Covariance of the predictions of several uses, correlated in time, from all other measurements.

    Parameters
    ----------
    uses : sequence of Fused
        In the order of time.
    without, smoothed
        As in `added_information`.

    Returns
    -------
    (M, M) array
        M components of all uses in their order, in the squared units of the components.
    """
    first = len(without.nodes) - len(smoothed.states)
    steps = [use.node - first for use in uses]
    jacobians = [
        linearized_measurement(use.constraint, smoothed.states[k], without.layout)[1]
        for use, k in zip(uses, steps, strict=True)
    ]
    return smoothed_joint_covariance(smoothed.covariance, smoothed.gain, steps, jacobians)
