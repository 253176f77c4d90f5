"""Quantities on which effects act: flow about the vehicle, aerodynamic coefficients, the vehicle as a rigid body."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from edl_filter.aero.conventions import reference_area
from edl_filter.types import Array


@dataclass(frozen=True)
class FlightCondition:
    """Position of the vehicle and its flow relative to the air, ``(N,)`` each unless stated otherwise.

    Attributes
    ----------
    time : array
        s since the epoch.
    altitude : array
        Areodetic, m.
    velocity_body : (N, 3) array
        Air-relative, m/s.
    rate : (N, 3) array
        Angular rate, rad/s, body axes.
    speed, density, mach, knudsen, dynamic_pressure : arrays
        m/s, kg/m³, 1, 1, Pa.
    alpha_total : array
        rad.
    diameter : float
        Reference length, m; the reference area is pi D²/4.
    """

    time: Array
    altitude: Array
    velocity_body: Array
    rate: Array
    speed: Array
    density: Array
    mach: Array
    knudsen: Array
    dynamic_pressure: Array
    alpha_total: Array
    diameter: float = np.nan

    @property
    def area(self) -> float:
        """Reference area, m²."""
        return reference_area(self.diameter)


@dataclass(frozen=True)
class AeroCoefficients:
    """Total coefficients in the plane of the total angle, ``(N,)`` each; the pitching moment is about the nose.

    Attributes
    ----------
    ca, cn, cm_nose : arrays
        Force along -x, force in the plane of the lateral flow, and nose-up moment in that plane.
    cl : array
        Rolling moment.
    cmq : array
        Pitch and yaw damping: moment coefficient over rate D / 2V.
    """

    ca: Array
    cn: Array
    cm_nose: Array
    cl: Array
    cmq: Array


@dataclass(frozen=True)
class Body:
    """The vehicle as a rigid body.

    Attributes
    ----------
    mass : float
        kg.
    inertia : (3, 3) array
        About the centre of mass, kg m²; elements off the diagonal are minus the products.
    offset : (3,) array
        Centre of mass relative to the point on the axis that the mission names, m, body axes: the mission's offset from
        the axis plus that of the effects. Instruments are fixed to the structure and do not move with it.
    """

    mass: float
    inertia: Array
    offset: Array = field(default_factory=lambda: np.zeros(3))

    def centre(self, x_over_d: float, diameter: float) -> tuple[float, float, float]:
        """Centre of mass in diameters: behind the nose, to the right (+y) and down (+z).

        Parameters
        ----------
        x_over_d : float
            The mission's point on the axis, diameters behind the nose.
        diameter : float
            m.
        """
        x, y, z = (float(d) / diameter for d in self.offset)
        return x_over_d - x, y, z
