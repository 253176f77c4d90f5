"""Commands: parse, call the API, print.

Exit codes: 0 done; 2 the input is wrong, with one message on standard error; 1 a fault of ours. Nothing heavy is
imported before a command runs, so that help comes at once.
"""

from __future__ import annotations

import gc
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from edl_filter import __version__
from edl_filter.command_line import Commands, busy, print_json
from edl_filter.errors import InputError

if TYPE_CHECKING:
    from edl_filter.mission import Mission

_HDF5 = (".h5", ".hdf5", ".nc")


app = typer.Typer(
    cls=Commands,
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,  # half the time of help is rich's import
    pretty_exceptions_enable=False,
    # a value for the help that was not asked for: else typer imports pydantic to convert None
    context_settings={"help_option_names": ["-h", "--help"], "default_map": {"help": False}},
)


def main() -> None:
    """Entry point of ``edl-filter``."""
    # a tenth of a short run goes to collecting cycles among what imports create, all of which stays
    gc.set_threshold(100_000)
    app(prog_name="edl-filter")


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"edl-filter {__version__}")
        raise typer.Exit


@app.callback(
    help="Reconstruct planetary entries from inertial telemetry.",
    epilog="Example: edl-filter demo -o results/demo",
)
def _app(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")
    ] = False,
    debug: Annotated[bool, typer.Option("--debug", help="Show the traceback of an error.")] = False,
) -> None:
    """Options of all commands; `debug` is read where exceptions are caught."""


@app.command(epilog="Example: edl-filter run missions/mer_a.yaml -o results/mer_a")
def run(
    mission: Annotated[str, typer.Argument(help="Mission file, or builtin:NAME.")],
    output: Annotated[Path | None, typer.Option("-o", "--output", help="Folder of the results.")] = None,
    changes: Annotated[
        list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Change a key of the mission.")
    ] = None,
    no_figures: Annotated[bool, typer.Option("--no-figures", help="Draw no figures.")] = False,
    no_refit: Annotated[
        bool, typer.Option("--no-refit", help="Leave effects at their values; compare nothing.")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print the summary as JSON, nothing else.")] = False,
) -> None:
    """Reconstruct an entry, its effects refitted; write result.nc, summary.json, report.html and figures."""
    from edl_filter.mission import Mission

    _run(Mission.load(mission, changes or ()), output, not no_figures, as_json, not no_refit)


@app.command(epilog="Example: edl-filter demo -o results/demo")
def demo(
    output: Annotated[Path | None, typer.Option("-o", "--output", help="Folder of the results.")] = None,
) -> None:
    """Reconstruct the flight that comes with the package, and say where its figures are."""
    from edl_filter.mission import Mission

    written = _run(Mission.load("builtin:practice_mer"), output, True, False)
    typer.echo(f"Look at {written['figures'][0] if written['figures'] else written['result']} first.")


@app.command(epilog="Example: edl-filter validate missions/mer_a.yaml")
def validate(
    path: Annotated[str, typer.Argument(help="Mission file (with its telemetry and tables), or flight file.")],
    changes: Annotated[
        list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Change a key of the mission.")
    ] = None,
) -> None:
    """Check a mission with all that it names, or a flight file."""
    if path.lower().endswith(_HDF5):
        from edl_filter.telemetry.flight_file import read_flight_file

        if changes:
            raise InputError(f"--set: {path} is a flight file; only a mission has keys to change.")
        telemetry, what = read_flight_file(path), "a flight file"
    else:
        from edl_filter.assembly import assemble
        from edl_filter.mission import Mission
        from edl_filter.reading import read_atmosphere, read_telemetry

        loaded = Mission.load(path, changes or ())
        telemetry, what = read_telemetry(loaded), f"the mission {loaded.name}"
        planet = loaded.planet_model(telemetry.prime_meridian_at_epoch)
        assemble(loaded, telemetry, planet, read_atmosphere(loaded))
    from edl_filter.report.terminal import telemetry_lines

    typer.echo(f"{path}: {what}, nothing wrong with it.")
    for line in telemetry_lines(telemetry):
        typer.echo(f"  {line}")


@app.command(epilog="Example: edl-filter convert imu_log.csv --spec imu_log.spec.yaml -o flight.h5")
def convert(
    log: Annotated[Path, typer.Argument(help="IMU log, CSV with a header.")],
    spec: Annotated[Path, typer.Option("--spec", help="Which columns hold what (YAML).")],
    output: Annotated[Path, typer.Option("-o", "--output", help="Flight file to write.")],
) -> None:
    """Turn an IMU log into a flight file."""
    from edl_filter.telemetry.csv_log import convert as convert_log

    typer.echo(f"Written: {convert_log(log, spec, output)}")


@app.command(epilog="Example: edl-filter simulate missions/scenarios/mer.yaml -o flight.h5 --seed 7")
def simulate(
    scenario: Annotated[str, typer.Argument(help="Scenario file, or builtin:NAME.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="Flight file to write.")],
    seed: Annotated[int | None, typer.Option("--seed", min=0, help="Of all that is drawn.")] = None,
    changes: Annotated[
        list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Change a key of the scenario.")
    ] = None,
) -> None:
    """Fly a scenario with six degrees of freedom; write what was measured, and the truth."""
    from edl_filter.simulation import Scenario
    from edl_filter.simulation import simulate as fly

    loaded = Scenario.load(scenario, changes or ())
    with busy(f"Simulating {loaded.title or loaded.name}", quiet=False):
        flight = fly(loaded, seed=seed)
    typer.echo(f"Written: {flight.write(output)}")


@app.command(epilog="Example: edl-filter export results/mer_a --to csv -o spirit.csv")
def export(
    result: Annotated[Path, typer.Argument(help="result.nc, or the folder that holds it.")],
    to: Annotated[str, typer.Option("--to", help="csv, spk or ck.")],
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="File to write; beside the result if not given.")
    ] = None,
    naif_id: Annotated[int | None, typer.Option("--naif-id", help="Spacecraft's number in SPICE.")] = None,
) -> None:
    """Write trajectory and attitude for other tools: a table, or SPICE kernels."""
    from edl_filter.export import export as export_result

    for path in export_result(result, to, output, naif_id):
        typer.echo(f"Written: {path}")


@app.command(epilog="Example: edl-filter fetch mer-imu")
def fetch(
    what: Annotated[str, typer.Argument(help="mer-imu: telemetry of Spirit and Opportunity.")],
    base_url: Annotated[str | None, typer.Option("--base-url", help="Another copy of the volume.")] = None,
    to: Annotated[Path | None, typer.Option("--to", help="Folder for downloads, not the cache.")] = None,
) -> None:
    """Download public data, each file checked by its sha256."""
    if what != "mer-imu":
        raise InputError(f"fetch: found {what!r}; accepted is mer-imu.")
    from edl_filter.telemetry.fetch import fetch_mer_imu

    typer.echo(f"MER telemetry: {fetch_mer_imu(base_url, to, progress=sys.stdout.isatty())}")


@app.command(epilog="Example: edl-filter effects remnant_torque")
def effects(
    name: Annotated[str | None, typer.Argument(help="One effect in detail; without it, all of them.")] = None,
    file: Annotated[Path | None, typer.Option("--file", help="Python file with effects of your own.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON, nothing else.")] = False,
) -> None:
    """List the physical effects that a model may lack: parameters, plausible sizes, how they show, sources."""
    from edl_filter.effects.loading import effects_in, find_effect, known_effects

    chosen = [find_effect(name, file)] if name else list((effects_in(file) if file else known_effects()).values())
    if as_json:
        import json

        from edl_filter.effects.describe import as_plain

        plain = [as_plain(effect) for effect in chosen]
        typer.echo(json.dumps(plain[0] if name else {"effects": plain}, allow_nan=False))
        return
    from edl_filter.report.catalogue import print_catalogue, print_effect

    if name:
        print_effect(chosen[0])
    else:
        print_catalogue(chosen)


@app.command(epilog="Example: edl-filter add missions/mer_a.yaml remnant_torque --from results/mer_a")
def add(
    mission: Annotated[str, typer.Argument(help="Mission file, or builtin:NAME.")],
    effect: Annotated[str, typer.Argument(help="Name of the effect ('edl-filter effects').")],
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="File to write; MISSION+EFFECT.yaml if not given.")
    ] = None,
    values: Annotated[
        list[str] | None, typer.Option("--set", metavar="PARAM=VALUE", help="Starting value of a parameter.")
    ] = None,
    result: Annotated[
        Path | None, typer.Option("--from", metavar="RESULT", help="Result whose diagnosis has the starting values.")
    ] = None,
    imu: Annotated[str | None, typer.Option("--imu", help="IMU that a sensor effect sits in.")] = None,
    file: Annotated[str | None, typer.Option("--file", help="Python file with an effect of your own.")] = None,
) -> None:
    """Write a new mission file with one physical effect more."""
    from shlex import quote

    from edl_filter.mission import Mission
    from edl_filter.mission.adding import add_effect

    written = add_effect(mission, effect, output, values or (), result, imu, file)
    typer.echo(f"Written: {written}")
    added = Mission.load(written).active_effects()[-1]
    if not any(added.values[q.name] for q in added.effect.sizes):
        typer.echo(f"All sizes of {effect} are zero: it is off until one of them is set or estimated.")
    place = Path("results") / written.stem
    if result is not None:  # beside the result that it came from, as 'diagnose' says
        folder = result.parent if result.suffix == ".nc" else result
        place = folder.with_name(f"{folder.name}+{effect}")
    typer.echo(f"Next: edl-filter run {quote(str(written))} -o {quote(str(place))}")


@app.command(epilog="Example: edl-filter diagnose results/mer_a")
def diagnose(
    result: Annotated[Path, typer.Argument(help="result.nc, or the folder that holds it.")],
    names: Annotated[
        list[str] | None, typer.Option("--effect", metavar="NAME", help="Try only this effect; may be repeated.")
    ] = None,
    file: Annotated[Path | None, typer.Option("--file", help="Python file with effects of your own.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the diagnosis as JSON, nothing else.")] = False,
) -> None:
    """Say where the model fails, which effect is missing and what is left; write diagnosis.json and figures."""
    from edl_filter.diagnosis.of_result import diagnose_result

    with busy(f"Diagnosing {result}", quiet=as_json) as say:
        found = diagnose_result(result, names or (), file, say)
    paths = [str(p) for p in (found.path, found.report, *found.figures)]
    if as_json:
        print_json(found.content | {"outputs": paths, "next": found.following})
        return
    from edl_filter.report.findings import print_diagnosis

    print_diagnosis(found.content, paths, found.following)


@app.command(epilog="Example: edl-filter compare results/mer_a results/mer_a+remnant_torque")
def compare(
    results: Annotated[list[Path], typer.Argument(help="Two or more results of one flight, in the order of the work.")],
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON, nothing else.")] = False,
) -> None:
    """Set results of one flight side by side: errors by channel, constraints, effects, and how the error fell."""
    from edl_filter.diagnosis.side_by_side import side_by_side

    with busy("Comparing", quiet=as_json):
        told = side_by_side(results)
    if as_json:
        print_json(told)
        return
    from edl_filter.report.findings import print_comparison

    print_comparison(told)


@app.command(epilog="Example: edl-filter improve missions/mer_a.yaml -o results/mer_a_improved")
def improve(
    mission: Annotated[str, typer.Argument(help="Mission file, or builtin:NAME.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder of the steps, the ledger and the result.")],
    changes: Annotated[
        list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Change a key of the mission.")
    ] = None,
    most: Annotated[int | None, typer.Option("--most", min=0, help="Add no more effects than this.")] = None,
    names: Annotated[
        list[str] | None, typer.Option("--effect", metavar="NAME", help="Try only this effect; may be repeated.")
    ] = None,
    file: Annotated[Path | None, typer.Option("--file", help="Python file with effects of your own.")] = None,
) -> None:
    """Diagnose, add what is missing, and again, until nothing earns its place; keep every step and a ledger."""
    from edl_filter.diagnosis.improving import finish, steps
    from edl_filter.mission import Mission

    loaded, told = Mission.load(mission, changes or ()), []
    with busy(f"Improving {loaded.title or loaded.name}", quiet=False) as say:
        for step in steps(loaded, output, most, names or (), file, say):
            typer.echo(step.paragraph)
            told.append(step)
        written = finish(loaded, output, told, say)
    for path in written:
        typer.echo(f"Written: {path}")


@app.command(epilog="Example: edl-filter identifiability missions/mer_a.yaml")
def identifiability(
    mission: Annotated[str, typer.Argument(help="Mission file, or builtin:NAME.")],
    changes: Annotated[
        list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Change a key of the mission.")
    ] = None,
    names: Annotated[
        list[str] | None, typer.Option("--effect", metavar="NAME", help="Only this effect; may be repeated.")
    ] = None,
    file: Annotated[Path | None, typer.Option("--file", help="Python file with effects of your own.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON, nothing else.")] = False,
) -> None:
    """Say how large each effect must be to be found on this flight, and with which others it would be confused."""
    from edl_filter.diagnosis.identifiability import identify
    from edl_filter.diagnosis.of_result import candidates
    from edl_filter.mission import Mission

    loaded = Mission.load(mission, changes or ())
    with busy(f"Studying {loaded.title or loaded.name}", quiet=as_json) as say:
        told = identify(loaded, candidates(names or (), file), say)
    if as_json:
        print_json(told)
        return
    from edl_filter.report.findings import print_identifiability

    print_identifiability(told)


@app.command(epilog="Example: edl-filter serve . --port 8765")
def serve(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of missions and results; all that it sees.")],
    port: Annotated[int, typer.Option("--port", min=0, max=65535, help="Of 127.0.0.1; 0 takes a free one.")] = 8765,
    no_browser: Annotated[bool, typer.Option("--no-browser", help="Only print the page's address.")] = False,
) -> None:
    """Open a workbench in the browser: run, see where it fails, add what is missing, watch the error fall."""
    from edl_filter.serve.server import serve as serve_folder

    at = folder.resolve()
    serve_folder(folder, port, not no_browser, lambda address: typer.echo(f"{address} serves {at}; Ctrl-C ends it."))


def _run(mission: Mission, output: Path | None, figures: bool, as_json: bool, refit: bool = True) -> dict[str, Any]:
    """Reconstruct, write and print."""
    from edl_filter.judging import reconstruct_and_judge
    from edl_filter.results.outputs import write_outputs

    with busy(f"Reconstructing {mission.title or mission.name}", quiet=as_json) as say:
        reconstruction, judged = reconstruct_and_judge(mission, refit, say)
    with busy("Writing results", quiet=as_json):
        written = write_outputs(
            reconstruction, output or mission.output_directory(), figures and mission.outputs.figures, judged
        )
    if as_json:
        paths = {k: str(written[k]) for k in ("result", "report")} | {"figures": [str(p) for p in written["figures"]]}
        print_json(written["content"] | {"outputs": paths})
    else:
        from edl_filter.report.terminal import print_run

        print_run(written)
    return written


if __name__ == "__main__":
    main()
