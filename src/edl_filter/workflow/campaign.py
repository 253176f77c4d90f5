"""A campaign on dask.distributed: which cases are missing, blocks of these for the scheduler, and what became of them.

The records on disk are the only state: whatever is interrupted (a worker, the scheduler, this process), the cases that
have no file are missing and nothing else. A lost scheduler is waited for; what was not complete is submitted again.
"""

from __future__ import annotations

import logging
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any

from edl_filter.errors import InputError
from edl_filter.estimation.parallel import processors
from edl_filter.simulation.campaign_config import Campaign
from edl_filter.workflow.campaign_files import (
    FAILURES,
    CampaignJob,
    Progress,
    claim_folder,
    ranges_text,
    read_progress,
)
from edl_filter.workflow.campaign_process import close_processes, run_block

#: Most cases in a block; and the share of the cases that are left, per thread, which a block may have: blocks become
#: smaller towards the end, so that all threads end at about the same time (guided self-scheduling).
MOST_IN_BLOCK, LEFT_SHARE = 100, 0.25
#: Blocks for each thread that the scheduler holds at one time.
WAITING_BLOCKS = 3
#: Attempts of a block whose worker ends.
ATTEMPTS = 5
#: Settings of a cluster of this machine. Its workers wait for their processes for cases; with dask's defaults each of
#: them takes 2 % of a processor for samples of its stack, and for ticks and measurements of itself.
_QUIET_CLUSTER = {
    "distributed.worker.profile.enabled": False,
    "distributed.admin.tick.interval": "1s",
    "distributed.admin.tick.limit": "60s",
    "distributed.admin.system-monitor.interval": "5s",
    "distributed.admin.system-monitor.gil.enabled": False,
}
#: Time between two looks at the scheduler, s.
_TICK_S = 1.0


@dataclass(frozen=True)
class CampaignState:
    """Counts of a campaign's cases while it runs."""

    total: int
    done: int
    failed: int
    dashboard: str = ""


@dataclass(frozen=True, eq=False)
class CampaignOutcome:
    """How a campaign ended.

    Attributes
    ----------
    progress : Progress
        Which cases are complete.
    stopped : str
        Why cases are missing; empty if none is.
    """

    progress: Progress
    stopped: str

    @property
    def sentence(self) -> str:
        """What is complete, and what is missing."""
        done, failed = int(self.progress.done.sum()), int(self.progress.failed.sum())
        missing = self.progress.missing
        text = f"{done} of {len(self.progress.done)} cases are done"
        if failed:
            text += f", {failed} failed"
        if missing:
            text += f", {len(missing)} are missing ({ranges_text(missing)})"
        return f"{text}."


Report = Callable[[CampaignState], None]


def run_campaign(
    campaign: Campaign,
    folder: Path,
    scheduler: str | None = None,
    workers: int | None = None,
    retry: bool = False,
    patience_s: float = 60.0,
    report: Report = lambda _: None,
    program: str | None = None,
) -> CampaignOutcome:
    """Run the cases that a folder lacks.

    Parameters
    ----------
    campaign : Campaign
        The campaign, checked.
    folder : Path
        Held by the caller (`edl_filter.io.output_folder.output_folder`).
    scheduler : str, optional
        Address of a dask scheduler whose workers see `folder` under the same path; otherwise processes of this machine.
    workers : int, optional
        Number of these; by default one for each processor of this process.
    retry : bool
        Whether failed cases are run again.
    patience_s : float
        How long a scheduler, or one without workers, is waited for, s.
    report : callable
        Called with the counts when they change.
    program : str, optional
        Module that runs cases in place of `edl_filter.workflow.campaign_process`.

    Returns
    -------
    CampaignOutcome

    Raises
    ------
    InputError
        dask is not installed, the scheduler does not answer, or the folder holds another campaign.
    """
    _require_dask()
    claim_folder(folder, campaign)
    if retry:
        for path in (folder / FAILURES).glob("[0-9]*/[0-9]*.json"):
            path.unlink()
    progress = read_progress(folder, campaign.total)
    missing = progress.missing
    done, failed = int(progress.done.sum()), int(progress.failed.sum())
    report(CampaignState(campaign.total, done, failed))
    if not missing:
        return CampaignOutcome(progress, "")
    job = CampaignJob.of(campaign, folder)
    if program is not None:
        job = replace(job, program=program)
    stopped = ""
    with connections(scheduler, workers, patience_s) as connect:
        deadline = time.monotonic() + patience_s
        while True:
            client = connect()
            if client is None:
                stopped = f"the scheduler {scheduler} was lost and did not return within {patience_s:g} s"
                break
            before = len(missing)
            distribution = _Distribution(client, job, missing, patience_s)
            counts = CampaignState(campaign.total, done, failed, client.dashboard_link or "")
            stopped = distribution.run(counts, report)
            progress = read_progress(folder, campaign.total)
            missing = progress.missing
            done, failed = int(progress.done.sum()), int(progress.failed.sum())
            if stopped != _LOST or not missing:
                break
            if len(missing) < before:
                deadline = time.monotonic() + patience_s
            elif time.monotonic() > deadline:
                stopped = f"the scheduler {scheduler} is lost again and again"
                break
    report(CampaignState(campaign.total, done, failed))
    return CampaignOutcome(progress, "" if not missing else stopped or "a part of the cases was not run")


#: Why a distribution ends if the connection to the scheduler ends.
_LOST = "the connection to the scheduler was lost"


class _Distribution:
    """Blocks of cases on their way through one scheduler."""

    def __init__(self, client: Any, job: CampaignJob, missing: list[int], patience_s: float) -> None:
        self.client, self.job, self.patience_s = client, job, patience_s
        self.threads = self._threads() or 1
        self.left, self.repeated = deque(missing), list[tuple[list[int], int]]()
        self.running: dict[str, tuple[Any, list[int], int]] = {}
        self.finished: SimpleQueue[Any] = SimpleQueue()
        self.alone_since: float | None = None
        self.submitted = 0

    def run(self, counts: CampaignState, report: Report) -> str:
        """Distribute all blocks; why it ended before, or nothing."""
        report(counts)
        stopped = ""
        while not stopped and (self.left or self.repeated or self.running):
            while (self.left or self.repeated) and len(self.running) < max(4, WAITING_BLOCKS * self.threads):
                self._submit(*self._next_block())
            try:
                future = self.finished.get(timeout=_TICK_S)
            except Empty:
                stopped = self._health()
                continue
            outcome, stopped = self._collect(future)
            if outcome is not None:
                done, failed = counts.done + outcome["done"], counts.failed + outcome["failed"]
                counts = CampaignState(counts.total, done, failed, counts.dashboard)
                report(counts)
        self._cancel()
        return stopped

    def _next_block(self) -> tuple[list[int], int]:
        """Numbers of cases, and which attempt it is to run them."""
        if self.repeated:
            return self.repeated.pop()
        size = max(1, min(MOST_IN_BLOCK, int(LEFT_SHARE * len(self.left) / self.threads)))
        return [self.left.popleft() for _ in range(size)], 1

    def _submit(self, numbers: list[int], attempt: int) -> None:
        self.submitted += 1
        key = f"cases-{numbers[0]}-{numbers[-1]}-{attempt}-{self.submitted}"
        future = self.client.submit(run_block, self.job, numbers, key=key, pure=False)
        self.running[key] = (future, numbers, attempt)
        future.add_done_callback(self.finished.put)

    def _collect(self, future: Any) -> tuple[dict[str, Any] | None, str]:
        """Outcome of a block; why the distribution ends, if it does."""
        _, numbers, attempt = self.running.pop(future.key, (None, [], 0))
        if future.status == "finished":
            outcome = future.result()
            future.release()
            if outcome["not_written"]:
                return outcome, f"a result could not be written: {outcome['not_written']}"
            return outcome, ""
        if future.status != "error":  # cancelled or lost with its scheduler
            return None, _LOST
        error = future.exception()
        future.release()
        if type(error).__name__ == "KilledWorker" and attempt < ATTEMPTS:
            self.repeated.append((numbers, attempt + 1))
            return None, ""
        return None, f"workers cannot run cases {ranges_text(numbers)} ({type(error).__name__}: {error})"

    def _health(self) -> str:
        """Why the distribution cannot go on, if it cannot."""
        if self.client.status != "running":
            return _LOST
        self.threads = self._threads() or self.threads
        if self._threads():
            self.alone_since = None
            return ""
        now = time.monotonic()
        self.alone_since = now if self.alone_since is None else self.alone_since
        if now - self.alone_since < self.patience_s:
            return ""
        return f"the scheduler has had no worker for {self.patience_s:g} s"

    def _threads(self) -> int:
        try:
            return sum(self.client.nthreads().values())
        except Exception:  # the scheduler is being lost, which `_health` says
            return 0

    def _cancel(self) -> None:
        futures = [future for future, _, _ in self.running.values()]
        self.running.clear()
        if futures and self.client.status == "running":
            try:
                self.client.cancel(futures)
            except Exception:  # the scheduler was lost in between
                return


@contextmanager
def connections(scheduler: str | None, workers: int | None, patience_s: float) -> Iterator[Callable[[], Any]]:
    """Connections to a scheduler, or to a cluster of this machine that ends with the context.

    Parameters
    ----------
    scheduler : str or None
        Address of a dask scheduler; None: processes of this machine.
    workers : int or None
        Number of these; None: one for each processor.
    patience_s : float
        How long a scheduler is waited for, s.

    Yields
    ------
    callable
        Returns a client, again where a connection was lost, and None if that fails for too long.

    Raises
    ------
    InputError
        dask is not installed, or no scheduler answers at the first connection.
    """
    _require_dask()
    import dask
    from distributed import Client, LocalCluster

    for name in ("distributed", "distributed.core", "tornado.application"):
        logging.getLogger(name).setLevel(logging.CRITICAL)
    client: Any = None
    cluster: Any = None
    settings = ExitStack()
    settings.enter_context(dask.config.set(_QUIET_CLUSTER))
    try:
        if scheduler is None:
            cluster = LocalCluster(
                n_workers=workers or processors(),
                threads_per_worker=1,
                processes=True,
                host="127.0.0.1",
                dashboard_address="127.0.0.1:0",
                silence_logs=logging.CRITICAL,
                memory_limit=0,
            )

        def connect() -> Any:
            nonlocal client
            first = client is None
            if client is not None:
                client.close(timeout=1)
            deadline = time.monotonic() + (patience_s if not first else min(10.0, patience_s))
            while True:
                try:
                    client = Client(cluster if cluster is not None else scheduler, timeout=3)
                    return client
                except (OSError, TimeoutError, ValueError) as error:
                    if first and (isinstance(error, ValueError) or time.monotonic() > deadline):
                        raise InputError(
                            f"--scheduler {scheduler}: no dask scheduler answers there; the address of one is "
                            "expected, such as tcp://192.0.2.7:8786."
                        ) from None
                    if time.monotonic() > deadline:
                        return None
                    time.sleep(1.0)

        yield connect
    finally:
        if client is not None and client.status == "running":
            try:
                client.run(close_processes)
            except Exception:  # a worker that ends closes its processes itself
                logging.getLogger("edl_filter").debug("the workers did not receive the request to end their processes")
        for part in (client, cluster):
            if part is not None:
                part.close(timeout=5)
        settings.close()


def _require_dask() -> None:
    if any(find_spec(name) is None for name in ("distributed", "zarr")):
        raise InputError(
            "campaign: needs dask.distributed and zarr; install them with: pip install 'edl-filter[campaign]'."
        )
