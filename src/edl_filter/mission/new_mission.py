"""A mission file of one's own: from another mission, without what it does not need, or from a template to fill in."""

from __future__ import annotations

import re
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path

from edl_filter.errors import InputError
from edl_filter.io.atomic import replace_with
from edl_filter.mission.files import source_folder
from edl_filter.mission.mission import PATH_KEYS, Mission
from edl_filter.mission.shipped import BUILTIN
from edl_filter.mission.yaml_edit import rebase_paths, remove_section, shorten_paths
from edl_filter.mission.yaml_text import set_key

#: Sections that are left out where all their values are the defaults, so that a new file has only what it needs.
_OPTIONAL_SECTIONS = ("sample_checks", "postflight", "filter", "diagnosis", "outputs")
_TEMPLATE_NAME = "my_mission"


def new_mission(target: Path, source: str | None = None, overrides: Sequence[str] = (), replace: bool = False) -> Path:
    """Write a mission file to begin with.

    Parameters
    ----------
    target : Path
        File to write; the mission's name is that of the file without its suffix.
    source : str, optional
        Mission to begin with, a file or ``builtin:NAME``: its values and comments are kept, its sections with default
        values and its folder of results are not. Without it the file is a template that lists what to fill in.
    overrides : sequence of str
        As in `Mission.load`; only with `source`.
    replace : bool
        Whether an existing file is replaced.

    Returns
    -------
    Path
        `target`.

    Raises
    ------
    InputError
        The file exists, the source cannot be read, or there are overrides without a source.
    """
    if target.exists() and not replace:
        raise InputError(f"{target}: found a file; --force replaces it.")
    if target.suffix not in (".yaml", ".yml"):
        raise InputError(f"{target}: found the suffix {target.suffix!r}; expected a mission file, NAME.yaml.")
    name = re.sub(r"[^A-Za-z0-9_\-]", "_", target.stem)
    if source is None:
        if overrides:
            raise InputError("--set: found a change without --from; the keys of the template are filled in by hand.")
        text = template_text().replace(f"name: {_TEMPLATE_NAME}", f"name: {name}", 1)
        return replace_with(target, lambda path: path.write_text(text, encoding="utf-8"))
    mission = Mission.load(source, overrides)
    mission.telemetry_path()
    text = set_key(mission.text, "name", name, source)
    if mission.outputs.directory is not None:  # two missions would write into one folder
        text = set_key(text, "outputs.directory", None, source)
    shortened = Mission.from_text(text, source, mission.source)
    for key in _OPTIONAL_SECTIONS:
        if getattr(shortened, key) == Mission.model_fields[key].default:
            text = remove_section(text, key, source)
    origin = source if source.startswith(BUILTIN) else Path(source).name
    head = (
        f"# Begun with {origin}; values and comments are its own. Every key with its unit and range is in\n"
        "# docs/reference/mission.md; a key that is absent has its default.\n"
    )
    checked = Mission.from_text(head + text, str(target), mission.source)
    text = rebase_paths(checked.text, PATH_KEYS, source_folder(mission), target.parent, str(target))
    text = shorten_paths(text, PATH_KEYS, target.parent, str(target))  # --set has made relative paths absolute
    return replace_with(target, lambda path: path.write_text(text, encoding="utf-8"))


def template_text() -> str:
    """Text of the template: values to fill in are empty, and their comments begin with FILL IN."""
    return (files("edl_filter") / "data" / "mission_template.yaml").read_text(encoding="utf-8")
