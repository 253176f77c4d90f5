"""Threads: order of the results, errors, and one BLAS thread inside."""

import os
import runpy
import threading
import time

import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from edl_filter.estimation import parallel
from edl_filter.estimation.parallel import THREADS, map_threads, one_blas_thread, processors, start_thread


def blas_threads():
    return {pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"}


def test_processors_are_those_that_the_process_may_use(monkeypatch):
    """Where the system does not say which they are, all of the machine; at least one."""
    this_process = {0: {1, 4, 6}, os.getpid(): {1, 4, 6}}
    monkeypatch.setattr(os, "sched_getaffinity", lambda pid: this_process.get(pid, {1}), raising=False)
    monkeypatch.setattr(os, "cpu_count", lambda: 8)
    assert processors() == 3
    monkeypatch.delattr(os, "sched_getaffinity")
    assert processors() == 8
    monkeypatch.setattr(os, "cpu_count", lambda: None)
    assert processors() == 1


@pytest.mark.parametrize(("available", "threads"), [(1, 1), (3, 3), (4, 4), (5, 4), (64, 4)])
def test_a_thread_for_each_processor_and_at_most_four(available, threads, monkeypatch):
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(available)), raising=False)
    assert runpy.run_path(parallel.__file__)["THREADS"] == threads


def test_results_are_in_the_order_of_the_items():
    def slow_square(x):
        time.sleep(0.002 * (5 - x))
        return x * x

    assert map_threads(slow_square, range(5)) == [0, 1, 4, 9, 16]
    assert map_threads(slow_square, []) == []


def test_items_are_computed_by_several_threads_with_one_blas_thread_each():
    barrier = threading.Barrier(THREADS)

    def meet(_):
        barrier.wait(timeout=10.0)  # returns only when all threads have arrived
        return blas_threads()

    assert map_threads(meet, range(THREADS)) == [{1}] * THREADS


def test_the_number_of_blas_threads_is_restored():
    with threadpool_limits(2, user_api="blas"):  # the tests run with one
        before = blas_threads()
        assert 2 in before
        with one_blas_thread():
            assert blas_threads() == {1}
        assert blas_threads() == before


def test_an_error_in_a_thread_is_raised():
    with pytest.raises(ZeroDivisionError):
        map_threads(lambda x: 1 / x, [1, 0])
    result = start_thread(lambda: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        result()


def test_start_thread_returns_at_once_and_its_result_waits():
    release = threading.Event()

    def value():
        release.wait(timeout=10.0)
        return threading.current_thread() is not threading.main_thread()

    result = start_thread(value)
    release.set()
    assert result() is True and result() is True
