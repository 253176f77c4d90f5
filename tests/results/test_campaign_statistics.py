"""Statistics of a campaign on numbers whose distribution is known."""

import numpy as np
import pytest
import xarray

from edl_filter.results.campaign_statistics import ELLIPSE_95, ellipse, statistics
from edl_filter.results.campaign_variables import AXES, PARTS, PHASES, STATE

CASES = 4000


def dataset(**more):
    random = np.random.default_rng(1)
    error = random.standard_normal((CASES, len(PHASES), 9))
    position = np.array([3.39e6, 0.0, 0.0]) + random.standard_normal((CASES, 3)) * [5.0, 100.0, 50.0]
    nees = np.stack([np.sum(error[:, :, part] ** 2, axis=2) for part in PARTS.values()], axis=2)
    variables = {
        "event_time": (("case", "event"), 100.0 + 2.0 * random.standard_normal((CASES, 1))),
        "landing_position": (("case", "axis"), position),
        "state_error": (("case", "phase", "component"), 3.0 * error),
        "state_sigma": (("case", "phase", "component"), np.full_like(error, 3.0)),
        "nees": (("case", "phase", "part"), nees),
        "nis": (("case", "constraint"), random.chisquare(3.0, (CASES, 1))),
        "dof": (("case", "constraint"), np.full((CASES, 1), 3.0)),
        "rejected": (("case", "constraint"), np.zeros((CASES, 1))),
        "trustworthy": (("case",), np.ones(CASES)),
    } | more
    coordinates = {
        "case": np.arange(CASES), "flight": ("case", np.full(CASES, "a")), "dispersion": ("case", np.full(CASES, "x")),
        "outcome": ("case", np.where(np.arange(CASES) < CASES - 5, 0, 2)), "event": ["landing"], "axis": list(AXES),
        "phase": list(PHASES), "component": list(STATE), "part": list(PARTS), "constraint": ["landing"],
    }  # fmt: skip
    return xarray.Dataset(variables, coordinates)


def test_statistics_are_those_of_the_distribution():
    content = statistics(dataset())
    (group,) = content["groups"]
    assert content["outcomes"] == {"done": CASES - 5, "failed": 0, "missing": 5}
    (event,) = group["events"]
    assert event["mean"] == pytest.approx(100.0, abs=0.2)
    assert event["percentiles"]["95.0"] == pytest.approx(100.0 + 1.645 * 2.0, abs=0.3)
    landing = group["landing"]["estimate"]
    assert landing["semi_major_95_m"] == pytest.approx(ELLIPSE_95 * 100.0, rel=0.06)
    assert landing["semi_minor_95_m"] == pytest.approx(ELLIPSE_95 * 50.0, rel=0.06)
    assert landing["azimuth_deg"] == pytest.approx(90.0, abs=4.0)  # the y axis is east there
    for row in group["coverage"]:
        np.testing.assert_allclose(row["within_sigmas"], [0.6827, 0.9545, 0.9973], atol=0.03)
        assert row["nees_per_dof"] == pytest.approx(1.0, abs=0.06)
    assert group["constraints"][0]["nis_per_dof"] == pytest.approx(1.0, abs=0.06)


def test_an_ellipse_of_95_percent_holds_95_percent():
    random = np.random.default_rng(2)
    turn = np.array([[np.cos(0.5), -np.sin(0.5)], [np.sin(0.5), np.cos(0.5)]])
    points = random.standard_normal((20000, 2)) * [30.0, 10.0] @ turn.T
    stated = ellipse(points)
    angle = np.radians(stated["azimuth_deg"])
    along = np.array([np.sin(angle), np.cos(angle)])
    across = np.array([np.cos(angle), -np.sin(angle)])
    inside = (points @ along / stated["semi_major_95_m"]) ** 2 + (points @ across / stated["semi_minor_95_m"]) ** 2
    assert np.mean(inside < 1.0) == pytest.approx(0.95, abs=0.006)


def test_reliability_counts_named_effects_by_their_probability():
    random = np.random.default_rng(3)
    probability = random.uniform(0.5, 1.0, CASES)
    named = (np.arange(CASES) % 2).astype(float)
    right = (random.uniform(size=CASES) < probability).astype(float)
    data = dataset(leader_probability=("case", probability), leader_right=("case", right), named=("case", named))
    (group,) = statistics(data)["groups"]
    assert sum(row["count"] for row in group["reliability"]) == np.sum(named[: CASES - 5])
    for row in group["reliability"]:
        spread = 4.0 * np.sqrt(0.25 / row["count"])
        assert row["share_right"] == pytest.approx(row["mean_probability"], abs=spread)
