"""A program for cases that do nothing for a moment, or fail as a file says: ``python -m faulty_cases``.

The environment variable ``FAULTS`` names a folder with ``faults.json`` (number of a case → fault); the numbers of the
cases that begin and end are appended to ``begun`` and ``ended`` in it.
"""

import json
import os
import resource
import time
from pathlib import Path

from edl_filter.workflow.campaign_process import serve

#: Time of a case, s.
LENGTH_S = 0.1


def note(path, number):
    """Append a number as one write, which several processes may do at the same time."""
    descriptor = os.open(path, os.O_WRONLY | os.O_APPEND | os.O_CREAT)
    os.write(descriptor, f"{number}\n".encode())
    os.close(descriptor)


class FaultyRunner:
    """Cases without a flight."""

    def __init__(self, campaign):
        self.campaign, self.folder = campaign, Path(os.environ["FAULTS"])

    def run(self, number):
        fault = json.loads((self.folder / "faults.json").read_text()).get(str(number))
        note(self.folder / "begun", number)
        if fault == "raise":
            raise ZeroDivisionError("a case that raises")
        if fault == "hang":
            while True:
                pass
        if fault == "exit":
            os._exit(7)
        if fault == "full":  # EFBIG from the first byte beyond the limit, as a full disk gives ENOSPC
            resource.setrlimit(resource.RLIMIT_FSIZE, (10, resource.RLIM_INFINITY))
        time.sleep(LENGTH_S)
        note(self.folder / "ended", number) if fault != "full" else None
        key = self.campaign.case(number)
        values = {"trustworthy": 1.0, "landing_sigma": float(number), "event_time": {"landing": 100.0 + number}}
        return {
            "case": number, "flight": key.flight, "dispersion": key.dispersion, "seed": number, "hidden": [],
            "values": values, "seconds": LENGTH_S, "processor_seconds": 0.0,
        }  # fmt: skip


if __name__ == "__main__":
    serve(FaultyRunner)
