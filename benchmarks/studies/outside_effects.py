"""Effects that no catalogue contains, for the studies of identification: the right verdict on them is `unknown`."""

import numpy as np

from edl_filter.effects.base import Effect, EffectInstance
from edl_filter.effects.parameters import Parameter


class Jet(Effect):
    """An oscillating jet: torque about y and a force along z."""

    name = "oscillating_jet"
    parameters = (Parameter("A", "N m", "torque", 5.0), Parameter("f", "Hz", "frequency", kind="frequency"))

    def force_moment(self, p, flow):
        active = (flow.time > 70.0) & (flow.time < 160.0)
        torque = np.where(active, p["A"] * np.sin(2.0 * np.pi * p["f"] * flow.time), 0.0)
        zero = np.zeros_like(torque)
        return np.column_stack((zero, zero, 2.0 * torque)), np.column_stack((zero, torque, zero))


class Leak(Effect):
    """A steady leak: force along y and torque about z, of constant size, from 90 s on."""

    name = "leak"
    parameters = (Parameter("F", "N", "force", 20.0),)

    def force_moment(self, p, flow):
        force = np.where(flow.time > 90.0, p["F"], 0.0)
        zero = np.zeros_like(force)
        return np.column_stack((zero, force, zero)), np.column_stack((zero, zero, 0.5 * force))


class Slosh(Effect):
    """Torque proportional to the rate and the square of the angle of attack: no damping of the catalogue."""

    name = "slosh"
    parameters = (Parameter("k", "N m s", "size", 3e2),)

    def force_moment(self, p, flow):
        size = p["k"] * flow.alpha_total**2
        return np.zeros_like(flow.rate), size[:, None] * flow.rate * np.array([0.0, 1.0, 1.0])


class ThrusterPulses(Effect):
    """A thruster that fires half a second every six seconds, from 60 s to 200 s: force along y and torque about z."""

    name = "thruster_pulses"
    parameters = (Parameter("T", "N m", "torque", 10.0),)

    def force_moment(self, p, flow):
        active = (flow.time > 60.0) & (flow.time < 200.0) & (np.mod(flow.time, 6.0) < 0.5)
        torque = np.where(active, p["T"], 0.0)
        zero = np.zeros_like(torque)
        return np.column_stack((zero, torque, zero)), np.column_stack((zero, zero, torque))


class ThermalDrift(Effect):
    """An accelerometer whose zero drifts along x and y after peak heating, from 100 s on, within 40 s."""

    name = "thermal_drift"
    parameters = (Parameter("a", "m/s2", "final zero offset", 0.008),)

    def _offset(self, p, time):
        offset = p["a"] * (1.0 - np.exp(-np.maximum(time - 100.0, 0.0) / 40.0))
        return np.column_stack((offset, offset, np.zeros_like(offset)))

    def imu(self, p, time, force, rate):
        return force + self._offset(p, time), rate

    def corrected(self, p, time, force, rate):
        return force - self._offset(p, time), rate


class JetDamping(Effect):
    """Torque proportional to the lateral rate, whatever the air."""

    name = "jet_damping"
    parameters = (Parameter("k", "N m s", "size", 0.2),)

    def force_moment(self, p, flow):
        return np.zeros_like(flow.rate), p["k"] * flow.rate * np.array([0.0, 1.0, 1.0])


class SpinningWheel(Effect):
    """A wheel that spins about x: torque across the lateral rate."""

    name = "spinning_wheel"
    parameters = (Parameter("h", "N m s", "angular momentum", 0.2),)

    def force_moment(self, p, flow):
        zero = np.zeros_like(flow.time)
        return np.zeros_like(flow.rate), p["h"] * np.column_stack((zero, -flow.rate[:, 2], flow.rate[:, 1]))


class MagnusMoment(Effect):
    """Torque in the plane of the angle of attack, proportional to it, to the spin and to the dynamic pressure."""

    name = "magnus_moment"
    parameters = (Parameter("M", "m3", "size: coefficient times area times diameter", 1.5),)

    def force_moment(self, p, flow):
        size = p["M"] * flow.dynamic_pressure * flow.rate[:, 0] * _DIAMETER / (2.0 * flow.speed)
        lateral = np.array([0.0, 1.0, 1.0]) * flow.velocity_body / flow.speed[:, None]
        return np.zeros_like(flow.rate), size[:, None] * lateral


#: m, about that of both vehicles.
_DIAMETER = 2.65
#: Effects by name, with typical values.
OUTSIDE_EFFECTS = {
    "oscillating_jet": (Jet(), {"A": 5.0, "f": 0.7}),
    "leak": (Leak(), {"F": 20.0}),
    "slosh": (Slosh(), {"k": 3e2}),
    "thruster_pulses": (ThrusterPulses(), {"T": 10.0}),
    "thermal_drift": (ThermalDrift(), {"a": 0.008}),
    "jet_damping": (JetDamping(), {"k": 0.2}),
    "spinning_wheel": (SpinningWheel(), {"h": 0.2}),
    "magnus_moment": (MagnusMoment(), {"M": 1.5}),
}


def random_outside_instance(name, random):
    """An effect of 0.7 to 1.4 times its typical size, with a random sign, and a frequency of 0.3 to 1.1 Hz."""
    effect, typical = OUTSIDE_EFFECTS[name]
    values = {}
    for q in effect.parameters:
        if q.kind == "frequency":
            values[q.name] = float(random.uniform(0.3, 1.1))
        else:
            values[q.name] = float(typical[q.name] * random.choice([-1.0, 1.0]) * random.uniform(0.7, 1.4))
    return EffectInstance(effect, values)
