"""From measured means to effective samples: lever arm, coning and sculling, and what a sample hides.

Between samples the body turns and the force changes. To second order in the interval, with force and rate
linear in time through the neighbouring samples (f = f0 + f1 t, w = w0 + w1 t about mid-sample), the
rotation over a sample is ``dt (w0 + dt²/12 w0 × w1)`` (coning), and the velocity gained, in axes turned by
half of that, is ``dt (f0 + dt²/12 (w0 × f1 - w1 × f0) + dt²/24 w0 × (w0 × f0))`` (sculling and rotation).
Savage, J. Guidance 21 (1998) 19 and 208, in post-flight form: neighbours on both sides are known.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from math import factorial

import numpy as np
from numba import njit
from numpy.typing import NDArray

from edl_filter.telemetry.record import ImuRecord

Array = NDArray[np.float64]

#: Part of a sample's hidden rotation in which two integrations of the same samples differ. Two second-order
#: algorithms, with backward and with central differences, differ by 1/√12 of it; on-board quaternions against
#: HIGHRATE gyros show 0.02 to 0.2 through parachute openings and bounces of both rovers.
NOT_SHARED = 0.05


@dataclass(frozen=True)
class Samples:
    """What drives the propagation: effective means at the centre of mass, and their noise.

    Attributes
    ----------
    time, interval : (N,) arrays
        s; end and length of the intervals.
    force, rate : (N, 3) arrays
        Effective means for `strapdown.propagate`, m/s² and rad/s, body axes: with coning and sculling, in the axes of
        half a sample's turn.
    mean_force, mean_rate : (N, 3) arrays
        Plain means at the centre of mass: what the vehicle felt, not what integrates best.
    force_noise, rate_noise : (N,) arrays
        One sigma of a sample, m/s² and rad/s, what the sample hides included.
    shared_rate_noise : (N,) array
        The part of the rate noise that an attitude computed on board from the same gyros has too: the gyros'
        own and most of what a sample hides.
    net_turn : (N,) boolean array
        Where the rate was taken from two attitudes, not from gyros.
    unit : (N,) integer array
        Which instrument's errors apply.
    """

    time: Array
    interval: Array
    force: Array
    rate: Array
    mean_force: Array
    mean_rate: Array
    force_noise: Array
    rate_noise: Array
    shared_rate_noise: Array
    net_turn: NDArray[np.bool_]
    unit: NDArray[np.int64]

    def index(self, time: float) -> int:
        """Number of samples whose interval ends by `time` (a microsecond allowed for rounding)."""
        return int(np.searchsorted(self.time, time + 1e-6))

    def part(self, start: int, stop: int) -> Samples:
        """Samples `start` to `stop`."""
        return Samples(**{f.name: getattr(self, f.name)[start:stop] for f in fields(self)})

    def split(self, times: Array) -> Samples:
        """The same motion with sample edges also at `times`; the random walks stay what they were."""
        edges = np.concatenate(([self.time[0] - self.interval[0]], self.time))
        inside = np.unique(times)
        inside = inside[(inside > edges[0]) & (inside < edges[-1])]
        after = np.searchsorted(edges, inside)
        new = inside[np.minimum(edges[after] - inside, inside - edges[after - 1]) > 1e-6]
        time = np.sort(np.concatenate((self.time, new)))
        index = np.searchsorted(self.time, time - 1e-9)
        interval = np.diff(time, prepend=edges[0])
        share = np.sqrt(self.interval[index] / interval)
        return Samples(
            time=time,
            interval=interval,
            force=self.force.take(index, axis=0),
            rate=self.rate.take(index, axis=0),
            mean_force=self.mean_force.take(index, axis=0),
            mean_rate=self.mean_rate.take(index, axis=0),
            force_noise=self.force_noise[index] * share,
            rate_noise=self.rate_noise[index] * share,
            shared_rate_noise=self.shared_rate_noise[index] * share,
            net_turn=self.net_turn.take(index, axis=0),
            unit=self.unit.take(index, axis=0),
        )


def effective_samples(record: ImuRecord) -> Samples:
    """Samples for `strapdown.propagate` from a record in body axes.

    Parameters
    ----------
    record : ImuRecord

    Returns
    -------
    Samples
    """
    dt, rate = record.interval, record.angular_rate
    force = record.specific_force - lever_arm_acceleration(dt, rate, record.position, record.unit)
    more_force, more_rate = _turning(dt, force, rate, slope(record.time, dt, force), slope(record.time, dt, rate))
    more_force[record.net_gain] = 0.0
    more_rate[record.net_turn] = 0.0
    hidden_force, hidden_rate = hidden_motion(dt, force, rate)
    return Samples(
        time=record.time,
        interval=dt,
        force=force + more_force,
        rate=rate + more_rate,
        mean_force=force,
        mean_rate=rate,
        force_noise=np.hypot(record.force_noise, hidden_force),
        rate_noise=np.hypot(record.rate_noise, hidden_rate),
        shared_rate_noise=np.hypot(record.shared_rate_noise, np.sqrt(1.0 - NOT_SHARED**2) * hidden_rate),
        net_turn=record.net_turn,
        unit=record.unit,
    )


def edge_values(interval: Array, mean: Array, parted: NDArray[np.bool_] | None = None) -> Array:
    """Values at the N + 1 edges of adjoining intervals from their means ``(N, 3)``.

    Eighth order where the eight intervals around an edge are equal, sixth, fourth and second where fewer are: central
    differences of the integral, which is known at the edges. At 8 Hz and one oscillation a second, second order would
    miss a tenth of an angular acceleration, and two IMUs a metre apart still show what fourth order leaves. No higher
    order reaches across an inner edge that is `parted` ``(N - 1,)``: other instruments on its two sides.
    """
    # where the interval or the instrument changes; a stencil is even if there is no change inside
    changed = np.abs(np.diff(interval)) > 1e-6 * interval[:-1]
    changes = np.concatenate(([0], np.cumsum(changed if parted is None else changed | parted)))
    return _edges(interval, np.ascontiguousarray(mean), changes, _EDGE)


def edge_weights(pairs: int) -> tuple[float, ...]:
    """Weights of the pairs of means around an edge, nearest first, for the order twice their number."""
    k = pairs
    central = [(-1) ** (j + 1) * factorial(k) ** 2 / (j * factorial(k - j) * factorial(k + j)) for j in range(1, k + 1)]
    return tuple(sum(central[i:]) for i in range(k))


#: Weights for two, three and four pairs, with zeros behind.
_EDGE = np.array([np.pad(edge_weights(k), (0, 4 - k)) for k in (2, 3, 4)])


def slope(time: Array, interval: Array, mean: Array) -> Array:
    """Time derivative at mid-sample by central difference of the neighbouring means, ``(N, 3)``."""
    return np.gradient(mean, time - 0.5 * interval, axis=0)


def lever_arm_acceleration(interval: Array, rate: Array, position: Array, unit: NDArray[np.int64]) -> Array:
    """Mean over each sample of ``α × r + ω × (ω × r)``, what an IMU at r feels more than the centre of mass.

    The first term is the difference of ω × r between the sample's edges, so that over many samples its
    errors telescope instead of growing (thesis eq. 3.3 in increments); the second has what a rate that changes
    inside the sample adds to the square of its mean. Where the instrument changes, the edge belongs to neither's
    neighbour and is taken from the sample itself.
    """
    parted = np.any(np.diff(position, axis=0) != 0.0, axis=1) | (np.diff(unit) != 0)
    edges = edge_values(interval, rate, parted)
    start, end = edges[:-1].copy(), edges[1:].copy()
    new = np.flatnonzero(parted)
    end[new] = rate[new]
    start[new + 1] = rate[new + 1]
    return _felt(interval, np.ascontiguousarray(rate), end - start, np.ascontiguousarray(position))


def hidden_motion(interval: Array, force: Array, rate: Array) -> tuple[Array, Array]:
    """One sigma per axis of what happens inside a sample and its means do not show, m/s² and rad/s.

    Where force and rate run smoothly from sample to sample this is nothing; at a parachute's snatch or a
    bounce their course inside the sample is unknown. The part of a mean that is not smooth is what it differs
    by from its neighbours' mean; with an unknown phase between that and the rotation (uniform: 1/√12) and an
    unknown angle between their axes (√2/3 per axis of a cross product), the hidden velocity is of the order
    ``(|Δθ| |δΔv| + |δΔθ| |Δv|)`` and the hidden rotation ``|Δθ| |δΔθ|``, both times ``√2/3 / √12``.
    """
    dv, rough_v = _length(force) * interval, _length(roughness(force)) * interval
    dtheta, rough_theta = _length(rate) * interval, _length(roughness(rate)) * interval
    factor = np.sqrt(2.0) / 3.0 / np.sqrt(12.0) / interval
    return factor * (dtheta * rough_v + rough_theta * dv), factor * dtheta * rough_theta


def roughness(mean: Array) -> Array:
    """A sample minus the mean of its two neighbours, ``(N, 3)``; zero at the ends."""
    out = np.zeros_like(mean)
    out[1:-1] = mean[1:-1] - 0.5 * (mean[:-2] + mean[2:])
    return out


def _length(vectors: Array) -> Array:
    """Of each row."""
    x, y, z = vectors.T
    return np.asarray(np.sqrt(x * x + y * y + z * z), np.float64)


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
def _felt(interval, rate, change, position):
    """``Δω × r / dt + ω × (ω × r) + Δω × (Δω × r) / 12`` of every sample."""
    out = np.empty_like(rate)
    for i in range(len(rate)):
        r = position[i, 0], position[i, 1], position[i, 2]
        w = rate[i, 0], rate[i, 1], rate[i, 2]
        dw = change[i, 0], change[i, 1], change[i, 2]
        swung = _cross(dw, r)
        steady, inside = _cross(w, _cross(w, r)), _cross(dw, swung)
        for axis in range(3):
            out[i, axis] = swung[axis] / interval[i] + steady[axis] + inside[axis] / 12.0
    return out


@njit(cache=True, error_model="numpy", nogil=True)
def _turning(interval, force, rate, force_slope, rate_slope):
    """What a sample's turn adds to its means: sculling and rotation to force, coning to rate."""
    more_force, more_rate = np.empty_like(force), np.empty_like(rate)
    for i in range(len(rate)):
        w, f = (rate[i, 0], rate[i, 1], rate[i, 2]), (force[i, 0], force[i, 1], force[i, 2])
        w1 = rate_slope[i, 0], rate_slope[i, 1], rate_slope[i, 2]
        f1 = force_slope[i, 0], force_slope[i, 1], force_slope[i, 2]
        coning, rowing, sculling = _cross(w, w1), _cross(w, f1), _cross(w1, f)
        rotation = _cross(w, _cross(w, f))
        h = interval[i] ** 2
        for axis in range(3):
            more_force[i, axis] = h / 12.0 * (rowing[axis] - sculling[axis]) + h / 24.0 * rotation[axis]
            more_rate[i, axis] = h / 12.0 * coning[axis]
    return more_force, more_rate


@njit(error_model="numpy")
def _cross(a, b):
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
