"""A simulated flight: what was measured of it, and the truth."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from edl_filter import rotations
from edl_filter.effects.effect import Active
from edl_filter.effects.world import World
from edl_filter.simulation.motion import Motion
from edl_filter.telemetry.flight_file import FlightContents, flight_telemetry, write_flight_file
from edl_filter.telemetry.record import InitialState, Telemetry

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Flight:
    """All of a simulated flight, in memory.

    Attributes
    ----------
    contents : FlightContents
        What was measured of it, and ``/truth``: all that its flight file holds.
    world : World
        That was flown in: the nominal model, the effects, and the errors of the preflight atmosphere.
    motion : Motion
        The truth at every step.
    """

    contents: FlightContents
    world: World
    motion: Motion

    def write(self, path: str | Path) -> Path:
        """Write the flight file.

        Raises
        ------
        InputError
            It cannot be written, or is not as the format wants it.
        """
        return write_flight_file(path, self.contents)

    def telemetry(self) -> Telemetry:
        """The telemetry that a reader of the flight file would give, without the file."""
        return flight_telemetry(self.contents)


def stated_state(
    random: np.random.Generator, motion: Motion, sigma: Array, effects: tuple[Active, ...]
) -> InitialState:
    """The entry state as it is stated: the true one disturbed.

    Parameters
    ----------
    random : Generator
    motion : Motion
    sigma : (9,) array
        Of position (m), velocity (m/s) and attitude (rad, body axes).
    effects : tuple of Active
        Those that give the true state where another was stated are undone.
    """
    true = motion.state[0]
    disturbed = sigma * random.standard_normal(9)
    attitude = rotations.multiply(true[6:10], rotations.from_rotation_vector(disturbed[6:]))
    stated = InitialState(
        float(motion.time[0]), true[:3] + disturbed[:3], true[3:6] + disturbed[3:6], attitude, np.diag(sigma**2)
    )
    for a in [a for a in effects if a.effect.acts("entry_state")][::-1]:
        stated = _before(a, stated)
    return stated


def _before(active: Active, true: InitialState) -> InitialState:
    """What was stated where the effect gives `true`: its inverse by iteration."""
    found = true
    for _ in range(8):
        given = active.effect.entry_state(active.values, found)
        error = rotations.multiply(rotations.conjugate(given.inertial_from_body), true.inertial_from_body)
        found = InitialState(
            true.time,
            found.position + (true.position - given.position),
            found.velocity + (true.velocity - given.velocity),
            rotations.normalise(rotations.multiply(found.inertial_from_body, error)),
            true.covariance,
        )
    return found


def true_course(world: World, motion: Motion, each: int) -> dict[str, Array]:
    """State and flow at the beginning and at every `each`-th step's end, for ``/truth``."""
    time, state = motion.time[::each], motion.state[::each]
    flow = world.flow(time, state[:, :3], state[:, 3:6], state[:, 6:10], state[:, 10:13])
    u, v, w = flow.velocity_body.T
    return {
        "time": time,
        "position": state[:, :3],
        "velocity": state[:, 3:6],
        "attitude": state[:, 6:10],
        "angular_rate": state[:, 10:13],
        "altitude": flow.altitude,
        "air_speed": flow.speed,
        "alpha": np.arctan2(w, u),
        "beta": np.arcsin(v / flow.speed),
        "alpha_total": flow.alpha_total,
        "density": flow.density,
        "mach": flow.mach,
        "dynamic_pressure": flow.dynamic_pressure,
    }
