"""The filter against its own sigmas: 100 simulated flights of a minute, for two sets of states and statements.

Averages over the flights of the normalised squares of the estimate's error (NEES) and of the innovations (NIS) must
lie inside their 95 % chi-square intervals (Bar-Shalom, Li & Kirubarajan 2001, section 5.4): too large means sigmas
too small, too small means sigmas too large. One test in twenty must fail by chance over all seeds; the seeds are
fixed.
"""

from collections import defaultdict
from functools import cache

import numpy as np
import pytest
import short_flights
from scipy.stats import chi2

from edl_filter.navigation.filter import forward
from edl_filter.navigation.smoother import smooth

COUNT = 100
TIMES = (10.0, 30.0, 50.0, 60.0)
KINDS = {"sensors": (short_flights.sensor_flights, 1), "onboard": (short_flights.onboard_flights, 1)}


@cache
def study(kind):
    """Errors normalised by their covariance, by (way, states, time), and NIS by constraint."""
    make, seed = KINDS[kind]
    nees, nis, sizes = defaultdict(list), defaultdict(list), {}
    for flight in make(seed, COUNT, TIMES):
        way = forward(flight.problem)
        smoothed = smooth(way)
        for f in way.fused:
            nis[f.constraint.name].append((f.innovation.nis, len(f.innovation.residual)))
        for t in TIMES:
            i = min(range(len(way.nodes)), key=lambda i: abs(way.nodes[i].time - t))
            both = {
                "filtered": (way.nodes[i].state, way.nodes[i].covariance),
                "smoothed": (smoothed.states[i], smoothed.covariance[i]),
            }
            for name, (state, covariance) in both.items():
                error = flight.truth[t].minus(state)
                for part, n in (("navigation", 9), ("all", len(error))):
                    square = error[:n] @ np.linalg.solve(covariance[:n, :n], error[:n])
                    nees[name, part, t].append(square)
                    sizes[part] = n
    return nees, nis, sizes


def interval(dof, runs, probability=0.95):
    """Interval of the average over `runs` of chi-squares with `dof` degrees of freedom."""
    tail = 0.5 * (1.0 - probability)
    return chi2.ppf([tail, 1.0 - tail], dof * runs) / runs


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("way", ["filtered", "smoothed"])
@pytest.mark.parametrize("part", ["navigation", "all"])
@pytest.mark.parametrize("time", TIMES)
def test_average_nees_is_in_its_interval(kind, way, part, time):
    nees, _, sizes = study(kind)
    low, high = interval(sizes[part], COUNT)
    assert low < np.mean(nees[way, part, time]) < high


@pytest.mark.parametrize("kind", KINDS)
def test_average_nis_is_in_its_interval(kind):
    """Of all constraints together, and of each kind."""
    _, nis, _ = study(kind)
    groups = {"together": [x for group in nis.values() for x in group], **nis}
    for name, group in groups.items():
        low, high = interval(sum(dof for _, dof in group) / COUNT, COUNT)
        assert low < sum(square for square, _ in group) / COUNT < high, name
