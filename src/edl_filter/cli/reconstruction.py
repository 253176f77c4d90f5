"""Commands that reconstruct a flight, and the check of their input."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

from edl_filter.cli._base import exit_with_trust, print_file_plan, print_json, progress
from edl_filter.cli.options import (
    DryRunOption,
    ForceOption,
    FormatsOption,
    JsonOption,
    MissionArgument,
    OverridesOption,
    ResultArgument,
    ResultFolderOption,
    mission_names,
)
from edl_filter.errors import InputError

_HDF5_SUFFIXES = (".h5", ".hdf5", ".nc")


def run(
    mission: MissionArgument,
    output: ResultFolderOption = None,
    changes: OverridesOption = None,
    no_figures: Annotated[bool, typer.Option("--no-figures", help="Draw no figures.")] = False,
    formats: FormatsOption = "png",
    no_refit: Annotated[
        bool, typer.Option("--no-refit", help="Keep effects at their stated values; compare nothing with a prediction.")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print the summary as JSON, nothing else.")] = False,
    dry_run: DryRunOption = False,
) -> None:
    """Reconstruct an entry and refit its effects; write result.nc, summary.json, report.html and figures."""
    kinds = _figure_formats(formats)
    if dry_run:
        from edl_filter.workflow.dry_run import plan_run

        print_file_plan(plan_run(mission, output, changes or (), not no_figures, kinds), as_json)
        return
    outputs = _reconstruct(mission, output, changes or (), not no_figures, as_json, not no_refit, kinds)
    exit_with_trust(outputs["content"]["headline"])


def demo(output: ResultFolderOption = None) -> None:
    """Reconstruct Spirit's entry from the telemetry that the package ships, and print the path of its first figure."""
    outputs = _reconstruct("builtin:mer_a", output)
    typer.echo(f"Look at {outputs['figures'][0] if outputs['figures'] else outputs['result']} first.")
    exit_with_trust(outputs["content"]["headline"])


def new(
    mission: Annotated[Path, typer.Argument(help="Mission file to write, NAME.yaml.")],
    source: Annotated[
        str | None,
        typer.Option(
            "--from",
            metavar="MISSION",
            help="Mission to begin with; without it the file lists what to fill in.",
            autocompletion=mission_names,
        ),
    ] = None,
    changes: OverridesOption = None,
    force: ForceOption = False,
) -> None:
    """Write a mission file of your own, with units and comments."""
    from shlex import quote

    from edl_filter.mission.new_mission import new_mission

    path = quote(str(new_mission(mission, source, changes or (), force)))
    typer.echo(f"Written: {path}")
    if source is None:
        typer.echo(f"Fill in the values marked FILL IN. What is missing: edl-filter validate {path}")
    else:
        typer.echo(f"Next: edl-filter validate {path}, then edl-filter run {path}")


def missions(as_json: JsonOption = False) -> None:
    """List the missions, practice flights and scenarios that the package ships."""
    from edl_filter.mission.shipped import (
        BUILTIN,
        SHIPPED_FLIGHTS,
        flight_command,
        shipped_mission,
        shipped_names,
        shipped_scenarios,
    )
    from edl_filter.mission.yaml_text import parse, read_text

    titles = {name: parse(read_text(shipped_mission(name)), name).get("title") for name in shipped_names()}
    scenarios = shipped_scenarios()
    if as_json:
        flights = {
            BUILTIN + name: {"mission": BUILTIN + mission, "title": title, "command": flight_command(name)}
            for name, (mission, title) in SHIPPED_FLIGHTS.items()
        }
        listed = {BUILTIN + name: {"title": title} for name, title in titles.items()}
        print_json({"missions": listed, "flights": flights, "scenarios": [BUILTIN + name for name in scenarios]})
        return
    typer.echo("Missions (edl-filter run builtin:NAME, or new --from builtin:NAME mine.yaml):")
    for name, title in titles.items():
        typer.echo(f"  {BUILTIN + name:<26} {title}")
    typer.echo("Flights (edl-filter run builtin:MISSION --set telemetry.path=builtin:NAME), by mission:")
    for mission in dict.fromkeys(mission for mission, _ in SHIPPED_FLIGHTS.values()):
        typer.echo(f"  for {BUILTIN + mission}")
        for name, (of_mission, title) in SHIPPED_FLIGHTS.items():
            if of_mission == mission:
                typer.echo(f"    {BUILTIN + name:<24} {title}")
    typer.echo("Scenarios (edl-filter simulate builtin:NAME -o flight.h5):")
    for name in scenarios:
        typer.echo(f"  {BUILTIN + name}")


def figures(
    result: ResultArgument,
    formats: FormatsOption = "png",
    as_json: JsonOption = False,
) -> None:
    """Draw the figures of a result, and of its diagnosis if there is one, into its folder figures."""
    from edl_filter.io.output_folder import interrupted, output_folder
    from edl_filter.workflow.draw_figures import draw_figures

    kinds = _figure_formats(formats)
    folder = result.parent if result.suffix == ".nc" else result
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder; expected the one that 'edl-filter run' writes.")
    kept = "The figures that were complete are kept."
    with output_folder(folder), interrupted(kept), progress("Drawing figures", quiet=as_json):
        paths = draw_figures(folder, kinds)
    if as_json:
        print_json({"figures": [str(path) for path in paths]})
    else:
        typer.echo(f"Figures: {folder / 'figures'} ({len(paths)} files)")


def validate(
    path: Annotated[str, typer.Argument(help="Mission file (checked with its telemetry and tables), or flight file.")],
    changes: OverridesOption = None,
) -> None:
    """Check all that a run checks, and list all problems: of a mission with its files and flight, or a flight file."""
    from edl_filter.workflow.validate import validated_flight_file, validated_mission

    code_files: list[str] = []
    if path.lower().endswith(_HDF5_SUFFIXES):
        if changes:
            raise InputError(f"--set: {path} is a flight file; only a mission has keys to change.")
        telemetry, description = validated_flight_file(Path(path)), "flight file"
    else:
        with progress(f"Checking {path}", quiet=False) as report_step:
            mission, telemetry = validated_mission(path, changes or (), report_step)
        description = f"mission {mission.name}"
        code_files = [e.file for e in mission.effects if e.file is not None]
    from edl_filter.report.terminal.console import print_paragraph
    from edl_filter.report.terminal.run import telemetry_lines

    count = len(telemetry.findings)
    outcome = f"usable; {count} finding{'s' * (count != 1)} about samples" if count else "no errors found"
    typer.echo(f"{path}: {description}, {outcome}.")
    for line in telemetry_lines(telemetry):
        print_paragraph(f"• {line}")
    for file in code_files:
        print_paragraph(f"• not checked: the effect in {file}, since a check runs no code of a mission")


def _figure_formats(text: str) -> tuple[str, ...]:
    """Formats of figures from the option's text."""
    from edl_filter.results.files import FIGURE_FORMATS

    formats = tuple(dict.fromkeys(part.strip().lower() for part in text.split(",")))
    for kind in formats:
        if kind not in FIGURE_FORMATS:
            raise InputError(f"--format: found {kind!r}; accepted are {', '.join(FIGURE_FORMATS)}, with commas.")
    return formats


def _reconstruct(
    mission: str,
    output: Path | None,
    changes: Sequence[str] = (),
    figures: bool = True,
    as_json: bool = False,
    refit: bool = True,
    formats: tuple[str, ...] = ("png",),
) -> dict[str, Any]:
    """Reconstruct a mission, write the outputs and print the summary; returns the paths of the outputs."""
    from edl_filter.workflow.run import run_into_folder

    outputs = run_into_folder(mission, output, changes, figures, refit, formats, _RunDisplay(as_json))
    if as_json:
        paths = {k: str(outputs[k]) for k in ("result", "report")} | {"figures": [str(p) for p in outputs["figures"]]}
        print_json(outputs["content"] | {"outputs": paths})
    elif outputs["figures"]:
        typer.echo(f"Figures: {outputs['figures'][0].parent} ({len(outputs['figures'])} files)")
    return outputs


@dataclass(frozen=True)
class _RunDisplay:
    """Display of a run (`workflow.run.RunDisplay`); with `quiet` nothing is printed on standard output."""

    quiet: bool

    def task(self, name: str) -> AbstractContextManager[Callable[[str], None]]:
        """Display a task while it lasts."""
        return progress(name, self.quiet)

    def replaces(self, sentence: str) -> None:
        """Print what of an earlier run is replaced or removed."""
        if not self.quiet:
            typer.echo(sentence)

    def written(self, outputs: dict[str, Any]) -> None:
        """Print the result."""
        if not self.quiet:
            from edl_filter.report.terminal.run import print_run

            print_run(outputs)
