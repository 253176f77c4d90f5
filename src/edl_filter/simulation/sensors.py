"""What an IMU reads of the true motion.

Means over each step of the integration are exact to the integrator's order, for the integrals of force, rate and
products of rates are integrated with the motion. At a place r from the centre of mass an accelerometer feels
``f + w' × r + w × (w × r)`` (thesis eq. 3.3), whose mean over a step is a difference of rates and a mean of products.
Sensor effects act on these fine means, so that a delay is not seen through the sampling; samples are their averages.
Then come the instrument's own errors, ``f_m = (1 + s) ∘ (R(m) f) + b`` in body axes, noise in its own axes, and the
counting of increments.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from edl_filter import rotations
from edl_filter.effects.effect import Active
from edl_filter.simulation.motion import Motion
from edl_filter.telemetry.flight_file import FlightImu
from edl_filter.telemetry.record import SensorErrors

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Instrument:
    """One IMU.

    Attributes
    ----------
    interval : float
        Of sampling, s.
    body_from_imu : (4,) array
    position : (3,) array
        From the nominal centre of mass, m, body axes.
    accelerometer_noise, gyro_noise : float
        One sigma of a sample, m/s² and rad/s.
    sigmas : SensorErrors
        What its constant errors are drawn from.
    velocity_quantum, angle_quantum : float
        Size of one count, m/s and rad; zero: none.
    gyro_delay : float
        The gyros' samples are late by this, s.
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
    """Mean specific force ``(N, 3)`` at `arm` from the centre of mass, and mean rate, over each step, body axes."""
    h = np.diff(motion.time)[:, None]
    gained = np.diff(motion.state[:, 10:], axis=0) / h
    turning, force, rate = gained[:, :3], gained[:, 3:6], gained[:, 6:9]
    xx, yy, zz, xy, xz, yz = gained[:, 9:].T
    x, y, z = arm
    # w × (w × r) = w (w · r) - r w²
    centripetal = np.column_stack((
        -(yy + zz) * x + xy * y + xz * z, xy * x - (xx + zz) * y + yz * z, xz * x + yz * y - (xx + yy) * z
    ))  # fmt: skip
    return force + rotations.cross(turning, np.broadcast_to(arm, turning.shape)) + centripetal, rate


def delayed_rates(motion: Motion, delay: float) -> Array:
    """Mean rate over each step of what happened `delay` (s) earlier; outside the record it holds."""
    edges = motion.time - delay
    inside = np.clip(edges, motion.time[0], motion.time[-1])
    turned = motion.at(inside)[:, 16:19]
    beyond = (edges - inside)[:, None] * np.where(
        (edges > inside)[:, None], motion.after[-1, 16:19], motion.before[0, 16:19]
    )
    return np.diff(turned + beyond, axis=0) / np.diff(motion.time)[:, None]


def true_means(
    motion: Motion, arm: Array, interval: float, delay: float, effects: Sequence[Active]
) -> tuple[Array, Array, Array]:
    """What a faultless IMU would read, but for the effects in it: time ``(N,)``, force and rate ``(N, 3)``, body axes.

    Parameters
    ----------
    motion : Motion
    arm : (3,) array
        From the true centre of mass, m.
    interval, delay : float
        Of sampling, and of the gyros, s.
    effects : sequence of Active
        Those in this IMU, in the order in which they act.
    """
    force, rate = step_means(motion, arm)
    if delay:
        rate = delayed_rates(motion, delay)
    for a in effects:
        force, rate = a.effect.imu(a.values, motion.time[1:], force, rate)
    each = round(interval / float(motion.time[1] - motion.time[0]))
    count = len(force) // each
    force, rate = (x[: count * each].reshape(count, each, 3).mean(axis=1) for x in (force, rate))
    return motion.time[each::each][:count], force, rate


def draw_errors(random: np.random.Generator, sigmas: SensorErrors) -> dict[str, Array]:
    """Constant errors of one instrument, by name (as in `SensorErrors`), ``(3,)`` each, body axes."""
    return {name: sigma * random.standard_normal(3) for name, sigma in vars(sigmas).items()}


def read(
    random: np.random.Generator,
    instrument: Instrument,
    errors: dict[str, Array],
    time: Array,
    force: Array,
    rate: Array,
) -> FlightImu:
    """What the instrument reads of true means ``(N, 3)`` in body axes, in its own axes."""
    turned = rotations.rotate(rotations.from_rotation_vector(errors["accelerometer_misalignment"]), force)
    turned = (1.0 + errors["accelerometer_scale"]) * turned + errors["accelerometer_bias"]
    turning = (1.0 + errors["gyro_scale"]) * rate + errors["gyro_bias"]
    imu_from_body = rotations.conjugate(instrument.body_from_imu)
    noise = random.standard_normal((2, len(time), 3))
    force = rotations.rotate(imu_from_body, turned) + instrument.accelerometer_noise * noise[0]
    rate = rotations.rotate(imu_from_body, turning) + instrument.gyro_noise * noise[1]
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
    """Means whose increments come in whole counts; what a sample leaves over goes into the next."""
    if quantum == 0.0:
        return mean
    counts = np.round(np.cumsum(mean * interval, axis=0) / quantum)
    return np.diff(counts, axis=0, prepend=0.0) * quantum / interval
