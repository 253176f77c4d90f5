"""Figures in Python: ``result.plot`` and ``diagnosis.plot``, accessors to the figures of a run.

Each method draws one of the figures that a run or a diagnosis writes, displays it through pyplot, and returns its
matplotlib axes, one or an array of them, to draw on further. With ``ax`` or ``axes`` they
draw on these axes instead.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from edl_filter.errors import InputError
from edl_filter.report import attitude, constraints, diagnosis, motion, track, trajectory
from edl_filter.report.description import Figure, Panel
from edl_filter.report.figures import FIGURES, available
from edl_filter.report.matplotlib_renderer import draw, draw_panel, pyplot_figures
from edl_filter.report.residual_map import residual_map
from edl_filter.results.reader import ResultReader
from edl_filter.results.residual_series import ResidualSeries
from edl_filter.results.schema import DiagnosisContent

if TYPE_CHECKING:
    from edl_filter.diagnosis.diagnosis import Diagnosis
    from edl_filter.effects.base import Effect
    from edl_filter.results.result import Result

AxesArray = NDArray[np.object_]

#: Argument of `ResultPlots.coefficients` → figure.
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
        self._reader = ResultReader.of(result.groups)

    def __repr__(self) -> str:
        return f"<figures of {self._reader.title}: {', '.join(n for n in dir(self) if n[0] != '_')}>"

    def trajectory(self, axes: Sequence[Axes] | None = None) -> AxesArray:
        """Altitude (km), air-relative velocity (km/s) and the uncertainty of both against time, ``(3,)``."""
        return self.figure("altitude_velocity", axes)

    def altitude(self, ax: Axes | None = None) -> Axes:
        """Areodetic altitude (km)."""
        return self._panel(trajectory.altitude(self._reader), "altitude", ax)

    def velocity(self, ax: Axes | None = None) -> Axes:
        """Air-relative velocity (km/s)."""
        return self._panel(trajectory.speed(self._reader), "air-relative velocity", ax)

    def uncertainty(self, ax: Axes | None = None) -> Axes:
        """Three sigma of altitude (m) and velocity (m/s)."""
        return self._panel(trajectory.uncertainty(self._reader), "3 sigma of altitude and velocity", ax)

    def deceleration(self, ax: Axes | None = None) -> Axes:
        """Axial deceleration (m/s²), logarithmic."""
        return self._panel(motion.axial_deceleration(self._reader), "axial deceleration", ax)

    def accelerations(self, axes: Sequence[Axes] | None = None) -> AxesArray:
        """Accelerations at the centre of mass (m/s²), before and under the parachute."""
        return self.figure("accelerations", axes)

    def rates(self, axes: Sequence[Axes] | None = None) -> AxesArray:
        """Angular rates (°/s), before and under the parachute."""
        return self.figure("angular_rates", axes)

    def angle_of_attack(self, ax: Axes | None = None) -> Axes:
        """Total angle of attack (°) with bands of one and three sigma, until the parachute."""
        return self._panel(attitude.total_angle_of_attack(self._reader), "total angle of attack", ax)

    def quaternion(self, ax: Axes | None = None) -> Axes:
        """Quaternion to the body, until the parachute."""
        return self._panel(attitude.quaternion(self._reader), attitude.quaternion_subject(self._reader), ax)

    def track(self, axes: Sequence[Axes] | None = None) -> AxesArray:
        """Ground track, and the landing with its 3-sigma ellipses (km)."""
        return self.figure("ground_track", axes)

    def landing(self, ax: Axes | None = None, *, near: bool = False) -> Axes:
        """Landing position with and without the landing constraint (km).

        Parameters
        ----------
        ax : Axes, optional
            Axes to draw on.
        near : bool
            Whether the axes have the extent of the estimate and the site only.
        """
        return self._panel(track.landing_ellipse(self._reader, near), "landing", ax, inches=5.7)

    def constraints(self, ax: Axes | None = None) -> Axes:
        """Innovations of all constraints, in sigmas."""
        return self._rows("constraint_innovations", ax)

    def left_out(self, ax: Axes | None = None) -> Axes:
        """Each constraint against the prediction from all others, in sigmas."""
        return self._rows("leave_one_out", ax)

    def atmosphere(self, axes: Sequence[Axes] | None = None) -> AxesArray:
        """Density (kg/m³), pressure (Pa), temperature (K) against altitude, and their ratios to the preflight ones."""
        return self.figure("atmosphere_profile", axes)

    def mach(self, axes: Sequence[Axes] | None = None) -> AxesArray:
        """Mach and Knudsen numbers with the flight's and the preflight atmosphere."""
        return self.figure("mach_and_knudsen", axes)

    def coefficients(self, which: str = "forces", axes: Sequence[Axes] | None = None) -> AxesArray:
        """Aerodynamic coefficients of flight and database.

        Parameters
        ----------
        which : {"forces", "moments", "rolling", "atmospheres", "database"}
            CN and CY, or Cm and Cn, by three methods; Cl and its parts; change of the flight's, or of the database's
            coefficients with the atmosphere.
        axes : sequence of Axes, optional
            Axes to draw on, one for each panel.

        Raises
        ------
        InputError
            There is no such figure, or no database to compare with.
        """
        if which not in COEFFICIENTS:
            raise InputError(f"coefficients: found {which!r}; accepted: {', '.join(COEFFICIENTS)}.")
        return self.figure(COEFFICIENTS[which], axes)

    def angles(self, axes: Sequence[Axes] | None = None) -> AxesArray:
        """Angle of attack and sideslip (°) by three methods, and their differences."""
        return self.figure("angles_by_method", axes)

    def angular_accelerations(self, axes: Sequence[Axes] | None = None) -> AxesArray:
        """Angular accelerations (°/s²) with their bands."""
        return self.figure("angular_accelerations", axes)

    def oscillation(self, axes: Sequence[Axes] | None = None) -> AxesArray:
        """Lateral rates (°/s), growth of the oscillation by its damping (1/s) and static stability (1/rad)."""
        return self.figure("oscillation", axes)

    def figure(self, name: str, axes: Sequence[Axes] | None = None) -> AxesArray:
        """Any figure of a run by the name of its file.

        Parameters
        ----------
        name : str
            Name of the file without its suffix.
        axes : sequence of Axes, optional
            Axes to draw on, one for each panel.

        Raises
        ------
        InputError
            There is no figure of that name, this flight has no data for it, or the number of axes is wrong.
        """
        return _drawn(self._describe(name), axes)

    def _describe(self, name: str) -> Figure:
        names = available(self._reader)
        if name not in names:
            raise InputError(f"plot: found no data for {name!r}; this flight has: {', '.join(names)}.")
        return FIGURES[name].describe(self._reader)

    def _panel(self, panel: Panel, subject: str, ax: Axes | None, inches: float = 3.6) -> Axes:
        return _drawn_panel(Figure(f"{self._reader.title}: {subject}", ((panel,),), (inches,), event_labels=True), ax)

    def _rows(self, name: str, ax: Axes | None) -> Axes:
        if ax is None:
            return self.figure(name)[0]
        panel = {"constraint_innovations": constraints.innovations, "leave_one_out": constraints.left_out}[name]
        return draw_panel(panel(self._reader), ax)


class DiagnosisPlots:
    """Figures of a diagnosis."""

    def __init__(self, diagnosis: Diagnosis) -> None:
        self._diagnosis = diagnosis
        self._content = DiagnosisContent.of(diagnosis.content())

    def __repr__(self) -> str:
        names = ", ".join(n for n in dir(self) if n[0] != "_")
        return f"<figures of the diagnosis of {self._diagnosis.title}: {names}>"

    def heatmap(self, axes: Sequence[Axes] | None = None) -> AxesArray:
        """Normalised RMS of every channel and regime, of every constraint, and the scale, ``(3,)``.

        Parameters
        ----------
        axes : sequence of Axes, optional
            Two axes to draw the channels and the constraints on, without the scale.
        """
        return _drawn(residual_map(self._content, self._diagnosis.title), axes)

    def ranking(self, ax: Axes | None = None) -> Axes:
        """Gain of every hypothesis (nats)."""
        return _drawn_panel(diagnosis.ranking(self._content, self._diagnosis.title), ax)

    def missing(self, axes: Sequence[Axes] | None = None) -> AxesArray:
        """Missing force (N) and moment (N m) against time with bands of two sigmas, ``(2,)``.

        Parameters
        ----------
        axes : sequence of Axes, optional
            Two axes to draw on.

        Raises
        ------
        InputError
            The verdict is not ``unknown``: nothing was estimated.
        """
        if self._content.latent is None:
            raise InputError(
                f"missing: found the verdict {self._content.verdict!r}; a missing force is estimated where it is "
                "'unknown'."
            )
        return _drawn(diagnosis.missing(self._content.latent, self._content.onsets, self._diagnosis.title), axes)

    def residual(self, channel: str, ax: Axes | None = None) -> Axes:
        """One channel's residual against time, in its unit, with the band of two stated sigmas.

        Parameters
        ----------
        channel : str
            As in ``diagnosis.residuals.channel``, such as ``moment_y``.
        ax : Axes, optional
            Axes to draw on.

        Raises
        ------
        InputError
            There is no such channel.
        """
        series = ResidualSeries.from_dataset(self._diagnosis.residuals)
        panel = diagnosis.residual_panel(series, channel, self._content.map)
        return self._panel(panel, f"residual of {channel.replace('_', ' ')}", ax)

    def scan(
        self,
        effect: str | Effect | type[Effect],
        place: str | None = None,
        values: Sequence[float] | None = None,
        ax: Axes | None = None,
    ) -> Axes:
        """Evidence for an effect (nats) against one of its places.

        Parameters
        ----------
        effect, place, values
            As in `Diagnosis.scan`.
        ax : Axes, optional
            Axes to draw on.
        """
        gains = self._diagnosis.scan(effect, place, values)
        return self._panel(diagnosis.evidence_panel(gains), f"evidence for {gains.name}", ax)

    def fall(self, *earlier: Diagnosis, ax: Axes | None = None) -> Axes:
        """Normalised RMS of the channels that fail, from earlier diagnoses of the same flight to this one.

        Parameters
        ----------
        *earlier : Diagnosis
            Diagnoses of the preceding models, in order.
        ax : Axes, optional
            Axes to draw on.

        Raises
        ------
        InputError
            No earlier diagnosis is given, or one of another flight.
        """
        if not earlier:
            raise InputError("fall: found no earlier diagnosis; expected those of the models before, in order.")
        for step in earlier:
            if step.mission != self._diagnosis.mission:
                raise InputError(
                    f"fall: found a diagnosis of {step.mission!r}; expected one of {self._diagnosis.mission!r}."
                )
        steps = [*earlier, self._diagnosis]
        changes = [
            diagnosis.model_change(
                " + ".join(e for e in successor.effects if e not in step.effects) or "the same effects"
            )
            for step, successor in pairwise(steps)
        ]
        errors = [step.errors for step in steps]
        minimum_rms = self._content.settings.cell_minimum_rms
        figure = diagnosis.ledger_figure(
            errors, changes, self._diagnosis.noise_floor, minimum_rms, self._diagnosis.title
        )
        return _drawn_panel(figure, ax)

    def _panel(self, panel: Panel, subject: str, ax: Axes | None) -> Axes:
        return _drawn_panel(diagnosis.single_figure(panel, f"{self._diagnosis.title}: {subject}"), ax)


def _drawn(figure: Figure, axes: Sequence[Axes] | None) -> AxesArray:
    """A figure that pyplot displays, or its panels on given axes."""
    if axes is None:
        return _displayed(figure)
    panels = [panel for row in figure.rows for panel in row]
    given = np.ravel(np.asarray(axes, object))
    if len(given) != len(panels):
        raise InputError(f"plot: found {len(given)} axes; expected {len(panels)}, one for each panel.")
    for panel, ax in zip(panels, given, strict=True):
        draw_panel(panel, ax)
    return given


def _drawn_panel(figure: Figure, ax: Axes | None) -> Axes:
    """Axes of a figure of one panel, as `_drawn`."""
    return _drawn(figure, None if ax is None else (ax,))[0]


def _displayed(figure: Figure) -> AxesArray:
    """Axes of a figure that pyplot displays."""
    with pyplot_figures():
        canvas = draw(figure)
    axes = np.empty(len(canvas.axes), object)
    axes[:] = canvas.axes
    return axes
