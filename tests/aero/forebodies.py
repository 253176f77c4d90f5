"""Forebodies that the tests of `edl_filter.aero` share, and the centre of pressure of their coefficients."""

import math

from edl_filter.aero.body import SphereCone

MER = SphereCone(2.65, 0.6625, 0.0662, math.radians(70.0))
STARDUST = SphereCone(0.8128, 0.2286, 0.01905, math.radians(60.0))
HUYGENS = SphereCone(2.7, 1.25, 0.05, math.radians(60.0))
HEMISPHERE = SphereCone(2.0, 1.0, 0.0, 0.0)
DISC = SphereCone(2.0, 0.0, 0.0, math.pi / 2.0)


def centre_of_pressure(cn, cm_nose):
    """Distance of the centre of pressure behind the nose, in diameters; for small angles −Cmα/CNα."""
    return -cm_nose / cn
