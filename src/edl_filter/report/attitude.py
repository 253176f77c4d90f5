"""Panels of the attitude: total angle of attack (thesis figure 3.13) and quaternion (figures 18.1 to 18.3)."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from xarray import DataTree

from edl_filter import rotations
from edl_filter.report import style, view
from edl_filter.report.decimate import envelope


@style.styled
def total_angle_of_attack(tree: DataTree, ax: Axes | None = None, *, phase: str = "entry") -> Axes:
    """Angle of the x axis from the air-relative velocity, with bands of one and three sigma.

    The bands end at 0 and 180 degrees, as the angle does. The range is that of the flight under the parachute:
    from the retro-rockets on the lander is slow and tumbles, and the angle says nothing of the air.
    """
    ax, finish = style.alone(tree, ax, "total angle of attack")
    low, high = view.span(tree, phase)
    time = view.time(tree)
    inside = (time >= low) & (time <= high)
    angle, sigma = view.trajectory(tree, "alpha_total"), view.trajectory(tree, "alpha_total_sigma")
    if angle is not None and inside.any():
        shown = np.degrees(angle[inside])
        flying = time[inside] <= max(_end_of_flying(tree), time[inside][0])
        if sigma is not None:
            spread = np.degrees(sigma[inside])
            for count, shade in ((3.0, "#CFE6F5"), (1.0, style.SKY)):
                least = envelope(time[inside], np.clip(shown - count * spread, 0.0, 180.0))
                most = envelope(time[inside], np.clip(shown + count * spread, 0.0, 180.0))
                ends = np.union1d(least[0], most[0])
                ax.fill_between(
                    ends,
                    np.interp(ends, *least),
                    np.interp(ends, *most),
                    color=shade,
                    linewidth=0.0,
                    label=f"±{count:.0f} sigma",
                )
            # Single peaks of the band may leave the panel, those of the angle may not
            upper = (shown + 3.0 * spread)[flying]
            top = max(np.nanmax(shown[flying]), np.nanquantile(upper, 0.99))
        else:
            top = np.nanmax(shown[flying])
        ax.plot(*envelope(time[inside], shown), color=style.BLUE, linewidth=0.9, label="estimate")
        ax.set_ylim(0.0, min((1.22 if phase == "entry" else 1.08) * top, 180.0))
        if phase == "entry":
            ax.legend(loc="upper left", ncols=3)
    ax.set_xlim(low, high)
    ax.set_ylabel("total angle of attack (°)")
    style.mark_events(tree, ax)
    finish()
    return ax


@style.styled
def quaternion(tree: DataTree, ax: Axes | None = None) -> Axes:
    """Elements of the quaternion from J2000, or from inertial axes where J2000 is not known, to the body."""
    matrix = tree.attrs.get("j2000_from_inertial")
    frame = "inertial" if matrix is None else "J2000"
    ax, finish = style.alone(tree, ax, f"{frame} to body quaternion")
    attitude, time = view.trajectory(tree, "inertial_from_body"), view.time(tree)
    low, high = view.span(tree, "entry")
    inside = (time >= low) & (time <= high)
    if attitude is not None and inside.any():
        q = attitude[inside]
        if matrix is not None:
            q = rotations.multiply(rotations.from_matrix(np.reshape(matrix, (3, 3))), q)
        q = rotations.conjugate(q)
        flip = np.cumprod(np.where(np.sum(q[1:] * q[:-1], axis=1) < 0.0, -1.0, 1.0))
        q = q * np.concatenate(([1.0], flip))[:, None]
        colours = (*style.AXIS_COLOURS, style.ORANGE)
        for k, colour in enumerate(colours):
            ax.plot(*envelope(time[inside], q[:, k]), color=colour, linewidth=0.9, label=f"q{k + 1}")
        ax.legend(loc="lower left", ncols=4)
    ax.set_xlim(low, high)
    ax.set_ylim(-1.25, 1.05)
    ax.set_ylabel("quaternion element, scalar last (–)")
    style.mark_events(tree, ax)
    finish()
    return ax


def _end_of_flying(tree: DataTree) -> float:
    """Time from which the angle has lost its meaning."""
    known = [view.event(tree, n) for n in ("retro_rocket_fire", "bridle_cut")]
    landing = view.event(tree, "landing")
    known.append(None if landing is None else landing - 0.5)
    return min((t for t in known if t is not None), default=np.inf)
