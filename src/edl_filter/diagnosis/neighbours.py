"""Transitions of the filter's vector over many stretches of a path at once.

A stretch begins at a known state; its neighbours, one component of the vector moved by a step, begin beside it. All are
propagated as the filter propagates its sigma points, and their central differences are the transition. What does not
hang on the state (the sensor errors undone, the turn of what was computed on board) is taken once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from edl_filter import rotations
from edl_filter.navigation import strapdown
from edl_filter.navigation.filter import Problem
from edl_filter.navigation.layout import State, sensor_maps, sigma_states
from edl_filter.navigation.ukf import onboard_steps

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@dataclass(frozen=True)
class Neighbours:
    """Sensor errors of a path under one instrument, and of its neighbours.

    Attributes
    ----------
    problem : Problem
    steps : (n,) array
        By how much each component of the vector is moved.
    offsets : (2n + 1, n) array
        None, each component moved up, each moved down.
    errors : (n, S) array
        Padded as `strapdown.propagate` wants it.
    force_map, rate_map : arrays
        What undoes them.
    """

    problem: Problem
    steps: Array
    offsets: Array
    errors: Array
    force_map: Array
    rate_map: Array

    @classmethod
    def of(cls, problem: Problem, state: State, steps: Array) -> Neighbours:
        """Neighbours of paths with a state's errors."""
        offsets = np.concatenate((np.zeros((1, len(steps))), np.diag(steps), -np.diag(steps)))
        errors = sigma_states(state, offsets, strapdown.padded(len(offsets)))[1]
        return cls(problem, steps, offsets, errors, *sensor_maps(problem.layout, errors))

    def onboard(self, begin: int, end: int) -> tuple[Array, Array]:
        """What turns the on-board attitude over samples: net turn ``(4,)``, and turns ``(2n + 1, 4)`` after it."""
        part = self.problem.samples.part(begin, end)
        return onboard_steps(self.problem.layout, part, self.errors[:, : len(self.offsets)])

    def transitions(self, nav: Array, begins: Index, ends: Index, onboard: Sequence[tuple[Array, Array]]) -> Array:
        """Transitions ``(K, n, n)`` over stretches of samples.

        Parameters
        ----------
        nav : (K, 10) or (K, 14) array
            Where they begin.
        begins, ends : (K,) arrays of int
        onboard : sequence of K
            Of `onboard`; empty where nothing was computed on board.
        """
        count, p, samples = len(self.offsets), self.problem.planet, self.problem.samples
        whole = np.repeat(nav[:, :10, None], self.errors.shape[1], axis=2)
        whole[:, :6, :count] += self.offsets.T[:6]
        whole[:, 6:, :count] = np.swapaxes(_beside(nav[:, 6:10], self.offsets[:, 6:9]), 1, 2)
        for k, (begin, end) in enumerate(zip(begins, ends, strict=True)):
            part = slice(begin, end)
            strapdown.propagate(
                whole[k], self.force_map, self.rate_map, samples.interval[part], samples.force[part],
                samples.rate[part], p.mu, p.j2, p.gravity_radius,
            )  # fmt: skip
        moved = np.repeat((self.errors[:, :count] - self.errors[:, :1]).T[None], len(nav), axis=0)
        moved[..., :6] = np.swapaxes(whole[:, :6, :count] - whole[:, :6, :1], 1, 2)
        moved[..., 6:9] = _apart(np.swapaxes(whole[:, 6:, :count], 1, 2))
        if onboard:
            net, turn = (np.array(values) for values in zip(*onboard, strict=True))
            beside = _beside(nav[:, 10:], self.offsets[:, -3:])
            moved[..., -3:] = _apart(rotations.multiply(rotations.multiply(beside, net[:, None]), turn))
        n = len(self.steps)
        return np.swapaxes((moved[:, 1 : n + 1] - moved[:, n + 1 :]) / (2.0 * self.steps[:, None]), 1, 2)


def _beside(attitude: Array, phi: Array) -> Array:
    """Each attitude ``(K, 4)`` turned by each rotation vector ``(S, 3)``."""
    return rotations.normalise(rotations.multiply(attitude[:, None], rotations.from_rotation_vector(phi)))


def _apart(attitude: Array) -> Array:
    """Rotation vectors ``(K, S, 3)`` from the first of S attitudes to each."""
    return rotations.to_rotation_vector(rotations.multiply(rotations.conjugate(attitude[:, :1]), attitude))
