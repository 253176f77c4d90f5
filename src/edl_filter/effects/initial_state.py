"""Effects in the entry state from which navigation starts."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from edl_filter import rotations
from edl_filter.effects.base import Effect
from edl_filter.effects.parameters import Parameter, Values
from edl_filter.effects.sensors import components
from edl_filter.types import AXES

if TYPE_CHECKING:
    from edl_filter.telemetry.record import InitialState


class AttitudeFrame(Effect):
    """Position and velocity of the entry state are rotated relative to the attitude's inertial axes."""

    name = "attitude_frame"
    family = "entry"
    summary = "position and velocity of the entry state are in rotated axes: true = R(r) stated, r in inertial axes"
    shows = (
        "The trajectory is rotated about the planet's centre: landing site and gravity at rest have residuals of "
        "kilometres in one direction while forces and rates agree; angles of attack and sideslip differ by a constant "
        "rotation."
    )
    source = (
        "Spirit's entry state against its attitude: 0.26 degrees (computed from the telemetry); Thomas (2011), "
        "section 3.2, rotates the attitude by 0.5 degrees about the line to the Sun"
    )
    parameters = tuple(
        Parameter(f"r{axis}", "rad", f"rotation vector, inertial {axis}", 5e-3, low=-0.1, high=0.1) for axis in AXES
    )

    def entry_state(self, p: Values, initial: InitialState) -> InitialState:
        """The state with position, velocity and their covariance rotated; the attitude stays."""
        turn = rotations.from_rotation_vector(components(p, "r"))
        jacobian = np.eye(9)
        jacobian[:3, :3] = jacobian[3:6, 3:6] = rotations.to_matrix(turn)
        return replace(
            initial,
            position=rotations.rotate(turn, initial.position),
            velocity=rotations.rotate(turn, initial.velocity),
            covariance=jacobian @ initial.covariance @ jacobian.T,
        )


EFFECTS = (AttitudeFrame,)
