"""Simulation of flights with six degrees of freedom and chosen effects.

In: a `Scenario` (entry conditions, instruments, errors) that names a mission for the nominal model. Out: a `Flight`, or
its flight file, with the truth. Tables and effects are shared with the reconstruction, the integrator (`dynamics`) is
not.

Read in this order: `scenario`, `simulate` (with the entry state); then `motion` (phases and events), which
integrates the equations of `dynamics` on the arrays of `tables` with the `increments` of effects, and `parachute`;
`sensors` (readings of the IMUs), `chance` (random errors of the atmosphere), `flight` (the result).

Campaigns and studies draw more: `database_errors`, `air_errors`, `model_errors` and `world_errors` (what they change),
`campaign_config` (the file of a campaign) and `dispersion` (one case of it).
"""

from edl_filter.simulation.flight import Flight
from edl_filter.simulation.scenario import Scenario
from edl_filter.simulation.simulate import simulate

__all__ = ["Flight", "Scenario", "simulate"]
