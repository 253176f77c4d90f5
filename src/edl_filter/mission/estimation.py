"""Sections of the estimate: initial state, constraints, filter settings and outputs."""

from __future__ import annotations

import math
from typing import Annotated, Literal

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field, Tag, model_validator

from edl_filter.mission.fields import (
    DEG,
    KM,
    AngleSigma,
    ForceSigma,
    FromTelemetryConfig,
    LengthSigma,
    Pressure,
    Radius,
    RelativeSigma,
    Section,
    SpeedSigma,
    StatedOrFromTelemetry,
    Time,
    WindowConfig,
    discriminator,
)
from edl_filter.mission.validators import (
    Covariance,
    Direction,
    Number,
    Quaternion,
    Switch,
    Vector,
    Within,
    field_error,
    normalised,
)
from edl_filter.rotations import to_matrix
from edl_filter.types import Array


class SunLineSigmaConfig(Section):
    """Attitude error that is larger about the line to the Sun than across it."""

    about_sun: AngleSigma = Field(description="1 sigma about the Sun line, deg")
    across_sun: AngleSigma = Field(description="1 sigma about each axis across it, deg")


class StatedStateConfig(Section):
    """Entry state stated in the mission."""

    time_s: Time = Field(description="time of the state, s since the epoch")
    epoch_sigma_s: Annotated[Number, Within("s", 0.0, 1e3)] = Field(
        default=0.0, description="1 sigma of the state's time, s; 0: exact"
    )
    position: Annotated[Vector, Within("m", 1e5, 1e9, KM)] = Field(description="position, m, inertial")
    velocity: Annotated[Vector, Within("m/s", 100.0, 1e5, (("km/s", 1e3),))] = Field(
        description="velocity, m/s, inertial"
    )
    position_sigma: LengthSigma | None = Field(default=None, description="1 sigma of the position per axis, m")
    velocity_sigma: SpeedSigma | None = Field(default=None, description="1 sigma of the velocity per axis, m/s")
    attitude: (
        Annotated[
            Annotated[Literal["onboard"], Tag("<word>")] | Annotated[Quaternion, Tag("<stated>")],
            discriminator(lambda value: "<word>" if isinstance(value, str) else "<stated>"),
        ]
        | None
    ) = Field(
        default=None,
        description="'onboard': the on-board quaternion at time_s; or inertial_from_body, scalar last",
    )
    attitude_sigma_deg: (
        Annotated[
            Annotated[AngleSigma, Tag("<stated>")] | Annotated[SunLineSigmaConfig, Tag("<sun>")],
            discriminator(lambda value: "<sun>" if isinstance(value, (dict, SunLineSigmaConfig)) else "<stated>"),
        ]
        | None
    ) = Field(default=None, description="1 sigma of the attitude, deg: a number, or about_sun and across_sun")
    sun_direction_j2000: Direction | None = Field(default=None, description="unit vector to the Sun in J2000")
    covariance: Covariance | None = Field(
        default=None,
        description="9 x 9, in place of the sigmas: m, m/s, and rad of attitude error in body axes",
    )
    frame_rotation_sigma_deg: Annotated[Number, Within("deg", 0.0, 180.0)] = Field(
        default=0.0, description="1 sigma per axis of a rotation of the whole state's frame, deg; 0: none"
    )

    @model_validator(mode="after")
    def _complete(self) -> StatedStateConfig:
        sigmas = ("position_sigma", "velocity_sigma", "attitude_sigma_deg")
        for key in sigmas:
            stated = getattr(self, key) is not None
            if self.covariance is not None and stated:
                raise field_error("both this and covariance", "one of them", key)
            optional = key == "attitude_sigma_deg" and self.attitude is None
            if self.covariance is None and not stated and not optional:
                raise field_error("nothing", f"{type(self).model_fields[key].description}; or covariance", key)
        if isinstance(self.attitude_sigma_deg, SunLineSigmaConfig) and self.sun_direction_j2000 is None:
            raise field_error("nothing", "the unit vector that about_sun needs", "sun_direction_j2000")
        return self

    @property
    def frame_rotation_sigma(self) -> float:
        """`frame_rotation_sigma_deg` in rad."""
        return self.frame_rotation_sigma_deg * DEG

    @property
    def sun_direction(self) -> Array | None:
        """`sun_direction_j2000` divided by its length, (3,)."""
        return None if self.sun_direction_j2000 is None else normalised(self.sun_direction_j2000)

    def covariance_matrix(self, inertial_from_body: ArrayLike, j2000_from_inertial: ArrayLike | None = None) -> Array:
        """Covariance of position, velocity and attitude error, without the errors of the state's epoch and frame.

        Parameters
        ----------
        inertial_from_body : (4,) array
            Attitude of the state, scalar last: the attitude error is in body axes.
        j2000_from_inertial : (3, 3) array, optional
            Required where the attitude's sigma is stated about the Sun line.

        Returns
        -------
        (9, 9) array
            m, m/s and rad.
        """
        if self.covariance is not None:
            return np.array(self.covariance)
        assert self.position_sigma is not None and self.velocity_sigma is not None  # ensured by _complete
        p = np.zeros((9, 9))
        p[:3, :3] = self.position_sigma**2 * np.eye(3)
        p[3:6, 3:6] = self.velocity_sigma**2 * np.eye(3)
        sigma = self.attitude_sigma_deg
        if isinstance(sigma, SunLineSigmaConfig):
            assert self.sun_direction is not None and j2000_from_inertial is not None
            sun = to_matrix(inertial_from_body).T @ np.asarray(j2000_from_inertial).T @ self.sun_direction
            across, about = (sigma.across_sun * DEG) ** 2, (sigma.about_sun * DEG) ** 2
            p[6:, 6:] = across * np.eye(3) + (about - across) * np.outer(sun, sun)
        else:
            p[6:, 6:] = ((0.0 if sigma is None else sigma) * DEG) ** 2 * np.eye(3)
        return p


InitialStateConfig = StatedOrFromTelemetry[StatedStateConfig, FromTelemetryConfig]


class OnboardAttitudeConfig(Section):
    """The attitude computed on board."""

    interval_s: Annotated[Number, Within("s", 0.0, 1e4, above=True)] = Field(description="time between updates, s")
    sigma_deg: AngleSigma = Field(description="1 sigma of one update about each axis, deg")
    unit_change_sigma_deg: Annotated[Number, Within("deg", 0.0, 180.0)] = Field(
        default=0.0,
        description="1 sigma of the attitude step when another on-board unit takes over the computation, deg; 0: none",
    )
    rate_sigma_deg_h: Annotated[Number, Within("deg/h", 0.0, 1e3)] = Field(
        default=0.0,
        description="1 sigma per body axis of the difference between the rates used on board and the gyro samples, "
        "deg/h; 0: none",
    )
    mounting_sigma_deg: Annotated[Number, Within("deg", 0.0, 10.0)] = Field(
        default=0.0,
        description="1 sigma per body axis of the difference between the mounting used on board and that of the "
        "samples, deg; 0: none",
    )

    @property
    def sigma(self) -> float:
        """`sigma_deg` in rad."""
        return self.sigma_deg * DEG

    @property
    def rate_sigma(self) -> float:
        """`rate_sigma_deg_h` in rad/s."""
        return self.rate_sigma_deg_h * DEG / 3600.0

    @property
    def mounting_sigma(self) -> float:
        """`mounting_sigma_deg` in rad."""
        return self.mounting_sigma_deg * DEG

    @property
    def unit_change_sigma(self) -> float:
        """`unit_change_sigma_deg` in rad."""
        return self.unit_change_sigma_deg * DEG


class ZeroForceConfig(WindowConfig):
    """Before the atmosphere, gravity is the only force on the vehicle."""

    sigma: ForceSigma = Field(description="1 sigma of the mean specific force over the window, m/s^2")


class ParachuteDeploymentConfig(Section):
    """Flow at the event parachute_deploy: axial force or dynamic pressure, Mach number, or one of each.

    A trigger on deceleration computes its dynamic pressure from the same accelerometers, so that its target and the
    axial force are one measurement, of which the axial force is the better form.
    """

    axial_force_window_s: Annotated[Number, Within("s", 0.0, 20.0, above=True)] | None = Field(
        default=None,
        description="dynamic pressure from the accelerometers, the mass and CA of the database: time before the event "
        "over which a line is fitted to the axial specific force, s",
    )
    dynamic_pressure: Pressure | None = Field(
        default=None, description="dynamic pressure, Pa, measured otherwise; instead of axial_force_window_s"
    )
    dynamic_pressure_sigma: Annotated[Number, Within("Pa", 0.0, 1e6, (("kPa", 1e3),), above=True)] | None = Field(
        default=None, description="1 sigma of it, Pa"
    )
    mach: Annotated[Number, Within("", 0.0, 50.0, above=True)] | None = Field(default=None, description="Mach number")
    mach_sigma: Annotated[Number, Within("", 0.0, 10.0, above=True)] | None = Field(
        default=None, description="1 sigma of it, without that of the temperature"
    )
    temperature_sigma: Annotated[Number, Within("K", 0.0, 200.0)] | None = Field(
        default=None, description="1 sigma of the preflight temperature, K: of the speed of sound; with mach"
    )

    @model_validator(mode="after")
    def _complete(self) -> ParachuteDeploymentConfig:
        for key, needed in (
            ("dynamic_pressure", "dynamic_pressure_sigma"),
            ("mach", "mach_sigma"),
            ("mach", "temperature_sigma"),
        ):
            for present, lacking in ((key, needed), (needed, key)):
                if getattr(self, present) is not None and getattr(self, lacking) is None:
                    raise field_error("nothing", f"a number: {present} needs it", lacking)
        if self.axial_force_window_s is not None and self.dynamic_pressure is not None:
            raise field_error("both this and axial_force_window_s", "one of them", "dynamic_pressure")
        if self.axial_force_window_s is None and self.dynamic_pressure is None and self.mach is None:
            raise field_error("no measurement", "axial_force_window_s, dynamic_pressure or mach")
        return self


class SteadyDescentConfig(WindowConfig):
    """Under the parachute the vehicle descends at terminal speed."""

    horizontal_sigma: SpeedSigma = Field(description="1 sigma of each horizontal velocity, m/s: wind")
    vertical_sigma: RelativeSigma = Field(description="1 sigma of the descent rate, relative")


class LandingSiteConfig(Section):
    """Position of the vehicle at the event landing."""

    use: Switch = Field(
        default=True, description="false: used only to compute the miss distance, not as a constraint of the estimate"
    )
    latitude_deg: Annotated[Number, Within("deg", -90.0, 90.0)] = Field(description="areocentric latitude, deg, north")
    longitude_deg: Annotated[Number, Within("deg", -180.0, 360.0)] = Field(description="longitude, deg, east")
    radius: Radius = Field(description="distance from the planet's centre, m")
    horizontal_sigma: LengthSigma = Field(description="1 sigma to the north and to the east, m")
    vertical_sigma: LengthSigma = Field(description="1 sigma of the radius, m")

    @property
    def latitude(self) -> float:
        """Areocentric latitude, rad."""
        return self.latitude_deg * DEG

    @property
    def longitude(self) -> float:
        """Longitude, rad, east."""
        return self.longitude_deg * DEG

    @property
    def position(self) -> Array:
        """Planet-fixed position (3,), m."""
        equatorial = math.cos(self.latitude)
        return self.radius * np.array(
            [equatorial * math.cos(self.longitude), equatorial * math.sin(self.longitude), math.sin(self.latitude)]
        )


class RestConfig(WindowConfig):
    """The vehicle rests on the surface."""

    velocity_sigma: SpeedSigma = Field(description="1 sigma of each ground-relative velocity, m/s")
    gravity_direction_sigma_deg: AngleSigma | None = Field(
        default=None, description="1 sigma of the measured direction of gravity, deg; absent: not used"
    )

    @property
    def gravity_direction_sigma(self) -> float | None:
        """`gravity_direction_sigma_deg` in rad."""
        sigma = self.gravity_direction_sigma_deg
        return None if sigma is None else sigma * DEG


class RestFromTelemetryConfig(FromTelemetryConfig):
    """The vehicle rests from the time of the flight file's landing constraint to the end of the record.

    The format defines rest as no ground-relative velocity. With the default sigma a vehicle may move by a centimetre
    within 20 s. It is 100 times smaller than what a settling airbag needs: state a larger one for such a vehicle.
    """

    velocity_sigma: SpeedSigma = Field(default=5e-4, description="1 sigma of each ground-relative velocity, m/s")


class AltimeterFromTelemetryConfig(FromTelemetryConfig):
    """The altimeter of the flight file.

    The vehicle comes to rest on the ground that the altimeter measures. Without a stated relief, the ground between a
    reading and the landing is a random walk with slopes of 5 degrees over 100 m, which those of the Mars Exploration
    Rovers' landing sites had to be below (Golombek et al. 2003, Journal of Geophysical Research 108, E12). Where
    heights refer to another surface than the ground at the landing, state how far it may be from it.
    """

    sigma: Annotated[Number, Within("m", 1e-3, 1e5)] | None = Field(
        default=None, description="1 sigma of one height, m; absent: that of the flight file"
    )
    relief_sigma: LengthSigma | None = Field(
        default=None,
        description="1 sigma of the height of the ground at the landing above the surface of the heights, m; absent: "
        "that of slopes of 5 degrees over 100 m between each reading and the landing",
    )


class ConstraintsConfig(Section):
    """Constraints that are fused into the estimate; a constraint that is absent or null is not used."""

    onboard_attitude: OnboardAttitudeConfig | None = Field(default=None, description="attitude computed on board")
    pre_entry_zero_force: ZeroForceConfig | None = Field(default=None, description="no force before the atmosphere")
    parachute: StatedOrFromTelemetry[ParachuteDeploymentConfig, FromTelemetryConfig] | None = Field(
        default=None, description="flow at parachute deployment"
    )
    steady_descent: SteadyDescentConfig | None = Field(default=None, description="terminal speed under the parachute")
    landing: StatedOrFromTelemetry[LandingSiteConfig, FromTelemetryConfig] | None = Field(
        default=None, description="landing site"
    )
    rest: StatedOrFromTelemetry[RestConfig, RestFromTelemetryConfig] | None = Field(
        default=None, description="rest on the surface"
    )
    altimeter: AltimeterFromTelemetryConfig | None = Field(default=None, description="radar altimeter")


class FilterConfig(Section):
    """Settings of the unscented Kalman filter."""

    method: Literal["ukf", "ekf"] = Field(
        default="ukf", description="ukf: unscented Kalman filter; ekf: extended, without alpha, beta and kappa"
    )
    engine: Literal["compiled", "filterpy"] = Field(
        default="compiled",
        description="of the unscented filter and the smoother; compiled: numba; filterpy: the readable reference, the "
        "same results to rounding",
    )
    robust: Literal["none", "huber", "student_t"] = Field(
        default="none",
        description="update with a measurement; none: Gaussian; huber, student_t: a reading far from its prediction "
        "gets more noise",
    )
    alpha: Annotated[Number, Within("", 0.1, 1.0)] = Field(
        default=0.5, description="spread of the sigma points; below 0.1 rounding errors become large"
    )
    beta: Annotated[Number, Within("", 0.0, 10.0)] = Field(default=2.0, description="shape of the prior; 2: Gaussian")
    kappa: Annotated[Number, Within("", -10.0, 100.0)] = Field(
        default=0.0, description="secondary spread of the sigma points"
    )
    longest_interval_s: Annotated[Number, Within("s", 0.0, 100.0, above=True)] = Field(
        default=5.0, description="longest time between fusion epochs, s"
    )
    gate_probability: Annotated[Number, Within("", 0.5, 1.0, (("%", 1e-2),), below=True)] = Field(
        default=0.99999, description="a constraint whose NIS exceeds this quantile of its distribution is not accepted"
    )
    sanity_check: Switch = Field(
        default=True,
        description="refuse a record that violates the physics of an entry: drag along -x, lost speed, gravity at "
        "rest, one angular rate",
    )


class OutputsConfig(Section):
    """Outputs of a run, and their folder."""

    directory: str | None = Field(
        default=None, description="folder of the results, relative to the current folder; absent: results/NAME"
    )
    figures: Switch = Field(default=True, description="draw figures")
