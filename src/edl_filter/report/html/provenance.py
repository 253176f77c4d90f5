"""Where the numbers come from: version, mission, inputs with checksums, libraries, times."""

from __future__ import annotations

import json
from typing import Any

from edl_filter.report.html.blocks import Block, Command, Details, Note, Section, Table
from edl_filter.report.html.source import Source

_KEY, _TITLE = "provenance", "Provenance"


def provenance(source: Source) -> Section:
    """What made this result, and from what."""
    about, told = source.about, source.summary
    rows = [
        ("edl-filter", about.get("edl_filter_version") or told.get("edl_filter_version")),
        ("mission", source.mission),
        ("mission file", about.get("mission_file")),
        ("planet", about.get("planet")),
        ("epoch", f"{about['epoch_utc']} UTC" if about.get("epoch_utc") else None),
        ("made", about.get("created_utc")),
    ]
    inputs = _plain(about.get("input_sha256"))
    rows += [(f"input {name}", f"sha256 {checksum}") for name, checksum in inputs.items()]
    rows += [(f"library {name}", version) for name, version in _plain(about.get("versions")).items()]
    seconds = {name: value for name, value in told.get("timing_s", {}).items() if value is not None}
    if seconds:
        parts = ", ".join(f"{name.replace('_', ' ')} {value:.2f}" for name, value in seconds.items())
        rows.append(("time spent", f"{sum(seconds.values()):.1f} s ({parts})"))
    known = [[name, str(value)] for name, value in rows if value]
    blocks: list[Block] = [Table("", ("", ""), known, texts=2)] if known else []
    if not source.has_result:
        blocks.append(Note("The folder has no result.nc that can be read; inputs and libraries are unknown.", "muted"))
    blocks += [Note(str(note)) for note in told.get("notes", [])]
    if about.get("mission_yaml"):
        blocks.append(Details("The mission as it was run", [Command(str(about["mission_yaml"]).rstrip())]))
    return Section(_KEY, _TITLE, blocks)


def _plain(text: Any) -> dict[str, Any]:
    try:
        found = json.loads(str(text))
    except ValueError:
        return {}
    return found if isinstance(found, dict) else {}
