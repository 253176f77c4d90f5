"""Figures of a diagnosis: hypotheses, missing force and moment, fall of the error, residuals."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from edl_filter.aero.increments import DatabaseUpdate
from edl_filter.report.colours import AXES
from edl_filter.report.database_update import database_figure
from edl_filter.report.description import (
    Axis,
    Band,
    Bars,
    Curve,
    Dash,
    Element,
    Figure,
    Legend,
    Line,
    Panel,
    Span,
    Symbol,
    Text,
)  # fmt: skip
from edl_filter.report.residual_map import CONSTRAINTS, residual_map
from edl_filter.report.text import (
    chance,
    hypothesis_label,
    number,
    readable,
    time_label,
    words,
)
from edl_filter.results.files import DIAGNOSIS_FIGURES
from edl_filter.results.residual_series import ResidualSeries
from edl_filter.results.schema import DiagnosisContent, LedgerLine, LedgerStep
from edl_filter.results.schema.diagnosis import LatentContent, MapCell, OnsetContent
from edl_filter.results.schema.ledger import ErrorChange
from edl_filter.types import Array

if TYPE_CHECKING:
    from xarray import DataArray

#: Linear part of the axis of gains, nats.
_LINEAR_NATS = 10.0
#: Onsets that are marked over the missing force and moment.
_ONSETS = 3
#: Colour and symbol of each channel of the ledger.
_CHANNEL_STYLES: tuple[tuple[str, Symbol], ...] = (
    ("blue", "circle"), ("vermillion", "square"), ("green", "diamond"), ("orange", "triangle"), ("purple", "down"),
    ("sky", "plus"), ("ink", "star"), ("muted", "cross"),
)  # fmt: skip
_DASH: Dash = "dash"


def draw_diagnosis(
    content: DiagnosisContent | Mapping[str, Any],
    title: str,
    folder: Path,
    update: DatabaseUpdate | None = None,
    formats: Sequence[str] = ("png",),
) -> list[Path]:
    """Write the figures of a diagnosis: `results.files.DIAGNOSIS_FIGURES`, the last two only if there are estimates.

    Parameters
    ----------
    content : DiagnosisContent or mapping
        Content of ``diagnosis.json``.
    title : str
        Title of the flight.
    folder : Path
        Existing or new folder.
    update : DatabaseUpdate, optional
        Increments of the database.
    formats : sequence of str
        Of `results.files.FIGURE_FORMATS`.
    """
    diagnosis = DiagnosisContent.of(content)
    figures = (
        residual_map(diagnosis, title),
        ranking(diagnosis, title),
        None if update is None else database_figure(update, title),
        None if diagnosis.latent is None else missing(diagnosis.latent, diagnosis.onsets, title),
    )
    named = zip(figures, DIAGNOSIS_FIGURES, strict=True)
    from edl_filter.report.matplotlib_renderer import write_figure  # imported on use: the page needs no matplotlib

    return [
        write_figure(figure, folder / f"{name}.{kind}") for figure, name in named if figure is not None
        for kind in formats
    ]  # fmt: skip


def ranking(content: DiagnosisContent | Mapping[str, Any], title: str) -> Figure:
    """Gain of every hypothesis that was refitted, in sample and held out, and of something outside the catalogue."""
    diagnosis = DiagnosisContent.of(content)
    something = diagnosis.something_else
    rows = [(hypothesis_label(h), h.gain, h.score_gain, h.probability) for h in diagnosis.ranking]
    rows.append(("something else", something.gain, None, something.probability))
    gains = [(float(k), gain) for k, (_, gain, _, _) in enumerate(rows) if gain is not None]
    scores = [(float(k), score) for k, (_, _, score, _) in enumerate(rows) if score is not None]
    elements: list[Element] = [_gain_bars(gains, -0.18, "blue", "gain")]
    if scores:
        elements.append(_gain_bars(scores, 0.18, "orange", "held-out gain"))
    for k, (_, _, _, probability) in enumerate(rows):
        text = f"p {chance(probability)}"
        elements.append(Text(text, 1.0, float(k), ("panel", "data"), (4.0, 0.0), "left", size=10.5))
    if diagnosis.required_gain is not None:
        required = f"{diagnosis.required_gain:.3g} nats: required"
        elements.append(Line(diagnosis.required_gain, "x", required, dash=_DASH, width=1.0))
    elements.append(Line(0.0, "x", colour="ink"))
    values = [value for _, value in (*gains, *scores)]
    limits = (min(1.3 * min(values, default=0.0), -1.0), max(1.6 * max(values, default=0.0), 30.0))
    label = "log-likelihood gained over the present model, prior included"
    ticks = tuple((float(k), name.replace(" or ", "\nor ")) for k, (name, *_) in enumerate(rows))
    panel = Panel(
        Axis(label, "nats", "symlog", limits, linear_limit=_LINEAR_NATS),
        Axis(range=(len(rows) - 0.5, -0.5), ticks=ticks), tuple(elements),
    )  # fmt: skip
    return Figure(
        f"{title}: hypotheses on missing effects", ((panel,),), (max(0.6 * len(rows), 0.8),), margins=(2.45, 1.0, 1.15),
        legend=True,
    )  # fmt: skip


def _gain_bars(values: Sequence[tuple[float, float]], shift: float, colour: str, label: str) -> Bars:
    positions, ends = tuple(p + shift for p, _ in values), tuple(v for _, v in values)
    return Bars(positions, (0.0,) * len(values), ends, (colour,) * len(values), label, 0.34, horizontal=True)


def missing(latent: LatentContent, onsets: Sequence[OnsetContent], title: str, epoch_utc: str = "") -> Figure:
    """Missing force and moment against time, with bands of two sigmas; the clearest onsets are marked."""
    time = np.array(latent.time_s)
    events = {f"onset {words(o.channel)}": o.time_s for o in onsets[:_ONSETS]}
    x = Axis(time_label(epoch_utc), "s", range=(float(time[0]), float(time[-1])))
    panels = []
    for quantity, unit, vectors, sigmas in (
        ("force", "N", latent.force_N, latent.force_sigma_N),
        ("moment", "N m", latent.moment_N_m, latent.moment_sigma_N_m),
    ):
        values, sigma = np.array(vectors, float), np.array(sigmas, float)
        elements: list[Element] = []
        for k, (name, colour) in enumerate(zip("xyz", AXES, strict=True)):
            label = f"along {name}"
            low, high = values[:, k] - 2.0 * sigma[:, k], values[:, k] + 2.0 * sigma[:, k]
            elements.append(Band(time, low, high, "", f"{colour}-band", curve=label))
            elements.append(Curve(time, values[:, k], label, colour, unit, 1.0))
        legend = Legend("outside", 1, "bands: 2 sigma") if quantity == "force" else None
        panels.append(Panel(x, Axis(f"unexplained {quantity}", unit), tuple(elements), events, legend))
    return Figure(
        f"{title}: unexplained force and moment", tuple((panel,) for panel in panels), (2.9, 2.9),
        margins=(1.0, 1.5, 0.7), shared_x=True, event_labels=True,
    )  # fmt: skip


def ledger_figure(
    errors: Sequence[Mapping[str, float | None]],
    changes: Sequence[str],
    noise_floor: float,
    minimum_rms: float,
    title: str,
) -> Figure:
    """Normalised RMS of the channels that fail, from step to step.

    Parameters
    ----------
    errors : sequence of mapping
        Channel → normalised RMS of the model of each step; None where a channel is not compared.
    changes : sequence of str
        What changes the model from each step to the next: one fewer (`model_change`).
    noise_floor : float
        Normalised RMS that noise does not exceed.
    minimum_rms : float
        Factor over `noise_floor` from which a channel is drawn (`DecisionSettings.cell_minimum_rms`).
    title : str
        Title of the flight.
    """
    largest = {name: max((e.get(name) or 0.0 for e in errors), default=0.0) for name in errors[0]}
    failing = sorted((n for n in largest if largest[n] > minimum_rms * noise_floor), key=lambda n: -largest[n])
    elements: list[Element] = []
    for name, (colour, symbol) in zip(failing, _CHANNEL_STYLES, strict=False):
        steps = [(float(k), rms) for k, e in enumerate(errors) if (rms := e.get(name)) is not None]
        positions, values = np.array(steps).T
        elements.append(Curve(positions, values, words(name), colour, symbol=symbol, size=6.0))
    elements.append(Line(noise_floor, label="noise", dash=_DASH, width=1.3))
    labels = ["as stated", *changes]
    angle = 0.0 if len(errors) <= 2 else 20.0 if len(errors) <= 5 else 55.0
    bottom = 0.6 if len(errors) <= 2 else 1.1 if len(errors) <= 5 else 0.4 + 0.075 * max(map(len, labels))
    sizes = [rms for e in errors for n in failing[: len(_CHANNEL_STYLES)] if (rms := e.get(n))]
    limits = (0.7 * min([noise_floor, *sizes]), 1.5 * max([noise_floor, *sizes]))
    x = Axis(range=(-0.3, len(errors) - 0.7), ticks=tuple(enumerate(labels)), tick_angle=angle)
    y = Axis("normalised RMS (1: the model holds)", scale="log", range=limits)
    panel = Panel(x, y, tuple(elements), legend=Legend("outside", 1))
    return Figure(f"{title}: error by added effect", ((panel,),), (4.0,), margins=(1.0, 2.35, bottom))


def model_change(added: str, removed: Sequence[str] = ()) -> str:
    """Change of a model in words: ``+ effect``, and ``− effect`` for each that was removed."""
    return " ".join((f"+ {added}", *(f"− {label}" for label in removed)))


def overall_rms(errors: Mapping[str, ErrorChange], after: bool = False) -> float | None:
    """Root mean square of the normalised RMS of all channels, before or after an addition; None without any."""
    values = [v for e in errors.values() if (v := e.after if after else e.before) is not None]
    return math.sqrt(math.fsum(v * v for v in values) / len(values)) if values else None


def ledger_levels(lines: Sequence[LedgerLine]) -> list[float]:
    """Overall normalised RMS before each step, and at the end."""
    levels = [overall_rms(line.errors) for line in lines]
    if lines and isinstance(lines[-1], LedgerStep):  # the improvement was interrupted: prediction of the last effect
        levels.append(overall_rms(lines[-1].errors, after=True))
    return [level for level in levels if level is not None]


def waterfall(lines: Sequence[LedgerLine], diagnosis: DiagnosisContent | None, title: str) -> Figure:
    """Overall normalised RMS at the beginning, its change by each effect, and at the end."""
    levels = ledger_levels(lines)
    bottom, top = 0.5 * min([1.0, *levels]), 2.0 * max(levels)
    # a step that increases the error has a bar upwards
    pairs = [(bottom, levels[0]), *((b, a) for a, b in pairwise(levels)), (bottom, levels[-1])]
    clean = diagnosis is not None and diagnosis.verdict == "clean"
    colours = (
        "muted",
        *("blue" if b <= a else "vermillion" for a, b in pairwise(levels)),
        "green" if clean else "muted",
    )
    bars = Bars(
        tuple(float(k) for k in range(len(pairs))), tuple(min(p) for p in pairs), tuple(max(p) for p in pairs), colours,
        notes=(number(levels[0]), *(f"{number(a)} → {number(b)}" for a, b in pairwise(levels)), number(levels[-1])),
    )  # fmt: skip
    names = [
        "as stated",
        *(model_change(line.label, line.removed) for line in lines if isinstance(line, LedgerStep)),
        "what is left",
    ]
    values = [m * 10.0**p for p in range(-3, 7) for m in (1, 2, 5)]
    y = Axis("normalised RMS", "–", "log", (bottom, top), tuple((v, f"{v:g}") for v in values if bottom <= v <= top))
    x = Axis(ticks=tuple((float(k), name) for k, name in enumerate(names)), grid=False)
    noise = () if diagnosis is None else (Line(diagnosis.noise_floor, colour="ink", dash=_DASH, width=1.0),)
    return Figure(f"{title}: error by added effect", ((Panel(x, y, (bars, *noise)),),), (4.0,))


def residual_panel(series: ResidualSeries, channel: str, cells: Sequence[MapCell]) -> Panel:
    """Residual of a channel with the band of two stated sigmas; regimes in which it fails are shaded.

    Raises
    ------
    InputError
        There is no such channel.
    """
    name = channel.replace(" ", "_")
    k = series.index(name)
    valid = np.isfinite(series.residual[k])
    time, values, sigma = series.time[valid], series.residual[k, valid], series.sigma[k, valid]
    unit = readable(series.units[k])
    failing = [c for c in cells if c.channel == name and c.fails and c.regime != CONSTRAINTS]
    elements: list[Element] = [
        Span(c.t0_s, c.t1_s, label="" if i else "regime fails", colour="failure") for i, c in enumerate(failing)
    ]
    elements += [
        Band(time, -2.0 * sigma, 2.0 * sigma, "±2 sigma stated", "blue-band"),
        Curve(time, values, "measured minus predicted", "blue", unit, 0.9),
        Line(0.0),
    ]
    x_range, y_range = _residual_ranges(time, values, sigma)
    *instrument, quantity, axis = name.split("_")
    label = "\n".join((*instrument, f"{quantity} {axis}"))
    x = Axis(time_label(""), "s", range=x_range)
    return Panel(x, Axis(label, unit, range=y_range), tuple(elements), legend=Legend("upper left", 3))


def _residual_ranges(
    time: Array, values: Array, sigma: Array
) -> tuple[tuple[float, float] | None, tuple[float, float] | None]:
    if not len(values):
        return None, None
    low, high = np.quantile(values, (0.002, 0.998))
    band = 2.0 * float(np.median(sigma))
    low, high = min(float(low), -band), max(float(high), band)
    return (float(time[0]), float(time[-1])), (low - 0.1 * (high - low), high + 0.35 * (high - low))


def evidence_panel(gains: DataArray) -> Panel:
    """Evidence for an effect against one of its places, the best one marked."""
    name = str(gains.dims[0])
    places, values = np.asarray(gains[name].values, float), np.asarray(gains.values, float)
    attributes = gains[name].attrs
    unit = str(attributes.get("units", ""))
    best = float(places[int(np.argmax(values))])
    elements = (
        Curve(places, values, "", "blue", "nats", symbol="circle", size=3.5),
        Line(best, "x", f"most at {best:.4g} {unit}", "vermillion", _DASH, 1.3), Line(0.0),
    )  # fmt: skip
    x = Axis(f"{name}: {attributes.get('long_name', '')}", unit)
    return Panel(x, Axis("gain over the present model", "nats"), elements, legend=Legend("best", 1))


def single_figure(panel: Panel, title: str) -> Figure:
    """A panel as a figure of its own."""
    return Figure(title, ((panel,),), (3.2,), margins=(1.2, 0.3, 0.65))
