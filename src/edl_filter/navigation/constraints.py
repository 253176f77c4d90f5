"""Measurement models: everything that is measured or known of the flight in addition to the IMU samples.

A constraint holds, for one time, the measured values, their covariance, their source, and the function that predicts
them from a state. `predict` works on many states at once: navigation states ``(10 or 14, S)`` and other states
``(n, S)`` as in `layout.State`, one per column; it returns ``(S, m)`` in the units that `components` names.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import ClassVar, Protocol

import numpy as np

from edl_filter import rotations
from edl_filter.imu_model.sensor_errors import apply_errors
from edl_filter.navigation.compiled_states import turns_between
from edl_filter.navigation.layout import Layout
from edl_filter.planet import Planet
from edl_filter.planet.atmosphere import Atmosphere
from edl_filter.types import Array


class Constraint(Protocol):
    """The interface of all constraints.

    Attributes
    ----------
    name : str
        Several constraints may share a name: they are reported together.
    time : float
        s since the epoch.
    components : tuple of str
        Name of each component, with its unit.
    source : str
        Where the measured values come from.
    """

    name: ClassVar[str]

    @property
    def components(self) -> tuple[str, ...]:
        """Name of each component, with its unit in brackets."""

    @property
    def time(self) -> float:
        """s since the epoch."""

    @property
    def source(self) -> str:
        """Where the measured values come from."""

    @property
    def measured(self) -> Array:
        """Measured values ``(m,)``."""

    @property
    def noise(self) -> Array:
        """Covariance of the measured values ``(m, m)``."""

    def predict(self, nav: Array, errors: Array, layout: Layout) -> Array:
        """Predicted values.

        Parameters
        ----------
        nav : (10 or 14, S) array
            As `State.nav`: m, m/s and quaternions.
        errors : (n, S) array
            As `State.errors`, in the units of `layout.UNITS`.
        layout : Layout
            Of the filter's vector.

        Returns
        -------
        (S, m) array
        """


class _OneSigma:
    """A constraint whose components are independent and have the same sigma."""

    components: ClassVar[tuple[str, ...]]
    sigma: float

    @cached_property
    def noise(self) -> Array:
        """Independent components with one sigma."""
        return self.sigma**2 * np.eye(len(self.components))


@dataclass(frozen=True)
class OnboardAttitude(_OneSigma):
    """Attitude computed on board, against the same sum of gyro readings as the filter propagates it.

    The predicted value is the rotation vector in body axes from the telemetered quaternion to the propagated one; the
    measured value is zero.
    """

    name: ClassVar[str] = "onboard_attitude"
    components: ClassVar[tuple[str, ...]] = ("about x (rad)", "about y (rad)", "about z (rad)")
    time: float
    inertial_from_body: Array
    sigma: float
    source: str = "on-board quaternion"

    @property
    def measured(self) -> Array:
        """Zero rotation."""
        return np.zeros(3)

    def predict(self, nav: Array, errors: Array, layout: Layout) -> Array:
        """Rotation vector from the telemetered quaternion to the propagated one, rad."""
        return np.asarray(turns_between(self.inertial_from_body, nav[10:]), np.float64)


@dataclass(frozen=True)
class ZeroSpecificForce:
    """Before entry only gravity acts, so the accelerometers read their bias."""

    name: ClassVar[str] = "pre_entry_zero_force"
    components: ClassVar[tuple[str, ...]] = ("x (m/s^2)", "y (m/s^2)", "z (m/s^2)")
    time: float
    mean_force: Array
    sigma: Array
    source: str = "mean of the accelerometers before entry"

    @property
    def measured(self) -> Array:
        """Mean reading, body axes."""
        return self.mean_force

    @property
    def noise(self) -> Array:
        """Independent axes."""
        return np.diag(self.sigma**2)

    def predict(self, nav: Array, errors: Array, layout: Layout) -> Array:
        """The bias."""
        if "accelerometer_bias" in layout:
            return errors[layout["accelerometer_bias"]].T
        return np.zeros((nav.shape[1], 3))


@dataclass(frozen=True)
class DynamicPressure:
    """Dynamic pressure at parachute deployment, against the preflight density."""

    name: ClassVar[str] = "parachute"
    components: ClassVar[tuple[str, ...]] = ("dynamic pressure (Pa)",)
    time: float
    pressure: float
    sigma: float
    density_sigma: float
    planet: Planet
    atmosphere: Atmosphere
    source: str = "dynamic pressure at deployment"

    @property
    def measured(self) -> Array:
        """Pa."""
        return np.array([self.pressure])

    @property
    def noise(self) -> Array:
        """Variance of the stated pressure and of the density together, Pa²."""
        return np.array([[self.sigma**2 + (self.density_sigma * self.pressure) ** 2]])

    def predict(self, nav: Array, errors: Array, layout: Layout) -> Array:
        """``ρ V² / 2`` of the air-relative velocity, Pa."""
        altitude, velocity, _ = local_velocity(self.planet, self.time, nav, self.atmosphere)
        return 0.5 * (self.atmosphere.density(altitude) * np.sum(velocity**2, axis=1))[:, None]


def local_velocity(
    planet: Planet, time: float, nav: Array, atmosphere: Atmosphere | None = None
) -> tuple[Array, Array, Array]:
    """Altitude and velocity of many states relative to the air, or to the rotating planet.

    Parameters
    ----------
    planet : Planet
        Shape, and the rotation that the air follows.
    time : float
        s.
    nav : (10 or 14, S) array
        As `State.nav`.
    atmosphere : Atmosphere, optional
        With the wind; None: the velocity is relative to the planet.

    Returns
    -------
    altitude : (S,) array
        Areodetic, m.
    velocity : (S, 3) array
        East, north and up, m/s.
    enu : (S, 3, 3) array
        Rows: the local axes in inertial ones.
    """
    position = nav[:3].T
    latitude, longitude, altitude = planet.geodetic(time, position)
    enu = planet.enu_at(time, latitude, longitude)
    velocity = np.einsum("sij,sj->si", enu, planet.velocity_relative(position, nav[3:6].T))
    if atmosphere is not None:
        velocity[:, :2] -= atmosphere.wind_at(altitude)
    return altitude, velocity, enu


@dataclass(frozen=True)
class SteadyDescent:
    """Under the parachute drag balances weight, and the horizontal velocity is that of the wind.

    The accelerometers measure the parachute's drag, which gives its dynamic pressure; the terminal speed follows
    from that and the density at the state's own altitude.
    """

    name: ClassVar[str] = "steady_descent"
    components: ClassVar[tuple[str, ...]] = ("east (m/s)", "north (m/s)", "sinking over terminal speed (1)")
    time: float
    dynamic_pressure: float
    wind_sigma: float
    speed_sigma: float
    planet: Planet
    atmosphere: Atmosphere
    source: str = "terminal speed under the parachute; wind"

    @property
    def measured(self) -> Array:
        """No horizontal velocity, and a descent at terminal speed."""
        return np.array([0.0, 0.0, 1.0])

    @property
    def noise(self) -> Array:
        """Independent components."""
        return np.diag(np.square([self.wind_sigma, self.wind_sigma, self.speed_sigma]))

    def predict(self, nav: Array, errors: Array, layout: Layout) -> Array:
        """Ground-relative velocity to east and north (m/s), and the rate of descent over ``sqrt(2 q / ρ)``."""
        altitude, velocity, _ = local_velocity(self.planet, self.time, nav)
        terminal = np.sqrt(2.0 * self.dynamic_pressure / self.atmosphere.density(altitude))
        velocity[:, 2] /= -terminal
        return velocity


@dataclass(frozen=True)
class Altimeter(_OneSigma):
    """Height above a sphere about the planet's centre."""

    name: ClassVar[str] = "altimeter"
    components: ClassVar[tuple[str, ...]] = ("height (m)",)
    time: float
    height: float
    sigma: float
    surface_radius: float
    source: str = "radar altimeter"

    @property
    def measured(self) -> Array:
        """m."""
        return np.array([self.height])

    def predict(self, nav: Array, errors: Array, layout: Layout) -> Array:
        """Distance from the centre minus the sphere's radius, m."""
        return (np.linalg.norm(nav[:3], axis=0) - self.surface_radius)[:, None]


@dataclass(frozen=True)
class LandingSite:
    """Position at landing, in planet-fixed axes."""

    name: ClassVar[str] = "landing"
    components: ClassVar[tuple[str, ...]] = ("fixed x (m)", "fixed y (m)", "fixed z (m)")
    time: float
    position: Array
    covariance: Array
    planet: Planet
    source: str = "landing site"

    @property
    def measured(self) -> Array:
        """m."""
        return self.position

    @property
    def noise(self) -> Array:
        """m²."""
        return self.covariance

    def predict(self, nav: Array, errors: Array, layout: Layout) -> Array:
        """Planet-fixed position, m."""
        return self.planet.rotation.to_fixed(self.time, nav[:3].T)


@dataclass(frozen=True)
class RestVelocity(_OneSigma):
    """At rest on the surface: no velocity relative to the ground."""

    name: ClassVar[str] = "rest_velocity"
    components: ClassVar[tuple[str, ...]] = ("inertial x (m/s)", "inertial y (m/s)", "inertial z (m/s)")
    time: float
    sigma: float
    planet: Planet
    source: str = "at rest on the surface"

    @property
    def measured(self) -> Array:
        """Zero."""
        return np.zeros(3)

    def predict(self, nav: Array, errors: Array, layout: Layout) -> Array:
        """Velocity relative to the ground, inertial axes, m/s."""
        return self.planet.velocity_relative(nav[:3].T, nav[3:6].T)


@dataclass(frozen=True)
class RestGravity(_OneSigma):
    """At rest on the surface: the mean reading of the accelerometers over a window is minus gravity.

    The same readings drive the propagation over the window. Their mean minus the support against gravity is the
    velocity at the end of the window over its length, and its noise is the process noise, which the covariance at the
    end already contains. If the mean were compared with gravity apart from the propagation, this noise would enter
    twice as if it were independent: between two zero velocities an interval T apart the velocity is a Brownian bridge
    with the variance ``q t (1 - t/T)``, but ``q t (1 + t/T)`` would be stated (intensity q).
    """

    name: ClassVar[str] = "rest_gravity"
    components: ClassVar[tuple[str, ...]] = ("inertial x (m/s^2)", "inertial y (m/s^2)", "inertial z (m/s^2)")
    time: float
    duration: float
    sigma: float
    planet: Planet
    drift_covariance: Array = field(default_factory=lambda: np.zeros((3, 3)))
    source: str = "accelerometers at rest"

    @property
    def noise(self) -> Array:
        """Independent components with one sigma, and what a force at rest that is not constant adds, m²/s⁴."""
        return super().noise + self.drift_covariance

    @property
    def measured(self) -> Array:
        """Zero."""
        return np.zeros(3)

    def predict(self, nav: Array, errors: Array, layout: Layout) -> Array:
        """Mean acceleration relative to the ground over the window that ends at `time`, inertial axes, m/s²."""
        return self.planet.velocity_relative(nav[:3].T, nav[3:6].T) / self.duration


@dataclass(frozen=True)
class RestRate(_OneSigma):
    """At rest on the surface: the gyros read the planet's rotation."""

    name: ClassVar[str] = "rest_rate"
    components: ClassVar[tuple[str, ...]] = ("x (rad/s)", "y (rad/s)", "z (rad/s)")
    time: float
    mean_rate: Array
    sigma: float
    planet: Planet
    source: str = "gyros at rest"

    @property
    def measured(self) -> Array:
        """Mean reading, body axes."""
        return self.mean_rate

    def predict(self, nav: Array, errors: Array, layout: Layout) -> Array:
        """``(1 + s) ∘ Cᵀ ω + b``, rad/s."""
        spin = np.array([0.0, 0.0, self.planet.rotation_rate])
        rate = rotations.rotate(rotations.conjugate(nav[6:10].T), spin)
        scale, bias = (_state(layout, errors, name) for name in ("gyro_scale", "gyro_bias"))
        return apply_errors(rate, scale=scale, bias=bias)


def _state(layout: Layout, errors: Array, name: str) -> Array | None:
    """Values ``(S, 3)`` of one state, or None where the layout has no such state."""
    return errors[layout[name]].T if name in layout else None
