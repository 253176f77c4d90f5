"""Altitude and speed (thesis figure 3.12), Mach number and dynamic pressure, and the uncertainty of the trajectory."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from edl_filter.report.description import Axis, Curve, Dash, Element, Figure, Legend, Line, Panel, Text, bounds
from edl_filter.report.text import event_label, time_label, words
from edl_filter.results.reader import Phase, ResultReader
from edl_filter.types import Array, BoolArray

#: Events that are named on the path of altitude over speed; the others are too close to them.
_NAMED = ("entry_interface", "peak_deceleration", "parachute_deploy", "landing")


def time_axis(reader: ResultReader, phase: Phase = "flight") -> Axis:
    """Time axis of a phase of the flight."""
    return Axis(time_label(reader.epoch_utc), "s", range=reader.span(phase))


def samples_within(time: Array, axis: Axis) -> BoolArray:
    """Samples ``(N,)`` within the range of a time axis.

    Parameters
    ----------
    time : (N,) array
        s since the epoch.
    axis : Axis
        Time axis with a range.
    """
    assert axis.range is not None
    return (time >= axis.range[0]) & (time <= axis.range[1])


def altitude(reader: ResultReader) -> Panel:
    """Areodetic altitude, with the height above the landing place on a second axis."""
    axis = time_axis(reader)
    time, values = reader.time, 1e-3 * reader.required("trajectory", "altitude")
    inside = samples_within(time, axis)
    elements: list[Element] = [Curve(time[inside], values[inside], "altitude", "blue", "km")]
    shifted = None
    if "landing" in reader.events:
        ground = float(np.interp(reader.events["landing"], time, values))
        elements.append(Line(ground, dash="dot"))
        shifted = ("above landing\nplace (km)", ground)
    return Panel(axis, Axis("areodetic\naltitude", "km"), tuple(elements), reader.events, shifted_axis=shifted)


def speed(reader: ResultReader) -> Panel:
    """Air-relative speed."""
    values = 1e-3 * reader.required("trajectory", "speed")
    inside = samples_within(reader.time, time_axis(reader))
    top = 1.05 * float(np.nanmax(values[inside])) or 1.0
    return _panel(
        reader, "speed", Axis("air-relative\nvelocity", "km/s", range=(0.0, top)), "velocity", "vermillion", 1e-3
    )


def mach(reader: ResultReader) -> Panel:
    """Mach number with the preflight atmosphere."""
    return _panel(reader, "mach", Axis("Mach", "–"), "Mach", "blue", 1.0)


def dynamic_pressure(reader: ResultReader) -> Panel:
    """Dynamic pressure with the preflight density."""
    return _panel(reader, "dynamic_pressure", Axis("q", "kPa"), "q", "blue", 1e-3)


def _panel(reader: ResultReader, name: str, y: Axis, label: str, colour: str, scale: float) -> Panel:
    axis, time = time_axis(reader), reader.time
    inside = samples_within(time, axis)
    values = scale * reader.required("trajectory", name)[inside]
    return Panel(axis, y, (Curve(time[inside], values, label, colour, y.unit.strip("–")),), reader.events)


def uncertainty(reader: ResultReader, sigmas: int = 3) -> Panel:
    """Multiple of the standard deviations of altitude and air-relative speed on one logarithmic axis."""
    axis, time = time_axis(reader), reader.time
    inside = samples_within(time, axis)
    curves = []
    dash: Dash
    for name, label, unit, colour, dash in (
        ("altitude_sigma", "altitude (m)", "m", "blue", ""),
        ("speed_sigma", "velocity (m/s)", "m/s", "vermillion", "dash"),
    ):
        values = reader.trajectory(name)
        if values is not None and np.nanmax(values[inside]) > 0.0:
            curves.append(Curve(time[inside], sigmas * values[inside], label, colour, unit, dash=dash))
    limits = None
    if curves:
        positive = np.concatenate([c.y[c.y > 0.0] for c in curves])
        limits = (
            float(10.0 ** np.floor(np.log10(positive.min()))),
            float(10.0 ** (np.ceil(np.log10(positive.max())) + 0.7)),
        )
    y = Axis(f"{sigmas} sigma\n(m; m/s)", scale="log" if curves else "linear", range=limits)
    return Panel(axis, y, tuple(curves), reader.events, Legend("upper left", 2))


def altitude_velocity(reader: ResultReader) -> Figure:
    """Altitude, air-relative velocity and the uncertainty of both."""
    return Figure(
        f"{reader.title}: altitude and velocity", tuple((p(reader),) for p in (altitude, speed, uncertainty)),
        (2.3, 2.3, 1.55), margins=(1.25, 1.0, 0.65), shared_x=True, event_labels=True,
    )  # fmt: skip


def flight_history(reader: ResultReader) -> Figure:
    """Altitude, speed, flight-path angle, Mach number, dynamic pressure where available, and one sigma."""
    panels = {
        "altitude": altitude, "speed": speed, "flight_path_angle": flight_path_angle, "mach": mach,
        "dynamic_pressure": dynamic_pressure,
    }  # fmt: skip
    available = [panel(reader) for name, panel in panels.items() if reader.trajectory(name) is not None]
    available.append(uncertainty(reader, 1))
    rows = tuple((replace(panel, shifted_axis=None),) for panel in available if panel.elements)
    return Figure(f"{reader.title}: trajectory", rows, (1.6,) * len(rows), shared_x=True, event_labels=True)


def flight_path_angle(reader: ResultReader) -> Panel:
    """Air-relative flight-path angle, positive up, until the landing: a vehicle at rest has none."""
    panel = _panel(
        reader, "flight_path_angle", Axis("flight-path\nangle", "°"), "flight-path angle", "green",
        float(np.degrees(1.0)),
    )  # fmt: skip
    curve = panel.elements[0]
    assert isinstance(curve, Curve)
    flying = curve.x < reader.events.get("landing", np.inf)
    return replace(panel, elements=(replace(curve, x=curve.x[flying], y=curve.y[flying]),))


def altitude_over_speed(reader: ResultReader) -> Figure:
    """Altitude against speed, with the events."""
    inside = samples_within(reader.time, time_axis(reader))
    time, x, y = (
        v[inside]
        for v in (
            reader.time, 1e-3 * reader.required("trajectory", "speed"),
            1e-3 * reader.required("trajectory", "altitude"),
        )
    )  # fmt: skip
    events = {name: t for name, t in reader.events.items() if time[0] <= t <= time[-1]}
    elements: list[Element] = [Curve(x, y, "path", "blue", "km", independent="none")]
    if events:
        px, py = (np.interp(list(events.values()), time, values) for values in (x, y))
        names = tuple(map(words, events))
        elements.append(Curve(px, py, "events", "vermillion", "km", 0.0, symbol="diamond", size=6.0, names=names))
        for name, speed_at, altitude_at in zip(events, px, py, strict=True):
            below = name == "landing"  # above it is the path
            if name in _NAMED:
                offset = (6.0, -6.0 if below else 6.0)
                label = Text(event_label(name), speed_at, altitude_at, offset=offset, horizontal="left")
                elements.append(replace(label, vertical="top" if below else "bottom"))
    axes = Axis("velocity", "km/s", range=bounds([x], 0.0)), Axis("altitude", "km", range=bounds([y], 0.0))
    panel = Panel(*axes, tuple(elements), legend=Legend("best") if events else None)
    return Figure(f"{reader.title}: altitude against velocity", ((panel,),), (4.0,))
