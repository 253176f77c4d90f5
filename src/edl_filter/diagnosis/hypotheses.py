"""A hypothesis: an effect refitted through the whole chain, from where the linear ranking saw it.

Its places are narrowed down and all its parameters refitted (`refit`), at the noise of the model without it and, where
there is hope, at the noise that it leaves; a leader once more about a reconstruction that has it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from edl_filter.diagnosis.case import HOLDS, Case, Linear, load_case
from edl_filter.diagnosis.narrowing import narrowed
from edl_filter.diagnosis.refit import Refit, refit
from edl_filter.diagnosis.regression import held_out
from edl_filter.diagnosis.roughness import find_rough, first_look
from edl_filter.diagnosis.settle import until_still
from edl_filter.diagnosis.trying import HOPELESS, Trial
from edl_filter.diagnosis.whitening import Whitener
from edl_filter.effects.effect import Active

Array = NDArray[np.float64]

#: Share of the model's roughness below which an effect has explained it.
_FLOOR = 0.1
#: The same at a first look, from which there is no hope.
_MAYBE = 0.7


@dataclass(frozen=True)
class Hypothesis:
    """An effect refitted.

    Attributes
    ----------
    name : str
    refit : Refit
    whiten : Whitener
        At the noise that the hypothesis leaves.
    gain : float
        Evidence over none, nats.
    score_gain : float
        Held-out log predictive density over none, nats.
    at_floor : bool
        Next to no noise beyond the stated one is left with it.
    explained : (R,) array
        What its sizes make of the differences, white, at the noise of the model without it.
    case, linear : Case, Linear
        The ground of the last refit.
    before : float
        Part of the rows that are rough without it, where the model fails.
    predictive : float
        Held-out log predictive density with it, as the evidence up to a constant of the flight.
    hard : Refit or None
        The same at the stated noise, where that is another.
    """

    name: str
    refit: Refit
    whiten: Whitener
    gain: float
    score_gain: float
    at_floor: bool
    explained: Array
    case: Case
    linear: Linear
    before: float
    predictive: float
    hard: Refit | None = None

    @property
    def active(self) -> Active:
        """The effect with its estimate."""
        return next(a for a in self.refit.effects if a.name == self.name)


def refitted(
    case: Case, linear: Linear, starts: list[tuple[Trial, Whitener]], base: float, before: float
) -> Hypothesis:
    """Refit from where each linear ranking saw the effect, and take the most probable outcome.

    Parameters
    ----------
    case, linear : Case, Linear
        The model without it, and the comparison about it.
    starts : list of (Trial, Whitener)
        What each linear ranking saw, and how it whitened.
    base : float
        Log-likelihood of *none* where it is likeliest: gains are over that, nats.
    before : float
        Part of the rows that are rough without the effect, where the model fails.

    Returns
    -------
    Hypothesis
    """
    soft: list[Refit] = []
    hard: list[Refit] = []
    begun: list[Active] = []
    holds = linear.holds
    for trial, way in starts:
        if soft and (trial.gain <= HOPELESS or not trial.active.effect.places):
            continue
        here: list[Refit] = []
        for start in (trial.active, *trial.elsewhere):
            # where path and air move with the effect, its size and they take one step together, from nothing
            active = start.unsized() if holds and not start.effect.places else narrowed(linear, start, way)
            if any(_near(active, other) for other in begun):
                continue
            begun.append(active)
            here.append(refit(linear, (*case.effects, active), linear.soft, steps=6, moving=holds))
            if _look(linear, here[-1], linear.share) < _FLOOR:
                return _best(starts[0][0].active.name, here[-1:], [], base, case, linear, before)
        if here and linear.soft is not linear.plain:
            hard.append(refit(linear, max(here, key=lambda r: r.evidence).effects, linear.plain))
        soft += here
    return _best(starts[0][0].active.name, soft, hard, base, case, linear, before)


def _look(linear: Linear, found: Refit, before: float) -> float:
    """Roughness that a first look at a refit sees, of that of the model without the effect (`before`)."""
    if before == 0.0:
        return 1.0
    return first_look(linear.plain, linear.ground.order, found.column, found.start).share / before


def _near(a: Active, b: Active) -> bool:
    """Whether two starts are at one place."""
    return all(np.isclose(a.values[q.name], b.values[q.name], rtol=0.05) for q in a.effect.places)


def _best(
    name: str,
    soft: list[Refit],
    hard: list[Refit],
    base: float,
    case: Case,
    linear: Linear,
    before: float,
    thorough: bool = False,
) -> Hypothesis:
    """The most probable of some refits, at the noise of the model without the effect or at the noise that it leaves.

    Its gain is that at the noise of the model without it, where all effects are judged alike; only one that leaves next
    to no roughness is judged at the noise that it leaves. That one is tried where a first look gives hope, or if
    `thorough`.
    """
    found = max(soft, key=lambda r: r.evidence)
    floor = _FLOOR * before
    first = _hypothesis(name, found, linear.soft, linear.share < floor, base, case, linear, before)
    if first.at_floor and linear.rough[0].none:
        return first
    surest = max(hard, key=lambda r: r.evidence) if hard else None
    outcomes = [first]
    for start in (found, *([surest] if surest is not None else [])):
        if not thorough and _look(linear, start, before) > _MAYBE:
            continue
        rough, whiten = find_rough(linear.plain, linear.ground.order, start.column, start.start)
        moving = start.point is not linear.ground.point  # one that moved goes on from there
        own = refit(linear, start.effects, whiten, steps=3, moving=moving)
        outcomes.append(_hypothesis(name, own, whiten, rough.share < floor, base, case, linear, before))
    best = max(outcomes, key=lambda h: (h.gain, h.at_floor))
    if best.at_floor:
        return best
    return replace(best, gain=first.gain, score_gain=first.score_gain, hard=surest)


def _hypothesis(
    name: str, found: Refit, whiten: Whitener, at_floor: bool, base: float, case: Case, linear: Linear, before: float
) -> Hypothesis:
    active = next(a for a in found.effects if a.name == name)
    sizes = {q.name for q in active.effect.sizes}
    mine = [i for i, (effect, q) in enumerate(found.names) if effect == name and q in sizes]
    size = np.array([active.values[found.names[i][1]] for i in mine])
    x = found.signature[:, mine]
    # before and after in one linear problem: the differences without the effect are those with it, plus x size
    without = found.white + x @ size
    score = held_out(without, x, found.sigma[mine], linear.ground.order.time)
    predictive = score + whiten.log_likelihood(without) + linear.ground.volume(found.effects)
    if whiten is linear.soft:  # over none about this path so far; the likeliest none may be about another
        score -= base - linear.log_likelihood - linear.ground.volume(case.effects)
    else:  # as the gain: over none at none's own noise
        score = predictive - base
    gain = found.evidence - base
    return Hypothesis(name, found, whiten, gain, score, at_floor, x @ size, case, linear, before, predictive)


def about_itself(h: Hypothesis, base: float) -> Hypothesis:
    """The same hypothesis refitted about a reconstruction that has it.

    What the effect does to the path is then taken up to all orders. It begins at what is most likely at the noise that
    the effect leaves, which the others were not polished to; beside a database with errors of its own there is no such
    noise, and it begins where it was. The gain is what it has over the model without it
    (`base`), where one of the two holds. Where both fail, it stays that of the first refit: another path would serve
    the model without the effect as well.

    Parameters
    ----------
    h : Hypothesis
    base : float
        Log-likelihood of *none* where it is likeliest, nats.

    Returns
    -------
    Hypothesis
    """
    polished = h
    if not h.at_floor:
        starts = [h.hard] if h.hard is not None and h.case.exact else []
        polished = _best(h.name, [h.refit], starts, 0.0, h.case, h.linear, h.before, thorough=True)
    rounds = 2 if h.case.exact else 1  # or nothing will hold, and what it moves is lost in the noise
    case, linear, found = until_still(load_case(h.case.mission, polished.refit.effects), rounds)
    again = _best(h.name, [found], [], 0.0, case, linear, h.before, thorough=True)
    gain = again.gain - base
    if h.linear.holds:  # from path to path evidence jumps by some nats; `base` is the likeliest's too
        gain = max(gain, h.gain)
    elif not again.at_floor:
        gain = h.gain
    solved = again.at_floor and h.before > HOLDS
    return replace(again, gain=gain, score_gain=again.predictive - base if solved else h.score_gain)
