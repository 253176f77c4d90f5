"""The way backwards: Rauch-Tung-Striebel on the stored cross-covariances.

filterpy's smoother cannot take per-epoch inputs and ignores per-epoch noise; and here the sigma points were
propagated already on the way forwards, so nothing needs to be propagated again. With C the covariance of a
node's error with the next node's predicted error and P⁻ the latter's covariance, ``G = C (P⁻)⁻¹``,
``x_s = x + G (x_s⁺ ⊖ x⁻)``, ``P_s = P + G (P_s⁺ - P⁻) Gᵀ`` (Särkkä 2008, IEEE Trans. Autom. Control 53, 845).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from edl_filter.navigation.filter import Forward
from edl_filter.navigation.layout import State

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Smoothed:
    """State and covariance at every node, given the whole flight.

    Attributes
    ----------
    time : (K,) array
    unit : (K,) integer array
    states : list of State
    covariance : (K, n, n) array
    """

    time: Array
    unit: NDArray[np.int64]
    states: list[State]
    covariance: Array


def smooth(forward: Forward, first: int = 0) -> Smoothed:
    """Smooth the way forwards.

    Parameters
    ----------
    forward : Forward
    first : int
        Node at which to stop on the way backwards; the result begins there.

    Returns
    -------
    Smoothed
    """
    nodes = forward.nodes[first:]
    states = [nodes[-1].state]
    covariances = [nodes[-1].covariance]
    for node, following in zip(reversed(nodes[:-1]), reversed(nodes[1:]), strict=True):
        arrival = following.arrival
        assert arrival is not None
        gain = cho_solve(cho_factor(arrival.covariance, check_finite=False), arrival.cross.T).T
        states.append(node.state.plus(gain @ states[-1].minus(arrival.state)))
        spread = node.covariance + gain @ (covariances[-1] - arrival.covariance) @ gain.T
        covariances.append(0.5 * (spread + spread.T))
    return Smoothed(
        time=np.array([n.time for n in nodes]),
        unit=np.array([n.unit for n in nodes]),
        states=states[::-1],
        covariance=np.array(covariances[::-1]),
    )
