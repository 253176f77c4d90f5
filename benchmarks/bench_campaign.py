"""Cost of a campaign: processor time and memory of reconstructions of Spirit on one and on two local workers.

Times are processor times of all processes of the campaign, since other programs may use the machine. Of two campaigns
of different length the difference is free of imports and of the start of the cluster. Occupancy is the share of the
workers' time, from the first record to the last, in which cases run.

    python benchmarks/bench_campaign.py [--cases 100 400] [--workers 1 2]
"""

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

import numpy as np
import psutil

CAMPAIGN = {
    "name": "bench",
    "leave_one_out": False,
    "flights": {"spirit": {"mission": "builtin:mer_a"}},
    "dispersions": {
        "wide": {
            "initial_state": {"position_sigma": 300.0, "velocity_sigma": 0.3},
            "imu_errors": 1.0,
            "air": {"density_sigma": 0.05, "wind_sigma": 5.0},
        }
    },
}


class Memory(threading.Thread):
    """Largest resident size of this process and of its descendants, each, MB, by kind."""

    def __init__(self):
        super().__init__(daemon=True)
        self.largest, self.ended = {}, threading.Event()

    def run(self):
        while not self.ended.wait(0.5):
            for process in [psutil.Process(), *psutil.Process().children(recursive=True)]:
                try:
                    words = " ".join(process.cmdline())
                    size = process.memory_info().rss / 1e6
                except psutil.Error:
                    continue
                kind = "case" if "campaign_process" in words else "client" if process.pid == os.getpid() else "worker"
                self.largest[kind] = max(self.largest.get(kind, 0.0), size)


def one_campaign(cases, workers):
    """Print processor time (s), time, occupancy, and largest memory of one campaign, in this process."""
    from edl_filter.simulation.campaign_config import Campaign
    from edl_filter.workflow.campaign import run_campaign
    from edl_filter.workflow.campaign_files import read_records
    from edl_filter.workflow.campaign_report import gather

    memory, done = Memory(), []
    memory.start()
    campaign = Campaign.from_dict(CAMPAIGN | {"cases": cases})
    with tempfile.TemporaryDirectory() as folder:
        results = Path(folder)
        outcome = run_campaign(
            campaign, results, workers=workers, report=lambda state: done.append((time.perf_counter(), state.done))
        )
        assert outcome.stopped == "" and outcome.progress.done.all(), outcome.sentence
        records = [r for shard in range((cases - 1) // 1000 + 1) for r in read_records(results, shard)]
        begin = time.process_time()
        gather(results)
        gathering = time.process_time() - begin
        size = np.mean([p.stat().st_size for p in results.glob("cases/*/*.json")])
    memory.ended.set()
    first = next((t, n) for t, n in done if n > 0)
    last = next((t, n) for t, n in done if n == cases)
    share = np.sum([r["seconds"] for r in records]) * (cases - first[1]) / cases / (workers * (last[0] - first[0]))
    usage = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    total = sum(u.ru_utime + u.ru_stime for u in usage)
    inside = np.sort([r["processor_seconds"] for r in records])
    largest = " ".join(f"{memory.largest.get(kind, np.nan):.0f}" for kind in ("client", "worker", "case"))
    print(f"{total} {np.median(inside)} {inside[workers:-workers].sum()} {share} {gathering} {size} {largest}")


def measured(cases, workers):
    """Numbers of one campaign, in a process of its own."""
    command = [sys.executable, __file__, "--one", str(cases), str(workers)]
    output = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    return [float(word) for word in output.split()]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, nargs=2, default=(100, 400))
    parser.add_argument("--workers", type=int, nargs="+", default=(1, 2))
    parser.add_argument("--one", type=int, nargs=2, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.one:
        one_campaign(*arguments.one)
        return
    marginal = {}
    few, many = arguments.cases
    print("workers  cases  processor s   in a case, ms (median)  occupancy   gather, ms/case   MB: client worker case")
    for workers in arguments.workers:
        totals = {}
        for cases in (few, many):
            total, median, _, share, gathering, size, *memory = measured(cases, workers)
            totals[cases] = total
            print(
                f"{workers:>7}{cases:>7}{total:>13.1f}{1e3 * median:>20.1f}{share:>16.2f}"
                f"{1e3 * gathering / cases:>14.2f}{memory[0]:>17.0f}{memory[1]:>7.0f}{memory[2]:>6.0f}", flush=True
            )  # fmt: skip
        marginal[workers] = (totals[many] - totals[few]) / (many - few)
        print(f"        each further case: {1e3 * marginal[workers]:.1f} ms of processor time; record {size:.0f} bytes")
    first, last = arguments.workers[0], arguments.workers[-1]
    print(f"efficiency of {last} workers against {first}, by processor time: {marginal[first] / marginal[last]:.0%}")


if __name__ == "__main__":
    main()
