"""Several processors: threads for compiled loops that release the interpreter lock, processes for everything else.

Small matrix products in a long loop run up to ten times slower with several BLAS threads, which wait for each other; so
BLAS is limited to one thread and the columns of a problem are divided among threads instead. Computations in the
interpreter are divided among copies of the process (`fork`), which share its memory until either side writes to it: the
inputs are not sent, only the results are.
"""

from __future__ import annotations

import gc
import io
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, ExitStack, contextmanager, suppress
from dataclasses import dataclass
from functools import cache
from typing import Generic, TypeVar, cast

from threadpoolctl import ThreadpoolController

Item = TypeVar("Item")
Value = TypeVar("Value")


def processors() -> int:
    """Number of processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


#: Number of threads or processes: one for each processor, at most four.
THREADS = min(4, processors())


def one_blas_thread() -> AbstractContextManager[object]:
    """A context in which BLAS uses one thread."""
    return _blas().limit(limits=1, user_api="blas")


def map_threads(function: Callable[[Item], Value], items: Iterable[Item]) -> list[Value]:
    """The function of every item, in the order of the items, computed by several threads."""
    with one_blas_thread(), ThreadPoolExecutor(THREADS) as pool:
        return list(pool.map(function, items))


def map_processes(
    function: Callable[[Item], Value],
    items: Iterable[Item],
    shared: Iterable[object] = (),
    processes: int = THREADS,
) -> list[Value]:
    """The function of every item, in the order of the items, computed by this process and by copies of it.

    Parameters
    ----------
    function : callable
        Its value must be picklable. What else it changes is lost with the copy in which it ran.
    items : iterable
        Each is given to the next process that is free.
    shared : iterable
        Objects of this process that a value may contain. The value that is returned contains them, and not copies.
    processes : int
        Largest number of processes.

    Returns
    -------
    list
        Computed one after the other where the process may not be copied (`simultaneous`).

    Raises
    ------
    Exception
        That of the first item whose function raises one.
    """
    items = list(items)
    count = min(len(items), processes)
    if count < 2 or simultaneous() < 2:
        return [function(item) for item in items]
    import multiprocessing

    following = multiprocessing.get_context("fork").Value("l", 0)

    def compute_share() -> dict[int, _Outcome[Value]]:
        share: dict[int, _Outcome[Value]] = {}
        parent = multiprocessing.parent_process()
        while parent is None or parent.is_alive():
            with following.get_lock():
                k, following.value = following.value, following.value + 1
            if k >= len(items):
                break
            share[k] = _outcome(function, items[k])
            if share[k].error is not None:  # all items before it have been given out
                following.value = len(items)
        return share

    with ExitStack() as stack:
        copies = [stack.enter_context(_copy(compute_share, tuple(shared))) for _ in range(count - 1)]
        outcomes = compute_share()
        for wait in copies:
            outcomes |= wait() or {}
    return [(outcomes.get(k) or _outcome(function, item)).value_or_error() for k, item in enumerate(items)]


@contextmanager
def started(function: Callable[[], Value]) -> Iterator[Callable[[], Value]]:
    """Start a function in a copy of this process, or in a thread where it may not be copied.

    The callable of the context waits for its value; at the end of the context a copy is stopped.
    """
    if simultaneous() < 2:
        with ThreadPoolExecutor(1) as pool:
            yield pool.submit(function).result
        return
    with _copy(lambda: _outcome(lambda _: function(), None), ()) as wait:
        yield lambda: (wait() or _outcome(lambda _: function(), None)).value_or_error()


def simultaneous() -> int:
    """Number of items that `map_processes` computes at the same time.

    One where the process may not be copied: while other threads run, whose locks would stay locked in the copy, in a
    copy or a process of a pool, which are several already, and where the system has no copies or its libraries do not
    work in them (macOS).
    """
    import multiprocessing

    if sys.platform == "darwin" or "fork" not in multiprocessing.get_all_start_methods():
        return 1
    return 1 if multiprocessing.current_process().daemon or threading.active_count() > 1 else THREADS


@dataclass(frozen=True)
class _Outcome(Generic[Value]):
    """A value, or the error that was raised instead."""

    value: Value | None = None
    error: Exception | None = None

    def value_or_error(self) -> Value:
        """The value; the error is raised."""
        if self.error is not None:
            raise self.error
        return cast("Value", self.value)


def _outcome(function: Callable[[Item], Value], item: Item) -> _Outcome[Value]:
    try:
        return _Outcome(function(item))
    except Exception as error:
        return _Outcome(error=error)


@contextmanager
def _copy(compute: Callable[[], Value], shared: tuple[object, ...]) -> Iterator[Callable[[], Value | None]]:
    """A copy of this process that computes a value; the callable waits for it. The copy ends with the context.

    The value is None if the copy ends without it, as for lack of memory, or if it cannot be pickled.
    """
    import multiprocessing
    import pickle

    context = multiprocessing.get_context("fork")
    receiver, sender = context.Pipe(duplex=False)
    number = {id(value): i for i, value in enumerate(shared)}  # the same in the copy

    class Pickler(pickle.Pickler):
        def persistent_id(self, value: object) -> int | None:
            return number.get(id(value))

    class Unpickler(pickle.Unpickler):
        def persistent_load(self, i: int) -> object:
            return shared[i]

    def run() -> None:
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C ends the process that started it, which then ends it
        gc.disable()  # a collection would write to the memory that is shared
        receiver.close()
        content = io.BytesIO()
        with suppress(Exception):  # what it does not send is computed by the process that started it
            Pickler(content, pickle.HIGHEST_PROTOCOL).dump(compute())
            sender.send_bytes(content.getbuffer())

    def wait() -> Value | None:
        try:
            return cast("Value", Unpickler(io.BytesIO(receiver.recv_bytes())).load())
        except EOFError:
            return None

    process = context.Process(target=run, daemon=True)
    process.start()
    sender.close()
    try:
        yield wait
    finally:
        receiver.close()
        process.terminate()
        process.join()


@cache
def _blas() -> ThreadpoolController:
    return ThreadpoolController()
