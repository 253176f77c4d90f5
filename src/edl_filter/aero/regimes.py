"""Mach and Knudsen numbers that bound the flow regimes of a Mars entry."""

from __future__ import annotations

#: Mach numbers between the hypersonic and supersonic regimes of the flight (Thomas 2011, sections 6 and 7).
BOUNDARY_MACH = (25.0, 15.0, 5.0)
#: Mach number below which the oscillation of a blunt capsule may be dynamically unstable.
DYNAMIC_INSTABILITY_MACH = 3.5
#: Knudsen numbers, based on the diameter, below which flow is continuum flow and above which it is free-molecular: the
#: ends of the bridging function. A mission may state another continuum limit (``aerodynamics.continuum_limit``).
CONTINUUM_KNUDSEN, FREE_MOLECULAR_KNUDSEN = 1e-3, 10.0
