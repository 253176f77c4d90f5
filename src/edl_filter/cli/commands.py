"""The program ``edl-filter``: its options, and its commands with an example of each."""

from __future__ import annotations

import gc
import os
from collections.abc import Callable
from typing import Annotated

import typer

from edl_filter._version import __version__
from edl_filter.cli._base import Commands, announce_code
from edl_filter.cli.bash_words import complete_whole_words
from edl_filter.cli.campaign import campaign
from edl_filter.cli.diagnosis import add, compare, diagnose, effects, identifiability, improve, serve
from edl_filter.cli.flight_data import convert, export, fetch, simulate
from edl_filter.cli.reconstruction import demo, figures, missions, new, run, validate

app = typer.Typer(
    cls=Commands,
    no_args_is_help=True,
    rich_markup_mode=None,  # importing rich would double the time of a help page
    pretty_exceptions_enable=False,
    # without a default value of an option that it adds itself, typer imports pydantic to convert None
    context_settings={
        "help_option_names": ["-h", "--help"],
        "default_map": {"help": False, "install_completion": False, "show_completion": False},
    },
)


def main() -> None:
    """Entry point of ``edl-filter``."""
    # before numpy is imported: matrices are small, and BLAS threads would wait for each other (`estimation.parallel`)
    for variable in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(variable, "1")
    # a tenth of a short run is spent on garbage collection of objects that imports create and that are never freed
    gc.set_threshold(100_000)
    announce_code()
    if os.environ.get("_EDL_FILTER_COMPLETE") == "complete_bash":
        complete_whole_words(lambda: app(prog_name="edl-filter"))
        return
    app(prog_name="edl-filter")


def _print_version(requested: bool) -> None:
    if requested:
        typer.echo(f"edl-filter {__version__}")
        raise typer.Exit


@app.callback(
    help="Reconstruct planetary entries from inertial telemetry.\n\n"
    "Exit codes: 0 done; 3 done, but the result is not to be trusted (landing, altimeter or rest contradict it); 2 the "
    "input is wrong, with one message; 1 an error of the program; 130 Ctrl-C.",
    epilog="Example: edl-filter demo -o results/demo",
)
def _app(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version.")
    ] = False,
    debug: Annotated[bool, typer.Option("--debug", help="Show the traceback of an error.")] = False,
) -> None:
    """Options of all commands; `Commands.invoke` reads `debug`."""


#: Commands in the order of the help, each with an example.
_EXAMPLES: dict[Callable[..., None], str] = {
    run: "edl-filter run missions/mer_a.yaml -o results/mer_a",
    demo: "edl-filter demo -o results/demo",
    new: "edl-filter new --from builtin:practice_mer my_flight.yaml",
    missions: "edl-filter missions --json",
    validate: "edl-filter validate missions/mer_a.yaml",
    convert: "edl-filter convert imu_log.csv --spec imu_log.spec.yaml -o flight.h5",
    simulate: "edl-filter simulate missions/scenarios/mer.yaml -o flight.h5 --seed 7",
    figures: "edl-filter figures results/mer_a --format svg,pdf",
    export: "edl-filter export results/mer_a --to csv -o spirit.csv",
    fetch: "edl-filter fetch mer-imu",
    effects: "edl-filter effects remnant_torque",
    add: "edl-filter add missions/mer_a.yaml remnant_torque --from results/mer_a",
    diagnose: "edl-filter diagnose results/mer_a",
    compare: "edl-filter compare results/mer_a results/mer_a+remnant_torque",
    improve: "edl-filter improve missions/mer_a.yaml -o results/mer_a_improved",
    identifiability: "edl-filter identifiability missions/mer_a.yaml",
    campaign: "edl-filter campaign missions/campaigns/mer.yaml -o results/mer_campaign --workers 2",
    serve: "edl-filter serve . --port 8765",
}
for _command, _example in _EXAMPLES.items():
    app.command(epilog=f"Example: {_example}")(_command)
