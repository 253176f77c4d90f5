"""Process noise and on-board attitude over many intervals of samples in one compiled call.

The functions of `noise` and `propagation` take one interval. A flight that is linearised from bin to bin has thousands
of short intervals, in which the arrangement of one interval costs a hundred times its arithmetic.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from edl_filter import rotations
from edl_filter.navigation.compiled_noise import COMPILED, in_body_axes, noise_of_samples, onboard_rotation_jacobians
from edl_filter.navigation.increments import Samples
from edl_filter.navigation.layout import ONBOARD, Layout
from edl_filter.navigation.noise import IDENTITY, increment_variances, sample_attitudes
from edl_filter.types import Array, IntArray


def process_noise_of_intervals(
    layout: Layout, samples: Samples, attitudes: Array, begins: IntArray, ends: IntArray
) -> Array:
    """`noise.process_noise` of K intervals.

    Parameters
    ----------
    layout : Layout
        Of the filter's vector.
    samples : Samples
        Of the driving instrument, all intervals.
    attitudes : (K, 4) array
        inertial_from_body at the intervals' beginnings.
    begins, ends : (K,) arrays of int
        First sample of each interval, and the one after its last.

    Returns
    -------
    (K, n, n) array
        Covariances, in the units of `layout.UNITS`.
    """
    covariance, common = _covariances(
        begins, ends, attitudes, samples.interval, samples.rate, samples.force, *increment_variances(samples)
    )
    noise = np.zeros((len(begins), layout.size, layout.size))
    noise[:, :9, :9] = covariance
    if ONBOARD in layout:
        block = layout[ONBOARD]
        noise[:, block, :9], noise[:, :9, block] = common[:, 6:], common[:, :, 6:]
        noise[:, block, block] = common[:, 6:, 6:]
    return noise


@dataclass(frozen=True)
class OnboardRotations:
    """Rotations of an attitude that was computed on board over K intervals, as `propagation.onboard_jacobians`.

    Attributes
    ----------
    net : (K, 4) array
        Rotation as it is computed on board.
    jacobians : dict of str to (K, 3, 3) array
        State of the layout → rotation vector (rad) that follows the net rotation per unit of the state (rad/s, rad).
    """

    net: Array
    jacobians: dict[str, Array]

    @classmethod
    def over(cls, layout: Layout, samples: Samples, begins: IntArray, ends: IntArray) -> OnboardRotations:
        """Rotations over the intervals from sample `begins` to `ends` ``(K,)``."""
        net, by_rate, by_mounting = _onboard_rotations(
            begins, ends, samples.interval, samples.rate, samples.onboard_rate, samples.coning_corrected
        )
        by_name = {"onboard_rate": by_rate, "onboard_mounting": by_mounting}
        return cls(net, {name: jacobian for name, jacobian in by_name.items() if name in layout})

    def corrections(self, layout: Layout, errors: Array) -> Array:
        """Rotations ``(K, S, 4)`` that follow the net ones, under sensor errors ``(n, S)`` in the filter's vector."""
        rotation = np.zeros((len(self.net), 3, errors.shape[1]))
        for name, jacobian in self.jacobians.items():
            rotation += jacobian @ errors[layout[name]]
        return rotations.from_rotation_vector(np.swapaxes(rotation, 1, 2))


@COMPILED
def _covariances(
    begins, ends, attitudes, interval, rate, force, velocity_variance, rotation_variance, unshared_variance
):
    """Covariances ``(K, 9, 9)`` by all noise, and by that which an on-board attitude does not share."""
    covariance = np.empty((begins.size, 9, 9))
    common = np.empty((begins.size, 9, 9))
    for k in range(begins.size):
        a, b = begins[k], ends[k]
        middle, end = sample_attitudes(interval[a:b], rate[a:b], attitudes[k])
        every, unshared = noise_of_samples(
            interval[a:b], middle, force[a:b], velocity_variance[a:b], rotation_variance[a:b], unshared_variance[a:b]
        )
        covariance[k] = in_body_axes(every, end)
        common[k] = in_body_axes(unshared, end)
    return covariance, common


@COMPILED
def _onboard_rotations(begins, ends, interval, rate, onboard_rate, coning_corrected):
    """Net rotations ``(K, 4)``, and their derivatives ``(K, 3, 3)`` by rate and by mounting."""
    net = np.empty((begins.size, 4))
    by_rate, by_mounting = np.empty((begins.size, 3, 3)), np.empty((begins.size, 3, 3))
    for k in range(begins.size):
        a, b = begins[k], ends[k]
        middle, end = sample_attitudes(interval[a:b], rate[a:b], IDENTITY)
        net[k] = sample_attitudes(interval[a:b], onboard_rate[a:b], IDENTITY)[1]
        by_rate[k], by_mounting[k] = onboard_rotation_jacobians(
            interval[a:b], rate[a:b], coning_corrected[a:b], middle, end
        )
    return net, by_rate, by_mounting
