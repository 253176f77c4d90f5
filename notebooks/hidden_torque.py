"""The effect that is hidden in the flight of notebook 4. Read it only when the notebook refers to it."""

import numpy as np

from edl_filter.effects import Effect, Parameter


class HiddenTorque(Effect):
    """A leaking thruster: an oscillating torque about the pitch axis that does not depend on the air density."""

    name = "hidden_torque"
    summary = "A sin(2 pi f t) about y from t0 to t1"
    parameters = (
        Parameter("A", "N m", "amplitude", 5.0, low=-50.0, high=50.0),
        Parameter("f", "Hz", "frequency", kind="frequency", low=0.1, high=3.0, default=0.8),
        Parameter("t0", "s", "beginning", kind="time"),
        Parameter("t1", "s", "end", kind="time", default=np.inf),
    )

    def force_moment(self, p, flow):
        """Force zero; moment about y from t0 to t1."""
        active = (flow.time >= p["t0"]) & (flow.time < p["t1"])
        torque = np.where(active, p["A"] * np.sin(2.0 * np.pi * p["f"] * flow.time), 0.0)
        zero = np.zeros_like(torque)
        return np.stack((zero, zero, zero), axis=1), np.stack((zero, torque, zero), axis=1)
