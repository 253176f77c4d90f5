"""Propagation of full states over samples: the strapdown kernel, and the attitude that was computed on board."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from edl_filter import rotations
from edl_filter.navigation import strapdown
from edl_filter.navigation.compiled_noise import COMPILED, onboard_rotation_jacobians
from edl_filter.navigation.increments import Samples
from edl_filter.navigation.layout import Layout, sensor_maps
from edl_filter.navigation.noise import IDENTITY, sample_attitudes
from edl_filter.planet import Planet
from edl_filter.types import Array, IntArray


def propagate_states(layout: Layout, planet: Planet, samples: Samples, nav: Array, errors: Array) -> None:
    """Propagate full states over `samples`, in place; an attitude computed on board turns as the gyros read.

    Parameters
    ----------
    layout : Layout
        Of the filter's vector.
    planet : Planet
        Gravity and rotation.
    samples : Samples
        Of the driving instrument.
    nav : (10 or 14, S) array, changed in place
        As `State.nav`, one state per column; S a multiple of `strapdown.LANES`.
    errors : (n, S) array
        As `State.errors`.
    """
    if len(nav) == 14:
        onboard = OnboardRotations.over_all(layout, samples)
        turned = rotations.multiply(nav[10:].T, onboard.net[0])
        nav[10:] = rotations.multiply(turned, onboard.corrections(layout, errors)[0]).T
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


@dataclass(frozen=True)
class OnboardRotations:
    """Rotations of an attitude that was computed on board over K intervals of samples.

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

    @classmethod
    def over_all(cls, layout: Layout, samples: Samples) -> OnboardRotations:
        """Rotation over all `samples`: K = 1."""
        return cls.over(layout, samples, np.array([0]), np.array([len(samples.time)]))

    def correction_vectors(self, layout: Layout, errors: Array) -> Array:
        """Rotation vectors ``(K, S, 3)`` of `corrections`, rad."""
        rotation = np.zeros((len(self.net), 3, errors.shape[1]))
        for name, jacobian in self.jacobians.items():
            rotation += jacobian @ errors[layout[name]]
        return np.swapaxes(rotation, 1, 2)

    def corrections(self, layout: Layout, errors: Array) -> Array:
        """Rotations ``(K, S, 4)`` that follow the net ones, under sensor errors ``(n, S)`` in the filter's vector."""
        return rotations.from_rotation_vector(self.correction_vectors(layout, errors))


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
