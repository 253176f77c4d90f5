"""Rounds: the comparison about the first point, and about where the flight says path and air are, until it stays."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice

import numpy as np

from edl_filter.diagnosis.case import Case
from edl_filter.diagnosis.deviating import moved
from edl_filter.diagnosis.linear import Linear, about
from edl_filter.diagnosis.point import first_point, told
from edl_filter.diagnosis.roughness import Rough

#: What a path may still move when it has settled, in sigmas of what is known of it.
_SETTLED = 0.1
#: Rounds, its last one counted, in which a failing model may find where it holds, and how much of its roughness one
#: may leave if there is hope.
_AWAY, _HOPE = 4, 0.8


def linearise(case: Case, rounds: int = 1, until: float = 1.0, begin: Rough | None = None) -> Linear:
    """Compare model and measurement, about a path and about what the flight says of air, tables and vehicle.

    The first path begins where the reconstruction says, which knows nothing of the air. What forces and moments say of
    its beginning, of the sensor errors and of the air is more; with further `rounds` everything is taken again there
    (`point`), until it stays. That is for models that hold: a failing one may drag the path along, so the rounds end
    where more than the part `until` of the rows is rough. Tables have bends, and the rounds may go to and fro between
    two sides of one; so the likeliest is kept.

    Parameters
    ----------
    case : Case
    rounds : int
        How often it is compared at most.
    until : float
        Part of the rows, 0 to 1.
    begin : Rough, optional
        `Linear.failures` of a model much like it, from which the search for its own noise begins.

    Returns
    -------
    Linear
    """
    return _likeliest(list(_rounds(case, rounds, until, about(case, first_point(case.reconstruction), begin))))


def followed(case: Case, linear: Linear) -> Linear | None:
    """Where a failing model beside an exact database leads, if it holds there; None otherwise.

    It fails where the reconstruction has put the path. After some rounds an unknown may have taken what is missing upon
    itself, by as many sigmas as that takes (`Linear.surprise`).

    Parameters
    ----------
    case : Case
    linear : Linear
        The model where it fails.

    Returns
    -------
    Linear or None
    """
    share = linear.share
    if not case.exact or linear.holds:
        return None
    for there in islice(_rounds(case, _AWAY, 1.0, linear), 1, None):
        if there.holds:
            return there
        if there.share > _HOPE * share:
            break
        share = there.share
    return None


def _likeliest(tried: list[Linear]) -> Linear:
    """Of those that hold, if any does."""
    holding = [x for x in tried if x.holds]
    return max(holding or tried, key=lambda x: x.log_likelihood)


def _rounds(case: Case, rounds: int, until: float, linear: Linear) -> Iterator[Linear]:
    """The comparison about a point, and about where that leads, until it stays or fails."""
    for i in range(rounds):
        yield linear
        point = linear.ground.point
        if i == rounds - 1 or linear.share > until:
            return
        soft, size = linear.soft, linear.unknowns.layout.size
        new = told(linear, point, linear.start, soft, linear.white(soft))
        if new is None:
            return
        spread = np.sqrt(np.maximum(np.diag(soft.start_covariance(size)), 0.0))
        still = np.all(np.abs(new.start.minus(point.start)) <= _SETTLED * spread + 1e-15)
        if still and moved(point.deviation, new.deviation, linear.sigma) <= _SETTLED:
            return
        linear = about(case, new, linear.failures)
