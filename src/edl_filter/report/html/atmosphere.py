"""The atmosphere that the flight met: density, pressure, temperature against altitude, beside the preflight one."""

from __future__ import annotations

import json
from typing import Any

import numpy as np

from edl_filter.report.html.blocks import Grid, Note, Plot, Section
from edl_filter.report.html.plotting import Trace, axis, band, curve, envelope, extent, layout, logarithmic
from edl_filter.report.html.source import Source
from edl_filter.report.profile import EDGE, KNOWN, known
from edl_filter.types import Array, BoolArray

_KEY, _TITLE = "atmosphere", "Atmosphere"
_FLIGHT, _PREFLIGHT = "postflight/atmosphere/flight", "postflight/atmosphere/preflight"
_HEIGHT, _BINS = 400, 250
_UNITS = {"density": "kg/m³", "pressure": "Pa", "temperature": "K"}


def atmosphere(source: Source) -> Section:
    """Profiles with one-sigma bands, and the ratio of the densities."""
    height, time = source.get(_FLIGHT, "altitude"), source.get(_FLIGHT, "time")
    if height is None or time is None or source.get(_FLIGHT, "density") is None:
        return Section(
            _KEY,
            _TITLE,
            [Note("The run derived no atmosphere; that needs an aerodynamic database in the mission.", "muted")],
        )
    start = _limit(source, "domain_start", float(time[0]))
    end = _limit(source, "domain_end", float(time[-1])) - EDGE
    useful = _limit(source, "domain_useful", start)
    inside = (time >= start) & (time <= end)
    if not inside.any():
        return Section(_KEY, _TITLE, [Note("No air was felt long enough for a profile.", "muted")])
    counts = time[inside] >= useful
    km = 1e-3 * height[inside]
    plots = [p for name in _UNITS if (p := _profile(source, name, km, inside, counts)) is not None]
    plots += [p for p in (_ratio(source, km, inside, counts),) if p is not None]
    for plot in plots:
        plot.figure["layout"] |= _mach_marks(source, time, height)
    note = (
        "From the drag: density from the axial force and the database, pressure by the hydrostatic integral, "
        "temperature by the gas law. Bands are one sigma. Temperature and ratios are left out where a sigma exceeds "
        f"{KNOWN:.0%}."
    )
    return Section(_KEY, _TITLE, [Note(note, "muted"), Grid(plots)])


def _mach_marks(source: Source, time: Array, height: Array) -> dict[str, Any]:
    """Lines at the altitudes at which Mach numbers were passed."""
    times = json.loads(source.attribute("postflight", "mach_times") or "{}")
    at = {mach: 1e-3 * float(np.interp(t, time, height)) for mach, t in times.items() if t}
    return {
        "shapes": [
            {"type": "line", "xref": "paper", "x0": 0, "x1": 1, "yref": "y", "y0": km, "y1": km, "layer": "below",
             "line": {"color": "@muted", "width": 1, "dash": "dot"}}
            for km in at.values()
        ],
        "annotations": [
            {"xref": "paper", "x": 1, "xanchor": "right", "yref": "y", "y": km, "yanchor": "bottom",
             "text": f"Mach {mach}", "showarrow": False, "font": {"size": 11, "color": "@muted"}}
            for mach, km in at.items()
        ],
    }  # fmt: skip


def _limit(source: Source, name: str, otherwise: float) -> float:
    found = source.attribute("postflight", name)
    return otherwise if found is None or not np.isfinite(found) else float(found)


def _profile(source: Source, name: str, km: Array, inside: BoolArray, counts: BoolArray) -> Plot | None:
    flown, sigma, expected = (
        source.get(_FLIGHT, name), source.get(_FLIGHT, f"{name}_sigma"), source.get(_PREFLIGHT, name)
    )  # fmt: skip
    if flown is None:
        return None
    unit, linear = _UNITS[name], name == "temperature"
    flown = (known(flown, sigma) if linear else flown)[inside]
    before = None if expected is None else expected[inside]
    least = 0.0 if linear else 1e-3 * float(np.nanmin(np.abs(flown if before is None else before)))
    traces: list[Trace] = []
    if sigma is not None:
        low, high = np.maximum(flown - sigma[inside], least), flown + sigma[inside]
        traces.append(band(km, low, high, "±1 sigma", "@blue-band", bins=_BINS, turned=True))
    traces.append(_up(km, flown if linear else np.where(flown > 0.0, flown, np.nan), "flight", "@blue", unit))
    if before is not None:
        traces.append(_up(km, before, "preflight", "@vermillion", unit, line={"dash": "dash"}))
    if linear:
        x = axis(f"{name} ({unit})", range=extent(*(v for v in (flown[counts], before) if v is not None), outside=0.01))
    else:
        both = np.concatenate([v for v in (flown, before) if v is not None])
        both = both[np.isfinite(both) & (both > 0.0)]
        reference = flown if before is None else before
        low_end = max(float(both.min()), 0.02 * float(np.nanmin(np.abs(reference))))
        ends = np.log10([0.5 * low_end, 2.0 * float(both.max())])
        x = logarithmic(f"{name} ({unit})", range=ends.tolist())
    made = layout(_HEIGHT) | {"xaxis": x, "yaxis": axis("altitude (km)")}
    return Plot(f"profile_{name}", f"{name.capitalize()} along the flight.", {"data": traces, "layout": made}, _HEIGHT)


def _ratio(source: Source, km: Array, inside: BoolArray, counts: BoolArray) -> Plot | None:
    traces: list[Trace] = []
    shown = [np.array([0.9, 1.1])]
    for name, colour in (("density", "@blue"), ("pressure", "@green"), ("temperature", "@orange")):
        flown, sigma, expected = (
            source.get(_FLIGHT, name), source.get(_FLIGHT, f"{name}_sigma"), source.get(_PREFLIGHT, name)
        )  # fmt: skip
        if flown is None or expected is None:
            continue
        ratio = known(flown, sigma)[inside] / expected[inside]
        if sigma is not None:
            apart = sigma[inside] / expected[inside]
            area = band(km, ratio - apart, ratio + apart, name, f"{colour}-band", bins=_BINS, turned=True)
            traces.append(area | {"legendgroup": name, "showlegend": False})
        traces.append(_up(km, ratio, name, colour, "") | {"legendgroup": name})
        shown.append(ratio if name == "density" else ratio[counts])
    if not traces:
        return None
    made = layout(_HEIGHT)
    made |= {"xaxis": axis("flight over preflight (–)", range=extent(*shown, outside=0.01))}
    made |= {"yaxis": axis("altitude (km)")}
    caption = "Flight over preflight: 1 where the atmosphere is the expected one."
    return Plot("profile_ratio", caption, {"data": traces, "layout": made}, _HEIGHT)


def _up(km: Array, values: Array, name: str, colour: str, unit: str, **more: Any) -> Trace:
    """A curve of `values` over altitude, drawn upwards."""
    height, thin = envelope(km, values, _BINS)
    ends = f" {unit}" if unit else ""
    hover = f"%{{y:.4~g}} km: %{{x:.4~g}}{ends}<extra>%{{fullData.name}}</extra>"
    return curve(thin, height, name, colour, unit, hovertemplate=hover, **more)
