"""Differences of the flown world from the nominal one: database, mass, inertia, entry state, size of sensor errors."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from edl_filter import rotations
from edl_filter.aero.database import Database
from edl_filter.effects.forward_model import ForwardModel
from edl_filter.effects.types import Body
from edl_filter.types import Array


@dataclass(frozen=True, eq=False)
class WorldErrors:
    """What of a flown world differs from the nominal model; air and sensors differ by effects.

    Attributes
    ----------
    database : Database or None
        Flown in place of the nominal one.
    mass_factor, inertia_factor : float
        True over nominal; the second one is that of the whole tensor.
    start : (9,) array
        Of the true entry state from that of the scenario: position (m), velocity (m/s), attitude (rad, body axes).
    imu_scale : float
        Factor on the constant sensor errors that the scenario draws; their stated sigmas do not change.
    """

    database: Database | None = None
    mass_factor: float = 1.0
    inertia_factor: float = 1.0
    start: Array = field(default_factory=lambda: np.zeros(9))
    imu_scale: float = 1.0

    def applied(self, forward_model: ForwardModel) -> ForwardModel:
        """The forward model with these differences."""
        if self.database is not None:
            forward_model = replace(forward_model, database=self.database)
        if self.mass_factor == 1.0 and self.inertia_factor == 1.0:
            return forward_model
        changed = tuple((time, self._body(body)) for time, body in forward_model.changed_bodies)
        return replace(forward_model, body=self._body(forward_model.body), changed_bodies=changed)

    def _body(self, body: Body) -> Body:
        return replace(body, mass=body.mass * self.mass_factor, inertia=body.inertia * self.inertia_factor)

    def moved(self, state: Array) -> Array:
        """A true entry state ``(13,)`` (`edl_filter.simulation.simulate.true_start`) with the difference in it."""
        if not self.start.any():
            return state
        moved = state.copy()
        moved[:6] += self.start[:6]
        moved[6:10] = rotations.multiply(state[6:10], rotations.from_rotation_vector(self.start[6:]))
        return moved
