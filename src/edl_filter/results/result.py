"""A result: a reconstruction, the refit of its effects, and the quantities derived from both."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from edl_filter.display import render
from edl_filter.effects.base import EffectInstance
from edl_filter.mission import Mission
from edl_filter.navigation.trajectory import Trajectory
from edl_filter.pipeline import reconstruct as pipeline
from edl_filter.pipeline.reconstruct import Reconstruction
from edl_filter.pipeline.trust import Trust, judge
from edl_filter.postflight.flight import DerivedQuantities, derived_quantities
from edl_filter.results.content import content
from edl_filter.results.groups import Groups
from edl_filter.results.netcdf import tree_of
from edl_filter.results.summary import RefitSummary, summary

if TYPE_CHECKING:
    from xarray import DataTree


@dataclass(frozen=True)
class Result:
    """A reconstructed entry with its derived quantities, as ``edl-filter run`` writes it.

    Attributes
    ----------
    reconstruction : Reconstruction
        Telemetry, filter, smoother, trajectory.
    refit : RefitSummary
        Sigmas of refitted effects and normalised residuals, where there are any.
    """

    reconstruction: Reconstruction
    refit: RefitSummary = field(default_factory=RefitSummary)

    @property
    def mission(self) -> Mission:
        """The mission that was reconstructed."""
        return self.reconstruction.mission

    @property
    def effects(self) -> tuple[EffectInstance, ...]:
        """Effects of the model, at their estimates."""
        return self.reconstruction.effects

    @property
    def trajectory(self) -> Trajectory:
        """Smoothed trajectory at every sample."""
        return self.reconstruction.trajectory

    @cached_property
    def derived(self) -> DerivedQuantities:
        """Air data, events, atmosphere and coefficients."""
        return derived_quantities(self.reconstruction)

    @cached_property
    def trust(self) -> Trust:
        """Whether the result may be trusted, and the likeliest cause if not."""
        return judge(self.reconstruction)

    @cached_property
    def groups(self) -> Groups:
        """Contents of ``result.nc``: path → `Group`."""
        return content(self.reconstruction, self.derived, self.refit, self.trust)

    @cached_property
    def _tree(self) -> DataTree:
        return tree_of(self.groups)

    def to_xarray(self) -> DataTree:
        """Contents as an xarray DataTree, the same as `edl_filter.read_result` of a run's file.

        Every variable has ``units`` and ``long_name``, and a ``standard_name`` where the CF table has the quantity.
        ``tree["trajectory"].to_dataset()`` is the trajectory as a Dataset by ``time``, s since the epoch.
        """
        return self._tree.copy()

    def summary(self) -> dict[str, Any]:
        """Main results as plain data, the contents of ``summary.json``."""
        return summary(self.reconstruction, self.derived, self.refit, self.trust)

    def save(self, folder: str | Path, figures: bool = True) -> Path:
        """Write ``result.nc``, ``summary.json``, tables and figures as ``edl-filter run`` does; returns the folder.

        Raises
        ------
        InputError
            The folder cannot be written, or an effect of the mission is defined in no file.
        """
        render("save", self, folder, figures)
        return Path(folder)

    @property
    def plot(self) -> Any:
        """Figures: ``result.plot.trajectory()`` and so on return matplotlib axes."""
        return render("plot", self)

    def __repr__(self) -> str:
        text = repr(self.reconstruction).replace("Reconstruction", "Result", 1)
        return f"{text[:-1]}; .to_xarray() has its data with units>"

    def _repr_html_(self) -> str:
        return str(render("html", self))


def reconstruct(
    mission: Mission, effects: Sequence[EffectInstance] | None = None, leave_one_out: bool = True
) -> Result:
    """Reconstruct an entry.

    Parameters
    ----------
    mission : Mission
        Telemetry, models and settings.
    effects : sequence of EffectInstance, optional
        Instead of the mission's; held at their values.
    leave_one_out : bool
        Predict every constraint from all others; without it there are no checks, which saves half of the time.

    Returns
    -------
    Result

    Raises
    ------
    InputError
        The mission's telemetry or tables are missing or invalid.
    """
    return Result(pipeline.reconstruct(mission, effects, leave_one_out))
