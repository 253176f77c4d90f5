"""From a mission and its telemetry to the filter's problem: corrected samples, entry state, constraints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from edl_filter import rotations
from edl_filter.effects.base import EffectInstance
from edl_filter.effects.forward_model import compose_entry_state, compose_gravity
from edl_filter.effects.sensor_chain import check_imus, corrected_record, moved_record
from edl_filter.errors import InputError
from edl_filter.mission import Mission
from edl_filter.mission.estimation import StatedStateConfig
from edl_filter.navigation.filter import Problem, Settings, build_problem
from edl_filter.navigation.increments import effective_samples
from edl_filter.navigation.initial import EntryErrors
from edl_filter.pipeline.constraints import build_constraints
from edl_filter.pipeline.events import centre_of_mass_shifts, with_velocity_steps
from edl_filter.planet import Planet
from edl_filter.planet.atmosphere import Atmosphere
from edl_filter.telemetry.record import ImuRecord, InitialState, Telemetry


def without_effects(mission: Mission, telemetry: Telemetry, effects: Sequence[EffectInstance]) -> Telemetry:
    """Telemetry as perfect sensors at known places would give it: the effects are removed from all IMUs.

    Raises
    ------
    InputError
        An effect names an IMU that the telemetry does not have.
    """
    if not effects:
        return telemetry
    check_imus(telemetry, effects, str(mission.source or mission.name))
    times = mission.event_times()
    until = min((times[n] for n, e in mission.vehicle.events.items() if e.position is not None), default=np.inf)

    def corrected(record: ImuRecord, driving: bool) -> ImuRecord:
        return moved_record(corrected_record(record, effects, driving), effects, until, driving)

    checking = tuple(corrected(record, driving=False) for record in telemetry.checking)
    return replace(telemetry, driving=corrected(telemetry.driving, driving=True), checking=checking)


def assemble(
    mission: Mission,
    telemetry: Telemetry,
    planet: Planet,
    atmosphere: Atmosphere,
    effects: Sequence[EffectInstance] | None = None,
) -> Problem:
    """Put the filter's problem together.

    Parameters
    ----------
    mission : Mission
        Checked mission.
    telemetry : Telemetry
        As it was read; the effects are removed by this function.
    planet, atmosphere : Planet, Atmosphere
        The mission's own, without effects.
    effects : sequence of EffectInstance, optional
        Instead of the mission's.

    Raises
    ------
    InputError
        The mission takes something from the telemetry that is not in it, or a window holds no samples; an effect names
        an IMU that the telemetry does not have.
    """
    effects = mission.active_effects() if effects is None else effects
    return assemble_free(mission, without_effects(mission, telemetry, effects), planet, atmosphere, effects)


def assemble_free(
    mission: Mission, telemetry: Telemetry, planet: Planet, atmosphere: Atmosphere, effects: Sequence[EffectInstance]
) -> Problem:
    """As `assemble`, from telemetry from which the effects are removed already (`without_effects`)."""
    planet = compose_gravity(planet, effects)
    shifts = centre_of_mass_shifts(mission, telemetry.driving)
    times = mission.event_times() | telemetry.events
    samples = with_velocity_steps(effective_samples(telemetry.driving, times.get("landing", np.inf)), shifts)
    initial, entry = entry_state(mission, telemetry)
    initial = compose_entry_state(initial, effects)
    f = mission.filter
    onboard = mission.constraints.onboard_attitude
    return build_problem(
        samples,
        initial,
        entry,
        telemetry.driving.errors,
        build_constraints(mission, telemetry, samples, planet, atmosphere, initial, effects),
        planet,
        Settings(f.alpha, f.beta, f.kappa, f.longest_interval_s, f.gate_probability, f.method, f.robust, f.engine),
        times=tuple(times.values()),
        unit_change_sigma=onboard.unit_change_sigma if onboard else 0.0,
    )


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
