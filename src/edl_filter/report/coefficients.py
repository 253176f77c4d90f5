"""Aerodynamic coefficients: two atmospheres, three methods, and the database (thesis chapters 5 to 7)."""

from __future__ import annotations

from dataclasses import dataclass, replace

from edl_filter.report.description import Axis, Element, Figure, Legend, Line, Panel
from edl_filter.report.domain import DomainView
from edl_filter.results.reader import ResultReader
from edl_filter.types import Array

FLIGHT, FLIGHT_PREFLIGHT = "coefficients/flight", "coefficients/preflight_density"
DATABASE, DATABASE_MEASURED = "coefficients/database", "coefficients/database_measured"
DATABASE_PREFLIGHT = "coefficients/database_preflight"
DIFFERENCES = "atmosphere_differences"
COLOURS = {"CA": "ink", "CN": "blue", "CY": "orange", "Cl": "purple", "Cm": "vermillion", "Cn": "green"}
#: Coefficient → meaning, in the order of the page.
MEANINGS = {
    "CN": "normal force", "CY": "side force", "Cm": "pitching moment", "Cn": "yawing moment", "Cl": "rolling moment",
    "CA": "axial force, preflight density",
}  # fmt: skip
_INVERSE = ", by inverse look-up"
#: Coefficient → origin of the combination, which an inverse look-up in the database takes to it, and its group.
_METHODS = {
    "CN": ("from moments", "combination/moments"),
    "CY": ("from moments", "combination/moments"),
    "Cm": ("from forces", "combination/forces"),
    "Cn": ("from forces", "combination/forces"),
}


def database_atmospheres(reader: ResultReader) -> Figure:
    """The database's coefficients with the flight's atmosphere minus those with the preflight one."""
    view = DomainView(reader, all_air=True)
    panels = (_change(view, "database", "CA", "CN", "CY"), _change(view, "database", "Cm", "Cn"))
    return view.figure("MEVAD, flight minus preflight", panels, (2.8, 2.8))


def flight_atmospheres(reader: ResultReader) -> Figure:
    """The flight's six coefficients with both atmospheres, and the differences."""
    view = DomainView(reader)
    panels = (
        *(_both_atmospheres(view, name) for name in COLOURS),
        # CA and Cl change by ten times as much as the others: in a panel of their own
        *(_change(view, "flight", *pair) for pair in (("CN", "CY"), ("Cm", "Cn"), ("CA", "Cl"))),
    )
    return view.figure("coefficients, both atmospheres", panels, (1.2,) * 6 + (1.6,) * 3)


def _both_atmospheres(view: DomainView, name: str) -> Panel:
    factor, unit = (1e6, "1e−6") if name == "Cl" else (1.0, "–")
    flight, preflight = (factor * view.values(group, name) for group in (FLIGHT, FLIGHT_PREFLIGHT))
    curves = (
        view.curve(preflight, "vermillion", "preflight atmosphere", 1.8),
        view.curve(flight, "blue", "flight atmosphere", 0.9),
    )
    first = name == "CA"
    y = Axis(name, unit, range=view.limits(flight, preflight, legend=first, outside=0.0))
    return view.panel(y, curves, Legend() if first else None)


def _change(view: DomainView, origin: str, *names: str) -> Panel:
    """Differences in percent of the database's 3 sigma, of the database's or the flight's coefficients."""
    values = [view.values(DIFFERENCES, f"{name}_{origin}") for name in names]
    curves = [view.curve(v, COLOURS[name], name, 1.0, "%") for name, v in zip(names, values, strict=True)]
    limits = view.limits(*values, everywhere=origin == "database", legend=True)
    return view.panel(Axis(f"Δ {', '.join(names)}\n(% of 3 sigma)", range=limits), curves, Legend())


def force_coefficients(reader: ResultReader) -> Figure:
    """CN and CY by three methods, and their differences within the database's 3 sigma."""
    return _three_methods(reader, "forces by three methods", "CN", "CY")


def moment_coefficients(reader: ResultReader) -> Figure:
    """Cm and Cn by three methods, and their differences within the database's 3 sigma."""
    return _three_methods(reader, "moments by three methods", "Cm", "Cn")


def _three_methods(reader: ResultReader, subject: str, *names: str) -> Figure:
    view = DomainView(reader)
    panels = [panel for name in names for panel in (_methods(view, name), _method_differences(view, name))]
    return view.figure(subject, panels, (2.3, 1.7) * len(names))


@dataclass(frozen=True, eq=False)
class _Methods:
    """One coefficient by three methods, ``(N,)`` each; `database` is as the flight's instruments would measure it."""

    database: Array
    three_sigma: Array
    flight: Array
    combination: Array

    @classmethod
    def read(cls, view: DomainView, name: str) -> _Methods:
        return cls(
            view.values(DATABASE_MEASURED, name),
            view.values(DATABASE, f"{name}_three_sigma"),
            view.values(FLIGHT, name),
            view.values(_METHODS[name][1], name),
        )


def _methods(view: DomainView, name: str) -> Panel:
    v, (origin, _) = _Methods.read(view, name), _METHODS[name]
    low, high = v.database - v.three_sigma, v.database + v.three_sigma
    elements = (
        view.band(low, high, "blue-faint", "MEVAD 3 sigma"),
        view.curve(v.combination, "green", origin + _INVERSE, 1.2),
        view.curve(v.flight, "vermillion", "flight"),
        view.curve(v.database, "blue", "MEVAD"),
    )
    return view.panel(
        Axis(name, "–", range=view.limits(low, high, v.flight, v.combination, legend=True)), elements, Legend()
    )


def _method_differences(view: DomainView, name: str) -> Panel:
    v, (origin, _) = _Methods.read(view, name), _METHODS[name]
    from_flight, from_combination = v.database - v.flight, v.database - v.combination
    elements: list[Element] = [view.band(-v.three_sigma, v.three_sigma, "blue-faint")]
    if view.has(FLIGHT, f"{name}_sigma"):
        sigma = view.values(FLIGHT, f"{name}_sigma")
        elements.append(view.band(from_flight - sigma, from_flight + sigma, "vermillion-band", "flight's 1 sigma"))
    elements += [
        view.curve(from_combination, "green", f"MEVAD − {origin}", 1.2),
        view.curve(from_flight, "vermillion", "MEVAD − flight"),
        Line(0.0),
    ]
    limits = view.limits(-v.three_sigma, v.three_sigma, from_flight, from_combination, legend=True)
    return view.panel(Axis(f"Δ{name}", "–", range=limits), elements, Legend())


def against_database(reader: ResultReader, name: str) -> Panel | None:
    """One coefficient of the flight within the database's three sigma; None if the result does not have it.

    The partner is the database as the flight's instruments would measure it. The flight's density is derived from CA:
    only the preflight density gives a CA that can be compared.
    """
    if reader.domain is None:
        return None
    axial = name == "CA"
    flight_group, database_group, sigma_group = (
        (FLIGHT_PREFLIGHT, DATABASE_PREFLIGHT, DATABASE_PREFLIGHT) if axial else (FLIGHT, DATABASE_MEASURED, DATABASE)
    )
    view = DomainView(reader)
    if not view.has(flight_group, name) or not view.has(database_group, name) or not view.inside.any():
        return None
    flight, database = view.values(flight_group, name), view.values(database_group, name)
    elements: list[Element] = []
    values, bands = [flight, database], []
    if view.has(sigma_group, f"{name}_three_sigma"):
        limit = view.values(sigma_group, f"{name}_three_sigma")
        elements.append(view.band(database - limit, database + limit, "blue-band", "database, 3 sigma"))
        bands += [database - limit, database + limit]
    if view.has(flight_group, f"{name}_sigma"):
        sigma = view.values(flight_group, f"{name}_sigma")
        elements.append(view.band(flight - sigma, flight + sigma, "vermillion-band", "flight, 1 sigma"))
        bands += [flight - sigma, flight + sigma] if axial else []  # of others it is wider than all else at first
    elements += [view.curve(database, "blue", "database", 1.4), view.curve(flight, "vermillion", "flight", 1.1)]
    curve_limits = view.limits(*values, everywhere=True, outside=0.0)  # no curve is clipped
    band_limits = view.limits(*bands, everywhere=True) if bands else curve_limits
    limits = min(curve_limits[0], band_limits[0]), max(curve_limits[1], band_limits[1])
    panel = view.panel(Axis(name, "–", range=limits), elements, Legend())
    caption = f"{name}: {MEANINGS[name]}."
    events = {event: time for event, time in reader.events.items() if time <= view.domain.end}
    return replace(panel, events=events, name=f"coefficient_{name}", caption=caption)
