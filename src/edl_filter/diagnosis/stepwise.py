"""Stepwise improvement of a model: diagnose, add the missing effect, fit, and repeat.

Forward selection with backward elimination: an effect that was added before is removed where, with the new one in the
model, the evidence for it is less than that with which an effect is named. The first name may have stood for a part of
the second: a wind of 200 m/s, say, for air that does not rotate with the planet.

References: Klein and Morelli, Aircraft System Identification (2006), section 5.4 (stepwise regression).
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass

from edl_filter.diagnosis.diagnosis import Diagnosis, diagnose
from edl_filter.diagnosis.linear_model.flight_case import load_case
from edl_filter.diagnosis.selection.outer_loop import fit_effects
from edl_filter.diagnosis.selection.ranking import Progress
from edl_filter.effects.base import Effect, EffectInstance, EffectKey, effect_with_key
from edl_filter.mission import Mission
from edl_filter.results.verdicts import CLEAN


@dataclass(frozen=True)
class Step:
    """One step of the selection.

    Attributes
    ----------
    model : tuple of EffectInstance
        Effects in the model that was diagnosed.
    diagnosis : Diagnosis
    added : EffectInstance or None
        The effect by which the next model is larger.
    improved : tuple of EffectInstance
        The next model, all effects fitted together.
    removed : tuple of EffectInstance
        Effects of earlier steps that are not in the next model, at their last estimates.
    """

    model: tuple[EffectInstance, ...]
    diagnosis: Diagnosis
    added: EffectInstance | None
    improved: tuple[EffectInstance, ...]
    removed: tuple[EffectInstance, ...] = ()

    @property
    def why_stopped(self) -> str:
        """Why nothing was added; empty where an effect was."""
        if self.added is not None:
            return ""
        verdict = self.diagnosis.verdict
        if verdict.verdict == CLEAN:
            return "Stopped: model and measurement agree to the stated noise."
        best = verdict.entries[0].hypothesis if verdict.entries else None
        if verdict.leader is not None and best is not None:
            return (
                f"Stopped: the model still fails with {len(self.model)} effects, the largest number allowed; the next "
                f"would be {best.label} (gain {best.gain:.1f} nats). Some of these effects may represent something "
                "that is not in the catalogue: check each of them."
            )
        if best is None:
            return "Stopped: something is missing, and no effect of the catalogue explains any of it."
        return (
            "Stopped: something is missing that no effect of the catalogue explains; "
            f"the best, {best.label}, would gain {best.gain:.1f} nats and {best.score_gain:.1f} on held-out data."
        )


def improve(
    mission: Mission,
    candidates: Sequence[Effect],
    effects: Iterable[EffectInstance] | None = None,
    progress: Progress = lambda _: None,
) -> Iterator[Step]:
    """Improve a mission's model step by step.

    Parameters
    ----------
    mission : Mission
        The mission, checked.
    candidates : sequence of Effect
        Effects that may be missing.
    effects : iterable of EffectInstance, optional
        To begin with, instead of the mission's. Those that the mission does not have may be removed again.
    progress : callable
        Called with a text for each stage.

    Yields
    ------
    Step
        The last one has nothing added.
    """
    model = mission.active_effects() if effects is None else tuple(effects)
    limit = mission.diagnosis.max_effects
    kept = {a.key for a in mission.active_effects()}  # and those that come back after they were removed
    while True:  # an effect is removed at most once, so that the selection ends
        diagnosis = diagnose(load_case(mission, model), candidates, progress)
        leader = diagnosis.verdict.leader
        if leader is None or len(model) >= limit:
            yield Step(model, diagnosis, None, model)
            return
        fitted = diagnosis.verdict.entries[0].hypothesis.fit.effects
        improved, removed = _fit_without_superfluous(mission, fitted, kept | {leader.key}, progress)
        kept |= {a.key for a in removed}
        yield Step(model, diagnosis, leader, improved, removed)
        model = improved


def _fit_without_superfluous(
    mission: Mission, effects: Sequence[EffectInstance], kept: Collection[EffectKey], progress: Progress
) -> tuple[tuple[EffectInstance, ...], tuple[EffectInstance, ...]]:
    """Effects fitted together, and those of them that were removed: not `kept`, and with too small a gain."""
    removed: list[EffectInstance] = []
    while True:
        fitted = fit_effects(mission, progress, effects)
        remaining = fitted.reconstruction.effects
        gains = {key: gain for key, gain in fitted.gain_over_zero.items() if key not in kept}
        least = min(gains, key=lambda key: gains[key], default=None)
        if least is None or gains[least] >= mission.diagnosis.named_gain_nats:
            return remaining, tuple(removed)
        superfluous = effect_with_key(remaining, least)
        progress(f"removing {superfluous.label}")
        removed.append(superfluous)
        effects = tuple(a for a in remaining if a.key != least)
