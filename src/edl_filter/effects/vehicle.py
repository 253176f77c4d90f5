"""Effects in the vehicle as a rigid body: mass, centre of mass, products of inertia."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from edl_filter.effects.base import Effect
from edl_filter.effects.parameters import Parameter, Values
from edl_filter.effects.sensors import components, vector
from edl_filter.effects.types import Body
from edl_filter.types import Array


class Mass(Effect):
    """``m (1 + k)``."""

    name = "mass"
    family = "vehicle"
    summary = "relative change of the mass at entry: m (1 + k)"
    shows = (
        "Axial and lateral specific force differ by one factor from the first sensed deceleration to the parachute, "
        "as with the density; moments do not."
    )
    region = "up to the parachute; a mass that an event states before it has the same factor"
    source = "mass budgets of Mars entry vehicles before launch; the moments distinguish it from a density"
    parameters = (Parameter("k", "", "relative change of the mass", 0.07, low=-0.5, high=1.0),)

    def vehicle(self, p: Values, body: Body) -> Body:
        """The body with the scaled mass; its inertia is stated independently and stays."""
        return replace(body, mass=body.mass * (1.0 + p["k"]))


class CentreOfMassOffset(Effect):
    """Centre of mass displaced by d; the IMUs are fixed to the structure."""

    name = "com_offset"
    family = "vehicle"
    summary = "centre of mass displaced by d; the IMUs are fixed to the structure"
    shows = (
        "A body-fixed moment in proportion to the axial force: the vehicle trims at an angle, largest in moments near "
        "peak dynamic pressure; on a spinning vehicle the trim rotates with the body."
    )
    region = "up to the first event that states a position from the centre of mass anew; a shift is added to it"
    source = "balance tolerances of entry capsules, some millimetres across the axis"
    parameters = vector("d", "m", "displacement", 5e-3, 0.2)

    def vehicle(self, p: Values, body: Body) -> Body:
        """The body with its centre of mass displaced; the change of the inertia by m d² is neglected."""
        return replace(body, offset=body.offset + components(p, "d"))


class ProductsOfInertia(Effect):
    """``Ixy + a, Ixz + b, Iyz + c``; elements of the tensor are minus the products."""

    name = "products_of_inertia"
    family = "vehicle"
    summary = "changed products of inertia: Ixy + a, Ixz + b, Iyz + c"
    shows = (
        "On a spinning vehicle the moments have a constant part in body axes even where the air is too thin to exert "
        "one; where it oscillates, the rolling moment follows the lateral angular accelerations."
    )
    source = "balancing of a spinning entry vehicle; Thomas (2011), eqs. 6.6 to 6.8"
    parameters = (
        Parameter("a", "kg m^2", "change of Ixy", 8.0, low=-100.0, high=100.0),
        Parameter("b", "kg m^2", "change of Ixz", 8.0, low=-100.0, high=100.0),
        Parameter("c", "kg m^2", "change of Iyz", 8.0, low=-100.0, high=100.0),
    )

    def vehicle(self, p: Values, body: Body) -> Body:
        """The body with the changed tensor."""
        a, b, c = p["a"], p["b"], p["c"]
        products: Array = np.array([[0.0, a, b], [a, 0.0, c], [b, c, 0.0]])
        return replace(body, inertia=body.inertia - products)


EFFECTS = (Mass, CentreOfMassOffset, ProductsOfInertia)
