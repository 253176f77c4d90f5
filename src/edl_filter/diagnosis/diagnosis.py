"""Diagnosis of one flight: where the model fails, which effect is missing, what is left; and this as plain data."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from edl_filter.aero.increments import SYMBOLS, DatabaseUpdate
from edl_filter.diagnosis.linear_model.flight_case import DiscrepancyEstimate, FlightCase
from edl_filter.diagnosis.noise.unmodelled_acceleration import largest_sigmas
from edl_filter.diagnosis.residual_analysis.change_point import Onset, onsets
from edl_filter.diagnosis.residual_analysis.database_update import estimate_database_update
from edl_filter.diagnosis.residual_analysis.nuisance_shifts import NuisanceShift, nuisance_shifts
from edl_filter.diagnosis.residual_analysis.residual_map import (
    Cell,
    failing_cells,
    model_rms,
    residual_map,
    residual_series,
)
from edl_filter.diagnosis.residual_analysis.unexplained import (
    LatentForce,
    Remainder,
    describe_remainder,
    estimate_latent_force,
)
from edl_filter.diagnosis.selection.decision import (
    Entry,
    Verdict,
    decide,
    hypothesis_rms,
    most_reduced_channel,
)
from edl_filter.diagnosis.selection.evidence_profile import evidence_profile
from edl_filter.diagnosis.selection.hypothesis import Hypothesis
from edl_filter.diagnosis.selection.ranking import Progress, Ranking, rank
from edl_filter.diagnosis.selection.screening import ScreeningResult
from edl_filter.diagnosis.state import improvement_with, state_sentences
from edl_filter.display import render
from edl_filter.effects.base import Effect, EffectInstance, label_of
from edl_filter.results.files import DATABASE_UPDATE, finite
from edl_filter.results.netcdf import tree_of
from edl_filter.results.verdicts import UNKNOWN

if TYPE_CHECKING:
    from xarray import DataArray, Dataset

#: Quantile of the standard normal distribution at 97.5 %, to which the mean square of many residuals is close.
_NORMAL_QUANTILE = 1.96


@dataclass(frozen=True)
class Diagnosis:
    """What is wrong with a model, and what would improve it.

    Attributes
    ----------
    mission : str
        Name.
    effects : tuple of str
        Labels of those in the model already.
    cells : list of Cell
        The residual map.
    verdict : Verdict
    ranking : Ranking
    remainder : Remainder or None
        Described where the verdict is ``unknown``.
    latent : LatentForce or None
        Unmodelled force and moment against time, in the same case.
    onsets : list of Onset
        When channels begin to fail, clearest first.
    errors : dict
        Channel → normalised RMS over the flight, as the model is.
    noise_floor : float
        Normalised RMS that chance allows over the flight: its 97.5 % point.
    update : DatabaseUpdate or None
        Estimated increments of the database, with the model as it is; None with an exact database.
    shifts : tuple of NuisanceShift
        Nuisance parameters that the flight moves away from what the mission states.
    """

    mission: str
    effects: tuple[str, ...]
    cells: list[Cell]
    verdict: Verdict
    ranking: Ranking
    remainder: Remainder | None
    latent: LatentForce | None
    onsets: list[Onset]
    errors: dict[str, float]
    noise_floor: float
    update: DatabaseUpdate | None
    shifts: tuple[NuisanceShift, ...]

    @property
    def title(self) -> str:
        """Name of the flight, for people."""
        mission = self.ranking.case.mission
        return mission.title or mission.name

    @property
    def database_proxy(self) -> str | None:
        """For what the aerodynamic database of the mission is a proxy; None where it is the vehicle's own."""
        aerodynamics = self.ranking.case.mission.aerodynamics
        return None if aerodynamics is None else aerodynamics.proxy

    @cached_property
    def state(self) -> tuple[str, ...]:
        """How much fails, the verdict, what the leading effect reduces, and what qualifies that: one sentence each."""
        minimum_rms = self.ranking.case.settings.cell_minimum_rms
        return state_sentences(self.cells, self.verdict, self.errors, self.database_proxy, minimum_rms)

    @property
    def leader(self) -> EffectInstance | None:
        """The effect that is missing, with its estimate; None unless the verdict is ``missing``."""
        return self.verdict.leader

    @cached_property
    def residuals(self) -> Dataset:
        """Residuals against time: ``residual``, ``sigma`` and ``normalised`` by ``channel`` and ``time``."""
        return tree_of(residual_series(self.ranking.model)).to_dataset()

    def scan(
        self,
        effect: str | Effect | type[Effect],
        place: str | None = None,
        values: Sequence[float] | None = None,
    ) -> DataArray:
        """Evidence of an effect at every place that it may have; see `selection.evidence_profile`."""
        return evidence_profile(self.ranking.model, effect, place, values)

    def content(self) -> dict[str, Any]:
        """All that ``diagnosis.json`` holds; numbers that are not finite are None."""
        verdict, ranking, remainder, latent = self.verdict, self.ranking, self.remainder, self.latent
        force, angular_acceleration, rate = largest_sigmas(ranking.model.residuals.flow, ranking.unmodelled)
        content = {
            "verdict": verdict.verdict,
            "sentence": verdict.sentence,
            "state": list(self.state),
            "database_proxy": self.database_proxy,
            "mission": self.mission,
            "effects": list(self.effects),
            "where": [_cell(c) for c in failing_cells(self.cells)],
            "map": [_cell(c) for c in self.cells],
            "ranking": [_entry(e, self.errors) for e in verdict.entries],
            "required_gain": verdict.required_gain,
            "none": verdict.none,
            "none_gain": 0.0 - max(ranking.excess_noise_gain, ranking.nuisance_gain, 0.0),
            "something_else": {
                "probability": verdict.something_else,
                "gain": verdict.something_else_gain,
                "unmodelled_gain": ranking.unmodelled_gain,
                "form": ranking.unmodelled.form.value,
                "force_m_s2": force,
                "angular_acceleration_rad_s2": angular_acceleration,
                "rate_rad_s": rate,
                "correlation_time_s": ranking.unmodelled.memory,
                "with_dynamic_pressure": ranking.unmodelled.with_pressure,
            },
            "screening": {
                label_of(key): {"gain": r.gain, "parameters": _screened_parameters(r, verdict.required_gain)}
                for key, r in ranking.screening.items()
            },
            "remainder": None
            if remainder is None
            else {
                "channel": remainder.channel, "t0_s": remainder.t0, "t1_s": remainder.t1,
                "normalised_rms": remainder.rms, "size": remainder.size, "unit": remainder.unit,
                "frequency_hz": remainder.frequency, "follows": remainder.follows,
                "companions": list(remainder.companions), "description": remainder.description,
            },
            "latent": None
            if latent is None
            else {
                "time_s": latent.time.tolist(), "force_N": latent.force.tolist(),
                "force_sigma_N": latent.force_sigma.tolist(), "moment_N_m": latent.moment.tolist(),
                "moment_sigma_N_m": latent.moment_sigma.tolist(),
            },
            "onsets": [{"channel": o.channel, "time_s": o.time, "gain": o.gain} for o in self.onsets],
            "failed": ranking.failed,
            "errors": self.errors,
            "noise_floor": self.noise_floor,
            "database_update": None if self.update is None else _update(self.update),
            "discrepancy_estimate": _discrepancy(ranking.case.discrepancy_estimate),
            "nuisances": [
                {"name": s.name, "sigmas": s.sigmas, "value": s.value, "unit": s.unit} for s in self.shifts
            ],
            "settings": ranking.case.settings.model_dump(),
        }  # fmt: skip
        return dict(finite(content))

    @property
    def plot(self) -> Any:
        """Figures: ``diagnosis.plot.heatmap()`` and so on return matplotlib axes."""
        return render("plot", self)

    def __repr__(self) -> str:
        return f"<Diagnosis of {self.mission}: {' '.join(self.state[:2])}>"

    def _repr_html_(self) -> str:
        return str(render("html", self))


def diagnose(case: FlightCase, candidates: Iterable[Effect], progress: Progress = lambda _: None) -> Diagnosis:
    """Diagnose a flight.

    Parameters
    ----------
    case : FlightCase
        The flight with what its mission states as uncertain.
    candidates : iterable of Effect
        What may be missing; those in the model are passed over, or offered once more if they act at a place.
    progress : callable
        Called with what is being done.
    """
    ranking = rank(case, candidates, progress)
    verdict = decide(ranking)
    progress("describing what is left")
    model, unknown = ranking.model, verdict.verdict == UNKNOWN
    update = estimate_database_update(model)
    return Diagnosis(
        mission=case.mission.name,
        effects=tuple(a.label for a in case.effects),
        cells=residual_map(model),
        verdict=verdict,
        ranking=ranking,
        remainder=describe_remainder(model) if unknown else None,
        latent=estimate_latent_force(model, ranking.unmodelled) if unknown else None,
        onsets=onsets(model),
        errors=model_rms(model),
        noise_floor=float(np.sqrt(1.0 + _NORMAL_QUANTILE * np.sqrt(2.0 / model.index.count))),
        update=update,
        shifts=nuisance_shifts(model, update),
    )


def _discrepancy(estimate: DiscrepancyEstimate | None) -> dict[str, Any] | None:
    if estimate is None:
        return None
    return {
        "gain": estimate.gain,
        "quantities": {
            q.name: {"stated": q.stated, "estimate": q.estimate, "low": q.low, "high": q.high, "at_bound": q.at_bound}
            for q in estimate.quantities
        },
    }


def _update(update: DatabaseUpdate) -> dict[str, Any]:
    return {
        "file": DATABASE_UPDATE,
        "cells": update.cells,
        "largest": {
            SYMBOLS[i.coefficient]: {
                "sigmas": i.sigmas, "increment": i.increment, "sigma": i.sigma,
                "mach": i.node if i.regime == "mach" else None, "knudsen": i.node if i.regime == "knudsen" else None,
                "alpha_deg": float(np.degrees(i.alpha)),
            }
            for i in update.largest()
        },
    }  # fmt: skip


def _cell(c: Cell) -> dict[str, Any]:
    return {
        "channel": c.channel, "regime": c.regime, "t0_s": c.t0, "t1_s": c.t1, "normalised_rms": c.rms, "bias": c.bias,
        "autocorrelation": c.autocorrelation, "excess_rms": c.physical, "unit": c.unit,
        "over_database_sigma": c.over_database_sigma,
        "count": c.count, "limit_rms": c.limit, "fails": c.fails, "sentence": c.sentence,
    }  # fmt: skip


def _screened_parameters(result: ScreeningResult, required_gain: float) -> dict[str, Any]:
    fit, smallest = result.fit, result.smallest_sizes(required_gain)
    posterior = np.sqrt(np.diag(fit.covariance))
    columns = zip(result.jacobian.names, fit.estimate, posterior, fit.data_share, result.jacobian.sigma, strict=True)
    return {
        n: {
            "estimate": float(v), "sigma": float(s), "data_share": float(d), "plausible": float(prior),
            "smallest": smallest[n],
        }
        for n, v, s, d, prior in columns
    }  # fmt: skip


def _parameters(h: Hypothesis, instance: EffectInstance) -> dict[str, Any]:
    units = {q.name: q.unit for q in instance.effect.parameters}
    estimates = h.fit.parameters(instance.key)
    return {n: {"estimate": v, "sigma": s, "unit": units[n]} for n, (v, s) in estimates.items()}


def _entry(entry: Entry, before: dict[str, float]) -> dict[str, Any]:
    h = entry.hypothesis
    after, improvement = hypothesis_rms(h), improvement_with(h)
    channel = most_reduced_channel(h, before, after)
    return {
        "effect": h.name,
        "imu": h.key[1],
        "label": h.label,
        "same_as": list(entry.same_as),
        "alternatives": {a.label: {"parameters": _parameters(a, a.instance)} for a in entry.indistinguishable},
        "discriminated_by": entry.discriminated_by,
        "probability": entry.probability,
        "gain": h.gain,
        "score_gain": h.score_gain,
        "at_noise_floor": h.at_floor,
        "explained_share": h.explained_share,
        "complemented": h.complemented,
        "parameters": _parameters(h, h.instance),
        "correlations": _correlations(h),
        "error_before": before[channel],
        "error_after": after[channel],
        "channel": channel,
        "errors_after": after,
        "cells_after": improvement.cells,
        "cells_failing_after": improvement.failing,
    }


def _correlations(h: Hypothesis) -> dict[str, float]:
    """Posterior correlations of all parameters; the label of another effect in the model is before the name."""
    sigma = h.fit.parameter_sigma
    names = [q if key == h.key else f"{label_of(key)} {q}" for key, q in h.fit.names]
    return {
        f"{names[j]}, {names[i]}": float(h.fit.covariance[i, j] / (sigma[i] * sigma[j]))
        for i in range(len(names))
        for j in range(i)
    }
