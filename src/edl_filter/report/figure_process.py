"""Figures drawn in processes of their own, which load matplotlib while a run still computes.

`FigureProcess` starts ``python -m edl_filter.report.figure_process``, which imports matplotlib, waits for one request
(a folder with a complete result, names and formats) and answers with the paths of the figures. It draws with several
processes (`estimation.parallel.WORKERS`) where the system can fork. It ends with its parent. Where no process can be
started, the figures are drawn in the present one.
"""

from __future__ import annotations

import gc
import json
import signal
import subprocess
import sys
from collections.abc import Sequence
from contextlib import suppress
from functools import cache
from io import BytesIO
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, NamedTuple

from edl_filter.errors import InputError
from edl_filter.estimation.parallel import map_processes

if TYPE_CHECKING:
    from edl_filter.results.reader import ResultReader


class FigureProcess:
    """A process that draws the figures of one result; a context manager, at whose end it stops.

    Examples
    --------
    >>> with FigureProcess() as process:                  # matplotlib is imported there meanwhile
    ...     write_the_result(folder)
    ...     process.start(folder, folder / "figures", ["png"])
    ...     paths = process.wait()
    """

    def __init__(self) -> None:
        self._request: tuple[Path, Path, tuple[str, ...]] | None = None
        self._process: subprocess.Popen[str] | None = None

    def __enter__(self) -> FigureProcess:
        if not sys.executable:  # Python is part of another program
            return self
        command = [sys.executable, "-m", __name__]
        try:
            self._process = subprocess.Popen(
                command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
            )
        except OSError:
            self._process = None
        return self

    def start(self, result: Path, folder: Path, formats: Sequence[str]) -> None:
        """Begin to draw the figures of a result.

        Parameters
        ----------
        result : Path
            Folder of the complete result.
        folder : Path
            Folder of the figures, created if it does not exist.
        formats : sequence of str
            Of `results.files.FIGURE_FORMATS`.
        """
        self._request = (result, folder, tuple(formats))
        if self._process is None or self._process.stdin is None:
            return
        try:
            line = {"result": str(result.absolute()), "folder": str(folder.absolute()), "formats": list(formats)}
            self._process.stdin.write(json.dumps(line) + "\n")
            self._process.stdin.flush()
        except OSError:  # it has ended; `wait` draws here
            return

    def wait(self) -> list[Path]:
        """Paths of the figures, when all are complete.

        Raises
        ------
        InputError
            The folder cannot be written.
        """
        assert self._request is not None
        answer = ""
        if self._process is not None and self._process.stdout is not None:
            answer = self._process.stdout.readline()
        result, folder, formats = self._request
        if not answer:
            from edl_filter.report.figures import draw_all
            from edl_filter.results.reader import ResultReader

            with ResultReader.open(result) as reader:
                return draw_all(reader, folder, formats)
        content = json.loads(answer)
        if "error" in content:
            raise InputError(content["error"])
        return [folder / name for name in content["names"]]

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._process is None:
            return
        if kind is not None:
            self._process.kill()
        with suppress(OSError), self._process:  # closes its input, at which it ends
            pass


def main() -> None:
    """Import matplotlib, wait for a request on standard input, draw, and answer on standard output."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # Ctrl-C ends it without a traceback
    gc.disable()  # it lives as long as one set of figures
    _warm_up()
    line = sys.stdin.readline()
    if not line:
        return
    request = json.loads(line)
    try:
        answer: dict[str, object] = {
            "names": _draw(Path(request["result"]), Path(request["folder"]), request["formats"])
        }
    except InputError as error:
        answer = {"error": str(error)}
    print(json.dumps(answer), flush=True)


def _draw(result: Path, folder: Path, formats: Sequence[str]) -> list[str]:
    """Draw all figures of a result; their file names."""
    from edl_filter.report.figures import available
    from edl_filter.results.reader import ResultReader

    with ResultReader.open(result) as reader:
        tasks = [_Task(result, name, folder, tuple(formats)) for name in available(reader)]
    return [name for names in map_processes(_draw_task, tasks) for name in names]


class _Task(NamedTuple):
    """One figure to draw: folder of the result, name, folder of the figures, formats."""

    result: Path
    name: str
    folder: Path
    formats: tuple[str, ...]


def _draw_task(task: _Task) -> list[str]:
    from edl_filter.report.figures import draw_figure

    paths = draw_figure(_reader(task.result), task.name, task.folder, task.formats)
    return [path.name for path in paths]


@cache
def _reader(result: Path) -> ResultReader:
    """Reader of a result, one for each process: open files are not shared."""
    from edl_filter.results.reader import ResultReader

    return ResultReader.open(result)


def _warm_up() -> None:
    """Load matplotlib, its fonts and all descriptions."""
    import edl_filter.report.figures  # noqa: F401 -- loaded before the first figure is asked for
    from edl_filter.report.description import Axis, Figure, Panel
    from edl_filter.report.matplotlib_renderer import draw

    panel = Panel(Axis("time", "s", range=(0.0, 1.0)), Axis("q", "Pa", "log", range=(1.0, 10.0)), ())
    draw(Figure("", ((panel,),), (4.0,))).savefig(BytesIO(), format="png")


if __name__ == "__main__":
    main()
