"""The loop in Python: what notebooks and scripts call, over the diagnosis's own functions.

Effects are given as a person has them at hand: names of the catalogue, classes, objects.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from edl_filter.effects.effect import Effect
from edl_filter.effects.loading import find_effect, known_effects, of_session
from edl_filter.errors import InputError

if TYPE_CHECKING:
    from edl_filter.diagnosis.diagnose import Diagnosis
    from edl_filter.diagnosis.improve import Step
    from edl_filter.mission import Mission
    from edl_filter.reconstruction import Reconstruction

Progress = Callable[[str], None]
Given = str | Effect | type[Effect]


class Catalogue(dict[str, Effect]):
    """Effects by name, shown as a table in a notebook."""

    def _repr_html_(self) -> str:
        from edl_filter.report.cards import catalogue_card

        return catalogue_card(self.values())


def catalogue() -> Catalogue:
    """Effects by name: the catalogue, and what installed packages bring.

    Raises
    ------
    InputError
        An installed package's effect cannot be used.
    """
    return Catalogue(known_effects())


def effect(name: str, file: str | Path | None = None) -> Effect:
    """One effect by name; ``effect(name).at(parameter=value)`` switches it on.

    Parameters
    ----------
    name : str
    file : path, optional
        Python file with effects of the user's.

    Raises
    ------
    InputError
        There is none of that name (the nearest are named), or the file cannot be used.
    """
    return find_effect(name, None if file is None else Path(file).expanduser())


def chosen(effects: Iterable[Given] | Given | None) -> list[Effect]:
    """Effects that a person names in one way or another; None is the whole catalogue, installed ones too.

    Raises
    ------
    InputError
        One is not known, or declared wrongly.
    """
    if effects is None:
        return list(known_effects().values())
    if isinstance(effects, (str, Effect, type)):
        effects = (effects,)
    found = [find_effect(e) if isinstance(e, str) else of_session(e) for e in effects]
    return list({e.name: e for e in found}.values())


def diagnose(
    of: Mission | Reconstruction,
    effects: Iterable[Given] | Given | None = None,
    progress: Progress | None = None,
) -> Diagnosis:
    """Say where a model fails, which effect is missing, and what is left.

    Parameters
    ----------
    of : Mission or Reconstruction
        A mission is reconstructed first, its effects as they are stated.
    effects : iterable of str, Effect or class, optional
        Only these may be missing; otherwise all that are known. None at all (``[]``) compares without trying any.
    progress : callable, optional
        Told what is being done, such as ``print``.

    Raises
    ------
    InputError
        The mission cannot be read, or has no database to compare with; an effect is not known.
    """
    from edl_filter.diagnosis.case import case_of, load_case
    from edl_filter.diagnosis.diagnose import diagnose as find
    from edl_filter.reconstruction import Reconstruction

    candidates, say = chosen(effects), progress or _silent
    if isinstance(of, Reconstruction):
        _predictable(of.mission)
        return find(case_of(of), candidates, say)
    _predictable(of)
    say("reconstructing")
    return find(load_case(of), candidates, say)


def refit(mission: Mission, progress: Progress | None = None) -> Reconstruction:
    """Reconstruct a mission with its effects at their most probable values, as ``edl-filter run`` does.

    One sigma of each is in the reconstruction's ``effect_sigma``. A mission without effects, or with all of them fixed,
    is reconstructed as it is.

    Raises
    ------
    InputError
        As `diagnose`; or an effect stands twice.
    """
    from edl_filter.diagnosis.settle import settle
    from edl_filter.reconstruction import reconstruct

    if all(a.fixed for a in mission.active_effects()):
        return reconstruct(mission)
    _predictable(mission)
    settled = settle(mission, progress or _silent)
    return replace(settled.reconstruction, effect_sigma=settled.sigma)


def improve(
    mission: Mission, effects: Iterable[Given] | Given | None = None, progress: Progress | None = None
) -> Iterator[Step]:
    """Diagnose, add what is missing, refit, and again until nothing earns its place; one `Step` for each turn.

    ``mission.with_effects(step.improved)`` is the mission of the next model.

    Parameters
    ----------
    mission : Mission
    effects, progress
        As `diagnose`.

    Raises
    ------
    InputError
        As `diagnose`.
    """
    from edl_filter.diagnosis.improve import improve as go_on

    _predictable(mission)
    return go_on(mission, chosen(effects), progress=progress or _silent)


def _predictable(mission: object) -> None:
    """Raise InputError where there is no mission, or one with nothing to predict the flight with."""
    from edl_filter.diagnosis.of_result import needs_prediction
    from edl_filter.mission import Mission

    if not isinstance(mission, Mission):
        raise InputError(f"found {type(mission).__name__}; expected a Mission, or a Reconstruction of one.")
    needs_prediction(mission, str(mission.source or mission.name))


def _silent(_: str) -> None:
    """Say nothing."""
