"""Figures of angles and rotation: rolling moment, angles by three methods, angular accelerations (thesis chapter 8)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from matplotlib.figure import Figure
from xarray import DataTree

from edl_filter.report import style
from edl_filter.report.postflight import BAND, LEGEND, Panel, layer, strips

_FLIGHT, _MOTION, _ANGLES = "coefficients/flight", "motion", "angles"
_COUPLING = {"difference": "Izz − Iyy", "xy": "Ixy", "xz": "Ixz", "yz": "Iyz"}


@style.styled
def rolling_moment(tree: DataTree) -> Figure:
    """Rolling-moment coefficient with its band, and the parts of the moment."""
    return strips(layer(tree), "rolling moment", (_rolling, _rolling_parts, _rolling_terms), (2.6, 2.1, 2.1))


def _rolling(panel: Panel) -> None:
    value, sigma = panel.layer.get(_FLIGHT, "Cl"), panel.layer.get(_FLIGHT, "Cl_sigma")
    panel.band(1e6 * (value - sigma), 1e6 * (value + sigma), BAND, "±1 sigma")
    panel.line(1e6 * value, style.BLUE, "Cl")
    panel.ax.axhline(0.0, color=style.GREY, linewidth=0.8)
    panel.limits(1e6 * value, room=LEGEND, outside=0.015)
    panel.ax.set_ylabel("Cl (1e−6)")
    panel.legend()


def _rolling_parts(panel: Panel) -> None:
    spin = panel.layer.get(_MOTION, "rolling_spin")
    coupling = np.sum([panel.layer.get(_MOTION, f"rolling_{n}") for n in _COUPLING], axis=0)
    panel.line(spin, style.BLUE, "measured torque (Ixx dp/dt)")
    panel.line(coupling, style.VERMILLION, "inertia coupling")
    panel.limits(spin, coupling, room=LEGEND, outside=0.008)
    panel.ax.set_ylabel("rolling moment (N m)")
    panel.legend()


def _rolling_terms(panel: Panel) -> None:
    shown = []
    for (name, label), colour in zip(
        _COUPLING.items(), (style.VERMILLION, style.GREEN, style.ORANGE, style.PURPLE), strict=True
    ):
        values = panel.layer.get(_MOTION, f"rolling_{name}")
        if np.any(values != 0.0):  # a tensor without products has no such moment
            shown.append(values)
            panel.line(values, colour, f"by {label}", 0.9)
    panel.limits(*shown, room=LEGEND)
    panel.ax.set_ylabel("inertia coupling (N m)")
    if shown:
        panel.legend()


@style.styled
def angles_by_method(tree: DataTree) -> Figure:
    """Angle of attack and sideslip by three methods, and their differences; the band is of forces less moments."""
    panels = (_angle("alpha"), _angle_change("alpha"), _angle("beta"), _angle_change("beta"))
    return strips(layer(tree), "angles by three methods", panels, (2.1, 1.9, 2.1, 1.9))


def _angle(name: str) -> Callable[[Panel], None]:
    def draw(panel: Panel) -> None:
        own = np.degrees(panel.layer.get(_ANGLES, name))
        forces, moments = (np.degrees(panel.layer.get(f"combination/{g}", name)) for g in ("forces", "moments"))
        panel.line(moments, style.GREEN, "from moments", 1.2)
        panel.line(forces, style.VERMILLION, "from forces")
        panel.line(own, style.BLUE, "reconstructed")
        panel.limits(own, forces, moments, room=LEGEND)
        panel.ax.set_ylabel({"alpha": "angle of\nattack (°)", "beta": "sideslip (°)"}[name])
        panel.legend()

    return draw


def _angle_change(name: str) -> Callable[[Panel], None]:
    def draw(panel: Panel) -> None:
        parts = {
            "moments": ("recon. − moments", style.GREEN),
            "forces": ("recon. − forces", style.VERMILLION),
            "between": ("forces − moments", style.BLACK),
        }
        shown = []
        if panel.layer.has(_ANGLES, f"{name}_between_sigma"):
            sigma = np.degrees(panel.layer.get(_ANGLES, f"{name}_between_sigma"))
            panel.band(-sigma, sigma, "#DDDDDD", "±1 sigma")
        for key, (label, colour) in parts.items():
            shown.append(np.degrees(panel.layer.get(_ANGLES, f"{name}_{key}")))
            panel.line(shown[-1], colour, label)
        panel.limits(*shown, room=LEGEND)
        panel.ax.set_ylabel({"alpha": "differences in\nattack (°)", "beta": "differences in\nsideslip (°)"}[name])
        panel.legend()

    return draw


@style.styled
def angular_accelerations(tree: DataTree) -> Figure:
    """Angular accelerations about x, y, z with one-sigma bands."""
    shared = layer(tree)
    panels = [_angular(axis) for axis in range(3)]
    return strips(shared, "angular accelerations, body axes", panels, (2.1, 2.1, 2.1), low=shared.start)


def _angular(axis: int) -> Callable[[Panel], None]:
    def draw(panel: Panel) -> None:
        value = np.degrees(panel.layer.get(_MOTION, "angular_acceleration")[:, axis])
        sigma = np.degrees(panel.layer.get(_MOTION, "angular_acceleration_sigma"))
        panel.band(value - sigma, value + sigma, "#BBBBBB", "±1 sigma")
        panel.line(value, style.AXIS_COLOURS[axis], "estimate")
        panel.limits(value, everything=True, room=LEGEND if axis == 0 else 0.0)
        panel.ax.set_ylabel(f"about {'xyz'[axis]} (°/s²)")
        if axis == 0:
            panel.legend()

    return draw
