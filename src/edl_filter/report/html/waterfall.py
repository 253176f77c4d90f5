"""How the error fell: the ledger of `edl-filter improve` as a waterfall."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

from edl_filter.report.html.blocks import Command, Details, Note, Plot, Section, Table
from edl_filter.report.html.commands import mission_name
from edl_filter.report.html.plotting import axis, layout
from edl_filter.report.html.source import Source
from edl_filter.report.html.words import readable
from edl_filter.report.terminal.diagnosis import number, parameters_text

_KEY, _TITLE = "ledger", "How the error fell"
_HEIGHT = 380
#: Where the logarithmic axis may have its ticks.
_TICKS = [m * 10.0**p for p in range(-3, 7) for m in (1, 2, 5)]

Lines = Sequence[Mapping[str, Any]]


def waterfall(source: Source) -> Section:
    """Each effect that was added and the fall of the error that it brought."""
    lines = source.ledger
    if not lines or not levels(lines):
        return Section(
            _KEY,
            _TITLE,
            [
                Note("There is no ledger: nothing was added step by step. The loop that does it all and keeps one:"),
                Command(f"edl-filter improve {mission_name(source)} -o DIR"),
            ],
        )
    caption = "Normalised RMS over all channels and constraints; 1 where the model holds. Dashed: the noise floor."
    return Section(
        _KEY,
        _TITLE,
        [
            Plot("waterfall", caption, _figure(lines, source.diagnosis), _HEIGHT),
            _steps(lines),
            *([Note(str(lines[-1]["why"]))] if lines[-1].get("why") else []),
            Details("Normalised RMS of every channel, step by step", [_channels(lines)]),
        ],
    )


def overall(errors: Mapping[str, Mapping[str, float | None]], when: str = "before") -> float | None:
    """Root mean square of all channels' normalised RMS; None where nothing is known."""
    known = [e[when] for e in errors.values() if e.get(when) is not None]
    return math.sqrt(sum(v * v for v in known if v is not None) / len(known)) if known else None


def levels(lines: Lines) -> list[float]:
    """The error before each step, and at the end."""
    found = [overall(line["errors"]) for line in lines]
    if lines and lines[-1].get("added"):  # the loop was broken off: what the last effect promised
        found.append(overall(lines[-1]["errors"], "after"))
    return [level for level in found if level is not None]


def _figure(lines: Lines, diagnosis: Mapping[str, Any]) -> dict[str, Any]:
    level, noise = levels(lines), diagnosis.get("noise_floor")
    bottom = 0.5 * min([1.0, *level])
    added = [f"+ {line['added']}" for line in lines if line.get("added")]
    names = ["as stated", *added, "what is left"]
    # a step that makes things worse rises: its bar then goes upwards
    pairs = [(bottom, level[0]), *((b, a) for a, b in pairwise(level)), (bottom, level[-1])]
    low, high = [min(p) for p in pairs], [max(p) for p in pairs]
    told = [number(level[0]), *(f"{number(a)} → {number(b)}" for a, b in pairwise(level)),
            number(level[-1])]  # fmt: skip
    fell = [
        "@muted",
        *("@blue" if b <= a else "@vermillion" for a, b in pairwise(level)),
        "@green" if diagnosis.get("verdict") == "clean" else "@muted",
    ]
    bars = {
        "type": "bar", "x": list(range(len(pairs))), "y": [b - a for a, b in zip(low, high, strict=True)], "base": low,
        "text": told, "textposition": "outside", "cliponaxis": False, "marker": {"color": fell}, "width": 0.6,
        "hovertemplate": "%{text}<extra></extra>", "textfont": {"color": "@ink"}, "showlegend": False,
    }  # fmt: skip
    made = layout(_HEIGHT, top=24, legend=False)
    made["xaxis"] = axis("", tickvals=list(range(len(pairs))), ticktext=names, showgrid=False)
    ticks = [v for v in _TICKS if bottom <= v <= 2.0 * max(level)]
    made["yaxis"] = axis(
        "normalised RMS (–)",
        type="log",
        range=[math.log10(bottom), math.log10(2.0 * max(level))],
        tickvals=ticks,
        ticktext=[f"{v:g}" for v in ticks],
    )
    if noise:
        made["shapes"] = [
            {"type": "line", "xref": "paper", "x0": 0, "x1": 1, "yref": "y", "y0": noise, "y1": noise,
             "line": {"color": "@ink", "width": 1, "dash": "dash"}}
        ]  # fmt: skip
    return {"data": [bars], "layout": made}


def _steps(lines: Lines) -> Table:
    rows = []
    for line, (before, after) in zip((e for e in lines if e.get("added")), pairwise(levels(lines)), strict=False):
        names = " or ".join((line["added"], *line.get("same_as", ())))
        rows.append([f"{line['step']}", names, readable(parameters_text(line["parameters"])), number(line["gain"]),
                     number(line["held_out_score"]), f"{number(before)} → {number(after)}"])  # fmt: skip
    heads = ("step", "added", "size as it was added", "gain (nats)", "held-out gain", "normalised RMS")
    return Table("Steps", heads, rows or [["–", "nothing was added", "", "", "", ""]], texts=3)


def _channels(lines: Lines) -> Table:
    names = list(dict.fromkeys(name for line in lines for name in line["errors"]))
    heads = ("channel", *("as stated" if k == 0 else f"step {line['step']}" for k, line in enumerate(lines)))
    rows = [[n.replace("_", " "), *(number(line["errors"].get(n, {}).get("before")) for line in lines)] for n in names]
    return Table("", heads, rows)
