"""Arguments and options that several commands share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def mission_names(incomplete: str) -> list[str]:
    """Names of shipped missions that begin with `incomplete`, for the shell; without one it completes files."""
    from edl_filter.mission.shipped import BUILTIN, shipped_names

    return [] if not incomplete else [n for n in map(BUILTIN.__add__, shipped_names()) if n.startswith(incomplete)]


def scenario_names(incomplete: str) -> list[str]:
    """Names of shipped scenarios that begin with `incomplete`, for the shell; without one it completes files."""
    from edl_filter.mission.shipped import BUILTIN, shipped_scenarios

    return [] if not incomplete else [n for n in map(BUILTIN.__add__, shipped_scenarios()) if n.startswith(incomplete)]


def effect_names(incomplete: str) -> list[str]:
    """Names of effects of the catalogue that begin with `incomplete`, for the shell."""
    from edl_filter.effects.registry import known_effects

    return [name for name in known_effects() if name.startswith(incomplete)]


MissionArgument = Annotated[str, typer.Argument(help="Mission file, or builtin:NAME.", autocompletion=mission_names)]
DryRunOption = Annotated[
    bool, typer.Option("--dry-run", help="List the files that would be read and written, and write nothing.")
]
ResultArgument = Annotated[Path, typer.Argument(help="result.nc, or the folder that contains it.")]
ResultFolderOption = Annotated[Path | None, typer.Option("-o", "--output", help="Folder of the results.")]
FlightFileOption = Annotated[Path, typer.Option("-o", "--output", help="Flight file to write.")]
FormatsOption = Annotated[
    str, typer.Option("--format", metavar="LIST", help="Formats of the figures: png, svg, pdf, with commas.")
]
ForceOption = Annotated[bool, typer.Option("--force", help="Replace an existing file.")]
OverridesOption = Annotated[
    list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Change a key of the mission.")
]
EffectNamesOption = Annotated[
    list[str] | None,
    typer.Option(
        "--effect", metavar="NAME", help="Test only this effect; may be repeated.", autocompletion=effect_names
    ),
]
EffectFileOption = Annotated[Path | None, typer.Option("--file", help="Python file with effects of your own.")]
JsonOption = Annotated[bool, typer.Option("--json", help="Print JSON, nothing else.")]
