"""All problems of a mission file, where `Mission.load` reports the first.

A section that is wrong does not hide the problems of the others: each is checked by itself, then the valid ones against
each other, and every file that is named must exist.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from pydantic import ValidationError, create_model

from edl_filter.errors import InputError
from edl_filter.mission.cross_checks import section_errors
from edl_filter.mission.error_messages import check_mapping, problem_message
from edl_filter.mission.mission import PATH_KEYS, Mission, existing_path, mission_file
from edl_filter.mission.shipped import BUILTIN
from edl_filter.mission.yaml_text import apply_overrides, parse, read_text


def mission_problems(path: str | Path, overrides: Sequence[str] = ()) -> list[str]:
    """Messages of all problems of a mission file that can be seen without reading the files that it names.

    Parameters
    ----------
    path, overrides
        As in `Mission.load`.

    Returns
    -------
    list of str
        Empty for a mission that `Mission.load` accepts and whose files exist.
    """
    label = str(path)
    try:
        file = mission_file(path)
        text, changed = apply_overrides(read_text(file), label, overrides, PATH_KEYS)
        data = parse(text, label)
        check_mapping(Mission, data, label)
    except InputError as error:  # without data there is nothing else to check
        return [str(error)]
    messages, wrong_sections = _validation_problems(data, label, changed)
    sections = _valid_sections(data, wrong_sections)
    for inconsistency in section_errors(sections):
        detail = {"type": "mission", "loc": (), "ctx": inconsistency.context, "input": None}
        messages.append(problem_message(detail, Mission, label, changed))
    messages += _missing_files(data, file, label)
    if not messages:
        try:
            Mission.load(path, overrides).telemetry_path()
        except InputError as error:  # a format that the package cannot read
            messages.append(str(error))
    return messages


def _validation_problems(data: dict[str, Any], label: str, changed: Sequence[str]) -> tuple[list[str], set[str]]:
    """Messages of the problems within sections, and the keys of these sections."""
    try:
        Mission.model_validate(data)
    except ValidationError as error:
        # the checks between sections have no place in the data; they are made without the wrong sections as well
        details: list[dict[str, Any]] = [dict(d) for d in error.errors(include_url=False) if d["loc"]]
    else:
        details = []
    details.sort(key=lambda d: d["type"] != "extra_forbidden")
    messages = [problem_message(d, Mission, label, changed) for d in details]
    return messages, {str(d["loc"][0]) for d in details}


def _valid_sections(data: dict[str, Any], wrong: set[str]) -> dict[str, Any]:
    """Values of the sections that are valid or absent with a default."""
    fields: dict[str, Any] = {n: (f.annotation, f) for n, f in Mission.model_fields.items() if n not in wrong}
    valid = create_model("ValidSections", **fields)(**{name: data[name] for name in fields if name in data})
    return {name: getattr(valid, name) for name in fields}


def _missing_files(data: dict[str, Any], file: Path, label: str) -> Iterator[str]:
    """Messages of the keys that name a file which does not exist."""
    for pattern in PATH_KEYS:
        for key, reference in _values_at(data, pattern.split("."), ""):
            if key.startswith("aerodynamics.") and str(reference).startswith(BUILTIN):
                continue  # also the name of a model without a table, such as that of free-molecular panels
            if isinstance(reference, str):
                try:
                    existing_path(reference, key, file, label, folders=key == "telemetry.path")
                except InputError as error:
                    yield str(error)


def _values_at(data: Any, parts: list[str], key: str) -> Iterator[tuple[str, Any]]:
    """Dotted keys and values that a pattern, divided at its dots, describes."""
    if not parts:
        yield key, data
        return
    if parts[0] == "*" and isinstance(data, list):
        for k, entry in enumerate(data):
            yield from _values_at(entry, parts[1:], f"{key}.{k}")
    elif isinstance(data, dict) and parts[0] in data:
        yield from _values_at(data[parts[0]], parts[1:], f"{key}.{parts[0]}" if key else parts[0])
