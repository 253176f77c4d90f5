"""State at entry: as the mission or the telemetry states it, and its correction by the smoother."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from edl_filter import rotations
from edl_filter.errors import InputError
from edl_filter.mission import Mission
from edl_filter.mission.estimation import StatedStateConfig
from edl_filter.navigation.filter import FilterPass, Problem
from edl_filter.navigation.initial import EntryErrors, frame_jacobian, initial_estimate
from edl_filter.navigation.smoother import Smoothed
from edl_filter.telemetry.record import InitialState, Telemetry
from edl_filter.types import Array


@dataclass(frozen=True)
class EntryCorrection:
    """Correction of the entry state.

    Attributes
    ----------
    change, change_sigma : (9,) arrays
        Smoothed minus stated: position (m), velocity (m/s), attitude (rad, body axes), and one sigma of the
        smoothed state.
    rotation : (3,) array
        The rotation of the state's frame (rad, inertial axes) that fits the change of position and velocity best.
    rotation_remainder : (6,) array
        Remainder of that change: m, m/s.
    states : dict
        Name → (estimate, sigma) of the entry epoch (s) and the state's frame (rad, inertial axes), as far as they
        are states.
    """

    change: Array
    change_sigma: Array
    rotation: Array
    rotation_remainder: Array
    states: dict[str, tuple[Array, Array]]


def entry_state(mission: Mission, telemetry: Telemetry) -> tuple[InitialState, EntryErrors]:
    """Entry state, and its errors in addition to its covariance."""
    stated = mission.initial_state
    if not isinstance(stated, StatedStateConfig):
        if telemetry.initial is None:
            raise InputError(f"{mission.source}: initial_state.from: the telemetry has no initial state.")
        return telemetry.initial, EntryErrors()
    if stated.attitude == "onboard":
        if telemetry.attitude is None:
            raise InputError(f"{mission.source}: initial_state.attitude: the telemetry has no on-board attitude.")
        attitude = telemetry.attitude.at(stated.time_s)
    elif stated.attitude is None:
        raise InputError(f"{mission.source}: initial_state.attitude: found nothing; 'onboard' or a quaternion.")
    else:
        attitude = rotations.normalise(stated.attitude)
    covariance = stated.covariance_matrix(attitude, mission.planet.j2000_from_inertial_matrix)
    initial = InitialState(stated.time_s, np.array(stated.position), np.array(stated.velocity), attitude, covariance)
    entry = EntryErrors(stated.epoch_sigma_s, stated.frame_rotation_sigma)
    if mission.constraints.onboard_attitude is not None and telemetry.attitude is not None:
        start, rounding = telemetry.attitude.at(stated.time_s), float(np.max(telemetry.attitude.sigma))
        onboard = mission.constraints.onboard_attitude
        entry = replace(
            entry,
            onboard_attitude=start,
            onboard_sigma=rounding,
            onboard_rate_sigma=onboard.rate_sigma,
            onboard_mounting_sigma=onboard.mounting_sigma,
        )
    return initial, entry


def entry_correction(problem: Problem, filter_pass: FilterPass, smoothed: Smoothed) -> tuple[EntryCorrection, Array]:
    """Correction of the entry state, and its prior covariance (9, 9)."""
    layout, stated = filter_pass.layout, problem.initial
    reference, covariance = initial_estimate(
        layout, stated, problem.entry, problem.instruments[int(problem.samples.unit[0])], problem.planet
    )
    change = smoothed.states[0].minus(reference)[:9]
    sigma = np.sqrt(np.diag(smoothed.covariance[0])).astype(float)
    scale = np.repeat(1.0 / np.array([np.linalg.norm(stated.position), np.linalg.norm(stated.velocity)]), 3)
    jacobian = frame_jacobian(stated)
    rotation = np.asarray(np.linalg.lstsq(jacobian * scale[:, None], change[:6] * scale, rcond=None)[0], float)
    names = [n for n in ("entry_epoch", "entry_frame") if n in layout]
    states = {n: (smoothed.states[0].errors[layout[n]], sigma[layout[n]]) for n in names}
    entry = EntryCorrection(change, sigma[:9], rotation, change[:6] - jacobian @ rotation, states)
    return entry, covariance[:9, :9]


def in_j2000(mission: Mission, rotation: Array) -> Array | None:
    """J2000 components of an inertial rotation vector (3,), rad; None where the mission does not relate the frames."""
    matrix = mission.planet.j2000_from_inertial_matrix
    return None if matrix is None else rotations.rotate(rotations.from_matrix(matrix), rotation)
