"""Motion as the IMU measured it: accelerations (thesis figures 3.2, 3.9) and rates (figure 3.3)."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np

from edl_filter.errors import InputError
from edl_filter.report.colours import AXES
from edl_filter.report.description import Axis, Curve, Element, Figure, Legend, Line, Panel, Text, bounds
from edl_filter.report.trajectory import samples_within, time_axis
from edl_filter.results.reader import Phase, ResultReader
from edl_filter.types import Array

#: Decelerations below this are noise of every IMU that has flown an entry, m/s².
LEAST_DECELERATION = 1e-3
#: Time before the landing at which the range of a panel ends, s: the shocks of the ground are much larger.
_BEFORE_LANDING = 0.5
#: Relative widths of the columns of entry and descent.
PHASE_WIDTHS = (1.5, 1.0)

ImuQuantity = Literal["specific_force", "angular_rate"]


def axial_deceleration(reader: ResultReader) -> Panel:
    """Deceleration along the body's x axis on a logarithmic scale.

    The line is the deceleration; samples of the opposite sign, which are noise before the atmosphere and oscillation or
    shocks after it, are dots at their magnitude.
    """
    axis = time_axis(reader)
    time, force = _measured(reader, "specific_force")
    inside = samples_within(time, axis)
    time, drag = time[inside], -force[inside, 0]
    line = np.where(drag > LEAST_DECELERATION, drag, np.nan)
    elements: list[Element] = [Curve(time, line, "deceleration (−x)", "blue", "m/s²", 1.1)]
    opposite = drag < -LEAST_DECELERATION
    if opposite.any():
        elements.append(
            Curve(
                time[opposite], -drag[opposite], "acceleration (+x)", "orange", "m/s²", 0.0, symbol="circle", size=1.5
            )
        )
    elements += _peak(reader, time, drag)
    domain = reader.domain
    if domain is not None and np.isfinite(domain.threshold) and reader.attribute("postflight", "domain_start"):
        elements.append(Line(domain.threshold, "y", colour="green", dash="dot", width=1.2))
        label = f"deceleration detectable from {domain.start:.1f} s"
        elements.append(Line(domain.start, "x", label, "green", "dot", 1.2))
    top = max(10.0 ** np.ceil(np.log10(np.nanmax(np.abs(drag)))), 1e2)
    y = Axis("axial deceleration", "m/s²", "log", (LEAST_DECELERATION, float(top)))
    return Panel(axis, y, tuple(elements), reader.events, Legend("lower center", 3))


def _peak(reader: ResultReader, time: Array, drag: Array) -> list[Element]:
    entry = time <= reader.span("entry")[1]
    if not entry.any():
        return []
    k = int(np.nanargmax(np.where(entry, drag, -np.inf)))
    text = f"peak {drag[k]:.1f} m/s²\n(one sample)\nat {time[k]:.1f} s"
    return [
        Curve(time[k : k + 1], drag[k : k + 1], "", "vermillion", "m/s²", 0.0, symbol="circle", size=5.0),
        Text(text, time[k], drag[k], offset=(0.0, -16.0), vertical="top", size=11.0, boxed=True),
    ]


def acceleration(reader: ResultReader, axis: int, phase: Phase = "flight") -> Panel:
    """Specific force at the centre of mass along a body axis: 0, 1, 2 for x, y, z."""
    return _component(reader, "specific_force", axis, phase, 1.0, Axis(f"along {'xyz'[axis]}", "m/s²"))


def angular_rate(reader: ResultReader, axis: int, phase: Phase = "flight") -> Panel:
    """Angular rate about a body axis: 0, 1, 2 for x, y, z."""
    return _component(reader, "angular_rate", axis, phase, float(np.degrees(1.0)), Axis(f"about {'xyz'[axis]}", "°/s"))


def _component(reader: ResultReader, quantity: ImuQuantity, axis: int, phase: Phase, scale: float, y: Axis) -> Panel:
    x = time_axis(reader, phase)
    time, values = _measured(reader, quantity)
    inside = samples_within(time, x)
    time, component = time[inside], scale * values[inside, axis]
    before = time < reader.events.get("landing", np.inf) - _BEFORE_LANDING
    y = replace(y, range=bounds([component[before]], 0.0, 0.08))
    curve = Curve(time, component, "", AXES[axis], y.unit, 1.0)
    return Panel(x, y, (curve,), reader.events)


def _measured(reader: ResultReader, quantity: ImuQuantity) -> tuple[Array, Array]:
    measured = reader.imu(quantity)
    if measured is None:
        raise InputError(f"{reader.title}: found no {quantity.replace('_', ' ')} in the result.")
    return measured


def deceleration_figure(reader: ResultReader) -> Figure:
    """Axial deceleration on a logarithmic scale."""
    return Figure(f"{reader.title}: axial deceleration", ((axial_deceleration(reader),),), (3.6,), event_labels=True)


def accelerations(reader: ResultReader) -> Figure:
    """Accelerations along x, y, z at the centre of mass, in entry and descent."""
    return _by_phase(reader, acceleration, "accelerations at the centre of mass")


def angular_rates(reader: ResultReader) -> Figure:
    """Angular rates about x, y, z, in entry and descent."""
    return _by_phase(reader, angular_rate, "angular rates, body axes")


def _by_phase(reader: ResultReader, component: object, subject: str) -> Figure:
    assert callable(component)
    rows = tuple(
        phase_row(reader, tuple(component(reader, axis, phase) for phase in reader.phases)) for axis in range(3)
    )
    return Figure(
        f"{reader.title}: {subject}", rows, (2.05,) * 3, PHASE_WIDTHS[: len(reader.phases)], shared_x=True,
        event_labels=True,
    )  # fmt: skip


def phase_row(reader: ResultReader, panels: tuple[Panel, ...]) -> tuple[Panel, ...]:
    """Panels of the phases in one row: the labels of the first apply to the others."""
    return (
        panels[0],
        *(replace(p, x=replace(p.x, label="time"), y=replace(p.y, label="", unit="")) for p in panels[1:]),
    )
