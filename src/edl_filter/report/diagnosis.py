"""Figures of a diagnosis: where the model fails, which hypothesis explains it, how the error fell."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from edl_filter.io.atomic import replace_with
from edl_filter.report import style
from edl_filter.report.html.colours import ink_on
from edl_filter.report.terminal.diagnosis import chance

DPI = 120
#: Gain from which an effect counts as found, nats (design section 6).
CLEAR = 6.0
#: Linear part of the axis of gains, nats.
_LINEAR = 10.0
_MAP = "cividis"  # even in lightness for all common kinds of colour vision
_FAILS = style.VERMILLION
#: Colour and marker of each channel of the ledger.
_COLOURS = (style.BLUE, style.VERMILLION, style.GREEN, style.ORANGE, style.PURPLE, style.SKY, style.BLACK, style.GREY)
_MARKS = tuple(zip(_COLOURS, "osD^vP*X", strict=True))


def draw_diagnosis(told: Mapping[str, Any], title: str, folder: Path) -> list[Path]:
    """Write ``diagnosis_heatmap.png``, ``diagnosis_ranking.png`` and, maybe, ``diagnosis_missing.png``.

    Parameters
    ----------
    told : dict
        The content of ``diagnosis.json``.
    title : str
        Name of the flight.
    folder : Path
    """
    made = {"diagnosis_heatmap": heatmap(told, title), "diagnosis_ranking": ranking(told, title)}
    if told["latent"] is not None:
        made["diagnosis_missing"] = missing(told, title)
    return [write_figure(made_one, folder / f"{name}.png") for name, made_one in made.items()]


def write_figure(made: Figure, path: Path) -> Path:
    """Write a figure whole or not at all."""
    return replace_with(path, lambda temporary: made.savefig(temporary, dpi=DPI, pil_kwargs={"compress_level": 1}))


@style.styled
def heatmap(told: Mapping[str, Any], title: str) -> Figure:
    """Normalised RMS of every channel in every regime, and of every constraint; failing ones outlined."""
    flight = [c for c in told["map"] if c["regime"] != "constraints"]
    fixed = [c for c in told["map"] if c["regime"] == "constraints"]
    channels = list(dict.fromkeys(c["channel"] for c in flight))
    regimes = list(dict.fromkeys(c["regime"] for c in sorted(flight, key=lambda c: c["t0_s"])))
    rows = max(len(channels), len(fixed))
    made = style.figure(1.9 + 0.42 * rows, width=12.5)
    grid = made.add_gridspec(1, 3, width_ratios=(max(len(regimes), 1), 1.1, 0.25), wspace=0.75)
    left, right, bar = (made.add_subplot(grid[0, k]) for k in range(3))
    worst = max((c["normalised_rms"] for c in told["map"]), default=1.0)
    norm = LogNorm(0.5, max(10.0, worst))
    _cells(left, {(c["channel"], c["regime"]): c for c in flight}, channels, regimes, norm)
    names = [c["channel"] for c in fixed]
    _cells(right, {(c["channel"], "constraints"): c for c in fixed}, names, ["constraints"], norm)
    right.set_ylim(rows - 0.5, -0.5)
    left.set_title(f"{title}: where the model fails", loc="left", fontweight="bold")
    mappable = made.colorbar(left.images[0], cax=bar)
    mappable.set_label("normalised RMS (1: the model holds); outlined: it fails")
    bar.grid(False)
    bar.yaxis.set_major_formatter(style.plain_powers)
    made.subplots_adjust(left=0.14, right=0.93, bottom=0.19 if rows > 8 else 0.3, top=0.92)
    return made


def _cells(
    ax: Axes,
    cells: Mapping[tuple[str, str], Mapping[str, Any]],
    rows: Sequence[str],
    columns: Sequence[str],
    norm: LogNorm,
) -> None:
    values = np.full((max(len(rows), 1), max(len(columns), 1)), np.nan)
    for (row, column), cell in cells.items():
        values[rows.index(row), columns.index(column)] = cell["normalised_rms"]
    ax.imshow(np.clip(values, norm.vmin, None), cmap=_MAP, norm=norm, aspect="auto", interpolation="none")
    for (row, column), cell in cells.items():
        r, c, rms = rows.index(row), columns.index(column), cell["normalised_rms"]
        ground = [round(255 * part) for part in colormaps[_MAP](norm(max(rms, norm.vmin)))[:3]]
        text = f"{rms:.2g}" if rms < 100.0 else f"{rms:.0f}"
        ax.text(c, r, text, ha="center", va="center", fontsize=9.5, color=ink_on(ground))
        if cell["fails"]:
            ax.add_patch(Rectangle((c - 0.47, r - 0.45), 0.94, 0.9, fill=False, edgecolor=_FAILS, linewidth=2.5))
    ax.set_yticks(range(len(rows)), [name.replace("_", " ") for name in rows])
    ax.set_xticks(range(len(columns)), [name.replace(" flow", "") for name in columns], rotation=25, ha="right")
    ax.grid(False)
    ax.tick_params(length=0)
    for side in ax.spines.values():
        side.set_visible(False)


@style.styled
def ranking(told: Mapping[str, Any], title: str) -> Figure:
    """Gain of every hypothesis that was refitted, in sample and held out, and of something else."""
    rows = [
        (" or ".join((e["effect"], *e["same_as"])), e["gain"], e["score_gain"], e["probability"])
        for e in told["ranking"]
    ]
    other = told["something_else"]
    rows.append(("something else", other["score_gain"], None, other["probability"]))
    made = style.figure(1.9 + 0.6 * len(rows))
    ax = made.add_subplot()
    for k, (_, gain, score, probability) in enumerate(rows):
        ax.barh(k - 0.18, gain, 0.34, color=style.BLUE, label="gain" if k == 0 else None)
        if score is not None:
            ax.barh(k + 0.18, score, 0.34, color=style.ORANGE, label="held-out gain" if k == 0 else None)
        ax.annotate(
            f"p {chance(probability)}", (1.0, k), xycoords=("axes fraction", "data"), xytext=(4, 0),
            textcoords="offset points", ha="left", va="center", fontsize=10.5,
        )  # fmt: skip
    ax.axvline(CLEAR, color=style.GREY, linestyle=(0, (4, 3)), linewidth=1.0, label="6 nats: found")
    ax.axvline(0.0, color=style.BLACK, linewidth=0.8)
    ax.set_xscale("symlog", linthresh=_LINEAR)
    low, high = ax.get_xlim()
    ax.set_xlim(min(low, -1.0), max(high, 30.0))
    ax.tick_params(axis="x", labelsize=9.5)
    ax.set_yticks(range(len(rows)), [name.replace(" or ", "\nor ") for name, *_ in rows])
    ax.invert_yaxis()
    ax.set_xlabel("log-likelihood gained over the model as it is, prior included (nats)")
    ax.legend(loc="upper center", bbox_to_anchor=(0.4, -0.75 / (0.6 * len(rows) + 0.01)), ncols=3)
    ax.set_title(f"{title}: which effect is missing", loc="left", fontweight="bold")
    height = made.get_size_inches()[1]
    made.subplots_adjust(left=0.27, right=0.89, bottom=1.15 / height, top=1.0 - 0.5 / height)
    return made


@style.styled
def missing(told: Mapping[str, Any], title: str) -> Figure:
    """Missing force and moment against time, with bands of two sigmas; onsets marked."""
    latent = told["latent"]
    time = np.array(latent["time_s"], float)
    made = style.figure(7.5)
    axes = made.subplots(2, 1, sharex=True)
    for ax, key, sigma, unit in zip(
        axes,
        ("force_N", "moment_N_m"),
        ("force_sigma_N", "moment_sigma_N_m"),
        ("force (N)", "moment (N m)"),
        strict=True,
    ):
        values, spread = np.array(latent[key], float), np.array(latent[sigma], float)
        for c, (name, colour) in enumerate(zip("xyz", (style.BLUE, style.ORANGE, style.GREEN), strict=True)):
            ax.plot(time, values[:, c], color=colour, label=name, linewidth=1.0)
            ax.fill_between(
                time, values[:, c] - 2.0 * spread[:, c], values[:, c] + 2.0 * spread[:, c], color=colour, alpha=0.2,
                linewidth=0.0,
            )  # fmt: skip
        ax.set_ylabel(f"missing {unit}")
        prefix = unit.split()[0]
        for onset in told["onsets"]:
            if onset["channel"].startswith(prefix):
                ax.axvline(onset["time_s"], color=style.GREY, linestyle=(0, (4, 3)), linewidth=1.0)
                break
    axes[0].legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), title="body axis")
    axes[1].set_xlabel("time (s); bands: 2 sigma; dashed: the clearest onset")
    axes[0].set_title(f"{title}: what is missing", loc="left", fontweight="bold")
    made.subplots_adjust(left=0.11, right=0.87, bottom=0.09, top=0.93, hspace=0.12)
    return made


@style.styled
def ledger_figure(lines: Sequence[Mapping[str, Any]], noise_floor: float, title: str) -> Figure:
    """How the error of the channels that fail falls from step to step.

    Parameters
    ----------
    lines : sequence of dict
        Of the ledger, the last with nothing added.
    noise_floor : float
        Normalised RMS that chance allows.
    title : str
    """
    errors = {name: [line["errors"].get(name, {}).get("before") for line in lines] for name in lines[0]["errors"]}
    worst = {name: max((v for v in values if v is not None), default=0.0) for name, values in errors.items()}
    shown = sorted((n for n in worst if worst[n] > 1.1 * noise_floor), key=lambda n: -worst[n])[: len(_MARKS)]
    made = style.figure(5.6)
    ax = made.add_subplot()
    for name, (colour, marker) in zip(shown, _MARKS, strict=False):
        steps = [(k, v) for k, v in enumerate(errors[name]) if v is not None]
        ax.plot(*zip(*steps, strict=True), color=colour, marker=marker, label=name.replace("_", " "))
    ax.axhline(noise_floor, color=style.GREY, linestyle=(0, (4, 3)), label="noise")
    ax.set_yscale("log")
    ax.yaxis.set_major_formatter(style.plain_powers)
    added = ["as stated", *(f"+ {line['added']}" for line in lines[:-1])]
    # the more labels, the steeper
    turn, room = (
        (0, 0.1) if len(lines) <= 2 else (20, 0.2) if len(lines) <= 5 else (55, 0.06 + 0.013 * max(map(len, added)))
    )
    ax.set_xticks(range(len(lines)), added, rotation=turn, ha="right" if turn else "center", rotation_mode="anchor")
    ax.set_xlim(-0.3, len(lines) - 0.7)
    ax.set_ylabel("normalised RMS (1: the model holds)")
    ax.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    ax.set_title(f"{title}: how the error fell", loc="left", fontweight="bold")
    made.subplots_adjust(left=0.11, right=0.74, bottom=room, top=0.9)
    return made
