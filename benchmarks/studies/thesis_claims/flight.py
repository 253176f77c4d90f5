"""One rover's flight with all that the statements need: the post-flight layer with the thesis's gas, and helpers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from edl_filter import rotations
from edl_filter.mission import Mission
from edl_filter.pipeline.reconstruct import Reconstruction, reconstruct
from edl_filter.planet import ellipsoid
from edl_filter.planet.gas import Gas
from edl_filter.postflight.airdata import air_data
from edl_filter.postflight.averages import Difference
from edl_filter.postflight.derive import PostflightResult, derive
from edl_filter.postflight.flight import postflight_inputs
from edl_filter.postflight.inputs import PostflightInputs
from edl_filter.telemetry.calibration import MisalignmentEstimate, compare
from edl_filter.telemetry.mer_segments import to_body
from edl_filter.telemetry.record import ImuRecord
from edl_filter.types import Array, BoolArray

#: Gas of the thesis (nomenclature), the default: CO2, ratio of specific heats 1.3, hard spheres of 4.64e-10 m.
THESIS_GAS = Gas()
#: Points of the thesis's batches, and the sampling interval of HIGHRATE, s.
BATCH, HIGHRATE_STEP = 7, 0.125
#: Beginning of HIGHRATE, s after entry, as the thesis has it.
HIGHRATE_START = 90.0
#: Constraints without which a flight is dead-reckoned from entry state and on-board attitude.
DEAD_RECKONING = (
    "constraints.landing.use=false",
    *(f"constraints.{c}=null" for c in ("pre_entry_zero_force", "parachute", "steady_descent", "rest")),
)


@dataclass(frozen=True)
class Arrival:
    """State at one event, from the landing site.

    Attributes
    ----------
    east, north, up : float
        Position from the site, m.
    horizontal : float
        Horizontal speed relative to the ground, m/s.
    speed : float
        Speed relative to the ground, m/s.
    """

    east: float
    north: float
    up: float
    horizontal: float
    speed: float


class ClaimFlight:
    """A reconstructed rover, its post-flight layer with the thesis's gas, and quantities of several statements."""

    def __init__(self, reconstruction: Reconstruction) -> None:
        stated = reconstruction.atmosphere  # its temperatures are those of the mission's gas at the table's pressure
        temperature = stated.temperature * stated.gas.constant / THESIS_GAS.constant
        reconstruction = replace(reconstruction, atmosphere=replace(stated, gas=THESIS_GAS, temperature=temperature))
        self.reconstruction = reconstruction
        self.trajectory = reconstruction.trajectory
        self.mission = reconstruction.mission
        self.air = air_data(self.trajectory, reconstruction.planet, reconstruction.atmosphere)
        inputs = postflight_inputs(reconstruction, self.air)
        self.post: PostflightResult = derive(inputs)
        self.inputs: PostflightInputs = inputs.until_parachute()
        self.time = self.post.time
        self.mach = self.post.flight.atmosphere.mach
        self.alpha_total = np.degrees(self.post.alpha_total)

    # times and windows

    @property
    def epoch_sigma(self) -> float:
        """One sigma of the time of entry interface on the spacecraft's clock, s."""
        return self.mission.initial_state.epoch_sigma_s

    def event(self, name: str) -> float:
        """Time of an event, s."""
        return self.reconstruction.event_times[name]

    @property
    def parachute(self) -> float:
        """s."""
        return self.event("parachute_deploy")

    def mach_time(self, mach: float) -> tuple[float, float]:
        """Last time at which the Mach number is above a value, s, and its sigma."""
        atmosphere = self.post.flight.atmosphere
        k = int(np.flatnonzero(atmosphere.mach > mach)[-1])
        slope = np.gradient(atmosphere.mach, self.time)[k]
        relative = np.hypot(
            self.inputs.speed_sigma[k] / self.inputs.speed[k],
            0.5 * atmosphere.temperature_sigma[k] / atmosphere.temperature[k],
        )
        fraction = (atmosphere.mach[k] - mach) / (atmosphere.mach[k] - atmosphere.mach[k + 1])
        time = self.time[k] + fraction * (self.time[k + 1] - self.time[k])
        return float(time), float(np.hypot(self.epoch_sigma, mach * relative / slope))

    @property
    def mach_25(self) -> float:
        """s."""
        return self.mach_time(25.0)[0]

    @property
    def mach_15(self) -> float:
        """s."""
        return self.mach_time(15.0)[0]

    @property
    def mach_5(self) -> float:
        """s."""
        return self.mach_time(5.0)[0]

    @property
    def start(self) -> float:
        """Start of the thesis's comparison of coefficients, 50 s."""
        return 50.0

    @property
    def end(self) -> float:
        """Last time before the mortar's recoil, s."""
        return self.post.domain.end

    def between(self, start: float, end: float) -> BoolArray:
        """Mask of the samples of the post-flight layer between two times, s."""
        return (self.time >= start) & (self.time <= end)

    # averages

    def mean(
        self, values: Array, inside: BoolArray, noise: Array | float = 0.0, systematic: Array | float = 0.0
    ) -> tuple[float, float]:
        """Mean over samples with its sigma: noise averaged over batches, and errors common to the flight."""
        points = self.post.motion.smoother.points
        noise, systematic = (np.broadcast_to(x, values.shape) for x in (noise, systematic))
        use = inside & np.isfinite(values) & np.isfinite(noise) & np.isfinite(systematic)
        batches = max(1.0, float(np.sum(1.0 / points[use])))
        random = np.sqrt(np.mean(noise[use] ** 2) / batches)
        return float(values[use].mean()), float(np.hypot(random, np.mean(systematic[use])))

    def mean_coefficient(self, name: str, start: float, end: float) -> tuple[float, float]:
        """Mean of a flight coefficient between two times, and its sigma."""
        c = self.post.flight.coefficients
        return self.mean(c.value[name], self.between(start, end), c.noise[name], c.systematic[name])

    def differences(self, pairs: Sequence[str], coefficients: Sequence[str]) -> list[Difference]:
        """Averages over the four windows, of some pairs of methods and some coefficients."""
        return [d for d in self.post.flight.differences if d.pair in pairs and d.coefficient in coefficients]

    def rms(self, values: Array, inside: BoolArray) -> float:
        """Root mean square over samples where the values are finite."""
        return float(np.sqrt(np.nanmean(values[inside] ** 2)))

    def amplitude(self, case: str, first: str, second: str) -> Array:
        """Magnitude ``(N,)`` of a pair of coefficients: of the ``database``, the ``flight`` or the ``combination``."""
        p = self.post.flight
        value = {
            "database": p.database_measured.value,
            "flight": p.coefficients.value,
            "combination": (p.moments if first == "CN" else p.forces).value,
        }[case]
        return np.hypot(value[first], value[second])

    # telemetry

    def batch_rates(self, record: ImuRecord, start: float, end: float) -> tuple[Array, Array, Array]:
        """Times, unfiltered rates and rates filtered by the thesis's batches of one IMU.

        The rates are the angle increments over a constant 0.125 s, as the archive has them: a sample that sums 51
        increments of 2.5 ms has a rate that is too large by 2 %.
        """
        from edl_filter.telemetry.smoothing import batch_polynomial

        part = record.between(start, end)
        sampled = np.abs(part.interval - HIGHRATE_STEP) < 0.01
        time = (part.time - 0.5 * part.interval)[sampled]
        rate = (part.angular_rate * part.interval[:, None] / HIGHRATE_STEP)[sampled]
        return time, rate, np.asarray(batch_polynomial(time, rate, BATCH))

    @property
    def rover_imu(self) -> ImuRecord:
        """The rover's IMU, up to separation."""
        return next(r for r in self.reconstruction.telemetry.checking if r.name == "rover")

    @cached_property
    def mounting_comparison(self) -> MisalignmentEstimate:
        """Projection of the axial force with the rover's IMU in the axes of its mounting alone.

        The mission's `alignment_deg` is this project's estimate of the difference of the two mountings. The thesis
        corrects accelerations that do not have it.
        """
        rotation = rotations.from_rotation_vector(-to_body(self.mission.telemetry.imus["rover"].alignment))
        rover = replace(
            self.rover_imu,
            specific_force=rotations.rotate(rotation, self.rover_imu.specific_force),
            angular_rate=rotations.rotate(rotation, self.rover_imu.angular_rate),
        )
        estimate = compare(self.reconstruction.telemetry.driving, rover, self.parachute)
        assert estimate is not None
        return estimate

    @cached_property
    def roll(self) -> tuple[Array, Array]:
        """Times (s) and smoothed roll rate (rad/s) up to the parachute."""
        return self.time, self.post.motion.rate[:, 0]

    def mean_roll_acceleration(self, length: float, start: float, end: float) -> tuple[Array, Array]:
        """Middles of windows of a length (s) and the mean roll acceleration in each, rad/s²."""
        time, rate = self.roll
        middle = np.arange(start + 0.5 * length, end - 0.5 * length, 0.25)
        edges = (np.interp(middle + s * 0.5 * length, time, rate) for s in (1.0, -1.0))
        return middle, np.subtract(*edges) / length

    # dead reckoning

    @cached_property
    def dead_reckoned(self) -> Reconstruction:
        """The flight from its stated entry state and the on-board attitude alone."""
        mission = self.mission
        path = getattr(mission.telemetry, "path", None)
        changes = DEAD_RECKONING if path is None else (f"telemetry.path={path}", *DEAD_RECKONING)
        changed = Mission.load(mission.source, changes)
        return reconstruct(changed, leave_one_out=False)

    def turned(self, angle_deg: float, event: str) -> Arrival:
        """State at an event of the dead-reckoned flight with its attitude turned about the line to the Sun.

        The specific force of the dead-reckoned flight is rotated in inertial axes and integrated again, with the
        gravity along the new path.
        """
        flight = self.dead_reckoned
        to_inertial = rotations.conjugate(rotations.from_matrix(self.mission.planet.j2000_from_inertial_matrix))
        sun = rotations.rotate(to_inertial, np.asarray(self.mission.initial_state.sun_direction))
        turn = rotations.from_rotation_vector(np.radians(angle_deg) * sun)
        t = flight.trajectory
        half = rotations.from_rotation_vector(-0.5 * t.angular_rate[1:] * np.diff(t.time)[:, None])
        middle = rotations.multiply(t.inertial_from_body[1:], half)
        force = rotations.rotate(turn, rotations.rotate(middle, t.specific_force[1:]))
        position, velocity = t.position[0].copy(), t.velocity[0].copy()
        stop = np.searchsorted(t.time, self.event(event) - 1e-6)
        for k in range(stop):
            step = t.time[k + 1] - t.time[k]
            before = force[k] + flight.planet.gravity(position)
            predicted = position + step * velocity + 0.5 * step**2 * before
            after = force[k] + flight.planet.gravity(predicted)
            position = position + step * velocity + step**2 / 6.0 * (2.0 * before + after)
            velocity = velocity + 0.5 * step * (before + after)
        return self.arrival(t.time[stop], position, velocity)

    def arrival(self, time: float, position: Array, velocity: Array) -> Arrival:
        """Position and velocity at a time, from the landing site."""
        site, planet = self.mission.constraints.landing, self.reconstruction.planet
        enu = ellipsoid.enu_from_fixed(site.latitude, site.longitude)
        place = enu @ (planet.rotation.to_fixed(time, position) - site.position)
        motion = enu @ planet.rotation.to_fixed(time, planet.velocity_relative(position, velocity))
        return Arrival(*map(float, place), float(np.hypot(*motion[:2])), float(np.linalg.norm(motion)))
