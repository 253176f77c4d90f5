"""Acceleration of an IMU's place against the centre of mass, against closed forms of known rotations."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from edl_filter.imu_model.lever_arm import (
    edge_values,
    edge_weights,
    lever_arm_acceleration,
    lever_arm_acceleration_at,
    lever_arm_acceleration_of_products,
)


def edge_value(interval, mean, parted, edge):
    """The value at an inner edge, from the polynomial that has the means of the samples around it.

    The degree is the largest, up to the seventh, whose samples are inside, even and of one instrument; else the two
    samples at the edge are weighted by the other one's length.
    """
    for pairs in (4, 3, 2):
        window = slice(edge - pairs, edge + pairs)
        if window.start < 0 or window.stop > len(mean):
            continue
        if np.ptp(interval[window]) > 0.0 or np.any(parted[window.start : window.stop - 1]):
            continue
        begin, powers = np.arange(-pairs, pairs)[:, None], np.arange(2 * pairs)
        means = ((begin + 1.0) ** (powers + 1) - (1.0 * begin) ** (powers + 1)) / (powers + 1)  # of t**power
        return np.linalg.solve(means, mean[window])[0]
    before, after = interval[edge - 1], interval[edge]
    return (mean[edge - 1] * after + mean[edge] * before) / (before + after)


@given(st.integers(0, 2**32 - 1), st.integers(1, 24), st.floats(0.0, 0.4))
def test_acceleration_of_random_samples_equals_its_slow_twin(seed, count, change):
    """Uneven samples and changes of instrument at random places."""
    rng = np.random.default_rng(seed)
    interval = np.array([0.125, 0.25])[np.cumsum(rng.random(count) < change) % 2]
    unit = np.cumsum(rng.random(count) < 0.5 * change)
    position = rng.standard_normal((unit[-1] + 1, 3))[unit]
    rate = rng.standard_normal((count, 3))
    parted = np.diff(unit) != 0
    acceleration = lever_arm_acceleration(interval, rate, position, unit)
    edges = [rate[0], *(edge_value(interval, rate, parted, e) for e in range(1, count)), rate[-1]]
    np.testing.assert_allclose(edge_values(interval, rate, parted), edges, rtol=0, atol=1e-12)
    for i, (w, r) in enumerate(zip(rate, position, strict=True)):
        start = w if i > 0 and parted[i - 1] else edges[i]
        end = w if i < count - 1 and parted[i] else edges[i + 1]
        swing = np.cross(end - start, r)
        expected = swing / interval[i] + np.cross(w, np.cross(w, r)) + np.cross(end - start, swing) / 12.0
        np.testing.assert_allclose(acceleration[i], expected, rtol=0, atol=1e-11)


def test_a_steady_rotation_pulls_towards_its_axis():
    rate, position = np.array([[0.0, 0.0, 2.0]]), np.array([3.0, 0.0, 5.0])
    acceleration = lever_arm_acceleration_at(np.zeros((1, 3)), rate, position)
    np.testing.assert_allclose(acceleration, [[-12.0, 0.0, 0.0]], atol=1e-15)


@given(st.integers(0, 2**32 - 1))
def test_products_of_steady_rates_give_the_acceleration_at_instants(seed):
    rng = np.random.default_rng(seed)
    turning, rate, position = rng.standard_normal((6, 3)), rng.standard_normal((6, 3)), rng.standard_normal(3)
    x, y, z = rate.T
    products = np.column_stack((x * x, y * y, z * z, x * y, x * z, y * z))
    acceleration = lever_arm_acceleration_of_products(turning, products, position)
    np.testing.assert_allclose(acceleration, lever_arm_acceleration_at(turning, rate, position), atol=1e-13)


@given(st.integers(0, 2**32 - 1))
def test_means_of_a_constant_rate_give_the_acceleration_at_instants(seed):
    rng = np.random.default_rng(seed)
    rate, position = np.tile(rng.standard_normal(3), (12, 1)), np.tile(rng.standard_normal(3), (12, 1))
    acceleration = lever_arm_acceleration(np.full(12, 0.1), rate, position, np.zeros(12, int))
    expected = lever_arm_acceleration_at(np.zeros((12, 3)), rate, position)
    np.testing.assert_allclose(acceleration, expected, atol=1e-13)


@pytest.mark.parametrize("pairs", [1, 2, 3, 4])
def test_edge_weights_reproduce_a_constant(pairs):
    """Each weight is that of both means of a pair, and all together make one."""
    weights = edge_weights(pairs)
    assert len(weights) == pairs
    assert 2.0 * sum(weights) == pytest.approx(1.0, abs=1e-15)


@given(st.integers(0, 2**32 - 1), st.integers(2, 40))
@settings(max_examples=40, deadline=None)
def test_tangential_parts_telescope(seed, count):
    """Whatever the rates' noise, the tangential parts add up to the difference between the ends."""
    rng = np.random.default_rng(seed)
    interval, rate = rng.uniform(0.05, 0.9, count), rng.standard_normal((count, 3))
    position = np.tile(rng.standard_normal(3), (count, 1))
    acceleration = lever_arm_acceleration(interval, rate, position, np.zeros(count, int))
    inside = np.diff(edge_values(interval, rate), axis=0)
    squares = np.cross(rate, np.cross(rate, position)) + np.cross(inside, np.cross(inside, position)) / 12.0
    tangential = acceleration - squares
    np.testing.assert_allclose(interval @ tangential, np.cross(rate[-1] - rate[0], position[0]), atol=1e-13)


def test_tangential_part_of_a_steady_spin_up():
    """Rates that grow evenly over uneven samples: α × r exactly, but for the end samples' half edges."""
    edges = np.cumsum([0.0, 0.1, 0.3, 0.1, 0.2, 0.2, 0.5, 0.1])
    alpha, position = np.array([0.3, -0.2, 0.5]), np.array([1.0, 2.0, -1.0])
    rate = 0.5 * (edges[1:] + edges[:-1])[:, None] * alpha
    interval = np.diff(edges)
    acceleration = lever_arm_acceleration(interval, rate, np.tile(position, (7, 1)), np.zeros(7, int))
    expected = np.cross(alpha, position) + np.cross(rate, np.cross(rate, position))
    expected += np.cross(alpha, np.cross(alpha, position)) * interval[:, None] ** 2 / 12.0
    np.testing.assert_allclose(acceleration[1:-1], expected[1:-1], atol=1e-14)


@pytest.mark.parametrize("degree", range(8))
def test_edge_values_of_polynomials(degree):
    """Eighth order: exact to the seventh power, four samples from an end."""
    edges = np.linspace(-1.0, 1.0, 17)
    rising = edges ** (degree + 1) / (degree + 1)
    mean = np.tile((np.diff(rising) / np.diff(edges))[:, None], 3)
    values = edge_values(np.diff(edges), mean)[4:-4, 0]
    np.testing.assert_allclose(values, edges[4:-4] ** degree, atol=1e-13)


def test_edge_values_near_an_uneven_sample():
    """Every edge has the order that the samples around it allow; a longer sample lowers only its neighbours' order."""
    interval = np.full(24, 0.125)
    interval[12] = 0.25
    edges = np.concatenate(([0.0], np.cumsum(interval)))
    mean = np.tile((-np.diff(np.cos(6.0 * edges)) / 6.0 / interval)[:, None], 3)
    error = np.abs(edge_values(interval, mean)[:, 0] - np.sin(6.0 * edges))
    assert max(np.max(error[4:9]), np.max(error[17:-4])) < 2e-4  # eighth order: 0.75**8 / 630
    assert error[9] < 1e-3 and error[10] < 1e-2  # sixth and fourth
    assert error[11] > 0.02  # second, next to the long one


def test_lever_arm_in_a_fast_oscillation():
    """Eight samples a second, an oscillation a second: a mean over a sample to a thousandth of itself."""
    dt, w, position = 0.125, 2.0 * np.pi, np.array([-0.8, 0.8, -0.6])
    edges = np.arange(0.0, 8.0 + 0.5 * dt, dt)
    swing = np.array([0.0, 0.2, 0.1])
    rate = np.outer(-np.diff(np.cos(w * edges)) / (w * dt), swing)
    count = len(rate)
    acceleration = lever_arm_acceleration(np.full(count, dt), rate, np.tile(position, (count, 1)), np.zeros(count))
    tangential = np.outer(np.diff(np.sin(w * edges)) / dt, np.cross(swing, position))
    squared = 0.5 - np.diff(np.sin(2.0 * w * edges)) / (4.0 * w * dt)
    expected = tangential + np.outer(squared, np.cross(swing, np.cross(swing, position)))
    size = np.max(np.linalg.norm(expected, axis=1))
    assert np.max(np.linalg.norm(acceleration - expected, axis=1)[4:-4]) < 1e-3 * size


@pytest.mark.parametrize("even", [True, False])
@pytest.mark.parametrize("change_of", ["unit", "both"])
def test_an_instrument_change_does_not_mix_the_two(change_of, even):
    """Each side of a change is what it is without the other side: the gyros' difference makes no spike."""
    rng = np.random.default_rng(11)
    n, change = 24, 11  # even intervals allow the highest order on both sides
    interval, rate = rng.uniform(0.1, 0.2, n), rng.standard_normal((n, 3))
    if even:
        interval[:] = 0.125
    position = np.tile([0.5, 0.1, -0.2], (n, 1))
    unit = np.zeros(n, int)
    unit[change:] = 1
    if change_of == "both":
        position[change:] = [-0.3, 0.6, 0.2]
    together = lever_arm_acceleration(interval, rate, position, unit)
    sides = (slice(change), slice(change, n))
    apart = [lever_arm_acceleration(interval[p], rate[p], position[p], unit[p]) for p in sides]
    np.testing.assert_allclose(together, np.concatenate(apart), atol=1e-14)


def test_a_change_of_position_keeps_the_rate_at_the_edge():
    """The centre of mass moves, the gyros stay: both sides are those of an IMU that was always there."""
    rng = np.random.default_rng(12)
    n, change = 24, 11
    interval, rate, unit = np.full(n, 0.125), rng.standard_normal((n, 3)), np.zeros(n, int)
    places = [np.tile(r, (n, 1)) for r in ([0.5, 0.1, -0.2], [-0.3, 0.6, 0.2])]
    after = (np.arange(n) >= change)[:, None]
    moved = lever_arm_acceleration(interval, rate, np.where(after, *places[::-1]), unit)
    before, later = (lever_arm_acceleration(interval, rate, r, unit) for r in places)
    np.testing.assert_array_equal(moved, np.where(after, later, before))
