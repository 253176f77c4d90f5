"""`edl-filter validate`: all that a run checks, and all problems instead of the first."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TypeVar

from edl_filter.errors import InputError
from edl_filter.io.output_folder import check_writable
from edl_filter.mission import Mission
from edl_filter.mission.edit_effects import without_code
from edl_filter.mission.problems import mission_problems
from edl_filter.pipeline.forward_model import damping_of, database_of
from edl_filter.pipeline.load import read_atmosphere, read_telemetry
from edl_filter.pipeline.reconstruct import assemble, reconstruct
from edl_filter.pipeline.trust import check_record
from edl_filter.planet import Planet
from edl_filter.planet.atmosphere import Atmosphere
from edl_filter.postflight.flight import derived_quantities
from edl_filter.telemetry.flight_file import flight_file_problems, read_flight_file
from edl_filter.telemetry.record import Telemetry
from edl_filter.telemetry.rest_drift import with_rest_drift
from edl_filter.telemetry.sample_repair import repaired
from edl_filter.workflow.run import check_output_names

Progress = Callable[[str], None]
T = TypeVar("T")


def validated_flight_file(path: Path) -> Telemetry:
    """Read a flight file and repair its samples, as a run does.

    Raises
    ------
    InputError
        It has problems; the message lists them.
    """
    raise_all(flight_file_problems(path))
    telemetry = with_rest_drift(read_flight_file(path))
    return repaired(telemetry, parachute=telemetry.events.get("parachute_deploy", math.inf))


def validated_mission(
    path: str | Path, overrides: Sequence[str] = (), progress: Progress = lambda _: None
) -> tuple[Mission, Telemetry]:
    """Check a mission, its files and its flight, as a run does; nothing is written.

    Parameters
    ----------
    path, overrides
        As in `Mission.load`.
    progress : callable
        Called with what is being done.

    Returns
    -------
    mission : Mission
        As it is stated; its effects from Python files are not checked.
    telemetry : Telemetry
        With repaired samples.

    Raises
    ------
    InputError
        There are problems; the message lists them. A part that depends on a wrong one is not checked.
    """
    raise_all(mission_problems(path, overrides))
    stated = Mission.load(path, overrides)
    mission = without_code(stated)  # a check runs no code of a mission
    progress("reading telemetry and tables")
    problems = _Problems()
    if mission.aerodynamics is not None:
        problems.of(lambda: database_of(mission))
        problems.of(lambda: damping_of(mission))
        if mission.vehicle.inertia is None:
            problems.messages.append(
                f"{mission.label}: vehicle.inertia: found nothing; aerodynamics needs it for the moments."
            )
    problems.of(mission.active_effects)
    problems.of(lambda: check_folder(mission.output_directory()))
    atmosphere = problems.of(lambda: read_atmosphere(mission))
    telemetry = problems.of(lambda: read_telemetry(mission))
    if telemetry is None and mission.telemetry.format == "flight-file":
        problems.of(lambda: raise_all(flight_file_problems(str(mission.telemetry_path()))))
    if telemetry is not None and atmosphere is not None:
        planet = problems.of(lambda: mission.planet_model(telemetry.prime_meridian_at_epoch))
        if planet is not None:
            _check_problem(mission, telemetry, planet, atmosphere, problems)
            problems.of(lambda: check_single_instances(mission, telemetry))
    raise_all(problems.messages)
    progress("reconstructing")
    # what is left can be seen in the trajectory only: windows without samples, a database that does not fit the flight
    reconstruction = reconstruct(mission, leave_one_out=False, recover=False)
    derived_quantities(reconstruction)
    return stated, reconstruction.telemetry  # with the samples of an IMU at fault replaced


def check_folder(folder: Path) -> None:
    """Raise InputError if a result cannot be written into a folder, which need not exist."""
    check_writable(folder)
    check_output_names(folder)


def check_single_instances(mission: Mission, telemetry: Telemetry) -> None:
    """Raise InputError if an effect that a run refits is listed twice."""
    from edl_filter.diagnosis.selection.outer_loop import can_fit_effects, check_single_instances

    if can_fit_effects(mission):
        check_single_instances(mission, mission.active_effects(), telemetry.driving)


def raise_all(problems: Sequence[str]) -> None:
    """Raise InputError with all problems, one per line; nothing happens where there is none."""
    unique = list(dict.fromkeys(problems))
    if len(unique) == 1:
        raise InputError(unique[0])
    if unique:
        raise InputError(f"{len(unique)} problems:\n" + "\n".join(f"  {message}" for message in unique))


class _Problems:
    """Messages of the checks that failed."""

    def __init__(self) -> None:
        self.messages: list[str] = []

    def of(self, check: Callable[[], T]) -> T | None:
        """Result of a check; None where it failed, whose message is added."""
        try:
            return check()
        except InputError as error:
            self.messages += [line.strip() for line in str(error).splitlines() if not line.endswith(" problems:")]
            return None


def _check_problem(
    mission: Mission, telemetry: Telemetry, planet: Planet, atmosphere: Atmosphere, problems: _Problems
) -> None:
    """Assemble the filter's problem and check the record; where that fails, each constraint is assembled alone."""
    try:
        problem = assemble(mission, telemetry, planet, atmosphere)
    except InputError as error:
        first = str(error)
    else:
        problems.of(lambda: check_record(mission, telemetry, planet, atmosphere, problem))
        return
    stated = mission.constraints
    for key in type(stated).model_fields:
        if getattr(stated, key) is not None:
            alone = stated.model_copy(update={k: None for k in type(stated).model_fields if k != key})
            reduced = mission.model_copy(update={"constraints": alone})
            problems.of(partial(assemble, reduced, telemetry, planet, atmosphere))
    if not problems.messages:
        problems.messages.append(first)
