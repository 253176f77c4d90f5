"""What is derived from the increments of a database: share, sigmas of the database, the largest of each coefficient."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from edl_filter.aero.discrepancy import DiscrepancyPrior
from edl_filter.aero.increments import SYMBOLS, DatabaseUpdate, RegimeUpdate

COEFFICIENTS = ("ca", "cn", "cm")


def regime_of(regime, increment, sigma, prior_sigma):
    """Arrays ``(3, K, A)``; Mach or Knudsen numbers 2, 3, …, angles 0, 0.1, … rad."""
    _, nodes, angles = increment.shape
    return RegimeUpdate(
        regime, 2.0 + np.arange(nodes), 0.1 * np.arange(angles), increment, sigma, prior_sigma,
        np.ones((nodes, angles), int),
    )  # fmt: skip


def random_regime(rng, regime):
    """Of random size; a third of all prior sigmas is zero, where the posterior is as certain."""
    shape = (3, *rng.integers(1, 5, 2))
    prior_sigma = rng.uniform(0.1, 2.0, shape) * (rng.random(shape) > 0.3)
    return regime_of(regime, rng.normal(size=shape) * (prior_sigma > 0.0), 0.5 * prior_sigma, prior_sigma)


def update_of(*regimes):
    size = sum(r.increment.size for r in regimes)
    return DatabaseUpdate("MER", DiscrepancyPrior(), regimes, np.eye(size))


def test_share_and_increments_of_certain_coefficients_are_zero():
    """CN and Cm are certain at zero angle; a table may be certain of one coefficient everywhere."""
    prior_sigma = np.array([[[0.2, 0.4]], [[0.0, 0.1]], [[0.0, 0.0]]])
    sigma = np.array([[[0.1, 0.4]], [[0.0, 0.06]], [[0.0, 0.0]]])
    increment = np.array([[[-0.1, 0.6]], [[0.0, 0.05]], [[0.0, 0.0]]])
    update = regime_of("mach", increment, sigma, prior_sigma)
    np.testing.assert_allclose(update.share, [[[0.75, 0.0]], [[0.0, 0.64]], [[0.0, 0.0]]], atol=1e-15)
    np.testing.assert_allclose(update.in_prior_sigmas, [[[-0.5, 1.5]], [[0.0, 0.5]], [[0.0, 0.0]]], atol=1e-15)


def test_a_value_beside_a_certain_prior_is_not_divided_by_zero():
    """Rounding may leave a posterior sigma or an increment where the prior has none: they are no sigmas."""
    tiny = np.full((3, 1, 1), 1e-12)
    update = regime_of("knudsen", tiny, tiny, np.zeros((3, 1, 1)))
    with np.errstate(all="raise"):
        assert not update.share.any() and not update.in_prior_sigmas.any()


@given(st.integers(0, 10_000))
def test_share_and_sigmas_are_those_of_each_cell(seed):
    update = random_regime(np.random.default_rng(seed), "mach")
    for place in np.ndindex(update.increment.shape):
        prior = update.prior_sigma[place]
        assert update.share[place] == pytest.approx(1.0 - update.sigma[place] ** 2 / prior**2 if prior else 0.0)
        assert update.in_prior_sigmas[place] == pytest.approx(update.increment[place] / prior if prior else 0.0)


@given(st.integers(0, 10_000), st.sampled_from([("mach",), ("knudsen",), ("mach", "knudsen")]))
def test_the_largest_increment_is_that_of_all_cells_of_all_regimes(seed, names):
    """Cell by cell; its sign, place and sigma are those of this cell."""
    rng = np.random.default_rng(seed)
    update = update_of(*(random_regime(rng, name) for name in names))
    actual = update.largest()
    assert tuple(i.coefficient for i in actual) == COEFFICIENTS == tuple(SYMBOLS)
    for c, largest in enumerate(actual):
        best = None
        for r in update.regimes:
            for k, a in np.ndindex(r.bins.shape):
                prior = r.prior_sigma[c, k, a]
                sigmas = r.increment[c, k, a] / prior if prior else 0.0
                if best is None or abs(sigmas) > abs(best[0]):
                    best = (sigmas, r.increment[c, k, a], r.sigma[c, k, a], r.regime, r.nodes[k], r.alpha[a])
        if best[0] == 0.0:  # certain everywhere
            assert largest.sigmas == largest.increment == 0.0
        else:
            assert (largest.sigmas, largest.increment, largest.sigma) == pytest.approx(best[:3])
            assert (largest.regime, largest.node, largest.alpha) == best[3:]


def test_the_largest_increment_is_in_sigmas_and_not_in_units_of_the_coefficient():
    """Of CA a small increment where the prior is narrow; of CN a negative one; of Cm one of the rarefied regime."""
    continuum = regime_of(
        "mach",
        np.array([[[0.30, 0.02]], [[-0.5, 0.4]], [[0.1, 0.0]]]),
        np.full((3, 1, 2), 0.01),
        np.array([[[1.00, 0.01]], [[0.1, 0.1]], [[0.1, 0.1]]]),
    )
    rarefied = regime_of("knudsen", np.full((3, 2, 1), 0.2), np.full((3, 2, 1), 0.05), np.full((3, 2, 1), 0.1))
    ca, cn, cm = update_of(continuum, rarefied).largest()
    assert (ca.sigmas, ca.increment, ca.regime, ca.node, ca.alpha) == pytest.approx((2.0, 0.02, "mach", 2.0, 0.1))
    assert (cn.sigmas, cn.increment, cn.regime, cn.alpha) == pytest.approx((-5.0, -0.5, "mach", 0.0))
    assert (cm.sigmas, cm.increment, cm.sigma, cm.regime) == pytest.approx((2.0, 0.2, 0.05, "knudsen"))


def test_cells_are_pairs_of_a_node_and_an_angle():
    shapes = [(3, 4, 5), (3, 2, 7)]
    update = update_of(*(regime_of(n, *(np.ones(s),) * 3) for n, s in zip(("mach", "knudsen"), shapes, strict=True)))
    assert update.cells == 4 * 5 + 2 * 7
    assert len(update.covariance) == 3 * update.cells
