"""The content of ``diagnosis.json``: a diagnosis as plain data."""

from __future__ import annotations

from typing import Any

import numpy as np

from edl_filter.aero.increments import SYMBOLS, DatabaseUpdate
from edl_filter.diagnosis.diagnosis import Diagnosis
from edl_filter.diagnosis.linear_model.flight_case import DiscrepancyEstimate
from edl_filter.diagnosis.residual_analysis.residual_map import Cell, failing_cells
from edl_filter.diagnosis.selection.decision import Entry, hypothesis_rms, most_reduced_channel
from edl_filter.diagnosis.selection.hypothesis import Hypothesis
from edl_filter.diagnosis.selection.screening import ScreeningResult
from edl_filter.diagnosis.state import improvement_with
from edl_filter.effects.base import EffectInstance, label_of
from edl_filter.results.files import DATABASE_UPDATE, finite


def diagnosis_content(diagnosis: Diagnosis) -> dict[str, Any]:
    """All that ``diagnosis.json`` holds; numbers that are not finite are None."""
    verdict, ranking, remainder, latent = (
        diagnosis.verdict,
        diagnosis.ranking,
        diagnosis.remainder,
        diagnosis.latent,
    )
    content = {
        "verdict": verdict.verdict,
        "sentence": verdict.sentence,
        "state": list(diagnosis.state),
        "database_proxy": diagnosis.database_proxy,
        "mission": diagnosis.mission,
        "effects": list(diagnosis.effects),
        "where": [_cell(c) for c in failing_cells(diagnosis.cells)],
        "map": [_cell(c) for c in diagnosis.cells],
        "ranking": [_entry(e, diagnosis.errors) for e in verdict.entries],
        "required_gain": verdict.required_gain,
        "none": verdict.none,
        "none_gain": 0.0 - max(ranking.excess_noise_gain, ranking.nuisance_gain, 0.0),
        "something_else": {
            "probability": verdict.something_else,
            "gain": ranking.unmodelled_gain,
            "force_m_s2": ranking.unmodelled.force,
            "angular_acceleration_rad_s2": ranking.unmodelled.moment,
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
            "channel": remainder.channel, "t0_s": remainder.t0, "t1_s": remainder.t1, "normalised_rms": remainder.rms,
            "size": remainder.size, "unit": remainder.unit, "frequency_hz": remainder.frequency,
            "follows": remainder.follows, "companions": list(remainder.companions),
            "description": remainder.description,
        },
        "latent": None
        if latent is None
        else {
            "time_s": latent.time.tolist(), "force_N": latent.force.tolist(),
            "force_sigma_N": latent.force_sigma.tolist(), "moment_N_m": latent.moment.tolist(),
            "moment_sigma_N_m": latent.moment_sigma.tolist(),
        },
        "onsets": [{"channel": o.channel, "time_s": o.time, "gain": o.gain} for o in diagnosis.onsets],
        "failed": ranking.failed,
        "errors": diagnosis.errors,
        "noise_floor": diagnosis.noise_floor,
        "database_update": None if diagnosis.update is None else _update(diagnosis.update),
        "discrepancy_estimate": _discrepancy(ranking.case.discrepancy_estimate),
        "nuisances": [
            {"name": s.name, "sigmas": s.sigmas, "value": s.value, "unit": s.unit} for s in diagnosis.shifts
        ],
        "settings": ranking.case.settings.model_dump(),
    }  # fmt: skip
    return dict(finite(content))


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
