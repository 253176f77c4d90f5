"""Both filters against their own sigmas: 100 simulated flights of a minute, for two sets of states and constraints.

Averages over the flights of the normalised squares of the estimate's error (NEES) and of the innovations (NIS) must
lie inside their 95 % chi-square intervals (Bar-Shalom, Li & Kirubarajan 2001, section 5.4): too large means sigmas
too small, too small means sigmas too large. One test in twenty must fail by chance over all seeds; the seeds are
fixed.
"""

from collections import defaultdict
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import short_flights
from scipy.stats import chi2

from edl_filter.navigation.filter import run_filter
from edl_filter.navigation.smoother import smooth

COUNT = 100
TIMES = (10.0, 30.0, 50.0, 60.0)
KINDS = {"sensors": (short_flights.sensor_flights, 1), "onboard": (short_flights.onboard_flights, 1)}


@cache
def flights(kind):
    make, seed = KINDS[kind]
    return make(seed, COUNT, TIMES)


@cache
def study(kind, method):
    """Errors normalised by their covariance, by (estimate, states, time), and NIS by constraint."""
    nees, nis, sizes = defaultdict(list), defaultdict(list), {}
    for flight in flights(kind):
        settings = replace(flight.problem.settings, method=method)
        filter_pass = run_filter(replace(flight.problem, settings=settings))
        smoothed = smooth(filter_pass)
        for f in filter_pass.fused:
            nis[f.constraint.name].append((f.innovation.nis, len(f.innovation.residual)))
        for t in TIMES:
            i = min(range(len(filter_pass.nodes)), key=lambda i: abs(filter_pass.nodes[i].time - t))
            both = {
                "filtered": (filter_pass.nodes[i].state, filter_pass.nodes[i].covariance),
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


@pytest.mark.parametrize("method", ["ukf", "ekf"])
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("estimate", ["filtered", "smoothed"])
@pytest.mark.parametrize("part", ["navigation", "all"])
@pytest.mark.parametrize("time", TIMES)
def test_average_nees_is_in_its_interval(method, kind, estimate, part, time):
    nees, _, sizes = study(kind, method)
    low, high = interval(sizes[part], COUNT)
    assert low < np.mean(nees[estimate, part, time]) < high


@pytest.mark.parametrize("method", ["ukf", "ekf"])
@pytest.mark.parametrize("kind", KINDS)
def test_average_nis_is_in_its_interval(method, kind):
    """Of all constraints together, and of each kind."""
    _, nis, _ = study(kind, method)
    groups = {"together": [x for group in nis.values() for x in group], **nis}
    for name, group in groups.items():
        low, high = interval(sum(dof for _, dof in group) / COUNT, COUNT)
        assert low < sum(square for square, _ in group) / COUNT < high, name
