"""The main job: from a mission to a reconstructed entry."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from edl_filter import rotations
from edl_filter.assembly import assemble, without_effects
from edl_filter.effects.effect import Active
from edl_filter.mission import Mission
from edl_filter.mission.estimation import LandingSite
from edl_filter.navigation import initial
from edl_filter.navigation.filter import Forward, Problem, forward
from edl_filter.navigation.leave_one_out import Statement, entry_statement, statements
from edl_filter.navigation.smoother import Smoothed, smooth
from edl_filter.navigation.trajectory import Trajectory, trace
from edl_filter.planet import Planet
from edl_filter.planet.atmosphere import Atmosphere
from edl_filter.reading import read_atmosphere, read_telemetry
from edl_filter.telemetry.calibration import MisalignmentEstimate, bias_from_velocity_slope
from edl_filter.telemetry.comparison import centred, compare
from edl_filter.telemetry.record import Telemetry

if TYPE_CHECKING:
    from xarray import DataTree

    from edl_filter.report.plots import ReconstructionPlots
    from edl_filter.results.content import Derived

Array = NDArray[np.float64]


@dataclass(frozen=True)
class EntryCorrection:
    """What had to give in the entry state.

    Attributes
    ----------
    change, change_sigma : (9,) arrays
        Smoothed minus stated: position (m), velocity (m/s), attitude (rad, body axes), and one sigma of the
        smoothed state.
    rotation, rotation_left : (3,) array, (6,) array
        The one rotation of the state's frame (rad, inertial axes) that comes nearest to the change of position and
        velocity, and what it leaves of them.
    states : dict
        Name → (estimate, sigma) of the entry epoch (s) and the state's frame (rad, inertial axes), as far as they
        are states.
    """

    change: Array
    change_sigma: Array
    rotation: Array
    rotation_left: Array
    states: dict[str, tuple[Array, Array]]


@dataclass(frozen=True)
class Reconstruction:
    """A reconstructed entry and all that it came from.

    `comparison` sets each checking IMU beside the driving one: name → misalignment, where a window is covered.
    `pre_entry_bias` is the accelerometers' bias by the thesis's way, slope of the velocity before entry, and its sigma,
    (3,) each, m/s²; None where the mission has no such window. `telemetry`, `planet` and `atmosphere` are as read and
    stated; `effects` are those of which the estimate is free (`assembly.without_effects`), and the planet with their
    gravity is the problem's. `effect_sigma` has one sigma of what was refitted: effect → parameter → sigma.
    """

    mission: Mission
    telemetry: Telemetry
    planet: Planet
    atmosphere: Atmosphere
    problem: Problem
    forward: Forward
    smoothed: Smoothed
    trajectory: Trajectory
    statements: list[Statement]
    entry: EntryCorrection
    comparison: dict[str, MisalignmentEstimate]
    pre_entry_bias: tuple[Array, Array] | None
    timing: dict[str, float]
    effects: tuple[Active, ...] = ()
    effect_sigma: Mapping[str, Mapping[str, float]] = field(default_factory=dict)

    @cached_property
    def derived(self) -> Derived:
        """Air data, events, atmosphere and coefficients."""
        from edl_filter.results.content import derive

        return derive(self)

    @cached_property
    def _tree(self) -> DataTree:
        from edl_filter.results.content import content
        from edl_filter.results.effects import Judged
        from edl_filter.results.netcdf import tree_of

        return tree_of(content(self, self.derived, Judged(self.effect_sigma)))

    def to_xarray(self) -> DataTree:
        """All results as an xarray DataTree with units, the same as `edl_filter.read_result` gives of a run's file."""
        return self._tree.copy()

    def summary(self) -> dict[str, Any]:
        """Give what a person asks first, as ``summary.json`` has it."""
        from edl_filter.results.effects import Judged
        from edl_filter.results.summary import summary

        return summary(self, self.derived, Judged(self.effect_sigma))

    def save(self, folder: str | Path, figures: bool = True) -> Path:
        """Write ``result.nc``, ``summary.json``, tables and figures as ``edl-filter run`` does; gives the folder.

        Raises
        ------
        InputError
            The folder cannot be written, or an effect of the mission stands in no file.
        """
        from edl_filter.results.effects import Judged
        from edl_filter.results.outputs import write_outputs

        write_outputs(self, folder, figures, Judged(self.effect_sigma))
        return Path(folder)

    @property
    def plot(self) -> ReconstructionPlots:
        """Figures: ``reconstruction.plot.trajectory()`` and so on give matplotlib axes."""
        from edl_filter.report.plots import ReconstructionPlots

        return ReconstructionPlots(self._tree)

    def __repr__(self) -> str:
        added = ", ".join(a.name for a in self.effects) or "no effects"
        return f"<Reconstruction of {self.mission.name}: {len(self.trajectory.time)} samples, {added}>"

    def _repr_html_(self) -> str:
        from edl_filter.report.cards import reconstruction_card

        return reconstruction_card(self)

    @property
    def event_times(self) -> dict[str, float]:
        """Name → s since the epoch."""
        return dict(sorted((self.telemetry.events | self.mission.event_times()).items(), key=lambda e: e[1]))

    @property
    def site(self) -> Array | None:
        """Landing site, planet-fixed position (m), whether the estimate was held to it or not; None if not known."""
        stated = self.mission.constraints.landing
        if isinstance(stated, LandingSite):
            return stated.position
        return None if self.telemetry.landing is None else self.telemetry.landing.position

    @property
    def site_radius(self) -> float | None:
        """Distance of the landing site from the planet's centre, m."""
        return None if self.site is None else float(np.linalg.norm(self.site))


def reconstruct(
    mission: Mission, effects: Sequence[Active] | None = None, leave_one_out: bool = True
) -> Reconstruction:
    """Reconstruct an entry.

    Parameters
    ----------
    mission : Mission
    effects : sequence of Active, optional
        Instead of the mission's.
    leave_one_out : bool
        Predict every constraint from all others; without it there are no `statements`, which saves half of the time.

    Returns
    -------
    Reconstruction

    Raises
    ------
    InputError
        The mission's telemetry or tables are missing or not as they should be.
    """
    timing: dict[str, float] = {}
    with _timed(timing, "telemetry"):
        telemetry = read_telemetry(mission)
        atmosphere = read_atmosphere(mission)
        planet = mission.planet_model(telemetry.prime_meridian_at_epoch)
        active = mission.active_effects() if effects is None else tuple(effects)
    with _timed(timing, "filter"):
        problem = assemble(mission, telemetry, planet, atmosphere, active)
        way = forward(problem)
    with _timed(timing, "smoother"):
        smoothed = smooth(way)
        trajectory = trace(problem, smoothed, way.layout)
    with _timed(timing, "leave_one_out"):
        found = statements(problem, way) if leave_one_out else []
        entry, prior = _entry_correction(problem, way, smoothed)
        if leave_one_out:
            found.insert(0, entry_statement(smoothed, prior, -entry.change))
    with _timed(timing, "comparison"):
        corrected = without_effects(mission, telemetry, active)
        comparison = _compare(mission, corrected)
        bias = _pre_entry_bias(mission, corrected)
    return Reconstruction(
        mission=mission,
        telemetry=telemetry,
        planet=planet,
        atmosphere=atmosphere,
        problem=problem,
        forward=way,
        smoothed=smoothed,
        trajectory=trajectory,
        statements=found,
        entry=entry,
        comparison=comparison,
        pre_entry_bias=bias,
        timing=timing,
        effects=active,
    )


def _pre_entry_bias(mission: Mission, telemetry: Telemetry) -> tuple[Array, Array] | None:
    window = mission.constraints.pre_entry_zero_force
    if window is None:
        return None
    quiet = centred(telemetry.driving.between(window.start_s, window.end_s))
    return bias_from_velocity_slope(quiet.time, quiet.interval, quiet.specific_force, window.start_s, window.end_s)


def _compare(mission: Mission, telemetry: Telemetry) -> dict[str, MisalignmentEstimate]:
    parachute = (telemetry.events | mission.event_times()).get("parachute_deploy", np.inf)
    pairs = {other.name: compare(telemetry.driving, other, parachute) for other in telemetry.checking}
    return {name: estimate for name, estimate in pairs.items() if estimate is not None}


@contextmanager
def _timed(timing: dict[str, float], stage: str) -> Iterator[None]:
    begin = time.perf_counter()
    yield
    timing[stage] = time.perf_counter() - begin


def _entry_correction(problem: Problem, way: Forward, smoothed: Smoothed) -> tuple[EntryCorrection, Array]:
    """Correction of the entry state, and its prior covariance (9, 9)."""
    layout, stated = way.layout, problem.initial
    reference, covariance = initial.start(
        layout, stated, problem.entry, problem.instruments[int(problem.samples.unit[0])], problem.planet
    )
    change = smoothed.states[0].minus(reference)[:9]
    sigma = np.sqrt(np.diag(smoothed.covariance[0])).astype(float)
    scale = np.repeat(1.0 / np.array([np.linalg.norm(stated.position), np.linalg.norm(stated.velocity)]), 3)
    effect = initial.frame_effect(stated)
    rotation = np.asarray(np.linalg.lstsq(effect * scale[:, None], change[:6] * scale, rcond=None)[0], float)
    names = [n for n in ("entry_epoch", "entry_frame") if n in layout]
    states = {n: (smoothed.states[0].errors[layout[n]], sigma[layout[n]]) for n in names}
    entry = EntryCorrection(change, sigma[:9], rotation, change[:6] - effect @ rotation, states)
    return entry, covariance[:9, :9]


def in_j2000(mission: Mission, rotation: Array) -> Array | None:
    """Components in J2000 of an inertial rotation vector, where the mission says how the frames lie."""
    matrix = mission.planet.j2000_from_inertial_matrix
    return None if matrix is None else rotations.rotate(rotations.from_matrix(matrix), rotation)
