"""The verdict: clean, missing or unknown, and how probable each hypothesis is.

Evidence (nats) is compared among *none* (the model at its stated noise), every refitted effect, and *something else*
(the model with noise or a missing force and moment that nobody named), all equal before the data.

A name must gain more than `CLEAR`, in evidence and on held-out data. Where an unnamed force and moment explain more
than it does, two effects may be missing, and the unnamed one has both: then the name must explain a good part of it.
Where the mission calls its database exact, it must bring the channel that it lessens most to its noise, for the other
effect leaves some channel alone. And the channel that it takes most from must fall to a fifth at least, whatever the
unnamed explain. Or one more effect must explain all that it leaves (`together`). A database with an error of its own
leaves no channel at the noise, whatever is added.
Effects whose white signatures cannot be told apart are one hypothesis with several names.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from edl_filter.diagnosis.channel_errors import lessens_its_channel, mends_its_channel
from edl_filter.diagnosis.hypotheses import Hypothesis
from edl_filter.diagnosis.ranking import Ranking
from edl_filter.diagnosis.separating import parting
from edl_filter.diagnosis.trying import likeness
from edl_filter.effects.effect import Active

Array = NDArray[np.float64]

#: Gain that names an effect, nats: that of a detectable one (design section 6), and on a flight with unexplained noise.
CLEAR, CLEAR_IN_NOISE = 6.0, 12.0
#: Correlation of fitted signatures from which two names are one hypothesis, and the evidence that still parts them.
SAME, PARTED = 0.9, 6.0
#: Part of what an unnamed force and moment explain that a name must explain if it does not beat them.
SHARE = 0.05
#: Evidence that the model's noise is not what is stated, nats.
_NOISY = 10.0


@dataclass(frozen=True)
class Entry:
    """One row of the ranking.

    Attributes
    ----------
    hypothesis : Hypothesis
    others : tuple of Hypothesis
        Those that the flight does not tell from it.
    probability : float
    parted_by : dict
        Each of those names → what would part it from the first, in words.
    """

    hypothesis: Hypothesis
    others: tuple[Hypothesis, ...]
    probability: float
    parted_by: dict[str, str] = field(default_factory=dict)

    @property
    def same_as(self) -> tuple[str, ...]:
        """Names that the flight does not tell from the first."""
        return tuple(h.name for h in self.others)


@dataclass(frozen=True)
class Verdict:
    """What the ranking says.

    Attributes
    ----------
    verdict : str
        ``clean``, ``missing`` or ``unknown``.
    entries : list of Entry
        Most probable first.
    none, something_else : float
        Their probabilities.
    sentence : str
    doubted : Hypothesis or None
        The best name, where it gains enough and is turned away for what it leaves beside an exact database. With a
        partner that explains the rest it would stand.
    partner : Hypothesis or None
        That partner, refitted together with the leader, which stands by it.
    """

    verdict: str
    entries: list[Entry]
    none: float
    something_else: float
    sentence: str
    doubted: Hypothesis | None = None
    partner: Hypothesis | None = None

    @property
    def leader(self) -> Active | None:
        """The effect that is missing, with its estimate."""
        if self.verdict != "missing":
            return None
        return self.entries[0].hypothesis.active


def judge(ranking: Ranking, partner: Hypothesis | None = None) -> Verdict:
    """Probabilities and verdict.

    Parameters
    ----------
    ranking : Ranking
    partner : Hypothesis, optional
        One more effect that explains all that the best name leaves: then nothing is left for *something else*.
    """
    noisy = ranking.noise_evidence > _NOISY
    none = -ranking.noise_evidence if noisy else 0.0
    other = max(0.0, ranking.something_else) if noisy else ranking.something_else - CLEAR
    if partner is not None:
        other = -np.inf
    groups = grouped(ranking.hypotheses)
    evidence = np.array([none, other, *(g[0].gain for g in groups)])
    weight = np.exp(evidence - evidence.max())
    probability = weight / weight.sum()
    entries = [
        Entry(g[0], tuple(g[1:]), float(p), {h.name: parted(g[0], h) for h in g[1:]})
        for g, p in zip(groups, probability[2:], strict=True)
    ]
    need = CLEAR_IN_NOISE if noisy else CLEAR
    best = groups[0][0] if groups else None
    # a name stands against the noise that is left without it; a smooth missing force may pass for a true effect
    gains = best is not None and best.gain > need and best.score_gain > need
    exact = noisy and ranking.case.exact
    stands = best is not None and (best.at_floor or partner is not None or _stands(ranking, best, other, exact))
    named = gains and stands
    verdict = "missing" if named else "unknown" if noisy or other > 0.0 else "clean"
    return Verdict(
        verdict,
        entries,
        float(probability[0]),
        float(probability[1]),
        _words(verdict, entries, partner),
        doubted=best if exact and gains and not stands else None,
        partner=partner,
    )


def _stands(ranking: Ranking, best: Hypothesis, other: float, exact: bool) -> bool:
    """Whether a name that does not reach the noise is one all the same; `other` is what unnamed things explain."""
    if best.gain < other and not (best.gain > SHARE * other and (not exact or mends_its_channel(ranking.linear, best))):
        return False
    return not exact or lessens_its_channel(ranking.linear, best)


def grouped(hypotheses: list[Hypothesis]) -> list[list[Hypothesis]]:
    """Hypotheses that cannot be told apart, together; best first in and among the groups."""
    left, groups = sorted(hypotheses, key=lambda h: -h.gain), []
    while left:
        head, rest = left[0], left[1:]
        same = [h for h in rest if head.gain - h.gain < PARTED and likeness(head.explained, h.explained) > SAME]
        groups.append([head, *same])
        left = [h for h in rest if not any(h is s for s in same)]
    return groups


def parted(one: Hypothesis, other: Hypothesis) -> str:
    """What would part two names, in words."""
    found = parting(other.linear, one.active, other.active)
    if found is not None:
        return f"{found.remedy} would part them by {found.evidence:.0f} nats"
    return "no better knowledge of anything else would part them, only a measurement of one of the two itself"


def _words(verdict: str, entries: list[Entry], partner: Hypothesis | None) -> str:
    if verdict == "clean":
        return "The flight is clean: model and measurement agree to the stated noise, and no effect earns its place."
    if verdict == "unknown":
        return "Something is missing that none of the effects tried explains."
    e = entries[0]
    name = " or ".join((e.hypothesis.name, *e.same_as))
    beside = "" if partner is None else f" With {partner.name} besides, model and measurement would agree."
    return f"Missing: {name} (gain {e.hypothesis.gain:.0f} nats).{beside}"
