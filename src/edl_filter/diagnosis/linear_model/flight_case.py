"""A flight laid out for diagnosis: what the flight and the mission give, whatever effects the model has."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from edl_filter.assembly import assemble_free, without_effects
from edl_filter.diagnosis.bins import Bins, lay_bins
from edl_filter.diagnosis.comparison import Setup
from edl_filter.diagnosis.quiet import quiet
from edl_filter.diagnosis.unknowns import Allowance
from edl_filter.effects.effect import Active
from edl_filter.effects.readings import log_stretch
from edl_filter.effects.world import World
from edl_filter.mission import Mission
from edl_filter.modelling import world_of
from edl_filter.navigation.filter import Problem
from edl_filter.navigation.increments import effective_samples
from edl_filter.reconstruction import Reconstruction, reconstruct
from edl_filter.telemetry.record import Telemetry

#: Time before the parachute that is not compared, s: the mortar's recoil and the samples that reach over it.
_MARGIN = 0.3


@dataclass(frozen=True)
class Case:
    """A flight and its mission.

    Attributes
    ----------
    reconstruction : Reconstruction
        With the effects of the model.
    bins : Bins
    allowance : Allowance
    """

    reconstruction: Reconstruction
    bins: Bins
    allowance: Allowance

    @property
    def mission(self) -> Mission:
        """The mission."""
        return self.reconstruction.mission

    @property
    def effects(self) -> tuple[Active, ...]:
        """Effects in the model."""
        return self.reconstruction.effects

    @property
    def exact(self) -> bool:
        """Whether the mission calls its database exact: then a model that fails lacks something."""
        return self.allowance.coefficients == 0.0

    @property
    def parachute(self) -> float:
        """End of the comparison, s."""
        return float(self.bins.edges[-1])

    def arrange(self, effects: Sequence[Active]) -> Setup:
        """Model and measurements with other effects than the model's."""
        r = self.reconstruction
        telemetry = without_effects(r.mission, r.telemetry, effects)
        problem = assemble_free(r.mission, telemetry, r.planet, r.atmosphere, effects)
        return self._setup(problem, telemetry, effects)

    def arrange_quiet(self, effects: Sequence[Active]) -> Setup:
        """The same with readings from which their own noise was taken (`quiet`), to differentiate by sensor errors.

        Of the problem the samples alone are as the effects have them.
        """
        known = self.reconstruction.problem
        telemetry = without_effects(self.mission, self.quiet_telemetry, effects)
        samples = effective_samples(telemetry.driving).split(known.epochs)
        samples = samples.part(samples.index(known.initial.time), len(samples.time))
        return self._setup(replace(known, samples=samples), telemetry, effects)

    def volume(self, effects: Sequence[Active]) -> float:
        """What undoing effects makes of a volume of readings, as its logarithm: the likelihood is that of the readings.

        Readings divided by 1.01 have one percent less noise, which many samples would call evidence for a scale error.
        """
        if not any(a.effect.acts("corrected") for a in effects):
            return 0.0
        t = self.reconstruction.telemetry
        records = ((t.driving, True), *((r, False) for r in t.checking))
        return int(np.sum(self.bins.sound)) * sum(log_stretch(r, effects, drives) for r, drives in records)

    @cached_property
    def quiet_telemetry(self) -> Telemetry:
        """Telemetry with every sample replaced by what its neighbours say."""
        t, bin_, end = self.reconstruction.telemetry, float(np.median(self.bins.interval)), self.parachute
        return replace(t, driving=quiet(t.driving, bin_, end), checking=tuple(quiet(r, bin_, end) for r in t.checking))

    @cached_property
    def world(self) -> World:
        """The mission's world without effects; its tables are read once."""
        r = self.reconstruction
        return world_of(r.mission, r.planet, r.atmosphere, ())

    def _setup(self, problem: Problem, telemetry: Telemetry, effects: Sequence[Active]) -> Setup:
        return Setup(problem, self.world.having(effects), telemetry.driving, telemetry.checking)


def load_case(mission: Mission, effects: Sequence[Active] | None = None, leave_one_out: bool = False) -> Case:
    """Reconstruct a mission and lay it out for comparison.

    Parameters
    ----------
    mission : Mission
    effects : sequence of Active, optional
        Instead of the mission's.
    leave_one_out : bool
        Of `reconstruct`; the comparison itself has no use for it.
    """
    return case_of(reconstruct(mission, effects, leave_one_out))


def case_of(reconstruction: Reconstruction) -> Case:
    """Lay a reconstructed flight out for comparison."""
    r, mission = reconstruction, reconstruction.mission
    record, begin = r.telemetry.driving, r.problem.initial.time
    edges = np.concatenate(([record.start], record.time))
    parachute = r.event_times.get("parachute_deploy", float(record.time[-1]))
    vehicle, aero = mission.vehicle, mission.aerodynamics
    return Case(
        reconstruction=r,
        bins=lay_bins(r.problem.samples, edges[edges >= begin - 1e-9], parachute - _MARGIN),
        allowance=Allowance(
            density=max(mission.atmosphere.density_sigma, 1e-4),
            density_correlation=mission.atmosphere.density_correlation_m,
            wind=mission.atmosphere.wind_sigma,
            coefficients=0.0 if aero is None else aero.coefficient_sigma,
            mass=vehicle.mass_sigma / vehicle.mass,
            inertia=vehicle.inertia_sigma,
        ),
    )
