"""All figures of one run.

Each panel is a function ``(tree, ax=None) -> Axes`` that draws on the axes it is given, or on a new figure;
each figure here is a function ``(tree) -> Figure`` that puts panels together. `draw_all` writes all of them.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from xarray import DataTree

from edl_filter.report import (
    aerodynamics,
    atmosphere,
    attitude,
    constraints,
    motion,
    oscillation,
    postflight,
    rotation,
    style,
    track,
    trajectory,
    view,
)

DPI = 120


@style.styled
def altitude_velocity(tree: DataTree) -> Figure:
    """Altitude, air-relative velocity and the uncertainty of both."""
    made = style.figure(7.6)
    style.margins(made, top=0.6, left=1.25, right=1.0)
    made.subplots_adjust(hspace=0.12)
    panels = made.subplots(3, 1, sharex=True, height_ratios=(3, 3, 2))
    for panel, ax in zip((trajectory.altitude, trajectory.speed, trajectory.uncertainty), panels, strict=True):
        panel(tree, ax)
    style.dress(tree, [panels[0]], [panels[-1]], "altitude and velocity")
    return made


@style.styled
def axial_deceleration(tree: DataTree) -> Figure:
    """Axial deceleration on a logarithmic scale."""
    return _root(motion.axial_deceleration(tree))


@style.styled
def angular_rates(tree: DataTree) -> Figure:
    """Angular rates about x, y, z."""
    return _components(tree, motion.angular_rate, "angular rates, body axes")


@style.styled
def attitude_quaternion(tree: DataTree) -> Figure:
    """Quaternion to the body, up to the parachute."""
    return _root(attitude.quaternion(tree))


@style.styled
def accelerations(tree: DataTree) -> Figure:
    """Accelerations along x, y, z at the centre of mass."""
    return _components(tree, motion.acceleration, "accelerations at the centre of mass")


@style.styled
def total_angle_of_attack(tree: DataTree) -> Figure:
    """Total angle of attack with its bands, large up to the parachute; instabilities shaded where they are known."""
    made = style.figure(5.4)
    columns = _columns(made, view.phases(tree), 1)
    for phase, (ax,) in columns.items():
        attitude.total_angle_of_attack(tree, ax, phase=phase)
        if phase != "entry":
            ax.set_ylabel("")
        elif "postflight" in tree.children:
            shared = postflight.layer(tree)
            postflight.shade_instabilities(shared, ax)
            # Below the legend: the angle dips to 0 at the foot
            postflight.name_shades(shared, ax, low=ax.get_xlim()[0], height=0.8)
    tops = [axes[0] for axes in columns.values()]
    style.dress(tree, tops, tops, "total angle of attack")
    return made


@style.styled
def ground_track(tree: DataTree) -> Figure:
    """Ground track, and the landing with its ellipses."""
    made = style.figure(8.6)
    style.margins(made, top=0.5, bottom=1.2)
    grid = made.add_gridspec(2, 2, height_ratios=(1.0, 1.35), hspace=0.26, wspace=0.25)
    whole, far, near = (made.add_subplot(cell) for cell in (grid[0, :], grid[1, 0], grid[1, 1]))
    track.ground_track(tree, whole)
    track.landing_ellipse(tree, far)
    track.landing_ellipse(tree, near, near=True)
    handles, labels = far.get_legend_handles_labels()
    made.legend(handles, labels, loc="lower center", ncols=3)
    style.title(tree, whole, "ground track and landing")
    return made


@style.styled
def constraint_innovations(tree: DataTree) -> Figure:
    """Innovations of all constraints in sigmas."""
    return _root(constraints.innovations(tree))


@style.styled
def leave_one_out(tree: DataTree) -> Figure:
    """Each constraint against the prediction from all others, in sigmas."""
    return _root(constraints.left_out(tree))


#: File name → figure, and what the tree must have for it.
FIGURES: dict[str, Callable[[DataTree], Figure]] = {
    "altitude_velocity": altitude_velocity,
    "axial_deceleration": axial_deceleration,
    "accelerations": accelerations,
    "angular_rates": angular_rates,
    "total_angle_of_attack": total_angle_of_attack,
    "ground_track": ground_track,
    "constraint_innovations": constraint_innovations,
    "leave_one_out": leave_one_out,
    "attitude_quaternion": attitude_quaternion,
    "mach_and_knudsen": atmosphere.mach_and_knudsen,
    "atmosphere_profile": atmosphere.atmosphere_profile,
    "database_atmospheres": aerodynamics.database_atmospheres,
    "flight_atmospheres": aerodynamics.flight_atmospheres,
    "force_coefficients": aerodynamics.force_coefficients,
    "moment_coefficients": aerodynamics.moment_coefficients,
    "rolling_moment": rotation.rolling_moment,
    "angles_by_method": rotation.angles_by_method,
    "angular_accelerations": rotation.angular_accelerations,
    "oscillation": oscillation.oscillation,
}
_NEEDS = {
    "attitude_quaternion": ("inertial_from_body",),
    "altitude_velocity": ("altitude", "speed"),
    "total_angle_of_attack": ("alpha_total",),
    "ground_track": ("position", "longitude"),
}
#: The same for the figures of the post-flight layer: ``group:variable``.
_NEEDS_POSTFLIGHT = {
    "mach_and_knudsen": (
        "atmosphere/flight:mach",
        "atmosphere/preflight:mach",
        "atmosphere_differences:mach",
    ),
    "atmosphere_profile": ("atmosphere/flight:density", "atmosphere/preflight:density"),
    "database_atmospheres": ("atmosphere_differences:CN_database",),
    "flight_atmospheres": (
        "coefficients/flight:CN",
        "coefficients/preflight_density:CN",
        "atmosphere_differences:CN_flight",
    ),
    "force_coefficients": (
        "coefficients/flight:CN",
        "coefficients/database:CN_three_sigma",
        "coefficients/database_measured:CN",
        "combination/moments:CN",
    ),
    "moment_coefficients": (
        "coefficients/flight:Cm",
        "coefficients/database:Cm_three_sigma",
        "coefficients/database_measured:Cm",
        "combination/forces:Cm",
    ),
    "rolling_moment": ("coefficients/flight:Cl", "motion:rolling_spin"),
    "angles_by_method": ("angles:alpha_between", "combination/forces:alpha", "combination/moments:alpha"),
    "angular_accelerations": ("motion:angular_acceleration",),
    "oscillation": ("oscillation:growth",),
}


def available(tree: DataTree) -> list[str]:
    """Names of the figures for which the tree has the data."""
    out = []
    for name in FIGURES:
        if name in ("constraint_innovations", "leave_one_out"):
            found = bool(view.constraints(tree))
        elif name in ("axial_deceleration", "accelerations"):
            found = view.imu(tree, "specific_force") is not None
        elif name in _NEEDS_POSTFLIGHT:
            found = postflight.has(tree, *_NEEDS_POSTFLIGHT[name])
        elif name == "angular_rates":
            found = view.imu(tree, "angular_rate") is not None
        else:
            found = all(view.trajectory(tree, need) is not None for need in _NEEDS[name])
        if found:
            out.append(name)
    return out


def draw_all(tree: DataTree, folder: Path) -> list[Path]:
    """Write all figures for which the tree has the data.

    Parameters
    ----------
    tree : DataTree
        A run's results, as `edl_filter.results` makes them.
    folder : Path
        Made where it does not exist.

    Returns
    -------
    list of Path
        PNG files, in the order of `FIGURES`.
    """
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for name in available(tree):
        path = folder / f"{name}.png"
        FIGURES[name](tree).savefig(path, dpi=DPI, pil_kwargs={"compress_level": 1})
        written.append(path)
    return written


def _components(tree: DataTree, panel: Callable[..., Axes], subject: str) -> Figure:
    """Three axes by the flight's phases, each with a range of its own."""
    made = style.figure(7.6)
    columns = _columns(made, view.phases(tree), 3)
    for phase, axes in columns.items():
        for axis, ax in enumerate(axes):
            panel(tree, ax, axis=axis, phase=phase)
            ax.tick_params(labelbottom=axis == 2)
            if phase != "entry":
                ax.set_ylabel("")
    style.dress(tree, [axes[0] for axes in columns.values()], [axes[-1] for axes in columns.values()], subject)
    return made


def _columns(made: Figure, phases: tuple[str, ...], rows: int) -> dict[str, list[Axes]]:
    """One column of axes for each phase, the entry's wider."""
    style.margins(made, top=0.6)
    grid = made.add_gridspec(rows, len(phases), width_ratios=(1.5, 1.0)[: len(phases)], hspace=0.12, wspace=0.18)
    return {p: [made.add_subplot(grid[r, c]) for r in range(rows)] for c, p in enumerate(phases)}


def _root(ax: Axes) -> Figure:
    found = ax.get_figure(root=True)
    assert isinstance(found, Figure)
    return found
