"""Diagnosis and improvement of a model in Python, for notebooks and scripts.

In: missions, results, and effects as names of the catalogue, classes or objects. Out: diagnoses, results and steps.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from edl_filter.display import render
from edl_filter.effects.base import Effect
from edl_filter.effects.registry import find_effect, known_effects
from edl_filter.errors import InputError
from edl_filter.mission.edit_effects import EffectLike, resolve_effect
from edl_filter.mission.mission import Mission, require_prediction_inputs

if TYPE_CHECKING:
    from edl_filter.diagnosis.diagnosis import Diagnosis
    from edl_filter.diagnosis.stepwise import Step
    from edl_filter.results.result import Result

Progress = Callable[[str], None]


class Catalogue(dict[str, Effect]):
    """Effects by name, displayed as a table in a notebook."""

    def _repr_html_(self) -> str:
        return str(render("html", self))


def catalogue() -> Catalogue:
    """Return the effects of the catalogue and of installed packages, by name.

    Raises
    ------
    InputError
        An installed package's effect cannot be used.
    """
    return Catalogue(known_effects())


def effect(name: str, file: str | Path | None = None) -> Effect:
    """Return one effect; ``effect(name).at(parameter=value)`` switches it on.

    Parameters
    ----------
    name : str
        Name of the effect.
    file : path, optional
        Python file with effects of the user.

    Raises
    ------
    InputError
        No effect has that name (the message has the nearest names), or the file cannot be used.
    """
    return find_effect(name, None if file is None else Path(file).expanduser())


def resolve_effects(effects: Iterable[EffectLike] | EffectLike | None) -> list[Effect]:
    """Return effects from names, classes and objects; None returns the catalogue and those of installed packages.

    Raises
    ------
    InputError
        An effect does not exist or is declared wrongly.
    """
    if effects is None:
        return list(known_effects().values())
    if isinstance(effects, (str, Effect, type)):
        effects = (effects,)
    return list({e.name: e for e in map(resolve_effect, effects)}.values())


def diagnose(
    mission_or_result: Mission | Result,
    effects: Iterable[EffectLike] | EffectLike | None = None,
    progress: Progress | None = None,
) -> Diagnosis:
    """Determine where a model fails, which effect is missing, and what remains unexplained.

    Parameters
    ----------
    mission_or_result : Mission or Result
        A mission is reconstructed first, with its effects at their stated values.
    effects : iterable of str, Effect or class, optional
        Candidate effects; by default all of the catalogue and of installed packages. An empty list compares model and
        measurement without testing any effect.
    progress : callable, optional
        Called with a description of each step; for example ``print``.

    Returns
    -------
    Diagnosis
        Residual map, ranking of the effects, verdict and unexplained remainder.

    Raises
    ------
    InputError
        The mission cannot be read or has no aerodynamic database; an effect does not exist.
    """
    from edl_filter.diagnosis.diagnosis import diagnose as diagnose_case
    from edl_filter.diagnosis.linear_model.flight_case import flight_case, load_case
    from edl_filter.results.result import Result

    candidates, report_progress = resolve_effects(effects), progress or _no_progress
    if isinstance(mission_or_result, Result):
        _check_mission(mission_or_result.mission)
        reconstruction = mission_or_result.reconstruction
        if reconstruction.recovery is None:
            return diagnose_case(flight_case(reconstruction), candidates, report_progress)
        case = load_case(reconstruction.mission, reconstruction.effects)  # without noise that would hide an effect
        return diagnose_case(case, candidates, report_progress)
    _check_mission(mission_or_result)
    report_progress("reconstructing")
    return diagnose_case(load_case(mission_or_result), candidates, report_progress)


def refit(mission: Mission, progress: Progress | None = None) -> Result:
    """Reconstruct a mission with its effects at their most probable values, as ``edl-filter run`` does.

    Parameters
    ----------
    mission : Mission
        A mission without effects, or with fixed effects only, is reconstructed with the stated values.
    progress : callable, optional
        As `diagnose`.

    Returns
    -------
    Result
        Its ``refit.sigma`` has one sigma of each parameter.

    Raises
    ------
    InputError
        As `diagnose`; or an effect is listed twice.
    """
    from edl_filter.diagnosis.selection.outer_loop import fit_effects
    from edl_filter.results.result import Result, reconstruct
    from edl_filter.results.summary import RefitSummary

    if all(a.fixed for a in mission.active_effects()):
        return reconstruct(mission)
    _check_mission(mission)
    fitted = fit_effects(mission, progress or _no_progress)
    return Result(fitted.reconstruction, RefitSummary(fitted.sigma))


def improve(
    mission: Mission, effects: Iterable[EffectLike] | EffectLike | None = None, progress: Progress | None = None
) -> Iterator[Step]:
    """Diagnose, add the missing effect and refit, until no effect is accepted (stepwise selection).

    ``with_effects(mission, step.improved)`` is the mission of the next model.

    Parameters
    ----------
    mission : Mission
        Mission with the initial model.
    effects, progress
        As `diagnose`.

    Yields
    ------
    Step
        One per diagnosis; the last adds no effect.

    Raises
    ------
    InputError
        As `diagnose`.
    """
    from edl_filter.diagnosis.stepwise import improve as improve_stepwise

    _check_mission(mission)
    return improve_stepwise(mission, resolve_effects(effects), progress=progress or _no_progress)


def _check_mission(mission: object) -> None:
    """Raise InputError if `mission` is no `Mission`, or lacks the sections from which a flight is predicted."""
    if not isinstance(mission, Mission):
        raise InputError(f"found {type(mission).__name__}; expected a Mission, or a Result of one.")
    require_prediction_inputs(mission)


def _no_progress(_: str) -> None:
    """Ignore a progress message."""
