"""Quiet records: the cubic comes back, and no sample keeps the noise of its own bin."""

from types import SimpleNamespace

import numpy as np
import pytest

from edl_filter.diagnosis import case as case_module
from edl_filter.diagnosis.case import HOLDS, followed, linearise, quiet
from edl_filter.telemetry.record import ImuRecord, SensorErrors


def record(values, interval=0.05, unit=None):
    count = len(values)
    zero, no = np.zeros(count), np.zeros(count, bool)
    return ImuRecord(
        "primary", interval * np.arange(1, count + 1), np.full(count, interval), values, values, np.zeros((count, 3)),
        zero, zero, zero, no, no, np.zeros(count, np.int64) if unit is None else unit, ("a", "b"),
        np.zeros(count, np.int64), ("made",), (SensorErrors(), SensorErrors()),
    )  # fmt: skip


@pytest.mark.parametrize(("interval", "length"), [(0.125, 0.125), (0.05, 0.1), (0.005, 0.1)])
def test_a_cubic_stays_what_it_is(interval, length):
    t = interval * np.arange(400)
    cubic = np.column_stack((t**3 - t, 2.0 * t**2, 5.0 + t))
    found = quiet(record(cubic, interval), length, 1e3).specific_force
    np.testing.assert_allclose(found, cubic, atol=1e-9 * np.abs(cubic).max())


@pytest.mark.parametrize("per_bin", [1, 2, 20])
def test_no_sample_keeps_the_noise_of_its_own_bin(per_bin):
    for k in range(100, 100 + per_bin):
        spike = np.zeros((400, 3))
        spike[k] = 1.0
        found = quiet(record(spike, 0.1 / per_bin), 0.1, 1e3).specific_force[:, 0]
        own = slice(k - k % per_bin, k - k % per_bin + per_bin)
        assert not found[own].any() and np.count_nonzero(found) == 4 and found.sum() == pytest.approx(1.0)


def test_where_samples_or_units_change_they_stay_as_they_were():
    noise = np.random.default_rng(0).normal(size=(60, 3))
    unit = np.repeat([0, 1], 30)
    found = quiet(record(noise, unit=unit), 0.1, 1e3).specific_force
    same = np.all(found == noise, axis=1)
    assert same[26:35].all() and same[:4].all() and same[-4:].all()
    assert not same[4:26].any() and not same[35:56].any()
    short = record(noise[:6])
    assert quiet(short, 0.1, 1e3) is short


def test_after_the_end_they_stay_as_they_were():
    noise = np.random.default_rng(0).normal(size=(60, 3))
    same = np.all(quiet(record(noise), 0.1, 2.0).specific_force == noise, axis=1)
    assert same[36:].all() and not same[4:36].any()  # 36 and its neighbours four further on end by 2 s: no longer


@pytest.mark.parametrize(("share", "until", "calls"), [(0.0, 0.02, 3), (0.5, 0.02, 1), (0.5, 1.0, 3)])
def test_further_rounds_are_for_models_that_hold(monkeypatch, share, until, calls):
    """The point moves round by round, but not where the model fails by more than `until`; noise begins at the last."""
    made, begun = [], []

    def about(case, point, begin=None):
        made.append(point)
        begun.append(begin)
        soft = SimpleNamespace(start_covariance=lambda size: np.eye(2), log_likelihood=lambda _: float(len(made)))
        unknowns, ground = SimpleNamespace(layout=SimpleNamespace(size=2)), SimpleNamespace(point=point)
        white = SimpleNamespace(
            share=share, holds=share <= HOLDS, soft=soft, white=lambda _: np.zeros(3), start=np.zeros(2)
        )
        white.unknowns, white.sigma, white.ground, white.log_likelihood = unknowns, {}, ground, float(len(made))
        white.failures = f"noise {len(made)}" if share > HOLDS else None
        return white

    def told(linear, point, *_):
        far = SimpleNamespace(minus=lambda _: np.ones(2))
        return SimpleNamespace(start=far, deviation=None)

    monkeypatch.setattr(case_module, "about", about)
    monkeypatch.setattr(case_module, "told", told)
    monkeypatch.setattr(case_module, "first_point", lambda _: SimpleNamespace(start=None, deviation=None))
    linearise(SimpleNamespace(reconstruction=None), rounds=3, until=until)
    assert len(made) == calls
    assert begun == ([None, "noise 1", "noise 2"] if share > HOLDS else [None] * 3)[:calls]


@pytest.mark.parametrize(
    ("shares", "exact", "found"),
    [
        ([0.1, 0.05, 0.01, 0.0], True, 2),  # where it holds first
        ([0.1, 0.05, 0.045, 0.0], True, None),  # hardly any better: no hope
        ([0.1, 0.07, 0.05, 0.03, 0.0], True, None),  # not soon enough
        ([0.1, 0.05, 0.01], False, None),  # a database with errors of its own would drag it along
        ([0.02, 0.0], True, None),  # it holds as it is
    ],
)
def test_a_failing_model_is_followed_to_where_it_holds(monkeypatch, shares, exact, found):
    rounds = [SimpleNamespace(share=s, holds=s <= HOLDS) for s in shares]
    monkeypatch.setattr(case_module, "_rounds", lambda case, count, until, first: iter(rounds[:count]))
    there = followed(SimpleNamespace(exact=exact), rounds[0])
    assert there is (None if found is None else rounds[found])
