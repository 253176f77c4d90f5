"""What notebook 4 hides in its flight. Do not read on before the notebook says so."""

import numpy as np

from edl_filter.effects import Effect, Parameter


class HiddenTorque(Effect):
    """A thruster that leaks to and fro about the pitch axis, as strongly in thin air as in thick."""

    name = "hidden_torque"
    summary = "A sin(2 pi f t) about y from t0 to t1"
    parameters = (
        Parameter("A", "N m", "amplitude", 5.0, low=-50.0, high=50.0),
        Parameter("f", "Hz", "frequency", kind="frequency", low=0.1, high=3.0, default=0.8),
        Parameter("t0", "s", "beginning", kind="time"),
        Parameter("t1", "s", "end", kind="time", default=np.inf),
    )

    def force_moment(self, p, flow):
        """No force, and a moment while it leaks."""
        leaks = (flow.time >= p["t0"]) & (flow.time < p["t1"])
        torque = np.where(leaks, p["A"] * np.sin(2.0 * np.pi * p["f"] * flow.time), 0.0)
        none = np.zeros_like(torque)
        return np.stack((none, none, none), axis=1), np.stack((none, torque, none), axis=1)
