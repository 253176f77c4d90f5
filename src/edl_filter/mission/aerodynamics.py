"""Sections of the aerodynamic database and of the post-flight analysis."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Literal

from pydantic import Field, StringConstraints, model_validator

from edl_filter.aero.discrepancy import DiscrepancyPrior
from edl_filter.aero.regimes import CONTINUUM_KNUDSEN
from edl_filter.mission.fields import DEG, Section, WindowConfig
from edl_filter.mission.validators import Number, Switch, Within, field_error, value_text


class ForebodyConfig(Section):
    """Sphere-cone: spherical nose, cone, and rounded shoulder up to the vehicle's diameter."""

    nose_radius: Annotated[Number, Within("m", 0.0, 25.0)] = Field(description="radius of the nose, m")
    shoulder_radius: Annotated[Number, Within("m", 0.0, 25.0)] = Field(description="radius of the shoulder, m")
    cone_half_angle_deg: Annotated[Number, Within("deg", 0.0, 90.0)] = Field(
        description="angle between axis and cone, deg"
    )

    @property
    def cone_half_angle(self) -> float:
        """`cone_half_angle_deg` in rad."""
        return self.cone_half_angle_deg * DEG


class DiscrepancyConfig(Section):
    """The database's error as a Gaussian random field over the flow."""

    log_mach_length: Annotated[Number, Within("", 0.0, 10.0, above=True)] = Field(
        default=0.5,
        description="correlation length in the natural logarithm of the Mach number: tables have a node every 0.2 to "
        "0.5 of it, and shock shape and sonic line change over a factor of 1.6",
    )
    log_knudsen_length: Annotated[Number, Within("", 0.0, 10.0, above=True)] = Field(
        default=1.0, description="correlation length in the decimal logarithm of the Knudsen number, in rarefied flow"
    )
    angle_length_deg: Annotated[Number, Within("deg", 0.0, 180.0, above=True)] = Field(
        default=6.0, description="correlation length in the total angle of attack, deg: a few nodes of the tables"
    )
    vanishing_angle_deg: Annotated[Number, Within("deg", 0.0, 90.0, above=True)] = Field(
        default=4.0,
        description="angle below which the errors of CN and Cm vanish by symmetry, as tanh(angle / it), deg",
    )
    asymmetry_sigma: Annotated[Number, Within("", 0.0, 10.0)] = Field(
        default=0.0,
        description="asymmetry: CN, CY, Cm and Cn that are fixed to the body and vary with Mach or Knudsen number over "
        "the lengths above; 1 sigma over the database's own, which is additive at any angle; 0: axisymmetric",
    )
    rolling_sigma: Annotated[Number, Within("", 0.0, 1e-3)] = Field(
        default=0.0,
        description="1 sigma of a constant Cl, which the tables do not have; 0: none. MEVAD states 1.24e-6 as 3 sigma",
    )
    damping_sigma: Annotated[Number, Within("", 0.0, 5.0)] = Field(
        default=0.0, description="1 sigma of the damping coefficient Cmq below Mach 3.5; 0: exact"
    )
    estimate: tuple[Literal["coefficient_sigma", "log_mach_length", "log_knudsen_length", "angle_length_deg"], ...] = (
        Field(
            default=(),
            description="which of coefficient_sigma, log_mach_length, log_knudsen_length and angle_length_deg a "
            "diagnosis estimates by marginal likelihood, within diagnosis.discrepancy_range of its value; absent: none",
        )
    )

    @model_validator(mode="after")
    def _each_once(self) -> DiscrepancyConfig:
        if len(set(self.estimate)) < len(self.estimate):
            raise field_error(value_text(list(self.estimate)), "each name once", "estimate")
        return self


class AerodynamicsConfig(Section):
    """Which tables of the Mars entry vehicle aerodynamic database the flight is compared with."""

    family: Literal["MER", "Phoenix"] = Field(description="vehicle whose database uncertainties apply: MER or Phoenix")
    continuum: str = Field(
        default="builtin:surrogate",
        description="continuum database: builtin:surrogate, builtin:continuum_grid, builtin:newtonian (the forebody's, "
        "modified Newtonian), or a CSV mach,alpha_deg,CA,CN,Cm",
    )
    base_pressure: Switch = Field(
        default=False, description="subtract Viking's base pressure from CA: for a continuum database of a forebody"
    )
    forebody: ForebodyConfig | None = Field(
        default=None, description="for builtin:newtonian and builtin:free_molecular; absent: the family's"
    )
    rarefied: str = Field(
        default="builtin:free_molecular",
        description="rarefied database: builtin:free_molecular (bridged), builtin:rarefied_grid, "
        "or a CSV knudsen,alpha_deg,CA,CN,Cm",
    )
    continuum_moment_point: Annotated[Number, Within("diameters", 0.0, 2.0)] | None = Field(
        default=None,
        description="moment reference point behind the nose, diameters: the continuum CSV is in the thesis's printed "
        "form, mach,alpha_total_deg,CA,CN,Cm; absent: moments about the nose",
    )
    rarefied_moment_point: Annotated[Number, Within("diameters", 0.0, 2.0)] | None = Field(
        default=None, description="the same for the rarefied CSV, knudsen,alpha_total_deg,CA,CN,Cm"
    )
    proxy: str | None = Field(
        default=None,
        description="text: whose database stands in for the vehicle's own, which every headline of a diagnosis then "
        "says; absent: the database is the vehicle's own",
    )
    interpolation: Literal["linear", "pchip"] = Field(
        default="linear", description="of tables in the angle: linear, or pchip (smooth, odd in CN and Cm)"
    )
    join: Literal["continuous", "switch", "blend"] | None = Field(
        default=None,
        description="how the two join at the continuum limit: continuous, switch or blend; absent: continuous for "
        "builtin:free_molecular, switch for a table",
    )
    continuum_limit: Annotated[Number, Within("", 1e-5, 1.0)] = Field(
        default=CONTINUUM_KNUDSEN, description="Knudsen number on D above which the rarefied database applies"
    )
    velocity_per_mach: Annotated[Number, Within("m/s", 50.0, 1000.0)] | None = Field(
        default=None,
        description="m/s: look the hypersonic part up by speed over this value, not by Mach: for a table of another "
        "trajectory",
    )
    damping: str | None = Field(
        default=None,
        description="pitch and yaw damping: builtin:practice_damping, or a CSV mach,Cmq; absent: no damping",
    )
    increments: str | None = Field(
        default=None,
        description="increments of the database that another flight gives, with their covariance: the "
        "database_update.nc that diagnose writes; without the covariance if coefficient_sigma is 0; absent: none",
    )
    coefficient_sigma: Annotated[Number, Within("", 0.0, 10.0)] = Field(
        default=1.0,
        description="1 sigma of the database's error, in units of its own sigma (a third of its family's 3 sigma); "
        "0: exact",
    )

    discrepancy: DiscrepancyConfig = Field(
        default_factory=DiscrepancyConfig, description="correlation lengths of the database's error"
    )

    def with_discrepancy(self, values: Mapping[str, float]) -> AerodynamicsConfig:
        """These settings with other values of keys that `discrepancy.estimate` can name, and nothing to estimate."""
        scale = values.get("coefficient_sigma", self.coefficient_sigma)
        lengths = {name: value for name, value in values.items() if name != "coefficient_sigma"}
        discrepancy = self.discrepancy.model_copy(update={**lengths, "estimate": ()})
        return self.model_copy(update={"coefficient_sigma": scale, "discrepancy": discrepancy})

    @property
    def discrepancy_prior(self) -> DiscrepancyPrior:
        """Prior of the database's discrepancy."""
        c = self.discrepancy
        return DiscrepancyPrior(
            scale=self.coefficient_sigma,
            log_mach_length=c.log_mach_length,
            log_knudsen_length=c.log_knudsen_length,
            angle_length=c.angle_length_deg * DEG,
            vanishing_angle=c.vanishing_angle_deg * DEG,
            asymmetry=c.asymmetry_sigma,
        )

    @model_validator(mode="after")
    def _joins(self) -> AerodynamicsConfig:
        if self.join == "continuous" and self.rarefied != "builtin:free_molecular":
            raise field_error("'continuous'", "switch or blend, since this rarefied database is a table", "join")
        if self.discrepancy.estimate and self.coefficient_sigma == 0.0:
            raise field_error(
                value_text(list(self.discrepancy.estimate)),
                "none, since coefficient_sigma is 0, an exact database",
                "discrepancy.estimate",
            )
        return self


class NamedWindowConfig(WindowConfig):
    """A span of time over which coefficient differences are averaged."""

    name: Annotated[str, StringConstraints(min_length=1)] = Field(description="name of the window in tables")


class PostflightConfig(Section):
    """Settings with which atmosphere and coefficients are derived after the flight."""

    batch_s: Annotated[Number, Within("s", 0.0, 30.0, above=True)] = Field(
        default=0.875, description="length of the second-order batch polynomial that smooths rates and forces, s"
    )
    low_pass_hz: Annotated[Number, Within("Hz", 0.0, 1e3, (("kHz", 1e3),), above=True)] | None = Field(
        default=None,
        description="half-power frequency of one pass of a zero-phase low-pass of rates and forces before the batches, "
        "Hz, below half the sampling frequency; evenly spaced samples only; absent: none",
    )
    top_temperature: Annotated[Number, Within("K", 10.0, 3000.0)] | None = Field(
        default=None,
        description="temperature where deceleration is first measurable, K: determines the pressure there; "
        "absent: zero pressure there",
    )
    top_temperature_sigma: Annotated[Number, Within("K", 0.0, 1000.0)] = Field(
        default=0.0, description="1 sigma of top_temperature, K"
    )
    windows: tuple[NamedWindowConfig, ...] | None = Field(
        default=None, description="windows of the average differences; absent: determined from the flight"
    )
