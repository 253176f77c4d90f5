"""The model without a further effect: what the gains of all hypotheses are over.

Its own effects are refitted as every hypothesis refits them, and what their sizes cost in evidence stands on both
sides. Otherwise each of them would make all further ones less probable by what its prior costs, some eight nats a size.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from edl_filter.diagnosis.linear import Linear
from edl_filter.diagnosis.refit import refit
from edl_filter.effects.effect import Active

#: Steps of the refit at most: the model's effects have been refitted when they were added.
_STEPS = 3


@dataclass(frozen=True)
class Without:
    """The model as it is, at its most likely.

    Attributes
    ----------
    evidence : float
        As a refit's, at the noise that the model shows, nats.
    likelihood : float
        Without priors, nats.
    rough : float
        Part of the rows that are rough where the model fails.
    """

    evidence: float
    likelihood: float
    rough: float


def without_more(linears: Sequence[Linear], effects: Sequence[Active]) -> Without:
    """The model about the path where it is most probable.

    Parameters
    ----------
    linears : sequence of Linear
        About different paths; the first is where it may fail.
    effects : sequence of Active
        The model's.

    Returns
    -------
    Without
    """

    def about(linear: Linear) -> Without:
        kept = refit(linear, effects, linear.soft, steps=_STEPS, moving=linear.holds)
        volume = linear.ground.volume(kept.effects)
        likelihood = linear.soft.log_likelihood(kept.white) + volume
        return Without(kept.evidence, likelihood, linears[0].share)

    return max((about(x) for x in linears), key=lambda w: w.evidence)
