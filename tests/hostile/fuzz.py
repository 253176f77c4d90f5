"""Longer search for files that break a reader: ``make fuzz``.

With atheris (extra ``edl-filter[fuzz]``) the search is guided by coverage; without it mutations are random. A file that
breaks a reader is written to the folder ``fuzz-results``, and the exit code is 1. ``python fuzz.py [--seconds S]
[KIND …]``
"""

import argparse
import hashlib
import os
import random
import subprocess
import sys
import tempfile
import time
from collections import Counter
from importlib.util import find_spec
from pathlib import Path

import targets

RESULTS = Path("fuzz-results")


def keep(kind, data, error):
    """Write the file that broke a reader."""
    RESULTS.mkdir(exist_ok=True)
    path = RESULTS / f"{kind.replace(' ', '_')}-{hashlib.sha256(data).hexdigest()[:12]}"
    path.write_bytes(data)
    print(f"FAULT {kind}: {type(error).__name__}: {str(error)[:200]} ({path})", flush=True)


def random_search(kind, seconds, seed, folder):
    """Random mutations; number of files read, refused and at fault."""
    rng, valid, counts = random.Random(seed), targets.seeds(folder)[kind], Counter()
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        changes = [(rng.randrange(6), rng.random(), rng.random(), rng.randrange(1 << 16))
                   for _ in range(rng.choice((1, 1, 2, 4, 8)))]  # fmt: skip
        data = targets.mutated(valid, changes)
        try:
            outcome = targets.read(kind, data, folder, memory=rng.random() < 0.2)
            counts["read" if outcome == "read" else "refused"] += 1
        except Exception as error:
            keep(kind, data, error)
            counts["fault"] += 1
    return counts


def guided_search(kind, seconds, folder):
    """Coverage-guided search of atheris, in this process, which it ends."""
    import atheris

    corpus = folder / "corpus"
    corpus.mkdir()
    (corpus / "seed").write_bytes(targets.seeds(folder)[kind])
    atheris.instrument_all() if os.environ.get("FUZZ_INSTRUMENT_ALL") else None

    def read_input(data):
        try:
            targets.read(kind, data, folder, memory=False)
        except Exception as error:
            keep(kind, data, error)
            raise

    arguments = [sys.argv[0], str(corpus), f"-max_total_time={seconds}", "-rss_limit_mb=2048", "-timeout=30"]
    atheris.Setup([*arguments, f"-artifact_prefix={RESULTS.resolve()}/"], read_input)
    atheris.Fuzz()


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("kinds", nargs="*", help=", ".join(targets.READERS))
    parser.add_argument("--seconds", type=int, default=60, help="for each kind")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--guided", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        if arguments.guided:
            guided_search(arguments.guided, arguments.seconds, folder)
            return
        guided = find_spec("atheris") is not None
        faults = 0
        for kind in arguments.kinds or targets.READERS:
            counts = random_search(kind, arguments.seconds, arguments.seed, folder)
            faults += counts["fault"]
            print(f"{kind}: {counts['read']} read, {counts['refused']} refused, {counts['fault']} at fault", flush=True)
            if guided:
                RESULTS.mkdir(exist_ok=True)
                command = [sys.executable, __file__, "--guided", kind, "--seconds", str(arguments.seconds)]
                process = subprocess.run(command, capture_output=True, text=True)
                faults += process.returncode != 0
                last = [line for line in process.stderr.splitlines() if line.startswith(("#", "Done"))][-1:]
                print(f"{kind}, guided by coverage: exit code {process.returncode}; {' '.join(last)}", flush=True)
    sys.exit(1 if faults else 0)


if __name__ == "__main__":
    main()
