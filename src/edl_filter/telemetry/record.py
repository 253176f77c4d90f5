"""What every reader of telemetry gives: records of IMUs, attitude and altimeter in body axes.

The records know nothing of files or missions; all later stages know nothing but these records.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from edl_filter import rotations
from edl_filter.errors import InputError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SensorErrors:
    """One-sigma sizes of an IMU's constant errors, per body axis (zero: no such error).

    Applied in the order misalignment, scale, bias: ``f_m = (1 + s) ∘ (R(m) f) + b``.
    """

    accelerometer_bias: float = 0.0
    accelerometer_scale: float = 0.0
    accelerometer_misalignment: float = 0.0
    gyro_bias: float = 0.0
    gyro_scale: float = 0.0


@dataclass(frozen=True)
class ImuRecord:
    """Samples of an IMU, or of several joined, in body axes.

    Attributes
    ----------
    name : str
        What the record is called in results and messages.
    time : (N,) array
        End of each sample's interval, s since the epoch, strictly increasing.
    interval : (N,) array
        Length of each interval, s. Intervals adjoin: ``time[i] - interval[i] == time[i - 1]``, so that
        a gap in the telemetry is one long sample whose content is unknown or reconstructed.
    specific_force, angular_rate : (N, 3) arrays
        Means over the interval, m/s² and rad/s, body axes. NaN in a gap that nothing fills.
    position : (N, 3) array
        Where the accelerometers sit, m from the centre of mass, body axes; zero where the telemetry was
        moved to the centre of mass already.
    force_noise, rate_noise : (N,) arrays
        One sigma of one sample, m/s² and rad/s.
    shared_rate_noise : (N,) array
        The part of `rate_noise` that an attitude computed on board from the same gyros has too, rad/s.
    net_turn : (N,) boolean array
        Where `angular_rate` is the net turn over the interval (from two attitudes), not the mean of a gyro's rate:
        coning is in it already.
    net_gain : (N,) boolean array
        Where `specific_force` is the velocity gained in the axes of mid-interval (from an inertial register), not
        the mean of an accelerometer's reading: sculling is in it already.
    unit : (N,) integer array
        Index into `units`: the instrument that took the sample. The sensor errors change with it.
    units : tuple of str
    source : (N,) integer array
        Index into `sources`: the product the sample came from.
    sources : tuple of str
    errors : tuple of SensorErrors
        The constant errors' sigmas, one entry for each of `units`.
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
    net_turn: NDArray[np.bool_]
    net_gain: NDArray[np.bool_]
    unit: NDArray[np.int64]
    units: tuple[str, ...]
    source: NDArray[np.int64]
    sources: tuple[str, ...]
    errors: tuple[SensorErrors, ...]

    def __post_init__(self) -> None:
        n = len(self.time)
        if n < 2:
            raise InputError(f"IMU '{self.name}': {n} samples; at least 2 are needed.")
        for key in (
            "interval", "force_noise", "rate_noise", "shared_rate_noise", "net_turn", "net_gain", "unit", "source"
        ):  # fmt: skip
            if getattr(self, key).shape != (n,):
                raise InputError(f"IMU '{self.name}': {key} has shape {getattr(self, key).shape}, not ({n},).")
        for key in ("specific_force", "angular_rate", "position"):
            if getattr(self, key).shape != (n, 3):
                raise InputError(f"IMU '{self.name}': {key} has shape {getattr(self, key).shape}, not ({n}, 3).")
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
        """Beginning of the first interval, s."""
        return float(self.time[0] - self.interval[0])

    def between(self, start: float, end: float) -> ImuRecord:
        """Samples whose interval lies within ``(start, end]``, a microsecond allowed for rounding."""
        keep = (self.time - self.interval >= start - 1e-6) & (self.time <= end + 1e-6)
        return self.select(keep)

    def select(self, keep: NDArray[np.bool_]) -> ImuRecord:
        """The samples where `keep` is true."""
        names = (
            "time", "interval", "specific_force", "angular_rate", "position", "force_noise", "rate_noise",
            "shared_rate_noise", "net_turn", "net_gain", "unit", "source",
        )  # fmt: skip
        return replace(self, **{name: getattr(self, name)[keep] for name in names})


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
        One sigma of one sample about each axis, rad, apart from the error of the whole record's frame.
    unit : (N,) integer array
        Index into `units`: the instrument whose gyros carried it.
    units : tuple of str
    """

    time: Array
    inertial_from_body: Array
    sigma: Array
    unit: NDArray[np.int64]
    units: tuple[str, ...]

    def at(self, time: float) -> Array:
        """Attitude ``(4,)`` at `time`, turned evenly between its two neighbours.

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
        turn = rotations.to_rotation_vector(rotations.multiply(rotations.conjugate(before), after))
        share = (time - self.time[k - 1]) / (self.time[k] - self.time[k - 1])
        return rotations.multiply(before, rotations.from_rotation_vector(share * turn))


@dataclass(frozen=True)
class AltimeterRecord:
    """Heights above a sphere of radius `surface_radius` about the planet's centre, m, one sigma `sigma`."""

    time: Array
    height: Array
    sigma: float
    surface_radius: float


@dataclass(frozen=True)
class InitialState:
    """State at `time`: inertial position, velocity and attitude, with a 9 x 9 covariance.

    The covariance is of position (m), velocity (m/s) and attitude error (rad, body axes,
    ``stated = true ⊗ exp(error)``).
    """

    time: float
    position: Array
    velocity: Array
    inertial_from_body: Array
    covariance: Array


@dataclass(frozen=True)
class LandingFix:
    """Where the vehicle rests: planet-fixed position (m) with one sigma per axis, from `time` on."""

    time: float
    position: Array
    position_sigma: Array


@dataclass(frozen=True)
class ParachuteFix:
    """Dynamic pressure at parachute deployment, Pa, with one sigma."""

    time: float
    dynamic_pressure: float
    dynamic_pressure_sigma: float


@dataclass(frozen=True)
class Telemetry:
    """All that was measured or known about one entry.

    Attributes
    ----------
    driving : ImuRecord
        Drives the propagation.
    checking : tuple of ImuRecord
        The other IMUs, for comparison.
    attitude : AttitudeRecord or None
    altimeter : AltimeterRecord or None
    initial : InitialState or None
    landing : LandingFix or None
    parachute : ParachuteFix or None
    events : dict
        Name → time, s since the epoch.
    epoch_utc : str
        ISO 8601 of time 0.
    epoch_sclk : float or None
        Spacecraft clock at time 0, where there is one.
    prime_meridian_at_epoch : float or None
        Angle from the inertial x axis to the prime meridian at time 0, rad, where the telemetry says it.
    files : dict
        Name within its folder or volume → sha256 of what was read.
    notes : tuple of str
        What cleaning did, one sentence each, for the report.
    planet : str
        Name of the planet as the telemetry has it; empty where it does not say.
    """

    driving: ImuRecord
    checking: tuple[ImuRecord, ...] = ()
    attitude: AttitudeRecord | None = None
    altimeter: AltimeterRecord | None = None
    initial: InitialState | None = None
    landing: LandingFix | None = None
    parachute: ParachuteFix | None = None
    events: dict[str, float] = field(default_factory=dict)
    epoch_utc: str = ""
    epoch_sclk: float | None = None
    prime_meridian_at_epoch: float | None = None
    files: dict[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    planet: str = ""
