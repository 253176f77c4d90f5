"""Commands that reconstruct a flight, and the check of their input."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from edl_filter.cli._base import exit_with_trust, interrupted, print_json, progress
from edl_filter.cli.options import MissionArgument, OverridesOption, ResultFolderOption
from edl_filter.errors import InputError

if TYPE_CHECKING:
    from edl_filter.mission import Mission

_HDF5_SUFFIXES = (".h5", ".hdf5", ".nc")


def run(
    mission: MissionArgument,
    output: ResultFolderOption = None,
    changes: OverridesOption = None,
    no_figures: Annotated[bool, typer.Option("--no-figures", help="Draw no figures.")] = False,
    formats: Annotated[
        str, typer.Option("--format", metavar="LIST", help="Formats of the figures: png, svg, pdf, with commas.")
    ] = "png",
    no_refit: Annotated[
        bool, typer.Option("--no-refit", help="Keep effects at their stated values; compare nothing with a prediction.")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print the summary as JSON, nothing else.")] = False,
) -> None:
    """Reconstruct an entry and refit its effects; write result.nc, summary.json, report.html and figures."""
    from edl_filter.mission import Mission

    kinds = _figure_formats(formats)
    outputs = _reconstruct(Mission.load(mission, changes or ()), output, not no_figures, as_json, not no_refit, kinds)
    exit_with_trust(outputs["content"]["headline"])


def demo(output: ResultFolderOption = None) -> None:
    """Reconstruct Spirit's entry from the telemetry that the package ships, and print the path of its first figure."""
    from edl_filter.mission import Mission

    outputs = _reconstruct(Mission.load("builtin:mer_a"), output, figures=True, as_json=False)
    typer.echo(f"Look at {outputs['figures'][0] if outputs['figures'] else outputs['result']} first.")
    exit_with_trust(outputs["content"]["headline"])


def validate(
    path: Annotated[str, typer.Argument(help="Mission file (checked with its telemetry and tables), or flight file.")],
    changes: OverridesOption = None,
) -> None:
    """Check a mission with its telemetry and tables, or a flight file."""
    if path.lower().endswith(_HDF5_SUFFIXES):
        import math

        from edl_filter.telemetry.flight_file import read_flight_file
        from edl_filter.telemetry.sample_repair import repaired

        if changes:
            raise InputError(f"--set: {path} is a flight file; only a mission has keys to change.")
        read, description = read_flight_file(path), "flight file"
        telemetry = repaired(read, parachute=read.events.get("parachute_deploy", math.inf))
    else:
        from edl_filter.mission import Mission
        from edl_filter.pipeline.load import read_atmosphere, read_telemetry
        from edl_filter.pipeline.problem import assemble
        from edl_filter.pipeline.trust import check_record

        mission = Mission.load(path, changes or ())
        telemetry, description = read_telemetry(mission), f"mission {mission.name}"
        planet = mission.planet_model(telemetry.prime_meridian_at_epoch)
        atmosphere = read_atmosphere(mission)
        check_record(mission, telemetry, planet, atmosphere, assemble(mission, telemetry, planet, atmosphere))
    from edl_filter.report.terminal.console import print_paragraph
    from edl_filter.report.terminal.run import telemetry_lines

    count = len(telemetry.findings)
    outcome = f"usable; {count} finding{'s' * (count != 1)} about samples" if count else "no errors found"
    typer.echo(f"{path}: {description}, {outcome}.")
    for line in telemetry_lines(telemetry):
        print_paragraph(f"• {line}")


def _figure_formats(text: str) -> tuple[str, ...]:
    """Formats of figures from the option's text."""
    from edl_filter.results.files import FIGURE_FORMATS

    formats = tuple(dict.fromkeys(part.strip().lower() for part in text.split(",")))
    for kind in formats:
        if kind not in FIGURE_FORMATS:
            raise InputError(f"--format: found {kind!r}; accepted are {', '.join(FIGURE_FORMATS)}, with commas.")
    return formats


def _reconstruct(
    mission: Mission,
    output: Path | None,
    figures: bool,
    as_json: bool,
    refit: bool = True,
    formats: tuple[str, ...] = ("png",),
) -> dict[str, Any]:
    """Reconstruct a mission, write the outputs and print the summary; returns the paths of the outputs."""
    from edl_filter.io.output_folder import output_folder
    from edl_filter.workflow.outputs import check_output_names, earlier_outputs, write_outputs
    from edl_filter.workflow.run import run_mission

    folder = output or mission.output_directory()
    with output_folder(folder), interrupted(f"Nothing was written; what {folder} held before is unchanged."):
        check_output_names(folder)
        if not as_json:
            for sentence in earlier_outputs(folder):
                typer.echo(sentence)
        with progress(f"Reconstructing {mission.title or mission.name}", quiet=as_json) as report_step:
            result = run_mission(mission, refit, report_step)
        with progress("Writing results", quiet=as_json):
            outputs = write_outputs(result, folder, figures and mission.outputs.figures, formats)
    if as_json:
        paths = {k: str(outputs[k]) for k in ("result", "report")} | {"figures": [str(p) for p in outputs["figures"]]}
        print_json(outputs["content"] | {"outputs": paths})
    else:
        from edl_filter.report.terminal.run import print_run

        print_run(outputs)
    return outputs
