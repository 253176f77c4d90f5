"""Commands that create, download and export flight data."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from edl_filter.cli._base import progress
from edl_filter.cli.options import FlightFileOption, ForceOption, ResultArgument, scenario_names
from edl_filter.errors import InputError


def _refuse_existing(path: Path, force: bool) -> None:
    """Raise InputError if a file would be replaced without ``--force``."""
    if path.is_file() and not force:
        raise InputError(f"{path}: found a file; --force replaces it.")


def convert(
    log: Annotated[Path, typer.Argument(help="IMU log, CSV with a header.")],
    spec: Annotated[Path, typer.Option("--spec", help="YAML file that states the quantity and unit of each column.")],
    output: FlightFileOption,
    force: ForceOption = False,
) -> None:
    """Convert an IMU log into a flight file."""
    from edl_filter.telemetry.csv_log import convert as convert_log

    _refuse_existing(output, force)
    typer.echo(f"Written: {convert_log(log, spec, output)}")


def simulate(
    scenario: Annotated[str, typer.Argument(help="Scenario file, or builtin:NAME.", autocompletion=scenario_names)],
    output: FlightFileOption,
    seed: Annotated[int | None, typer.Option("--seed", min=0, help="Seed of the random numbers.")] = None,
    changes: Annotated[
        list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Change a key of the scenario.")
    ] = None,
    force: ForceOption = False,
) -> None:
    """Simulate a scenario with six degrees of freedom; write the measurements and the true trajectory."""
    from edl_filter.simulation import Scenario
    from edl_filter.simulation import simulate as simulate_flight

    _refuse_existing(output, force)
    loaded = Scenario.load(scenario, changes or ())
    with progress(f"Simulating {loaded.title or loaded.name}", quiet=False):
        flight = simulate_flight(loaded, seed=seed)
    typer.echo(f"Written: {flight.write(output)}")


def export(
    result: ResultArgument,
    to: Annotated[str, typer.Option("--to", help="csv, spk or ck.", autocompletion=lambda: ["csv", "spk", "ck"])],
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="File to write; in the result's folder if not stated.")
    ] = None,
    naif_id: Annotated[int | None, typer.Option("--naif-id", help="NAIF ID of the spacecraft in SPICE.")] = None,
    force: ForceOption = False,
) -> None:
    """Write trajectory and attitude for other tools: a CSV table, or SPICE kernels."""
    from edl_filter.export import default_path
    from edl_filter.export import export as export_result

    _refuse_existing(output or default_path(result, to), force)
    for path in export_result(result, to, output, naif_id):
        typer.echo(f"Written: {path}")


def fetch(
    dataset: Annotated[
        str,
        typer.Argument(help="mer-imu: telemetry of Spirit and Opportunity.", autocompletion=lambda: ["mer-imu"]),
    ],
    base_url: Annotated[str | None, typer.Option("--base-url", help="URL of another copy of the volume.")] = None,
    to: Annotated[Path | None, typer.Option("--to", help="Folder for the downloads, instead of the cache.")] = None,
    compact: Annotated[
        Path | None,
        typer.Option("--compact", help="Folder for mer_a.h5 and mer_b.h5, the form that the package ships."),
    ] = None,
) -> None:
    """Download original files of public data, or find them below $EDL_FILTER_DATA; check their SHA-256 checksums."""
    if dataset != "mer-imu":
        raise InputError(f"fetch: found {dataset!r}; accepted is mer-imu.")
    from edl_filter.telemetry.fetch import fetch_mer_imu

    volume = fetch_mer_imu(base_url, to, progress=sys.stdout.isatty(), report=typer.echo)
    typer.echo(f"MER telemetry: {volume}")
    if compact is not None:
        from edl_filter.telemetry.mer_compact import write_compact

        for path in write_compact(volume, compact):
            typer.echo(f"Written: {path}")
