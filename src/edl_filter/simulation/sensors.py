"""Readings of an IMU of the true motion.

Means over each step of the integration have the order of the integrator, because the integrals of force, rate and
products of rates are integrated with the motion. At a position r from the centre of mass an accelerometer measures
``f + w' × r + w × (w × r)`` (thesis eq. 3.3), whose mean over a step is a difference of rates and a mean of products.
Sensor effects act on these means over steps, so that a delay is independent of the sampling; samples are averages of
them. Then the instrument's own errors are applied, ``f_m = (1 + s) ∘ (R(m) f) + b`` in body axes, noise in the
instrument's axes, and the quantisation of increments.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from edl_filter import rotations
from edl_filter.effects.base import EffectInstance
from edl_filter.effects.sensor_chain import apply_sensor_effects
from edl_filter.imu_model.lever_arm import lever_arm_acceleration_of_products
from edl_filter.imu_model.sensor_errors import SensorErrors, apply_errors
from edl_filter.simulation.motion import Motion
from edl_filter.telemetry.flight_file_writer import FlightImu
from edl_filter.types import Array


@dataclass(frozen=True)
class Instrument:
    """One IMU.

    Attributes
    ----------
    interval : float
        Sampling interval, s.
    body_from_imu : (4,) array
        Scalar last.
    position : (3,) array
        From the nominal centre of mass, m, body axes.
    accelerometer_noise, gyro_noise : float
        One sigma of a sample, m/s² and rad/s.
    sigmas : SensorErrors
        One sigma of the constant errors, which are drawn at random.
    velocity_quantum, angle_quantum : float
        Size of one count, m/s and rad; zero: no quantisation.
    gyro_delay : float
        Delay of the gyros' samples, s.
    """

    interval: float
    body_from_imu: Array
    position: Array
    accelerometer_noise: float
    gyro_noise: float
    sigmas: SensorErrors = field(default_factory=SensorErrors)
    velocity_quantum: float = 0.0
    angle_quantum: float = 0.0
    gyro_delay: float = 0.0


def step_means(motion: Motion, arm: Array) -> tuple[Array, Array]:
    """Mean specific force and mean rate over each step.

    Parameters
    ----------
    motion : Motion
        Of N steps.
    arm : (3,) or (N, 3) array
        Position of the accelerometers from the centre of mass, m, body axes; by step where events change it.

    Returns
    -------
    force, rate : (N, 3) arrays
        m/s² and rad/s, body axes.
    """
    h = np.diff(motion.time)[:, None]
    gained = np.diff(motion.state[:, 10:], axis=0) / h
    turning, force, rate = gained[:, :3], gained[:, 3:6], gained[:, 6:9]
    return force + lever_arm_acceleration_of_products(turning, gained[:, 9:], arm), rate


def delayed_rates(motion: Motion, delay: float) -> Array:
    """Mean rate ``(N, 3)``, rad/s, of the motion `delay` (s) before each of N steps; held constant at both ends."""
    edges = motion.time - delay
    inside = np.clip(edges, motion.time[0], motion.time[-1])
    integral = motion.at(inside)[:, 16:19]
    outside = (edges - inside)[:, None] * np.where(
        (edges > inside)[:, None], motion.after[-1, 16:19], motion.before[0, 16:19]
    )
    return np.diff(integral + outside, axis=0) / np.diff(motion.time)[:, None]


def true_means(
    motion: Motion, arm: Array, interval: float, delay: float, effects: Sequence[EffectInstance]
) -> tuple[Array, Array, Array]:
    """Samples of an IMU without errors of its own, with the effects in it.

    Parameters
    ----------
    motion : Motion
        The true motion.
    arm : (3,) or (N, 3) array
        By step: position of the accelerometers from the true centre of mass, m, body axes.
    interval, delay : float
        Sampling interval, and delay of the gyros, s.
    effects : sequence of EffectInstance
        Those in this IMU.

    Returns
    -------
    time : (N,) array
        Ends of the samples, s.
    force, rate : (N, 3) arrays
        m/s² and rad/s, body axes.
    """
    force, rate = step_means(motion, arm)
    if delay:
        rate = delayed_rates(motion, delay)
    force, rate = apply_sensor_effects(effects, motion.time[1:], force, rate)
    each = round(interval / float(motion.time[1] - motion.time[0]))
    count = len(force) // each
    force, rate = (x[: count * each].reshape(count, each, 3).mean(axis=1) for x in (force, rate))
    return motion.time[each::each][:count], force, rate


def draw_errors(random: np.random.Generator, sigmas: SensorErrors) -> dict[str, Array]:
    """Random constant errors of one instrument, by name (as in `SensorErrors`), ``(3,)`` each, body axes."""
    return {name: sigma * random.standard_normal(3) for name, sigma in vars(sigmas).items()}


def read(
    random: np.random.Generator,
    instrument: Instrument,
    errors: dict[str, Array],
    time: Array,
    force: Array,
    rate: Array,
) -> FlightImu:
    """Readings of an instrument, in its own axes.

    Parameters
    ----------
    random : Generator
        Source of the noise.
    instrument : Instrument
        Mounting, noise and quantisation.
    errors : dict
        Constant errors (`draw_errors`).
    time : (N,) array
        Ends of the samples, s.
    force, rate : (N, 3) arrays
        True means over the samples, m/s² and rad/s, body axes.

    Returns
    -------
    FlightImu
    """
    erroneous_force = apply_errors(
        force, errors["accelerometer_misalignment"], errors["accelerometer_scale"], errors["accelerometer_bias"]
    )
    erroneous_rate = apply_errors(rate, scale=errors["gyro_scale"], bias=errors["gyro_bias"])
    imu_from_body = rotations.conjugate(instrument.body_from_imu)
    noise = random.standard_normal((2, len(time), 3))
    force = rotations.rotate(imu_from_body, erroneous_force) + instrument.accelerometer_noise * noise[0]
    rate = rotations.rotate(imu_from_body, erroneous_rate) + instrument.gyro_noise * noise[1]
    return FlightImu(
        time=time,
        specific_force=counted(force, instrument.interval, instrument.velocity_quantum),
        angular_rate=counted(rate, instrument.interval, instrument.angle_quantum),
        sample_interval=instrument.interval,
        body_from_imu=instrument.body_from_imu,
        position=instrument.position,
        accelerometer_noise=instrument.accelerometer_noise,
        gyro_noise=instrument.gyro_noise,
        errors=instrument.sigmas,
    )


def counted(mean: Array, interval: float, quantum: float) -> Array:
    """Means whose increments are whole counts; the remainder of a sample is added to the next.

    Parameters
    ----------
    mean : (N, 3) array
        Means over the samples.
    interval : float
        s.
    quantum : float
        Size of one count, in the unit of `mean` times s; zero: no quantisation.

    Returns
    -------
    (N, 3) array
        In the unit of `mean`.
    """
    if quantum == 0.0:
        return mean
    counts = np.round(np.cumsum(mean * interval, axis=0) / quantum)
    return np.diff(counts, axis=0, prepend=0.0) * quantum / interval
