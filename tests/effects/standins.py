"""A stretch of flight, a body, a planet and an entry state for tests of single effects, and what an effect changes."""

import numpy as np

from edl_filter.effects import AeroCoefficients, Body, EffectInstance, FlightCondition
from edl_filter.effects.registry import find_effect
from edl_filter.planet import Planet
from edl_filter.telemetry.record import InitialState

N = 7
T = np.linspace(100.0, 130.0, N)
H = np.linspace(50e3, 8e3, N)
FORCE, RATE = np.tile([-40.0, 2.0, 0.0], (N, 1)), np.tile([0.2, 0.0, -0.1], (N, 1))
PLANET = Planet("mars", 4.28e13, 1.96e-3, 3396190.0, 3396190.0, 1 / 170, 7.088e-5, 0.0)


def flow(**changes):
    velocity = np.stack((np.linspace(5e3, 400.0, N), np.full(N, 30.0), np.full(N, -40.0)), axis=1)
    speed = np.linalg.norm(velocity, axis=1)
    values = {
        "time": T, "altitude": H, "velocity_body": velocity, "rate": np.full((N, 3), 0.1), "speed": speed,
        "density": 1e-2 * np.exp(-H / 11e3), "mach": speed / 200.0, "knudsen": np.full(N, 1e-5),
        "dynamic_pressure": np.linspace(100.0, 7e3, N), "alpha_total": np.linspace(0.0, 0.2, N), "diameter": 2.65,
    }  # fmt: skip
    return FlightCondition(**(values | changes))


def totals():
    return AeroCoefficients(
        np.full(N, 1.7), np.linspace(0.0, 0.05, N), np.linspace(0.0, -0.02, N), np.zeros(N), np.full(N, -0.1)
    )


BODY = Body(832.0, np.diag([270.0, 205.0, 210.0]))
STATE = InitialState(0.0, np.array([3.5e6, 1e5, 0.0]), np.array([-3e3, 4e3, 1e3]), np.array([0, 0, 0, 1.0]), np.eye(9))


def on(name, **values):
    effect = find_effect(name)
    return effect, EffectInstance(effect, values).values


def changes(name, flight=None, **values):
    """Changes of all coefficients by an effect, by name."""
    effect, p = on(name, **values)
    before = totals()
    after = effect.coefficients(p, flow() if flight is None else flight, before)
    return {c: getattr(after, c) - getattr(before, c) for c in ("ca", "cn", "cm_nose", "cl", "cmq")}


def only(changed, name):
    """The change of one coefficient, where no other one changes."""
    assert all(not values.any() for c, values in changed.items() if c != name)
    return changed[name]
