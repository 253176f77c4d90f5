"""Which commands a click means. What the page shows to copy, and what is run, both come from here."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from edl_filter.diagnosis.of_result import AS_RUN
from edl_filter.errors import InputError
from edl_filter.mission import Mission
from edl_filter.mission.adding import by_name
from edl_filter.mission.mission import BUILTIN, shipped_mission, shipped_names
from edl_filter.mission.naming import write_mission
from edl_filter.mission.text import read_text
from edl_filter.results.netcdf import attributes
from edl_filter.serve.library import find_mission, find_result
from edl_filter.serve.safety import ForbiddenError, inside

RESULTS = "results"


@dataclass(frozen=True)
class Plan:
    """Commands of a click.

    Attributes
    ----------
    title : str
        What is done, for a person.
    commands : tuple of tuple of str
        Arguments of `edl-filter`, from the served folder.
    result : str
        Folder of the result that is there at the end.
    """

    title: str
    commands: tuple[tuple[str, ...], ...]
    result: str

    def lines(self) -> list[str]:
        """The commands as a person types them."""
        return [shlex.join(("edl-filter", *c)) for c in self.commands]


def plan_run(root: Path, mission: str, diagnose: bool = True) -> Plan:
    """Run a mission and, if wanted, diagnose its result.

    Raises
    ------
    ForbiddenError
        The path leads out of the folder.
    InputError
        There is no such mission.
    """
    file = find_mission(root, mission)
    result = _free_result(root, f"{RESULTS}/{_stem(mission)}", file)
    run = ("run", _plain(mission), "-o", _plain(result))
    return Plan(f"Run {mission}", (run, _diagnose(result)) if diagnose else (run,), result)


def plan_diagnose(root: Path, result: str) -> Plan:
    """Diagnose a result."""
    find_result(root, result)
    return Plan(f"Diagnose {result}", (_diagnose(result),), result)


def plan_add(root: Path, result: str, effect: str) -> Plan:
    """Add an effect of a result's ranking to its mission, run that and diagnose it.

    Raises
    ------
    ForbiddenError
        A path leads out of the folder.
    InputError
        There is no such result, or its diagnosis has no such hypothesis.
    """
    told = find_result(root, result).diagnosis
    names = [] if told is None else list(by_name(told["ranking"]))
    if effect not in names:
        raise InputError(
            f"{result}: found no estimate of {effect!r}; it has estimates of {', '.join(names) or 'none'}."
        )
    mission, _ = _mission_of(root, result)
    folder = PurePosixPath() if mission.startswith(BUILTIN) else PurePosixPath(mission).parent
    at = PurePosixPath(result)
    beside = PurePosixPath(RESULTS) / root.name if at == PurePosixPath() else at
    for k in range(1, 1000):  # an earlier attempt stays as it is
        end = f"+{effect}" + ("" if k == 1 else f"-{k}")
        new, output = str(folder / f"{_stem(mission)}{end}.yaml"), str(beside.with_name(beside.name + end))
        if not inside(root, new).exists() and not inside(root, output).exists():
            break
    add = ("add", _plain(mission), effect, "--from", _plain(result), "-o", _plain(new))
    run = ("run", _plain(new), "-o", _plain(output))
    return Plan(f"Add {effect} to {mission} and run it", (add, run, _diagnose(output)), output)


def plan_compare(way: Sequence[str]) -> Plan:
    """Set the results of a way side by side."""
    return Plan(f"Compare {len(way)} results", (("compare", *map(_plain, way)),), way[-1])


def prepare_add(root: Path, result: str) -> None:
    """Write the mission of a result that was run with changes, so that a command can name it."""
    name, text = _mission_of(root, result)
    if text is not None:
        source = attributes(inside(root, f"{result}/result.nc")).get("mission_file")
        mission = Mission.from_text(text, name, None if source is None else Path(str(source)))
        write_mission(mission, text, inside(root, name))


def _mission_of(root: Path, result: str) -> tuple[str, str | None]:
    """Name of a result's mission; and its text where no file that may be named says it any more."""
    attrs = attributes(inside(root, f"{result}/result.nc"))
    text, source = str(attrs["mission_yaml"]), attrs.get("mission_file")
    file = Path() if source is None else Path(str(source)).resolve()
    try:
        if file.is_file() and read_text(file) == text:
            if file.is_relative_to(root):
                return file.relative_to(root).as_posix(), None
            if file.stem in shipped_names() and shipped_mission(file.stem).resolve() == file:
                return BUILTIN + file.stem, None
    except (InputError, OSError):
        pass
    return str(PurePosixPath(result) / AS_RUN), text


def _free_result(root: Path, wanted: str, file: Path) -> str:
    """A result's folder: `wanted` if it is new or of the same mission file, else with a number."""
    for k in range(1, 1000):
        name = wanted if k == 1 else f"{wanted}-{k}"
        folder = inside(root, name)
        if not folder.exists():
            return name
        try:
            source = attributes(folder).get("mission_file")
        except InputError:
            continue
        if source is not None and Path(str(source)).resolve() == file.resolve():
            return name
    raise ForbiddenError(f"Refused: {wanted} and 999 more of that name are taken.")


def _diagnose(result: str) -> tuple[str, ...]:
    return ("diagnose", _plain(result))


def _stem(mission: str) -> str:
    return mission.removeprefix(BUILTIN) if mission.startswith(BUILTIN) else PurePosixPath(mission).stem


def _plain(name: str) -> str:
    """A name that no command takes for an option."""
    return f"./{name}" if name.startswith("-") else name
