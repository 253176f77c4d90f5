"""A flight laid out for diagnosis: measurements, model, and the linear problem about one path.

`Case` holds what the flight and the mission give; `Linear` is the comparison about a model with chosen effects, ready
to be whitened.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from edl_filter.assembly import assemble_free, without_effects
from edl_filter.diagnosis.bins import Bins, lay_bins
from edl_filter.diagnosis.comparison import Setup, binned, compare
from edl_filter.diagnosis.deviating import moved
from edl_filter.diagnosis.missing import Missing, allow
from edl_filter.diagnosis.motion import follow, frame_of
from edl_filter.diagnosis.path import readings
from edl_filter.diagnosis.point import Point, first_point, told
from edl_filter.diagnosis.roughness import Rough, find_rough
from edl_filter.diagnosis.sensitivity import bin_rows, coefficient_sigma, one_sigma, slopes
from edl_filter.diagnosis.signatures import Ground
from edl_filter.diagnosis.timeline import in_order
from edl_filter.diagnosis.unknowns import Allowance, Unknowns, lay_out
from edl_filter.diagnosis.whitening import Steps, Whitener, Whitens, whitener
from edl_filter.effects.deviation import CoefficientUnits
from edl_filter.effects.effect import Active
from edl_filter.effects.readings import log_stretch
from edl_filter.effects.world import World
from edl_filter.mission import Mission
from edl_filter.modelling import world_of
from edl_filter.navigation.filter import Problem
from edl_filter.navigation.increments import effective_samples
from edl_filter.reconstruction import Reconstruction, reconstruct
from edl_filter.telemetry.record import ImuRecord, Telemetry

Array = NDArray[np.float64]

#: Time before the parachute that is not compared, s: the mortar's recoil and the samples that reach over it.
_MARGIN = 0.3
#: Part of the rows that may be rough where a model holds.
HOLDS = 0.02
#: What a path may still move when it has settled, in sigmas of what is known of it.
_SETTLED = 0.1
#: Rounds, its last one counted, in which a failing model may find where it holds, and how much of its roughness one
#: may leave if there is hope.
_AWAY, _HOPE = 4, 0.8


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


def quiet(record: ImuRecord, length: float, end: float) -> ImuRecord:
    """A record in which every sample is the cubic through four others, ``(4 (a + b) - (c + d)) / 6``.

    The others are one and two bins away on either side, `length` (s) being that of a bin: none is in the sample's own
    bin. A scale error multiplies what was read, noise and all. A signature with the noise of a bin in it would find
    that noise in the bin's difference again, and call it a scale error. After `end` (s), where nothing is compared,
    samples stay: a cubic through a parachute's shock would lead the path astray.
    """
    p = max(1, round(length / float(np.median(record.interval))))
    count = len(record)
    even = np.zeros(count, bool)
    if count > 4 * p:
        usual = np.abs(record.interval - np.median(record.interval)) < 1e-6
        broken = np.concatenate(([0], np.cumsum(~usual | (np.diff(record.unit, prepend=record.unit[0]) != 0))))
        # samples from 2 p before to 2 p after are as long as usual and of one unit
        even[2 * p : count - 2 * p] = broken[4 * p + 1 :] == broken[: count - 4 * p]
        even[: count - 2 * p] &= record.time[2 * p :] <= end

    def smooth(values: Array) -> Array:
        out = values.copy()
        near = values[p : -3 * p] + values[3 * p : -p]
        far = values[: -4 * p] + values[4 * p :]
        out[2 * p : -2 * p] = (4.0 * near - far) / 6.0
        return np.where(even[:, None], out, values)

    if not even.any():
        return record
    return replace(record, specific_force=smooth(record.specific_force), angular_rate=smooth(record.angular_rate))


@dataclass(frozen=True)
class Linear:
    """The comparison about a model.

    Attributes
    ----------
    ground : Ground
        Where signatures are taken.
    bins : Bins
    unknowns : Unknowns
    sigma : dict
        What one sigma of air and vehicle is (`sensitivity.one_sigma`).
    units : CoefficientUnits
        One sigma of the tables.
    steps : Steps
        Nothing missing allowed.
    column : (R,) array
        The differences.
    start : (n,) array
        What the mission states of the unknowns at the beginning, about the path.
    begin : Rough or None
        Noise from which the search for its own begins: `failures` of a model much like it.
    """

    ground: Ground
    bins: Bins
    unknowns: Unknowns
    sigma: dict[str, float]
    units: CoefficientUnits
    steps: Steps
    column: Array
    start: Array
    begin: Rough | None = None

    @cached_property
    def plain(self) -> Whitener:
        """Whitener that allows for nothing missing."""
        return whitener(self.steps)

    @cached_property
    def rough(self) -> tuple[Rough, Whitener]:
        """Noise that the differences have beyond what is stated, and the whitener that allows for it."""
        return find_rough(self.plain, self.ground.order, self.column, self.start, self.begin)

    @property
    def share(self) -> float:
        """Part of the rows that are rough."""
        return self.rough[0].share

    @property
    def holds(self) -> bool:
        """Whether next to nothing is rough: the model agrees with the measurements about this path."""
        return self.share <= HOLDS

    @property
    def failures(self) -> Rough | None:
        """Its noise, where a model much like it may begin; None if it holds: noise is then asked for afresh."""
        return None if self.holds else self.rough[0]

    @property
    def soft(self) -> Whitener:
        """Whitener that takes the model's failures for noise."""
        return self.rough[1]

    def white(self, whiten: Whitens) -> Array:
        """The differences, white."""
        return whiten(self.column[:, None], self.start[:, None])[:, 0]

    @cached_property
    def log_likelihood(self) -> float:
        """Of the differences, at the noise that they have."""
        return self.soft.log_likelihood(self.white(self.soft))

    @property
    def surprise(self) -> float:
        """How far the point is from what the mission states, in sigmas of the unknown that is farthest."""
        size = self.unknowns.layout.size
        prior = np.sqrt(np.diag(self.steps.start)[:size])
        start = float(np.max(np.abs(self.start[:size]) / np.where(prior > 0.0, prior, np.inf)))
        return max(start, moved(None, self.ground.point.deviation, self.sigma))

    def with_missing(self, missing: Missing) -> Whitener:
        """Whitener that allows for a missing force and moment."""
        order, flow = self.ground.order, self.ground.found.flow
        return whitener(allow(self.steps, order, self.bins, flow, missing))


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


def linearise(case: Case, rounds: int = 1, until: float = 1.0, begin: Rough | None = None) -> Linear:
    """Compare model and measurement, about a path and about what the flight says of air, tables and vehicle.

    The first path begins where the reconstruction says, which knows nothing of the air. What forces and moments say of
    its beginning, of the sensor errors and of the air is more; with further `rounds` everything is taken again there
    (`point`), until it stays. That is for models that hold: a failing one may drag the path along, so the rounds end
    where more than the part `until` of the rows is rough. Tables have bends, and the rounds may go to and fro between
    two sides of one; so the likeliest is kept.

    Parameters
    ----------
    case : Case
    rounds : int
        How often it is compared at most.
    until : float
        Part of the rows, 0 to 1.
    begin : Rough, optional
        `Linear.failures` of a model much like it, from which the search for its own noise begins.

    Returns
    -------
    Linear
    """
    return _likeliest(list(_rounds(case, rounds, until, about(case, first_point(case.reconstruction), begin))))


def followed(case: Case, linear: Linear) -> Linear | None:
    """Where a failing model beside an exact database leads, if it holds there; None otherwise.

    It fails where the reconstruction has put the path. After some rounds an unknown may have taken what is missing upon
    itself, by as many sigmas as that takes (`Linear.surprise`).

    Parameters
    ----------
    case : Case
    linear : Linear
        The model where it fails.

    Returns
    -------
    Linear or None
    """
    share = linear.share
    if not case.exact or linear.holds:
        return None
    for there in islice(_rounds(case, _AWAY, 1.0, linear), 1, None):
        if there.holds:
            return there
        if there.share > _HOPE * share:
            break
        share = there.share
    return None


def _likeliest(tried: list[Linear]) -> Linear:
    """Of those that hold, if any does."""
    holding = [x for x in tried if x.holds]
    return max(holding or tried, key=lambda x: x.log_likelihood)


def _rounds(case: Case, rounds: int, until: float, linear: Linear) -> Iterator[Linear]:
    """The comparison about a point, and about where that leads, until it stays or fails."""
    for i in range(rounds):
        yield linear
        point = linear.ground.point
        if i == rounds - 1 or linear.share > until:
            return
        soft, size = linear.soft, linear.unknowns.layout.size
        new = told(linear, point, linear.start, soft, linear.white(soft))
        if new is None:
            return
        spread = np.sqrt(np.maximum(np.diag(soft.start_covariance(size)), 0.0))
        still = np.all(np.abs(new.start.minus(point.start)) <= _SETTLED * spread + 1e-15)
        if still and moved(point.deviation, new.deviation, linear.sigma) <= _SETTLED:
            return
        linear = about(case, new, linear.failures)


def about(case: Case, point: Point, begin: Rough | None = None) -> Linear:
    """Compare model and measurement about a point; the search for the noise begins at `begin`."""
    bins, unmoved = case.bins, case.arrange(case.effects)
    setup = replace(unmoved, world=replace(unmoved.world, deviation=point.deviation))
    layout = setup.problem.layout
    motion = follow(setup.problem, bins, point.start, point.errors)
    frame = frame_of(motion, bins, point.start, point.errors)
    found = compare(frame, setup)
    off = point.deviation
    units = coefficient_sigma(setup, found, case.allowance) if off is None else off.units
    slope = slopes(setup, bins, found, case.allowance.density, units)
    unknowns = lay_out(layout, setup.checking, case.allowance)
    sigma = one_sigma(case.allowance)
    calm = case.arrange_quiet(case.effects).problem
    read = binned(bins, calm.samples, readings(calm, point.errors))
    rows = bin_rows(setup, bins, found, read, unknowns, slope, sigma, case.allowance)
    steps, order = in_order(setup, bins, motion, rows, unknowns, case.allowance, found)
    ground = Ground(
        case.arrange,
        case.arrange_quiet,
        case.volume,
        case.effects,
        frame,
        setup,
        found,
        slope,
        order,
        point,
        unknowns.size,
    )
    return Linear(
        ground=ground,
        bins=bins,
        unknowns=unknowns,
        sigma=sigma,
        units=units,
        steps=steps,
        column=ground.column(found),
        start=ground.stated(setup),
        begin=begin,
    )
