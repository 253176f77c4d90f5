"""Rotation: rolling moment, angles by three methods, angular accelerations, oscillation (thesis section 7.3, ch. 8)."""

from __future__ import annotations

import numpy as np

from edl_filter.report.colours import AXES
from edl_filter.report.description import Axis, Curve, Element, Figure, Legend, Line, Panel, Text, bounds
from edl_filter.report.domain import DomainView
from edl_filter.results.reader import ResultReader

_FLIGHT, _MOTION, _ANGLES, _OSCILLATION = "coefficients/flight", "motion", "angles", "oscillation"
_COUPLING = {"difference": "Izz − Iyy", "xy": "Ixy", "xz": "Ixz", "yz": "Iyz"}


def rolling_moment(reader: ResultReader) -> Figure:
    """Rolling-moment coefficient with its band, and the parts of the moment."""
    view = DomainView(reader)
    panels = (_rolling_coefficient(view), _rolling_parts(view), _rolling_terms(view))
    return view.figure("rolling moment", panels, (2.6, 2.1, 2.1))


def _rolling_coefficient(view: DomainView) -> Panel:
    value, sigma = (1e6 * view.values(_FLIGHT, name) for name in ("Cl", "Cl_sigma"))
    elements = (
        view.band(value - sigma, value + sigma, "blue-faint", "±1 sigma"), view.curve(value, "blue", "Cl"), Line(0.0),
    )  # fmt: skip
    return view.panel(Axis("Cl", "1e−6", range=view.limits(value, legend=True, outside=0.015)), elements, Legend())


def _rolling_parts(view: DomainView) -> Panel:
    spin = view.values(_MOTION, "rolling_spin")
    coupling = np.sum([view.values(_MOTION, f"rolling_{name}") for name in _COUPLING], axis=0)
    curves = (
        view.curve(spin, "blue", "measured torque (Ixx dp/dt)"), view.curve(coupling, "vermillion", "inertia coupling"),
    )  # fmt: skip
    y = Axis("rolling moment", "N m", range=view.limits(spin, coupling, legend=True, outside=0.008))
    return view.panel(y, curves, Legend())


def _rolling_terms(view: DomainView) -> Panel:
    terms = {name: view.values(_MOTION, f"rolling_{name}") for name in _COUPLING}
    colours = dict(zip(_COUPLING, ("vermillion", "green", "orange", "purple"), strict=True))
    terms = {name: values for name, values in terms.items() if np.any(values != 0.0)}
    curves = [view.curve(v, colours[name], f"by {_COUPLING[name]}", 0.9) for name, v in terms.items()]
    return view.panel(
        Axis("inertia coupling", "N m", range=view.limits(*terms.values(), legend=True)), curves, Legend()
    )


def angles_by_method(reader: ResultReader) -> Figure:
    """Angle of attack and sideslip by three methods, and their differences; the band is of forces minus moments."""
    view = DomainView(reader)
    panels = [panel for name in ("alpha", "beta") for panel in (_angle(view, name), _angle_differences(view, name))]
    return view.figure("angles by three methods", panels, (2.1, 1.9, 2.1, 1.9))


def _angle(view: DomainView, name: str) -> Panel:
    reconstructed, forces, moments = (
        np.degrees(view.values(group, name)) for group in (_ANGLES, "combination/forces", "combination/moments")
    )
    curves = (
        view.curve(moments, "green", "from moments, by inverse look-up", 1.2),
        view.curve(forces, "vermillion", "from forces, by inverse look-up"),
        view.curve(reconstructed, "blue", "reconstructed"),
    )
    label = {"alpha": "angle of\nattack", "beta": "sideslip"}[name]
    return view.panel(
        Axis(label, "°", range=view.limits(reconstructed, forces, moments, legend=True)), curves, Legend()
    )


def _angle_differences(view: DomainView, name: str) -> Panel:
    elements: list[Element] = []
    if view.has(_ANGLES, f"{name}_between_sigma"):
        sigma = np.degrees(view.values(_ANGLES, f"{name}_between_sigma"))
        elements.append(view.band(-sigma, sigma, "muted-band", "±1 sigma"))
    differences = []
    for part, label, colour in (
        ("moments", "recon. − moments", "green"),
        ("forces", "recon. − forces", "vermillion"),
        ("between", "forces − moments", "ink"),
    ):
        differences.append(np.degrees(view.values(_ANGLES, f"{name}_{part}")))
        elements.append(view.curve(differences[-1], colour, label))
    label = {"alpha": "differences in\nattack", "beta": "differences in\nsideslip"}[name]
    return view.panel(Axis(label, "°", range=view.limits(*differences, legend=True)), elements, Legend())


def angular_accelerations(reader: ResultReader) -> Figure:
    """Angular accelerations about x, y, z with one-sigma bands."""
    view = DomainView(reader, all_air=True)
    panels = [_angular_acceleration(view, axis) for axis in range(3)]
    return view.figure("angular accelerations, body axes", panels, (2.1, 2.1, 2.1))


def _angular_acceleration(view: DomainView, axis: int) -> Panel:
    value = np.degrees(view.values(_MOTION, "angular_acceleration")[:, axis])
    sigma = np.degrees(view.values(_MOTION, "angular_acceleration_sigma"))
    elements = (
        view.band(value - sigma, value + sigma, "muted-band", "±1 sigma"), view.curve(value, AXES[axis], "estimate"),
    )  # fmt: skip
    y = Axis(f"about {'xyz'[axis]}", "°/s²", range=view.limits(value, everywhere=True, legend=axis == 0))
    return view.panel(y, elements, Legend() if axis == 0 else None)


def oscillation(reader: ResultReader) -> Figure:
    """Lateral rates, growth by damping and static stability, in windows of time."""
    view = DomainView(reader)
    rate = np.degrees(view.values(_OSCILLATION, "rate"))
    curve = Curve(view.values(_OSCILLATION, "time"), rate, "", "blue", "°/s", symbol="circle", size=3.5)
    top = 1.1 * float(np.nanmax(rate)) or 1.0
    y = Axis("lateral rates,\nRMS", "°/s", range=(-0.12 * top, top))  # the instabilities are named at the foot
    note = Text(
        "above zero the oscillation grows; bars: 1 sigma of the fit", 0.99, 0.03, ("panel", "panel"),
        horizontal="right", vertical="bottom", size=9.0,
    )  # fmt: skip
    growth = Axis("growth by in-phase\nmoments", "1/s")
    panels = (
        view.panel(y, (curve,)),
        _windows(view, "growth", "vermillion", growth, Line(0.0), note),
        _windows(view, "stiffness", "green", Axis("slope Cm over\nangle", "1/rad")),
    )
    return view.figure("oscillation", panels, (1.7, 2.5, 1.7))


def _windows(view: DomainView, name: str, colour: str, y: Axis, *elements: Element) -> Panel:
    time, value, sigma = (view.values(_OSCILLATION, n) for n in ("time", name, f"{name}_sigma"))
    valid = np.isfinite(value)
    # windows with a large sigma do not determine the range
    precise = (sigma < 3.0 * np.nanmedian(sigma)) | (np.abs(value) > 3.0 * sigma)
    curve = Curve(time[valid], value[valid], "", colour, y.unit, 0.0, symbol="circle", size=3.5, sigma=sigma[valid])
    limits = bounds([(value - sigma)[precise], (value + sigma)[precise]], outside=0.0)
    return view.panel(Axis(y.label, y.unit, range=limits), (*elements, curve))
