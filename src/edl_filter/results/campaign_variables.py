"""Variables of a campaign's store: dimensions, unit and description of each, and the labels that are fixed."""

from __future__ import annotations

from typing import NamedTuple

from edl_filter.results.verdicts import VERDICTS
from edl_filter.types import AXES

#: Phases of a simulated flight at which errors of the state are recorded.
PHASES = ("entry", "peak deceleration", "before parachute", "under parachute", "rest")
#: Components of the state's error, and its parts.
STATE = tuple(f"{name} {axis}" for name in ("position", "velocity", "attitude") for axis in AXES)
PARTS = {"position": slice(0, 3), "velocity": slice(3, 6), "attitude": slice(6, 9), "all": slice(0, 9)}
#: Outcomes of a case, in the order of their codes.
OUTCOMES = ("done", "failed", "missing")
#: Attribute of an `edl_filter.postflight.events.Event` → variable.
EVENT_VALUES = {
    "time_s": "event_time",
    "altitude_m": "event_altitude",
    "altitude_sigma_m": "event_altitude_sigma",
    "velocity_m_s": "event_velocity",
    "mach": "event_mach",
    "dynamic_pressure_pa": "event_dynamic_pressure",
    "flight_path_deg": "event_flight_path",
    "alpha_total_deg": "event_alpha_total",
    "acceleration_m_s2": "event_acceleration",
}


class Variable(NamedTuple):
    """A variable by case.

    Attributes
    ----------
    dimensions : tuple of str
        In addition to ``case``; each has labels.
    unit, description : str
    """

    dimensions: tuple[str, ...]
    unit: str
    description: str


VARIABLES: dict[str, Variable] = {
    "event_time": Variable(("event",), "s", "time since the epoch"),
    "event_altitude": Variable(("event",), "m", "areodetic altitude"),
    "event_altitude_sigma": Variable(("event",), "m", "one sigma of the altitude"),
    "event_velocity": Variable(("event",), "m/s", "air-relative speed"),
    "event_mach": Variable(("event",), "1", "Mach number"),
    "event_dynamic_pressure": Variable(("event",), "Pa", "dynamic pressure"),
    "event_flight_path": Variable(("event",), "deg", "flight path angle of the air-relative velocity"),
    "event_alpha_total": Variable(("event",), "deg", "total angle of attack"),
    "event_acceleration": Variable(("event",), "m/s^2", "axial deceleration, of the peak only"),
    "trustworthy": Variable((), "1", "1 if the reconstruction is to be trusted"),
    "landing_position": Variable(("axis",), "m", "planet-fixed landing position, estimate"),
    "landing_sigma": Variable((), "m", "one sigma of it, horizontal"),
    "predicted_landing_position": Variable(("axis",), "m", "planet-fixed landing position without that constraint"),
    "predicted_landing_sigma": Variable((), "m", "one sigma of its difference from the measured site, horizontal"),
    "true_landing_position": Variable(("axis",), "m", "planet-fixed landing position, truth of a simulated flight"),
    "nis": Variable(("constraint",), "1", "normalised innovation squared, all uses"),
    "dof": Variable(("constraint",), "1", "degrees of freedom of nis"),
    "rejected": Variable(("constraint",), "1", "rejected uses"),
    "left_out_nis": Variable(("constraint",), "1", "normalised residual squared against all other constraints"),
    "left_out_dof": Variable(("constraint",), "1", "degrees of freedom of left_out_nis"),
    "state_error": Variable(("phase", "component"), "SI", "true minus smoothed state; m, m/s, rad"),
    "state_sigma": Variable(("phase", "component"), "SI", "one sigma of the smoothed state; m, m/s, rad"),
    "nees": Variable(("phase", "part"), "1", "normalised estimation error squared; 3 degrees of freedom, all: 9"),
    "verdict": Variable((), "1", "verdict of the diagnosis, index in " + ", ".join(VERDICTS)),
    "none_probability": Variable((), "1", "probability that nothing is missing"),
    "leader_probability": Variable((), "1", "probability of the leading hypothesis"),
    "leader_right": Variable(
        (), "1", "1 if the leading hypothesis, or one not distinguished from it, is in the flight"
    ),
    "named": Variable((), "1", "1 if the verdict names the leading hypothesis"),
    "probability": Variable(("effect",), "1", "probability of each hypothesis of the ranking"),
    "drawn": Variable(("quantity",), "SI", "drawn numbers"),
}
