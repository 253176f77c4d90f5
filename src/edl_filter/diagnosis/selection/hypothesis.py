"""A hypothesis: an effect refitted through the whole chain, from where the linear ranking saw it.

Its places are narrowed down and all its parameters refitted (`refit`), at the noise of the model without it and, where
there is hope, at the noise that it leaves; a leader once more about a reconstruction that has it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from edl_filter.diagnosis.case import Case, load_case
from edl_filter.diagnosis.linear import HOLDS, Linear
from edl_filter.diagnosis.narrowing import narrowed
from edl_filter.diagnosis.refit import Refit, refit
from edl_filter.diagnosis.regression import held_out
from edl_filter.diagnosis.roughness import find_rough, first_look
from edl_filter.diagnosis.settle import until_still
from edl_filter.diagnosis.trying import HOPELESS, Trial
from edl_filter.diagnosis.whitening import Whitener, Whitens
from edl_filter.diagnosis.without import Without
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
    without : Without
        The model without it.
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
    without: Without
    hard: Refit | None = None

    @property
    def active(self) -> Active:
        """The effect with its estimate."""
        return next(a for a in self.refit.effects if a.name == self.name)


def refitted(case: Case, linear: Linear, starts: list[tuple[Trial, Whitens]], without: Without) -> Hypothesis:
    """Refit from where each linear ranking saw the effect, and take the most probable outcome.

    Parameters
    ----------
    case, linear : Case, Linear
        The model without it, and the comparison about it.
    starts : list of (Trial, callable)
        What each linear ranking saw, and how it whitened.
    without : Without
        The model without it, which gains are over.

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
                return _best(starts[0][0].active.name, here[-1:], [], without, case, linear)
        if here and linear.soft is not linear.plain:
            hard.append(refit(linear, max(here, key=lambda r: r.evidence).effects, linear.plain))
        soft += here
    return _best(starts[0][0].active.name, soft, hard, without, case, linear)


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
    without: Without,
    case: Case,
    linear: Linear,
    thorough: bool = False,
) -> Hypothesis:
    """The most probable of some refits, at the noise of the model without the effect or at the noise that it leaves.

    Its gain is that at the noise of the model without it, where all effects are judged alike; only one that leaves next
    to no roughness is judged at the noise that it leaves. That one is tried where a first look gives hope, or if
    `thorough`.
    """
    found = max(soft, key=lambda r: r.evidence)
    floor = _FLOOR * without.rough
    first = _hypothesis(name, found, linear.soft, linear.share < floor, without, case, linear)
    if first.at_floor and linear.rough[0].none:
        return first
    surest = max(hard, key=lambda r: r.evidence) if hard else None
    outcomes = [first]
    for start in (found, *([surest] if surest is not None else [])):
        if not thorough and _look(linear, start, without.rough) > _MAYBE:
            continue
        rough, whiten = find_rough(linear.plain, linear.ground.order, start.column, start.start, linear.failures)
        moving = start.point is not linear.ground.point  # one that moved goes on from there
        own = refit(linear, start.effects, whiten, steps=3, moving=moving)
        outcomes.append(_hypothesis(name, own, whiten, rough.share < floor, without, case, linear))
    best = max(outcomes, key=lambda h: (h.gain, h.at_floor))
    if best.at_floor:
        return best
    return replace(best, gain=first.gain, score_gain=first.score_gain, hard=surest)


def _hypothesis(
    name: str, found: Refit, whiten: Whitener, at_floor: bool, without: Without, case: Case, linear: Linear
) -> Hypothesis:
    active = next(a for a in found.effects if a.name == name)
    sizes = {q.name for q in active.effect.sizes}
    mine = [i for i, (effect, q) in enumerate(found.names) if effect == name and q in sizes]
    size = np.array([active.values[found.names[i][1]] for i in mine])
    x = found.signature[:, mine]
    # before and after in one linear problem: the differences without the effect are those with it, plus x size
    before = found.white + x @ size
    predictive = held_out(before, x, found.sigma[mine], linear.ground.order.time)
    predictive += whiten.log_likelihood(before) + linear.ground.volume(found.effects)
    return Hypothesis(
        name=name,
        refit=found,
        whiten=whiten,
        gain=found.evidence - without.evidence,
        score_gain=predictive - without.likelihood,
        at_floor=at_floor,
        explained=x @ size,
        case=case,
        linear=linear,
        without=without,
    )


def about_itself(h: Hypothesis) -> Hypothesis:
    """The same hypothesis refitted about a reconstruction that has it.

    What the effect does to the path is then taken up to all orders. It begins at what is most likely at the noise that
    the effect leaves, which the others were not polished to; beside a database with errors of its own there is no such
    noise, and it begins where it was. The gain is what it has over the model without it, where one of the two holds.
    Where both fail, it stays that of the first refit: another path would serve the model without the effect as well.
    """
    polished = h
    if not h.at_floor:
        starts = [h.hard] if h.hard is not None and h.case.exact else []
        polished = _best(h.name, [h.refit], starts, h.without, h.case, h.linear, thorough=True)
    rounds = 2 if h.case.exact else 1  # or nothing will hold, and what it moves is lost in the noise
    case, linear, found = until_still(
        load_case(h.case.mission, polished.refit.effects), rounds, begin=h.linear.failures
    )
    again = _best(h.name, [found], [], h.without, case, linear, thorough=True)
    gain = again.gain
    if h.linear.holds:  # from path to path evidence jumps by some nats; the model without it has its likeliest too
        gain = max(gain, h.gain)
    elif not again.at_floor:
        gain = h.gain
    solved = again.at_floor and h.without.rough > HOLDS
    return replace(again, gain=gain, score_gain=again.score_gain if solved else h.score_gain)
