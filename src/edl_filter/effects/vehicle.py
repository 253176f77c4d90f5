"""Effects in the vehicle as a rigid body: mass, centre of mass, products of inertia."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from edl_filter.effects.effect import Array, Body, Effect, Parameter, Values
from edl_filter.effects.sensors import components, vector


class Mass(Effect):
    """``m (1 + k)``."""

    name = "mass"
    family = "vehicle"
    summary = "another mass at entry: m (1 + k)"
    shows = (
        "Axial and lateral specific force are off by one factor from the first sensed deceleration to the parachute, "
        "as with the density; moments are not."
    )
    region = "up to the first event that states a mass"
    source = "mass budgets of Mars entry vehicles before launch; the moments tell it from a density"
    parameters = (Parameter("k", "", "relative change of the mass", 0.07, low=-0.5, high=1.0),)

    def vehicle(self, p: Values, body: Body) -> Body:
        """The heavier body; its inertia is a statement of its own."""
        return replace(body, mass=body.mass * (1.0 + p["k"]))


class CentreOfMassOffset(Effect):
    """Centre of mass moved by d; the IMUs stay bolted where they are."""

    name = "com_offset"
    family = "vehicle"
    summary = "centre of mass moved by d; the IMUs stay bolted where they are"
    shows = (
        "A body-fixed moment in proportion to the axial force: the vehicle trims at an angle, largest in moments near "
        "peak dynamic pressure; on a spinning vehicle the trim turns with "
        "the body."
    )
    region = "up to the first event that moves the centre of mass"
    source = "balance tolerances of entry capsules, some millimetres across the axis"
    parameters = vector("d", "m", "displacement", 5e-3, 0.2)

    def vehicle(self, p: Values, body: Body) -> Body:
        """The displaced body; the inertia about the new point differs by m d², which is left out."""
        return replace(body, offset=body.offset + components(p, "d"))


class ProductsOfInertia(Effect):
    """``Ixy + a, Ixz + b, Iyz + c``; tensor elements are minus the products."""

    name = "products_of_inertia"
    family = "vehicle"
    summary = "other products of inertia: Ixy + a, Ixz + b, Iyz + c"
    shows = (
        "On a spinning vehicle the moments keep a constant part in body axes even where the air is too thin to exert "
        "one; where it swings, the rolling moment follows the lateral angular accelerations."
    )
    source = "balancing of a spinning entry vehicle; Thomas (2011), eqs. 6.6 to 6.8"
    parameters = (
        Parameter("a", "kg m^2", "change of Ixy", 8.0, low=-100.0, high=100.0),
        Parameter("b", "kg m^2", "change of Ixz", 8.0, low=-100.0, high=100.0),
        Parameter("c", "kg m^2", "change of Iyz", 8.0, low=-100.0, high=100.0),
    )

    def vehicle(self, p: Values, body: Body) -> Body:
        """The body with another tensor."""
        a, b, c = p["a"], p["b"], p["c"]
        products: Array = np.array([[0.0, a, b], [a, 0.0, c], [b, c, 0.0]])
        return replace(body, inertia=body.inertia - products)


EFFECTS = (Mass, CentreOfMassOffset, ProductsOfInertia)
