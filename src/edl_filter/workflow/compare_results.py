"""`edl-filter compare`: results of one flight side by side, and how the error fell from the first to the last."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from edl_filter.diagnosis.of_result import needs_prediction
from edl_filter.errors import InputError
from edl_filter.results.outputs import DIAGNOSIS
from edl_filter.results.reopen import Reopened, reopen


def side_by_side(results: Sequence[Path]) -> dict[str, Any]:
    """Set results of one flight side by side.

    Parameters
    ----------
    results : sequence of Path
        Two or more, in the order of the work: ``result.nc`` or its folder.

    Returns
    -------
    dict
        ``results``: for each its path, mission, verdict (None if not diagnosed), effects with estimates, ``residuals``
        (channel → normalised RMS), ``nis_per_dof`` (constraint → number) and ``score_gain`` (held-out, of what it has
        more than the one before, where that one's diagnosis says it). ``fall_percent``: channel → fall from the first
        to the last, None where there is nothing to compare.

    Raises
    ------
    InputError
        Fewer than two results, one that cannot be read, or of another flight.
    """
    if len(results) < 2:
        raise InputError(f"compare: found {len(results)} result; two or more are expected.")
    opened = [reopen(r) for r in results]
    for other in opened[1:]:
        _same_flight(opened[0], other)
    diagnoses = [_diagnosis(r.folder) for r in opened]
    told = [_one(r, d) for r, d in zip(opened, diagnoses, strict=True)]
    for k in range(1, len(told)):
        told[k]["score_gain"] = _score_gain(diagnoses[k - 1], told[k - 1]["effects"], told[k]["effects"])
    first, last = told[0]["residuals"], told[-1]["residuals"]
    return {"results": told, "fall_percent": {c: _fall(first[c], last.get(c)) for c in first}}


def _same_flight(one: Reopened, other: Reopened) -> None:
    if one.checksums != other.checksums:
        raise InputError(
            f"{other.path}: found another flight than in {one.path}: its telemetry has another sha256 "
            f"({_short(other)} against {_short(one)}); results of one flight are expected."
        )


def _short(reopened: Reopened) -> str:
    return ", ".join(f"{name} {value[:8]}" for name, value in list(reopened.checksums.items())[:1]) or "none"


def _diagnosis(folder: Path) -> dict[str, Any] | None:
    path = folder / DIAGNOSIS
    if not path.is_file():
        return None
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
        return found if found["errors"] is not None and found["ranking"] is not None else None
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError(f"{path}: found no diagnosis ({error!r}); run 'edl-filter diagnose' again.") from None


def _one(r: Reopened, diagnosis: dict[str, Any] | None) -> dict[str, Any]:
    return {
        "path": str(r.path),
        "mission": r.mission.name,
        "verdict": None if diagnosis is None else diagnosis["verdict"],
        "effects": r.told["effects"],
        "residuals": _residuals(r, diagnosis),
        "nis_per_dof": _nis(r),
        "score_gain": None,
    }


def _residuals(r: Reopened, diagnosis: dict[str, Any] | None) -> dict[str, float]:
    """Normalised RMS over the flight: as diagnosed, as run, or compared now."""
    if diagnosis is not None:
        return dict(diagnosis["errors"])
    found = r.told["residuals"]
    if not found:
        from edl_filter.diagnosis.residuals import residuals
        from edl_filter.reconstruction import reconstruct

        needs_prediction(r.mission, str(r.path))
        reconstruction = reconstruct(r.mission, r.effects)
        r.check_same_flight(reconstruction)
        found = residuals(reconstruction)
    return {channel: by_regime["overall"] for channel, by_regime in found.items()}


def _nis(r: Reopened) -> dict[str, float]:
    """Sum of every constraint's NIS over its degrees of freedom."""
    from edl_filter.results.netcdf import load

    groups = {path.removeprefix("/constraints/"): g for path, g in load(r.path).items() if "nis_total" in g.attrs}
    return {n: float(g.attrs["nis_total"] / g.attrs["dof"]) if g.attrs["dof"] else math.nan for n, g in groups.items()}


def _score_gain(before: dict[str, Any] | None, old: dict[str, Any], new: dict[str, Any]) -> float | None:
    """Held-out gain of the one effect that is new, where the diagnosis before it has one."""
    added = [name for name in new if name not in old]
    if before is None or len(added) != 1:
        return None
    for entry in before["ranking"]:
        if added[0] == entry["effect"]:
            return float(entry["score_gain"])
    return None


def _fall(before: float | None, after: float | None) -> float | None:
    if before is None or after is None or not before > 0.0:
        return None
    return 100.0 * (1.0 - after / before)
