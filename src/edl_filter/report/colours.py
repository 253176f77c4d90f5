"""Colours by role: one for printed figures, one for each theme of the page."""

from __future__ import annotations

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


def page_roles() -> dict[str, tuple[str, str]]:
    """Colours of the page: ``"@role"`` → colour of the light theme, colour of the dark theme."""
    return {f"@{role}": (light, dark) for role, (_, light, dark) in ROLES.items()}


def scale_colours() -> tuple[str, ...]:
    """Colours of the scale at equal steps."""
    return _CIVIDIS
