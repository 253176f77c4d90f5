"""Diagnosis of one flight: where the model fails, which effect is missing, what is left."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from edl_filter.diagnosis.case import Case
from edl_filter.diagnosis.channel_errors import errors_of, errors_with, most_lessened
from edl_filter.diagnosis.hypotheses import Hypothesis
from edl_filter.diagnosis.latent import Latent, estimate
from edl_filter.diagnosis.ranking import Progress, Ranking, rank
from edl_filter.diagnosis.remainder import Remainder, describe
from edl_filter.diagnosis.together import partner_of
from edl_filter.diagnosis.trying import Trial
from edl_filter.diagnosis.verdict import Entry, Verdict, judge
from edl_filter.diagnosis.where import Cell, Onset, failures, onsets, survey
from edl_filter.effects.effect import Active, Effect

if TYPE_CHECKING:
    from xarray import DataArray, Dataset

    from edl_filter.report.plots import DiagnosisPlots

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Diagnosis:
    """What is wrong with a model, and what would mend it.

    Attributes
    ----------
    mission : str
        Name.
    effects : tuple of str
        In the model already.
    cells : list of Cell
    verdict : Verdict
    ranking : Ranking
    remainder : Remainder or None
        Described where nothing in the catalogue explains it.
    latent : Latent or None
        Missing force and moment against time, in the same case.
    onsets : list of Onset
        When channels begin to fail, clearest first.
    errors : dict
        Channel → normalised RMS over the flight, as the model is.
    noise_floor : float
        Normalised RMS that chance allows over the flight: its 97.5 % point.
    """

    mission: str
    effects: tuple[str, ...]
    cells: list[Cell]
    verdict: Verdict
    ranking: Ranking
    remainder: Remainder | None
    latent: Latent | None
    onsets: list[Onset]
    errors: dict[str, float]
    noise_floor: float

    @property
    def title(self) -> str:
        """Name of the flight, for people."""
        mission = self.ranking.case.mission
        return mission.title or mission.name

    @property
    def leader(self) -> Active | None:
        """The effect that is missing, with its estimate; None unless the verdict is ``missing``."""
        return self.verdict.leader

    @cached_property
    def residuals(self) -> Dataset:
        """Residuals against time: ``residual``, ``sigma`` and ``normalised`` by ``channel`` and ``time`` (`series`)."""
        from edl_filter.diagnosis.series import residual_series
        from edl_filter.results.netcdf import tree_of

        return tree_of(residual_series(self.ranking.linear)).to_dataset()

    def scan(
        self,
        effect: str | Effect | type[Effect],
        place: str | None = None,
        values: Sequence[float] | None = None,
    ) -> DataArray:
        """Evidence for an effect at every place that it may have; see `edl_filter.diagnosis.scan.scan`."""
        from edl_filter.diagnosis.scan import scan

        return scan(self.ranking.linear, effect, place, values)

    @property
    def plot(self) -> DiagnosisPlots:
        """Figures: ``diagnosis.plot.heatmap()`` and so on give matplotlib axes."""
        from edl_filter.report.plots import DiagnosisPlots

        return DiagnosisPlots(self)

    def __repr__(self) -> str:
        return f"<Diagnosis of {self.mission}: {self.verdict.sentence}>"

    def _repr_html_(self) -> str:
        from edl_filter.report.cards import diagnosis_card

        return diagnosis_card(self)

    def content(self) -> dict[str, Any]:
        """What ``diagnosis.json`` holds."""
        verdict, ranking = self.verdict, self.ranking
        left = self.remainder
        return {
            "verdict": verdict.verdict,
            "sentence": verdict.sentence,
            "partner": None if verdict.partner is None else _partner(verdict.partner),
            "mission": self.mission,
            "effects": list(self.effects),
            "where": [_cell(c) for c in failures(self.cells)],
            "map": [_cell(c) for c in self.cells],
            "ranking": [_entry(e, self.errors) for e in verdict.entries],
            "none": verdict.none,
            "none_gain": 0.0 if ranking.noise_evidence <= 0.0 else -ranking.noise_evidence,
            "something_else": {
                "probability": verdict.something_else,
                "score_gain": ranking.something_else,
                "force_m_s2": ranking.missing.force,
                "angular_acceleration_rad_s2": ranking.missing.moment,
                "memory_s": ranking.missing.memory,
                "with_dynamic_pressure": ranking.missing.with_pressure,
            },
            "undecided": {
                name: {"gain": t.gain, "parameters": _trial(t)} for name, t in ranking.trials.items()
            },
            "remainder": None
            if left is None
            else {
                "channel": left.channel, "t0_s": left.t0, "t1_s": left.t1, "normalised_rms": left.rms,
                "size": left.size, "unit": left.unit, "frequency_hz": left.frequency, "follows": left.follows,
                "companions": list(left.companions), "description": left.description,
            },
            "latent": None if self.latent is None else {
                "time_s": self.latent.time.tolist(), "force_N": self.latent.force.tolist(),
                "force_sigma_N": self.latent.force_sigma.tolist(), "moment_N_m": self.latent.moment.tolist(),
                "moment_sigma_N_m": self.latent.moment_sigma.tolist(),
            },
            "onsets": [{"channel": o.channel, "time_s": o.time, "gain": o.gain} for o in self.onsets],
            "failed": ranking.failed,
            "errors": self.errors,
            "noise_floor": self.noise_floor,
        }  # fmt: skip


def diagnose(case: Case, candidates: Iterable[Effect], progress: Progress = lambda _: None) -> Diagnosis:
    """Diagnose a flight.

    Parameters
    ----------
    case : Case
    candidates : iterable of Effect
        What may be missing; those in the model are passed over, or tried once more if they act at a place.
    progress : callable
        Told what is being done.
    """
    effects = list(candidates)
    ranking = rank(case, effects, progress)
    verdict = judge(ranking)
    if verdict.doubted is not None:
        partner = partner_of(verdict.doubted, effects, progress)
        verdict = verdict if partner is None else judge(ranking, partner)
    progress("describing what is left")
    count = ranking.linear.ground.order.count
    return Diagnosis(
        mission=case.mission.name,
        effects=tuple(a.name for a in case.effects),
        cells=survey(ranking.linear),
        verdict=verdict,
        ranking=ranking,
        remainder=describe(ranking.linear) if verdict.verdict == "unknown" else None,
        latent=estimate(ranking.linear, ranking.missing) if verdict.verdict == "unknown" else None,
        onsets=onsets(ranking.linear),
        errors=errors_of(ranking.linear),
        noise_floor=float(np.sqrt(1.0 + 1.96 * np.sqrt(2.0 / count))),
    )


def _cell(c: Cell) -> dict[str, Any]:
    return {
        "channel": c.channel, "regime": c.regime, "t0_s": c.t0, "t1_s": c.t1, "normalised_rms": c.rms, "bias": c.bias,
        "autocorrelation": c.autocorrelation, "beyond_noise": c.physical, "unit": c.unit,
        "over_database_sigma": c.matters, "count": c.count, "fails": c.fails, "sentence": c.sentence,
    }  # fmt: skip


def _trial(trial: Trial) -> dict[str, Any]:
    spread = np.sqrt(np.diag(trial.fit.covariance))
    return {
        n: {"estimate": float(v), "sigma": float(s), "data_share": float(d)}
        for n, v, s, d in zip(trial.signature.names, trial.fit.size, spread, trial.fit.data_share, strict=True)
    }


def _partner(h: Hypothesis) -> dict[str, Any]:
    """The leader's partner, and the estimates of all effects of that model together."""
    return {"effect": h.name, "together": {a.name: _parameters(h, a) for a in h.refit.effects}}


def _parameters(h: Hypothesis, active: Active) -> dict[str, Any]:
    units = {q.name: q.unit for q in active.effect.parameters}
    found = h.refit.parameters(active.name)
    return {n: {"estimate": v, "sigma": s, "unit": units[n]} for n, (v, s) in found.items()}


def _entry(entry: Entry, before: dict[str, float]) -> dict[str, Any]:
    h = entry.hypothesis
    after = errors_with(h)
    channel = most_lessened(h, before, after)
    return {
        "effect": h.name,
        "same_as": list(entry.same_as),
        "alternatives": {other.name: {"parameters": _parameters(other, other.active)} for other in entry.others},
        "parted_by": entry.parted_by,
        "probability": entry.probability,
        "gain": h.gain,
        "score_gain": h.score_gain,
        "at_noise_floor": h.at_floor,
        "parameters": _parameters(h, h.active),
        "correlations": _correlations(h),
        "error_before": before[channel],
        "error_after": after[channel],
        "channel": channel,
        "errors_after": after,
    }


def _correlations(h: Hypothesis) -> dict[str, float]:
    """Of all sizes; those of other effects in the model have the effect before the name."""
    spread = np.sqrt(np.diag(h.refit.covariance))
    name = [q if effect == h.name else f"{effect} {q}" for effect, q in h.refit.names]
    found = {}
    for i in range(len(name)):
        for j in range(i):
            found[f"{name[j]}, {name[i]}"] = float(h.refit.covariance[i, j] / (spread[i] * spread[j]))
    return found
