"""Euler's equations: moments, their parts and bands, and tensors that no body has."""

import numpy as np
import pytest

from edl_filter.errors import InputError
from edl_filter.postflight.moments import check_inertia, euler
from edl_filter.postflight.rates import batch_smoother

INERTIA = np.array([[400.0, -3.0, 2.0], [-3.0, 303.0, 1.5], [2.0, 1.5, 299.0]])


def test_a_free_symmetric_top_feels_no_moment():
    inertia, n, p = np.diag([400.0, 300.0, 300.0]), 0.02, 0.21
    wobble = (400 - 300) / 300 * p
    t = np.arange(0, 300, 0.125)
    rate = np.stack((np.full_like(t, p), n * np.cos(wobble * t), n * np.sin(wobble * t)), axis=1)
    turn = wobble * np.stack((0 * t, -n * np.sin(wobble * t), n * np.cos(wobble * t)), axis=1)
    np.testing.assert_allclose(euler(rate, turn, inertia).moment, 0.0, atol=1e-12)
    filters = batch_smoother(t)
    moments = euler(filters.smooth(rate), filters.differentiate(rate), inertia)
    assert np.abs(moments.moment[10:-10]).max() < 1e-4 * 300 * n * wobble + 1e-6


def test_the_slow_twin_and_the_parts_of_the_rolling_moment():
    rng = np.random.default_rng(1)
    rate, turn = rng.normal(size=(2, 20, 3))
    moments = euler(rate, turn, INERTIA)
    for k in range(20):
        want = INERTIA @ turn[k] + np.cross(rate[k], INERTIA @ rate[k])
        np.testing.assert_allclose(moments.moment[k], want)
    np.testing.assert_allclose(sum(moments.rolling.values()), moments.moment[:, 0], rtol=1e-10)
    coupling = sum(v for term, v in moments.rolling.items() if term != "spin")
    np.testing.assert_allclose(coupling, moments.moment[:, 0] - 400 * turn[:, 0])


def test_bands_of_moments():
    rng = np.random.default_rng(2)
    rate, turn = rng.normal(size=(2, 1, 3))
    moments = euler(rate, turn, INERTIA, 0.01, 0.003, 0.05)
    many = euler(rate + 0.01 * rng.normal(size=(20000, 3)), turn + 0.003 * rng.normal(size=(20000, 3)), INERTIA)
    np.testing.assert_allclose(many.moment.std(axis=0), moments.sigma[0], rtol=0.03)
    np.testing.assert_allclose(moments.systematic, 0.05 * np.abs(moments.moment))


def test_sigmas_of_the_products_are_a_band_of_all_moments():
    """Against tensors that are drawn."""
    rng = np.random.default_rng(2)
    rate, turn = rng.normal(size=(2, 4, 3))
    sigma = (2.0, 0.0, 5.0)
    many = []
    for xy, xz, yz in sigma * rng.normal(size=(4000, 3)):
        many.append(euler(rate, turn, INERTIA - np.array([[0, xy, xz], [xy, 0, yz], [xz, yz, 0]])).moment)
    band = euler(rate, turn, INERTIA, product_sigma=sigma).systematic
    np.testing.assert_allclose(np.std(many, axis=0), band, rtol=0.05)
    both = euler(rate, turn, INERTIA, inertia_relative=0.05, product_sigma=sigma).systematic
    np.testing.assert_allclose(both, np.hypot(band, 0.05 * np.abs(euler(rate, turn, INERTIA).moment)))


@pytest.mark.parametrize(
    ("inertia", "says"),
    [
        (np.diag([400.0, 300.0, -1.0]), "not positive definite"),
        (np.diag([400.0, 100.0, 100.0]), "exceeds the sum"),
        (np.array([[1.0, 1, 0], [0, 1, 0], [0, 0, 1]]), "symmetric"),
    ],
)
def test_no_such_body(inertia, says):
    with pytest.raises(InputError, match=says):
        check_inertia(inertia)
