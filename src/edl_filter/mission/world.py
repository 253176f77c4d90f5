"""The planet, its atmosphere, and the vehicle."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np
from pydantic import Field, model_validator

from edl_filter.mission.checks import (
    Array,
    Number,
    RotationMatrix,
    Within,
    check_inertia,
    orthonormal,
    problem,
)
from edl_filter.mission.sections import (
    DEG,
    DEGREE_RATES,
    KM,
    PERCENT,
    LeverArm,
    Mass,
    Moment,
    Product,
    Radius,
    RelativeSigma,
    Sclk,
    Section,
    Time,
    TimeSigma,
)


class Gravity(Section):
    """Gravity field, to the second zonal harmonic."""

    mu: Annotated[Number, Within("m^3/s^2", 1e10, 1e18, (("km^3/s^2", 1e9),))] = Field(
        description="gravitational parameter, m^3/s^2"
    )
    j2: Annotated[Number, Within("", -0.1, 0.1)] = Field(
        description="second zonal coefficient, unnormalised; 0 is a point mass"
    )
    radius: Radius = Field(description="reference radius of j2, m")


class Ellipsoid(Section):
    """Ellipsoid of areodetic latitude and altitude."""

    equatorial_radius: Radius = Field(description="equatorial radius, m")
    flattening: Annotated[Number, Within("", 0.0, 0.2)] = Field(
        description="(equatorial - polar) / equatorial radius; 1/170 for Mars, not 170"
    )


class Planet(Section):
    """The planet, and how the inertial frame lies."""

    name: str = Field(description="name of the planet")
    gravity: Gravity = Field(description="gravity field")
    ellipsoid: Ellipsoid = Field(description="reference ellipsoid")
    rotation_rate: Annotated[
        Number,
        Within("rad/s", 1e-8, 1e-3, DEGREE_RATES, zero=True),
    ] = Field(description="rotation rate, rad/s, eastward")
    prime_meridian_deg: Annotated[Number, Within("deg", -360.0, 360.0)] | None = Field(
        default=None, description="angle from the inertial x axis to the prime meridian at the epoch, deg"
    )
    j2000_from_inertial: RotationMatrix | None = Field(
        default=None,
        description="3 rows; columns are the inertial axes in J2000 (Earth mean equator and equinox)",
    )

    @property
    def prime_meridian(self) -> float | None:
        """Angle to the prime meridian at the epoch, rad, if the mission states it."""
        return None if self.prime_meridian_deg is None else self.prime_meridian_deg * DEG

    @property
    def j2000_from_inertial_matrix(self) -> Array | None:
        """`j2000_from_inertial` made orthonormal to rounding, (3, 3)."""
        return None if self.j2000_from_inertial is None else orthonormal(self.j2000_from_inertial)


class Atmosphere(Section):
    """Preflight atmosphere and the gas."""

    table: str = Field(description="CSV table of the preflight atmosphere: a path, or builtin:NAME")
    density_sigma: RelativeSigma = Field(description="1 sigma of the preflight density, relative")
    density_correlation_m: Annotated[Number, Within("m", 10.0, 2e5, KM)] = Field(
        default=1e4, description="altitude over which the density's error is correlated, m"
    )
    wind_sigma: Annotated[Number, Within("m/s", 0.0, 500.0, (("km/s", 1e3),))] = Field(
        default=20.0,
        description="1 sigma of the wind towards east and north about the table's, m/s: in the bands of what is "
        "derived, and what a diagnosis allows for",
    )
    gas_constant: Annotated[Number, Within("J/(kg K)", 10.0, 5e3, (("kJ/(kg K)", 1e3),))] = Field(
        default=188.92, description="specific gas constant, J/(kg K)"
    )
    heat_capacity_ratio: Annotated[Number, Within("", 1.0, 1.7, above=True)] = Field(
        default=1.3, description="ratio of specific heats"
    )
    molecule_diameter: Annotated[Number, Within("m", 1e-11, 1e-8)] = Field(
        default=4.64e-10, description="hard-sphere diameter of a molecule, m"
    )
    molecule_mass: Annotated[Number, Within("kg", 1e-27, 1e-24)] = Field(
        default=7.3079e-26, description="mass of a molecule, kg"
    )


class Inertia(Section):
    """Moments and products of inertia about the centre of mass, body axes.

    An element of the tensor off its diagonal is minus the product.
    """

    xx: Moment = Field(description="moment about x (symmetry axis), kg m^2")
    yy: Moment = Field(description="moment about y, kg m^2")
    zz: Moment = Field(description="moment about z, kg m^2")
    xy: Product = Field(default=0.0, description="product of x and y, kg m^2")
    xz: Product = Field(default=0.0, description="product of x and z, kg m^2")
    yz: Product = Field(default=0.0, description="product of y and z, kg m^2")

    @model_validator(mode="after")
    def _physical(self) -> Inertia:
        check_inertia(self.tensor)
        return self

    @property
    def tensor(self) -> Array:
        """Inertia tensor (3, 3), kg m²."""
        return np.array([[self.xx, -self.xy, -self.xz], [-self.xy, self.yy, -self.yz], [-self.xz, -self.yz, self.zz]])


class Parachute(Section):
    """The parachute."""

    area_diameter: Annotated[Number, Within("m", 0.1, 100.0, KM)] = Field(description="nominal diameter D0, m")
    drag_coefficient: Annotated[Number, Within("", 0.05, 3.0)] | None = Field(
        default=None, description="drag coefficient on pi D0^2 / 4, subsonic"
    )


class Event(Section):
    """Something that happened, and what changed with it."""

    sclk: Sclk | None = Field(default=None, description="spacecraft clock count, s (or time_s)")
    time_s: Time | None = Field(default=None, description="time, s since the epoch (or sclk)")
    sigma_s: TimeSigma = Field(description="1 sigma of the time, s")
    mass: Mass | None = Field(default=None, description="mass from here on, kg")
    position: LeverArm | None = Field(
        default=None,
        description="driving IMU's position from the centre of mass as it is from here on, m, axes as under imus",
    )

    @model_validator(mode="after")
    def _one_time(self) -> Event:
        if (self.sclk is None) == (self.time_s is None):
            raise problem("neither" if self.sclk is None else "both", "one of sclk and time_s")
        return self


class Vehicle(Section):
    """Mass properties, size and what happens to them."""

    mass: Mass = Field(description="mass at entry, kg")
    mass_sigma: Annotated[Number, Within("kg", 0.0, 1e4)] = Field(default=0.0, description="1 sigma of it, kg")
    diameter: Annotated[Number, Within("m", 0.1, 50.0, KM)] = Field(
        description="diameter, m: reference length; reference area pi D^2 / 4"
    )
    centre_of_mass: Annotated[Number, Within("diameters", 0.0, 2.0)] = Field(
        description="distance of the centre of mass behind the nose, diameters"
    )
    centre_of_mass_offset: tuple[
        Annotated[Number, Within("diameters", -0.2, 0.2)], Annotated[Number, Within("diameters", -0.2, 0.2)]
    ] = Field(default=(0.0, 0.0), description="[y, z] of the centre of mass from the axis of symmetry, diameters")
    inertia: Inertia | None = Field(default=None, description="inertia at entry")
    inertia_sigma: Annotated[Number, Within("", 0.0, 1.0, PERCENT)] = Field(
        default=0.0, description="relative 1 sigma of all of it together"
    )
    parachute: Parachute | None = Field(default=None, description="parachute")
    events: dict[str, Event] = Field(default_factory=dict, description="events by name, in order of time")

    @property
    def reference_area(self) -> float:
        """Pi D² / 4, m²."""
        return math.pi / 4.0 * self.diameter**2
