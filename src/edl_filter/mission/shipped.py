"""Missions, scenarios and data that the package ships, named ``builtin:NAME``."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

from edl_filter.errors import InputError

BUILTIN = "builtin:"
_DATA_SUFFIXES = (".csv", ".h5")
#: Flight files that the package ships: name → mission that runs them, and description.
SHIPPED_FLIGHTS = {
    "practice_06": ("practice_mer", "practice flight, MER-like vehicle"),
    "unknown_1": ("practice_mer", "practice flight with a hidden effect"),
    "unknown_2": ("practice_mer", "practice flight with hidden effects"),
    "unknown_3": ("practice_phoenix", "practice flight with a hidden effect, Phoenix-like vehicle"),
}


def shipped_mission(name: str) -> Path:
    """Path of the mission file that the package ships as `name`.

    An installed wheel has the files in the package; a working copy has them in ``missions/``, the folder next to
    ``src/``.

    Raises
    ------
    InputError
        The package ships no mission of that name.
    """
    for folder in _mission_folders():
        if (path := folder / f"{name}.yaml").is_file():
            return path
    if name in SHIPPED_FLIGHTS:
        raise InputError(
            f"{BUILTIN}{name}: found a flight file; expected a mission. Use "
            f"{BUILTIN}{SHIPPED_FLIGHTS[name][0]} --set telemetry.path={BUILTIN}{name}."
        )
    raise InputError(f"{BUILTIN}{name}: found no such mission; expected one of {', '.join(shipped_names())}.")


def shipped_names() -> list[str]:
    """Names of the missions that the package ships."""
    return sorted({path.stem for folder in _mission_folders() for path in folder.glob("*.yaml")})


def shipped_scenario(name: str) -> Path:
    """Path of the scenario file that the package ships as `name`.

    Raises
    ------
    InputError
        The package ships no scenario of that name.
    """
    for folder in _mission_folders():
        if (path := folder / "scenarios" / f"{name}.yaml").is_file():
            return path
    raise InputError(f"{BUILTIN}{name}: found no such scenario; expected one of {', '.join(shipped_scenarios())}.")


def shipped_scenarios() -> list[str]:
    """Names of the scenarios that the package ships."""
    return sorted({path.stem for folder in _mission_folders() for path in folder.glob("scenarios/*.yaml")})


def flight_command(name: str) -> str:
    """The command that runs a shipped flight."""
    return f"edl-filter run {BUILTIN}{SHIPPED_FLIGHTS[name][0]} --set telemetry.path={BUILTIN}{name} -o results/{name}"


def shipped_data(name: str, label: str) -> Path:
    """Path of the table or flight file that the package ships as `name`.

    Raises
    ------
    InputError
        The package ships no data of that name; the message begins with `label`.
    """
    folder = Path(str(files("edl_filter"))) / "data"
    for suffix in _DATA_SUFFIXES:
        if (path := folder / (name + suffix)).is_file():
            return path
    names = ", ".join(sorted(path.stem for path in folder.glob("*") if path.suffix in _DATA_SUFFIXES))
    raise InputError(f"{label}: found {BUILTIN + name!r}; the package ships {names}.")


def _mission_folders() -> tuple[Path, Path]:
    package = Path(str(files("edl_filter")))
    return package / "missions", package.parent.parent / "missions"
