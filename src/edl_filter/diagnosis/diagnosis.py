"""Diagnosis of one flight: where the model fails, which effect is missing, what is left."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from edl_filter.aero.increments import DatabaseUpdate
from edl_filter.diagnosis.linear_model.flight_case import FlightCase
from edl_filter.diagnosis.residual_analysis.change_point import Onset, onsets
from edl_filter.diagnosis.residual_analysis.database_update import estimate_database_update
from edl_filter.diagnosis.residual_analysis.latent_force import LatentForce, estimate_latent_force
from edl_filter.diagnosis.residual_analysis.nuisance_shifts import NuisanceShift, nuisance_shifts
from edl_filter.diagnosis.residual_analysis.residual_map import Cell, model_rms, residual_map, residual_series
from edl_filter.diagnosis.residual_analysis.unexplained import Remainder, describe_remainder
from edl_filter.diagnosis.selection.decision import UNKNOWN, Verdict, decide
from edl_filter.diagnosis.selection.evidence_profile import evidence_profile
from edl_filter.diagnosis.selection.ranking import Progress, Ranking, rank
from edl_filter.diagnosis.state import state_sentences
from edl_filter.display import render
from edl_filter.effects.base import Effect, EffectInstance
from edl_filter.results.netcdf import tree_of

if TYPE_CHECKING:
    from xarray import DataArray, Dataset


@dataclass(frozen=True)
class Diagnosis:
    """What is wrong with a model, and what would improve it.

    Attributes
    ----------
    mission : str
        Name.
    effects : tuple of str
        Labels of those in the model already.
    cells : list of Cell
        The residual map.
    verdict : Verdict
    ranking : Ranking
    remainder : Remainder or None
        Described where the verdict is ``unknown``.
    latent : LatentForce or None
        Unmodelled force and moment against time, in the same case.
    onsets : list of Onset
        When channels begin to fail, clearest first.
    errors : dict
        Channel → normalised RMS over the flight, as the model is.
    noise_floor : float
        Normalised RMS that chance allows over the flight: its 97.5 % point.
    update : DatabaseUpdate or None
        What the flight says of the database, with the model as it is; None with an exact database.
    shifts : tuple of NuisanceShift
        Nuisance parameters that the flight moves away from what the mission states.
    """

    mission: str
    effects: tuple[str, ...]
    cells: list[Cell]
    verdict: Verdict
    ranking: Ranking
    remainder: Remainder | None
    latent: LatentForce | None
    onsets: list[Onset]
    errors: dict[str, float]
    noise_floor: float
    update: DatabaseUpdate | None
    shifts: tuple[NuisanceShift, ...]

    @property
    def title(self) -> str:
        """Name of the flight, for people."""
        mission = self.ranking.case.mission
        return mission.title or mission.name

    @property
    def database_proxy(self) -> str | None:
        """For what the aerodynamic database of the mission is a proxy; None where it is the vehicle's own."""
        aerodynamics = self.ranking.case.mission.aerodynamics
        return None if aerodynamics is None else aerodynamics.proxy

    @cached_property
    def state(self) -> tuple[str, ...]:
        """How much fails, the verdict, what the leading effect reduces, and what qualifies that: one sentence each."""
        minimum_rms = self.ranking.case.settings.cell_minimum_rms
        return state_sentences(self.cells, self.verdict, self.errors, self.database_proxy, minimum_rms)

    @property
    def leader(self) -> EffectInstance | None:
        """The effect that is missing, with its estimate; None unless the verdict is ``missing``."""
        return self.verdict.leader

    @cached_property
    def residuals(self) -> Dataset:
        """Residuals against time: ``residual``, ``sigma`` and ``normalised`` by ``channel`` and ``time``."""
        return tree_of(residual_series(self.ranking.model)).to_dataset()

    def scan(
        self,
        effect: str | Effect | type[Effect],
        place: str | None = None,
        values: Sequence[float] | None = None,
    ) -> DataArray:
        """Evidence of an effect at every place that it may have; see `selection.evidence_profile`."""
        return evidence_profile(self.ranking.model, effect, place, values)

    @property
    def plot(self) -> Any:
        """Figures: ``diagnosis.plot.heatmap()`` and so on return matplotlib axes."""
        return render("plot", self)

    def __repr__(self) -> str:
        return f"<Diagnosis of {self.mission}: {' '.join(self.state[:2])}>"

    def _repr_html_(self) -> str:
        return str(render("html", self))


def diagnose(case: FlightCase, candidates: Iterable[Effect], progress: Progress = lambda _: None) -> Diagnosis:
    """Diagnose a flight.

    Parameters
    ----------
    case : FlightCase
        The flight with what its mission states as uncertain.
    candidates : iterable of Effect
        What may be missing; those in the model are passed over, or offered once more if they act at a place.
    progress : callable
        Called with what is being done.
    """
    ranking = rank(case, candidates, progress)
    verdict = decide(ranking)
    progress("describing what is left")
    model, unknown = ranking.model, verdict.verdict == UNKNOWN
    update = estimate_database_update(model)
    return Diagnosis(
        mission=case.mission.name,
        effects=tuple(a.label for a in case.effects),
        cells=residual_map(model),
        verdict=verdict,
        ranking=ranking,
        remainder=describe_remainder(model) if unknown else None,
        latent=estimate_latent_force(model, ranking.unmodelled) if unknown else None,
        onsets=onsets(model),
        errors=model_rms(model),
        noise_floor=float(np.sqrt(1.0 + 1.96 * np.sqrt(2.0 / model.index.count))),
        update=update,
        shifts=nuisance_shifts(model, update),
    )
