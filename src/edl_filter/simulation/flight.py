"""A simulated flight: its measurements and the truth."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from edl_filter import rotations
from edl_filter.aero.conventions import attack_and_sideslip
from edl_filter.effects.base import EffectInstance
from edl_filter.effects.forward_model import ForwardModel, invert_entry_state
from edl_filter.simulation.motion import Motion
from edl_filter.telemetry.flight_file_writer import FlightContents, flight_telemetry, write_flight_file
from edl_filter.telemetry.record import InitialState, Telemetry
from edl_filter.telemetry.sample_checks import CheckSettings
from edl_filter.types import Array


@dataclass(frozen=True)
class Flight:
    """A simulated flight in memory.

    Attributes
    ----------
    contents : FlightContents
        Measurements and ``/truth``: the contents of its flight file.
    forward_model : ForwardModel
        Model that was simulated: the nominal one, the effects, and the errors of the preflight atmosphere.
    motion : Motion
        True motion at every step.
    """

    contents: FlightContents
    forward_model: ForwardModel
    motion: Motion

    def write(self, path: str | Path) -> Path:
        """Write the flight file.

        Raises
        ------
        InputError
            It cannot be written, or its contents violate the format.
        """
        return write_flight_file(path, self.contents)

    def telemetry(self, settings: CheckSettings | None = None) -> Telemetry:
        """The telemetry that the reader of the flight file returns, without the file.

        Parameters
        ----------
        settings : CheckSettings, optional
            Thresholds of the checks of the samples.
        """
        return flight_telemetry(self.contents, settings)


def stated_state(
    random: np.random.Generator, motion: Motion, sigma: Array, effects: tuple[EffectInstance, ...]
) -> InitialState:
    """The stated entry state: the true one with random errors.

    Parameters
    ----------
    random : Generator
        Source of the errors.
    motion : Motion
        Its first state is the true one.
    sigma : (9,) array
        One sigma of position (m), velocity (m/s) and attitude (rad, body axes).
    effects : tuple of EffectInstance
        Those on the entry state are inverted.
    """
    true = motion.state[0]
    disturbed = sigma * random.standard_normal(9)
    attitude = rotations.multiply(true[6:10], rotations.from_rotation_vector(disturbed[6:]))
    stated = InitialState(
        float(motion.time[0]), true[:3] + disturbed[:3], true[3:6] + disturbed[3:6], attitude, np.diag(sigma**2)
    )
    return invert_entry_state(stated, effects)


def true_course(forward_model: ForwardModel, motion: Motion, each: int) -> dict[str, Array]:
    """State and flow at the beginning and at the end of every `each`-th step, for ``/truth``.

    Parameters
    ----------
    forward_model : ForwardModel
        The true models.
    motion : Motion
        The flight.
    each : int
        Number of steps from one row to the next.

    Returns
    -------
    dict
        Name of a dataset → ``(N,)``, ``(N, 3)`` or ``(N, 4)`` array, SI units and rad.
    """
    time, state = motion.time[::each], motion.state[::each]
    flow = forward_model.flow(time, state[:, :3], state[:, 3:6], state[:, 6:10], state[:, 10:13])
    alpha, beta = attack_and_sideslip(flow.velocity_body)
    return {
        "time": time,
        "position": state[:, :3],
        "velocity": state[:, 3:6],
        "attitude": state[:, 6:10],
        "angular_rate": state[:, 10:13],
        "altitude": flow.altitude,
        "air_speed": flow.speed,
        "alpha": alpha,
        "beta": beta,
        "alpha_total": flow.alpha_total,
        "density": flow.density,
        "mach": flow.mach,
        "dynamic_pressure": flow.dynamic_pressure,
    }
