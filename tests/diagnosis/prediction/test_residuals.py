"""Quadrature over bins: polynomials exactly, oscillations in closed form, a body without torque."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.polynomial import Polynomial

from edl_filter.diagnosis.bins import Bins
from edl_filter.diagnosis.comparison import angular_acceleration, averaged, rounding, stepped, triangle
from edl_filter.diagnosis.path import PER_BIN


def bins_of(edges):
    edges = np.asarray(edges, float)
    return Bins(edges, np.ones(len(edges) - 1, bool), 1)


def nodes(bins):
    inner = bins.edges[:-1, None] + bins.interval[:, None] * np.arange(PER_BIN) / PER_BIN
    return np.append(inner.ravel(), bins.edges[-1])


def body(inertia, mass=2.0):
    return SimpleNamespace(rigid_body=SimpleNamespace(mass=mass, inertia=np.asarray(inertia, float)))


UNEVEN = bins_of([0.0, 0.1, 0.25, 0.3, 0.6, 0.7])
EVEN = bins_of(np.arange(41) / 8.0)


def mean(p, bins):
    return np.diff(p.integ()(bins.edges)) / bins.interval


def weighted(p, bins):
    """Exact integral with the triangular weight, from edge to edge to edge."""
    out = []
    for a, b, c in zip(bins.edges, bins.edges[1:], bins.edges[2:], strict=False):
        up = (p * Polynomial([-a, 1.0]) / (b - a)).integ()
        down = (p * Polynomial([c, -1.0]) / (c - b)).integ()
        out.append(up(b) - up(a) + down(c) - down(b))
    return np.array(out)


@given(st.lists(st.floats(-5.0, 5.0), min_size=4, max_size=4))
def test_means_of_cubics_are_exact(c):
    p = Polynomial(c)
    np.testing.assert_allclose(averaged(p(nodes(UNEVEN)), UNEVEN), mean(p, UNEVEN), atol=1e-12)


@given(st.lists(st.floats(-5.0, 5.0), min_size=3, max_size=3))
def test_triangular_integrals_of_quadratics_are_exact(c):
    p = Polynomial(c)
    np.testing.assert_allclose(triangle(p(nodes(UNEVEN)), UNEVEN), weighted(p, UNEVEN), atol=1e-12)


def test_of_a_quartic_simpsons_error_is_left():
    """The mean of t⁴ is wrong by h⁴ f''''/180 at the node distance h."""
    p = Polynomial([0.0, 0.0, 0.0, 0.0, 1.0])
    error = averaged(p(nodes(UNEVEN)), UNEVEN) - mean(p, UNEVEN)
    np.testing.assert_allclose(error, 24.0 / 180.0 * (UNEVEN.interval / PER_BIN) ** 4, rtol=1e-6)


def test_vectors_are_taken_axis_by_axis():
    t = nodes(EVEN)
    table = np.stack((np.sin(t), t**2, np.exp(-t)), axis=1)
    for rule in (averaged, triangle):
        for axis in range(3):
            np.testing.assert_array_equal(rule(table, EVEN)[:, axis], rule(table[:, axis], EVEN))


@given(st.lists(st.floats(-5.0, 5.0), min_size=4, max_size=4))
def test_the_step_of_a_mean_rate_is_the_triangular_integral_of_its_derivative(c):
    rate = Polynomial(c)
    found = triangle(rate.deriv()(nodes(UNEVEN)), UNEVEN)
    np.testing.assert_allclose(found, np.diff(mean(rate, UNEVEN)), atol=1e-12)


@given(st.floats(0.1, 1.0), st.floats(0.0, 2.0 * np.pi))
def test_the_step_of_an_oscillating_mean_rate(frequency, phase):
    """Simpson's rule is wrong by (h w)⁴/180 of the step's amplitude w dt, three times that with the triangle's bend."""
    w = 2.0 * np.pi * frequency
    means = -np.diff(np.cos(w * EVEN.edges + phase)) / (w * EVEN.interval)
    found = triangle(w * np.cos(w * nodes(EVEN) + phase), EVEN)
    step = w * EVEN.interval[0]
    np.testing.assert_allclose(found, np.diff(means), atol=(step / PER_BIN) ** 4 / 60.0 * step + 1e-13)


def test_a_symmetric_body_without_torque():
    """The lateral rate turns at (Ix - It)/It wx in the body."""
    along, across, roll, wide = 300.0, 220.0, 3.0, 0.2
    turn = (along - across) / across * roll
    t, edges = nodes(EVEN), EVEN.edges
    rate = np.stack((np.full_like(t, roll), wide * np.cos(turn * t), wide * np.sin(turn * t)), axis=1)
    means = np.stack((roll * edges, wide * np.sin(turn * edges) / turn, -wide * np.cos(turn * edges) / turn), axis=1)
    means = np.diff(means, axis=0) / EVEN.interval[:, None]
    world = body(np.diag([along, across, across]))
    found = stepped(world, EVEN, SimpleNamespace(rate=rate), np.zeros_like(rate))
    np.testing.assert_allclose(found, np.diff(means, axis=0), atol=1e-6 * wide * turn / 8.0)
    assert np.abs(found[:, 1:]).max() > 0.5 * wide * turn / 8.0  # it is not zero that is compared


@given(st.integers(0, 1000))
def test_eulers_equations_hold(seed):
    """``I α + w × I w = M`` for any inertia."""
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(3, 3))
    inertia = root @ root.T + np.eye(3)
    rate, moment = rng.normal(size=(2, 5, 3))
    found = angular_acceleration(body(inertia), SimpleNamespace(rate=rate), moment)
    for a, w, m in zip(found, rate, moment, strict=True):
        np.testing.assert_allclose(inertia @ a + np.cross(w, inertia @ w), m, atol=1e-9)


def wrong_by(values):
    """What `rounding` says of a force and of a moment with the same course, mass and inertia one."""
    three = np.repeat(values[:, None], 3, axis=1)
    flow = SimpleNamespace(rate=np.zeros_like(three))
    force, turn = rounding(body(np.eye(3), 1.0), EVEN, flow, three, three)
    assert np.all(force >= 0.0) and np.all(turn >= 0.0)
    return force[:, 0], turn[:, 0]


def test_smooth_loads_have_no_rounding():
    t = nodes(EVEN)
    force, turn = wrong_by(1.0 + t - 0.3 * t**2)
    assert force.max() < 1e-12 and turn.max() < 1e-12
    force, turn = wrong_by(np.sin(2.0 * np.pi * 0.7 * t))
    assert force.max() < 3e-4 and turn.max() < 3e-4 / 8.0


def test_the_rounding_at_a_kink_is_of_the_size_of_the_error():
    t, edges = nodes(EVEN), EVEN.edges
    said, true = [], []
    for kink in 2.0 + np.linspace(0.0, 0.125, 101)[1:-1]:
        integral = 0.5 * (edges - kink) * np.abs(edges - kink)
        force, _ = wrong_by(np.abs(t - kink))
        error = averaged(np.abs(t - kink), EVEN) - np.diff(integral) / EVEN.interval
        inside = int(np.searchsorted(edges, kink)) - 1
        assert np.delete(force, inside).max() < 1e-12 and np.abs(np.delete(error, inside)).max() < 1e-12
        said.append(force[inside])
        true.append(error[inside])
    assert np.sqrt(np.mean(np.square(said))) == pytest.approx(np.sqrt(np.mean(np.square(true))), rel=0.5)
