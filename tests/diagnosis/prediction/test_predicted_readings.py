"""Quadrature over the bins: exact for polynomials, oscillations in closed form, a body without torque."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.polynomial import Polynomial

from edl_filter.diagnosis.prediction.dead_reckoning import NODES_PER_BIN
from edl_filter.diagnosis.prediction.predicted_readings import (
    FINE_NODES_PER_BIN,
    bin_average,
    fine_rule_sigma,
    rate_step_from_moment,
    triangular_integral,
)
from edl_filter.diagnosis.prediction.time_bins import TimeBins
from edl_filter.effects.forward_model import ForwardModel
from edl_filter.effects.types import Body


def bins_of(edges):
    edges = np.asarray(edges, float)
    return TimeBins(edges, np.ones(len(edges) - 1, bool))


def nodes(bins, per_bin=NODES_PER_BIN):
    inner = bins.edges[:-1, None] + bins.interval[:, None] * np.arange(per_bin) / per_bin
    return np.append(inner.ravel(), bins.edges[-1])


def model_of(inertia, mass=2.0):
    return ForwardModel(None, None, None, None, None, Body(mass, np.asarray(inertia, float)), 1.0, 0.0)


UNEVEN = bins_of([0.0, 0.1, 0.25, 0.3, 0.6, 0.7])
EVEN = bins_of(np.arange(41) / 8.0)


def exact_mean(p, bins):
    """Exact means of a polynomial over the bins."""
    return np.diff(p.integ()(bins.edges)) / bins.interval


def exact_triangular_integral(p, bins):
    """Exact integrals with the triangular weight over two adjoining bins."""
    integrals = []
    for a, b, c in zip(bins.edges, bins.edges[1:], bins.edges[2:], strict=False):
        rising = (p * Polynomial([-a, 1.0]) / (b - a)).integ()
        falling = (p * Polynomial([c, -1.0]) / (c - b)).integ()
        integrals.append(rising(b) - rising(a) + falling(c) - falling(b))
    return np.array(integrals)


@given(st.lists(st.floats(-5.0, 5.0), min_size=4, max_size=4))
def test_means_of_cubics_are_exact(c):
    p = Polynomial(c)
    np.testing.assert_allclose(bin_average(p(nodes(UNEVEN)), UNEVEN), exact_mean(p, UNEVEN), atol=1e-12)


@given(st.lists(st.floats(-5.0, 5.0), min_size=3, max_size=3))
def test_triangular_integrals_of_quadratics_are_exact(c):
    p = Polynomial(c)
    np.testing.assert_allclose(
        triangular_integral(p(nodes(UNEVEN)), UNEVEN), exact_triangular_integral(p, UNEVEN), atol=1e-12
    )


def test_error_of_simpsons_rule_for_a_quartic():
    """The mean of t⁴ is wrong by h⁴ f''''/180 at the node distance h."""
    p = Polynomial([0.0, 0.0, 0.0, 0.0, 1.0])
    error = bin_average(p(nodes(UNEVEN)), UNEVEN) - exact_mean(p, UNEVEN)
    np.testing.assert_allclose(error, 24.0 / 180.0 * (UNEVEN.interval / NODES_PER_BIN) ** 4, rtol=1e-6)


def test_vectors_are_integrated_axis_by_axis():
    t = nodes(EVEN)
    values = np.stack((np.sin(t), t**2, np.exp(-t)), axis=1)
    for rule in (bin_average, triangular_integral):
        for axis in range(3):
            np.testing.assert_array_equal(rule(values, EVEN)[:, axis], rule(values[:, axis], EVEN))


@given(st.lists(st.floats(-5.0, 5.0), min_size=4, max_size=4))
def test_the_step_of_a_mean_rate_is_the_triangular_integral_of_its_derivative(c):
    rate = Polynomial(c)
    steps = triangular_integral(rate.deriv()(nodes(UNEVEN)), UNEVEN)
    np.testing.assert_allclose(steps, np.diff(exact_mean(rate, UNEVEN)), atol=1e-12)


@given(st.floats(0.1, 1.0), st.floats(0.0, 2.0 * np.pi))
def test_the_step_of_an_oscillating_mean_rate(frequency, phase):
    """Simpson's rule errs by (h w)⁴/180 of the step's amplitude w dt, three times that with the triangular weight."""
    w = 2.0 * np.pi * frequency
    means = -np.diff(np.cos(w * EVEN.edges + phase)) / (w * EVEN.interval)
    steps = triangular_integral(w * np.cos(w * nodes(EVEN) + phase), EVEN)
    step = w * EVEN.interval[0]
    np.testing.assert_allclose(steps, np.diff(means), atol=(step / NODES_PER_BIN) ** 4 / 60.0 * step + 1e-13)


def test_a_symmetric_body_without_torque():
    """The lateral rate rotates at (Ix - It)/It wx in the body."""
    axial, transverse, roll, lateral = 300.0, 220.0, 3.0, 0.2
    w = (axial - transverse) / transverse * roll
    t, edges = nodes(EVEN), EVEN.edges
    rate = np.stack((np.full_like(t, roll), lateral * np.cos(w * t), lateral * np.sin(w * t)), axis=1)
    integral = np.stack((roll * edges, lateral * np.sin(w * edges) / w, -lateral * np.cos(w * edges) / w), axis=1)
    means = np.diff(integral, axis=0) / EVEN.interval[:, None]
    model = model_of(np.diag([axial, transverse, transverse]))
    steps = rate_step_from_moment(model, EVEN, SimpleNamespace(time=t, rate=rate), np.zeros_like(rate))
    np.testing.assert_allclose(steps, np.diff(means, axis=0), atol=1e-6 * lateral * w / 8.0)
    assert np.abs(steps[:, 1:]).max() > 0.5 * lateral * w / 8.0  # the comparison is not of zeros


@given(st.integers(0, 1000))
def test_eulers_equations_hold(seed):
    """``I α + w × I w = M`` for any inertia."""
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(3, 3))
    inertia = root @ root.T + np.eye(3)
    rate, moment = rng.normal(size=(2, 5, 3))
    acceleration = model_of(inertia).angular_acceleration(np.arange(5.0), rate, moment)
    for a, w, m in zip(acceleration, rate, moment, strict=True):
        np.testing.assert_allclose(inertia @ a + np.cross(w, inertia @ w), m, atol=1e-9)


def averages(load, bins):
    """Means of a load over the bins by both rules, and the sigma that the fine rule is stated to have."""
    by_nodes, fine = (bin_average(load(nodes(bins, count)), bins) for count in (NODES_PER_BIN, FINE_NODES_PER_BIN))
    return by_nodes, fine, fine_rule_sigma((fine - by_nodes)[:, None])[:, 0]


def test_smooth_loads_have_no_quadrature_error():
    _, _, sigma = averages(lambda t: 1.0 + t - 0.3 * t**2, EVEN)
    assert 0.0 <= sigma.max() < 1e-12
    _, _, sigma = averages(lambda t: np.sin(2.0 * np.pi * 0.7 * t), EVEN)
    assert sigma.max() < 2e-5


@pytest.mark.parametrize("rule", ["mean", "rate step"])
def test_the_sigma_at_a_change_of_slope_is_the_rms_of_the_error(rule):
    """RMS over all places of the change: true h / √1080 for a mean, with the distance h of the rule's nodes.

    Simpson's integral of ``|t - kink|`` errs by h² (2u/3 - u²), where the kink is u h < h from the end of a panel.
    """
    edges = EVEN.edges
    step = EVEN.interval[0]
    errors, sigmas = [], []
    for kink in 2.0 + (np.arange(400) + 0.5) / 400.0 * step:

        def load(t, kink=kink):
            return np.abs(t - kink)

        if rule == "mean":
            by_nodes, fine, sigma = averages(load, EVEN)
            exact = np.diff(0.5 * (edges - kink) * np.abs(edges - kink)) / step
        else:
            by_nodes, fine = (
                triangular_integral(load(nodes(EVEN, count)), EVEN) for count in (NODES_PER_BIN, FINE_NODES_PER_BIN)
            )
            sigma = fine_rule_sigma((fine - by_nodes)[:, None])[:, 0]
            exact = np.diff(np.diff(np.abs(edges - kink) ** 3 / 6.0) / step)
        inside = int(np.searchsorted(edges, kink)) - 1
        near = [inside] if rule == "mean" else [inside - 1, inside]
        assert np.abs(np.delete(fine - exact, near)).max() < 1e-12 and np.delete(sigma, near).max() < 1e-12
        errors.append(np.stack(((by_nodes - exact)[near], (fine - exact)[near]), axis=1))
        sigmas.append(sigma[near])
    by_nodes, fine = np.sqrt(np.mean(np.square(errors), axis=(0, 1)))
    if rule == "mean":
        assert by_nodes == pytest.approx(step / NODES_PER_BIN / np.sqrt(1080.0), rel=2e-3)
    assert by_nodes / fine == pytest.approx((FINE_NODES_PER_BIN / NODES_PER_BIN) ** 2, rel=0.05)
    assert np.sqrt(np.mean(np.square(sigmas))) == pytest.approx(fine, rel=0.1)


def test_the_error_where_a_vehicle_passes_several_nodes_of_a_table_in_a_bin_is_covered():
    """It oscillates by 9 deg at 1.3 Hz, the table has nodes at each degree, and its slope changes from node to node."""
    bins = bins_of(np.arange(601) / 10.0)
    degrees, rng = np.arange(12.0), np.random.default_rng(7)
    coefficient = np.concatenate(([0.0], np.cumsum(1.0 + 0.1 * rng.normal(size=len(degrees) - 1))))

    def load(time):
        angle = 9.0 * np.sin(2.0 * np.pi * 1.3 * time) * (1.0 + 0.01 * time / 60.0)
        return np.sign(angle) * np.interp(np.abs(angle), degrees, coefficient)

    inside = bins.edges[:-1, None] + bins.interval[:, None] * (np.arange(2000) + 0.5) / 2000.0
    exact = np.mean(load(inside), axis=1)
    by_nodes, fine, sigma = averages(load, bins)
    errors = (fine - exact) / sigma
    assert 0.5 < np.sqrt(np.mean(errors**2)) < 1.3
    assert np.abs(errors).max() < 5.0
    assert np.std(fine - exact) < 0.15 * np.std(by_nodes - exact)
