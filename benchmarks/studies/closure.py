"""Closure over many flights: how often coefficients, density, temperature and angles lie within two sigma.

Simulated flights with the database's own physics (``tests/postflight/model_flights.py``), the errors of each
reconstruction drawn from their sigmas; a Gaussian band holds 95.4 %. Once as the database has CA, once with CA drawn
from its 3 sigma. Ends with 1 if less than 95 % lie within, by more than two flights.

Run: ``python benchmarks/studies/closure.py [FLIGHTS]``, a power of two
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2] / "tests" / "postflight"))

from model_flights import QUANTITIES, axial_sigma, shares


def main() -> int:
    """Print both tables."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 1024
    least = 1.0
    for title, axial in (("the database's CA", None), ("CA drawn from its uncertainty", axial_sigma())):
        by_window = shares(count, axial)
        print(f"{count} flights, {title}: percent of the samples within two sigma")
        for k, window in enumerate(by_window):
            print(f"  ({k + 1}) {window}")
        print(f"  {'':14s}" + "".join(f"{f'({k + 1})':>8s}" for k in range(len(by_window))))
        for name in QUANTITIES:
            row = [by_name[name] for by_name in by_window.values()]
            least = min(least, *row)
            print(f"  {name:14s}" + "".join(f"{100.0 * share:8.1f}" for share in row))
    print(f"least: {100.0 * least:.1f} %")
    return int(least < 0.95 - 2.0 / count)


if __name__ == "__main__":
    sys.exit(main())
