"""Ranking: which effect is missing, by evidence.

Every effect of the catalogue that is not in the model is first tried linearly (`trying`), once with the model's
failures taken for noise (`roughness`) and once without. The leaders are refitted (`hypotheses`), the last time about a
new reconstruction. The same evidence, in nats, is computed for *none* and for *something else* (`missing`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from edl_filter.diagnosis.beside import beside_own
from edl_filter.diagnosis.case import Case
from edl_filter.diagnosis.hypotheses import Hypothesis, about_itself, refitted
from edl_filter.diagnosis.linear import HOLDS, Linear
from edl_filter.diagnosis.missing import Missing, most_likely
from edl_filter.diagnosis.roughness import find_rough
from edl_filter.diagnosis.rounds import followed, linearise
from edl_filter.diagnosis.threads import meanwhile, one_blas_thread
from edl_filter.diagnosis.trying import RIVAL, STARTS, Trial, alike, leaders, signatures, try_all
from edl_filter.diagnosis.whitening import Whitens
from edl_filter.diagnosis.without import Without, without_more
from edl_filter.effects.again import offered
from edl_filter.effects.effect import Effect
from edl_filter.errors import InputError

Array = NDArray[np.float64]
Progress = Callable[[str], None]

#: Sigmas that one may believe an unknown to be off.
_BELIEVED = 5.0
#: Part of the leader's gain from which another may be right about its own path.
_CLOSE = 0.25


@dataclass(frozen=True)
class Ranking:
    """All hypotheses about one model.

    Attributes
    ----------
    case, linear : Case, Linear
    trials : dict
        Effect → linear trial at the noise that the model without it shows.
    hypotheses : list of Hypothesis
        Refitted, most probable first.
    missing : Missing
        Something else, at its most likely.
    something_else : float
        Its evidence, nats, over the model at its own noise where it is likeliest, as all gains are.
    noise_evidence : float
        Evidence of that over the model where it is, at the stated noise, less what its variances cost; zero where they
        are one.
    failed : dict
        Effect → what went wrong in it: a user's, whose hooks raise or give the wrong thing.
    """

    case: Case
    linear: Linear
    trials: dict[str, Trial]
    hypotheses: list[Hypothesis]
    missing: Missing
    something_else: float
    noise_evidence: float
    failed: dict[str, str] = field(default_factory=dict)


def rank(case: Case, candidates: Iterable[Effect], progress: Progress = lambda _: None) -> Ranking:
    """Rank the effects that may be missing from a case's model.

    Parameters
    ----------
    case : Case
    candidates : iterable of Effect
        Those that are in the model already are passed over, or tried once more if they act at a place (`again`).
    progress : callable
        Told what is being done.

    Returns
    -------
    Ranking
    """
    with one_blas_thread():  # throughout: of two threads that set it in turn, the second would leave the first's
        return _ranked(case, candidates, progress)


def _ranked(case: Case, candidates: Iterable[Effect], progress: Progress) -> Ranking:
    progress("comparing model and measurements")
    linear = linearise(case, rounds=3, until=HOLDS)
    away = followed(case, linear)
    if away is not None and away.surprise <= _BELIEVED:
        linear, away = away, None  # it failed only where the reconstruction had put the path
    paths = [x for x in (linear, away) if x is not None]
    without, likeliest = without_more(paths, case.effects), max(paths, key=lambda x: x.log_likelihood)
    progress("trying the catalogue and something else")
    elsewise = meanwhile(lambda: something_else(linear))  # compiled loops for the most part
    effects = offered(candidates, {a.name for a in case.effects})
    failed: dict[str, str] = {}
    # where the model holds an effect has its full evidence; the scan of one with a place is too coarse for that
    shares = [(linear, effects)]
    if away is not None:
        shares = [(linear, [e for e in effects if e.places]), (away, [e for e in effects if not e.places])]
    grounds = [_tried(ground, share, case.parachute, failed) for ground, share in shares]
    polished: list[Hypothesis] = []
    for tried in grounds:
        best = max((h.gain for h in polished), default=0.0)
        found = _refitted(case, tried, without, _CLOSE * best, failed, progress)
        polished += _polished(case, found, failed, progress)
    polished.sort(key=lambda h: -h.gain)
    missing, likely = elsewise()
    stated = linear.plain.log_likelihood(linear.white(linear.plain))
    trials = {name: trial for tried in grounds for name, trial in tried.trials[0].items()}
    other = likely - likeliest.log_likelihood  # the model's own effects where they are, in both
    noise = likeliest.log_likelihood - likeliest.rough[0].price - stated
    return Ranking(case, linear, trials, polished, missing, other, noise, failed)


@dataclass(frozen=True)
class _Tried:
    """Effects tried linearly about one point, in each way to whiten."""

    linear: Linear
    ways: list[Whitens]
    trials: list[dict[str, Trial]]


def _tried(linear: Linear, effects: Sequence[Effect], end: float, failed: dict[str, str]) -> _Tried:
    """With the model's failures taken for noise, and without."""
    whiteners = [linear.soft] if linear.soft is linear.plain else [linear.soft, linear.plain]
    ways = [beside_own(linear, w) for w in whiteners]
    columns = signatures(linear, effects, end, failed)
    return _Tried(linear, ways, [try_all(linear, way, columns) for way in ways])


def _refitted(
    case: Case, tried: _Tried, without: Without, least: float, failed: dict[str, str], progress: Progress
) -> list[Hypothesis]:
    """The leaders of what was tried, refitted: those whose linear gain is not below `least`."""
    found: list[Hypothesis] = []
    for name in leaders(tried.trials):
        if max(t[name].gain for t in tried.trials) < least:
            continue
        solved = next((h for h in found if h.at_floor), None) if not tried.linear.holds else None
        if solved is not None and alike(tried.trials[-1], solved.name, name) < RIVAL:
            continue  # everything is explained, and this is another thing
        progress(f"refitting {name}")
        starts = [(t[name], way) for t, way in zip(tried.trials, tried.ways, strict=True)]
        try:
            one = refitted(case, tried.linear, starts, without)
        except InputError as error:
            failed[name] = str(error)
            continue
        if np.any(one.explained):  # a place outside the flight is no hypothesis
            found.append(one)
    return found


def something_else(linear: Linear) -> tuple[Missing, float]:
    """Most likely missing force and moment, and the log-likelihood with it at the noise that it leaves.

    Noise that nobody named is something else as well, if the flight is likelier with that alone.

    Parameters
    ----------
    linear : Linear

    Returns
    -------
    missing : Missing
    likely : float
        nats.
    """

    def value(missing: Missing) -> float:
        whiten = linear.with_missing(missing)
        return whiten.log_likelihood(linear.white(whiten))

    missing, found = most_likely(value)
    if linear.rough[0].none:
        return missing, found
    allowed, order = linear.with_missing(missing), linear.ground.order
    _, whiten = find_rough(allowed, order, linear.column, linear.start, linear.failures)
    return missing, max(whiten.log_likelihood(linear.white(whiten)), linear.log_likelihood)


def _polished(case: Case, found: list[Hypothesis], failed: dict[str, str], progress: Progress) -> list[Hypothesis]:
    """All hypotheses, the leader refitted about itself, and others that may be right where it is wrong.

    About a model that fails, gains are good to a factor only: a wrong name may lead where the right one moves the path
    by much. The right one comes to the noise about its own path, if nothing else is missing and the database is exact;
    so those that are `_CLOSE` to the leader are given the chance, and the one that leaves least at the stated noise.
    """
    ranked = sorted(found, key=lambda h: -h.gain)
    close, least = [], []
    if case.exact and ranked and not ranked[0].linear.holds:
        close = [h.name for h in ranked if h.gain > _CLOSE * ranked[0].gain]
        least = [name for _, name in sorted((h.hard.evidence, h.name) for h in found if h.hard is not None)[-1:]]
    own: set[str] = set()
    while ranked and len(own) < STARTS:
        unsolved = [] if any(h.at_floor for h in ranked) else least
        waiting = [name for name in (ranked[0].name, *unsolved, *close) if name not in own]
        if not waiting:
            break
        name = waiting[0]
        i = next(i for i, h in enumerate(ranked) if h.name == name)
        own.add(name)
        progress(f"refitting {name} about a new reconstruction")
        try:
            ranked[i] = about_itself(ranked[i])
        except InputError as error:
            failed[name] = str(error)
        ranked.sort(key=lambda h: -h.gain)
    return ranked
