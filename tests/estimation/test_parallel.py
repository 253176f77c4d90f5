"""Threads and copies of the process: order of the results, errors, and one BLAS thread inside."""

import fcntl
import os
import runpy
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from edl_filter.estimation import parallel
from edl_filter.estimation.parallel import in_background, map_threads, one_blas_thread, processors


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
    """Unless the environment states a number of at least one."""
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(available)), raising=False)
    monkeypatch.delenv(parallel.WORKERS_VARIABLE, raising=False)
    for stated in ("7", "1"):
        with monkeypatch.context() as context:
            context.setenv(parallel.WORKERS_VARIABLE, stated)
            assert runpy.run_path(parallel.__file__)["WORKERS"] == int(stated)
    for wrong in ("0", "-1", "two", ""):
        with monkeypatch.context() as context:
            context.setenv(parallel.WORKERS_VARIABLE, wrong)
            assert runpy.run_path(parallel.__file__)["WORKERS"] == threads
    assert runpy.run_path(parallel.__file__)["WORKERS"] == threads


def test_results_are_in_the_order_of_the_items():
    def slow_square(x):
        time.sleep(0.002 * (5 - x))
        return x * x

    assert map_threads(slow_square, range(5)) == [0, 1, 4, 9, 16]
    assert map_threads(slow_square, []) == []


def test_items_are_computed_by_several_threads_with_one_blas_thread_each(monkeypatch):
    monkeypatch.setattr(parallel, "WORKERS", 3)
    barrier = threading.Barrier(3)

    def meet(_):
        barrier.wait(timeout=10.0)  # returns only when all threads have arrived
        return blas_threads()

    assert map_threads(meet, range(3)) == [{1}] * 3


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


BEGIN = """
import os, signal, sys, threading, time
from edl_filter.estimation import parallel
from edl_filter.estimation.parallel import in_background, map_processes, process_count
parallel.WORKERS = 2
first = os.getpid()
in_copy = lambda: os.getpid() != first
"""


def run(code, exit_code=0):
    """Words that a script prints in a process of its own, which has one thread and may be copied."""
    command = [sys.executable, "-c", BEGIN + code]
    same_package = os.environ | {"PYTHONPATH": str(Path(parallel.__file__).parents[2])}
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, env=same_package)
    assert done.returncode == exit_code and not done.stderr, done.stderr
    return done.stdout.split()


def test_items_are_computed_by_copies_of_the_process():
    """Each waits until another process computes as well; results are in the order of the items."""
    code = """
import multiprocessing
barrier = multiprocessing.get_context("fork").Barrier(2)
def meet(x):
    barrier.wait(timeout=20)
    return x * x, in_copy()
values = map_processes(meet, range(4))
print([v for v, _ in values] == [0, 1, 4, 9], sorted(c for _, c in values) == [False, False, True, True])
"""
    assert run(code) == ["True", "True"]


def test_shared_objects_are_not_copied():
    code = """
shared, other = ["model"], ["state"]
def refer(x):
    time.sleep(0.1)
    return {"shared": shared, "other": other, "copy": in_copy()}
values = map_processes(refer, range(4), [shared])
(copied, *_) = [v for v in values if v["copy"]]
print(copied["shared"] is shared, copied["other"] == other, copied["other"] is other)
"""
    assert run(code) == ["True", "True", "False"]


def test_the_error_of_the_first_item_is_raised():
    """With the place where it was raised, whichever process was at it; items that follow are not begun any more."""
    code = """
import traceback
class OwnError(Exception):
    def __init__(self, item, reason):  # a pickle of it cannot be read
        super().__init__(item)
def fail(x):
    time.sleep(0.2 if x == 1 else 0.05)
    if 0 < x < 6:
        raise OwnError(x, "odd")
begin = time.perf_counter()
try:
    map_processes(fail, range(400))
except OwnError as error:
    print(error, traceback.extract_tb(error.__traceback__)[-1].name, time.perf_counter() - begin < 5)
"""
    assert run(code) == ["1", "fail", "True"]


def test_an_interrupt_is_that_of_the_process_that_started_the_copies():
    code = """
os.setsid()
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell may have switched it off
def value(x):
    time.sleep(0.1)
    if not in_copy():
        os.killpg(0, signal.SIGINT)
    time.sleep(0.1)
try:
    map_processes(value, range(100))
except KeyboardInterrupt:
    print("interrupted")
"""
    assert run(code) == ["interrupted"]
    code = """
signal.signal(signal.SIGINT, signal.default_int_handler)
def value(x):
    time.sleep(0.1)
    if in_copy():
        os.kill(os.getpid(), signal.SIGINT)
    return in_copy()
print(any(map_processes(value, range(4))))
"""
    assert run(code) == ["True"]


@pytest.mark.parametrize(
    "in_the_copy",
    [
        "os.kill(os.getpid(), signal.SIGKILL)",
        "return lambda: x",
        "return Unreadable()",
        "raise RuntimeError('this process was started by another one')",
    ],
    ids=["killed", "not picklable", "pickle not readable", "error"],
)
def test_what_a_copy_does_not_return_is_computed_here(in_the_copy):
    code = f"""
class Unreadable:
    def __reduce__(self):
        return int, ("no number",)
def value(x):
    time.sleep(0.1)
    if in_copy():
        {in_the_copy}
    return x, os.getpid() == first
print(map_processes(value, range(4)) == [(x, True) for x in range(4)])
with in_background(lambda: value(7)) as result:
    print(result() == (7, True))
"""
    assert run(code) == ["True", "True"]


def test_a_process_is_copied_only_where_that_is_safe():
    """Not in a copy, not while another thread runs, and not on macOS."""
    code = """
print(process_count())
values = map_processes(lambda _: (time.sleep(0.1), in_copy(), process_count()), range(2))
print(*sorted(v[1:] for v in values)[1])
release = threading.Event()
thread = threading.Thread(target=release.wait)
thread.start()
print(process_count(), *map_processes(lambda _: (time.sleep(0.1), in_copy())[1], range(2)))
release.set()
thread.join()
sys.platform = "darwin"
print(process_count())
"""
    assert run(code) == ["2", "True", "1", "1", "False", "False", "1"]


def test_a_function_is_computed_while_the_process_goes_on():
    code = """
with in_background(lambda: (time.sleep(0.2), in_copy())) as result:
    begin = time.perf_counter()
    print(time.perf_counter() - begin < 0.1, result()[1], result() is result())
try:
    with in_background(lambda: 1 / 0) as result:
        result()
except ZeroDivisionError as error:
    print("raised")
"""
    assert run(code) == ["True", "True", "True", "raised"]


def test_a_copy_ends_with_its_context():
    code = """
with in_background(lambda: time.sleep(50)):
    begin = time.perf_counter()
print(time.perf_counter() - begin < 10)
"""
    assert run(code) == ["True"]


@pytest.mark.skipif(sys.platform != "linux", reason="the signal of the parent's end is one of Linux")
@pytest.mark.parametrize(
    "call", ["map_processes(value, range(4))", "context = in_background(lambda: value(1)); context.__enter__()"]
)
def test_a_copy_ends_with_the_process_that_started_it(call, tmp_path):
    """At once, within an item: a copy has the locks of its parent, and its output."""
    code = f"""
import fcntl
file = open({str(tmp_path / "lock")!r}, "w")
fcntl.flock(file, fcntl.LOCK_EX)
def value(x):
    time.sleep(100.0 if in_copy() else 0.2)  # the test waits for a minute
    os.kill(os.getpid(), signal.SIGKILL)
{call}
value(0)
"""
    assert run(code, -signal.SIGKILL) == []
    with (tmp_path / "lock").open() as file:
        fcntl.flock(file, fcntl.LOCK_EX)


def test_a_function_is_started_in_a_thread_where_the_process_may_not_be_copied(monkeypatch):
    monkeypatch.setattr(parallel, "process_count", lambda: 1)
    release = threading.Event()

    def value():
        release.wait(timeout=10.0)
        return threading.current_thread() is not threading.main_thread()

    with in_background(value) as result:
        release.set()
        assert result() is True and result() is True
    with in_background(lambda: time.sleep(3.0)):
        begin = time.perf_counter()
    assert time.perf_counter() - begin < 1.0  # it goes on
    with pytest.raises(ZeroDivisionError), in_background(lambda: 1 / 0) as result:
        result()
