"""Panels over the validation domain: what the figures of the post-flight layer have in common."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from edl_filter.errors import InputError
from edl_filter.report.description import Axis, Band, Curve, Element, Figure, Legend, Panel, Span, bounds
from edl_filter.report.text import time_label
from edl_filter.results.reader import ResultReader, ValidationDomain
from edl_filter.types import Array, BoolArray

#: Room for a legend in one row, as a share of the range.
LEGEND_ROOM = 0.28


def instability_spans(
    domain: ValidationDomain, begin: float, end: float = np.inf, note: bool = True, height: float = 0.02
) -> tuple[Span, ...]:
    """Shaded intervals of the static instabilities."""
    return tuple(
        Span(max(low, begin), min(high, end), note="unstable" if note else "", height=height)
        for low, high in domain.instabilities
        if high > begin and low < end
    )


@dataclass(frozen=True, eq=False)
class DomainView:
    """A result over its validation domain.

    Attributes
    ----------
    reader : ResultReader
    all_air : bool
        Whether the time axis begins where the deceleration is measurable, instead of where the force coefficients are
        significant.
    """

    reader: ResultReader
    all_air: bool = False

    @cached_property
    def domain(self) -> ValidationDomain:
        """Validation domain of the result."""
        domain = self.reader.domain
        if domain is None:
            raise InputError(f"{self.reader.title}: found no post-flight groups; they need an aerodynamic database.")
        return domain

    @property
    def begin(self) -> float:
        """Begin of the time axis, s since the epoch."""
        return self.domain.start if self.all_air else self.domain.useful

    @cached_property
    def end(self) -> float:
        """End of the time axis, s since the epoch: the parachute, so that its line is visible."""
        parachute = self.reader.events.get("parachute_deploy", np.inf)
        return max(self.domain.end, parachute) if abs(parachute - self.domain.end) < 1.0 else self.domain.end

    @cached_property
    def inside(self) -> BoolArray:
        """Samples ``(N,)`` on the time axis."""
        return (self.domain.time >= self.begin) & (self.domain.time <= self.domain.end)

    @cached_property
    def events(self) -> dict[str, float]:
        """Mach numbers and the parachute; more events would crowd the row of labels."""
        parachute = {name: t for name, t in self.reader.events.items() if name == "parachute_deploy"}
        events = parachute | {f"Mach {mach}": t for mach, t in self.domain.mach_times.items()}
        return dict(sorted(events.items(), key=lambda event: event[1]))

    def values(self, group: str, name: str) -> Array:
        """Variable of group ``/postflight/<group>`` at all samples, ``(N,)`` or ``(N, 3)``."""
        return self.reader.required(f"postflight/{group}", name)

    def has(self, group: str, name: str) -> bool:
        """Whether the result has a variable of group ``/postflight/<group>``."""
        return self.reader.has(f"postflight/{group}:{name}")

    def curve(self, values: Array, colour: str, label: str = "", width: float = 1.0, unit: str = "") -> Curve:
        """Curve of a variable over the time axis.

        Parameters
        ----------
        values : (N,) array
            At all samples, in `unit`.
        colour, label : str
            Role of the colour; entry of the legend.
        width : float
            Width of the line, points.
        unit : str
            Unit of the values.
        """
        return Curve(self.domain.time[self.inside], values[self.inside], label, colour, unit, width)

    def band(self, low: Array, high: Array, colour: str, label: str = "") -> Band:
        """Band over the time axis.

        Parameters
        ----------
        low, high : (N,) arrays
            Limits at all samples, in one unit.
        colour, label : str
            Role of the colour; entry of the legend.
        """
        return Band(self.domain.time[self.inside], low[self.inside], high[self.inside], label, colour)

    def limits(
        self, *values: Array, legend: bool = False, everywhere: bool = False, outside: float = 0.004
    ) -> tuple[float, float]:
        """Range of nearly all values where the force coefficients are significant.

        Parameters
        ----------
        *values : (N,) arrays
            Variables in one unit.
        legend : bool
            Whether there is room for a row of legend at the top.
        everywhere : bool
            Consider the values on the whole time axis.
        outside : float
            Share of the samples that may be below, and above, the range.
        """
        samples = self.inside if everywhere else self.domain.significant
        low, high = bounds([v[samples] for v in values], outside)
        return low, high + (LEGEND_ROOM if legend else 0.0) * (high - low)

    def panel(self, y: Axis, elements: Sequence[Element], legend: Legend | None = None) -> Panel:
        """Panel over the time axis with the instabilities and the events."""
        x = Axis(time_label(self.reader.epoch_utc), "s", range=(self.begin, self.end))
        spans = instability_spans(self.domain, self.begin, self.end, note=False)
        return Panel(x, y, (*spans, *elements), self.events, legend)

    def figure(self, subject: str, panels: Sequence[Panel], heights: Sequence[float]) -> Figure:
        """Panels one below the other; the first names the instabilities.

        Parameters
        ----------
        subject : str
            Subject of the title.
        panels : sequence of Panel
            From `panel`.
        heights : sequence of float
            Height of each panel, inches.
        """
        first = panels[0]
        elements = tuple(replace(e, note="unstable") if isinstance(e, Span) else e for e in first.elements)
        rows = ((replace(first, elements=elements),), *((panel,) for panel in panels[1:]))
        return Figure(
            f"{self.reader.title}: {subject}", rows, tuple(heights), margins=(1.2, 0.3, 0.65), gaps=(0.18, 0.1),
            shared_x=True, event_labels=True,
        )  # fmt: skip
