"""Effects in the aerodynamics: errors of the database, and torques that it does not contain.

Total coefficients act in the plane of the total angle; the pitching moment is about the nose
(`edl_filter.effects.types.AeroCoefficients`).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from edl_filter.aero.regimes import DYNAMIC_INSTABILITY_MACH
from edl_filter.effects.base import Effect
from edl_filter.effects.parameters import Parameter, Values
from edl_filter.effects.types import AeroCoefficients, FlightCondition
from edl_filter.types import Array

#: The effect on the base pressure acts below this Mach number.
_BASE_MACH = 10.0
#: Width in Mach number and range in angle (rad) of the static instability.
_WIDTH, _RANGE = 4.0, np.radians(8.0)


class AxialForceScale(Effect):
    """``CA (1 + k)``."""

    name = "axial_force_scale"
    family = "aerodynamics"
    summary = "axial force of the database: CA (1 + k)"
    shows = (
        "The axial force alone differs by a factor, lateral forces do not; where the density is estimated from the "
        "axial force, CN and CY have the factor instead."
    )
    source = "MEVAD's 3 sigma of CA, Thomas (2011), table 11.3"
    parameters = (Parameter("k", "", "relative change of CA", 0.05, low=-0.5, high=0.5),)

    def coefficients(self, p: Values, flow: FlightCondition, totals: AeroCoefficients) -> AeroCoefficients:
        """Scaled CA."""
        return replace(totals, ca=totals.ca * (1.0 + p["k"]))


class BasePressure(Effect):
    """``CA + a (1 − M/10)²`` for M < 10."""

    name = "base_pressure"
    family = "aerodynamics"
    summary = "pressure on the base: CA + a (1 - M/10)^2"
    shows = "The residual of the axial force grows below Mach 10 and is largest at the parachute."
    region = "Mach < 10"
    source = "base pressure of Viking's flights, Thomas (2011), eqs. 11.3 and 11.4"
    parameters = (Parameter("a", "", "added CA at Mach 0", 0.15, low=-1.0, high=1.0),)

    def coefficients(self, p: Values, flow: FlightCondition, totals: AeroCoefficients) -> AeroCoefficients:
        """Added CA."""
        return replace(totals, ca=totals.ca + p["a"] * np.maximum(1.0 - flow.mach / _BASE_MACH, 0.0) ** 2)


class NormalForceScale(Effect):
    """``CN (1 + k)``."""

    name = "normal_force_scale"
    family = "aerodynamics"
    summary = "normal force of the database: CN (1 + k)"
    shows = (
        "Residuals of the lateral forces are in proportion to the forces and follow the oscillation in angle; those of "
        "the moments are small."
    )
    source = (
        "CN of a blunt body is the small difference of large numbers; MEVAD's 3 sigma of CN is 0.01: Thomas (2011), "
        "section 5"
    )
    parameters = (Parameter("k", "", "relative change of CN", 0.35, low=-1.5, high=3.0),)

    def coefficients(self, p: Values, flow: FlightCondition, totals: AeroCoefficients) -> AeroCoefficients:
        """Scaled CN."""
        return replace(totals, cn=totals.cn * (1.0 + p["k"]))


class PitchingMomentScale(Effect):
    """``Cm (1 + k)`` about the nose."""

    name = "pitching_moment_scale"
    family = "aerodynamics"
    summary = "pitching moment of the database about the nose: Cm (1 + k)"
    shows = (
        "Residuals of pitching and yawing moments are in proportion to the angle at all Mach numbers: the vehicle "
        "oscillates faster or slower than the model, while lateral forces agree."
    )
    source = (
        "Thomas (2011), table 11.3 has MEVAD's 3 sigma of Cm, but its digits are missing in the text; the size is "
        "assumed"
    )
    parameters = (Parameter("k", "", "relative change of Cm about the nose", 0.2, low=-1.0, high=2.0),)

    def coefficients(self, p: Values, flow: FlightCondition, totals: AeroCoefficients) -> AeroCoefficients:
        """Scaled Cm."""
        return replace(totals, cm_nose=totals.cm_nose * (1.0 + p["k"]))


class StaticInstability(Effect):
    """``Cm + a exp(−((M − M0)/4)²) sin(pi min(alpha, 8°)/8°)``, nose-up."""

    name = "static_instability"
    family = "aerodynamics"
    summary = "nose-up moment at small angles about one Mach number: a exp(-((M - M0)/4)^2) sin(pi alpha/8 deg)"
    shows = (
        "About one hypersonic Mach number the restoring moment is smaller than the model's, below 8 degrees only: the "
        "vehicle trims at a non-zero angle and its oscillation slows there."
    )
    region = "total angle < 8 degrees, within about 6 of Mach M0"
    source = "static instabilities of 70-degree cones, where the sonic line moves; Edquist et al., AIAA 2008-7219"
    parameters = (
        Parameter("a", "", "added Cm", 4e-3, low=-0.05, high=0.05),
        Parameter("M0", "", "Mach number of its maximum", kind="mach", low=10.0, high=26.0, scan=5, default=18.0),
    )

    def coefficients(self, p: Values, flow: FlightCondition, totals: AeroCoefficients) -> AeroCoefficients:
        """Added Cm."""
        near = np.exp(-(((flow.mach - p["M0"]) / _WIDTH) ** 2))
        small = np.sin(np.pi * np.minimum(flow.alpha_total, _RANGE) / _RANGE)
        return replace(totals, cm_nose=totals.cm_nose + p["a"] * near * small)


class PitchDamping(Effect):
    """``Cmq + a`` below Mach 3.5, about body y and z."""

    name = "pitch_damping"
    family = "aerodynamics"
    summary = "pitch and yaw damping in the range of dynamic instability: Cmq + a"
    shows = (
        "Below Mach 3.5 residuals of the moments follow the rates instead of the angles: the oscillation before the "
        "parachute grows faster, or slower, than the model's."
    )
    region = "Mach < 3.5"
    source = "ballistic-range tests of the MER and Phoenix capsules"
    parameters = (Parameter("a", "", "added Cmq", 0.6, low=-5.0, high=5.0),)

    def coefficients(self, p: Values, flow: FlightCondition, totals: AeroCoefficients) -> AeroCoefficients:
        """Added damping."""
        return replace(totals, cmq=totals.cmq + np.where(flow.mach < DYNAMIC_INSTABILITY_MACH, p["a"], 0.0))


class RollingMoment(Effect):
    """``Cl = k alpha_total + c``."""

    name = "rolling_moment"
    family = "aerodynamics"
    summary = "rolling moment of a body that is not exactly axisymmetric: Cl = k alpha_total + c"
    shows = (
        "The spin rate changes in proportion to dynamic pressure and angle, about x alone; the model has no rolling "
        "moment."
    )
    source = "Thomas (2011), section 7.3: Cl of about 5e-6 on Spirit, uncertainty of 1.24e-6 in Phoenix's database"
    parameters = (
        Parameter("k", "1/rad", "slope in the total angle", 5e-4, low=-0.05, high=0.05),
        Parameter("c", "", "constant part", 5e-6, low=-1e-3, high=1e-3),
    )

    def coefficients(self, p: Values, flow: FlightCondition, totals: AeroCoefficients) -> AeroCoefficients:
        """Added Cl."""
        return replace(totals, cl=totals.cl + p["k"] * flow.alpha_total + p["c"])


class RemnantTorque(Effect):
    """Body-fixed moment ``(Cl, Cm, Cn) q S D`` from t0, to t1 if that is finite."""

    name = "remnant_torque"
    family = "aerodynamics"
    summary = "body-fixed torque of an attached remnant: constant Cl, Cm, Cn from t0 on"
    shows = (
        "From t0 on pitching and yawing moments have a constant part in body axes, in proportion to the dynamic "
        "pressure, which does not average to zero over a turn."
    )
    region = "from t0 to t1"
    source = (
        "remnants of the thermal blanket on Spirit and Opportunity; Tolson et al., AAS 06-087; Thomas (2011), section 7"
    )
    parameters = (
        Parameter("Cl", "", "rolling moment coefficient", 5e-6, low=-1e-3, high=1e-3),
        Parameter("Cm", "", "pitching moment coefficient", 1.5e-3, low=-0.05, high=0.05),
        Parameter("Cn", "", "yawing moment coefficient", 1e-3, low=-0.05, high=0.05),
        Parameter("t0", "s", "beginning, since the epoch", kind="time", scan=40),
        Parameter("t1", "s", "end, since the epoch; infinite: never", kind="time", default=np.inf),
    )

    def force_moment(self, p: Values, flow: FlightCondition) -> tuple[Array, Array]:
        """A moment without a force."""
        acting = (flow.time >= p["t0"]) & (flow.time < p["t1"])
        size = np.where(acting, flow.dynamic_pressure, 0.0) * flow.area * flow.diameter
        return np.zeros((len(size), 3)), size[:, None] * np.array([p["Cl"], p["Cm"], p["Cn"]])


EFFECTS = (
    AxialForceScale, BasePressure, NormalForceScale, PitchingMomentScale, StaticInstability, PitchDamping,
    RollingMoment, RemnantTorque,
)  # fmt: skip
