"""The command that runs a campaign, repeats one of its cases, and reports on it."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from edl_filter.cli._base import exit_with_trust, print_json
from edl_filter.cli.options import JsonOption
from edl_filter.errors import UNTRUSTWORTHY, InputError

if TYPE_CHECKING:
    from edl_filter.simulation.campaign_config import Campaign
    from edl_filter.workflow.campaign import CampaignState

#: First argument that stands for the report.
_REPORT = "report"


def campaign(
    campaign: Annotated[str, typer.Argument(help="Campaign file; or report, with the folder of a campaign.")],
    folder: Annotated[Path | None, typer.Argument(help="With report: folder of the campaign.")] = None,
    output: Annotated[Path | None, typer.Option("-o", "--output", help="Folder of the campaign's results.")] = None,
    scheduler: Annotated[
        str | None, typer.Option("--scheduler", metavar="ADDRESS", help="Dask scheduler; absent: this machine.")
    ] = None,
    workers: Annotated[
        int | None, typer.Option("--workers", min=1, help="Processes of this machine; absent: one for each processor.")
    ] = None,
    case: Annotated[
        int | None, typer.Option("--case", min=0, help="Run this case alone in this process and print its record.")
    ] = None,
    retry: Annotated[bool, typer.Option("--retry", help="Run failed cases again.")] = False,
    patience: Annotated[
        float, typer.Option("--patience", min=1.0, help="Time for which a lost scheduler is waited for, s.")
    ] = 60.0,
    as_json: JsonOption = False,
) -> None:
    """Run many flights on dask, resumable; or draw the report of a campaign: campaign report DIR."""
    if campaign == _REPORT:
        _report(folder or output, as_json)
        return
    if folder is not None:
        raise InputError(f"campaign: found {folder} after {campaign}; -o names the folder of the results.")
    if scheduler is not None and workers is not None:
        raise InputError("--workers: found it with --scheduler, whose workers are used; leave one of them out.")
    from edl_filter.simulation.campaign_config import Campaign

    loaded = Campaign.load(campaign)
    if case is not None:
        _run_case(loaded, case)
        return
    _run(loaded, output or Path("results") / loaded.name, scheduler, workers, retry, patience, as_json)


def _run_case(loaded: Campaign, number: int) -> None:
    """Print the record of one case; its errors are those of the command."""
    from edl_filter.workflow.campaign_case import CaseRunner

    print_json(CaseRunner(loaded).run(number))


def _run(
    loaded: Campaign,
    folder: Path,
    scheduler: str | None,
    workers: int | None,
    retry: bool,
    patience: float,
    as_json: bool,
) -> None:
    from edl_filter.io.output_folder import interrupted, output_folder
    from edl_filter.workflow.campaign import run_campaign
    from edl_filter.workflow.campaign_files import ranges_text, read_failures
    from edl_filter.workflow.campaign_report import gather

    kept = f"Complete cases are in {folder}; the same command runs those that are missing."
    with output_folder(folder), interrupted(kept):
        with _bar(loaded.title or loaded.name, as_json) as show:
            outcome = run_campaign(loaded, folder, scheduler, workers, retry, patience, show)
        missing = outcome.progress.missing
        if not outcome.stopped:
            gather(folder)
    content: dict[str, Any] = {
        "cases": loaded.total,
        "done": int(outcome.progress.done.sum()),
        "failed": int(outcome.progress.failed.sum()),
        "missing": len(missing),
        "folder": str(folder),
    }
    if missing:
        raise InputError(
            f"{folder}: {outcome.sentence} Reason: {outcome.stopped}. The same command runs the missing ones."
        )
    if as_json:
        print_json(content)
    else:
        typer.echo(outcome.sentence)
        failures = read_failures(folder)
        if failures:
            typer.echo(f"Failed: {ranges_text([f['case'] for f in failures])}. The first: {failures[0]['message']}")
            typer.echo(f"  {failures[0]['command']}")
        typer.echo(f"Written: {folder / 'results.zarr'}\nNext: edl-filter campaign report {folder}")
    if content["failed"]:
        raise typer.Exit(UNTRUSTWORTHY)
    exit_with_trust(None)


def _report(folder: Path | None, as_json: bool) -> None:
    """Write and print the report of a campaign's folder."""
    if folder is None:
        raise InputError("campaign report: found no folder; expected that of a campaign, such as results/mer.")
    from edl_filter.io.output_folder import output_folder
    from edl_filter.report.terminal.campaign import print_statistics
    from edl_filter.workflow.campaign_files import read_identity
    from edl_filter.workflow.campaign_report import report_campaign

    read_identity(folder)
    with output_folder(folder):
        written = report_campaign(folder)
    if as_json:
        print_json(written["statistics"] | {"outputs": [str(path) for path in written["paths"]]})
        return
    print_statistics(written["statistics"], written["failures"])
    for path in written["paths"]:
        typer.echo(f"Written: {path}")


@contextmanager
def _bar(title: str, quiet: bool) -> Iterator[Callable[[CampaignState], None]]:
    """Progress bar on standard error with the address of the dashboard; nothing if it is no terminal."""
    if quiet or not sys.stderr.isatty():
        yield lambda _: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[failed]}"),
        TimeRemainingColumn(),
    )
    console = Console(stderr=True)
    shown: set[str] = set()
    with Progress(*columns, console=console) as bar:
        task = bar.add_task(title, total=None, failed="")

        def show(state: CampaignState) -> None:
            if state.dashboard and state.dashboard not in shown:
                shown.add(state.dashboard)
                console.print(f"Dashboard: {state.dashboard}")
            failed = f"{state.failed} failed" if state.failed else ""
            bar.update(task, total=state.total, completed=state.done + state.failed, failed=failed)

        yield show
