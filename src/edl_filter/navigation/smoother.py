"""Rauch-Tung-Striebel smoothing of a filter pass, on the stored cross-covariances.

filterpy's smoother cannot take inputs that differ from epoch to epoch and ignores the noise of each epoch. The
filter has propagated everything already, so nothing needs to be propagated again. With C the covariance of a
node's error with the next node's predicted error and P⁻ the latter's covariance, ``G = C (P⁻)⁻¹``,
``x_s = x + G (x_s⁺ ⊖ x⁻)``, ``P_s = P + G (P_s⁺ - P⁻) Gᵀ`` (Särkkä 2008, IEEE Trans. Autom. Control 53, 845); the
arithmetic is in `estimation.smoothing`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from edl_filter.estimation.smoothing import smoothed_moments, smoother_gain
from edl_filter.navigation.filter import FilterPass
from edl_filter.navigation.layout import State
from edl_filter.types import Array, IntArray


@dataclass(frozen=True)
class Smoothed:
    """State and covariance at every node, given the whole flight.

    Attributes
    ----------
    time : (K,) array
        s.
    unit : (K,) integer array
        Instrument that drives from the node on.
    states : list of State
    covariance : (K, n, n) array
        In the units of `layout.UNITS`.
    """

    time: Array
    unit: IntArray
    states: list[State]
    covariance: Array


def smooth(filter_pass: FilterPass, first: int = 0) -> Smoothed:
    """Smooth a filter pass.

    Parameters
    ----------
    filter_pass : FilterPass
        With its transitions.
    first : int
        Node at which to stop; the result begins there.

    Returns
    -------
    Smoothed
    """
    nodes = filter_pass.nodes[first:]
    states = [nodes[-1].state]
    covariances = [nodes[-1].covariance]
    for node, following in zip(reversed(nodes[:-1]), reversed(nodes[1:]), strict=True):
        transition = following.transition
        assert transition is not None
        gain = smoother_gain(transition.cross_covariance, transition.covariance)
        change = states[-1].minus(transition.state)
        error, covariance = smoothed_moments(
            np.zeros_like(change), node.covariance, gain, change, covariances[-1] - transition.covariance
        )
        states.append(node.state.plus(error))
        covariances.append(covariance)
    return Smoothed(
        time=np.array([n.time for n in nodes]),
        unit=np.array([n.unit for n in nodes]),
        states=states[::-1],
        covariance=np.array(covariances[::-1]),
    )
