"""Something else: against the joint Gaussian of a Gauss–Markov process, and found again in one that was drawn."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import multivariate_normal

from edl_filter.diagnosis.bins import Bins
from edl_filter.diagnosis.comparison import averaged, triangle
from edl_filter.diagnosis.missing import FORCES, MOMENTS, Missing, allow, most_likely
from edl_filter.diagnosis.path import PER_BIN
from edl_filter.diagnosis.sparse import sparse
from edl_filter.diagnosis.timeline import Order
from edl_filter.diagnosis.whitening import Steps, whitener

DT = 0.125
FORCE_SIGMA, TURN_SIGMA = 5e-3, 2e-4


def flight(count):
    """Bins with force and turn, nothing unknown but the missing force and moment, and a pulse of dynamic pressure."""
    edges = 20.0 + DT * np.arange(count + 1)
    bins = Bins(edges, np.ones(count, bool), 1)
    rows = np.full((count, 6), -1)
    rows[:-1] = np.arange(6 * (count - 1)).reshape(-1, 6)
    rows[-1, :3] = 6 * (count - 1) + np.arange(3)  # from the last bin no step follows
    total = 6 * count - 3
    noise = np.repeat([FORCE_SIGMA**2, TURN_SIGMA**2], 3)
    row_noise = np.tile(np.diag(noise), (count, 1))[:total]
    steps = Steps(
        change=sparse(0, [(slice(0, 0), slice(0, 0), np.zeros((count, 0, 0)))]),
        noise=sparse(0, [(slice(0, 0), slice(0, 0), np.zeros((count, 0, 0)))]),
        rows=np.append(np.arange(count) * 6, total),
        design=np.zeros((total, 0)),
        row_noise=row_noise,
        start=np.zeros((0, 0)),
    )
    order = Order(rows, (), total, np.full(count, DT), np.repeat(edges[1:], 6)[:total], np.arange(total) % 6)
    at = np.linspace(0.0, 1.0, PER_BIN * count + 1)
    return steps, order, bins, SimpleNamespace(dynamic_pressure=8e3 * np.exp(-0.5 * ((at - 0.6) / 0.2) ** 2))


def likelihood(parts, column, missing):
    w = whitener(allow(*parts, missing))
    return w.log_likelihood(w(column[:, None], np.zeros((0, 1)))[:, 0])


def drawn(parts, rng, force=0.0, moment=0.0, memory=10.0, strength=1.0):
    """Differences under a Gauss–Markov force and moment that were drawn at the nodes, and the stated noise."""
    _, order, bins, _ = parts
    nodes = PER_BIN * len(bins.interval) + 1
    keep = np.exp(-DT / PER_BIN / memory)
    course = np.empty((nodes, 6))
    course[0] = rng.normal(size=6)
    for k in range(1, nodes):
        course[k] = keep * course[k - 1] + np.sqrt(1.0 - keep**2) * rng.normal(size=6)
    course *= np.repeat([force, moment], 3) * np.broadcast_to(np.reshape(strength, (-1, 1)), (nodes, 1))
    table = np.full((len(bins.interval), 6), np.nan)
    table[:, :3], table[:-1, 3:] = averaged(course[:, :3], bins), triangle(course[:, 3:], bins)
    table += np.repeat([FORCE_SIGMA, TURN_SIGMA], 3) * rng.normal(size=table.shape)
    out, used = np.zeros(order.count), order.bin_rows >= 0
    out[order.bin_rows[used]] = table[used]
    return out


def test_nothing_missing_leaves_the_problem_alone():
    parts = flight(20)
    assert allow(*parts, Missing(memory=3.0, with_pressure=True)) is parts[0]


@pytest.mark.parametrize("with_pressure", [False, True])
def test_it_is_a_gauss_markov_process(with_pressure):
    """The likelihood is the joint Gaussian's with covariance ``s_i s_j exp(-|t_i - t_j| / memory)`` plus noise."""
    count, missing = 25, Missing(0.02, 0.004, 0.7, with_pressure)
    parts = flight(count)
    _, order, bins, flow = parts
    column = drawn(parts, np.random.default_rng(3), 0.02, 0.004, 0.7)
    time = bins.edges[1:]
    kernel = np.exp(-np.abs(time[:, None] - time) / missing.memory)
    push = flow.dynamic_pressure / flow.dynamic_pressure.max() if with_pressure else np.ones(PER_BIN * count + 1)
    expected = 0.0
    for axis in range(6):
        rows = order.bin_rows[:, axis]
        rows = rows[rows >= 0]
        size = missing.force * averaged(push, bins) if axis < 3 else missing.moment * triangle(push, bins)
        n, sigma = len(rows), FORCE_SIGMA if axis < 3 else TURN_SIGMA
        covariance = size[:, None] * kernel[:n, :n] * size + sigma**2 * np.eye(n)
        constant = 0.5 * n * np.log(2.0 * np.pi)
        expected += multivariate_normal.logpdf(column[rows], cov=covariance) + constant
    assert likelihood(parts, column, missing) == pytest.approx(expected, rel=1e-9)


@given(st.floats(0.1, 100.0), st.floats(1e-4, 1.0))
def test_its_size_stays_what_it_was(memory, size):
    """One sigma at the beginning is one sigma ever after, whatever the memory and the steps."""
    parts = flight(4)
    steps = allow(*parts, Missing(size, size, memory))
    for k in range(len(steps.noise)):
        move, noise = np.eye(6) + steps.change[k], steps.noise[k]
        np.testing.assert_allclose(move @ np.eye(6) @ move.T + noise, np.eye(6), atol=1e-12)


def test_the_problem_that_was_given_is_left_as_it_was():
    parts = flight(10)
    allow(*parts, Missing(0.1, 0.1))
    assert not parts[0].design.any() and not parts[0].noise.values.any()


@pytest.mark.parametrize(("memory", "size"), [(0.5, 0.01), (10.0, 0.02), (10.0, 0.2)])
def test_a_missing_moment_is_found(memory, size):
    """A moment of Gauss–Markov course: far more likely with it than without, and its size comes out."""
    parts = flight(400)
    column = drawn(parts, np.random.default_rng(5), moment=size, memory=memory)
    tried = {}

    def value(missing):
        tried[missing] = likelihood(parts, column, missing)
        return tried[missing]

    found, at = most_likely(value)
    assert at == max(tried.values()) and at > tried[Missing()] + 100.0
    assert size / 3.0 < found.moment < size * 3.0
    assert found.force < FORCE_SIGMA  # no force of the noise's size
    assert found.memory == memory and not found.with_pressure


def test_between_the_grids_sizes_its_wandering_comes_out():
    """What a flight says well is how fast a moment wanders, size² over memory; another pair may have it as well."""
    parts = flight(400)
    column = drawn(parts, np.random.default_rng(5), moment=0.02, memory=0.5)
    found, _ = most_likely(lambda m: likelihood(parts, column, m))
    wanders = found.moment**2 / found.memory / (0.02**2 / 0.5)
    assert 0.1 < wanders < 10.0


def test_one_that_follows_the_dynamic_pressure_is_told_from_one_that_does_not():
    parts = flight(400)
    strength = parts[-1].dynamic_pressure / parts[-1].dynamic_pressure.max()
    column = drawn(parts, np.random.default_rng(6), 0.1, 0.01, 0.5, strength)
    found, at = most_likely(lambda m: likelihood(parts, column, m))
    assert found.with_pressure
    other = most_likely(lambda m: -np.inf if m.with_pressure else likelihood(parts, column, m))[1]
    assert at > other + 100.0


def test_noise_alone_asks_for_nothing_that_is_felt():
    parts = flight(200)
    gains = []
    for seed in range(10):
        column = drawn(parts, np.random.default_rng(seed))
        found, at = most_likely(lambda m, c=column: likelihood(parts, c, m))
        gains.append(at - likelihood(parts, column, Missing()))
        assert found.force < FORCE_SIGMA and found.moment * DT < 5.0 * TURN_SIGMA
    assert min(gains) >= 0.0 and max(gains) < 6.0


@given(st.sampled_from(MOMENTS[1:]), st.sampled_from(FORCES[1:]), st.sampled_from([0.5, 10.0]), st.booleans())
def test_the_search_ends_at_a_top_of_its_grid(moment, force, memory, with_pressure):
    """A smooth hill in the logarithms of the sizes, with its top on the grid."""

    def value(m):
        away = [np.log(max(a, 1e-6) / b) for a, b in ((m.moment, moment), (m.force, force))]
        return -np.square(away).sum() - (m.memory != memory) - (m.with_pressure != with_pressure)

    found, at = most_likely(value)
    assert found == Missing(force, moment, memory, with_pressure) and at == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("top", [0.03, 0.1 / 3.0])
def test_the_search_refines_by_a_factor_of_three(top):
    """Upwards from 0.01, downwards from 0.1."""
    found, _ = most_likely(lambda m: -(np.log(max(m.moment, 1e-6) / top) ** 2) - 1e6 * m.force)
    assert found.moment == pytest.approx(top) and found.force == 0.0
