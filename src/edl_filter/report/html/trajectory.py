"""The trajectory: altitude, speed, Mach number and dynamic pressure, and how well they are known."""

from __future__ import annotations

from typing import Any

import numpy as np

from edl_filter.report.html.blocks import Block, Note, Plot, Section
from edl_filter.report.html.plotting import (
    LABELS,
    Array,
    Trace,
    axis,
    curve,
    extent,
    layout,
    line,
    logarithmic,
    stacked,
)
from edl_filter.report.html.source import Source

_KEY, _TITLE = "trajectory", "Trajectory"
_GROUP = "trajectory"
#: Variable → scale, axis label, unit.
_PANELS = {
    "altitude": (1e-3, "altitude (km)", "km"),
    "speed": (1.0, "speed (m/s)", "m/s"),
    "mach": (1.0, "Mach (–)", ""),
    "dynamic_pressure": (1e-3, "q (kPa)", "kPa"),
}
#: Events that are named on the path; the others are too near to them.
_NAMED = ("entry_interface", "peak_deceleration", "parachute_deploy", "landing")
_SIGMAS = {
    "altitude_sigma": ("altitude", "@blue", "m"),
    "speed_sigma": ("speed", "@vermillion", "m/s"),
}


def trajectory(source: Source) -> Section:
    """Four variables and their sigmas over time, and altitude over speed."""
    time = source.get(_GROUP, "time")
    if time is None or source.get(_GROUP, "altitude") is None:
        return Section(
            _KEY, _TITLE, [Note("The folder has no trajectory (result.nc is missing or not whole).", "muted")]
        )
    inside = time <= source.end(float(time[-1]))
    panels: list[tuple[list[Trace], dict[str, Any]]] = []
    shown = time[inside]
    for name, (scale, label, unit) in _PANELS.items():
        values = source.get(_GROUP, name)
        if values is None:
            continue
        which = "" if not panels else str(len(panels) + 1)
        trace = line(shown, scale * values[inside], label.split(" (")[0], "@blue", unit, axis=which)
        panels.append(([trace], axis(label)))
    sigmas, which = [], str(len(panels) + 1)
    for name, (label, colour, unit) in _SIGMAS.items():
        values = source.get(_GROUP, name)
        if values is not None and np.nanmax(values[inside]) > 0.0:
            sigmas.append(line(shown, values[inside], f"{label} ({unit})", colour, unit, axis=which))
    if sigmas:
        panels.append((sigmas, logarithmic("1 sigma")))
    span = [float(shown[0]), float(shown[-1])]
    figure = stacked(panels, axis(source.time_label, range=span), 900, source.events)
    if sigmas:
        figure["layout"] |= {"showlegend": True}
        figure["layout"]["margin"]["b"] += 30
        figure["layout"]["legend"] |= {"y": -0.07}
        for trace in figure["data"][: len(panels) - 1]:
            trace["showlegend"] = False
    caption = (
        "Altitude over the ellipsoid, speed relative to the air, Mach number, dynamic pressure; at the foot one sigma "
        "of altitude and speed."
    )
    blocks: list[Block] = [Plot("flight", caption, figure, 900)]
    speed = source.get(_GROUP, "speed")
    if speed is not None:
        altitude = source.get(_GROUP, "altitude")
        assert altitude is not None
        blocks.append(_against(source, shown, 1e-3 * speed[inside], 1e-3 * altitude[inside]))
    return Section(_KEY, _TITLE, blocks)


def _against(source: Source, time: Array, speed: Array, altitude: Array) -> Plot:
    """Altitude over speed; the bins are of time, so that both keep their turns."""
    kept = np.unique(np.linspace(0, len(time) - 1, min(len(time), 1200)).astype(int))
    path = curve(speed[kept], altitude[kept], "path", "@blue", "km")
    at = {n: t for n, t in source.events.items() if time[0] <= t <= time[-1]}
    names = [n.replace("_", " ") for n in at]
    events = {
        "type": "scatter", "mode": "markers+text", "name": "events", "hovertext": names,
        "text": [LABELS[n] if n in _NAMED else "" for n in at], "cliponaxis": False,
        "textposition": ["bottom right" if n == "landing" else "top right" for n in at],
        "textfont": {"size": 11, "color": "@ink"},
        "x": [float(np.interp(t, time, speed)) for t in at.values()],
        "y": [float(np.interp(t, time, altitude)) for t in at.values()],
        "marker": {"color": "@vermillion", "size": 9, "symbol": "diamond"},
        "hovertemplate": "%{hovertext}<br>%{x:.4~g} km/s, %{y:.4~g} km<extra></extra>",
    }  # fmt: skip
    made = layout(420, legend=bool(at))
    made |= {
        "xaxis": axis("speed (km/s)", range=extent(speed, outside=0.0)),
        "yaxis": axis("altitude (km)", range=extent(altitude, outside=0.0)),
    }
    return Plot(
        "altitude_speed", "Altitude against speed.", {"data": [path, *([events] if at else [])], "layout": made}, 420
    )
