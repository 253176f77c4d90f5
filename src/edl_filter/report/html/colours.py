"""Colours of the report: roles that the page's script turns into a colour of the light or the dark theme."""

from __future__ import annotations

import math
from collections.abc import Sequence

from edl_filter.report.palette import BLUE, GREEN, GREY, ORANGE, PURPLE, SKY, VERMILLION

#: Role → colour on white, colour on the dark page. Figures name roles, so that a theme changes them all.
ROLES = {
    "@ink": ("#1c1f23", "#e6e8ea"),
    "@muted": (GREY, "#a3abb3"),
    "@grid": ("#dcdfe3", "#363c43"),
    "@blue": (BLUE, SKY),
    "@vermillion": (VERMILLION, "#F08A4B"),
    "@green": (GREEN, "#2DBE95"),
    "@orange": (ORANGE, ORANGE),
    "@purple": ("#A8588A", PURPLE),
    "@blue-band": ("rgba(0,114,178,0.20)", "rgba(86,180,233,0.24)"),
    "@blue-faint": ("rgba(0,114,178,0.10)", "rgba(86,180,233,0.13)"),
    "@vermillion-band": ("rgba(213,94,0,0.20)", "rgba(240,138,75,0.24)"),
    "@green-band": ("rgba(0,158,115,0.20)", "rgba(45,190,149,0.24)"),
    "@orange-band": ("rgba(230,159,0,0.22)", "rgba(230,159,0,0.26)"),
    "@shade": ("rgba(230,159,0,0.16)", "rgba(230,159,0,0.20)"),
    "@page": ("#ffffff", "#15191d"),
}
#: Roles of body axes x, y, z, as in the other figures.
AXES = ("@blue", "@vermillion", "@green")

#: Matplotlib's cividis at equal steps: even in lightness for all common kinds of colour vision.
_CIVIDIS = (
    "#00224e", "#083370", "#35456c", "#4f576c", "#666970", "#7d7c78", "#948e77", "#aea371", "#c8b866", "#e5cf52",
    "#fee838",
)  # fmt: skip
#: Normalised RMS at the dark end, and at the bright end where nothing is worse.
LEAST, MOST = 0.5, 10.0


def cividis(share: float) -> tuple[int, int, int]:
    """Colour at a share from 0 (dark) to 1 (bright), red, green and blue of 255."""
    place = min(max(share, 0.0), 1.0) * (len(_CIVIDIS) - 1)
    k = min(int(place), len(_CIVIDIS) - 2)
    low, high = (_parts(_CIVIDIS[i]) for i in (k, k + 1))
    red, green, blue = (round(a + (place - k) * (b - a)) for a, b in zip(low, high, strict=True))
    return red, green, blue


def cell_colours(rms: float, worst: float) -> tuple[str, str]:
    """Ground and text of a cell of the map, on a logarithmic scale from `LEAST` to the worst of the map."""
    top = max(MOST, worst)
    share = math.log(max(rms, LEAST) / LEAST) / math.log(top / LEAST)
    ground = cividis(share)
    return _hex(ground), ink_on(ground)


def ink_on(ground: Sequence[int]) -> str:
    """Black or white on a colour (of 255), whichever has the better contrast: black from 0.18 on (WCAG 2)."""
    return "#000000" if luminance(ground) > 0.18 else "#ffffff"


def gradient() -> str:
    """The whole scale as a CSS gradient."""
    return f"linear-gradient(to right, {', '.join(_CIVIDIS)})"


def _parts(colour: str) -> tuple[int, int, int]:
    return int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16)


def _hex(parts: tuple[int, int, int]) -> str:
    return "#{:02x}{:02x}{:02x}".format(*parts)


def luminance(parts: Sequence[int]) -> float:
    """Relative luminance of a colour of 255 (WCAG 2), 0 to 1."""
    linear = [(p / 255.0 + 0.055) ** 2.4 / 1.055**2.4 if p > 10 else p / 255.0 / 12.92 for p in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]
