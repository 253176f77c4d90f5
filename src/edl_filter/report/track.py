"""Panels of the ground track and of the landing with its uncertainty."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Ellipse
from xarray import DataTree

from edl_filter.report import style, view
from edl_filter.report.landing_ellipse import Landing, Local, about, fixed_track, landing
from edl_filter.types import Array

SIGMAS = 3.0
#: Points of a track on a map.
POINTS = 1500
#: Marks of time closer to the one before than this part of the track have no label.
APART = 0.05


@style.styled
def ground_track(tree: DataTree, ax: Axes | None = None) -> Axes:
    """Draw the track over the ground to the landing, with a mark every 30 s, in km from the site."""
    own = ax is None
    ax = _axes(ax)
    found = landing(tree)
    here = _map(found)
    track, time = here.offset(fixed_track(tree)) / 1e3, view.time(tree)
    low, high = view.span(tree)
    inside = np.flatnonzero((time >= low) & (time <= high))
    thin = inside[:: max(1, len(inside) // POINTS)]
    ax.plot(*track[thin].T, color=style.BLUE, label="ground track")
    length = float(np.hypot(*np.ptp(track[inside], axis=0)))
    last = np.full(2, np.inf)
    for t in np.arange(30.0 * np.ceil(low / 30.0), high, 30.0):
        at = np.array([np.interp(t, time, track[:, i]) for i in (0, 1)])
        if np.hypot(*(at - last)) < APART * length or np.hypot(*at) < APART * length:
            continue
        last = at
        ax.plot(*at, "o", color=style.BLUE, markersize=4.0)
        ax.annotate(f"{t:.0f} s", (at[0], at[1]), (0, 6), textcoords="offset points", ha="center", fontsize=10.0)
    _site(ax, found)
    ax.set_aspect("equal", adjustable="datalim")
    ax.margins(0.06, 0.25)
    _label(ax, found)
    if own:
        style.title(tree, ax, "ground track")
    return ax


@style.styled
def landing_ellipse(tree: DataTree, ax: Axes | None = None, *, near: bool = False) -> Axes:
    """Landing place as estimated, as predicted without the landing constraint, and as measured.

    Ellipses of 3 sigma hold 98.9 % in two dimensions.

    Parameters
    ----------
    tree : DataTree
    ax : Axes, optional
    near : bool
        Show the estimate and the site alone at full size.

    Returns
    -------
    Axes
    """
    own = ax is None
    ax = _axes(ax)
    found = landing(tree)
    here = _map(found)
    corners = [np.zeros((1, 2))]
    if found.predicted is not None:
        drawn = _estimate(
            ax, here, found.predicted, found.predicted_covariance, style.ORANGE, "without landing constraint"
        )
        corners += [] if near else drawn
    corners += _estimate(ax, here, found.position, found.covariance, style.BLUE, "estimate")
    if near:
        for patch in ax.patches[:-1]:
            patch.set_facecolor("none")
    _site(ax, found)
    time = view.time(tree)
    shown = (time >= view.span(tree)[0]) & (time <= found.time)
    track = here.offset(fixed_track(tree)[shown]) / 1e3
    ax.plot(*track.T, color=style.GREY, linewidth=1.2, label="ground track", zorder=2)
    parachute = view.event(tree, "parachute_deploy")
    if parachute is not None and parachute < found.time:
        k = int(np.searchsorted(time[shown], parachute))
        ax.plot(*track[k], "D", color="black", markersize=6.0, label="parachute opens", zorder=4)
    points = np.concatenate(corners)
    centre = 0.5 * (points.min(axis=0) + points.max(axis=0))
    half = max(1.15 * 0.5 * float(np.ptp(points, axis=0).max()), 1e-3)
    ax.set_xlim(centre[0] - half, centre[0] + half)
    ax.set_ylim(centre[1] - half, centre[1] + half)
    ax.set_aspect("equal", adjustable="box")
    _label(ax, found)
    if own:
        ax.legend(loc="best")
        style.title(tree, ax, "landing")
    return ax


def _axes(ax: Axes | None) -> Axes:
    if ax is not None:
        return ax
    made = style.figure(7.0)
    style.margins(made, top=0.6)
    return made.add_subplot()


def _map(found: Landing) -> Local:
    """Map about the site, about the estimated landing where no site is known."""
    return about(found.position if found.site is None else found.site)


def _site(ax: Axes, found: Landing) -> None:
    if found.site is not None:
        ax.plot(0.0, 0.0, "*", color=style.VERMILLION, markersize=13.0, zorder=5, label="landing site")


def _estimate(ax: Axes, here: Local, position: Array, covariance: Array | None, colour: str, label: str) -> list[Array]:
    """Draw one estimate with its ellipse; gives the corners of what it takes up, km."""
    centre = here.offset(position) / 1e3
    ax.plot(*centre, "o", color=colour, markersize=6.0, zorder=4)
    if covariance is None or not np.isfinite(covariance).all():
        ax.plot([], [], "o", color=colour, label=label)
        return [centre[None]]
    spread = here.spread(covariance) / 1e6
    values, vectors = np.linalg.eigh(spread)
    size = 2.0 * SIGMAS * np.sqrt(values)
    tilt = float(np.degrees(np.arctan2(vectors[1, 1], vectors[0, 1])))
    patch = Ellipse((float(centre[0]), float(centre[1])), size[1], size[0], angle=tilt)
    patch.set(facecolor=colour + "22", edgecolor=colour, linewidth=1.6, zorder=3)
    patch.set_label(f"{label}, {SIGMAS:.0f} sigma")
    ax.add_patch(patch)
    half = SIGMAS * np.sqrt(np.diag(spread))
    return [centre + np.array([[-1.0], [1.0]]) * half]


def _label(ax: Axes, found: Landing) -> None:
    origin = "the estimated landing" if found.site is None else "the site"
    ax.set_xlabel(f"east of {origin} (km)")
    ax.set_ylabel("north (km)")
