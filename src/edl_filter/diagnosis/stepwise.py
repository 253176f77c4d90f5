"""The loop: diagnose, add what is missing, refit, and again, until nothing earns its place."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

from edl_filter.diagnosis.case import load_case
from edl_filter.diagnosis.diagnose import Diagnosis, diagnose
from edl_filter.diagnosis.ranking import Progress
from edl_filter.diagnosis.settle import settle
from edl_filter.effects.effect import Active, Effect
from edl_filter.mission import Mission

#: Effects in a model at which the loop ends though more would earn their place: it then needs a person.
MOST = 12


@dataclass(frozen=True)
class Step:
    """One turn of the loop.

    Attributes
    ----------
    model : tuple of Active
        Effects in the model that was diagnosed.
    diagnosis : Diagnosis
    added : Active or None
        What the next model has more.
    improved : tuple of Active
        The next model, all effects refitted together.
    """

    model: tuple[Active, ...]
    diagnosis: Diagnosis
    added: Active | None
    improved: tuple[Active, ...]

    @property
    def why_stopped(self) -> str:
        """Why nothing was added; empty where something was."""
        if self.added is not None:
            return ""
        if self.diagnosis.verdict.verdict == "clean":
            return "Stopped: model and measurement agree to the noise."
        best = self.diagnosis.verdict.entries[0].hypothesis if self.diagnosis.verdict.entries else None
        if self.diagnosis.verdict.leader is not None and best is not None:
            return (
                f"Stopped: the model still fails with {len(self.model)} effects, which is as many as are tried; the "
                f"next would be {best.name} (gain {best.gain:.1f} nats). Some of them may stand for something else: "
                "what they are and what they mend is for a person to judge."
            )
        if best is None:
            return "Stopped: something is missing, and none of the effects tried explains any of it."
        return (
            "Stopped: something is missing that none of the effects tried explains; "
            f"the best, {best.name}, would gain {best.gain:.1f} nats and {best.score_gain:.1f} on held-out data."
        )


def improve(
    mission: Mission,
    candidates: Sequence[Effect],
    effects: Iterable[Active] | None = None,
    progress: Progress = lambda _: None,
) -> Iterator[Step]:
    """Improve a mission's model step by step.

    Parameters
    ----------
    mission : Mission
    candidates : sequence of Effect
    effects : iterable of Active, optional
        To begin with, instead of the mission's.
    progress : callable

    Yields
    ------
    Step
        The last one has nothing added.
    """
    model = mission.active_effects() if effects is None else tuple(effects)
    for _ in range(MOST + 1):
        found = diagnose(load_case(mission, model), candidates, progress)
        leader = found.verdict.leader
        if leader is None or len(model) >= MOST:
            yield Step(model, found, None, model)
            return
        improved = settle(mission, progress, found.verdict.entries[0].hypothesis.refit.effects).reconstruction.effects
        yield Step(model, found, leader, improved)
        model = improved
