"""Panels of what the IMU measured: accelerations (thesis figures 3.2, 3.9) and rates (figure 3.3)."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from xarray import DataTree

from edl_filter.report import style, view
from edl_filter.report.decimate import envelope
from edl_filter.types import Array

#: Decelerations below this are noise of every IMU that has flown an entry, m/s².
LEAST_DECELERATION = 1e-3


@style.styled
def axial_deceleration(tree: DataTree, ax: Axes | None = None) -> Axes:
    """Deceleration along the body's x axis on a logarithmic scale.

    The line is the deceleration; samples of the other sign, that is noise before the air is felt and swinging
    or shocks after it, are dots at their size.
    """
    ax, finish = style.alone(tree, ax, "axial deceleration")
    low, high = view.span(tree)
    found = view.imu(tree, "specific_force")
    if found is not None:
        time, force = found
        inside = (time >= low) & (time <= high)
        time, drag = time[inside], -force[inside, 0]
        line = np.where(drag > LEAST_DECELERATION, drag, np.nan)
        ax.semilogy(*envelope(time, line), color=style.BLUE, linewidth=1.1, label="deceleration (−x)")
        other = drag < -LEAST_DECELERATION
        if other.any():
            label = "acceleration (+x)"
            ax.semilogy(time[other], -drag[other], ".", color=style.ORANGE, markersize=2.5, label=label)
        _mark_peak(tree, ax, time, drag)
        _mark_domain(tree, ax)
        top = 10.0 ** np.ceil(np.log10(np.nanmax(np.abs(drag))))
        ax.set_ylim(LEAST_DECELERATION, max(top, 1e2))
        ax.yaxis.set_major_formatter(style.plain_powers)
        ax.legend(loc="lower center", ncols=3, markerscale=3.0)
    ax.set_xlim(low, high)
    ax.set_ylabel("axial deceleration (m/s²)")
    style.mark_events(tree, ax)
    finish()
    return ax


def _mark_peak(tree: DataTree, ax: Axes, time: Array, drag: Array) -> None:
    entry = time <= view.span(tree, "entry")[1]
    if not entry.any():
        return
    peak = int(np.nanargmax(np.where(entry, drag, -np.inf)))
    ax.plot(time[peak], drag[peak], "o", color=style.VERMILLION, markersize=5.0, zorder=4)
    text = f"peak {drag[peak]:.1f} m/s²\n(one sample)\nat {time[peak]:.1f} s"
    ax.annotate(
        text,
        (time[peak], drag[peak]),
        (0, -16),
        textcoords="offset points",
        ha="center",
        va="top",
        fontsize=11.0,
        bbox={"facecolor": "white", "edgecolor": "none", "pad": 1.0},
    )


def _mark_domain(tree: DataTree, ax: Axes) -> None:
    """From where on the air is felt: the deceleration stays above three sigmas of its noise."""
    about = tree["postflight"].attrs if "postflight" in tree.children else {}
    if np.isfinite(about.get("domain_start", np.nan)) and np.isfinite(about.get("threshold", np.nan)):
        start, threshold = float(about["domain_start"]), float(about["threshold"])
        ax.axhline(threshold, color=style.GREEN, linewidth=1.2, linestyle=":")
        ax.axvline(start, color=style.GREEN, linewidth=1.2, linestyle=":", label=f"air felt from {start:.1f} s")


@style.styled
def acceleration(tree: DataTree, ax: Axes | None = None, *, axis: int = 0, phase: str = "flight") -> Axes:
    """Specific force at the centre of mass along body axis x, y or z (0, 1, 2) in one phase of the flight."""
    subject = f"acceleration along {'xyz'[axis]} at the centre of mass"
    return _component(tree, ax, "specific_force", axis, phase, 1.0, f"along {'xyz'[axis]} (m/s²)", subject)


@style.styled
def angular_rate(tree: DataTree, ax: Axes | None = None, *, axis: int = 0, phase: str = "flight") -> Axes:
    """Angular rate about body axis x, y or z (0, 1, 2) in one phase of the flight."""
    subject = f"angular rate about {'xyz'[axis]}"
    return _component(tree, ax, "angular_rate", axis, phase, np.degrees(1.0), f"about {'xyz'[axis]} (°/s)", subject)


def _component(
    tree: DataTree, ax: Axes | None, name: str, axis: int, phase: str, scale: float, label: str, subject: str
) -> Axes:
    ax, finish = style.alone(tree, ax, subject)
    low, high = view.span(tree, phase)
    found = view.imu(tree, name)
    if found is not None:
        time, values = found
        inside = (time >= low) & (time <= high)
        if inside.any():
            shown = scale * values[inside, axis]
            ax.plot(*envelope(time[inside], shown), color=style.AXIS_COLOURS[axis], linewidth=1.0)
            ax.set_ylim(*_range(shown[time[inside] < _shock(tree)]))
    ax.set_xlim(low, high)
    ax.set_ylabel(label)
    style.mark_events(tree, ax)
    finish()
    return ax


def _shock(tree: DataTree) -> float:
    """Time from which shocks of the ground would make all else small."""
    landing = view.event(tree, "landing")
    return np.inf if landing is None else landing - 0.5


def _range(values: Array) -> tuple[float, float]:
    """Range that holds all `values`, with a margin."""
    if not np.isfinite(values).any():
        return -1.0, 1.0
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    margin = 0.08 * (high - low) or 1.0
    return low - margin, high + margin
