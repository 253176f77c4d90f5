"""What is left: the force and moment that no effect explains, against time."""

from __future__ import annotations

from typing import Any

import numpy as np

from edl_filter.report.html.blocks import Block, Note, Plot, Section
from edl_filter.report.html.colours import AXES
from edl_filter.report.html.plotting import axis, band, line, stacked
from edl_filter.report.html.source import Source
from edl_filter.report.html.words import readable

_KEY, _TITLE = "left", "What is left"
_BINS = 200


def missing(source: Source) -> Section:
    """The missing force and moment with bands of two sigmas, where the diagnosis estimated them."""
    told = source.diagnosis
    if not told:
        return Section(_KEY, _TITLE, [Note("Unknown without a diagnosis.", "muted")])
    blocks: list[Block] = []
    if told.get("remainder"):
        blocks.append(Note(readable(str(told["remainder"]["description"]))))
        blocks.append(
            Note("Write it as an effect of your own (docs/effects.md), then diagnose with --file my_effect.py.")
        )
    if told.get("latent"):
        caption = "Missing force and moment, body axes, with bands of two sigmas."
        blocks.append(Plot("missing", caption, _figure(source, told["latent"]), 560))
    elif told["verdict"] == "unknown":
        blocks.append(Note("The missing force and moment were not estimated.", "muted"))
    else:
        why = "the model holds" if told["verdict"] == "clean" else "the first hypothesis explains it"
        blocks.append(Note(f"No missing force or moment was estimated, because {why}.", "muted"))
    return Section(_KEY, _TITLE, blocks)


def _figure(source: Source, latent: dict[str, Any]) -> dict[str, Any]:
    time = np.array(latent["time_s"], float)
    panels = []
    for which, key, unit in (("", "force", "N"), ("2", "moment", "N_m")):
        values = np.array(latent[f"{key}_{unit}"], float)
        sigma = np.array(latent[f"{key}_sigma_{unit}"], float)
        shown = unit.replace("_", " ")
        traces = []
        for c, (name, colour) in enumerate(zip("xyz", AXES, strict=True)):
            low, high = values[:, c] - 2.0 * sigma[:, c], values[:, c] + 2.0 * sigma[:, c]
            same = {"legendgroup": name}
            traces.append(
                band(time, low, high, name, f"{colour}-band", axis=which, bins=_BINS) | same | {"showlegend": False}
            )
            curve = line(time, values[:, c], f"along {name}", colour, shown, axis=which, bins=_BINS)
            traces.append(curve | same | {"showlegend": not which})
        panels.append((traces, axis(f"missing {key} ({shown})")))
    span = [float(time[0]), float(time[-1])]
    onsets = {f"onset {o['channel'].replace('_', ' ')}": o["time_s"] for o in source.diagnosis.get("onsets", [])[:3]}
    return stacked(panels, axis(source.time_label, range=span), 560, onsets, legend=True)
