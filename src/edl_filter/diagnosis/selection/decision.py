"""Decision: probabilities of all hypotheses, and the verdict, which is a function of them.

Hypotheses, with their log evidence E in nats over the model as it is:

none
    The model holds with all that is stated: E = 0, or minus the contradiction where that is positive. The contradiction
    is the evidence for noise beyond the stated less its prior cost, `excess_noise_nats`, or the evidence that a
    nuisance parameter has another sigma than is stated less `named_gain_nats`, whichever is larger.
name
    One effect of the catalogue is missing: E = min(gain, held-out gain) - c.
something else
    A sigma is not what is stated: E is the contradiction, at most 0; or an unmodelled acceleration: E = gain - c. Where
    the contradiction is positive, the acceleration counts only if the first name leaves hardly any excess variance:
    of two missing effects the first explains less than a process that explains both. Otherwise E of none is less by the
    acceleration's evidence, so that the odds of none against something else are continuous.

All gains are over the same reference: the model with its nuisance parameters, the discrepancy of the database among
them, marginalised, at the noise that it shows. An effect that is a change of the database is therefore named only as
far as it exceeds what the database's own uncertainty allows, and a name that leaves the flight unexplained only if it
explains more than a force and a moment that follow nothing but their own correlation.

Where the noise is not what is stated, the gain of a name depends on how the rest is modelled. If the first name leaves
excess noise and explains less than `sufficient_share` of the log-likelihood between the model and one that holds
(`Hypothesis.explained_share`), and no second effect explains the rest (`Hypothesis.complemented`), something outside
the catalogue is missing too. The evidence of the name is then at most the log likelihood ratio of that share s,
log k s^(k - 1): the share of a right name has the distribution Beta(k, 1), where k is `explained_share_shape`, that of
a wrong name is uniform. The evidence of the others is reduced as much.

c is the prior cost of a hypothesis that is not the reference (log prior odds): `named_gain_nats`, or
`named_gain_in_excess_noise_nats` where the noise is not what is stated (Kass and Raftery, JASA 90 (1995) 773), and in
proportion between them where the evidence for excess noise is below `excess_noise_nats`. The
probabilities are the normalised exponentials, mixed with equal probabilities of all hypotheses by the share of flights
in which the approximation of the evidence fails, `approximation_error`. The verdict is ``clean``, ``missing`` or
``unknown`` where the probability of none, of the first name or of something else exceeds `decided_probability`;
otherwise it is ``undecided``. Effects whose white columns cannot be distinguished are one hypothesis with several
names.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from edl_filter.diagnosis.noise.unmodelled_acceleration import in_words
from edl_filter.diagnosis.residual_analysis.residual_map import (
    channels,
    rms_by_channel,
    rms_by_constraint,
)
from edl_filter.diagnosis.selection.disambiguation import best_discriminator
from edl_filter.diagnosis.selection.hypothesis import Hypothesis
from edl_filter.diagnosis.selection.ranking import Ranking
from edl_filter.diagnosis.selection.screening import correlation
from edl_filter.effects.base import EffectInstance
from edl_filter.mission.decision_settings import DecisionSettings
from edl_filter.results.verdicts import CLEAN, MISSING, UNDECIDED, UNKNOWN
from edl_filter.types import Array

#: Number of hypotheses that the sentence of an undecided verdict names.
_CONTENDERS = 3
#: Least share that a name explains, for a finite logarithm: with the default shape its odds are exp(-60).
_LEAST_SHARE = 1e-3


@dataclass(frozen=True)
class Entry:
    """One row of the ranking.

    Attributes
    ----------
    hypothesis : Hypothesis
    indistinguishable : tuple of Hypothesis
        Those that this flight does not distinguish from it.
    probability : float
    discriminated_by : dict
        Label of each of those → the measurement that would distinguish it from the first, in words.
    """

    hypothesis: Hypothesis
    indistinguishable: tuple[Hypothesis, ...]
    probability: float
    discriminated_by: dict[str, str] = field(default_factory=dict)

    @property
    def same_as(self) -> tuple[str, ...]:
        """Labels of the effects that this flight does not distinguish from the first."""
        return tuple(h.label for h in self.indistinguishable)


@dataclass(frozen=True)
class Verdict:
    """Probabilities, and what follows from them.

    Attributes
    ----------
    verdict : str
        ``clean``, ``missing``, ``undecided`` or ``unknown``: `verdict_of` the probabilities.
    entries : list of Entry
        Most probable first.
    none, something_else : float
        Their probabilities.
    something_else_gain : float
        Gain with which a name is as probable as something else, nats: the log evidence of something else, plus c.
    required_gain : float
        Gain that a name needs, nats: c of this module.
    sentence : str
    """

    verdict: str
    entries: list[Entry]
    none: float
    something_else: float
    something_else_gain: float
    required_gain: float
    sentence: str

    @property
    def leader(self) -> EffectInstance | None:
        """The effect that is missing, with its estimate; None unless the verdict is ``missing``."""
        return self.entries[0].hypothesis.instance if self.verdict == MISSING else None


def verdict_of(names: Sequence[float], none: float, something_else: float, required: float) -> str:
    """The verdict that probabilities imply: that of the hypothesis whose probability is sufficient.

    Parameters
    ----------
    names : sequence of float
        Probabilities of the named hypotheses.
    none, something_else : float
        Probabilities that nothing is missing, and that something outside the catalogue is.
    required : float
        Sufficient probability, above one half.
    """
    by_verdict = {CLEAN: none, UNKNOWN: something_else, MISSING: max(names, default=0.0)}
    verdict = max(by_verdict, key=lambda v: by_verdict[v])
    return verdict if by_verdict[verdict] >= required else UNDECIDED


def probabilities(log_evidence: Array, approximation_error: float) -> Array:
    """Probabilities of hypotheses from approximate evidence.

    Parameters
    ----------
    log_evidence : (n,) array
        nats; of hypotheses with equal prior probabilities.
    approximation_error : float
        Share of flights in which the approximation is wrong and says nothing of the hypotheses.

    Returns
    -------
    (n,) array
    """
    weight = np.exp(log_evidence - np.max(log_evidence))
    return np.asarray((1.0 - approximation_error) * weight / np.sum(weight) + approximation_error / len(weight))


def decide(ranking: Ranking) -> Verdict:
    """Probabilities and verdict."""
    settings = ranking.case.settings
    noisy = ranking.excess_noise_gain > settings.excess_noise_nats
    cost, contradiction = prior_cost(ranking.excess_noise_gain, settings), _contradiction(ranking)
    unmodelled = ranking.unmodelled_gain - cost
    groups = group_indistinguishable(ranking.hypotheses, settings)
    evidence = [group[0].conservative_gain - cost for group in groups]
    explains_all = bool(groups) and groups[int(np.argmax(evidence))][0].at_floor
    if contradiction > 0.0 and not explains_all:
        none, something_else = -contradiction - max(unmodelled, 0.0), 0.0
    else:
        none, something_else = -max(contradiction, 0.0), max(unmodelled, min(contradiction, 0.0))
    if noisy and groups:
        evidence = _limited(evidence, groups, settings)
    probability = probabilities(np.array([none, something_else, *evidence]), settings.approximation_error)
    entries = [
        Entry(groups[i][0], tuple(groups[i][1:]), float(probability[2 + i]), _discriminators(groups[i]))
        for i in sorted(range(len(groups)), key=lambda i: -evidence[i])
    ]
    of_none, of_something_else = float(probability[0]), float(probability[1])
    verdict = verdict_of([e.probability for e in entries], of_none, of_something_else, settings.decided_probability)
    sentence = _sentence(verdict, entries, of_none, of_something_else)
    if verdict == UNKNOWN and unmodelled > 0.0 and not ranking.unmodelled.is_zero:
        sentence += f" It most likely acts as {in_words(ranking.unmodelled)} (gain {ranking.unmodelled_gain:.0f} nats)."
    return Verdict(verdict, entries, of_none, of_something_else, something_else + cost, cost, sentence)


def prior_cost(excess_noise_gain: float, settings: DecisionSettings) -> float:
    """Prior cost of a hypothesis that is not the reference, nats: c of this module."""
    low, high = settings.named_gain_nats, settings.named_gain_in_excess_noise_nats
    if excess_noise_gain <= 0.0:
        return low
    if excess_noise_gain >= settings.excess_noise_nats:
        return high
    return low + excess_noise_gain / settings.excess_noise_nats * (high - low)


def _contradiction(ranking: Ranking) -> float:
    """Evidence that a sigma is not what is stated, less its prior cost, nats."""
    settings = ranking.case.settings
    contradictions = [
        gain - cost
        for gain, cost in (
            (ranking.excess_noise_gain, settings.excess_noise_nats),
            (ranking.nuisance_gain, settings.named_gain_nats),
        )
        if gain > 0.0
    ]
    return max(contradictions, default=-np.inf)


def _limited(evidence: list[float], groups: list[list[Hypothesis]], settings: DecisionSettings) -> list[float]:
    """Evidence of the names over something else, limited by the share of the first one if much is left."""
    first = max(range(len(groups)), key=lambda i: evidence[i])
    head = groups[first][0]
    alone = head.explained_share >= settings.sufficient_share and head.complemented is None
    if head.at_floor or head.complemented or alone:
        return evidence
    share, shape = max(head.explained_share, _LEAST_SHARE), settings.explained_share_shape
    excess = max(evidence[first] - float(np.log(shape) + (shape - 1.0) * np.log(share)), 0.0)
    return [e - excess for e in evidence]


def group_indistinguishable(hypotheses: list[Hypothesis], settings: DecisionSettings) -> list[list[Hypothesis]]:
    """Groups of hypotheses that cannot be distinguished; best first within and among the groups."""
    remaining, groups = sorted(hypotheses, key=lambda h: -h.gain), []
    while remaining:
        head, rest = remaining[0], remaining[1:]
        same = [
            h
            for h in rest
            if head.gain - h.gain < settings.separable_gain_nats
            and correlation(head.explained, h.explained) > settings.same_correlation
        ]
        groups.append([head, *same])
        remaining = [h for h in rest if not any(h is s for s in same)]
    return groups


def hypothesis_rms(h: Hypothesis) -> dict[str, float]:
    """Channel or constraint → normalised RMS with a hypothesis in the model."""
    return rms_by_channel(h.model, h.normalised) | rms_by_constraint(h.model, h.normalised)


def most_reduced_channel(h: Hypothesis, before: dict[str, float], after: dict[str, float]) -> str:
    """The channel whose mean square a hypothesis reduces most; a constraint only where no channel's falls.

    A constraint is one number or a few, which many hypotheses can meet.
    """
    fall = {name: before[name] ** 2 - after[name] ** 2 for name in before if np.isfinite(before[name] - after[name])}
    reduced = [name for name, _ in channels(h.model) if fall.get(name, 0.0) > 0.0]
    return max(reduced or fall, key=lambda name: fall[name])


def _discriminators(group: Sequence[Hypothesis]) -> dict[str, str]:
    """Label of each hypothesis after the first → what would distinguish it from the first."""
    return {h.label: _discriminator_text(group[0], h) for h in group[1:]}


def _discriminator_text(first: Hypothesis, second: Hypothesis | None = None) -> str:
    """What would distinguish two hypotheses, or a name from none."""
    model = first.model if second is None else second.model
    discriminator = best_discriminator(model, first.instance, None if second is None else second.instance)
    if discriminator is not None:
        return f"{discriminator.measurement} would distinguish them by {discriminator.evidence:.0f} nats"
    if second is None:
        return "no better knowledge of a single nuisance parameter or constraint would distinguish them"
    return "only a measurement of one of the two would distinguish them"


@dataclass(frozen=True)
class _Contender:
    """A hypothesis as the sentence of an undecided verdict names it."""

    text: str
    probability: float
    hypothesis: Hypothesis | None = None


_NONE, _SOMETHING_ELSE = "nothing is missing", "something outside the catalogue"


def _sentence(verdict: str, entries: list[Entry], none: float, something_else: float) -> str:
    if verdict == CLEAN:
        return "The flight is clean: model and measurement agree to the stated uncertainties, and no effect is missing."
    if verdict == UNKNOWN:
        return "Something is missing that no effect of the catalogue explains."
    names = [_Contender(" or ".join((e.hypothesis.label, *e.same_as)), e.probability, e.hypothesis) for e in entries]
    if verdict == MISSING:
        return f"Missing: {names[0].text} (gain {entries[0].hypothesis.gain:.0f} nats)."
    contenders = [_Contender(_NONE, none), _Contender(_SOMETHING_ELSE, something_else), *names]
    likely = sorted(contenders, key=lambda c: -c.probability)[:_CONTENDERS]
    texts = [f"{c.text} ({'' if k else 'probability '}{c.probability:.2f})" for k, c in enumerate(likely)]
    return f"Undecided: {', '.join(texts)}. {_deciding_sentence(likely[0], likely[1])}"


def _deciding_sentence(first: _Contender, second: _Contender) -> str:
    """What would decide between the two most probable hypotheses."""
    named = [c.hypothesis for c in (first, second) if c.hypothesis is not None]
    if not named:
        return "A calibration of the sensors' noise, or an effect that explains the residuals, would decide."
    if _SOMETHING_ELSE in (first.text, second.text):
        return f"A diagnosis of the model with {named[0].label} would show whether it leaves anything unexplained."
    text = _discriminator_text(*named)
    return f"{text[0].upper()}{text[1:]}."
