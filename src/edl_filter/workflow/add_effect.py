"""`edl-filter add`: a mission with one effect more, with starting values from a diagnosis."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from edl_filter.effects.base import EffectKey, label_of
from edl_filter.errors import InputError
from edl_filter.mission import edit_effects


def add_effect(
    mission: str,
    name: str,
    output: Path | None = None,
    changes: Sequence[str] = (),
    result: Path | None = None,
    imu: str | None = None,
    file: str | None = None,
) -> Path:
    """Write a mission file with the effect `name` at the end of its ``effects:``; returns the file.

    Parameters
    ----------
    mission, name, output, changes, imu, file
        As in `edl_filter.mission.edit_effects.add_effect`.
    result : Path, optional
        Folder of a result, or its ``diagnosis.json``: starting values are its estimates.

    Raises
    ------
    InputError
        As `edl_filter.mission.edit_effects.add_effect`; or there is no diagnosis, or no estimate of the effect in it.
    """
    estimates = {} if result is None else estimates_of(result, (name, imu))
    return edit_effects.add_effect(mission, name, output, changes, estimates, imu, file)


def estimates_of(result: Path, key: EffectKey) -> dict[str, float]:
    """An effect's estimates in a diagnosis, to 8 digits.

    Parameters
    ----------
    result : Path
        ``diagnosis.json``, or its folder.
    key : (str, str or None)
        Name of the effect, and its IMU.

    Raises
    ------
    InputError
        There is no diagnosis, it violates its schema, or it has no estimate of the effect.
    """
    # imported only where there is a result: they take longer than the rest of the command
    from edl_filter.results.files import DIAGNOSIS, read_diagnosis

    hypotheses = read_diagnosis(result).hypotheses()
    hypothesis = hypotheses.get(label_of(key))
    if hypothesis is None:
        path = result / DIAGNOSIS if result.is_dir() else result
        names = ", ".join(hypotheses) or "none"
        raise InputError(f"{path}: found no estimate of {label_of(key)}; it has estimates of {names}.")
    estimates = {p: e.estimate for p, e in hypothesis.parameters.items()}
    return {p: float(f"{x:.8g}") for p, x in estimates.items() if x is not None}
