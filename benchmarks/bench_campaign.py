"""Cost of a campaign: reconstructions of Spirit on one and on two local workers, for page and for `docs/scale.md`.

Times are processor times of all processes of the campaign, since other programs may use the machine. Of two campaigns
of different length the difference is free of imports and of the start of the cluster. Occupancy is the share of the
workers' time, from the first record to the last, in which cases run.

    python benchmarks/bench_campaign.py [--cases 100 400] [--workers 1 2] [--rows FILE]
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
from measuring import Grid, Row, Section, as_json, interleaved

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


def print_campaign(cases, workers):
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


def reconstruction_seconds():
    """Processor time of one reconstruction of Spirit in a process that has read the telemetry, s."""
    from edl_filter.mission import Mission
    from edl_filter.pipeline.load import read_atmosphere, read_telemetry
    from edl_filter.pipeline.reconstruct import FlightInputs, reconstruct

    mission = Mission.load("builtin:mer_a")
    inputs = FlightInputs(read_telemetry(mission), read_atmosphere(mission))
    functions = {"reconstruction": lambda: reconstruct(mission, leave_one_out=False, inputs=inputs)}
    return interleaved(functions, rounds=5).least("reconstruction")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, nargs=2, default=(100, 400))
    parser.add_argument("--workers", type=int, nargs="+", default=(1, 2))
    parser.add_argument("--rows", type=Path, help="JSON file to write")
    parser.add_argument("--one", type=int, nargs=2, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.one:
        print_campaign(*arguments.one)
        return
    marginal, totals, largest = {}, {}, []
    few, many = arguments.cases
    print("workers  cases  processor s   in a case, ms (median)  occupancy   gather, ms/case   MB: client worker case")
    for workers in arguments.workers:
        for cases in (few, many):
            total, median, _, share, gathering, size, *memory = measured(cases, workers)
            totals[workers, cases] = total
            largest.append(max(memory))
            print(
                f"{workers:>7}{cases:>7}{total:>13.1f}{1e3 * median:>20.1f}{share:>16.2f}"
                f"{1e3 * gathering / cases:>14.2f}{memory[0]:>17.0f}{memory[1]:>7.0f}{memory[2]:>6.0f}",
                flush=True,
            )
        marginal[workers] = (totals[workers, many] - totals[workers, few]) / (many - few)
        print(f"        each further case: {1e3 * marginal[workers]:.1f} ms of processor time; record {size:.0f} bytes")
    first, last = arguments.workers[0], arguments.workers[-1]
    print(f"efficiency of {last} workers against {first}, by processor time: {marginal[first] / marginal[last]:.0%}")
    if arguments.rows:
        rows = [
            Row(
                "a further case of a campaign, one worker",
                "reconstruction of Spirit in one process",
                marginal[first] / reconstruction_seconds(),
            ),
            Row(
                f"efficiency of {last} workers by processor time, %",
                f"{first} worker",
                100.0 * marginal[first] / marginal[last],
            ),
            Row("largest memory of one process of a campaign", "1 MB", max(largest)),
        ]
        unit = totals[first, few]
        lines = {f"{w} workers": [totals[w, c] / unit for c in (few, many)] for w in arguments.workers}
        grid = Grid("cases", [str(few), str(many)], lines)
        text = "Growth: processor time of all processes with their start, relative to the first number ([](scale.md))."
        arguments.rows.write_text(as_json([Section("Campaign", text, rows, grid)]))


if __name__ == "__main__":
    main()
