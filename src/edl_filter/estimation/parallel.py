"""Threads for compiled loops that hold no interpreter lock: one for each core up to four, and one for BLAS in each."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager
from functools import cache
from typing import TypeVar

from threadpoolctl import ThreadpoolController

Item = TypeVar("Item")
Found = TypeVar("Found")

#: Threads that are worth their while.
THREADS = min(4, os.cpu_count() or 1)


def one_blas_thread() -> AbstractContextManager[object]:
    """Small matrices in a long loop: threads that wait for each other cost ten times what they save."""
    return _blas().limit(limits=1, user_api="blas")


def in_threads(function: Callable[[Item], Found], items: Iterable[Item]) -> list[Found]:
    """The function of every item, in their order."""
    with one_blas_thread(), ThreadPoolExecutor(THREADS) as pool:
        return list(pool.map(function, items))


def meanwhile(function: Callable[[], Found]) -> Callable[[], Found]:
    """Begin a function beside what follows; calling what is given waits for its answer."""
    pool = ThreadPoolExecutor(1)
    begun = pool.submit(function)
    pool.shutdown(wait=False)
    return begun.result


@cache
def _blas() -> ThreadpoolController:
    return ThreadpoolController()
