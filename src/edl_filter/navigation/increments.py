"""From measured means to effective samples: lever arm, coning and sculling, and the noise of unresolved motion.

Between samples the body turns and the force changes. To second order in the interval, with force and rate
linear in time through the neighbouring samples (f = f0 + f1 t, w = w0 + w1 t about mid-sample), the
rotation over a sample is ``dt (w0 + dt²/12 w0 × w1)`` (coning), and the velocity gained, in axes turned by
half of that, is ``dt (f0 + dt²/12 (w0 × f1 - w1 × f0) + dt²/24 w0 × (w0 × f0))`` (sculling and rotation).
Savage, J. Guidance 21 (1998) 19 and 208, in post-flight form: neighbours on both sides are known.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields

import numpy as np
from numba import njit

from edl_filter.imu_model.lever_arm import cross_product, lever_arm_acceleration
from edl_filter.telemetry.record import ImuRecord
from edl_filter.types import Array, BoolArray, IntArray

#: Part of a sample's unresolved rotation in which two integrations of the same samples differ. Two second-order
#: algorithms, with backward and with central differences, differ by 1/√12 of it; on-board quaternions against
#: HIGHRATE gyros show 0.02 to 0.2 through parachute openings and bounces of both rovers.
INTEGRATION_DIFFERENCE = 0.05


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
        Plain means at the centre of mass, m/s² and rad/s, body axes: for aerodynamics, without the corrections that the
        integration needs.
    force_noise, rate_noise : (N,) arrays
        One sigma of a sample, m/s² and rad/s, including unresolved motion.
    shared_rate_noise : (N,) array
        The part of the rate noise that an attitude computed on board from the same gyros has too, rad/s: the gyros'
        own and most of the unresolved motion.
    coning_corrected : (N,) boolean array
        Where the rate was taken from two attitudes, not from gyros.
    unit : (N,) integer array
        Which instrument's errors apply.
    force_fill_sigma, rate_fill_sigma : (N, 3) arrays, optional
        One sigma by which a value that was filled in may be wrong beyond its noise, m/s² and rad/s, body axes
        (`ImuRecord.force_fill_sigma`); zero where the instrument was read.
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
    coning_corrected: BoolArray
    unit: IntArray
    force_fill_sigma: Array = field(default_factory=lambda: np.zeros((0, 3)))
    rate_fill_sigma: Array = field(default_factory=lambda: np.zeros((0, 3)))

    def __post_init__(self) -> None:
        for key in ("force_fill_sigma", "rate_fill_sigma"):
            if not len(getattr(self, key)):
                object.__setattr__(self, key, np.zeros((len(self.time), 3)))

    @property
    def filled(self) -> BoolArray:
        """Samples ``(N,)`` of which a value was filled in."""
        return np.any(self.force_fill_sigma > 0.0, axis=1) | np.any(self.rate_fill_sigma > 0.0, axis=1)

    def index(self, time: float) -> int:
        """Number of samples whose interval ends by `time` (a microsecond allowed for rounding)."""
        return int(np.searchsorted(self.time, time + 1e-6))

    def part(self, start: int, stop: int) -> Samples:
        """Samples `start` to `stop`."""
        return Samples(*[getattr(self, name)[start:stop] for name in _SAMPLES_FIELDS])

    def split(self, times: Array) -> Samples:
        """The same motion with sample edges also at `times` (s); the random walks stay the same."""
        edges = np.concatenate(([self.time[0] - self.interval[0]], self.time))
        inside = np.unique(times)
        inside = inside[(inside > edges[0]) & (inside < edges[-1])]
        after = np.searchsorted(edges, inside)
        added = inside[np.minimum(edges[after] - inside, inside - edges[after - 1]) > 1e-6]
        time = np.sort(np.concatenate((self.time, added)))
        index = np.searchsorted(self.time, time - 1e-9)
        interval = np.diff(time, prepend=edges[0])
        factor = np.sqrt(self.interval[index] / interval)
        return Samples(
            time=time,
            interval=interval,
            force=self.force.take(index, axis=0),
            rate=self.rate.take(index, axis=0),
            mean_force=self.mean_force.take(index, axis=0),
            mean_rate=self.mean_rate.take(index, axis=0),
            force_noise=self.force_noise[index] * factor,
            rate_noise=self.rate_noise[index] * factor,
            shared_rate_noise=self.shared_rate_noise[index] * factor,
            coning_corrected=self.coning_corrected.take(index, axis=0),
            unit=self.unit.take(index, axis=0),
            force_fill_sigma=self.force_fill_sigma[index] * factor[:, None],
            rate_fill_sigma=self.rate_fill_sigma[index] * factor[:, None],
        )


_SAMPLES_FIELDS = tuple(f.name for f in fields(Samples))


def effective_samples(record: ImuRecord) -> Samples:
    """Samples for `strapdown.propagate` from a record in body axes.

    Parameters
    ----------
    record : ImuRecord
        In body axes.

    Returns
    -------
    Samples
    """
    dt, rate = record.interval, record.angular_rate
    force = record.specific_force - lever_arm_acceleration(dt, rate, record.position, record.unit)
    sculling, coning = _rotation_corrections(
        dt, force, rate, slope(record.time, dt, force), slope(record.time, dt, rate)
    )
    sculling[record.sculling_corrected] = 0.0
    coning[record.coning_corrected] = 0.0
    unresolved_force, unresolved_rate = unresolved_motion(dt, force, rate)
    return Samples(
        time=record.time,
        interval=dt,
        force=force + sculling,
        rate=rate + coning,
        mean_force=force,
        mean_rate=rate,
        force_noise=np.hypot(record.force_noise, unresolved_force),
        rate_noise=np.hypot(record.rate_noise, unresolved_rate),
        shared_rate_noise=np.hypot(
            record.shared_rate_noise, np.sqrt(1.0 - INTEGRATION_DIFFERENCE**2) * unresolved_rate
        ),
        coning_corrected=record.coning_corrected,
        unit=record.unit,
        force_fill_sigma=record.force_fill_sigma,
        rate_fill_sigma=record.rate_fill_sigma,
    )


def slope(time: Array, interval: Array, mean: Array) -> Array:
    """Time derivative at mid-sample by central difference of the neighbouring means.

    Parameters
    ----------
    time, interval : (N,) arrays
        s; end and length of the intervals.
    mean : (N, 3) array
        Of any unit.

    Returns
    -------
    (N, 3) array
        Per second.
    """
    return np.gradient(mean, time - 0.5 * interval, axis=0)


def unresolved_motion(interval: Array, force: Array, rate: Array) -> tuple[Array, Array]:
    """Noise of the means that is due to motion within a sample which the means do not show.

    Where force and rate run smoothly from sample to sample this is zero; at a parachute's snatch or a
    bounce their course inside the sample is unknown. The part of a mean that is not smooth is its difference
    from its neighbours' mean; with an unknown phase between that and the rotation (uniform: 1/√12) and an
    unknown angle between their axes (√2/3 per axis of a cross product), the unresolved velocity is of the order
    ``(|Δθ| |δΔv| + |δΔθ| |Δv|)`` and the unresolved rotation ``|Δθ| |δΔθ|``, both times ``√2/3 / √12``.

    Parameters
    ----------
    interval : (N,) array
        s.
    force, rate : (N, 3) arrays
        Means, m/s² and rad/s, body axes.

    Returns
    -------
    force_sigma, rate_sigma : (N,) arrays
        One sigma per axis, m/s² and rad/s.
    """
    dv, irregular_dv = _length(force) * interval, _length(second_difference(force)) * interval
    dtheta, irregular_dtheta = _length(rate) * interval, _length(second_difference(rate)) * interval
    factor = np.sqrt(2.0) / 3.0 / np.sqrt(12.0) / interval
    return factor * (dtheta * irregular_dv + irregular_dtheta * dv), factor * dtheta * irregular_dtheta


def second_difference(mean: Array) -> Array:
    """Each sample of ``(N, 3)`` minus the mean of its two neighbours; zero at the ends."""
    out = np.zeros_like(mean)
    out[1:-1] = mean[1:-1] - 0.5 * (mean[:-2] + mean[2:])
    return out


def _length(vectors: Array) -> Array:
    """Length of each row."""
    x, y, z = vectors.T
    return np.asarray(np.sqrt(x * x + y * y + z * z), np.float64)


@njit(cache=True, error_model="numpy", nogil=True)
def _rotation_corrections(interval, force, rate, force_slope, rate_slope):
    """Corrections of a sample's means for its rotation: sculling and rotation to force, coning to rate."""
    to_force, to_rate = np.empty_like(force), np.empty_like(rate)
    for i in range(len(rate)):
        w, f = (rate[i, 0], rate[i, 1], rate[i, 2]), (force[i, 0], force[i, 1], force[i, 2])
        w1 = rate_slope[i, 0], rate_slope[i, 1], rate_slope[i, 2]
        f1 = force_slope[i, 0], force_slope[i, 1], force_slope[i, 2]
        coning, w_f1, w1_f = cross_product(w, w1), cross_product(w, f1), cross_product(w1, f)
        rotation = cross_product(w, cross_product(w, f))
        h = interval[i] ** 2
        for axis in range(3):
            to_force[i, axis] = h / 12.0 * (w_f1[axis] - w1_f[axis]) + h / 24.0 * rotation[axis]
            to_rate[i, axis] = h / 12.0 * coning[axis]
    return to_force, to_rate
