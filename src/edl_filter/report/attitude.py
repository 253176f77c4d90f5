"""Panel of the total angle of attack with its uncertainty (thesis figure 3.13)."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from xarray import DataTree

from edl_filter.report import style, view
from edl_filter.report.envelope import envelope


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


def _end_of_flying(tree: DataTree) -> float:
    """Time from which the angle has lost its meaning."""
    known = [view.event(tree, n) for n in ("retro_rocket_fire", "bridle_cut")]
    landing = view.event(tree, "landing")
    known.append(None if landing is None else landing - 0.5)
    return min((t for t in known if t is not None), default=np.inf)
