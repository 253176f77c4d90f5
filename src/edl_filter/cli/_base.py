"""What all commands share: exceptions as messages and exit codes, progress, output of one JSON object.

This module imports no large package either.
"""

from __future__ import annotations

import logging
import os
import sys
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import typer
from typer.core import TyperGroup

from edl_filter.errors import UNTRUSTWORTHY, InputError, InterruptedCommandError
from edl_filter.io.progress import PROGRESS, PROGRESS_MARK

if TYPE_CHECKING:
    from edl_filter.workflow.dry_run import FilePlan

#: Exit code of a command that Ctrl-C ended, as shells have it.
INTERRUPTED = 130


class Commands(TyperGroup):
    """Converts the exceptions of all commands into messages and exit codes."""

    def invoke(self, ctx: Any) -> Any:
        """Run a command."""
        try:
            result = super().invoke(ctx)
            sys.stdout.flush()
            return result
        except BrokenPipeError:  # the reading program, such as head, has closed the pipe
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            raise typer.Exit(0) from None
        except (KeyboardInterrupt, InterruptedCommandError) as error:
            typer.echo(f"edl-filter: interrupted. {error}".rstrip(), err=True)
            raise typer.Exit(INTERRUPTED) from None
        except Exception as error:
            if type(error).__module__.split(".")[0] in ("typer", "click"):
                raise  # exceptions of typer have their own message and exit code
            if ctx.params.get("debug"):
                traceback.print_exc()
            if isinstance(error, InputError):
                typer.echo(f"edl-filter: {error}", err=True)
                raise typer.Exit(2) from None
            typer.echo(
                f"edl-filter: internal error: {type(error).__name__}: {error}\n"
                "Run 'edl-filter --debug COMMAND …' to see where, and please report it.",
                err=True,
            )
            raise typer.Exit(1) from None


def announce_code() -> None:
    """Print on standard error which files' code a command runs: those of the users' effects that a mission names."""
    handler = logging.StreamHandler()
    handler.setFormatter(logging.Formatter("edl-filter: %(message)s"))
    logger = logging.getLogger("edl_filter")
    logger.addHandler(handler)
    logger.setLevel(logging.INFO)


def exit_with_trust(headline: str | None) -> None:
    """End the command with exit code 3 if there is a `headline`: why its result is not to be trusted."""
    if headline is not None:
        raise typer.Exit(UNTRUSTWORTHY)


@contextmanager
def progress(task: str, quiet: bool) -> Iterator[Callable[[str], None]]:
    """Display a task and its current step while it runs.

    A terminal shows a status line on standard error, which no thread refreshes: while other threads run a process is
    not copied (`estimation.parallel`). A program that sets the variable `PROGRESS` receives one line per step.

    Parameters
    ----------
    task : str
        Name of the task.
    quiet : bool
        Whether a terminal shows nothing.

    Yields
    ------
    callable
        To be called with a description of each step.
    """
    if os.environ.get(PROGRESS) == "lines":
        typer.echo(f"{PROGRESS_MARK}{task}", err=True)
        yield lambda step: typer.echo(f"{PROGRESS_MARK}{task}: {step}", err=True)
        return
    if quiet or not sys.stdout.isatty():
        yield lambda _: None
        return
    from rich.console import Console
    from rich.live import Live

    with Live(f"{task} …", console=Console(stderr=True), auto_refresh=False, transient=True) as line:
        yield lambda step: line.update(f"{task}: {step} …", refresh=True)


def print_file_plan(plan: FilePlan, as_json: bool) -> None:
    """Print what a command would read and write, as text or as one JSON object."""
    if as_json:
        print_json({"dry_run": plan.as_json()})
        return
    typer.echo("Would read:")
    for key, name in plan.reads:
        typer.echo(f"  {name}  ({key})")
    for title, paths in (
        ("Would write:", plan.writes),
        ("Would write as far as the flight has the data:", plan.optional),
        ("Would replace or remove:", plan.removes),
    ):
        if paths:
            typer.echo(title)
        for path in paths:
            typer.echo(f"  {path}")
    typer.echo("Nothing was written.")


def print_json(content: dict[str, Any]) -> None:
    """Print one JSON object; numbers that are not finite are printed as null."""
    import json

    from edl_filter.results.files import finite

    typer.echo(json.dumps(finite(content), allow_nan=False))
