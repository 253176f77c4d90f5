"""The residual map: order of its cells, their colour, text and sentence, and its printed figure.

Input: cells of a diagnosis. `html.residual_map` draws them as buttons of the page, this module as a printed heat map.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from edl_filter.report.colours import scale_colours
from edl_filter.report.description import Axis, ColourScale, Figure, HeatCell, HeatMap, Panel
from edl_filter.report.text import readable, words
from edl_filter.results.schema import DiagnosisContent
from edl_filter.results.schema.diagnosis import MapCell

#: Regime under which the residual map lists the constraints.
CONSTRAINTS = "constraints"
#: Ends of the scale of a residual map, normalised RMS; the upper one is larger if the map has a larger value.
LEAST, MOST = 0.5, 10.0


def map_cells(cells: Sequence[MapCell]) -> tuple[list[str], list[str], dict[tuple[str, str], int]]:
    """Channels and regimes of the flight's cells in the order of the map, and the index of each (channel, regime)."""
    flight = [(k, cell) for k, cell in enumerate(cells) if cell.regime != CONSTRAINTS]
    channels = list(dict.fromkeys(cell.channel for _, cell in flight))
    regimes = list(dict.fromkeys(cell.regime for _, cell in sorted(flight, key=lambda item: item[1].t0_s)))
    return channels, regimes, {(cell.channel, cell.regime): k for k, cell in flight}


def worst_rms(cells: Sequence[MapCell]) -> float:
    """Largest normalised RMS of a map."""
    return max((cell.normalised_rms for cell in cells if cell.normalised_rms is not None), default=1.0)


def rms_text(rms: float) -> str:
    """Normalised RMS with three digits."""
    return f"{rms:.2f}" if rms < 10.0 else f"{rms:.1f}" if rms < 100.0 else f"{rms:.0f}"


def cell_sentence(cell: MapCell) -> str:
    """The sentence of a cell of the residual map, with its channel as words."""
    return readable(cell.sentence.replace(cell.channel, words(cell.channel), 1))


def cell_colours(rms: float, worst: float) -> tuple[str, str]:
    """Background and text colour of a cell of the residual map, on a logarithmic scale.

    Parameters
    ----------
    rms : float
        Normalised RMS of the cell.
    worst : float
        Largest normalised RMS of the map.
    """
    colours = scale_colours()
    share = math.log(max(rms, LEAST) / LEAST) / math.log(max(MOST, worst) / LEAST)
    position = min(max(share, 0.0), 1.0) * (len(colours) - 1)
    k = min(int(position), len(colours) - 2)
    low, high = (_components(colours[i]) for i in (k, k + 1))
    background = [round(a + (position - k) * (b - a)) for a, b in zip(low, high, strict=True)]
    ink = "#000000" if _luminance(background) > 0.18 else "#ffffff"  # the better contrast (WCAG 2)
    return "#{:02x}{:02x}{:02x}".format(*background), ink


def gradient() -> str:
    """The colour scale as a CSS gradient."""
    return f"linear-gradient(to right, {', '.join(scale_colours())})"


def _components(colour: str) -> tuple[int, int, int]:
    return int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16)


def _luminance(components: Sequence[int]) -> float:
    """Relative luminance of a colour (WCAG 2), 0 to 1."""
    linear = [(c / 255.0 + 0.055) ** 2.4 / 1.055**2.4 if c > 10 else c / 255.0 / 12.92 for c in components]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def residual_map(content: DiagnosisContent | Mapping[str, Any], title: str) -> Figure:
    """Normalised RMS of every channel in every regime, and of every constraint; failing ones are outlined."""
    cells = DiagnosisContent.of(content).map
    channels, regimes, index = map_cells(cells)
    constraints = [cell for cell in cells if cell.regime == CONSTRAINTS]
    worst = worst_rms(cells)
    flight = _heat_cells(
        [(cells[k], channels.index(channel), regimes.index(regime)) for (channel, regime), k in index.items()], worst
    )
    fixed = _heat_cells([(cell, k, 0) for k, cell in enumerate(constraints)], worst)
    rows = max(len(channels), len(constraints), 1)
    panels = (
        _map_panel(flight, channels, [name.replace(" flow", "") for name in regimes], max(len(channels), 1)),
        _map_panel(fixed, [c.channel for c in constraints], [CONSTRAINTS], rows),
    )
    scale = ColourScale(LEAST, max(MOST, worst), "normalised RMS (1: the model holds); outlined: it fails")
    return Figure(
        f"{title}: residual map", (panels,), (0.42 * rows,), (max(len(regimes), 1), 1.1), 12.5,
        (1.75, 1.9, 1.05), (0.75, 0.1), scale=scale,
    )  # fmt: skip


def _heat_cells(places: Iterable[tuple[MapCell, int, int]], worst: float) -> tuple[HeatCell, ...]:
    """Cells that have a normalised RMS, from cell, row and column."""
    return tuple(
        HeatCell(row, column, rms, *cell_colours(rms, worst), rms_text(rms), cell.fails)
        for cell, row, column in places
        if (rms := cell.normalised_rms) is not None
    )


def _map_panel(cells: tuple[HeatCell, ...], rows: Sequence[str], columns: Sequence[str], height: int) -> Panel:
    x = Axis(
        range=(-0.5, max(len(columns), 1) - 0.5), ticks=tuple((float(k), name) for k, name in enumerate(columns)),
        tick_angle=25.0, grid=False,
    )  # fmt: skip
    ticks = tuple((float(k), words(name)) for k, name in enumerate(rows))
    return Panel(x, Axis(range=(height - 0.5, -0.5), ticks=ticks, grid=False), (HeatMap(cells),))
