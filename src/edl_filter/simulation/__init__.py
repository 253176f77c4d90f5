"""Flights with six degrees of freedom and chosen effects: from a scenario to a flight file with its truth.

In: a `Scenario` (entry conditions, instruments, errors) that names a mission for the nominal model. Out: a `Flight`,
or its flight file. Tables and effects are shared with the reconstruction, the integrator (`dynamics`) is not.
"""

from edl_filter.simulation.flight import Flight
from edl_filter.simulation.scenario import Scenario
from edl_filter.simulation.simulate import simulate

__all__ = ["Flight", "Scenario", "simulate"]
