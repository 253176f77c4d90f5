"""Attitude: total angle of attack (thesis figure 3.13) and quaternion (figures 18.1 to 18.3)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from edl_filter import rotations
from edl_filter.report.colours import AXES
from edl_filter.report.description import Axis, Band, Curve, Element, Figure, Legend, Panel
from edl_filter.report.domain import instability_spans
from edl_filter.report.motion import PHASE_WIDTHS, phase_row
from edl_filter.report.trajectory import samples_within, time_axis
from edl_filter.results.reader import Phase, ResultReader


def total_angle_of_attack(reader: ResultReader, phase: Phase = "entry") -> Panel:
    """Angle of the x axis from the air-relative velocity, with bands of one and three sigma.

    The bands end at 0 and 180 degrees, as the angle does. The range is that of the flight under the parachute: from the
    retro-rockets on the lander is slow and tumbles, and the angle does not describe the flow.
    """
    axis, entry = time_axis(reader, phase), phase == "entry"
    inside = samples_within(reader.time, axis)
    time = reader.time[inside]
    angle = np.degrees(reader.required("trajectory", "alpha_total")[inside])
    flying = time <= max(_end_of_aerodynamic_flight(reader), time[0])
    top = float(np.nanmax(angle[flying]))
    elements: list[Element] = []
    sigma = reader.trajectory("alpha_total_sigma")
    if sigma is not None:
        spread = np.degrees(sigma[inside])
        for count, colour in ((3.0, "blue-faint"), (1.0, "sky")):
            low, high = (np.clip(angle + sign * count * spread, 0.0, 180.0) for sign in (-1.0, 1.0))
            elements.append(Band(time, low, high, f"±{count:.0f} sigma", colour))
        # Single peaks of the band may leave the panel, those of the angle may not
        top = max(top, float(np.nanquantile((angle + 3.0 * spread)[flying], 0.99)))
    elements.append(Curve(time, angle, "estimate", "blue", "°", 0.9))
    y = Axis("total angle of attack", "°", range=(0.0, min((1.22 if entry else 1.08) * top, 180.0)))
    return Panel(axis, y, tuple(elements), reader.events, Legend("upper left", 3) if entry else None)


def quaternion(reader: ResultReader) -> Panel:
    """Elements of the quaternion to the body from J2000, or from inertial axes if their rotation is not stated."""
    axis = time_axis(reader, "entry")
    inside = samples_within(reader.time, axis)
    time, elements = reader.time[inside], reader.required("trajectory", "inertial_from_body")[inside]
    matrix = reader.attribute("", "j2000_from_inertial")
    if matrix is not None:
        elements = elements @ rotations.product_matrix(rotations.from_matrix(np.reshape(matrix, (3, 3)))).T
    elements = rotations.conjugate(elements)
    flip = np.cumprod(np.where(np.sum(elements[1:] * elements[:-1], axis=1) < 0.0, -1.0, 1.0))
    elements = elements * np.concatenate(([1.0], flip))[:, None]
    curves = tuple(
        Curve(time, elements[:, k], f"q{k + 1}", colour, "", 0.9) for k, colour in enumerate((*AXES, "orange"))
    )
    y = Axis("quaternion element, scalar last", "–", range=(-1.25, 1.05))
    return Panel(axis, y, curves, reader.events, Legend("lower left", 4))


def quaternion_subject(reader: ResultReader) -> str:
    """Subject of the title of a quaternion's figure, with its frame."""
    return f"{'inertial' if reader.attribute('', 'j2000_from_inertial') is None else 'J2000'} to body quaternion"


def quaternion_figure(reader: ResultReader) -> Figure:
    """Quaternion to the body until the parachute."""
    title = f"{reader.title}: {quaternion_subject(reader)}"
    return Figure(title, ((quaternion(reader),),), (3.6,), event_labels=True)


def angle_of_attack_figure(reader: ResultReader) -> Figure:
    """Total angle of attack in entry and descent; instabilities are shaded."""
    entry, *descent = (total_angle_of_attack(reader, phase) for phase in reader.phases)
    if reader.domain is not None:
        # Below the legend: the angle dips to 0 at the foot
        spans = instability_spans(reader.domain, reader.span("entry")[0], height=0.8)
        entry = replace(entry, elements=(*spans, *entry.elements))
    row = phase_row(reader, (entry, *descent))
    return Figure(f"{reader.title}: total angle of attack", (row,), (4.0,), PHASE_WIDTHS[: len(row)], event_labels=True)


def _end_of_aerodynamic_flight(reader: ResultReader) -> float:
    """Time from which the angle of attack does not describe the flow, s."""
    times = [reader.events[n] for n in ("retro_rocket_fire", "bridle_cut") if n in reader.events]
    if "landing" in reader.events:
        times.append(reader.events["landing"] - 0.5)
    return min(times, default=np.inf)
