"""Threads for compiled loops that release the interpreter lock, with one BLAS thread in each.

Small matrix products in a long loop run up to ten times slower with several BLAS threads, which wait for each other; so
BLAS is limited to one thread and the columns of a problem are divided among threads instead.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager
from functools import cache
from typing import TypeVar

from threadpoolctl import ThreadpoolController

Item = TypeVar("Item")
Value = TypeVar("Value")


def processors() -> int:
    """Number of processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


#: Number of threads: one for each processor, at most four.
THREADS = min(4, processors())


def one_blas_thread() -> AbstractContextManager[object]:
    """A context in which BLAS uses one thread."""
    return _blas().limit(limits=1, user_api="blas")


def map_threads(function: Callable[[Item], Value], items: Iterable[Item]) -> list[Value]:
    """The function of every item, in the order of the items, computed by several threads."""
    with one_blas_thread(), ThreadPoolExecutor(THREADS) as pool:
        return list(pool.map(function, items))


def start_thread(function: Callable[[], Value]) -> Callable[[], Value]:
    """Start a function in a thread; the callable that is returned waits for its value."""
    pool = ThreadPoolExecutor(1)
    future = pool.submit(function)
    pool.shutdown(wait=False)
    return future.result


@cache
def _blas() -> ThreadpoolController:
    return ThreadpoolController()
