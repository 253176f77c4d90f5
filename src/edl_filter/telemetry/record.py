"""Records that every telemetry reader returns: IMU samples, attitude and altimeter in body axes, and stated fixes.

The records are independent of files and missions; all later stages read telemetry only through them.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from edl_filter import rotations
from edl_filter.errors import InputError
from edl_filter.estimation.series import finite_rows
from edl_filter.imu_model.sensor_errors import SensorErrors
from edl_filter.types import Array, BoolArray, IntArray

#: Times that differ by less than this are equal, s: far above the rounding of times and of sums of intervals (some
#: 1e-10 s; tables in microseconds, 5e-7 s), and far below any sampling interval.
SAME_TIME = 1e-6


def within_window(time: Array, interval: Array, start: float, end: float) -> BoolArray:
    """Select the samples whose interval lies within a window.

    Parameters
    ----------
    time, interval : (N,) arrays
        End and length of each sample's interval, s.
    start, end : float
        Window, s; it is extended by `SAME_TIME` at both ends to allow for rounding.

    Returns
    -------
    (N,) boolean array
    """
    return (time - interval >= start - SAME_TIME) & (time <= end + SAME_TIME)


def sample_edges(time: Array, interval: Array) -> Array:
    """Edges ``(N + 1,)`` of adjoining samples, s, from the end and the length of each interval ``(N,)``, s."""
    return np.concatenate((time[:1] - interval[:1], time))


def filled_samples(force_fill_sigma: Array, rate_fill_sigma: Array) -> BoolArray:
    """Samples ``(N,)`` of which a value was filled in: one with a sigma ``(N, 3)`` of that."""
    return np.any(force_fill_sigma > 0.0, axis=1) | np.any(rate_fill_sigma > 0.0, axis=1)


#: Arrays of a record that are zero unless samples were lost, and the shape of one sample's.
_OPTIONAL_ARRAYS: dict[str, tuple[int, ...]] = {
    "force_fill_sigma": (3,), "rate_fill_sigma": (3,), "partial_force": (2, 3), "partial_rate": (2, 3),
}  # fmt: skip


@dataclass(frozen=True)
class ImuRecord:
    """Samples of one IMU, or of several IMUs joined in time, in body axes.

    Attributes
    ----------
    name : str
        Name of the record in results and messages.
    time : (N,) array
        End of each sample's interval, s since the epoch, strictly increasing.
    interval : (N,) array
        Length of each interval, s. Intervals adjoin: ``time[i] - interval[i] == time[i - 1]``. A gap in the
        telemetry is therefore one or more samples whose values are unknown or reconstructed.
    specific_force, angular_rate : (N, 3) arrays
        Means over the interval, m/s² and rad/s, body axes. NaN in a gap that was not filled.
    position : (N, 3) array
        Position of the accelerometers relative to the centre of mass, m, body axes; zero where the specific force
        was already transferred to the centre of mass.
    force_noise, rate_noise : (N,) arrays
        One sigma of one sample, m/s² and rad/s.
    shared_rate_noise : (N,) array
        The part of `rate_noise` that an attitude computed on board from the same gyros has in common, rad/s.
    coning_corrected : (N,) boolean array
        True where `angular_rate` is the net rotation over the interval (from two attitudes) divided by the interval,
        and not the mean of the gyros' rate: it includes the coning correction.
    sculling_corrected : (N,) boolean array
        True where `specific_force` is the velocity increment in the axes of mid-interval (from an inertial register)
        divided by the interval, and not the mean of the accelerometers' readings: it includes the sculling correction.
    unit : (N,) integer array
        Index into `units`: the instrument that took the sample. The sensor errors depend on it.
    units : tuple of str
    source : (N,) integer array
        Index into `sources`: the product that the sample was read from.
    sources : tuple of str
    errors : tuple of SensorErrors
        One-sigma sizes of the constant errors, one entry for each of `units`.
    force_fill_sigma, rate_fill_sigma : (N, 3) arrays, optional
        One sigma by which a value that was filled in may be wrong beyond `force_noise` and `rate_noise`, m/s² and
        rad/s, body axes; zero where the instrument was read (a force that was read while rates are lost has the sigma
        of the velocity change by tilt). The errors of a filled stretch are correlated in time: these are the sigmas of
        independent errors whose sum over the stretch has the variance of the correlated ones.
    stated_interval : float, optional
        Sampling interval that the telemetry states besides the times, s; NaN if there is none.
    partial_force, partial_rate : (N, 2, 3) arrays, optional
        Of a triad of which one axis is lost: the readings of the other two axes as a vector, m/s² or rad/s, and the
        unit vector of the lost axis, both in body axes; zeros elsewhere. `specific_force` or `angular_rate` is NaN
        there until it is filled.
    """

    name: str
    time: Array
    interval: Array
    specific_force: Array
    angular_rate: Array
    position: Array
    force_noise: Array
    rate_noise: Array
    shared_rate_noise: Array
    coning_corrected: BoolArray
    sculling_corrected: BoolArray
    unit: IntArray
    units: tuple[str, ...]
    source: IntArray
    sources: tuple[str, ...]
    errors: tuple[SensorErrors, ...]
    force_fill_sigma: Array = field(default_factory=lambda: np.zeros((0, 3)))
    rate_fill_sigma: Array = field(default_factory=lambda: np.zeros((0, 3)))
    stated_interval: float = np.nan
    partial_force: Array = field(default_factory=lambda: np.zeros((0, 2, 3)))
    partial_rate: Array = field(default_factory=lambda: np.zeros((0, 2, 3)))

    def __post_init__(self) -> None:
        n = len(self.time)
        for key, shape in _OPTIONAL_ARRAYS.items():
            if not len(getattr(self, key)):
                object.__setattr__(self, key, np.zeros((n, *shape)))
        if n < 2:
            raise InputError(f"IMU '{self.name}': {n} samples; at least 2 are needed.")
        for key in (
            "interval", "force_noise", "rate_noise", "shared_rate_noise", "coning_corrected",
            "sculling_corrected", "unit", "source",
        ):  # fmt: skip
            if getattr(self, key).shape != (n,):
                raise InputError(f"IMU '{self.name}': {key} has shape {getattr(self, key).shape}, not ({n},).")
        vectors: dict[str, tuple[int, ...]] = dict.fromkeys(("specific_force", "angular_rate", "position"), (3,))
        for key, shape in {**vectors, **_OPTIONAL_ARRAYS}.items():
            if getattr(self, key).shape != (n, *shape):
                raise InputError(
                    f"IMU '{self.name}': {key} has shape {getattr(self, key).shape}, not "
                    f"({n}, {', '.join(str(size) for size in shape)})."
                )
        if np.any(self.shared_rate_noise > self.rate_noise):
            raise InputError(f"IMU '{self.name}': shared_rate_noise is a part of rate_noise and cannot exceed it.")
        step = np.diff(self.time)
        if not np.all(step > 0.0):  # also catches NaN
            i = int(np.flatnonzero(~(step > 0.0))[0])
            raise InputError(
                f"IMU '{self.name}': time must increase, but sample {i + 1} at {self.time[i + 1]:.6g} s follows "
                f"{self.time[i]:.6g} s."
            )

    def __len__(self) -> int:
        return len(self.time)

    @property
    def start(self) -> float:
        """Start of the first interval, s."""
        return float(self.time[0] - self.interval[0])

    @property
    def edges(self) -> Array:
        """Edges ``(N + 1,)`` of the samples, s."""
        return sample_edges(self.time, self.interval)

    @property
    def middle(self) -> Array:
        """Middle ``(N,)`` of each sample's interval, s."""
        return self.time - 0.5 * self.interval

    @property
    def complete(self) -> BoolArray:
        """Samples ``(N,)`` of which all values are finite."""
        return finite_rows(self.specific_force) & finite_rows(self.angular_rate)

    @property
    def filled(self) -> BoolArray:
        """Samples ``(N,)`` of which a value was filled in."""
        return filled_samples(self.force_fill_sigma, self.rate_fill_sigma)

    def index_at(self, time: Array) -> IntArray:
        """Index ``(M,)`` of the sample whose interval contains each time ``(M,)``, s; the nearest one outside."""
        return np.minimum(np.searchsorted(self.time, time, side="left"), len(self) - 1)

    def between(self, start: float, end: float) -> ImuRecord:
        """Samples whose interval lies within `start` to `end`, s (`within_window`)."""
        return self.select(within_window(self.time, self.interval, start, end))

    def select(self, selected: BoolArray) -> ImuRecord:
        """Samples where the boolean array `selected` (N,) is true."""
        names = (
            "time", "interval", "specific_force", "angular_rate", "position", "force_noise", "rate_noise",
            "shared_rate_noise", "coning_corrected", "sculling_corrected", "unit", "source", *_OPTIONAL_ARRAYS,
        )  # fmt: skip
        return replace(self, **{name: getattr(self, name)[selected] for name in names})


@dataclass(frozen=True)
class SampleFinding:
    """Samples of an IMU that are missing or bad, and what was done about them.

    Attributes
    ----------
    imu : str
        Name of the record, or ``altimeter``.
    channel : str
        ``force`` or ``rate``, with an axis of the IMU (``force x``); ``all``: both triads; ``height`` of the altimeter.
    start, end : float
        From the first sample's beginning to the last one's end, s since the epoch.
    samples : int
        Number of samples.
    kind : str
        One of `KINDS`.
    repair : str
        What was done, one phrase.
    interpolated : tuple of (float, float)
        Parts that no other IMU covers, from start to end, s: filled from their neighbours.
    limit : tuple of three floats, optional
        Of a saturated axis whose reading is the farthest from zero, or its counterpart on the other side of a symmetric
        range: this reading times the axis, m/s² or rad/s, body axes.
    clock_sigma : float
        One sigma by which all times that are used may be late or early after the repair, s.
    """

    imu: str
    channel: str
    start: float
    end: float
    samples: int
    kind: str
    repair: str = ""
    interpolated: tuple[tuple[float, float], ...] = ()
    limit: tuple[float, float, float] | None = None
    clock_sigma: float = 0.0


#: Kinds of findings, with their names for people.
KINDS = {
    "missing": "missing samples",
    "not_finite": "values that are not finite",
    "out_of_range": "values beyond the limits of an instrument",
    "all_zero": "packets of zeros",
    "stuck": "stuck axis",
    "saturated": "saturated axis",
    "spike": "spike",
    "burst": "burst",
    "noise": "noise beyond the stated",
    "duplicated": "duplicated packets",
    "reordered": "packets out of order",
    "clock_jump": "jump of the clock",
    "clock_drift": "clock at a wrong rate",
    "jitter": "time stamps that scatter",
    "coarse": "readings in coarse steps",
    "dead": "IMU ends before the other",
    "disagreement": "disagreement of two IMUs beyond constant errors",
    "delay": "force and rate that are late by different times",
    "rest_drift": "force at rest that is not constant",
}


@dataclass(frozen=True)
class AttitudeRecord:
    """Attitude computed on board.

    Attributes
    ----------
    time : (N,) array
        s since the epoch, strictly increasing.
    inertial_from_body : (N, 4) array
        Unit quaternions, scalar last.
    sigma : (N,) array
        One sigma of one sample about each axis, rad, without the error that all samples have in common (that of the
        record's reference frame).
    unit : (N,) integer array
        Index into `units`: the instrument from whose gyros the attitude was computed.
    units : tuple of str
    """

    time: Array
    inertial_from_body: Array
    sigma: Array
    unit: IntArray
    units: tuple[str, ...]

    def at(self, time: float) -> Array:
        """Attitude at one time, interpolated at constant rate between the two samples around it.

        Parameters
        ----------
        time : float
            s since the epoch.

        Returns
        -------
        (4,) array
            Unit quaternion ``inertial_from_body``.

        Raises
        ------
        InputError
            `time` is outside the record.
        """
        if not self.time[0] <= time <= self.time[-1]:
            raise InputError(
                f"On-board attitude is wanted at {time:g} s; telemetry has it from {self.time[0]:g} to "
                f"{self.time[-1]:g} s."
            )
        k = min(int(np.searchsorted(self.time, time, side="right")), len(self.time) - 1)
        before, after = self.inertial_from_body[k - 1], self.inertial_from_body[k]
        rotation_vector = rotations.rotation_vector_between(before, after)
        fraction = (time - self.time[k - 1]) / (self.time[k] - self.time[k - 1])
        return rotations.multiply(before, rotations.from_rotation_vector(fraction * rotation_vector))


@dataclass(frozen=True)
class AltimeterRecord:
    """Radar altimeter: heights above a sphere about the planet's centre.

    Attributes
    ----------
    time : (N,) array
        s since the epoch.
    height : (N,) array
        m.
    sigma : float
        One sigma of one height, m.
    surface_radius : float
        Radius of the sphere, m.
    """

    time: Array
    height: Array
    sigma: float
    surface_radius: float


@dataclass(frozen=True)
class InitialState:
    """Inertial state at one time, with its covariance.

    Attributes
    ----------
    time : float
        s since the epoch.
    position, velocity : (3,) arrays
        Inertial, m and m/s.
    inertial_from_body : (4,) array
        Unit quaternion, scalar last.
    covariance : (9, 9) array
        Of position (m), velocity (m/s) and attitude error (rad, body axes, ``stated = true ⊗ exp(error)``).
    """

    time: float
    position: Array
    velocity: Array
    inertial_from_body: Array
    covariance: Array


@dataclass(frozen=True)
class LandingFix:
    """Position at rest after the landing.

    Attributes
    ----------
    time : float
        s since the epoch; the vehicle is at rest from then on.
    position, position_sigma : (3,) arrays
        Planet-fixed position and one sigma per axis, m.
    """

    time: float
    position: Array
    position_sigma: Array


@dataclass(frozen=True)
class ParachuteFix:
    """Dynamic pressure at parachute deployment, with one sigma: s since the epoch, Pa."""

    time: float
    dynamic_pressure: float
    dynamic_pressure_sigma: float


@dataclass(frozen=True)
class Telemetry:
    """All measurements of one entry, and the other statements about it that came with them.

    Attributes
    ----------
    driving : ImuRecord
        The record that drives the propagation.
    checking : tuple of ImuRecord
        Records of the other IMUs, for comparison.
    attitude : AttitudeRecord or None
    altimeter : AltimeterRecord or None
    initial : InitialState or None
    landing : LandingFix or None
    parachute : ParachuteFix or None
    events : dict
        Name → time, s since the epoch.
    event_sigmas : dict
        Name → one sigma of the time, s, where the telemetry states it.
    epoch_utc : str
        ISO 8601 of time 0.
    epoch_sclk : float or None
        Spacecraft clock at time 0, s, where there is one.
    prime_meridian_at_epoch : float or None
        Angle from the inertial x axis to the prime meridian at time 0, rad, where the telemetry states it.
    files : dict
        Name within its folder or volume → sha256 of the files that were read.
    notes : tuple of str
        Steps of the cleaning, one sentence each, for the report.
    planet : str
        Name of the planet in the telemetry; empty if there is none.
    findings : tuple of SampleFinding
        Missing and bad samples of all IMUs.
    rest_force_sigma : tuple of (float, float)
        One sigma by which the mean specific force at rest may be wrong since it is not constant, along and across
        itself, m/s² (`rest_drift`).
    as_read : Telemetry or None
        The telemetry before the comparison of its IMUs and the repair of its samples; None where it is the same.
    """

    driving: ImuRecord
    checking: tuple[ImuRecord, ...] = ()
    attitude: AttitudeRecord | None = None
    altimeter: AltimeterRecord | None = None
    initial: InitialState | None = None
    landing: LandingFix | None = None
    parachute: ParachuteFix | None = None
    events: dict[str, float] = field(default_factory=dict)
    event_sigmas: dict[str, float] = field(default_factory=dict)
    epoch_utc: str = ""
    epoch_sclk: float | None = None
    prime_meridian_at_epoch: float | None = None
    files: dict[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    planet: str = ""
    findings: tuple[SampleFinding, ...] = ()
    rest_force_sigma: tuple[float, float] = (0.0, 0.0)
    as_read: Telemetry | None = None
