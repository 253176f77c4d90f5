"""Two effects at once: whether a name that leaves something unexplained stands with one more beside it.

Where two effects are missing, the right name of one leaves the other's mark, and the rules that keep a wrong name from
standing for something outside the catalogue (`verdict`) may turn it away. Whether there is such a thing is found out by
asking again with the name in the model: if one more effect then brings the flight to its noise, nothing unknown is
left.
"""

from __future__ import annotations

from collections.abc import Sequence

from edl_filter.diagnosis.case import load_case
from edl_filter.diagnosis.hypotheses import Hypothesis
from edl_filter.diagnosis.ranking import Progress, rank
from edl_filter.diagnosis.verdict import judge
from edl_filter.effects.again import kind_of
from edl_filter.effects.effect import Effect

#: A first name whose sizes are all within so many sigmas of zero beside its partner is not needed.
_NEEDED = 5.0


def partner_of(first: Hypothesis, candidates: Sequence[Effect], progress: Progress) -> Hypothesis | None:
    """The effect that explains all that a hypothesis leaves, or None.

    Parameters
    ----------
    first : Hypothesis
    candidates : sequence of Effect
    progress : callable
        Told what is being done.

    Returns
    -------
    Hypothesis or None
        Refitted together with the first: it is named about the model that has the first, leaves next to no noise beyond
        the stated one, and does not do without the first.
    """
    held = load_case(first.case.mission, first.refit.effects)
    own = kind_of(first.active.effect)
    others = [e for e in candidates if kind_of(e) != own]  # two of one kind may copy what neither is
    verdict = judge(rank(held, others, lambda said: progress(f"with {first.name}: {said}")))
    if verdict.leader is None:
        return None
    second = verdict.entries[0].hypothesis
    return second if second.at_floor and _needed(first, second) else None


def _needed(first: Hypothesis, second: Hypothesis) -> bool:
    """Whether the first has a size beside the second."""
    together = second.refit.parameters(first.name)
    return any(abs(together[q.name][0]) > _NEEDED * together[q.name][1] for q in first.active.effect.sizes)
