"""Acceleration of an IMU's place against the centre of mass: ``α × r + ω × (ω × r)`` (thesis eq. 3.3).

Three forms of the same equation, by what is known of the rotation: means of the rates over samples
(`lever_arm_acceleration`), which needs the rates at the samples' edges (`edge_values`); exact means of angular
acceleration and of products of rates (`lever_arm_acceleration_of_products`); or rate and angular acceleration at
instants (`lever_arm_acceleration_at`).
"""

from __future__ import annotations

from math import factorial

import numpy as np
from numba import njit

from edl_filter import rotations
from edl_filter.types import Array, BoolArray, IntArray


def lever_arm_acceleration_at(angular_acceleration: Array, rate: Array, position: Array) -> Array:
    """Acceleration of a place against the centre of mass, at instants.

    Parameters
    ----------
    angular_acceleration, rate : (N, 3) arrays
        rad/s² and rad/s, body axes.
    position : (3,) or (N, 3) array
        Place from the centre of mass, m, body axes.

    Returns
    -------
    (N, 3) array
        m/s².
    """
    return np.cross(angular_acceleration, position) + np.cross(rate, np.cross(rate, position))


def lever_arm_acceleration_of_products(angular_acceleration: Array, products: Array, position: Array) -> Array:
    """Mean acceleration of a place against the centre of mass, from exact means over intervals.

    Parameters
    ----------
    angular_acceleration : (N, 3) array
        Means, rad/s², body axes.
    products : (N, 6) array
        Means of the products of rates xx, yy, zz, xy, xz, yz, rad²/s².
    position : (3,) or (N, 3) array
        Place from the centre of mass, m, body axes.

    Returns
    -------
    (N, 3) array
        m/s².
    """
    xx, yy, zz, xy, xz, yz = products.T
    x, y, z = np.broadcast_to(position, angular_acceleration.shape).T
    # w × (w × r) = w (w · r) - r w²
    centripetal = np.column_stack((
        -(yy + zz) * x + xy * y + xz * z, xy * x - (xx + zz) * y + yz * z, xz * x + yz * y - (xx + yy) * z
    ))  # fmt: skip
    return rotations.cross(angular_acceleration, np.broadcast_to(position, angular_acceleration.shape)) + centripetal


def lever_arm_acceleration(interval: Array, rate: Array, position: Array, unit: IntArray) -> Array:
    """Mean acceleration of an instrument's place against the centre of mass over each sample, from means of the rates.

    The first term is the difference of ω × r between the sample's edges, so that over many samples its
    errors telescope instead of growing (thesis eq. 3.3 in increments); the second has what a rate that changes
    inside the sample adds to the square of its mean. Where the instrument changes, neither side's stencil may reach
    across, and the rate at the edge is that of the sample itself. Where only its position changes, because the centre
    of mass moved, the gyros are the same and the rate at the edge is that of both sides.

    Parameters
    ----------
    interval : (N,) array
        Lengths of adjoining intervals, s.
    rate : (N, 3) array
        Means over them, rad/s, body axes.
    position : (N, 3) array
        Place of the instrument from the centre of mass, m, body axes.
    unit : (N,) integer array
        Which instrument took the sample.

    Returns
    -------
    (N, 3) array
        m/s².
    """
    parted = np.diff(unit) != 0
    edges = edge_values(interval, rate, parted)
    start, end = edges[:-1].copy(), edges[1:].copy()
    last = np.flatnonzero(parted)
    end[last] = rate[last]
    start[last + 1] = rate[last + 1]
    return _mean_acceleration(interval, np.ascontiguousarray(rate), end - start, np.ascontiguousarray(position))


def edge_values(interval: Array, mean: Array, parted: BoolArray | None = None) -> Array:
    """Values at the edges of adjoining intervals from the means over them.

    Eighth order where the eight intervals around an edge are equal, sixth, fourth and second where fewer are: central
    differences of the integral, which is known at the edges. At 8 Hz and one oscillation a second, second order would
    miss a tenth of an angular acceleration, and between two IMUs a metre apart the error of fourth order is measurable.

    Parameters
    ----------
    interval : (N,) array
        s.
    mean : (N, 3) array
        Of any unit.
    parted : (N - 1,) boolean array, optional
        Inner edges across which no order above the second reaches: other instruments on the two sides.

    Returns
    -------
    (N + 1, 3) array
        In the unit of `mean`.
    """
    # where the interval or the instrument changes; a stencil is even if there is no change inside
    changed = np.abs(np.diff(interval)) > 1e-6 * interval[:-1]
    changes = np.concatenate(([0], np.cumsum(changed if parted is None else changed | parted)))
    return _edges(interval, np.ascontiguousarray(mean), changes, _EDGE)


def mean_derivative(interval: Array, mean: Array) -> Array:
    """Mean time derivative over each of N adjoining intervals, from `edge_values`.

    Parameters
    ----------
    interval : (N,) array
        s.
    mean : (N, 3) array
        Mean over each interval, of any unit.

    Returns
    -------
    (N, 3) array
        In the unit of `mean` per s.
    """
    return np.diff(edge_values(interval, mean), axis=0) / interval[:, None]


def edge_weights(pairs: int) -> tuple[float, ...]:
    """Weights of the pairs of means around an edge, nearest first, for the order twice their number."""
    k = pairs
    central = [(-1) ** (j + 1) * factorial(k) ** 2 / (j * factorial(k - j) * factorial(k + j)) for j in range(1, k + 1)]
    return tuple(sum(central[i:]) for i in range(k))


#: Samples on each side of an edge that take part in the value there.
EDGE_REACH = 4
#: Weights for two, three and four pairs, with zeros behind.
_EDGE = np.array([np.pad(edge_weights(k), (0, EDGE_REACH - k)) for k in range(2, EDGE_REACH + 1)])


@njit(cache=True, error_model="numpy", nogil=True)
def _edges(interval, mean, changes, weights):
    """Values at all edges: the highest order whose stencil is even, or the second."""
    n = len(mean)
    out = np.empty((n + 1, 3))
    out[0], out[n] = mean[0], mean[n - 1]
    for e in range(n - 1):  # the edge between two samples
        share = interval[e + 1] / (interval[e] + interval[e + 1])
        for axis in range(3):
            out[e + 1, axis] = mean[e, axis] * share + mean[e + 1, axis] * (1.0 - share)
        for order in range(len(weights) - 1, -1, -1):
            pairs = order + 2
            if e - pairs + 1 < 0 or e + pairs >= n or changes[e + pairs] != changes[e - pairs + 1]:
                continue
            for axis in range(3):
                value = 0.0
                for i in range(pairs):
                    value += weights[order, i] * (mean[e - i, axis] + mean[e + 1 + i, axis])
                out[e + 1, axis] = value
            break
    return out


@njit(cache=True, error_model="numpy", nogil=True)
def _mean_acceleration(interval, rate, change, position):
    """``Δω × r / dt + ω × (ω × r) + Δω × (Δω × r) / 12`` of every sample."""
    out = np.empty_like(rate)
    for i in range(len(rate)):
        r = position[i, 0], position[i, 1], position[i, 2]
        w = rate[i, 0], rate[i, 1], rate[i, 2]
        dw = change[i, 0], change[i, 1], change[i, 2]
        tangential = cross_product(dw, r)
        centripetal, unsteady = cross_product(w, cross_product(w, r)), cross_product(dw, tangential)
        for axis in range(3):
            out[i, axis] = tangential[axis] / interval[i] + centripetal[axis] + unsteady[axis] / 12.0
    return out


@njit(error_model="numpy")
def cross_product(a, b):
    """Vector product of two triples of numbers.

    Parameters
    ----------
    a, b : (3,) arrays or tuples of three floats
        Factors.

    Returns
    -------
    tuple of three floats
        In the product of their units.
    """
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
