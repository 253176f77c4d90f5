"""Sections of the planet, its atmosphere and the vehicle."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import Field, Tag, model_validator

from edl_filter.aero.conventions import reference_area
from edl_filter.mission.fields import (
    DEG,
    DEGREE_RATES,
    KM,
    PERCENT,
    LeverArm,
    Mass,
    Moment,
    Product,
    ProductSigma,
    Radius,
    RelativeSigma,
    Sclk,
    Section,
    Time,
    TimeSigma,
    discriminator,
)
from edl_filter.mission.validators import (
    Number,
    RotationMatrix,
    Within,
    check_inertia,
    field_error,
    nearest_rotation_matrix,
    value_text,
)
from edl_filter.types import Array


class GravityConfig(Section):
    """Gravity field, to the second zonal harmonic."""

    mu: Annotated[Number, Within("m^3/s^2", 1e10, 1e18, (("km^3/s^2", 1e9),))] = Field(
        description="gravitational parameter, m^3/s^2"
    )
    j2: Annotated[Number, Within("", -0.1, 0.1)] = Field(
        description="second zonal coefficient, unnormalised; 0 is a point mass"
    )
    radius: Radius = Field(description="reference radius of j2, m")


class EllipsoidConfig(Section):
    """Ellipsoid of areodetic latitude and altitude."""

    equatorial_radius: Radius = Field(description="equatorial radius, m")
    flattening: Annotated[Number, Within("", 0.0, 0.2)] = Field(
        description="(equatorial - polar) / equatorial radius; 1/170 for Mars, not 170"
    )


class PlanetConfig(Section):
    """The planet, and the orientation of the inertial frame."""

    name: str = Field(description="name of the planet")
    gravity: GravityConfig = Field(description="gravity field")
    ellipsoid: EllipsoidConfig = Field(description="reference ellipsoid")
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
        """Angle to the prime meridian at the epoch, rad; None where the mission does not state it."""
        return None if self.prime_meridian_deg is None else self.prime_meridian_deg * DEG

    @property
    def j2000_from_inertial_matrix(self) -> Array | None:
        """`j2000_from_inertial` made orthonormal to rounding, (3, 3); None where the mission does not state it."""
        return None if self.j2000_from_inertial is None else nearest_rotation_matrix(self.j2000_from_inertial)


GasConstant = Annotated[Number, Within("J/(kg K)", 10.0, 5e3, (("kJ/(kg K)", 1e3),))]
Fraction = Annotated[Number, Within("", 0.0, 1.0, PERCENT)]
#: Keys of the gas in the section of the atmosphere up to release 0.1.
_FORMER_GAS_KEYS = ("gas_constant", "heat_capacity_ratio", "molecule_diameter", "molecule_mass")


class CompositionConfig(Section):
    """Mole fractions, which are divided by their sum."""

    CO2: Fraction = Field(default=0.0, description="carbon dioxide")
    N2: Fraction = Field(default=0.0, description="nitrogen")
    Ar: Fraction = Field(default=0.0, description="argon")
    O2: Fraction = Field(default=0.0, description="oxygen")
    CO: Fraction = Field(default=0.0, description="carbon monoxide")

    @model_validator(mode="after")
    def _complete(self) -> CompositionConfig:
        total = sum(self.model_dump().values())
        if abs(total - 1.0) > 0.01:
            raise field_error(f"fractions with the sum {total:.6g}", "mole fractions with the sum 1, to 0.01")
        return self


class GasMixtureConfig(Section):
    """A mixture, whose heat capacity depends on the temperature."""

    form: ClassVar[str] = "a composition"
    composition: CompositionConfig = Field(description="mole fractions")


class GasConstantsConfig(Section):
    """A gas with constants that are stated."""

    form: ClassVar[str] = "constants"
    constant: GasConstant = Field(description="specific gas constant, J/(kg K)")
    heat_capacity_ratio: Annotated[Number, Within("", 1.0, 1.7, above=True)] = Field(
        description="ratio of specific heats, at all temperatures"
    )
    molecule_diameter: Annotated[Number, Within("m", 1e-11, 1e-8)] | None = Field(
        default=None, description="hard-sphere diameter of a molecule, m; absent: that of carbon dioxide, 4.64e-10"
    )
    molecule_mass: Annotated[Number, Within("kg", 1e-27, 1e-24)] | None = Field(
        default=None, description="mass of a molecule, kg; absent: from the gas constant"
    )


def _gas_tag(value: Any) -> str:
    if isinstance(value, GasMixtureConfig) or (isinstance(value, dict) and "composition" in value):
        return "<mixture>"
    return "<constants>" if isinstance(value, (dict, GasConstantsConfig)) else "<name>"


GasConfig = Annotated[
    Annotated[Literal["thesis", "mars"], Tag("<name>")]
    | Annotated[GasMixtureConfig, Tag("<mixture>")]
    | Annotated[GasConstantsConfig, Tag("<constants>")],
    discriminator(_gas_tag),
]


class AtmosphereConfig(Section):
    """Preflight atmosphere and the gas."""

    table: str = Field(description="CSV table of the preflight atmosphere: a path, or builtin:NAME")
    density_sigma: RelativeSigma = Field(description="1 sigma of the preflight density, relative")
    density_correlation_m: Annotated[Number, Within("m", 10.0, 2e5, KM)] = Field(
        default=1e4, description="altitude over which the density's error is correlated, m"
    )
    wind_sigma: Annotated[Number, Within("m/s", 0.0, 500.0, (("km/s", 1e3),))] = Field(
        default=20.0,
        description="1 sigma of the wind towards east and north about the table's, m/s: part of the uncertainty of "
        "derived quantities, and the prior sigma of the wind in a diagnosis",
    )
    gas: GasConfig = Field(
        default="thesis",
        description="thesis (CO2, R = 188.92 J/(kg K), ratio of specific heats 1.3), mars (mixture, R = 191.20 "
        "J/(kg K), heat capacity by temperature), a composition, or constants",
    )
    table_gas_constant: GasConstant | None = Field(
        default=None,
        description="gas constant with which the temperatures of the table were computed, J/(kg K): they are converted "
        "to the gas, at the table's pressure; absent: that of the gas",
    )

    @model_validator(mode="before")
    @classmethod
    def _no_former_keys(cls, data: Any) -> Any:
        for key in _FORMER_GAS_KEYS if isinstance(data, dict) else ():
            if key in data:
                raise field_error(
                    value_text(data[key]),
                    "no such key since 0.2: 'gas: thesis' has the former defaults, 'gas: mars' the air of Mars, and "
                    "'gas: {constant: R, heat_capacity_ratio: gamma}' other constants",
                    key,
                )
        return data


class InertiaConfig(Section):
    """Moments and products of inertia about the centre of mass, body axes.

    An off-diagonal element of the inertia tensor is minus the product.
    """

    xx: Moment = Field(description="moment about x (symmetry axis), kg m^2")
    yy: Moment = Field(description="moment about y, kg m^2")
    zz: Moment = Field(description="moment about z, kg m^2")
    xy: Product = Field(default=0.0, description="product of x and y, kg m^2")
    xz: Product = Field(default=0.0, description="product of x and z, kg m^2")
    yz: Product = Field(default=0.0, description="product of y and z, kg m^2")
    xy_sigma: ProductSigma = Field(default=0.0, description="1 sigma of the product of x and y, kg m^2")
    xz_sigma: ProductSigma = Field(default=0.0, description="1 sigma of the product of x and z, kg m^2")
    yz_sigma: ProductSigma = Field(default=0.0, description="1 sigma of the product of y and z, kg m^2")

    @model_validator(mode="after")
    def _physical(self) -> InertiaConfig:
        check_inertia(self.tensor)
        return self

    @property
    def product_sigma(self) -> tuple[float, float, float]:
        """One sigma of the products xy, xz and yz, kg m²."""
        return self.xy_sigma, self.xz_sigma, self.yz_sigma

    @property
    def tensor(self) -> Array:
        """Inertia tensor (3, 3), kg m²."""
        return np.array([[self.xx, -self.xy, -self.xz], [-self.xy, self.yy, -self.yz], [-self.xz, -self.yz, self.zz]])


class ParachuteConfig(Section):
    """The parachute."""

    area_diameter: Annotated[Number, Within("m", 0.1, 100.0, KM)] = Field(description="nominal diameter D0, m")
    drag_coefficient: Annotated[Number, Within("", 0.05, 3.0)] | None = Field(
        default=None, description="drag coefficient on pi D0^2 / 4, subsonic"
    )


class VehicleChangeConfig(Section):
    """What an event changes in the vehicle; also of an event of a simulated flight."""

    mass: Mass | None = Field(default=None, description="mass from this event on, kg")
    centre_of_mass_shift: LeverArm | None = Field(
        default=None,
        description="displacement of the centre of mass at this event, m, body axes; the IMUs are fixed to the "
        "structure, so that their positions from the centre of mass change by minus it",
    )
    inertia: InertiaConfig | None = Field(
        default=None, description="inertia about the centre of mass from this event on"
    )
    imu_positions: dict[str, LeverArm] = Field(
        default_factory=dict,
        description="positions of IMUs from the centre of mass from this event on, by name, m, body axes: of those "
        "that the event moves relative to the structure",
    )


class EventConfig(VehicleChangeConfig):
    """An event of the flight, and the vehicle's properties that change with it."""

    sclk: Sclk | None = Field(default=None, description="spacecraft clock count, s (or time_s)")
    time_s: Time | None = Field(default=None, description="time, s since the epoch (or sclk)")
    sigma_s: TimeSigma = Field(
        description="1 sigma of the time, s: axial force is compared with the database until three of them before the "
        "parachute; trajectories and the other events take the time as exact"
    )
    position: LeverArm | None = Field(
        default=None,
        description="driving IMU's position from the centre of mass from this event on, m, axes as under imus",
    )

    @model_validator(mode="after")
    def _single_time(self) -> EventConfig:
        if (self.sclk is None) == (self.time_s is None):
            raise field_error("neither" if self.sclk is None else "both", "one of sclk and time_s")
        return self


ComSigma = Annotated[Number, Within("m", 0.0, 1.0)]


class VehicleConfig(Section):
    """Mass properties and size of the vehicle, and the events that change them."""

    mass: Mass = Field(description="mass at entry, kg")
    mass_sigma: Annotated[Number, Within("kg", 0.0, 1e4)] = Field(default=0.0, description="1 sigma of the mass, kg")
    diameter: Annotated[Number, Within("m", 0.1, 50.0, KM)] = Field(
        description="diameter, m: reference length; reference area pi D^2 / 4"
    )
    centre_of_mass: Annotated[Number, Within("diameters", 0.0, 2.0)] = Field(
        description="distance of the centre of mass behind the nose, diameters"
    )
    centre_of_mass_offset: tuple[
        Annotated[Number, Within("diameters", -0.2, 0.2)], Annotated[Number, Within("diameters", -0.2, 0.2)]
    ] = Field(default=(0.0, 0.0), description="[y, z] of the centre of mass from the axis of symmetry, diameters")
    centre_of_mass_sigma: tuple[ComSigma, ComSigma, ComSigma] = Field(
        default=(0.0, 0.0, 0.0), description="1 sigma of the centre of mass along x, y and z, m; 0: exact"
    )
    inertia: InertiaConfig | None = Field(default=None, description="inertia at entry")
    inertia_sigma: Annotated[Number, Within("", 0.0, 1.0, PERCENT)] = Field(
        default=0.0, description="relative 1 sigma of a common factor of all moments and products"
    )
    parachute: ParachuteConfig | None = Field(default=None, description="parachute")
    events: dict[str, EventConfig] = Field(default_factory=dict, description="events by name, in order of time")

    @property
    def reference_area(self) -> float:
        """Reference area, m²."""
        return reference_area(self.diameter)
