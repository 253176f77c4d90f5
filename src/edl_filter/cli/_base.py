"""What all commands share: errors as messages and exit codes, signs of life, one JSON object.

Nothing heavy is imported here either.
"""

from __future__ import annotations

import os
import sys
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import typer
from typer.core import TyperGroup

from edl_filter.errors import InputError

#: Environment variable that, set to ``lines``, makes commands tell each step on standard error behind this mark.
PROGRESS, PROGRESS_MARK = "EDL_FILTER_PROGRESS", "progress: "


class Commands(TyperGroup):
    """Turns exceptions into messages and exit codes, for all commands alike."""

    def invoke(self, ctx: Any) -> Any:
        """Run a command."""
        try:
            done = super().invoke(ctx)
            sys.stdout.flush()
            return done
        except BrokenPipeError:  # the reader, such as head, has seen enough
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            raise typer.Exit(0) from None
        except Exception as error:
            if type(error).__module__.split(".")[0] in ("typer", "click"):
                raise  # these carry their own message and code
            if ctx.params.get("debug"):
                traceback.print_exc()
            if isinstance(error, InputError):
                typer.echo(f"edl-filter: {error}", err=True)
                raise typer.Exit(2) from None
            typer.echo(
                f"edl-filter: a fault of ours: {type(error).__name__}: {error}\n"
                "Run 'edl-filter --debug COMMAND …' to see where, and please report it.",
                err=True,
            )
            raise typer.Exit(1) from None


@contextmanager
def busy(what: str, quiet: bool) -> Iterator[Callable[[str], None]]:
    """Show that work goes on, on a terminal or as lines for a program; gives what is told of each step."""
    if os.environ.get(PROGRESS) == "lines":
        typer.echo(f"{PROGRESS_MARK}{what}", err=True)
        yield lambda step: typer.echo(f"{PROGRESS_MARK}{what}: {step}", err=True)
        return
    if quiet or not sys.stdout.isatty():
        yield lambda _: None
        return
    from rich.console import Console

    with Console(stderr=True).status(f"{what} …") as status:
        yield lambda step: status.update(f"{what}: {step} …")


def print_json(content: dict[str, Any]) -> None:
    """Print one JSON object."""
    import json

    from edl_filter.results.plain import finite

    typer.echo(json.dumps(finite(content), allow_nan=False))
