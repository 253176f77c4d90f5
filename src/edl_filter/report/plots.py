"""Figures for notebooks: ``result.plot`` and ``diagnosis.plot``, accessors over the figures of a run.

Each method draws one of the figures that a run or a diagnosis writes, shows it through pyplot, and gives its matplotlib
axes, one or an array of them, to draw on further. Methods that take ``ax`` draw on that instead.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray
from xarray import DataArray

from edl_filter.diagnosis.diagnosis_json import diagnosis_content
from edl_filter.errors import InputError
from edl_filter.report import (
    attitude,
    constraints,
    diagnosis,
    figures,
    motion,
    residuals,
    style,
    track,
    trajectory,
    view,
)

if TYPE_CHECKING:
    from edl_filter.diagnosis.diagnosis import Diagnosis
    from edl_filter.effects.base import Effect
    from edl_filter.results.result import Result

AxesArray = NDArray[np.object_]
Panel = Callable[..., Axes]

#: What `ResultPlots.coefficients` is asked for → figure.
COEFFICIENTS = {
    "forces": "force_coefficients",
    "moments": "moment_coefficients",
    "rolling": "rolling_moment",
    "atmospheres": "flight_atmospheres",
    "database": "database_atmospheres",
}


class ResultPlots:
    """Figures of a result."""

    def __init__(self, result: Result) -> None:
        self._tree = result.to_xarray()

    def __repr__(self) -> str:
        return f"<figures of {view.title(self._tree)}: {', '.join(n for n in dir(self) if n[0] != '_')}>"

    def trajectory(self) -> AxesArray:
        """Altitude (km), air-relative velocity (km/s) and the uncertainty of both against time, ``(3,)``."""
        return self.figure("altitude_velocity")

    def altitude(self, ax: Axes | None = None) -> Axes:
        """Areodetic altitude (km)."""
        return self._panel(trajectory.altitude, ax)

    def velocity(self, ax: Axes | None = None) -> Axes:
        """Air-relative velocity (km/s)."""
        return self._panel(trajectory.speed, ax)

    def uncertainty(self, ax: Axes | None = None) -> Axes:
        """Three sigma of altitude (m) and velocity (m/s)."""
        return self._panel(trajectory.uncertainty, ax)

    def deceleration(self, ax: Axes | None = None) -> Axes:
        """Axial deceleration (m/s²), logarithmic."""
        return self._panel(motion.axial_deceleration, ax, "axial_deceleration")

    def accelerations(self) -> AxesArray:
        """Accelerations at the centre of mass (m/s²), before and under the parachute."""
        return self.figure("accelerations")

    def rates(self) -> AxesArray:
        """Angular rates (°/s), before and under the parachute."""
        return self.figure("angular_rates")

    def angle_of_attack(self, ax: Axes | None = None) -> Axes:
        """Total angle of attack (°) with bands of one and three sigma, up to the parachute."""
        return self._panel(attitude.total_angle_of_attack, ax)

    def quaternion(self, ax: Axes | None = None) -> Axes:
        """Quaternion to the body, up to the parachute."""
        return self._panel(attitude.quaternion, ax)

    def track(self) -> AxesArray:
        """Ground track, and the landing with its 3-sigma ellipses (km)."""
        return self.figure("ground_track")

    def landing(self, ax: Axes | None = None, *, near: bool = False) -> Axes:
        """Landing place with and without the landing constraint (km); `near`: the estimate and the site alone."""
        return self._panel(lambda tree, ax: track.landing_ellipse(tree, ax, near=near), ax, "ground_track")

    def constraints(self, ax: Axes | None = None) -> Axes:
        """Innovations of all constraints, in sigmas."""
        return self._panel(constraints.innovations, ax, "constraint_innovations")

    def left_out(self, ax: Axes | None = None) -> Axes:
        """Each constraint against the prediction from all others, in sigmas."""
        return self._panel(constraints.left_out, ax, "leave_one_out")

    def atmosphere(self) -> AxesArray:
        """Density (kg/m³), pressure (Pa), temperature (K) against altitude, and their ratios to those expected."""
        return self.figure("atmosphere_profile")

    def mach(self) -> AxesArray:
        """Mach and Knudsen numbers with the flight's atmosphere and the one expected."""
        return self.figure("mach_and_knudsen")

    def coefficients(self, which: str = "forces") -> AxesArray:
        """Aerodynamic coefficients of flight and database.

        Parameters
        ----------
        which : {"forces", "moments", "rolling", "atmospheres", "database"}
            CN and CY, or Cm and Cn, by three methods; Cl and its parts; what the choice of the atmosphere changes in
            the flight's, or in the database's.

        Raises
        ------
        InputError
            There is no such figure, or no database to compare with.
        """
        if which not in COEFFICIENTS:
            raise InputError(f"coefficients: found {which!r}; accepted: {', '.join(COEFFICIENTS)}.")
        return self.figure(COEFFICIENTS[which])

    def angles(self) -> AxesArray:
        """Angle of attack and sideslip (°) by three methods, and their differences."""
        return self.figure("angles_by_method")

    def angular_accelerations(self) -> AxesArray:
        """Angular accelerations (°/s²) with their bands."""
        return self.figure("angular_accelerations")

    def oscillation(self) -> AxesArray:
        """Lateral rates (°/s), growth of the oscillation by its damping (1/s) and static stability (1/rad)."""
        return self.figure("oscillation")

    def figure(self, name: str) -> AxesArray:
        """Any figure of a run by the name of its file.

        Raises
        ------
        InputError
            There is none of that name, or this flight has no data for it.
        """
        known = figures.available(self._tree)
        if name not in known:
            raise InputError(f"plot: found no data for {name!r}; this flight has: {', '.join(known)}.")
        return _axes(_drawn(figures.FIGURES[name], self._tree))

    def _panel(self, draw: Panel, ax: Axes | None, name: str = "") -> Axes:
        if name and name not in figures.available(self._tree):
            raise InputError(f"plot: found no data for {name!r} in this flight.")
        return _drawn(draw, self._tree, ax)


class DiagnosisPlots:
    """Figures of a diagnosis."""

    def __init__(self, found: Diagnosis) -> None:
        self._found = found
        self._told: dict[str, Any] = diagnosis_content(found)

    def __repr__(self) -> str:
        return f"<figures of the diagnosis of {self._found.title}: {', '.join(n for n in dir(self) if n[0] != '_')}>"

    def heatmap(self) -> AxesArray:
        """Normalised RMS of every channel and regime, of every constraint, and the scale, ``(3,)``."""
        return _axes(_drawn(diagnosis.heatmap, self._told, self._found.title))

    def ranking(self) -> Axes:
        """Gain of every hypothesis (nats)."""
        return _axes(_drawn(diagnosis.ranking, self._told, self._found.title))[0]

    def missing(self) -> AxesArray:
        """Missing force (N) and moment (N m) against time with bands of two sigmas, ``(2,)``.

        Raises
        ------
        InputError
            The verdict is not ``unknown``: nothing was estimated.
        """
        if self._told["latent"] is None:
            raise InputError(
                f"missing: found the verdict {self._told['verdict']!r}; a missing force is estimated where it is "
                "'unknown'."
            )
        return _axes(_drawn(diagnosis.missing, self._told, self._found.title))

    def residual(self, channel: str, ax: Axes | None = None) -> Axes:
        """One channel's residual against time, in its unit, with the band of two stated sigmas.

        Parameters
        ----------
        channel : str
            As in ``diagnosis.residuals.channel``, such as ``moment_y``.
        ax : Axes, optional

        Raises
        ------
        InputError
            There is no such channel.
        """
        return _drawn(residuals.residual, self._found.residuals, channel, self._told["map"], self._found.title, ax)

    def scan(
        self,
        effect: str | Effect | type[Effect],
        place: str | None = None,
        values: Sequence[float] | None = None,
        ax: Axes | None = None,
    ) -> Axes:
        """Evidence for an effect (nats) against one of its places; see `Diagnosis.scan`."""
        gains: DataArray = self._found.scan(effect, place, values)
        return _drawn(residuals.scan, gains, self._found.title, ax)

    def fall(self, *earlier: Diagnosis) -> Axes:
        """How the error of the channels that fail fell, from `earlier` diagnoses of the same flight to this one.

        Raises
        ------
        InputError
            No earlier diagnosis is given, or one of another flight.
        """
        if not earlier:
            raise InputError("fall: found no earlier diagnosis; expected those of the models before, in order.")
        steps = [*earlier, self._found]
        for one in earlier:
            if one.mission != self._found.mission:
                raise InputError(
                    f"fall: found a diagnosis of {one.mission!r}; expected one of {self._found.mission!r}."
                )
        after = [*steps[1:], self._found]
        lines = [
            {
                "added": " + ".join(e for e in nxt.effects if e not in one.effects) or "the same effects",
                "errors": {name: {"before": rms} for name, rms in one.errors.items()},
            }
            for one, nxt in zip(steps, after, strict=True)
        ]
        return _axes(_drawn(diagnosis.ledger_figure, lines, self._found.noise_floor, self._found.title))[0]


def _drawn(draw: Callable[..., Any], *arguments: Any) -> Any:
    """What `draw` gives, its figure made with pyplot."""
    with style.shown():
        return draw(*arguments)


def _axes(made: Figure) -> AxesArray:
    found = np.empty(len(made.axes), object)
    found[:] = made.axes
    return found
