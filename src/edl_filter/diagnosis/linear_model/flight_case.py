"""A flight prepared for diagnosis: what the telemetry and the mission give, whatever effects the model has."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from edl_filter.aero.discrepancy import DiscrepancyPrior
from edl_filter.diagnosis.jacobians.denoised_readings import denoise
from edl_filter.diagnosis.jacobians.nuisance import StatedUncertainty
from edl_filter.diagnosis.linear_model.stated_parameters import StatedParameter, stated_parameters
from edl_filter.diagnosis.prediction.residuals import ModelInputs
from edl_filter.diagnosis.prediction.time_bins import TimeBins, make_time_bins
from edl_filter.effects.base import EffectInstance, model_effects
from edl_filter.effects.forward_model import ForwardModel
from edl_filter.effects.sensor_chain import log_abs_det_jacobian
from edl_filter.mission import Mission
from edl_filter.mission.decision_settings import DecisionSettings
from edl_filter.navigation.consensus import LEAST_READINGS
from edl_filter.navigation.filter import FilterPass, Problem
from edl_filter.navigation.increments import Samples, effective_samples, unresolved_motion_of
from edl_filter.navigation.unresolved import UnresolvedMotion
from edl_filter.pipeline.forward_model import forward_model_of
from edl_filter.pipeline.load import impacts_from
from edl_filter.pipeline.reconstruct import Reconstruction, assemble_free, reconstruct, without_effects
from edl_filter.telemetry.record import SAME_TIME, ImuRecord, Telemetry

#: Distance from a bound, in logarithms, within which an estimate is at the bound.
_AT_BOUND = 0.01


@dataclass(frozen=True)
class EstimatedQuantity:
    """A quantity of the prior of the database's error.

    Attributes
    ----------
    name : str
        Key of the mission.
    stated, estimate, low, high : float
        Value in the mission, estimate, and bounds, in the key's unit.
    """

    name: str
    stated: float
    estimate: float
    low: float
    high: float

    @property
    def at_bound(self) -> bool:
        """Whether the estimate is at one of its bounds."""
        distance = min(np.log(self.estimate / self.low), np.log(self.high / self.estimate))
        return bool(distance < _AT_BOUND)


@dataclass(frozen=True)
class DiscrepancyEstimate:
    """Estimated quantities, and the gain in log posterior density over the stated values, nats."""

    quantities: tuple[EstimatedQuantity, ...]
    gain: float


@dataclass(frozen=True)
class FlightCase:
    """A reconstructed flight and what its mission states as uncertain.

    Attributes
    ----------
    reconstruction : Reconstruction
        With the effects of the model.
    bins : TimeBins
    uncertainty : StatedUncertainty
    constants : tuple of StatedParameter
        Constant nuisance parameters.
    discrepancy_estimate : DiscrepancyEstimate or None
        What of the mission's prior of the database's error was estimated; None: nothing.
    excluded_constraints : frozenset of (str, float)
        Name and time (s) of constraints that are not compared, whatever effects the model has: `rejected_readings`, and
        those after `end_of_linear_attitude`.
    """

    reconstruction: Reconstruction
    bins: TimeBins
    uncertainty: StatedUncertainty
    constants: tuple[StatedParameter, ...] = ()
    discrepancy_estimate: DiscrepancyEstimate | None = None
    excluded_constraints: frozenset[tuple[str, float]] = frozenset()

    @property
    def mission(self) -> Mission:
        """The mission."""
        return self.reconstruction.mission

    @property
    def settings(self) -> DecisionSettings:
        """Thresholds of the diagnosis."""
        return self.mission.diagnosis

    @property
    def effects(self) -> tuple[EffectInstance, ...]:
        """Effects in the model."""
        return self.reconstruction.effects

    @property
    def end(self) -> float:
        """End of the comparison, s."""
        return float(self.bins.edges[-1])

    def reconstruct_with(self, effects: Sequence[EffectInstance]) -> FlightCase:
        """The same flight reconstructed with other effects in the model; its files are not read again."""
        r = self.reconstruction
        again = reconstruct(r.mission, effects, leave_one_out=False, recover=False, inputs=r.inputs, compare_imus=False)
        return replace(flight_case(again), excluded_constraints=self.excluded_constraints)

    def model_inputs(self, effects: Sequence[EffectInstance]) -> ModelInputs:
        """Model and measurements with the given effects; the noise of unresolved motion does not depend on them."""
        r = self.reconstruction
        telemetry = without_effects(r.mission, r.telemetry, effects)
        problem = assemble_free(r.mission, telemetry, r.planet, r.atmosphere, effects, self.unresolved)
        return self._inputs(problem, telemetry, effects)

    def denoised_inputs(self, effects: Sequence[EffectInstance]) -> ModelInputs:
        """The same with denoised readings, to differentiate with respect to sensor errors.

        Of the problem only the samples depend on the effects.
        """
        problem = self.reconstruction.problem
        telemetry = without_effects(self.mission, self.denoised_telemetry, effects)
        samples = effective_samples(telemetry.driving, unresolved=self.unresolved).split(problem.epochs)
        samples = samples.part(samples.index(problem.initial.time), len(samples.time))
        return self._inputs(replace(problem, samples=samples), telemetry, effects)

    @cached_property
    def unresolved(self) -> UnresolvedMotion:
        """Noise of unresolved motion of the readings as they were telemetered."""
        r = self.reconstruction
        return unresolved_motion_of(r.telemetry.driving, impacts_from(r.telemetry, r.event_times))

    def log_abs_det_jacobian(self, effects: Sequence[EffectInstance]) -> float:
        """Log determinant of the map from readings to corrected readings: the likelihood is that of the readings.

        Readings divided by 1.01 have one percent less noise. Without this term the many samples would make that
        evidence for a scale error (change of variables of a probability density).
        """
        if not any(a.effect.acts("corrected") for a in effects):
            return 0.0
        t = self.reconstruction.telemetry
        records = ((t.driving, True), *((r, False) for r in t.checking))
        middle, total = self.bins.middle[self.bins.valid], 0.0
        for record, driving in records:
            covered = middle[(middle > record.start) & (middle < record.time[-1])]
            if len(covered):
                samples = record.index_at(covered)
                total += len(covered) * log_abs_det_jacobian(record, effects, driving, samples)
        return total

    @cached_property
    def denoised_telemetry(self) -> Telemetry:
        """Telemetry in which each sample is interpolated from its neighbours."""
        t, length, end = self.reconstruction.telemetry, float(np.median(self.bins.interval)), self.end

        def denoised(record: ImuRecord) -> ImuRecord:
            coarse = [f.channel for f in t.findings if f.kind == "coarse" and f.imu == record.name]
            return denoise(record, length, end, coarse)

        return replace(t, driving=denoised(t.driving), checking=tuple(denoised(record) for record in t.checking))

    @cached_property
    def forward_model(self) -> ForwardModel:
        """The mission's forward model without effects; its tables are read once."""
        r = self.reconstruction
        return forward_model_of(r.mission, r.planet, r.atmosphere, ())

    def _inputs(self, problem: Problem, telemetry: Telemetry, effects: Sequence[EffectInstance]) -> ModelInputs:
        model = self.forward_model.with_effects(model_effects(effects))
        compared = tuple(c for c in problem.constraints if (c.name, c.time) not in self.excluded_constraints)
        return ModelInputs(replace(problem, constraints=compared), model, telemetry.driving, telemetry.checking)


def load_case(mission: Mission, effects: Sequence[EffectInstance] | None = None) -> FlightCase:
    """Reconstruct a mission and prepare it for diagnosis.

    A missing effect contradicts the measurements as a diverged state does. No noise is added for it here, which would
    hide it.

    Parameters
    ----------
    mission : Mission
        The mission, checked.
    effects : sequence of EffectInstance, optional
        Instead of the mission's.
    """
    return flight_case(reconstruct(mission, effects, leave_one_out=False, recover=False))


def flight_case(reconstruction: Reconstruction) -> FlightCase:
    """Prepare a reconstructed flight for diagnosis."""
    r, mission = without_coarse_checking(reconstruction), reconstruction.mission
    settings, record, begin = mission.diagnosis, r.telemetry.driving, r.problem.initial.time
    edges = record.edges
    parachute = r.event_times.get("parachute_deploy", float(record.time[-1]))
    vehicle, aero = mission.vehicle, mission.aerodynamics
    return FlightCase(
        reconstruction=r,
        bins=make_time_bins(
            r.problem.samples,
            edges[edges >= begin - 1e-9],
            parachute - settings.parachute_margin_s,
            settings.bin_length_s,
            settings.excluded_end_bins,
            [time for time, _ in mission.vehicle_changes()],
        ),
        uncertainty=StatedUncertainty(
            density=max(mission.atmosphere.density_sigma, settings.minimum_density_sigma),
            density_correlation=mission.atmosphere.density_correlation_m,
            wind=mission.atmosphere.wind_sigma,
            discrepancy=DiscrepancyPrior() if aero is None else aero.discrepancy_prior,
            numerical=settings.relative_prediction_error,
            numerical_memory=settings.numerical_error_memory_s,
            mass=vehicle.mass_sigma / vehicle.mass,
            inertia=vehicle.inertia_sigma,
        ),
        constants=stated_parameters(mission, r.telemetry),
        excluded_constraints=rejected_readings(r.filter_pass)
        | constraints_after(r.problem, end_of_linear_attitude(r.problem.samples, settings.linear_attitude_sigma_rad)),
    )


def without_coarse_checking(reconstruction: Reconstruction) -> Reconstruction:
    """The reconstruction without the checking IMUs whose readings have coarse steps, unless an effect acts on them.

    The rounding error of a coarse step depends on the reading. It is neither white nor constant: the differences from
    another IMU would be evidence for an error of a sensor.
    """
    t = reconstruction.telemetry
    coarse = {f.imu for f in t.findings if f.kind == "coarse"} - {a.imu for a in reconstruction.effects}
    compared = tuple(record for record in t.checking if record.name not in coarse)
    if len(compared) == len(t.checking):
        return reconstruction
    return replace(reconstruction, telemetry=replace(t, checking=compared))


def rejected_readings(filter_pass: FilterPass) -> frozenset[tuple[str, float]]:
    """Name and time of the readings that the filter rejected while most of those of their instrument agree.

    A minority of an instrument's readings that contradicts the majority is in error itself. A measurement of which
    there are few contradicts the model, and so does an instrument most of whose readings are rejected: these are
    compared.
    """
    uses = Counter(f.constraint.name for f in filter_pass.fused)
    rejected = [f.constraint for f in filter_pass.fused if not f.accepted]
    counts = Counter(c.name for c in rejected)
    return frozenset(
        (c.name, c.time) for c in rejected if uses[c.name] >= LEAST_READINGS and 2 * counts[c.name] < uses[c.name]
    )


def end_of_linear_attitude(samples: Samples, limit: float) -> float:
    """Time from which a linear model of the path does not hold, since lost rates leave the attitude unknown, s.

    The path is dead-reckoned from the filled rates, and no parameter moves it as their errors do. Only lost samples
    about the opening of a parachute leave so large an error: the opening shock cannot be interpolated.

    Parameters
    ----------
    samples : Samples
        Of the driving instrument.
    limit : float
        Largest standard deviation of the attitude by the errors of filled rates, rad.

    Returns
    -------
    float
        Beginning of the first sample that exceeds it; infinite if none does.
    """
    variance = np.cumsum(np.sum((samples.interval[:, None] * samples.rate_fill_sigma) ** 2, axis=1))
    beyond = np.flatnonzero(variance > limit**2)
    return float(samples.time[beyond[0]] - samples.interval[beyond[0]]) if len(beyond) else np.inf


def constraints_after(problem: Problem, time: float) -> frozenset[tuple[str, float]]:
    """Name and time (s) of the constraints after a time (s)."""
    return frozenset((c.name, c.time) for c in problem.constraints if c.time > time + SAME_TIME)
