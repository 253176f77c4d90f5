"""Several processors: threads for compiled loops that release the interpreter lock, processes for everything else.

Small matrix products in a long loop run up to ten times slower with several BLAS threads, which wait for each other; so
BLAS is limited to one thread and the columns of a problem are divided among threads instead. Computations in the
interpreter are divided among copies of the process (`fork`), which share its memory until either side writes to it: the
inputs are not sent, only the results are.
"""

from __future__ import annotations

import ctypes
import gc
import io
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, ExitStack, contextmanager, suppress
from functools import cache
from typing import TypeVar, cast

from threadpoolctl import ThreadpoolController

Item = TypeVar("Item")
Value = TypeVar("Value")


def processors() -> int:
    """Number of processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


#: Environment variable: number of threads or processes.
WORKERS_VARIABLE = "EDL_FILTER_WORKERS"


def workers() -> int:
    """Number of threads or processes: as stated by the environment, or one for each processor and at most four."""
    stated = os.environ.get(WORKERS_VARIABLE, "")
    return int(stated) if stated.isdecimal() and int(stated) > 0 else min(4, processors())


#: `workers` when this module was imported.
WORKERS = workers()
#: Option of prctl (linux/prctl.h): the signal that a process receives when its parent ends.
_PR_SET_PDEATHSIG = 1


def one_blas_thread() -> AbstractContextManager[object]:
    """A context in which BLAS uses one thread."""
    return _blas().limit(limits=1, user_api="blas")


def map_threads(function: Callable[[Item], Value], items: Iterable[Item]) -> list[Value]:
    """The function of every item, in the order of the items, computed by several threads."""
    with one_blas_thread(), ThreadPoolExecutor(WORKERS) as pool:
        return list(pool.map(function, items))


def map_processes(
    function: Callable[[Item], Value],
    items: Iterable[Item],
    shared: Iterable[object] = (),
) -> list[Value]:
    """The function of every item, computed by this process and by copies of it.

    A copy has one BLAS thread. What it does not return is computed again by this process: items whose function raises
    an error, whose value cannot be pickled, or during which the copy was killed.

    Parameters
    ----------
    function : callable
        Its value must be picklable. What else it changes is lost with the copy in which it ran.
    items : iterable
        Each is given to the next process that is free.
    shared : iterable
        Objects of this process that a value may contain. The value that is returned contains them, and not copies.

    Returns
    -------
    list
        In the order of the items.

    Raises
    ------
    Exception
        That of the first item whose function raises one.
    """
    items = list(items)
    count = min(len(items), process_count())
    if count < 2:
        return [function(item) for item in items]
    import multiprocessing

    following = multiprocessing.get_context("fork").Value("l", 0)

    def compute_share() -> dict[int, Value]:
        share: dict[int, Value] = {}
        while True:
            with following.get_lock():
                k, following.value = following.value, following.value + 1
            if k >= len(items):
                return share
            try:
                share[k] = function(items[k])
            except Exception:  # it is raised below, or by an item before it: all of those have been given out
                following.value = len(items)
                return share

    with one_blas_thread(), ExitStack() as stack:
        copies = [stack.enter_context(_copy(compute_share, tuple(shared))) for _ in range(count - 1)]
        values = compute_share()
        for wait in copies:
            values |= wait() or {}
    return [values[k] if k in values else function(item) for k, item in enumerate(items)]


@contextmanager
def in_background(function: Callable[[], Value]) -> Iterator[Callable[[], Value]]:
    """Compute a function in a copy of this process, or in a thread where it may not be copied.

    The callable of the context waits for its value. At the end of the context a copy is ended; a thread goes on, and
    what it reads must not change until then.
    """
    if process_count() < 2:
        pool = ThreadPoolExecutor(1)
        future = pool.submit(function)
        try:
            yield future.result
        finally:
            pool.shutdown(wait=False)
        return
    with one_blas_thread(), _copy(lambda: [function()], ()) as wait:

        @cache
        def value() -> Value:
            return (wait() or [function()])[0]

        yield value


def process_count() -> int:
    """Number of processes among which `map_processes` divides items at most.

    One where this process may not be copied: while other threads run, whose locks would stay locked in the copy, in a
    process of `multiprocessing`, which is one of several, and where the system has no copies or its libraries do not
    work in them (macOS).
    """
    import multiprocessing

    if sys.platform == "darwin" or "fork" not in multiprocessing.get_all_start_methods():
        return 1
    alone = multiprocessing.parent_process() is None and threading.active_count() == 1
    return WORKERS if alone else 1


@contextmanager
def _copy(compute: Callable[[], Value], shared: tuple[object, ...]) -> Iterator[Callable[[], Value | None]]:
    """A copy of this process that computes a value; the callable waits for it. The copy ends with the context.

    The value is None if the copy ends without it, as by an error or for lack of memory, or if no pickle can hold it.
    """
    import multiprocessing
    import pickle

    context = multiprocessing.get_context("fork")
    receiver, sender = context.Pipe(duplex=False)
    number = {id(value): i for i, value in enumerate(shared)}  # the same in the copy
    parent = os.getpid()

    class Pickler(pickle.Pickler):
        def persistent_id(self, value: object) -> int | None:
            return number.get(id(value))

    class Unpickler(pickle.Unpickler):
        def persistent_load(self, i: int) -> object:
            return shared[i]

    def run() -> None:
        _end_with(parent)
        gc.disable()  # a collection would write to the memory that is shared
        receiver.close()
        content = io.BytesIO()
        with suppress(Exception):
            Pickler(content, pickle.HIGHEST_PROTOCOL).dump(compute())
            sender.send_bytes(content.getbuffer())

    def wait() -> Value | None:
        try:
            return cast("Value", Unpickler(io.BytesIO(receiver.recv_bytes())).load())
        except Exception:  # the end of the copy, or a pickle that cannot be read
            return None

    process = context.Process(target=run, daemon=True)
    process.start()
    sender.close()
    try:
        yield wait
    finally:
        receiver.close()
        process.kill()
        process.join()


def _end_with(parent: int) -> None:
    """Let this copy end when the process that started it ends, and not by Ctrl-C, which ends that one.

    A copy has the locks of folders that its parent has, and would keep them.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:  # it ended before
        os._exit(1)


@cache
def _blas() -> ThreadpoolController:
    return ThreadpoolController()
