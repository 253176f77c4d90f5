"""`edl-filter compare`: results of one flight side by side, and the fall of their residuals."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from edl_filter.errors import InputError
from edl_filter.mission.mission import require_prediction_inputs
from edl_filter.results.files import DIAGNOSIS, read_diagnosis
from edl_filter.results.reader import ResultReader
from edl_filter.results.reopen import Reopened, reopen

if TYPE_CHECKING:
    from edl_filter.results.schema import DiagnosisContent


def compare_results(results: Sequence[Path]) -> dict[str, Any]:
    """Compare results of one flight.

    Parameters
    ----------
    results : sequence of Path
        Two or more, in the order in which they were made: ``result.nc`` or its folder.

    Returns
    -------
    dict
        ``results``: for each its path, mission, headline (why it is not to be trusted, or None), verdict (None if not
        diagnosed), effects with estimates, ``residuals``
        (channel → normalised RMS), ``minimum_rms`` (normalised RMS below which no channel fails: that of its diagnosis,
        or of its mission), ``nis_per_dof`` (constraint → number) and ``score_gain`` (held-out, of the effect that it
        has more than the one before, where that one's diagnosis contains it). ``fall_percent``: channel → fall
        from the first to the last, None where there is nothing to compare.

    Raises
    ------
    InputError
        Fewer than two results, one that cannot be read, or of another flight.
    """
    if len(results) < 2:
        raise InputError(f"compare: found {len(results)} result; two or more are expected.")
    opened = [reopen(r) for r in results]
    for later in opened[1:]:
        _check_same_flight(opened[0], later)
    diagnoses = [read_diagnosis(r.folder) if (r.folder / DIAGNOSIS).is_file() else None for r in opened]
    columns = [_column(r, d) for r, d in zip(opened, diagnoses, strict=True)]
    for k in range(1, len(columns)):
        columns[k]["score_gain"] = _score_gain(diagnoses[k - 1], columns[k - 1]["effects"], columns[k]["effects"])
    first, last = columns[0]["residuals"], columns[-1]["residuals"]
    return {"results": columns, "fall_percent": {c: _fall_percent(first[c], last.get(c)) for c in first}}


def _check_same_flight(first: Reopened, later: Reopened) -> None:
    if first.checksums != later.checksums:
        raise InputError(
            f"{later.path}: found another flight than in {first.path}: its telemetry has another sha256 "
            f"({_short_checksum(later)} against {_short_checksum(first)}); results of one flight are expected."
        )


def _short_checksum(reopened: Reopened) -> str:
    return ", ".join(f"{name} {value[:8]}" for name, value in list(reopened.checksums.items())[:1]) or "none"


def _column(r: Reopened, diagnosis: DiagnosisContent | None) -> dict[str, Any]:
    return {
        "path": str(r.path),
        "mission": r.mission.name,
        "headline": r.headline,
        "verdict": None if diagnosis is None else diagnosis.verdict,
        "effects": r.effects_content,
        "residuals": _overall_rms(r, diagnosis),
        "minimum_rms": (r.mission.diagnosis if diagnosis is None else diagnosis.settings).cell_minimum_rms,
        "nis_per_dof": _nis_per_dof(r),
        "score_gain": None,
    }


def _overall_rms(r: Reopened, diagnosis: DiagnosisContent | None) -> dict[str, float | None]:
    """Normalised RMS over the flight, of the diagnosis or of the run; otherwise computed as these compute it."""
    if diagnosis is not None:
        return dict(diagnosis.errors)
    residuals = r.residuals
    if not residuals:
        from edl_filter.diagnosis.linear_model.credible_model import credible_model
        from edl_filter.diagnosis.linear_model.flight_case import load_case
        from edl_filter.diagnosis.residual_analysis.residual_map import rms_by_regime

        require_prediction_inputs(r.mission, str(r.path))
        case = load_case(r.mission, r.effects)
        r.check_same_flight(case.reconstruction)
        residuals = rms_by_regime(credible_model(case)[0])
    return {channel: by_regime["overall"] for channel, by_regime in residuals.items()}


def _nis_per_dof(r: Reopened) -> dict[str, float]:
    """Sum of every constraint's NIS over its degrees of freedom."""
    with ResultReader.open(r.path) as reader:
        sums = {name: group.attrs for name, group in reader.constraints.items() if "nis_total" in group.attrs}
    return {n: float(a["nis_total"] / a["dof"]) if a["dof"] else math.nan for n, a in sums.items()}


def _score_gain(before: DiagnosisContent | None, old: dict[str, Any], new: dict[str, Any]) -> float | None:
    """Held-out gain of the one effect that is new, where the diagnosis before it contains it."""
    added = [name for name in new if name not in old]
    if before is None or len(added) != 1:
        return None
    return next((h.score_gain for h in before.ranking if h.label == added[0]), None)


def _fall_percent(before: float | None, after: float | None) -> float | None:
    if before is None or after is None or not before > 0.0:
        return None
    return 100.0 * (1.0 - after / before)
