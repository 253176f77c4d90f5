"""A flight over the Earth through pyins and through this package: strapdown integration, and a filter with 15 states.

pyins integrates in local axes over the WGS84 ellipsoid with its normal gravity; the package integrates in inertial
axes with the planet's point mass and J2, here those of WGS84. The fields differ by J4 and above, 2e-5 m/s²; nothing
else differs in the model. pyins' simulation writes the increments.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd
from pyins import earth, filters, inertial_sensor, measurements, sim, strapdown, transform
from scipy.spatial.transform import Rotation

from edl_filter import rotations
from edl_filter.imu_model.sensor_errors import SensorErrors
from edl_filter.navigation import strapdown as our_strapdown
from edl_filter.navigation.constraints import LandingSite
from edl_filter.navigation.filter import Problem, Settings, build_problem, run_filter
from edl_filter.navigation.increments import Samples, effective_samples
from edl_filter.navigation.initial import EntryErrors
from edl_filter.planet import Planet
from edl_filter.telemetry.record import ImuRecord, InitialState
from edl_filter.types import Array

EARTH = Planet("earth", 3.986004418e14, 1.08262982e-3, earth.A, earth.A, 1.0 - np.sqrt(1.0 - earth.E2), earth.RATE, 0.0)
POSITION_SIGMA, VELOCITY_SIGMA, ATTITUDE_SIGMA = 5.0, 0.3, np.radians(0.2)
BIAS_SIGMAS = {"accelerometer": 0.02, "gyro": 2e-4}  # m/s², rad/s
NOISES = {"accelerometer": 2e-3, "gyro": 2e-5}  # m/s²/√Hz, rad/s/√Hz
FIX_SIGMA, FIX_INTERVAL = 2.0, 1.0
INTERVAL = 0.01


@dataclass(frozen=True)
class Flight:
    """Increments of a turning, climbing vehicle, and its true trajectory in pyins' form."""

    truth: pd.DataFrame
    imu: pd.DataFrame

    @property
    def time(self) -> Array:
        """Edges of the samples, s."""
        return np.asarray(self.imu.index, float)


def flight(duration: float) -> Flight:
    """Simulate by pyins, without errors."""
    time = np.arange(0.0, duration + 0.5 * INTERVAL, INTERVAL)
    roll, pitch = 20.0 * np.sin(0.2 * time), 5.0 + 5.0 * np.sin(0.13 * time)
    heading = 40.0 + 2.0 * time
    north, east = 200.0 * np.cos(np.radians(heading)), 200.0 * np.sin(np.radians(heading))
    velocity = np.stack([north, east, -20.0 * np.sin(0.13 * time)], axis=1)
    truth, imu = sim.generate_imu(
        time, [45.0, 12.0, 3000.0], np.stack([roll, pitch, heading], axis=1), velocity, sensor_type="increment"
    )
    return Flight(truth, imu)


def inertial_states(trajectory: pd.DataFrame) -> Array:
    """pyins' position, velocity and attitude as ours, ``(N, 10)``: inertial axes are those of the Earth at time 0."""
    time = np.asarray(trajectory.index, float)
    lla = trajectory[["lat", "lon", "alt"]].to_numpy(float, copy=True)
    lla[:, 1] += np.degrees(earth.RATE) * time
    axes = transform.mat_en_from_ll(lla[:, 0], lla[:, 1])
    position = transform.lla_to_ecef(lla)
    velocity = np.einsum("nij,nj->ni", axes, trajectory[["VN", "VE", "VD"]].to_numpy(float))
    velocity += np.cross([0.0, 0.0, earth.RATE], position)
    body = axes @ transform.mat_from_rph(trajectory[["roll", "pitch", "heading"]].to_numpy(float))
    return np.concatenate((position, velocity, Rotation.from_matrix(body).as_quat()), axis=1)


def samples(given: Flight) -> Samples:
    """Our samples from the increments; noise of the stated intensities."""
    values = given.imu.to_numpy(float)[1:] / INTERVAL
    n = len(values)
    full, none = np.ones(n), np.zeros(n, bool)
    record = ImuRecord(
        name="pyins",
        time=given.time[1:],
        interval=np.diff(given.time),
        specific_force=values[:, 3:],
        angular_rate=values[:, :3],
        position=np.zeros((n, 3)),
        force_noise=0.0 * full,
        rate_noise=0.0 * full,
        shared_rate_noise=0.0 * full,
        coning_corrected=none,
        sculling_corrected=none,
        unit=np.zeros(n, int),
        units=("imu",),
        source=np.zeros(n, int),
        sources=("pyins",),
        errors=(sensor_errors(),),
    )
    root = np.sqrt(INTERVAL)
    return replace(
        effective_samples(record),
        force_noise=NOISES["accelerometer"] / root * full,
        rate_noise=NOISES["gyro"] / root * full,
    )


def sensor_errors() -> SensorErrors:
    """Sigmas of the biases."""
    return SensorErrors(accelerometer_bias=BIAS_SIGMAS["accelerometer"], gyro_bias=BIAS_SIGMAS["gyro"])


def integrated(given: Flight) -> tuple[Callable[[], Any], Callable[[], Array]]:
    """Strapdown integration of all samples: pyins' trajectory, and our last state ``(10,)``."""

    def theirs() -> Any:
        increments = strapdown.compute_increments_from_imu(given.imu, "increment")
        return strapdown.Integrator(given.truth.iloc[0]).integrate(increments)

    def ours() -> Array:
        s, columns = samples(given), our_strapdown.LANES
        state = np.repeat(inertial_states(given.truth.iloc[:1]).T, columns, axis=1)
        force_map, rate_map = np.zeros((12, columns)), np.zeros((6, columns))
        force_map[[0, 4, 8]], rate_map[:3] = 1.0, 1.0
        our_strapdown.propagate(
            state, force_map, rate_map, s.interval, s.force, s.rate, EARTH.mu, EARTH.j2, EARTH.gravity_radius
        )
        return state[:, 0]

    return theirs, ours


def bare_integration(given: Flight) -> tuple[Callable[[], Any], Callable[[], None]]:
    """Integration of prepared increments: pyins' of one state, and ours of a block of states."""
    increments, s, columns = (
        strapdown.compute_increments_from_imu(given.imu, "increment"),
        samples(given),
        our_strapdown.LANES,
    )
    start = np.repeat(inertial_states(given.truth.iloc[:1]).T, columns, axis=1)
    force_map, rate_map = np.zeros((12, columns)), np.zeros((6, columns))
    force_map[[0, 4, 8]], rate_map[:3] = 1.0, 1.0
    return (
        lambda: strapdown.Integrator(given.truth.iloc[0]).integrate(increments),
        lambda: our_strapdown.propagate(
            start.copy(), force_map, rate_map, s.interval, s.force, s.rate, EARTH.mu, EARTH.j2, EARTH.gravity_radius
        ),
    )


def measured(given: Flight, seed: int = 0) -> tuple[Flight, pd.Series, Array, Array]:
    """The flight with errors: readings, stated initial state, times and positions (ECEF) of the fixes."""
    rng = np.random.default_rng(seed)
    imu = given.imu.copy()
    for columns, name in (
        (["gyro_x", "gyro_y", "gyro_z"], "gyro"),
        (["accel_x", "accel_y", "accel_z"], "accelerometer"),
    ):
        noise = NOISES[name] * np.sqrt(INTERVAL) * rng.standard_normal((len(imu), 3))
        imu[columns] += BIAS_SIGMAS[name] * INTERVAL * rng.standard_normal(3) + noise
    degrees = np.degrees(ATTITUDE_SIGMA)
    error = sim.generate_pva_error(POSITION_SIGMA, VELOCITY_SIGMA, degrees, degrees, np.random.RandomState(seed))
    initial = sim.perturb_pva(given.truth.iloc[0], error)
    each = round(FIX_INTERVAL / INTERVAL)
    rows = given.truth.iloc[each:-1:each]  # pyins does not use a fix at the last sample
    fixes = transform.lla_to_ecef(rows[["lat", "lon", "alt"]].to_numpy(float))
    fixes = fixes + FIX_SIGMA * rng.standard_normal(fixes.shape)
    return Flight(given.truth, imu), initial, np.asarray(rows.index, float), fixes


def their_filter(
    given: Flight, initial: pd.Series, times: Array, fixes: Array, time_step: float = 0.1
) -> Callable[[], Any]:
    """pyins' feedback filter."""
    planet = EARTH.geodetic_from_fixed(fixes)
    lla = np.stack([np.degrees(planet[0]), np.degrees(planet[1]), planet[2]], axis=1)
    positions = measurements.Position(pd.DataFrame(lla, index=times, columns=["lat", "lon", "alt"]), FIX_SIGMA)

    def run() -> Any:
        increments = strapdown.compute_increments_from_imu(given.imu, "increment")
        return filters.run_feedback_filter(
            initial,
            POSITION_SIGMA,
            VELOCITY_SIGMA,
            np.degrees(ATTITUDE_SIGMA),
            np.degrees(ATTITUDE_SIGMA),
            increments,
            inertial_sensor.EstimationModel(bias_sd=BIAS_SIGMAS["gyro"], noise=NOISES["gyro"]),
            inertial_sensor.EstimationModel(bias_sd=BIAS_SIGMAS["accelerometer"], noise=NOISES["accelerometer"]),
            [positions],
            time_step,
        )

    return run


def our_problem(given: Flight, initial: pd.Series, times: Array, fixes: Array, method: Any) -> Problem:
    """The same as a problem of ours."""
    nav = inertial_states(initial.to_frame().T.set_index(pd.Index([0.0])))[0]
    covariance = np.diag(np.repeat([POSITION_SIGMA, VELOCITY_SIGMA, ATTITUDE_SIGMA], 3) ** 2)
    start = InitialState(0.0, nav[:3], nav[3:6], nav[6:], covariance)
    noise = FIX_SIGMA**2 * np.eye(3)
    constraints = [LandingSite(float(t), p, noise, EARTH) for t, p in zip(times, fixes, strict=True)]
    settings = Settings(longest_interval=FIX_INTERVAL, gate_probability=1.0, method=method)
    return build_problem(samples(given), start, EntryErrors(), (sensor_errors(),), constraints, EARTH, settings)


def our_filter(given: Flight, initial: pd.Series, times: Array, fixes: Array, method: Any) -> Callable[[], Any]:
    """Our filter from the increments on."""
    return lambda: run_filter(our_problem(given, initial, times, fixes, method))


def difference_in_sigmas(theirs: Any, ours: Any) -> float:
    """Largest difference of the last position, velocity and attitude in sigmas of ours."""
    node = ours.nodes[-1]
    them = inertial_states(theirs.trajectory.iloc[-1:])[0]
    turn = rotations.multiply(rotations.conjugate(node.state.nav[6:]), them[6:])
    delta = np.concatenate((them[:6] - node.state.nav[:6], rotations.to_rotation_vector(turn)))
    return float(np.max(np.abs(delta) / np.sqrt(np.diag(node.covariance))[:9]))
