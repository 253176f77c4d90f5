"""From measured means to effective samples: lever arm, coning and sculling, and the noise of unresolved motion.

The specific force is moved to the centre of mass (`imu_model.lever_arm`), force and rate are corrected for the rotation
within the sample (`rotation_corrections`), and what the samples do not show of it is noise (`unresolved`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, fields

import numpy as np
from numpy.typing import ArrayLike

from edl_filter import rotations
from edl_filter.estimation.interpolating_spline import InterpolatingSpline, integral_spline
from edl_filter.imu_model.lever_arm import lever_arm_acceleration
from edl_filter.navigation.rotation_corrections import rotation_corrections
from edl_filter.navigation.unresolved import UnresolvedMotion, unresolved_motion
from edl_filter.telemetry.record import SAME_TIME, ImuRecord, filled_samples, sample_edges
from edl_filter.types import Array, BoolArray, IntArray

#: Distance (s) from an edge of a sample within which no further edge is made: `Samples.index` counts a sample that ends
#: there as over, whatever the rounding of both times.
_ONE_EDGE = SAME_TIME - 1e-9
#: Number of samples from which the course up to a jump is extrapolated; those before them have no weight left.
_EXTRAPOLATED = 40
#: Part of one sample's unresolved rotation in which the attitude that was computed on board differs from the integral
#: of the same samples by its algorithm (`onboard_rates`). Spirit's quaternions differ from it by 0.12 under the
#: parachute and 0.13 during the bounces, their rounding subtracted.
INTEGRATION_DIFFERENCE = 0.15


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
    force_noise, rate_noise : (N, 3) arrays
        One sigma of a sample, m/s² and rad/s, body axes, including unresolved motion; may be given as ``(N,)``, for all
        axes.
    shared_rate_noise : (N, 3) array
        The part of the rate noise that the flight computer integrated too, rad/s, body axes: the gyros' own and most of
        the unresolved motion. It is no error of the propagated on-board attitude; may be given as ``(N,)``.
    coning_corrected : (N,) boolean array
        Where the rate was taken from two attitudes, not from gyros.
    unit : (N,) integer array
        Which instrument's errors apply.
    force_fill_sigma, rate_fill_sigma : (N, 3) arrays, optional
        One sigma by which a value that was filled in may be wrong beyond its noise, m/s² and rad/s, body axes
        (`ImuRecord.force_fill_sigma`).
    onboard_rate : (N, 3) array, optional
        Effective means as a flight computer integrates the same samples (`onboard_rates`), rad/s, body axes; absent: as
        `rate`.
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
    onboard_rate: Array = field(default_factory=lambda: np.zeros((0, 3)))

    def __post_init__(self) -> None:
        if not len(self.onboard_rate):
            object.__setattr__(self, "onboard_rate", self.rate)
        for key in ("force_fill_sigma", "rate_fill_sigma"):
            if not len(getattr(self, key)):
                object.__setattr__(self, key, np.zeros((len(self.time), 3)))
        for key in ("force_noise", "rate_noise", "shared_rate_noise"):
            if getattr(self, key).ndim == 1:
                object.__setattr__(self, key, np.repeat(getattr(self, key)[:, None], 3, axis=1))

    @property
    def edges(self) -> Array:
        """Edges ``(N + 1,)`` of the samples, s."""
        return sample_edges(self.time, self.interval)

    @property
    def middle(self) -> Array:
        """Middle ``(N,)`` of each sample's interval, s."""
        return self.time - 0.5 * self.interval

    @property
    def filled(self) -> BoolArray:
        """Samples ``(N,)`` of which a value was filled in."""
        return filled_samples(self.force_fill_sigma, self.rate_fill_sigma)

    @property
    def unit_changes(self) -> Array:
        """Times ``(K,)`` from which another instrument drives, s: ends of the last samples of the one before."""
        return self.time[np.flatnonzero(np.diff(self.unit))]

    def index(self, time: float) -> int:
        """Number of samples whose interval ends by `time` (`SAME_TIME` allowed for rounding)."""
        return int(self.time.searchsorted(time + SAME_TIME))

    def indices(self, times: ArrayLike) -> IntArray:
        """`index` of several times ``(K,)``, s."""
        return np.searchsorted(self.time, np.asarray(times, float) + SAME_TIME)

    def part(self, start: int, stop: int) -> Samples:
        """Samples `start` to `stop`."""
        return Samples(*[getattr(self, name)[start:stop] for name in _SAMPLES_FIELDS])

    def split(self, times: Array) -> Samples:
        """The same motion with sample edges also at `times` ``(K,)``, s; the random walks stay the same.

        Force and rate inside a sample are those of the spline through their integrals, as in `rotation_corrections`.
        The last part of the sample has what remains, so that the whole sample's rotation and velocity do not change.
        The plain means of all parts are those of the sample, which is what was measured.
        """
        edges = self.edges
        inside = np.unique(times)
        inside = inside[(inside > edges[0]) & (inside < edges[-1])]
        after = np.searchsorted(edges, inside)
        added = inside[np.minimum(edges[after] - inside, inside - edges[after - 1]) > _ONE_EDGE]
        time = np.sort(np.concatenate((self.time, added)))
        index = np.searchsorted(self.time, time - 1e-9)
        interval = np.diff(time, prepend=edges[0])
        factor = np.sqrt(self.interval[index] / interval)[:, None]
        out = Samples(
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
            force_fill_sigma=self.force_fill_sigma[index] * factor,
            rate_fill_sigma=self.rate_fill_sigma[index] * factor,
            onboard_rate=self.onboard_rate.take(index, axis=0),
        )
        divided = np.flatnonzero(np.bincount(index) > 1)
        if len(divided):
            segment = self._segments()
            courses = {i: self._course(np.flatnonzero(segment == i)) for i in np.unique(segment[divided])}
            for k in divided:
                self._divide(out, np.flatnonzero(index == k), int(k), courses[segment[k]])
        return out

    def _segments(self) -> IntArray:
        """Number ``(N,)`` of each sample's segment, across whose ends no spline reaches: a short sample is its own."""
        short = self.interval < 0.5 * np.median(self.interval)
        return np.cumsum(short | np.append(False, short[:-1]))

    def _course(self, index: IntArray) -> InterpolatingSpline:
        """Spline through the integrals of force and rate over the adjoining samples of `index`."""
        edges = self.edges[index[0] : index[-1] + 2]
        return integral_spline(edges, self.interval[index], np.hstack((self.mean_force, self.mean_rate))[index])

    def _divide(self, out: Samples, part: IntArray, k: int, course: Callable[[Array], Array]) -> None:
        """Give the parts of sample `k`, which are `part` of `out`, their effective forces and rates; in place.

        `course` gives the integrals of force and rate ``(M, 6)`` at ``(M,)`` times. What the effective means have in
        addition to the plain ones is divided in proportion to time.
        """
        dt, whole_dt = out.interval[part], self.interval[k]
        increments = np.diff(course(np.append(out.time[part[0]] - dt[0], out.time[part[:-1]])), axis=0)
        mean_force, mean_rate = np.split(increments / dt[:-1, None], 2, axis=1)
        for name in ("rate", "onboard_rate"):
            rate, whole = getattr(out, name), getattr(self, name)[k]
            rate[part[:-1]] = mean_rate + (whole - self.mean_rate[k])
            rest = rotations.from_rotation_vector(whole * whole_dt)
            for i in part[:-1]:
                rest = rotations.multiply(rotations.from_rotation_vector(-rate[i] * out.interval[i]), rest)
            rate[part[-1]] = rotations.to_rotation_vector(rest) / dt[-1]
        # as `strapdown.step`: a sample's force is in the axes of half its turn
        out.force[part[:-1]] = mean_force + (self.force[k] - self.mean_force[k])
        half_turns = rotations.from_rotation_vector(0.5 * out.rate[part] * dt[:, None])
        velocity_increment = rotations.rotate(
            rotations.from_rotation_vector(0.5 * self.rate[k] * whole_dt), self.force[k] * whole_dt
        )
        attitude = np.array([0.0, 0.0, 0.0, 1.0])
        for i, half_turn in zip(part[:-1], half_turns[:-1], strict=True):
            middle = rotations.multiply(attitude, half_turn)
            velocity_increment = velocity_increment - rotations.rotate(middle, out.force[i]) * out.interval[i]
            attitude = rotations.multiply(middle, half_turn)
        middle = rotations.multiply(attitude, half_turns[-1])
        out.force[part[-1]] = rotations.rotate(rotations.conjugate(middle), velocity_increment) / dt[-1]

    def opened_at(self, time: float) -> Samples:
        """The same motion with a sample edge at the `time` (s) from which on a parachute pulls.

        Force and moment jump there. The part of the sample before has the course that the samples before it show. For
        a force that jumps, a Wiener process, that is its last value; for a rate whose derivative does, the spline of
        fifth degree through its integral, extrapolated. Where less than a quarter of the sample is behind the time,
        little of the jump is in it, and a small error of the extrapolation would be a large rate of that part: it is
        split as at any other time.
        """
        k = self.index(time)
        inside = 0 < k < len(self.time) and time - self.edges[k] > _ONE_EDGE
        if not inside or self.time[k] - time < 0.25 * self.interval[k]:
            return self
        out = self.split(np.array([time]))
        segment = self._segments()
        before = np.flatnonzero(segment[:k] == segment[k - 1])[-_EXTRAPOLATED:]
        edges, interval = self.edges[before[0] : k + 1], self.interval[before]
        rate = integral_spline(edges, interval, self.mean_rate[before])

        def course(times: Array) -> Array:
            return np.hstack((self.mean_force[k - 1] * (times - edges[-1])[:, None], rate(times)))

        self._divide(out, np.array([k, k + 1]), k, course)
        return out

    def stopped_at(self, time: float) -> Samples:
        """The same motion with a sample edge at the `time` (s) from which on the vehicle is at rest.

        The sample that contains this time may have an impact of tens of g in its mean, which is over at that time. The
        part of it after the stop has the median of the samples at rest and the noise of their random walk. The part
        before has what remains, so that the sum of both increments is that of the sample, and all of its noise.
        """
        k = self.index(time)
        if k + 1 >= len(self.time) or time - self.edges[k] <= _ONE_EDGE:
            return self
        out = self.split(np.array([time]))
        after = self.time[k] - time
        share = after / self.interval[k]
        values = {name: getattr(out, name).copy() for name in _SAMPLES_FIELDS}
        for name in ("force", "rate", "mean_force", "mean_rate", "onboard_rate"):
            whole, at_rest = getattr(self, name)[k], np.median(getattr(self, name)[k + 1 :], axis=0)
            values[name][k], values[name][k + 1] = (whole - share * at_rest) / (1.0 - share), at_rest
        for name in ("force_noise", "rate_noise", "shared_rate_noise"):
            noise = getattr(self, name)
            values[name][k] = noise[k] / (1.0 - share)
            random_walk = np.median(noise[k + 1 :] * np.sqrt(self.interval[k + 1 :, None]), axis=0)
            values[name][k + 1] = random_walk / np.sqrt(after)
        for name in ("force_fill_sigma", "rate_fill_sigma"):
            values[name][k], values[name][k + 1] = getattr(self, name)[k] / (1.0 - share), 0.0
        return Samples(**values)


_SAMPLES_FIELDS = tuple(f.name for f in fields(Samples))


def force_at_centre_of_mass(record: ImuRecord) -> Array:
    """Specific force at the centre of mass ``(N, 3)``, m/s², body axes, of a record in body axes."""
    return record.specific_force - lever_arm_acceleration(
        record.interval, record.angular_rate, record.position, record.unit
    )


def unresolved_motion_of(record: ImuRecord, impacts_from: float) -> UnresolvedMotion:
    """Noise of unresolved motion of a record in body axes whose vehicle hits the ground from `impacts_from` (s) on."""
    force = force_at_centre_of_mass(record)
    return unresolved_motion(record.time, record.interval, force, record.angular_rate, impacts_from)


def effective_samples(
    record: ImuRecord, impacts_from: float = np.inf, unresolved: UnresolvedMotion | None = None
) -> Samples:
    """Samples for `strapdown.propagate` from a record in body axes.

    Parameters
    ----------
    record : ImuRecord
        In body axes.
    impacts_from : float
        Time from which the vehicle hits the ground, s (`unresolved_motion`).
    unresolved : UnresolvedMotion, optional
        Noise that replaces that of this record's own motion: of the same record before small corrections.

    Returns
    -------
    Samples
    """
    dt, rate, force = record.interval, record.angular_rate, force_at_centre_of_mass(record)
    sculling, coning = rotation_corrections(record.time, dt, force, rate)
    sculling[record.sculling_corrected] = 0.0
    coning[record.coning_corrected] = 0.0
    if unresolved is None:
        unresolved = unresolved_motion_of(record, impacts_from)
    unresolved_force, unresolved_rate, in_sample = unresolved
    difference = INTEGRATION_DIFFERENCE * in_sample[:, None]
    unresolved_rate = np.maximum(unresolved_rate, difference)
    return Samples(
        time=record.time,
        interval=dt,
        force=force + sculling,
        rate=rate + coning,
        mean_force=force,
        mean_rate=rate,
        force_noise=np.hypot(record.force_noise[:, None], unresolved_force),
        rate_noise=np.hypot(record.rate_noise[:, None], unresolved_rate),
        shared_rate_noise=np.sqrt(record.shared_rate_noise[:, None] ** 2 + unresolved_rate**2 - difference**2),
        coning_corrected=record.coning_corrected,
        unit=record.unit,
        force_fill_sigma=record.force_fill_sigma,
        rate_fill_sigma=record.rate_fill_sigma,
        onboard_rate=onboard_rates(dt, rate, record.coning_corrected),
    )


def onboard_rates(interval: Array, rate: Array, coning_corrected: BoolArray) -> Array:
    """Effective mean rates of an attitude that was computed on board, sample by sample as the samples came.

    The flight computer knew the samples before, not those after: the rotation over a sample is
    ``Δθ + Δθ_before × Δθ / 12`` (Savage 1998). A regression of Spirit's quaternions on the products of
    increments gives 0.082 to 0.083 for this coefficient: they differ by 0.006 mrad a sample from this sum, their own
    rounding, and by 0.2 mrad under the parachute from an interpolation with both neighbours.

    Parameters
    ----------
    interval : (N,) array
        s.
    rate : (N, 3) array
        Means over the samples, rad/s, body axes.
    coning_corrected : (N,) boolean array
        Samples whose rate contains the coning already.

    Returns
    -------
    (N, 3) array
        rad/s.
    """
    out = rate.copy()
    out[1:] += rotations.cross(rate[:-1] * interval[:-1, None], rate[1:]) / 12.0
    out[coning_corrected] = rate[coning_corrected]
    return out
