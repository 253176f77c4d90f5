"""Reconstruction of an entry: read, put the filter's problem together, filter, smooth, check."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np

from edl_filter.effects.base import EffectInstance
from edl_filter.effects.forward_model import compose_entry_state, compose_gravity
from edl_filter.effects.sensor_chain import check_imus, corrected_record, moved_record, sensor_effects
from edl_filter.estimation.parallel import one_blas_thread
from edl_filter.mission import Mission
from edl_filter.mission.estimation import LandingSiteConfig
from edl_filter.navigation.filter import FilterPass, Problem, Settings, build_problem
from edl_filter.navigation.increments import effective_samples
from edl_filter.navigation.leave_one_out import ConstraintCheck, check_constraints, check_entry_state
from edl_filter.navigation.recovery import Recovery, first_pass, run_with_recovery
from edl_filter.navigation.smoother import Smoothed, smooth
from edl_filter.navigation.trajectory import Trajectory, smoothed_trajectory
from edl_filter.navigation.unresolved import UnresolvedMotion
from edl_filter.pipeline.constraints import build_constraints
from edl_filter.pipeline.entry_state import EntryCorrection, entry_correction, entry_state
from edl_filter.pipeline.forward_model import forward_model_of
from edl_filter.pipeline.load import (
    centre_of_mass_shifts,
    check_settings,
    event_times,
    impacts_from,
    read_atmosphere,
    read_telemetry,
    with_velocity_steps,
)
from edl_filter.pipeline.redundancy import Checks, Run, arbitrated
from edl_filter.planet import Planet
from edl_filter.planet.atmosphere import Atmosphere
from edl_filter.telemetry.calibration import (
    MisalignmentEstimate,
    bias_from_velocity_slope,
    compare,
    record_at_centre_of_mass,
)
from edl_filter.telemetry.record import ImuRecord, Telemetry
from edl_filter.telemetry.relative_calibration import RelativeCalibration, relative_calibration
from edl_filter.telemetry.sample_repair import interpolated_stretches
from edl_filter.types import Array


@dataclass(frozen=True)
class FlightInputs:
    """Telemetry and preflight atmosphere of a mission, for several reconstructions of one flight.

    Attributes
    ----------
    telemetry : Telemetry
    atmosphere : Atmosphere, optional
        Read from the mission's table if not given.
    arbitrated : bool
        Whether a reconstruction has decided already which of two IMUs is at fault, or that it is not known.
    """

    telemetry: Telemetry
    atmosphere: Atmosphere | None = None
    arbitrated: bool = False


@dataclass(frozen=True)
class Reconstruction:
    """A reconstructed entry, and what it was computed from.

    Attributes
    ----------
    mission : Mission
    telemetry : Telemetry
        As the filter used it: bad samples replaced and filled, the effects not removed.
    planet, atmosphere : Planet, Atmosphere
        As stated, without effects; the planet with the effects' gravity is the problem's.
    problem : Problem
    filter_pass : FilterPass
    smoothed : Smoothed
    trajectory : Trajectory
    constraint_checks : list of ConstraintCheck
        The entry state first; empty where the leave-one-out checks were not asked for.
    entry : EntryCorrection
    comparison : dict
        Name of a checking IMU → misalignment against the driving one by the thesis's method, where a window is covered.
    calibrations : dict
        Name of a checking IMU → its calibration against the driving one, where they have enough common samples.
    pre_entry_bias : tuple of two (3,) arrays or None
        The accelerometers' bias by the thesis's method, slope of the velocity before entry, and its sigma, m/s²; None
        where the mission has no such window.
    timing : dict
        Stage → s.
    effects : tuple of EffectInstance
        Those that were removed from the telemetry (`without_effects`).
    recovery : Recovery or None
        What was added to `problem` since its state diverged from the measurements; None where it did not.
    inputs : FlightInputs or None
        For further reconstructions of the same flight, with other effects: the samples of an IMU at fault are replaced,
        and no other one is searched, so that all of them have the same readings; samples that dynamics fill are not
        filled yet.
    """

    mission: Mission
    telemetry: Telemetry
    planet: Planet
    atmosphere: Atmosphere
    problem: Problem
    filter_pass: FilterPass
    smoothed: Smoothed
    trajectory: Trajectory
    constraint_checks: list[ConstraintCheck]
    entry: EntryCorrection
    comparison: dict[str, MisalignmentEstimate]
    calibrations: dict[str, RelativeCalibration]
    pre_entry_bias: tuple[Array, Array] | None
    timing: dict[str, float]
    effects: tuple[EffectInstance, ...] = ()
    recovery: Recovery | None = None
    inputs: FlightInputs | None = None

    def __repr__(self) -> str:
        added = ", ".join(a.name for a in self.effects) or "no effects"
        return f"<Reconstruction of {self.mission.name}: {len(self.trajectory.time)} samples, {added}>"

    @property
    def event_times(self) -> dict[str, float]:
        """Name → s since the epoch."""
        return dict(sorted(event_times(self.mission, self.telemetry).items(), key=lambda e: e[1]))

    @property
    def site(self) -> Array | None:
        """Landing site, planet-fixed position (3,), m, whether it is used as a constraint or not; None if not known."""
        stated = self.mission.constraints.landing
        if isinstance(stated, LandingSiteConfig):
            return stated.position
        return None if self.telemetry.landing is None else self.telemetry.landing.position

    @property
    def site_radius(self) -> float | None:
        """Distance of the landing site from the planet's centre, m."""
        return None if self.site is None else float(np.linalg.norm(self.site))


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
    effects = [a for a in effects if not a.is_zero]
    if not effects:
        return telemetry
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
    mission: Mission,
    telemetry: Telemetry,
    planet: Planet,
    atmosphere: Atmosphere,
    effects: Sequence[EffectInstance],
    unresolved: UnresolvedMotion | None = None,
) -> Problem:
    """As `assemble`, from telemetry from which the effects are removed already (`without_effects`).

    `unresolved` replaces the noise of the samples' own unresolved motion (`effective_samples`).
    """
    planet = compose_gravity(planet, effects)
    shifts = centre_of_mass_shifts(mission, telemetry.driving)
    times = event_times(mission, telemetry)
    samples = effective_samples(telemetry.driving, impacts_from(telemetry, times), unresolved)
    samples = with_velocity_steps(samples, shifts)
    if "parachute_deploy" in times:
        samples = samples.opened_at(times["parachute_deploy"])
    if telemetry.landing is not None:
        samples = samples.stopped_at(telemetry.landing.time)
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


def reconstruct(
    mission: Mission,
    effects: Sequence[EffectInstance] | None = None,
    leave_one_out: bool = True,
    recover: bool = True,
    inputs: FlightInputs | None = None,
    compare_imus: bool = True,
) -> Reconstruction:
    """Reconstruct an entry.

    Parameters
    ----------
    mission : Mission
        Checked mission.
    effects : sequence of EffectInstance, optional
        Instead of the mission's.
    leave_one_out : bool
        Predict every constraint from all others; False leaves `constraint_checks` empty and saves half of the time.
    recover : bool
        Add noise where state and measurements contradict each other (`navigation.recovery`). Without it only samples
        that were lost and filled are tested.
    inputs : FlightInputs, optional
        Read already; otherwise the mission's files are read.
    compare_imus : bool
        Compare and calibrate checking IMUs; False leaves `comparison`, `calibrations` and `pre_entry_bias` empty.

    Returns
    -------
    Reconstruction

    Raises
    ------
    InputError
        The mission's telemetry or tables are missing or invalid.
    """
    with one_blas_thread():  # several threads wait for each other at matrices of this size
        return _reconstruct(mission, effects, leave_one_out, recover, inputs, compare_imus)


def _reconstruct(
    mission: Mission,
    effects: Sequence[EffectInstance] | None,
    leave_one_out: bool,
    recover: bool,
    inputs: FlightInputs | None,
    compare_imus: bool,
) -> Reconstruction:
    timing: dict[str, float] = {}
    with _timed(timing, "telemetry"):
        if inputs is None:
            inputs = FlightInputs(read_telemetry(mission))
        telemetry, atmosphere = inputs.telemetry, inputs.atmosphere or read_atmosphere(mission)
        planet = mission.planet_model(telemetry.prime_meridian_at_epoch)
        active = mission.active_effects() if effects is None else tuple(effects)
    with _timed(timing, "filter"):
        sound, first = _first_runs(mission, telemetry, planet, atmosphere, active, not inputs.arbitrated)
        telemetry, problem, filter_pass = first.telemetry, first.problem, first.filter_pass
        corrected = without_effects(mission, telemetry, active)
        lost, recovery = lost_stretches(telemetry.driving), None
        if recover or lost:
            problem, filter_pass, recovery = run_with_recovery(problem, lost, filter_pass, gap_only=not recover)
    with _timed(timing, "smoother"):
        smoothed = smooth(filter_pass)
        trajectory = smoothed_trajectory(problem, smoothed, filter_pass.layout)
    with _timed(timing, "leave_one_out"):
        checks = check_constraints(problem, filter_pass) if leave_one_out else []
        entry, prior = entry_correction(problem, filter_pass, smoothed)
        if leave_one_out:
            checks.insert(0, check_entry_state(smoothed, prior, -entry.change))
    with _timed(timing, "comparison"):
        comparison: dict[str, MisalignmentEstimate] = {}
        calibrations: dict[str, RelativeCalibration] = {}
        bias = None
        if compare_imus:
            comparison = _compare(mission, corrected)
            calibrations = _calibrate(mission, corrected)
            bias = _pre_entry_bias(mission, corrected)
    return Reconstruction(
        mission=mission,
        telemetry=telemetry,
        planet=planet,
        atmosphere=atmosphere,
        problem=problem,
        filter_pass=filter_pass,
        smoothed=smoothed,
        trajectory=trajectory,
        constraint_checks=checks,
        entry=entry,
        comparison=comparison,
        calibrations=calibrations,
        pre_entry_bias=bias,
        timing=timing,
        effects=active,
        recovery=recovery,
        inputs=FlightInputs(sound.telemetry, atmosphere, arbitrated=True),
    )


def first_run(
    mission: Mission,
    telemetry: Telemetry,
    planet: Planet,
    atmosphere: Atmosphere,
    effects: Sequence[EffectInstance],
) -> Run:
    """Run of the filter before any recovery: samples of an IMU at fault replaced, lost ones filled by dynamics.

    Parameters
    ----------
    mission : Mission
        Checked mission.
    telemetry : Telemetry
        As it was read.
    planet, atmosphere : Planet, Atmosphere
        The mission's own, without effects.
    effects : sequence of EffectInstance
        Of the model.

    Returns
    -------
    Run
        Its telemetry is the given one where the IMUs agree (`redundancy`) and no stretch is filled by rotational
        dynamics (`dynamics_filling`), which need aerodynamics and inertia.
    """
    return _first_runs(mission, telemetry, planet, atmosphere, effects)[1]


def _first_runs(
    mission: Mission,
    telemetry: Telemetry,
    planet: Planet,
    atmosphere: Atmosphere,
    effects: Sequence[EffectInstance],
    arbitrate: bool = True,
) -> tuple[Run, Run]:
    """The run with the samples of an IMU at fault replaced, and that with lost ones filled by dynamics in addition."""

    def run(changed: Telemetry) -> Run:
        problem = assemble(mission, changed, planet, atmosphere, effects)
        return Run(changed, problem, first_pass(problem))

    exchange = not any(a.imu is None for a in sensor_effects(effects))
    parachute = _deployment(mission, telemetry)
    result = run(telemetry)
    if arbitrate:
        result = arbitrated(result, run, Checks(check_settings(mission), parachute, exchange))
    if mission.aerodynamics is None or mission.vehicle.inertia is None or not interpolated_stretches(result.telemetry):
        return result, result
    from edl_filter.pipeline.dynamics_filling import filled_by_dynamics  # few flights need it

    model = forward_model_of(mission, planet, atmosphere, effects)
    return result, filled_by_dynamics(result, model, parachute, run)


def lost_stretches(record: ImuRecord) -> list[tuple[float, float]]:
    """Start and end of the samples that stand for lost ones, s: those that were filled, or whose source says so."""
    sources = [k for k, name in enumerate(record.sources) if any(word in name for word in ("gap", "filled", "lost"))]
    selected = record.filled | np.isin(record.source, sources)
    return list(zip(record.time[selected] - record.interval[selected], record.time[selected], strict=True))


def _pre_entry_bias(mission: Mission, telemetry: Telemetry) -> tuple[Array, Array] | None:
    window = mission.constraints.pre_entry_zero_force
    if window is None:
        return None
    record = record_at_centre_of_mass(telemetry.driving.between(window.start_s, window.end_s))
    return bias_from_velocity_slope(record.time, record.interval, record.specific_force, window.start_s, window.end_s)


def _deployment(mission: Mission, telemetry: Telemetry) -> float:
    return event_times(mission, telemetry).get("parachute_deploy", np.inf)


def _calibrate(mission: Mission, telemetry: Telemetry) -> dict[str, RelativeCalibration]:
    """Calibration of every checking IMU up to the parachute, whose shocks are no motion of a rigid body."""
    end = _deployment(mission, telemetry) - mission.diagnosis.parachute_margin_s
    pairs = {r.name: relative_calibration(telemetry.driving, r, -np.inf, end) for r in telemetry.checking}
    return {name: estimate for name, estimate in pairs.items() if estimate is not None}


def _compare(mission: Mission, telemetry: Telemetry) -> dict[str, MisalignmentEstimate]:
    parachute = _deployment(mission, telemetry)
    pairs = {record.name: compare(telemetry.driving, record, parachute) for record in telemetry.checking}
    return {name: estimate for name, estimate in pairs.items() if estimate is not None}


@contextmanager
def _timed(timing: dict[str, float], stage: str) -> Iterator[None]:
    begin = time.perf_counter()
    yield
    timing[stage] = time.perf_counter() - begin
