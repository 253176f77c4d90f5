"""Atmosphere of the flight and the preflight one (thesis figures 4.1 and 4.2, chapter 4)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from edl_filter.report.description import (
    Axis,
    Band,
    Curve,
    Element,
    Figure,
    Legend,
    Line,
    Panel,
    Text,
    bounds,
    significant,
)  # fmt: skip
from edl_filter.report.domain import DomainView
from edl_filter.results.reader import ResultReader, ValidationDomain
from edl_filter.types import Array, BoolArray

FLIGHT, PREFLIGHT = "atmosphere/flight", "atmosphere/preflight"
#: Largest relative sigma of a temperature or a ratio that is plotted.
LARGEST_SIGMA = 0.1
#: Time before the parachute at which a profile ends, s: the smoothing spreads the opening so far back.
_BEFORE_PARACHUTE = 0.5
_UNITS = {"density": "kg/m³", "pressure": "Pa", "temperature": "K"}


def mach_and_knudsen(reader: ResultReader) -> Figure:
    """Mach and Knudsen numbers with the flight's and the preflight atmosphere."""
    view = DomainView(reader, all_air=True)
    panels = (_mach(view), _knudsen(view), _differences(view))
    return view.figure("Mach and Knudsen numbers", panels, (2.4, 2.4, 2.0))


def _mach(view: DomainView) -> Panel:
    flight, preflight = view.values(FLIGHT, "mach"), view.values(PREFLIGHT, "mach")
    top = 1.25 * max(np.nanmax(preflight[view.inside]), np.nanmax(flight[view.domain.significant]))
    y = Axis("Mach number", "–", range=(0.0, float(top)))
    return view.panel(y, (*_pair(view, "mach"), *_continuum(view)), Legend("upper right", 1))


def _knudsen(view: DomainView) -> Panel:
    elements = [*_pair(view, "knudsen"), *_continuum(view)]
    if view.domain.continuum is not None:
        elements.append(Line(view.domain.continuum[1], "y", colour="green", dash="dot", width=1.2))
    return view.panel(Axis("Knudsen number", "–", "log"), elements)


def _differences(view: DomainView) -> Panel:
    mach, knudsen = (view.values("atmosphere_differences", name) for name in ("mach", "knudsen"))
    curves = (view.curve(mach, "blue", "Mach", 1.2, "%"), view.curve(knudsen, "orange", "Knudsen", 1.2, "%"))
    # the Mach number's first seconds, which depend on the initial pressure, would dominate the range
    later = np.where(view.domain.significant, mach, np.nan)
    y = Axis("flight minus\npreflight", "%", range=view.limits(later, knudsen, everywhere=True, legend=True))
    return view.panel(y, curves, Legend())


def _continuum(view: DomainView) -> list[Element]:
    """Time from which the database is entered with the Mach number."""
    if view.domain.continuum is None:
        return []
    time, limit = view.domain.continuum
    return [Line(time, "x", f"continuum (Kn < {limit:g})", "green", "dot", 1.4)]


def _pair(view: DomainView, name: str) -> list[Element]:
    preflight = view.curve(view.values(PREFLIGHT, name), "vermillion", "preflight", 1.4)
    return [view.curve(view.values(FLIGHT, name), "blue", "flight", 1.4), replace(preflight, dash="dash")]


@dataclass(frozen=True, eq=False)
class Profiles:
    """Altitude of the samples at which profiles are plotted.

    Attributes
    ----------
    reader : ResultReader
    domain : ValidationDomain
    inside : (N,) bool array
        Samples of the profiles.
    height : (M,) array
        Their altitude, km.
    """

    reader: ResultReader
    domain: ValidationDomain
    inside: BoolArray
    height: Array

    def values(self, group: str, name: str) -> Array | None:
        """Variable at the samples of the profiles ``(M,)``; None if the result does not have it."""
        values = self.reader.variable(f"postflight/{group}", name)
        return None if values is None else values[self.inside]

    @property
    def significant(self) -> BoolArray:
        """Samples ``(M,)`` at which the force coefficients are significant."""
        return self.domain.significant[self.inside]


def profiles(reader: ResultReader) -> Profiles | None:
    """Samples of the profiles; None if the result has no atmosphere, or too short a time with measurable air."""
    domain, height = reader.domain, reader.variable(f"postflight/{FLIGHT}", "altitude")
    if domain is None or height is None or not reader.has(f"postflight/{FLIGHT}:density"):
        return None
    inside = (domain.time >= domain.start) & (domain.time <= domain.end - _BEFORE_PARACHUTE)
    return Profiles(reader, domain, inside, 1e-3 * height[inside]) if inside.any() else None


def profile_panels(reader: ResultReader) -> tuple[Panel, ...]:
    """Density, pressure and temperature against altitude with one-sigma bands, and their ratios to the preflight ones.

    Panels of quantities that the result does not have are omitted.
    """
    samples = profiles(reader)
    if samples is None:
        return ()
    panels = [_profile(samples, name) for name in _UNITS if samples.values(FLIGHT, name) is not None]
    if any(samples.values(PREFLIGHT, name) is not None for name in _UNITS):
        panels.append(_ratios(samples))
    marks = _mach_marks(samples)
    return tuple(replace(panel, elements=(*marks, *panel.elements)) for panel in panels)


def atmosphere_profile(reader: ResultReader) -> Figure:
    """Profiles of the atmosphere and their ratios to the preflight one."""
    panels = profile_panels(reader)
    return Figure(
        f"{reader.title}: atmosphere along the flight", tuple(panels[k : k + 2] for k in range(0, len(panels), 2)),
        (3.5, 3.5), (1.0, 1.0), gaps=(0.12, 0.3), shared_y=True,
    )  # fmt: skip


def _height_axis(samples: Profiles) -> Axis:
    low, high = float(np.nanmin(samples.height)), float(np.nanmax(samples.height))
    return Axis("altitude", "km", range=(max(0.0, low - 3.0), high + 1.0))


def _profile(samples: Profiles, name: str) -> Panel:
    """One quantity against altitude."""
    flight, sigma = samples.values(FLIGHT, name), samples.values(FLIGHT, f"{name}_sigma")
    preflight = samples.values(PREFLIGHT, name)
    assert flight is not None
    linear, unit, height = name == "temperature", _UNITS[name], samples.height
    if linear:
        flight = significant(flight, sigma, LARGEST_SIGMA)
    reference = np.abs(flight) if preflight is None else preflight
    elements: list[Element] = []
    if sigma is not None:
        least = 0.0 if linear else 1e-3 * float(np.nanmin(reference))
        low, high = np.maximum(flight - sigma, least), flight + sigma
        elements.append(Band(height, low, high, "±1 sigma", "blue-band", "y"))
    line = flight if linear else np.where(flight > 0.0, flight, np.nan)
    elements.append(Curve(line, height, "flight", "blue", unit, independent="y"))
    if preflight is not None:
        elements.append(Curve(preflight, height, "preflight", "vermillion", unit, dash="dash", independent="y"))
    both = [flight[samples.significant] if linear else flight, *(() if preflight is None else (preflight,))]
    if linear:
        low_end, high_end = bounds(both, 0.01)
        x = Axis(name, unit, range=(max(low_end, 0.0), high_end))
    else:
        positive = np.concatenate(both)
        positive = positive[positive > 0.0]
        # the hydrostatic pressure begins with zero: its first metres do not deserve decades of the axis
        least = max(float(positive.min()), 0.02 * float(np.nanmin(reference)))
        x = Axis(name, unit, "log", (0.5 * least, 2.0 * float(positive.max())))
    caption = f"{name.capitalize()} along the flight."
    return Panel(
        x, _height_axis(samples), tuple(elements), legend=Legend("upper right", 1), name=f"profile_{name}",
        caption=caption,
    )  # fmt: skip


def _ratios(samples: Profiles) -> Panel:
    """Flight over preflight of all three quantities."""
    elements: list[Element] = [Line(1.0, "x")]
    values = [np.array([0.9, 1.1])]
    for name, colour in (("density", "blue"), ("pressure", "green"), ("temperature", "orange")):
        flight, preflight = samples.values(FLIGHT, name), samples.values(PREFLIGHT, name)
        if flight is None or preflight is None:
            continue
        sigma = samples.values(FLIGHT, f"{name}_sigma")
        ratio = significant(flight, sigma, LARGEST_SIGMA) / preflight
        if sigma is not None:
            low, high = ratio - sigma / preflight, ratio + sigma / preflight
            elements.append(Band(samples.height, np.maximum(low, 0.0), high, "", f"{colour}-band", "y", name))
        elements.append(Curve(ratio, samples.height, name, colour, "", 1.2, independent="y"))
        values.append(ratio if name == "density" else ratio[samples.significant])
    low_end, high_end = bounds(values, 0.01)
    return Panel(
        Axis("flight / preflight", "–", range=(max(low_end, 0.0), high_end)), _height_axis(samples), tuple(elements),
        legend=Legend("best", 1), name="profile_ratio",
        caption="Flight over preflight: 1 where the atmosphere is the expected one.",
    )  # fmt: skip


def _mach_marks(samples: Profiles) -> list[Element]:
    """Altitudes at which the flight falls below Mach numbers."""
    altitude = 1e-3 * samples.reader.required(f"postflight/{FLIGHT}", "altitude")
    marks: list[Element] = []
    for mach, time in samples.domain.mach_times.items():
        height = float(np.interp(time, samples.domain.time, altitude))
        marks.append(Line(height, "y", dash="dash"))
        marks.append(Text(f"Mach {mach}", 0.0, height, ("panel", "data"), (3.0, 1.0), "left", "bottom", 9.0, "muted"))
    return marks
