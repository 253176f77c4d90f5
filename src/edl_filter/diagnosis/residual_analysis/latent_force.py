"""Unmodelled force and moment against time: the smoothed Gauss–Markov process of `noise.unmodelled_acceleration`.

The process is part of the state vector. The fixed-interval smoother gives its value in every bin, given all earlier and
later residuals, with the nuisance parameters marginalised (`estimation.smoothing.smoothed_last_states`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from edl_filter.diagnosis.linear_model.linear_model import LinearizedModel
from edl_filter.diagnosis.noise.unmodelled_acceleration import UnmodelledAcceleration, amplitude
from edl_filter.diagnosis.prediction.dead_reckoning import NODES_PER_BIN
from edl_filter.estimation.kalman import whitening_filter
from edl_filter.estimation.smoothing import smoothed_last_states
from edl_filter.types import Array


@dataclass(frozen=True)
class LatentForce:
    """Unmodelled force and moment in body axes, and one sigma of them.

    Attributes
    ----------
    time : (B,) array
        Middles of the bins that are compared, s.
    force, force_sigma : (B, 3) arrays
        N.
    moment, moment_sigma : (B, 3) arrays
        About the centre of mass, N m.
    """

    time: Array
    force: Array
    force_sigma: Array
    moment: Array
    moment_sigma: Array


def estimate_latent_force(model: LinearizedModel, unmodelled: UnmodelledAcceleration) -> LatentForce | None:
    """Smoothed unmodelled force and moment with the most likely process; None where that is zero."""
    if unmodelled.is_zero:
        return None
    whiten = whitening_filter(model.state_space_with_unmodelled(unmodelled))
    mean, covariance = smoothed_last_states(whiten, model.white_residuals(whiten), model.initial_mean, 6)
    used, step = model.index.step_of_bins(whiten.model.row_start)
    scale = amplitude(model.residuals.flow, unmodelled)[NODES_PER_BIN // 2 :: NODES_PER_BIN][used, None]
    time = model.bins.middle[used]
    mass, inertia = np.empty((len(time), 1)), np.empty((len(time), 3, 3))
    for part, body in model.inputs.forward_model.bodies(time):
        mass[part], inertia[part] = body.mass, body.inertia
    to_force, to_moment = unmodelled.force * mass * scale, unmodelled.moment * scale
    moment_covariance = inertia @ covariance[step][:, 3:, 3:] @ inertia.transpose(0, 2, 1)
    return LatentForce(
        time=time,
        force=to_force * mean[step, :3],
        force_sigma=to_force * np.sqrt(np.einsum("bii->bi", covariance[step][:, :3, :3])),
        moment=to_moment * np.einsum("bij,bj->bi", inertia, mean[step, 3:]),
        moment_sigma=to_moment * np.sqrt(np.einsum("bii->bi", moment_covariance)),
    )
