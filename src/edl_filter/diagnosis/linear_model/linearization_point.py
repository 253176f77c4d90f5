"""The point about which everything is linear: where the path begins, what the sensors are off, and the deviation.

The unknowns enter the linear problem one by one, but the flight multiplies them: density times attitude, a gyro's bias
times the roll at the start. About the mission's values one percent of density and half a degree of attitude leave more
of a moment unexplained than its noise. So path and model are taken where the unknowns most probably were, and
everything is linearised there: an iterated smoother (Bell, SIAM J. Optim. 4 (1994) 626), which is Gauss–Newton on
everything at once. What is known of the unknowns keeps counting from what the mission states.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from edl_filter.diagnosis.deviating import deviation
from edl_filter.diagnosis.whitening import Whitener
from edl_filter.effects.deviation import Deviation
from edl_filter.navigation.layout import ONBOARD, State
from edl_filter.reconstruction import Reconstruction

if TYPE_CHECKING:
    from edl_filter.diagnosis.linear import Linear

Array = NDArray[np.float64]

#: States of the attitude that was computed on board, which no model moves.
_ONBOARD = ("onboard_rate", "onboard_mounting", ONBOARD)
#: Sigmas of what is stated beyond which nothing is believed to lie.
_BELIEF = 100.0
#: The same of the logarithm of the density.
_THICK = 0.9


@dataclass(frozen=True)
class Point:
    """Where everything is linearised.

    Attributes
    ----------
    start : State
        Where the path begins, with the first instrument's errors.
    errors : (U, n) array
        Sensor errors by instrument, each in the filter's vector.
    deviation : Deviation, optional
        Of air, tables and vehicle; none before the flight has told.
    """

    start: State
    errors: Array
    deviation: Deviation | None = None


def first_point(reconstruction: Reconstruction) -> Point:
    """What the smoothed reconstruction says, which knows nothing of the air."""
    r = reconstruction
    errors = np.zeros((len(r.problem.instruments), r.problem.layout.size))
    met: set[int] = set()
    for node, state in zip(r.forward.nodes, r.smoothed.states, strict=True):
        if node.unit not in met:
            met.add(node.unit)
            errors[node.unit] = state.errors
    return Point(r.smoothed.states[0], errors)


def told(
    linear: Linear, point: Point, start: Array, whiten: Whitener, white: Array, onboard: bool = True
) -> Point | None:
    """Where the unknowns most probably are; None where that is beyond belief, as with a model far from the truth.

    Parameters
    ----------
    linear : Linear
    point : Point
        About which the differences are.
    start : (n,) array
        What is stated of the unknowns at the beginning, about the point.
    whiten : Whitener
    white : (R,) array
        The differences.
    onboard : bool
        Whether the on-board attitude's states move as well; it is carried along the path, which then must be followed
        anew.
    """
    layout = linear.unknowns.layout
    first, smoothed = whiten.smoothed(white, start)
    shift = first[: layout.size].copy()
    if not onboard:
        for name in _ONBOARD:
            if name in layout:
                shift[layout[name]] = 0.0
    prior = np.sqrt(np.diag(whiten.steps.start)[: layout.size])
    order, rows = linear.ground.order, whiten.steps.rows
    air = deviation(order, linear.bins, linear.unknowns, linear.sigma, linear.units, rows, smoothed)
    if not (np.all(np.abs(shift - start[: layout.size]) <= _BELIEF * prior) and np.all(np.abs(air.density) < _THICK)):
        return None
    begin = point.start.plus(shift)
    errors = point.errors.copy()
    errors[int(linear.ground.setup.problem.samples.unit[0])] = begin.errors
    return Point(begin, errors, air)
