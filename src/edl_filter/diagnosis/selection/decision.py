"""Decision: probabilities of all hypotheses, and the verdict, which is a function of them.

Hypotheses, with their log evidence E in nats over the model as it is:

none
    The model holds at its stated noise. E = 0, or minus the evidence for excess noise where that is significant.
name
    One effect of the catalogue is missing, alone or together with an unmodelled acceleration.
    E = min(gain, held-out gain) - c; with the unmodelled acceleration E = joint gain - c.
something else
    Excess noise (E = 0 where it is significant) or an unmodelled acceleration, E = gain - c.

c is the prior cost of a hypothesis that is not the reference (log prior odds), `named_gain_nats`, or
`named_gain_in_excess_noise_nats` where the noise is not what is stated (Kass and Raftery, JASA 90 (1995) 773). The
probabilities are the normalised exponentials; the verdict is that of the most probable hypothesis: ``clean``,
``missing`` or ``unknown``.

A name is *accepted* only if it leaves hardly any excess variance, or if it explains a good part of what the unmodelled
acceleration explains. With an exact database it must in addition bring the channel that it reduces by the largest
factor to its noise, and reduce the channel from which it removes most to a fifth, since a second missing effect usually
leaves some channel alone; or a second effect must explain all that it leaves (`find_joint_effect`). A name that is not
accepted represents something that is not in the catalogue: its probability is limited to that of something else divided
by the exponential of c. A database with an error of its own leaves no channel at its noise, whatever is added. Effects
whose white columns cannot be distinguished are one hypothesis with several names.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from edl_filter.diagnosis.linear_model.flight_case import load_case
from edl_filter.diagnosis.linear_model.linear_model import LinearizedModel
from edl_filter.diagnosis.noise.variance_components import estimate_variance_components
from edl_filter.diagnosis.residual_analysis.channel_rms import (
    channels,
    normalised_innovations,
    rms_by_channel,
    rms_by_constraint,
)
from edl_filter.diagnosis.selection.disambiguation import best_discriminator
from edl_filter.diagnosis.selection.hypothesis import Hypothesis
from edl_filter.diagnosis.selection.map_fit import fit_map
from edl_filter.diagnosis.selection.ranking import Progress, Ranking, rank
from edl_filter.diagnosis.selection.screening import correlation
from edl_filter.effects.base import Effect, EffectInstance
from edl_filter.effects.instances import kind_of
from edl_filter.mission.decision_settings import DecisionSettings
from edl_filter.types import Array

CLEAN, MISSING, UNKNOWN = "clean", "missing", "unknown"


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
        ``clean``, ``missing`` or ``unknown``: `verdict_of` the probabilities.
    entries : list of Entry
        Most probable first.
    none, something_else : float
        Their probabilities.
    required_gain : float
        Gain that a name needs, nats: c of this module.
    sentence : str
    provisional : Hypothesis or None
        The best name, where it gains enough and is not accepted for what it leaves with an exact database, and no other
        name is missing. With a second effect that explains the rest it would be accepted.
    partner : Hypothesis or None
        That second effect, fitted together with the first name of the ranking.
    """

    verdict: str
    entries: list[Entry]
    none: float
    something_else: float
    required_gain: float
    sentence: str
    provisional: Hypothesis | None = None
    partner: Hypothesis | None = None

    @property
    def leader(self) -> EffectInstance | None:
        """The effect that is missing, with its estimate; None unless the verdict is ``missing``."""
        return self.entries[0].hypothesis.instance if self.verdict == MISSING else None


def verdict_of(names: Sequence[float], none: float, something_else: float) -> str:
    """The verdict that probabilities imply: that of the most probable hypothesis.

    Parameters
    ----------
    names : sequence of float
        Probabilities of the named hypotheses.
    none, something_else : float
        Probabilities that nothing is missing, and that something outside the catalogue is.
    """
    best = max(names, default=0.0)
    if best > max(none, something_else):
        return MISSING
    return UNKNOWN if something_else > none else CLEAN


def decide(ranking: Ranking, partner: Hypothesis | None = None) -> Verdict:
    """Probabilities and verdict.

    Parameters
    ----------
    ranking : Ranking
        All hypotheses about one model.
    partner : Hypothesis, optional
        A second effect that explains all that the best name leaves; nothing is then left for something else.
    """
    settings = ranking.case.settings
    noisy = ranking.excess_noise_gain > settings.excess_noise_nats
    cost = settings.named_gain_in_excess_noise_nats if noisy else settings.named_gain_nats
    none = -ranking.excess_noise_gain if noisy else 0.0
    something_else = 0.0 if noisy else ranking.unmodelled_gain - cost
    groups = group_indistinguishable(ranking.hypotheses, settings)
    evidence = [min(group[0].gain, group[0].score_gain) - cost for group in groups]
    log_weight = np.array([none, something_else, *evidence])
    weight = np.exp(log_weight - log_weight.max())
    probability = weight / weight.sum()
    entries = [
        Entry(g[0], tuple(g[1:]), float(p), {h.label: _discriminator_text(g[0], h) for h in g[1:]})
        for g, p in zip(groups, probability[2:], strict=True)
    ]
    entries.sort(key=lambda e: -e.probability)
    verdict = verdict_of([e.probability for e in entries], float(probability[0]), float(probability[1]))
    return Verdict(
        verdict,
        entries,
        float(probability[0]),
        float(probability[1]),
        cost,
        _sentence(verdict, entries, partner),
    )


def joint_gain(ranking: Ranking, h: Hypothesis) -> float:
    """Evidence of a name together with an unmodelled acceleration, over the model without both, nats."""
    model = h.model
    _, whiten = estimate_variance_components(
        model.filter_with_unmodelled(ranking.unmodelled),
        model.index,
        h.fit.residual_vector,
        h.fit.initial_mean,
        model.settings,
        model.failing_excess,
    )
    steps = model.settings.polish_fit_iterations
    return fit_map(model, h.fit.effects, whiten, steps=steps).evidence - h.null.evidence


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
    normalised = _normalised_with(h)
    return rms_by_channel(h.model, normalised) | rms_by_constraint(h.model, normalised)


def most_reduced_channel(h: Hypothesis, before: dict[str, float], after: dict[str, float]) -> str:
    """The channel whose mean square a hypothesis reduces most; a constraint only where no channel's falls.

    A constraint is one number or a few, which many hypotheses can meet.
    """
    fall = {name: before[name] ** 2 - after[name] ** 2 for name in before if np.isfinite(before[name] - after[name])}
    reduced = [name for name, _ in channels(h.model) if fall.get(name, 0.0) > 0.0]
    return max(reduced or fall, key=lambda name: fall[name])


def explains_its_channel(model: LinearizedModel, h: Hypothesis) -> bool:
    """Whether the channel that a hypothesis reduces by the largest factor fails without it and not with it."""
    s = model.settings
    before, after = max(_rms_pairs(model, h), key=lambda pair: pair[0] / pair[1], default=(1.0, 1.0))
    remaining = 1.0 - s.channel_explained_share
    return before > s.channel_fails_rms >= after and after**2 - 1.0 < remaining * (before**2 - 1.0)


def reduces_its_channel(model: LinearizedModel, h: Hypothesis) -> bool:
    """Whether the channel from which a hypothesis removes most fails without it, and falls to a small part with it."""
    s = model.settings
    before, after = max(_rms_pairs(model, h), key=lambda pair: pair[0] ** 2 - pair[1] ** 2, default=(1.0, 1.0))
    return before > s.channel_fails_rms and after < s.channel_remaining_share * before


def find_joint_effect(first: Hypothesis, candidates: Sequence[Effect], progress: Progress) -> Hypothesis | None:
    """The second effect that explains all that a hypothesis leaves, or None.

    Where two effects are missing, the right name of one leaves the residuals of the other, and the rules that keep a
    wrong name from representing something outside the catalogue may reject it. The diagnosis is repeated with the name
    in the model: if a second effect then brings the residuals to their noise, nothing unknown is left.

    Parameters
    ----------
    first : Hypothesis
        The first effect, fitted.
    candidates : sequence of Effect
        Effects that may be missing.
    progress : callable
        Called with what is being done.

    Returns
    -------
    Hypothesis or None
        Fitted together with the first: it is named about the model that has the first, leaves hardly any excess
        variance, and the first is still significant.
    """
    case = load_case(first.case.mission, first.fit.effects)
    own_kind = kind_of(first.instance.effect)
    # two effects of one kind may imitate what neither is
    different = [e for e in candidates if kind_of(e) != own_kind]
    verdict = decide(rank(case, different, lambda step: progress(f"with {first.label}: {step}")))
    if verdict.leader is None:
        return None
    second = verdict.entries[0].hypothesis
    return second if second.at_floor and _is_significant(first, second) else None


def _is_significant(first: Hypothesis, second: Hypothesis) -> bool:
    """Whether a size of the first differs from zero in the fit of both."""
    limit = first.case.settings.joint_effect_sigmas
    joint = second.fit.parameters(first.key)
    return any(abs(joint[q.name][0]) > limit * joint[q.name][1] for q in first.instance.effect.sizes)


def _is_accepted(ranking: Ranking, best: Hypothesis, exact: bool) -> bool:
    """Whether a name is accepted by the rules of this module."""
    if best.at_floor:
        return True
    settings, unmodelled = ranking.case.settings, max(0.0, ranking.unmodelled_gain)
    if best.gain < unmodelled:
        partial = best.gain > settings.partial_gain_share * unmodelled
        if not (partial and (not exact or explains_its_channel(ranking.model, best))):
            return False
    return not exact or reduces_its_channel(ranking.model, best)


def _rms_pairs(model: LinearizedModel, h: Hypothesis) -> list[tuple[float, float]]:
    """RMS without and with a hypothesis, of every channel of forces, moments and other IMUs."""
    before = rms_by_channel(model, normalised_innovations(model))
    after = rms_by_channel(h.model, _normalised_with(h))
    return [(before[name], after[name]) for name in before if name in after]


def _normalised_with(h: Hypothesis) -> Array:
    return h.whiten.innovations(h.fit.white) / h.model.stated_noise_filter.innovation_sigma


def _discriminator_text(first: Hypothesis, second: Hypothesis) -> str:
    discriminator = best_discriminator(second.model, first.instance, second.instance)
    if discriminator is not None:
        return f"{discriminator.measurement} would distinguish them by {discriminator.evidence:.0f} nats"
    return "only a measurement of one of the two would distinguish them"


def _sentence(verdict: str, entries: list[Entry], partner: Hypothesis | None) -> str:
    if verdict == CLEAN:
        return "The flight is clean: model and measurement agree to the stated noise, and no effect is needed."
    if verdict == UNKNOWN:
        return "Something is missing that no effect of the catalogue explains."
    e = entries[0]
    name = " or ".join((e.hypothesis.label, *e.same_as))
    both = "" if partner is None else f" With {partner.label} in addition, model and measurement agree."
    return f"Missing: {name} (gain {e.hypothesis.gain:.0f} nats).{both}"
