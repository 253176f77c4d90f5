"""Settle: a mission's own effects refitted, and the reconstruction that has them at their estimates.

An effect in a mission file has starting values. A run finds the most probable ones: it refits about a reconstruction,
reconstructs with what it found, and again until nothing moves. A hypothesis that is to stand is refitted so as well.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from edl_filter.diagnosis.case import Case, load_case
from edl_filter.diagnosis.linear import HOLDS, Linear, about
from edl_filter.diagnosis.refit import Refit, refit
from edl_filter.diagnosis.roughness import Rough
from edl_filter.diagnosis.rounds import linearise
from edl_filter.effects.effect import Active
from edl_filter.errors import InputError
from edl_filter.mission import Mission
from edl_filter.reconstruction import Reconstruction, reconstruct

#: Reconstructions that a run refits about at most, and the move (sigmas) that is small enough to stop.
ROUNDS, STILL = 3, 0.3


@dataclass(frozen=True)
class Settled:
    """A reconstruction with effects at their estimates.

    Attributes
    ----------
    reconstruction : Reconstruction
    sigma : dict
        Effect → parameter → one sigma; what was not fitted is not in it.
    """

    reconstruction: Reconstruction
    sigma: dict[str, dict[str, float]]


def can_settle(mission: Mission) -> bool:
    """Whether a mission has effects to refit, and the model that a comparison needs."""
    return (
        any(not entry.fixed for entry in mission.effects)
        and mission.aerodynamics is not None
        and mission.vehicle.inertia is not None
    )


def settle(
    mission: Mission, progress: Callable[[str], None] = lambda _: None, effects: Sequence[Active] | None = None
) -> Settled:
    """Refit a mission's effects.

    Parameters
    ----------
    mission : Mission
    progress : callable
        Told what is being done.
    effects : sequence of Active, optional
        Instead of the mission's.

    Raises
    ------
    InputError
        An effect stands twice, or the mission cannot be reconstructed.
    """
    begin = time.perf_counter()
    _once(mission)
    progress("reconstructing with the effects as they are stated")
    _, _, found = until_still(load_case(mission, effects), ROUNDS, progress)
    last = reconstruct(mission, found.effects, leave_one_out=True)
    timing = last.timing | {"refit": time.perf_counter() - begin}
    return Settled(replace(last, timing=timing), _sigma(found))


def until_still(
    case: Case,
    rounds: int = ROUNDS,
    progress: Callable[[str], None] = lambda _: None,
    begin: Rough | None = None,
) -> tuple[Case, Linear, Refit]:
    """Refit a case's effects about its reconstruction, and again about one with what was found, until nothing moves.

    Path and air move along, but not where a model fails beside a database that has errors of its own: what is wrong
    with the database would drag them along. The search for the noise begins at `begin`, `Linear.failures` of a model
    much like it.
    """
    # a database with errors of its own would drag the path of a failing model along; else it may be all that is wrong
    until = 1.0 if case.exact else HOLDS

    def about_it(linear: Linear) -> Refit:
        return refit(linear, case.effects, linear.soft, moving=linear.rough[0].share <= until)

    progress("refitting the effects, round 1")
    linear = linearise(case, rounds=2, until=until, begin=begin)
    found = about_it(linear)
    for i in range(1, rounds):
        if _moved(case.effects, found) <= STILL:
            break
        progress(f"refitting the effects, round {i + 1}")
        case = load_case(case.mission, found.effects)
        linear = about(case, found.point, linear.failures)
        found = about_it(linear)
    return case, linear, found


def _once(mission: Mission) -> None:
    twice = [name for name, n in Counter(entry.name for entry in mission.effects).items() if n > 1]
    if twice:
        raise InputError(
            f"{mission.source or mission.name}: effects: found {twice[0]} twice; a refit takes each name once. "
            "Run with --no-refit to hold all effects at their values."
        )


def _sigma(found: Refit) -> dict[str, dict[str, float]]:
    spread = np.sqrt(np.diag(found.covariance))
    told: dict[str, dict[str, float]] = {}
    for (effect, parameter), s in zip(found.names, spread, strict=True):
        told.setdefault(effect, {})[parameter] = float(s)
    return told


def _moved(before: tuple[Active, ...], found: Refit) -> float:
    """Largest move of a parameter, in its sigmas."""
    old = {a.name: a.values for a in before}
    new = {a.name: a for a in found.effects}
    spread = np.sqrt(np.diag(found.covariance))
    moves = [new[e].change_from(old[e], q) / s for (e, q), s in zip(found.names, spread, strict=True)]
    return max(moves, default=0.0)
