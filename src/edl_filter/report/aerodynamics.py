"""Figures of the aerodynamic coefficients: two atmospheres, three methods (thesis chapters 5 to 7)."""

from __future__ import annotations

from collections.abc import Callable

from matplotlib.figure import Figure
from xarray import DataTree

from edl_filter.report import style
from edl_filter.report.postflight import BAND, LEGEND, Layer, Panel, layer, strips
from edl_filter.types import Array

FLIGHT, OTHER = "coefficients/flight", "coefficients/preflight_density"
DATABASE, MEASURED = "coefficients/database", "coefficients/database_measured"
BETWEEN = "atmosphere_differences"
_COLOURS = {
    "CA": style.BLACK,
    "CN": style.BLUE,
    "CY": style.ORANGE,
    "Cl": style.PURPLE,
    "Cm": style.VERMILLION,
    "Cn": style.GREEN,
}
#: Coefficient → name of the flight's method, of the combination's, and the latter's group.
_WAYS = {
    "CN": ("accels", "combine Cm", "combination/moments"),
    "CY": ("accels", "combine Cn", "combination/moments"),
    "Cm": ("gyros", "combine CN", "combination/forces"),
    "Cn": ("gyros", "combine CY", "combination/forces"),
}


@style.styled
def database_atmospheres(tree: DataTree) -> Figure:
    """The database's coefficients with the flight's atmosphere less those with the preflight one."""
    shared = layer(tree)
    panels = (_change("database", "CA", "CN", "CY"), _change("database", "Cm", "Cn"))
    return strips(shared, "MEVAD, flight less preflight", panels, (2.8, 2.8), low=shared.start)


@style.styled
def flight_atmospheres(tree: DataTree) -> Figure:
    """The flight's six coefficients with both atmospheres, and the differences."""
    panels = (
        *(_flight_both(name) for name in _COLOURS),
        # CA and Cl change by ten times what the others do: apart from them
        *(_change("flight", *pair) for pair in (("CN", "CY"), ("Cm", "Cn"), ("CA", "Cl"))),
    )
    return strips(layer(tree), "coefficients, both atmospheres", panels, (1.2,) * 6 + (1.6,) * 3)


def _flight_both(name: str) -> Callable[[Panel], None]:
    def draw(panel: Panel) -> None:
        factor, unit = (1e6, "1e−6") if name == "Cl" else (1.0, "–")
        flown, other = factor * panel.layer.get(FLIGHT, name), factor * panel.layer.get(OTHER, name)
        panel.line(other, style.VERMILLION, "preflight atmosphere", 1.8)
        panel.line(flown, style.BLUE, "flight atmosphere", 0.9)
        first = name == "CA"
        panel.limits(flown, other, room=LEGEND if first else 0.0)
        panel.ax.set_ylabel(f"{name} ({unit})")
        if first:
            panel.legend()

    return draw


def _change(of: str, *names: str) -> Callable[[Panel], None]:
    """Differences in percent of the database's 3 sigma, of the database's or the flight's coefficients."""

    def draw(panel: Panel) -> None:
        shown = [panel.layer.get(BETWEEN, f"{name}_{of}") for name in names]
        for name, values in zip(names, shown, strict=True):
            panel.line(values, _COLOURS[name], name)
        panel.limits(*shown, everything=of == "database", room=LEGEND)
        panel.ax.set_ylabel(f"Δ {', '.join(names)}\n(% of 3 sigma)")
        panel.legend()

    return draw


@style.styled
def force_coefficients(tree: DataTree) -> Figure:
    """CN and CY by three methods, and their differences within the database's 3 sigma."""
    return _methods(tree, "forces by three methods", "CN", "CY")


@style.styled
def moment_coefficients(tree: DataTree) -> Figure:
    """Cm and Cn by three methods, and their differences within the database's 3 sigma."""
    return _methods(tree, "moments by three methods", "Cm", "Cn")


def _methods(tree: DataTree, subject: str, *names: str) -> Figure:
    panels = [draw for name in names for draw in (_three(name), _apart(name))]
    return strips(layer(tree), subject, panels, (2.3, 1.7) * len(names))


def _three(name: str) -> Callable[[Panel], None]:
    def draw(panel: Panel) -> None:
        shared = panel.layer
        expected, limit, flown, combined = _found(shared, name)
        own, through, _ = _WAYS[name]
        panel.band(expected - limit, expected + limit, BAND, "MEVAD 3 sigma")
        panel.line(combined, style.GREEN, through, 1.2)
        panel.line(flown, style.VERMILLION, own, 1.0)
        panel.line(expected, style.BLUE, "MEVAD", 1.0)
        panel.limits(expected - limit, expected + limit, flown, combined, room=LEGEND)
        panel.ax.set_ylabel(f"{name} (–)")
        panel.legend()

    return draw


def _apart(name: str) -> Callable[[Panel], None]:
    def draw(panel: Panel) -> None:
        expected, limit, flown, combined = _found(panel.layer, name)
        own, through, _ = _WAYS[name]
        panel.band(-limit, limit, BAND)
        if panel.layer.has(FLIGHT, f"{name}_sigma"):
            sigma = panel.layer.get(FLIGHT, f"{name}_sigma")
            panel.band(
                expected - flown - sigma, expected - flown + sigma, style.VERMILLION, "flight's 1 sigma", alpha=0.3
            )
        panel.line(expected - combined, style.GREEN, f"MEVAD − {through}", 1.2)
        panel.line(expected - flown, style.VERMILLION, f"MEVAD − {own}", 1.0)
        panel.ax.axhline(0.0, color=style.GREY, linewidth=0.8)
        panel.limits(-limit, limit, expected - flown, expected - combined, room=LEGEND)
        panel.ax.set_ylabel(f"Δ{name} (–)")
        panel.legend()

    return draw


def _found(shared: Layer, name: str) -> tuple[Array, Array, Array, Array]:
    """The database's, as the flight's instruments would see it, its 3 sigma, the flight's and the combination's."""
    return (
        shared.get(MEASURED, name),
        shared.get(DATABASE, f"{name}_three_sigma"),
        shared.get(FLIGHT, name),
        shared.get(_WAYS[name][2], name),
    )
