"""Arguments and options that several commands share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

MissionArgument = Annotated[str, typer.Argument(help="Mission file, or builtin:NAME.")]
ResultArgument = Annotated[Path, typer.Argument(help="result.nc, or the folder that contains it.")]
ResultFolderOption = Annotated[Path | None, typer.Option("-o", "--output", help="Folder of the results.")]
FlightFileOption = Annotated[Path, typer.Option("-o", "--output", help="Flight file to write.")]
ForceOption = Annotated[bool, typer.Option("--force", help="Replace an existing file.")]
OverridesOption = Annotated[
    list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Change a key of the mission.")
]
EffectNamesOption = Annotated[
    list[str] | None, typer.Option("--effect", metavar="NAME", help="Test only this effect; may be repeated.")
]
EffectFileOption = Annotated[Path | None, typer.Option("--file", help="Python file with effects of your own.")]
JsonOption = Annotated[bool, typer.Option("--json", help="Print JSON, nothing else.")]
