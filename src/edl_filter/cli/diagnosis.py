"""Commands that diagnose a model and extend it with effects, and the workbench that runs them in a browser."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path
from typing import Annotated

import typer

from edl_filter.cli._base import exit_with_trust, print_file_plan, print_json, progress
from edl_filter.cli.options import (
    DryRunOption,
    EffectFileOption,
    EffectNamesOption,
    JsonOption,
    MissionArgument,
    OverridesOption,
    ResultArgument,
    effect_names,
)


def effects(
    name: Annotated[
        str | None,
        typer.Argument(help="Show one effect in detail; all effects if not stated.", autocompletion=effect_names),
    ] = None,
    file: EffectFileOption = None,
    as_json: JsonOption = False,
) -> None:
    """List the physical effects that a model may lack: parameters, plausible sizes, residuals they cause, sources."""
    from edl_filter.effects.registry import effects_in, find_effect, known_effects

    listed = [find_effect(name, file)] if name else list((effects_in(file) if file else known_effects()).values())
    if as_json:
        import json

        from edl_filter.effects.tables import as_plain

        tables = [as_plain(effect) for effect in listed]
        typer.echo(json.dumps(tables[0] if name else {"effects": tables}, allow_nan=False))
        return
    from edl_filter.report.terminal.effects import print_catalogue, print_effect

    if name:
        print_effect(listed[0])
    else:
        print_catalogue(listed)


def add(
    mission: MissionArgument,
    effect: Annotated[
        str, typer.Argument(help="Name of the effect ('edl-filter effects').", autocompletion=effect_names)
    ],
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="File to write; MISSION+EFFECT.yaml if not stated.")
    ] = None,
    values: Annotated[
        list[str] | None, typer.Option("--set", metavar="PARAM=VALUE", help="Starting value of a parameter.")
    ] = None,
    result: Annotated[
        Path | None,
        typer.Option("--from", metavar="RESULT", help="Result whose diagnosis contains the starting values."),
    ] = None,
    imu: Annotated[str | None, typer.Option("--imu", help="IMU that a sensor effect acts on.")] = None,
    file: Annotated[str | None, typer.Option("--file", help="Python file with an effect of your own.")] = None,
) -> None:
    """Write a new mission file with one more physical effect."""
    from shlex import quote

    from edl_filter.mission import Mission
    from edl_filter.workflow.add_effect import add_effect

    path = add_effect(mission, effect, output, values or (), result, imu, file)
    typer.echo(f"Written: {path}")
    added = Mission.load(path).active_effects()[-1]
    if not any(added.values[q.name] for q in added.effect.sizes):
        typer.echo(f"All sizes of {effect} are zero: the effect is off until one of them is set or estimated.")
    next_result = Path("results") / path.stem
    if result is not None:  # next to the result with the diagnosis, as in the commands that 'diagnose' prints
        folder = result.parent if result.suffix == ".nc" else result
        next_result = folder.with_name(f"{folder.name}+{effect}")
    typer.echo(f"Next: edl-filter run {quote(str(path))} -o {quote(str(next_result))}")


def diagnose(
    result: ResultArgument,
    names: EffectNamesOption = None,
    file: EffectFileOption = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the diagnosis as JSON, nothing else.")] = False,
    dry_run: DryRunOption = False,
) -> None:
    """Determine where the model fails, which effect is missing and what remains; write diagnosis.json and figures."""
    if dry_run:
        from edl_filter.effects.registry import selected_effects
        from edl_filter.workflow.dry_run import plan_diagnosis

        selected_effects(names or (), file)
        print_file_plan(plan_diagnosis(result, file), as_json)
        return
    from edl_filter.io.output_folder import interrupted, output_folder
    from edl_filter.workflow.diagnose_result import diagnose_result

    folder = result if result.is_dir() else result.parent
    outcome = f"No diagnosis was written; {folder} holds the result as before."
    with (
        output_folder(folder) if folder.is_dir() else nullcontext(),
        interrupted(outcome),
        progress(f"Diagnosing {result}", quiet=as_json) as report_step,
    ):
        if not as_json and (folder / "diagnosis.json").is_file():
            typer.echo(f"{folder} holds an earlier diagnosis; it is replaced.")
        diagnosed = diagnose_result(result, names or (), file, report_step)
    paths = [str(p) for p in (diagnosed.path, diagnosed.report, *diagnosed.figures)]
    if as_json:
        trust = {"trustworthy": diagnosed.headline is None, "headline": diagnosed.headline}
        print_json(trust | diagnosed.content | {"outputs": paths, "next": diagnosed.following.commands})
        return
    from edl_filter.report.terminal.diagnosis import print_diagnosis

    print_diagnosis(diagnosed.content, paths, diagnosed.following, diagnosed.warnings)


def compare(
    results: Annotated[list[Path], typer.Argument(help="Two or more results of one flight, the first model first.")],
    as_json: JsonOption = False,
) -> None:
    """Compare results of one flight: errors by channel, constraints, effects, and the decrease of each error."""
    from edl_filter.workflow.compare_results import compare_results

    with progress("Comparing", quiet=as_json):
        comparison = compare_results(results)
    if as_json:
        print_json(comparison)
        return
    from edl_filter.report.terminal.diagnosis import print_comparison

    print_comparison(comparison)


def improve(
    mission: MissionArgument,
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder of the steps, the ledger and the result.")],
    changes: OverridesOption = None,
    most: Annotated[int | None, typer.Option("--most", min=0, help="Greatest number of effects to add.")] = None,
    names: EffectNamesOption = None,
    file: EffectFileOption = None,
) -> None:
    """Diagnose and add the missing effect, repeatedly, until no effect is accepted; write each step and a ledger."""
    from edl_filter.io.output_folder import interrupted, output_folder
    from edl_filter.mission import Mission
    from edl_filter.report.terminal.console import print_paragraph
    from edl_filter.workflow.improve_model import StepFiles, complete_steps, improve_steps, write_final_model

    loaded = Mission.load(mission, changes or ())
    completed: list[StepFiles] = []
    with (
        output_folder(output),
        interrupted(lambda: f"{output} keeps {complete_steps(output)} complete steps; the same command goes on."),
        progress(f"Improving {loaded.title or loaded.name}", quiet=False) as report_step,
    ):
        for step in improve_steps(loaded, output, most, names or (), file, report_step):
            print_paragraph(step.paragraph)
            completed.append(step)
        paths, headline = write_final_model(loaded, output, completed, report_step)
    if headline is not None:
        print_paragraph(headline)
    for path in paths:
        typer.echo(f"Written: {path}")
    exit_with_trust(headline)


def identifiability(
    mission: MissionArgument,
    changes: OverridesOption = None,
    names: EffectNamesOption = None,
    file: EffectFileOption = None,
    as_json: JsonOption = False,
) -> None:
    """Compute the smallest detectable size of each effect on this flight, and which effects would be confused."""
    from edl_filter.diagnosis.detectability import detectability
    from edl_filter.effects.registry import selected_effects
    from edl_filter.mission import Mission

    loaded = Mission.load(mission, changes or ())
    with progress(f"Computing detectable sizes for {loaded.title or loaded.name}", quiet=as_json) as report_step:
        study = detectability(loaded, selected_effects(names or (), file), report_step)
    if as_json:
        print_json(study)
        return
    from edl_filter.report.terminal.diagnosis import print_identifiability

    print_identifiability(study)


def serve(
    folder: Annotated[
        Path,
        typer.Argument(metavar="DIR", help="Folder of missions and results; the page cannot name files outside of it."),
    ],
    port: Annotated[
        int, typer.Option("--port", min=0, max=65535, help="Port on 127.0.0.1; 0 selects a free port.")
    ] = 8765,
    no_browser: Annotated[bool, typer.Option("--no-browser", help="Only print the address of the page.")] = False,
) -> None:
    """Open a workbench in the browser: run missions, diagnose results, add missing effects, compare the errors."""
    from edl_filter.serve.server import serve as serve_folder

    path = folder.resolve()
    serve_folder(folder, port, not no_browser, lambda address: typer.echo(f"{address} serves {path}; Ctrl-C ends it."))
