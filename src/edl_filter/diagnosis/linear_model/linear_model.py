"""The linear problem about one point: model and measurement compared with chosen effects, ready to be whitened."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from edl_filter.diagnosis.bins import Bins
from edl_filter.diagnosis.case import Case
from edl_filter.diagnosis.comparison import binned, compare
from edl_filter.diagnosis.deviating import moved
from edl_filter.diagnosis.missing import Missing, allow
from edl_filter.diagnosis.motion import follow, frame_of
from edl_filter.diagnosis.path import readings
from edl_filter.diagnosis.point import Point
from edl_filter.diagnosis.roughness import Rough, find_rough
from edl_filter.diagnosis.sensitivity import bin_rows, coefficient_sigma, one_sigma, slopes
from edl_filter.diagnosis.signatures import Ground
from edl_filter.diagnosis.timeline import in_order
from edl_filter.diagnosis.unknowns import Unknowns, lay_out
from edl_filter.diagnosis.whitening import Steps, Whitener, Whitens, whitener
from edl_filter.effects.deviation import CoefficientUnits

Array = NDArray[np.float64]

#: Part of the rows that may be rough where a model holds.
HOLDS = 0.02


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
