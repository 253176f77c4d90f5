"""A flight with a torque that begins later in the model than it did: models whose time is wrong."""

from dataclasses import replace

from edl_filter import Mission
from edl_filter.diagnosis.linear_model.flight_case import load_case
from edl_filter.diagnosis.linear_model.linearization import linearize
from edl_filter.effects import EffectInstance
from edl_filter.effects.registry import find_effect
from edl_filter.simulation import Scenario, simulate

TORQUE = {"Cl": 0.0, "Cm": -4e-4, "Cn": 8e-4, "t0": 120.26}
LATE_S = 0.7


def late_model_of(folder):
    """A torque that begins at 120.26 s, linearised with one that begins 0.7 s later."""
    torque = find_effect("remnant_torque")
    path = folder / "flight.h5"
    simulate(Scenario.load("builtin:mer"), [EffectInstance(torque, TORQUE)], 5).write(path)
    mission = Mission.load("builtin:practice_mer", [f"telemetry.path={path}"])
    return linearize(load_case(mission, (EffectInstance(torque, TORQUE | {"t0": TORQUE["t0"] + LATE_S}),)))


def with_torque(model, **values):
    """The model linearised about a reconstruction with other values of its torque."""
    (late,) = model.effects
    return linearize(load_case(model.case.mission, (replace(late, values=late.values | values),)))
