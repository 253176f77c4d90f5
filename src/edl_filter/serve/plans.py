"""Commands of each action of the page: the page displays them, and the worker runs them."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from edl_filter.effects.base import key_of
from edl_filter.errors import InputError
from edl_filter.io.output_folder import is_empty
from edl_filter.mission import Mission
from edl_filter.mission.files import write_mission
from edl_filter.mission.shipped import BUILTIN, shipped_mission, shipped_names
from edl_filter.mission.yaml_text import read_text
from edl_filter.results.files import AS_RUN
from edl_filter.results.reader import ResultReader
from edl_filter.serve.library import find_mission, find_result
from edl_filter.serve.safety import ForbiddenError, inside

#: Folder of new results.
RESULTS = "results"


@dataclass(frozen=True)
class Plan:
    """Commands of one action.

    Attributes
    ----------
    title : str
        Name of the action.
    commands : tuple of tuple of str
        Arguments of `edl-filter`, which runs in the served folder.
    result : str
        Folder of the result that the commands write; empty where they write none.
    """

    title: str
    commands: tuple[tuple[str, ...], ...]
    result: str

    def lines(self) -> list[str]:
        """The commands as lines for a shell."""
        return [shlex.join(("edl-filter", *c)) for c in self.commands]


def plan_run(root: Path, mission: str, diagnose: bool = True) -> Plan:
    """Plan to run a mission and, if `diagnose` is set, to diagnose its result.

    Raises
    ------
    ForbiddenError
        The path leads out of the folder.
    InputError
        The mission does not exist.
    """
    file = find_mission(root, mission)
    result = _free_result(root, f"{RESULTS}/{_stem(mission)}", file)
    run = ("run", _argument(mission), "-o", _argument(result))
    return Plan(f"Run {mission}", (run, _diagnose(result)) if diagnose else (run,), result)


def plan_diagnose(root: Path, result: str) -> Plan:
    """Plan to diagnose a result."""
    find_result(root, result)
    return Plan(f"Diagnose {result}", (_diagnose(result),), result)


def plan_improve(root: Path, mission: str) -> Plan:
    """Plan to improve a mission until no effect is accepted."""
    find_mission(root, mission)
    result = _free_result(root, f"{RESULTS}/{_stem(mission)}_improved", None)
    return Plan(f"Improve {mission}", (("improve", _argument(mission), "-o", _argument(result)),), result)


def plan_identifiability(root: Path, mission: str) -> Plan:
    """Plan to compute the smallest detectable size of each effect; no file is written."""
    find_mission(root, mission)
    return Plan(f"Detectable sizes of {mission}", (("identifiability", _argument(mission)),), "")


def plan_add(root: Path, result: str, label: str) -> Plan:
    """Plan to add an effect of a result's ranking to its mission, and to run and diagnose the new mission.

    Raises
    ------
    ForbiddenError
        A path leads out of the folder.
    InputError
        The result does not exist, or its diagnosis has no estimate of the effect.
    """
    diagnosis = find_result(root, result).diagnosis
    labels = [] if diagnosis is None else list(diagnosis.hypotheses())
    if label not in labels:
        raise InputError(
            f"{result}: found no estimate of {label!r}; it has estimates of {', '.join(labels) or 'none'}."
        )
    effect, imu = key_of(label)
    part = effect if imu is None else f"{effect}-{imu}"
    mission, _ = _mission_of(root, result)
    folder = PurePosixPath() if mission.startswith(BUILTIN) else PurePosixPath(mission).parent
    path = PurePosixPath(result)
    base = PurePosixPath(RESULTS) / root.name if path == PurePosixPath() else path
    for k in range(1, 1000):  # files of an earlier attempt are not replaced
        suffix = f"+{part}" + ("" if k == 1 else f"-{k}")
        new, output = str(folder / f"{_stem(mission)}{suffix}.yaml"), str(base.with_name(base.name + suffix))
        if not inside(root, new).exists() and not inside(root, output).exists():
            break
    of_imu = () if imu is None else ("--imu", imu)
    file = None if diagnosis is None or diagnosis.own_effects is None else diagnosis.own_effects.get(effect)
    own = ("--file", _argument(file)) if file is not None and (root / file).is_file() else ()
    add = ("add", _argument(mission), effect, *of_imu, *own, "--from", _argument(result), "-o", _argument(new))
    run = ("run", _argument(new), "-o", _argument(output))
    return Plan(f"Add {label} to {mission} and run it", (add, run, _diagnose(output)), output)


def plan_compare(results: Sequence[str]) -> Plan:
    """Plan to compare results, the one with the last model last."""
    return Plan(f"Compare {len(results)} results", (("compare", *map(_argument, results)),), results[-1])


def prepare_add(root: Path, result: str) -> None:
    """Write the mission of a result whose text differs from its file, so that a command can name it."""
    name, text = _mission_of(root, result)
    if text is not None:
        _, source = _mission_text_and_file(inside(root, result))
        mission = Mission.from_text(text, name, source)
        write_mission(mission, text, inside(root, name))


def _mission_of(root: Path, result: str) -> tuple[str, str | None]:
    """Name of a result's mission, and its text where no accessible file contains it; otherwise None."""
    text, source = _mission_text_and_file(inside(root, result))
    file = Path() if source is None else source.resolve()
    try:
        if file.is_file() and read_text(file) == text:
            if file.is_relative_to(root):
                return file.relative_to(root).as_posix(), None
            if file.stem in shipped_names() and shipped_mission(file.stem).resolve() == file:
                return BUILTIN + file.stem, None
    except (InputError, OSError):
        pass
    return str(PurePosixPath(result) / AS_RUN), text


def _mission_text_and_file(folder: Path) -> tuple[str, Path | None]:
    """Text of a result's mission, and the path of its file as the result states it."""
    with ResultReader.open(folder) as reader:
        file = reader.attribute("", "mission_file")
        return str(reader.attribute("", "mission_yaml", "")), None if file is None else Path(str(file))


def _free_result(root: Path, preferred: str, file: Path | None) -> str:
    """Folder of a new result: `preferred` if it is free or holds a result of the mission `file`, else with a number.

    A folder without any file is free: a cancelled command may have left it.
    """
    for k in range(1, 1000):
        name = preferred if k == 1 else f"{preferred}-{k}"
        folder = inside(root, name)
        if not folder.exists() or is_empty(folder):
            return name
        try:
            _, source = _mission_text_and_file(folder)
        except InputError:
            continue
        if file is not None and source is not None and source.resolve() == file.resolve():
            return name
    raise ForbiddenError(f"Refused: {preferred} and 999 more of that name are taken.")


def _diagnose(result: str) -> tuple[str, ...]:
    return ("diagnose", _argument(result))


def _stem(mission: str) -> str:
    return mission.removeprefix(BUILTIN) if mission.startswith(BUILTIN) else PurePosixPath(mission).stem


def _argument(name: str) -> str:
    """A name as an argument that no command interprets as an option."""
    return f"./{name}" if name.startswith("-") else name
