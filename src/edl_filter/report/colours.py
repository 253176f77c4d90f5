"""Colours by role: one for printed figures, one for each theme of the page."""

from __future__ import annotations

import math
from collections.abc import Sequence

#: Okabe and Ito's palette, distinct for all common kinds of colour vision.
BLACK, ORANGE, SKY, GREEN, BLUE, VERMILLION, PURPLE = (
    "#000000", "#E69F00", "#56B4E9", "#009E73", "#0072B2", "#D55E00", "#CC79A7",
)  # fmt: skip
GREY = "#666666"

#: Role → colour of a printed figure, colour on the light page, colour on the dark page.
ROLES = {
    "ink": (BLACK, "#1c1f23", "#e6e8ea"),
    "muted": (GREY, GREY, "#a3abb3"),
    "grid": ("#DDDDDD", "#dcdfe3", "#363c43"),
    "blue": (BLUE, BLUE, SKY),
    "vermillion": (VERMILLION, VERMILLION, "#F08A4B"),
    "green": (GREEN, GREEN, "#2DBE95"),
    "orange": (ORANGE, ORANGE, ORANGE),
    "purple": (PURPLE, "#A8588A", PURPLE),
    "sky": (SKY, SKY, SKY),
    "blue-band": (SKY + "80", "rgba(0,114,178,0.20)", "rgba(86,180,233,0.24)"),
    "blue-faint": ("#CFE6F5", "rgba(0,114,178,0.10)", "rgba(86,180,233,0.13)"),
    "blue-fainter": ("#EEF6FB", "rgba(0,114,178,0.06)", "rgba(86,180,233,0.08)"),
    "vermillion-band": (VERMILLION + "4D", "rgba(213,94,0,0.20)", "rgba(240,138,75,0.24)"),
    "green-band": (GREEN + "40", "rgba(0,158,115,0.20)", "rgba(45,190,149,0.24)"),
    "orange-band": (ORANGE + "40", "rgba(230,159,0,0.22)", "rgba(230,159,0,0.26)"),
    "muted-band": ("#D0D0D0", "rgba(102,102,102,0.25)", "rgba(163,171,179,0.28)"),
    "shade": ("#EEEEEE", "rgba(230,159,0,0.16)", "rgba(230,159,0,0.20)"),
    "failure": ("#F3E3DA", "rgba(230,159,0,0.16)", "rgba(230,159,0,0.20)"),
    "page": ("#ffffff", "#ffffff", "#15191d"),
}
#: Colours of the body axes x, y, z.
AXES = ("blue", "vermillion", "green")

#: Matplotlib's cividis at equal steps: even in lightness for all common kinds of colour vision.
_CIVIDIS = (
    "#00224e", "#083370", "#35456c", "#4f576c", "#666970", "#7d7c78", "#948e77", "#aea371", "#c8b866", "#e5cf52",
    "#fee838",
)  # fmt: skip
#: Ends of the scale of a residual map, normalised RMS; the upper one is larger if the map has a larger value.
LEAST, MOST = 0.5, 10.0


def page_roles() -> dict[str, tuple[str, str]]:
    """Colours of the page: ``"@role"`` → colour of the light theme, colour of the dark theme."""
    return {f"@{role}": (light, dark) for role, (_, light, dark) in ROLES.items()}


def cell_colours(rms: float, worst: float) -> tuple[str, str]:
    """Background and text colour of a cell of the residual map, on a logarithmic scale.

    Parameters
    ----------
    rms : float
        Normalised RMS of the cell.
    worst : float
        Largest normalised RMS of the map.
    """
    share = math.log(max(rms, LEAST) / LEAST) / math.log(max(MOST, worst) / LEAST)
    position = min(max(share, 0.0), 1.0) * (len(_CIVIDIS) - 1)
    k = min(int(position), len(_CIVIDIS) - 2)
    low, high = (_components(_CIVIDIS[i]) for i in (k, k + 1))
    background = [round(a + (position - k) * (b - a)) for a, b in zip(low, high, strict=True)]
    ink = "#000000" if _luminance(background) > 0.18 else "#ffffff"  # the better contrast (WCAG 2)
    return "#{:02x}{:02x}{:02x}".format(*background), ink


def gradient() -> str:
    """The colour scale as a CSS gradient."""
    return f"linear-gradient(to right, {', '.join(_CIVIDIS)})"


def scale_colours() -> tuple[str, ...]:
    """Colours of the scale at equal steps."""
    return _CIVIDIS


def _components(colour: str) -> tuple[int, int, int]:
    return int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16)


def _luminance(components: Sequence[int]) -> float:
    """Relative luminance of a colour (WCAG 2), 0 to 1."""
    linear = [(c / 255.0 + 0.055) ** 2.4 / 1.055**2.4 if c > 10 else c / 255.0 / 12.92 for c in components]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]
