"""Residual coefficients of a flight, and a library in which a column stands for an effect of the catalogue.

Flight minus database with the preflight atmosphere, all six coefficients stacked, each sample over its sigma: what the
methods of `comparators` regress. Every column is written down by hand, as somebody does who has no catalogue to ask.
"""

from dataclasses import dataclass, replace

import numpy as np

from edl_filter import rotations
from edl_filter.aero.planes import moments_at_cm, split
from edl_filter.aero.regimes import DYNAMIC_INSTABILITY_MACH
from edl_filter.pipeline.forward_model import damping_of
from edl_filter.pipeline.reconstruct import Reconstruction
from edl_filter.planet import ellipsoid
from edl_filter.postflight.atmosphere import AtmosphereProfile
from edl_filter.postflight.comparison import database_coefficients
from edl_filter.postflight.derive import PostflightResult
from edl_filter.postflight.flight import derived_quantities, postflight_inputs
from edl_filter.postflight.inputs import PostflightInputs
from edl_filter.postflight.measured import as_measured
from edl_filter.types import Array

#: Order in which coefficients stand in a stacked column.
CHANNELS = ("CA", "CY", "CN", "Cl", "Cm", "Cn")
#: Onsets of `remnant_torque`; bands of `wind`, m; lengths of `density_wave`, m; Mach numbers of `static_instability`.
ONSETS = 12
BANDS = ((0.0, 10e3), (10e3, 20e3), (20e3, 30e3), (30e3, 45e3))
WAVES = (8e3, 10e3, 12.5e3, 15e3, 18e3, 21e3, 25e3)
INSTABILITIES = (10.0, 14.0, 18.0, 22.0, 26.0)
#: Steps of differences: m/s, rad.
_STEP, _TURN = 10.0, 2e-3
_BASE_MACH = 10.0


@dataclass(frozen=True)
class Regression:
    """Residuals and library, each row over its sigma.

    Attributes
    ----------
    residual : (R,) array
    library : (R, K) array
    names : tuple of str
        The effect that each column stands for, ``(K,)``.
    """

    residual: Array
    library: Array
    names: tuple[str, ...]


@dataclass(frozen=True)
class Course:
    """A flight up to the parachute, as the regressors need it; arrays ``(N,)`` or ``(N, 3)``.

    Attributes
    ----------
    given, derived : PostflightInputs, PostflightResult
    dynamic_pressure : array
        Of the preflight atmosphere, Pa.
    per_force, per_moment : arrays
        Coefficient per m/s² of specific force, and per N m.
    table : (N, 6) array
        The database's coefficients at the reconstructed angles.
    inertial_from_body : (N, 4) array
    position, velocity : (N, 3) arrays
        Inertial, m and m/s.
    east, north : (N, 3) arrays
        In body axes.
    arm : (3,) array
        Driving IMU from the centre of mass, m.
    rotation : float
        Of the planet, rad/s.
    """

    given: PostflightInputs
    derived: PostflightResult
    dynamic_pressure: Array
    per_force: Array
    per_moment: Array
    table: Array
    inertial_from_body: Array
    position: Array
    velocity: Array
    east: Array
    north: Array
    arm: Array
    rotation: float

    def pushed(self, force: Array | float = 0.0, moment: Array | float = 0.0) -> Array:
        """Coefficients of a specific force (m/s²) and a moment (N m), ``(N, 6)``."""
        still = np.zeros((len(self.per_force), 3))
        f, m = force + still, moment + still
        return np.concatenate(
            (self.per_force[:, None] * f * [-1.0, 1.0, -1.0], self.per_moment[:, None] * m), axis=1
        )  # fmt: skip

    def added(
        self, ca: Array | float = 0.0, cn: Array | float = 0.0, cm: Array | float = 0.0, cl: Array | float = 0.0
    ) -> Array:
        """Coefficients of an addition to the totals: CA, CN, Cm about the nose, Cl; ``(N, 6)``."""
        i = self.given
        _, v, w = i.velocity_body.T
        zero = np.zeros(len(v))
        in_pitch, in_yaw, pitch, yaw = split(cn + zero, cm + zero, v, w)
        moments = moments_at_cm((ca + zero, in_yaw, in_pitch), (cl + zero, pitch, yaw), (i.x_over_d, *i.offset))
        return np.stack((ca + zero, in_yaw, in_pitch, *moments), axis=1)

    def with_air_velocity(self, change: Array, step: float) -> Array:
        """How the coefficients change with the air-relative velocity, per `step`; `change` (N, 3) in body axes."""
        i, air = self.given, self.derived.preflight.atmosphere
        velocity = i.velocity_body + change
        faster = np.linalg.norm(velocity, axis=1) / i.speed
        there = table_at(i, replace(air, mach=air.mach * faster), velocity)
        return (there * faster[:, None] ** 2 - self.table) / step


def table_at(given: PostflightInputs, atmosphere: AtmosphereProfile, velocity: Array) -> Array:
    """The database's coefficients ``(N, 6)`` where the air comes with `velocity`."""
    speed = np.linalg.norm(velocity, axis=1)
    coefficients = database_coefficients(given.database, atmosphere, speed, velocity, given.x_over_d, 0.0, given.offset)
    return np.stack([coefficients.value[c] for c in CHANNELS], axis=1)


def course_of(flight: Reconstruction) -> Course:
    """The flight up to the parachute."""
    everything = derived_quantities(flight)
    given, derived = postflight_inputs(flight, everything.air).until_parachute(), everything.postflight
    n, t, air = len(given.time), flight.trajectory, everything.air
    middle = 0.5 * (t.time[1:] + t.time[:-1])[:n]
    pressure = 0.5 * derived.preflight.atmosphere.density * given.speed**2
    area = np.pi / 4.0 * given.diameter**2
    attitude = rotations.normalise(t.inertial_from_body[1 : n + 1] + _same_side(t.inertial_from_body)[:n])
    back = rotations.conjugate(attitude)
    angle = flight.planet.rotation.angle(middle)
    half = [0.5 * (x[1:] + x[:-1])[:n] for x in (air.latitude, np.unwrap(air.longitude), t.position, t.velocity)]
    enu = ellipsoid.enu_from_fixed(half[0], half[1] + angle)
    return Course(
        given=given,
        derived=derived,
        dynamic_pressure=pressure,
        per_force=np.asarray(given.mass / (pressure * area)),
        per_moment=1.0 / (pressure * area * given.diameter),
        table=table_at(given, derived.preflight.atmosphere, given.velocity_body),
        inertial_from_body=attitude,
        position=half[2],
        velocity=half[3],
        east=rotations.rotate(back, enu[:, 0]),
        north=rotations.rotate(back, enu[:, 1]),
        arm=np.asarray(flight.telemetry.driving.position[0]),
        rotation=flight.planet.rotation_rate,
    )


def _same_side(attitude: Array) -> Array:
    """Every quaternion but the last, with the sign of the one after it."""
    return attitude[:-1] * np.sign(np.sum(attitude[:-1] * attitude[1:], axis=1))[:, None]


def regressors(p: Course) -> dict[str, list[Array]]:
    """Effect → its columns ``(N, 6)``, one for each parameter and place: what it adds to flight minus database.

    First order in the parameter. Columns of measured things (forces, rates) are the flight's own, smoothed; columns of
    the model are the database's.
    """
    i, d = p.given, p.derived
    mach, time, altitude, alpha = d.preflight.atmosphere.mach, i.time, i.altitude, i.alpha_total
    force, rate, turn, inertia = d.motion.force, d.motion.rate, d.motion.acceleration, i.inertia
    coefficients = i.database.lookup(mach, d.preflight.atmosphere.knudsen, alpha, i.speed)
    axes, zero = np.eye(3), np.zeros(len(time))

    def spun(change_rate: Array, change_turn: Array) -> Array:
        """Moment that goes with a wrong rate and angular acceleration."""
        coupled = np.cross(change_rate, rate @ inertia) + np.cross(rate, change_rate @ inertia)
        return change_turn @ inertia + coupled

    def bolted(at: Array, rates: Array, turns: Array) -> Array:
        """Acceleration of a point `at` (3,)."""
        return np.cross(turns, at) + np.cross(rates, np.cross(rates, at))

    late_rate, late_turn = -turn, -np.gradient(turn, time, axis=0)
    late_force = -(np.cross(late_turn, p.arm) + np.cross(late_rate, np.cross(rate, p.arm)))
    late_force -= np.cross(rate, np.cross(late_rate, p.arm))
    tensors = [np.array([[0.0, a, b], [a, 0.0, c], [b, c, 0.0]]) for a, b, c in axes]
    onsets = np.linspace(d.domain.useful, i.time[-1], ONSETS, endpoint=False)
    damping = np.where(mach < DYNAMIC_INSTABILITY_MACH, i.diameter / (2.0 * i.speed), 0.0)[:, None]
    damping = damping * rate * [0.0, 1.0, 1.0]
    small = np.sin(np.pi * np.minimum(alpha, np.radians(8.0)) / np.radians(8.0))
    # the air's own turning, towards the east
    carried = p.rotation * np.hypot(p.position[:, 0], p.position[:, 1])[:, None] * p.east

    def within(low: float, high: float) -> Array:
        return 0.5 * (np.tanh((altitude - low) / 2e3) - np.tanh((altitude - high) / 2e3))[:, None]

    def turned(axis: Array) -> Array:
        change = np.cross(np.broadcast_to(axis, p.velocity.shape), p.velocity)
        return rotations.rotate(rotations.conjugate(p.inertial_from_body), change)

    waves = [f(2.0 * np.pi * altitude / length)[:, None] for length in WAVES for f in (np.sin, np.cos)]
    return {
        "accelerometer_bias": [p.pushed(a) for a in axes],
        "accelerometer_scale": [p.pushed(force * a) for a in axes],
        "accelerometer_misalignment": [p.pushed(np.cross(a, force)) for a in axes],
        "gyro_bias": [p.pushed(0.0, spun(zero[:, None] + a, np.zeros_like(rate))) for a in axes],
        "gyro_scale": [p.pushed(0.0, spun(rate * a, turn * a)) for a in axes],
        "imu_lever_arm": [p.pushed(bolted(a, rate, turn)) for a in axes],
        "imu_time_offset": [p.pushed(late_force, spun(late_rate, late_turn))],
        "mass": [p.pushed(-force)],
        "com_offset": [p.pushed(0.0, -np.cross(a, i.mass * force)) for a in axes],
        "products_of_inertia": [p.pushed(0.0, turn @ b + np.cross(rate, rate @ b)) for b in tensors],
        "density_scale": [p.table],
        "density_wave": [p.table * wave for wave in waves],
        "wind": [p.with_air_velocity(-_STEP * within(*band) * a, _STEP) for band in BANDS for a in (p.east, p.north)],
        "atmosphere_rotation": [p.with_air_velocity(carried, 1.0)],
        "axial_force_scale": [p.added(ca=coefficients.ca)],
        "base_pressure": [p.added(ca=np.where(mach < _BASE_MACH, (1.0 - mach / _BASE_MACH) ** 2, 0.0))],
        "normal_force_scale": [p.added(cn=coefficients.cn)],
        "pitching_moment_scale": [p.added(cm=coefficients.cm_nose)],
        "static_instability": [p.added(cm=np.exp(-(((mach - m) / 4.0) ** 2)) * small) for m in INSTABILITIES],
        "pitch_damping": [p.pushed(0.0, damping / p.per_moment[:, None])],
        "rolling_moment": [p.added(cl=alpha), p.added(cl=1.0)],
        "remnant_torque": [
            p.pushed(0.0, (time >= t0)[:, None] * a / p.per_moment[:, None]) for t0 in onsets for a in axes
        ],
        "attitude_frame": [p.with_air_velocity(_TURN * turned(a), _TURN) for a in axes],
    }


def residuals(flight: Reconstruction, p: Course) -> tuple[Array, Array]:
    """Flight minus database with the preflight atmosphere, and one sigma of it, ``(N, 6)`` each.

    The database has the mission's damping, which the layer after the flight leaves out, and has gone through the
    flight's sampling and smoothing.
    """
    i, d = p.given, p.derived
    mach = d.preflight.atmosphere.mach
    damping = damping_of(flight.mission).at(mach) * i.diameter / (2.0 * i.speed)
    case, rate = d.preflight, d.motion.rate
    undamped = case.database.value
    damped = {"Cm": undamped["Cm"] + damping * rate[:, 1], "Cn": undamped["Cn"] + damping * rate[:, 2]}
    database = replace(case.database, value=undamped | damped)
    smoother = d.motion.smoother
    measured = as_measured(database, case.atmosphere, smoother, rate, i.speed, i.mass, i.diameter, i.inertia)
    difference = np.stack([case.coefficients.value[c] - measured.value[c] for c in CHANNELS], axis=1)
    sigma = np.stack([np.hypot(case.coefficients.sigma(c), measured.angle_sigma[c]) for c in CHANNELS], axis=1)
    return difference, sigma


def regression_of(flight: Reconstruction) -> Regression:
    """Residuals and library of a flight, where its forces can be used."""
    p = course_of(flight)
    difference, sigma = residuals(flight, p)
    columns = regressors(p)
    names = tuple(name for name, regressor in columns.items() for _ in regressor)
    stacked = np.stack([c for regressor in columns.values() for c in regressor], axis=2)
    use = np.isfinite(difference) & np.isfinite(sigma) & np.all(np.isfinite(stacked), axis=2)
    use &= (p.given.time >= p.derived.domain.useful)[:, None]
    return Regression((difference / sigma)[use], (stacked / sigma[:, :, None])[use], names)
