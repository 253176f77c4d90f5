"""Ranking: which effect is missing, by evidence.

Every effect of the catalogue that is not in the model is first tried linearly, at every place that it may have: its
signature is whitened and regressed (`regression`), once with the model's failures taken for noise (`roughness`) and
once without. The leaders' places are narrowed down and all their parameters
refitted through the whole chain (`refit`), the last time about a new reconstruction. The same evidence,
in nats, is computed for *none* and for *something else* (`missing`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from edl_filter.diagnosis.case import HOLDS, Case, Linear, linearise, load_case
from edl_filter.diagnosis.missing import Missing, most_likely
from edl_filter.diagnosis.narrowing import narrowed
from edl_filter.diagnosis.refit import Refit, refit
from edl_filter.diagnosis.regression import Fit, held_out, regress
from edl_filter.diagnosis.roughness import find_rough, first_look
from edl_filter.diagnosis.settle import until_still
from edl_filter.diagnosis.signatures import Signature, places, signature
from edl_filter.diagnosis.whitening import Whitener
from edl_filter.effects.effect import Active, Effect
from edl_filter.errors import InputError

Array = NDArray[np.float64]
Progress = Callable[[str], None]

#: Leaders of each linear ranking that are refitted, and places at which one begins.
LEADERS, STARTS = 4, 3
#: Share of the model's roughness below which an effect has explained it.
_FLOOR = 0.1
#: The same at a first look, from which there is no hope.
_MAYBE = 0.7
#: Likeness from which an effect may be a rival of one that explains everything.
_RIVAL = 0.7
#: Linear gain (nats) below which an effect is no leader.
_HOPELESS = 0.0
#: Part of the leader's gain from which another may be right about its own path.
_CLOSE = 0.25
#: Dynamic pressure from which air can be felt, Pa: places in time begin there.
_FELT = 1.0


@dataclass(frozen=True)
class Trial:
    """An effect tried linearly at its best place.

    Attributes
    ----------
    active : Active
        With its sizes as they came out.
    signature : Signature
    fit : Fit
    gain : float
        Evidence over none, averaged over the places, nats.
    rows : (R, k) array
        White signature.
    elsewhere : tuple of Active
        The effect at other places that look unlike the best, best first.
    """

    active: Active
    signature: Signature
    fit: Fit
    gain: float
    rows: Array
    elsewhere: tuple[Active, ...] = ()


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
    hard: Refit | None = None

    @property
    def active(self) -> Active:
        """The effect with its estimate."""
        return next(a for a in self.refit.effects if a.name == self.name)


@dataclass(frozen=True)
class Ranking:
    """All hypotheses about one model.

    Attributes
    ----------
    case, linear : Case, Linear
    white : (R,) array
        Differences of the model as it is.
    trials : dict
        Effect → linear trial with nothing else missing.
    hypotheses : list of Hypothesis
        Refitted, most probable first.
    missing : Missing
        Something else, at its most likely.
    something_else : float
        Its evidence, nats, over the model at its own noise, as all gains are.
    noise_evidence : float
        Evidence of the model's own noise over the stated one, nats; zero where they are one.
    failed : dict
        Effect → what went wrong in it: a user's, whose hooks raise or give the wrong thing.
    """

    case: Case
    linear: Linear
    white: Array
    trials: dict[str, Trial]
    hypotheses: list[Hypothesis]
    missing: Missing
    something_else: float
    noise_evidence: float
    failed: dict[str, str] = field(default_factory=dict)


def rank(case: Case, candidates: Iterable[Effect], progress: Progress = lambda _: None) -> Ranking:
    """Rank the effects that may be missing from a case's model."""
    progress("comparing model and measurements")
    linear = linearise(case, rounds=3, until=HOLDS)
    soft = linear.soft
    white = linear.white(soft)
    volume = linear.ground.volume(case.effects)
    base = soft.log_likelihood(white) + volume
    present = {a.name for a in case.effects}
    progress("trying the catalogue")
    failed: dict[str, str] = {}
    tried = signatures(linear, [e for e in candidates if e.name not in present], case.parachute, failed)
    ways = [soft] if soft is linear.plain else [soft, linear.plain]
    trials = [try_all(linear, way, tried) for way in ways]
    progress("trying something else")
    missing, likely = something_else(linear)
    found: list[Hypothesis] = []
    for name in leaders(trials):
        solved = next((h for h in found if h.at_floor), None)
        if solved is not None and _alike(trials[-1], solved.name, name) < _RIVAL:
            continue  # everything is explained, and this is another thing
        progress(f"refitting {name}")
        starts = [(t[name], way) for t, way in zip(trials, ways, strict=True)]
        try:
            one = _refitted(case, linear, starts, base)
        except InputError as error:
            failed[name] = str(error)
            continue
        if np.any(one.explained):  # a place outside the flight is no hypothesis
            found.append(one)
    polished = _polished(case, found, base, failed, progress)
    stated = linear.plain.log_likelihood(linear.white(linear.plain)) + volume
    return Ranking(case, linear, white, trials[0], polished, missing, likely + volume - base, base - stated, failed)


def something_else(linear: Linear) -> tuple[Missing, float]:
    """Most likely missing force and moment, and the log-likelihood with it at the noise that it leaves."""

    def value(missing: Missing) -> float:
        whiten = linear.with_missing(missing)
        return whiten.log_likelihood(linear.white(whiten))

    missing, found = most_likely(value)
    if linear.rough[0].none:
        return missing, found
    _, whiten = find_rough(linear.with_missing(missing), linear.ground.order, linear.column, linear.start)
    return missing, whiten.log_likelihood(linear.white(whiten))


def signatures(
    linear: Linear, effects: Sequence[Effect], end: float, failed: dict[str, str] | None = None
) -> list[list[Signature]]:
    """Signatures of every effect at all its places; an effect that fails goes into `failed`, if that is given."""
    nodes, q = linear.ground.found.nodes.time, linear.ground.found.flow.dynamic_pressure
    begin = float(nodes[np.argmax(q > _FELT)])
    lowest = float(np.min(linear.ground.found.flow.altitude))
    found = []
    for e in effects:
        try:
            found.append([signature(linear.ground, Active(e, place)) for place in places(e, begin, end, lowest)])
        except InputError as error:
            if failed is None:
                raise
            failed[e.name] = str(error)
    return found


def try_all(linear: Linear, whiten: Whitener, tried: list[list[Signature]]) -> dict[str, Trial]:
    """Regress the differences on every effect, at every place."""
    flat = [s for group in tried for s in group]
    if not flat:
        return {}
    rows = np.concatenate([linear.column[:, None], *(s.rows for s in flat)], axis=1)
    starts = np.concatenate([linear.start[:, None], *(s.start for s in flat)], axis=1)
    white = whiten(rows, starts)
    y, at, found = white[:, 0], 1, {}
    for group in tried:
        fits = []
        for s in group:
            x = white[:, at : at + len(s.names)]
            at += len(s.names)
            fits.append((regress(y, x, s.sigma), s, x))
        gains = np.array([f[0].gain for f in fits])
        mean = float(gains.max() + np.log(np.mean(np.exp(gains - gains.max()))))
        chosen = _unlike(fits)
        best, s, x = chosen[0]
        found[s.active.name] = Trial(
            _sized(s, best), s, best, mean, x, tuple(_sized(other, fit) for fit, other, _ in chosen[1:])
        )
    return found


def _sized(s: Signature, fit: Fit) -> Active:
    """The effect of a signature with the sizes of a fit."""
    return replace(s.active, values=s.active.values | dict(zip(s.names, fit.size.tolist(), strict=True)))


def _unlike(fits: list[tuple[Fit, Signature, Array]]) -> list[tuple[Fit, Signature, Array]]:
    """The best fit and up to `STARTS` - 1 others, each unlike those before."""
    ranked = sorted(fits, key=lambda f: -f[0].gain)
    chosen = ranked[:1]
    made = [ranked[0][2] @ ranked[0][0].size]
    for fit, s, x in ranked[1:]:
        if len(chosen) == STARTS or fit.gain <= _HOPELESS:
            break
        y = x @ fit.size
        if all(_likeness(y, m) < _RIVAL for m in made):
            chosen.append((fit, s, x))
            made.append(y)
    return chosen


def _likeness(a: Array, b: Array) -> float:
    """Correlation without its sign."""
    scale = float(np.linalg.norm(a) * np.linalg.norm(b))
    return abs(float(a @ b)) / scale if scale > 0.0 else 0.0


def leaders(rankings: list[dict[str, Trial]]) -> list[str]:
    """Names that lead any of the linear rankings, each once."""
    names: list[str] = []
    for trials in rankings:
        ranked = sorted(trials, key=lambda n: -trials[n].gain)
        names += [n for n in ranked[:LEADERS] if trials[n].gain > _HOPELESS and n not in names]
    return names


def _alike(trials: dict[str, Trial], one: str, other: str) -> float:
    """Correlation of two effects' fitted signatures, white."""
    a, b = (trials[n].rows @ trials[n].fit.size for n in (one, other))
    return _likeness(a, b)


def _refitted(case: Case, linear: Linear, starts: list[tuple[Trial, Whitener]], base: float) -> Hypothesis:
    """Refit from where each linear ranking saw the effect, and take the most probable outcome."""
    soft: list[Refit] = []
    hard: list[Refit] = []
    begun: list[Active] = []
    holds = linear.rough[0].share <= HOLDS
    for trial, way in starts:
        if soft and (trial.gain <= _HOPELESS or not trial.active.effect.places):
            continue
        here: list[Refit] = []
        for start in (trial.active, *trial.elsewhere):
            active = narrowed(linear, start, way)
            if any(_near(active, other) for other in begun):
                continue
            begun.append(active)
            here.append(refit(linear, (*case.effects, active), linear.soft, steps=6, moving=holds))
            if _look(linear, here[-1]) < _FLOOR:
                return _best(starts[0][0].active.name, here[-1:], [], base, case, linear)
        if here and linear.soft is not linear.plain:
            hard.append(refit(linear, max(here, key=lambda r: r.evidence).effects, linear.plain))
        soft += here
    return _best(starts[0][0].active.name, soft, hard, base, case, linear)


def _look(linear: Linear, found: Refit, share: float | None = None) -> float:
    """Roughness that a first look at a refit sees, of that of the model without the effect (`share`)."""
    before = linear.rough[0].share if share is None else share
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
    rough_share: float | None = None,
    thorough: bool = False,
) -> Hypothesis:
    """The most probable of some refits, at the noise of the model without the effect or at the noise that it leaves.

    Its gain is that at the noise of the model without it, where all effects are judged alike; only one that leaves next
    to no roughness is judged at the noise that it leaves. That one is tried where a first look gives hope, or if
    `thorough`.
    """
    found = max(soft, key=lambda r: r.evidence)
    share = linear.rough[0].share if rough_share is None else rough_share
    first = _hypothesis(name, found, linear.soft, linear.rough[0].share < _FLOOR * share, base, case, linear)
    if first.at_floor and linear.rough[0].none:
        return first
    surest = max(hard, key=lambda r: r.evidence) if hard else None
    outcomes = [first]
    for start in (found, *([surest] if surest is not None else [])):
        if not thorough and _look(linear, start, share) > _MAYBE:
            continue
        rough, whiten = find_rough(linear.plain, linear.ground.order, start.column, start.start)
        moving = start.point is not linear.ground.point  # one that moved goes on from there
        own = refit(linear, start.effects, whiten, steps=3, moving=moving)
        outcomes.append(_hypothesis(name, own, whiten, rough.share < _FLOOR * share, base, case, linear))
    best = max(outcomes, key=lambda h: (h.gain, h.at_floor))
    if best.at_floor:
        return best
    return replace(best, gain=first.gain, score_gain=first.score_gain, hard=surest)


def _hypothesis(
    name: str, found: Refit, whiten: Whitener, at_floor: bool, base: float, case: Case, linear: Linear
) -> Hypothesis:
    active = next(a for a in found.effects if a.name == name)
    sizes = {q.name for q in active.effect.sizes}
    mine = [i for i, (effect, q) in enumerate(found.names) if effect == name and q in sizes]
    size = np.array([active.values[found.names[i][1]] for i in mine])
    x = found.signature[:, mine]
    # before and after in one linear problem: the differences without the effect are those with it, plus x size
    score = held_out(found.white + x @ size, x, found.sigma[mine], linear.ground.order.time)
    gain = found.evidence - base
    return Hypothesis(name, found, whiten, gain, score, at_floor, x @ size, case, linear)


def _polished(
    case: Case, found: list[Hypothesis], base: float, failed: dict[str, str], progress: Progress
) -> list[Hypothesis]:
    """All hypotheses, the leader refitted about itself, and others that may be right where it is wrong.

    About a model that fails, gains are good to a factor only: a wrong name may lead where the right one moves the path
    by much. The right one comes to the noise about its own path, if nothing else is missing and the database is exact;
    so those that are `_CLOSE` to the leader are given the chance.
    """
    ranked = sorted(found, key=lambda h: -h.gain)
    holds = not ranked or ranked[0].linear.rough[0].share <= HOLDS
    close = [h.name for h in ranked if h.gain > _CLOSE * ranked[0].gain]
    near = close if not holds and case.exact else []
    own: set[str] = set()
    while ranked and len(own) < STARTS:
        waiting = [h.name for h in ranked if h.name not in own and (h is ranked[0] or h.name in near)]
        if not waiting:
            break
        name = waiting[0]
        i = next(i for i, h in enumerate(ranked) if h.name == name)
        own.add(name)
        progress(f"refitting {name} about a new reconstruction")
        try:
            ranked[i] = about_itself(ranked[i], base)
        except InputError as error:
            failed[name] = str(error)
        ranked.sort(key=lambda h: -h.gain)
    return ranked


def about_itself(h: Hypothesis, base: float) -> Hypothesis:
    """The same hypothesis refitted about a reconstruction that has it.

    What the effect does to the path is then taken up to all orders. It begins at what is most likely at the noise that
    the effect leaves, which the others were not polished to. The gain is what it has over the model without it
    (`base`), where one of the two holds. Where both fail, it stays that of the first refit: another path would serve
    the model without the effect as well.
    """
    polished = h
    if not h.at_floor:
        starts = [] if h.hard is None else [h.hard]
        polished = _best(h.name, [h.refit], starts, 0.0, h.case, h.linear, thorough=True)
    rounds = 2 if h.case.exact else 1  # or nothing will hold, and what it moves is lost in the noise
    case, linear, found = until_still(load_case(h.case.mission, polished.refit.effects), rounds)
    again = _best(h.name, [found], [], 0.0, case, linear, h.linear.rough[0].share, thorough=True)
    either = again.at_floor or h.linear.rough[0].share <= HOLDS
    return replace(again, gain=again.gain - base if either else h.gain, score_gain=h.score_gain)
