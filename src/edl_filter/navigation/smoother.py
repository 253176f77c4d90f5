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
from edl_filter.navigation.compiled_ukf import smooth_node
from edl_filter.navigation.filter import FilterPass, Node
from edl_filter.navigation.layout import ONBOARD, Layout, State
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
    gain : (K - 1, n, n) array
        Of the smoother, from each node to the next one.
    """

    time: Array
    unit: IntArray
    states: list[State]
    covariance: Array
    gain: Array


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
    if filter_pass.references is not None:
        states, covariance, gain = _smooth(nodes, filter_pass.references[first:])
    elif filter_pass.engine == "compiled" and len(nodes) > 1:
        states, covariance, gain = _smooth_compiled(filter_pass.layout, nodes)
    else:
        states, covariance, gain = _smooth(nodes, [n.state for n in nodes])
    return Smoothed(
        time=np.array([n.time for n in nodes]),
        unit=np.array([n.unit for n in nodes]),
        states=states,
        covariance=covariance,
        gain=gain,
    )


def _smooth(nodes: list[Node], references: list[State]) -> tuple[list[State], Array, Array]:
    """States, covariances and gains, from the last node backwards.

    Means are errors about the node's reference. Where this is the filter's own estimate, the next node's predicted
    state takes its place in the difference of the two means there.
    """
    states, covariances, gains = [nodes[-1].state], [nodes[-1].covariance], []
    for k in reversed(range(len(nodes) - 1)):
        node, transition = nodes[k], nodes[k + 1].transition
        assert transition is not None
        origin = transition.state if references[k + 1] is nodes[k + 1].state else references[k + 1]
        gain = smoother_gain(transition.cross_covariance, transition.covariance)
        error, covariance = smoothed_moments(
            node.state.minus(references[k]), node.covariance, gain,
            states[-1].minus(origin) - transition.state.minus(origin), covariances[-1] - transition.covariance,
        )  # fmt: skip
        states.append(references[k].plus(error))
        covariances.append(covariance)
        gains.append(gain)
    size = len(nodes[-1].covariance)
    return states[::-1], np.array(covariances[::-1]), np.array(gains[::-1]).reshape(-1, size, size)


def _smooth_compiled(layout: Layout, nodes: list[Node]) -> tuple[list[State], Array, Array]:
    """The same with `compiled_ukf.smooth_node`."""
    onboard = layout[ONBOARD].start if ONBOARD in layout else -1
    states = [nodes[-1].state]
    covariance = np.empty((len(nodes), layout.size, layout.size))
    gain = np.empty((len(nodes) - 1, layout.size, layout.size))
    covariance[-1] = nodes[-1].covariance
    for k in reversed(range(len(nodes) - 1)):
        node, transition = nodes[k], nodes[k + 1].transition
        assert transition is not None
        following = (states[-1], covariance[k + 1])
        states.append(
            smooth_node((node.state, node.covariance), transition, following, onboard, covariance[k], gain[k])
        )
    return states[::-1], covariance, gain
