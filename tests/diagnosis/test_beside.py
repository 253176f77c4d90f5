"""The model's own effects as unknowns: a further effect gains what it gains in one regression with them."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from edl_filter.diagnosis import beside
from edl_filter.diagnosis.regression import regress
from edl_filter.effects.catalogue import effect_named
from edl_filter.effects.effect import Active


def identity(columns, start):
    """A whitener of rows that are white as they are."""
    return columns


def with_own(monkeypatch, own, sigma, fixed=False):
    """A model of one effect whose signatures are `own`."""
    active = Active(effect_named("gyro_bias"), {}, fixed=fixed)
    found = SimpleNamespace(rows=own, start=np.zeros((2, own.shape[1])), sigma=sigma)
    monkeypatch.setattr(beside, "signature", lambda ground, a, names: found)
    return beside.beside_own(SimpleNamespace(ground=SimpleNamespace(effects=(active,))), identity)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10_000), st.floats(-3.0, 3.0), st.floats(0.0, 1.0))
def test_gain_and_size_are_those_of_one_regression_with_them(seed, magnitude, alike):
    """However loud the own signatures are, and however like the one that is tried."""
    rng = np.random.default_rng(seed)
    own, noise = rng.normal(size=(200, 3)) * 10.0**magnitude, rng.normal(size=200)
    tried = alike * own[:, :2] / 10.0**magnitude + (1.0 - alike) * rng.normal(size=(200, 2))
    y = own @ rng.normal(size=3) + tried @ rng.normal(size=2) + noise
    sigma, other = np.array([0.5, 1.0, 2.0]), np.array([1.5, 0.7])
    with pytest.MonkeyPatch.context() as patch:
        white = with_own(patch, own, sigma)
    start = np.zeros((2, 1))
    found = regress(white(y[:, None], start)[:, 0], white(tried, start), other)
    both = regress(y, np.concatenate((own, tried), axis=1), np.concatenate((sigma, other)))
    alone = regress(y, own, sigma)
    scale = 1.0 + abs(both.gain)
    assert found.gain == pytest.approx(both.gain - alone.gain, abs=1e-7 * scale)
    np.testing.assert_allclose(found.size, both.size[3:], rtol=1e-5, atol=1e-7)
    np.testing.assert_allclose(found.covariance, both.covariance[3:, 3:], rtol=1e-5)


def test_what_an_own_effect_could_have_explained_is_nobody_elses(monkeypatch):
    """An own effect that has moved from its best values leaves a mark; an effect that looks like it does not gain."""
    rng = np.random.default_rng(1)
    own = rng.normal(size=(400, 1))
    y = 0.3 * own[:, 0] + rng.normal(size=400)
    like = own + 0.1 * rng.normal(size=(400, 1))
    held = regress(y, like, np.array([1.0]))
    white = with_own(monkeypatch, own, np.array([1.0]))
    freed = regress(white(y[:, None], np.zeros((2, 1)))[:, 0], white(like, np.zeros((2, 1))), np.array([1.0]))
    assert held.gain > 10.0 and freed.gain < 0.0


@pytest.mark.parametrize("fixed", [True, False])
def test_without_effects_that_are_free_it_is_the_whitener_itself(monkeypatch, fixed):
    if fixed:
        assert with_own(monkeypatch, np.ones((5, 3)), np.ones(3), fixed=True) is identity
    else:
        assert beside.beside_own(SimpleNamespace(ground=SimpleNamespace(effects=())), identity) is identity
