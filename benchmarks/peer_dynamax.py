"""The problem of `peer_problem` through dynamax's unscented filter: jax on the CPU, float64, one jitted scan."""

from __future__ import annotations

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from dynamax.nonlinear_gaussian_ssm import ParamsNLGSSM, UKFHyperParams, unscented_kalman_filter
from peer_problem import ALPHA, BETA, FIX_SIGMA, KAPPA, SIGMAS, PeerProblem, transition

from edl_filter.types import Array

jax.config.update("jax_enable_x64", True)


def prepared(given: PeerProblem) -> Callable[[], tuple[Array, Array]]:
    """Function that filters, compiled for this number of epochs; its result as of `peer_problem.ours`."""
    params = ParamsNLGSSM(
        initial_mean=jnp.zeros(15),
        initial_covariance=jnp.diag(SIGMAS**2),
        dynamics_function=lambda x, u: transition(jnp, x, u),
        dynamics_covariance=jnp.asarray(given.process_noise),
        emission_function=lambda x, u: x[:3],
        emission_covariance=FIX_SIGMA**2 * jnp.eye(3),
    )
    hyperparameters = UKFHyperParams(alpha=ALPHA, beta=BETA, kappa=KAPPA)
    inputs, fields = jnp.asarray(given.inputs), ["filtered_means", "filtered_covariances"]

    @jax.jit
    def run(emissions):
        result = unscented_kalman_filter(params, emissions, hyperparameters, inputs, fields)
        return result.filtered_means, jnp.sqrt(jnp.diagonal(result.filtered_covariances, axis1=1, axis2=2))

    emissions = jnp.asarray(given.innovations)

    def filtered() -> tuple[Array, Array]:
        means, sigmas = run(emissions)
        return np.asarray(means), np.asarray(sigmas)

    return filtered
