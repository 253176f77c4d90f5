"""Constraints against their predictions, in sigmas: in the forward pass, and from all others."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from edl_filter.report.description import Axis, Curve, Element, Figure, Line, Panel, Span, Symbol, Text
from edl_filter.report.text import short, words
from edl_filter.results.groups import Group
from edl_filter.results.reader import ResultReader
from edl_filter.types import Array, BoolArray

PROBABILITY = 0.999
LIMIT = 5.0  # sigmas; a value beyond it is an arrow at the edge with its number
_ROW_INCHES = 0.2
#: Width of the column with the names of constraints and components, inches.
_NAMES_INCHES = 3.2
#: Distance between two constraints, rows.
_GAP = 0.6


@dataclass(frozen=True, eq=False)
class _Component:
    """Values of one component of a constraint, in sigmas ``(U,)``, NaN where nothing was predicted; ``(U,)`` uses."""

    name: str
    values: Array
    accepted: BoolArray


@dataclass(frozen=True, eq=False)
class _Constraint:
    """Components of one constraint, and its normalised innovation squared with its 99.9 % interval if there is one."""

    name: str
    components: list[_Component]
    nis: float
    interval: tuple[float, float] | None


def innovations(reader: ResultReader) -> Panel:
    """Innovations of all constraints in the forward pass, one dot for each use and component.

    The forward pass begins with the entry state; `left_out` compares it with the others.
    """
    constraints = [_innovation(n, g) for n, g in reader.constraints.items() if n != "entry_state"]
    return _panel(constraints, "innovation (sigma)")


def left_out(reader: ResultReader) -> Panel:
    """Each constraint against the prediction from all others."""
    constraints = [_left_out(n, g) for n, g in reader.constraints.items() if "left_out" in g.variables]
    return _panel(constraints, "measured − predicted (sigma)")


def innovations_figure(reader: ResultReader) -> Figure:
    """Innovations of all constraints in sigmas."""
    return _figure(reader, innovations(reader), "constraint innovations")


def left_out_figure(reader: ResultReader) -> Figure:
    """Each constraint against the prediction from all others, in sigmas."""
    return _figure(reader, left_out(reader), "each constraint against all others")


def _figure(reader: ResultReader, panel: Panel, subject: str) -> Figure:
    assert panel.y.range is not None
    rows = max(panel.y.range[0] - panel.y.range[1], 6.0)
    return Figure(f"{reader.title}: {subject}", ((panel,),), (_ROW_INCHES * rows,), margins=(_NAMES_INCHES, 2.35, 0.9))


def _innovation(name: str, group: Group) -> _Constraint:
    values = _numbers(group)
    residual, sigma = np.atleast_2d(values["innovation"]), np.atleast_2d(values["innovation_sigma"])
    accepted = np.atleast_1d(values.get("accepted", np.ones(len(residual)))).astype(bool)
    components = [
        _Component(n, in_sigmas(residual[:, i], sigma[:, i]), accepted)
        for i, n in enumerate(_component_names(group, residual.shape[1]))
    ]
    nis = float(np.sum(values["nis"])) if "nis" in values else np.nan
    return _Constraint(name, components, nis, _interval(group, "nis_interval_99_9", "dof"))


def _left_out(name: str, group: Group) -> _Constraint:
    values = _numbers(group)
    ratio = in_sigmas(np.atleast_1d(values["left_out"]), np.atleast_1d(values["left_out_sigma"]))
    names = _component_names(group, len(ratio))
    components = [_Component(n, ratio[i : i + 1], np.ones(1, bool)) for i, n in enumerate(names)]
    nis = float(group.attrs.get("left_out_nis", np.nan))
    return _Constraint(name, components, nis, _interval(group, "left_out_nis_interval_99_9", "left_out_dof"))


def _interval(group: Group, name: str, dof: str) -> tuple[float, float] | None:
    """Interval of a NIS in attribute `name`; None where its degrees of freedom, in attribute `dof`, are zero."""
    if name not in group.attrs or group.attrs[dof] < 1:
        return None
    low, high = group.attrs[name]
    return float(low), float(high)


def _numbers(group: Group) -> Mapping[str, Array]:
    return {n: np.asarray(v.values, float) for n, v in group.variables.items() if v.values.dtype.kind in "fiub"}


def in_sigmas(residual: Array, sigma: Array) -> Array:
    """Residuals ``(...)`` over their sigmas; NaN where a sigma is zero or not finite."""
    valid = np.isfinite(sigma) & (sigma > 0.0)
    return np.divide(residual, sigma, out=np.full(residual.shape, np.nan), where=valid)


def _component_names(group: Group, count: int) -> list[str]:
    """Names of the components without their units, which values in sigmas do not have."""
    labels = group.variables["component"].values if "component" in group.variables else ()
    names = [re.sub(r"\s*\([^)]*\)$", "", str(label)) for label in np.atleast_1d(labels)]
    return names if len(names) == count else [str(i) for i in range(count)]


def _panel(constraints: list[_Constraint], label: str) -> Panel:
    elements: list[Element] = [
        Span(-3.0, 3.0, colour="blue-fainter"), Span(-1.0, 1.0, colour="blue-faint"), Line(0.0, "x"),
        Line(-3.0, "x", dash="dash"), Line(3.0, "x", dash="dash"),
    ]  # fmt: skip
    ticks: list[tuple[float, str]] = []
    y = 0.0
    for constraint in constraints:
        first = y
        for component in constraint.components:
            elements += _component_elements(component, y)
            ticks.append((y, component.name))
            y += 1.0
        elements += _constraint_texts(constraint, 0.5 * (first + y - 1.0))
        y += _GAP
        elements.append(Line(y - 0.8, "y", colour="grid"))
    components = [component for constraint in constraints for component in constraint.components]
    if any(len(component.values) > 1 for component in components):
        label += "\nused many times: one small dot per use, the first at the top"
    if any(not component.accepted.all() for component in components):
        label += "; cross: not accepted"
    head = f"NIS in its {100 * PROBABILITY:g} % interval"
    elements.append(Text(head, 1.03, 1.0, ("panel", "panel"), horizontal="left", vertical="bottom", size=10.5))
    rows = Axis(range=(max(y - 0.8, 1.0), -0.8), ticks=tuple(ticks), grid=False)
    return Panel(Axis(label, range=(-LIMIT, LIMIT)), rows, tuple(elements))


def _component_elements(component: _Component, y: float) -> list[Element]:
    """Dots of one component around a row of the panel."""
    values, uses = component.values, len(component.values)
    if not np.isfinite(values).any():
        return [Text("not predicted by the others", 0.0, y, size=9.0, colour="muted")]
    repeated = uses > 1
    rows = y + np.linspace(-0.35, 0.35, uses) if repeated else np.full(uses, y)
    inside = np.abs(values) <= LIMIT
    elements: list[Element] = []
    styles: tuple[tuple[bool, str, Symbol], ...] = ((True, "blue", "circle"), (False, "vermillion", "cross"))
    for accepted, colour, symbol in styles:
        chosen = (component.accepted == accepted) & inside
        if chosen.any():
            style: dict[str, Any] = {"size": 2.5 if repeated and accepted else 6.0, "opacity": 0.5 if repeated else 1.0}
            dots = Curve(values[chosen], rows[chosen], "", colour, "sigma", 0.0, symbol=symbol, **style)
            elements.append(dots)
    for value in values[~inside & np.isfinite(values)]:
        right = value > 0.0
        edge = LIMIT if right else -LIMIT
        arrow: Symbol = "right" if right else "left"
        point = np.array([edge]), np.array([y])
        elements.append(Curve(*point, "", "vermillion", "sigma", 0.0, symbol=arrow, size=7.0))
        elements.append(
            Text(
                f"{value:.1f}", edge, y, offset=(-7.0 if right else 7.0, 0.0), horizontal="right" if right else "left",
                colour="vermillion",
            )
        )  # fmt: skip
    return elements


def _constraint_texts(constraint: _Constraint, y: float) -> list[Element]:
    """The constraint's name at the left of its rows, and its NIS with the interval at the right."""
    offset = (-72.0 * (_NAMES_INCHES - 0.15), 0.0)
    name = Text(words(constraint.name), 0.0, y, ("panel", "data"), offset, "left", size=11.0)
    if not np.isfinite(constraint.nis) or constraint.interval is None:
        return [name]
    low, high = constraint.interval
    consistent = low <= constraint.nis <= high
    text = f"{short(constraint.nis)} {'in' if consistent else 'not in'} {short(low)} … {short(high)}"
    colour = "ink" if consistent else "vermillion"
    return [name, Text(text, 1.03, y, ("panel", "data"), horizontal="left", size=10.5, colour=colour)]
