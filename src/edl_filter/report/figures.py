"""All figures of one run: the file name of each, its description, and what a result must have for it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from edl_filter.report import atmosphere, attitude, coefficients, constraints, motion, rotation, track, trajectory
from edl_filter.report.description import Figure
from edl_filter.results.groups import Group
from edl_filter.results.reader import ResultReader

if TYPE_CHECKING:
    from xarray import DataTree


@dataclass(frozen=True)
class RunFigure:
    """A figure of a run.

    Attributes
    ----------
    describe : callable
        Function that returns the description from the result.
    needs : tuple of str
        Variables ``"group:variable"`` without which there is no such figure.
    """

    describe: Callable[[ResultReader], Figure]
    needs: tuple[str, ...]


def _postflight(*needs: str) -> tuple[str, ...]:
    return tuple(f"postflight/{need}" for need in needs)


#: File name → figure.
FIGURES: dict[str, RunFigure] = {
    "altitude_velocity": RunFigure(trajectory.altitude_velocity, ("trajectory:altitude", "trajectory:speed")),
    "axial_deceleration": RunFigure(motion.deceleration_figure, ("imu:specific_force",)),
    "accelerations": RunFigure(motion.accelerations, ("imu:specific_force",)),
    "angular_rates": RunFigure(motion.angular_rates, ("imu:angular_rate",)),
    "total_angle_of_attack": RunFigure(attitude.angle_of_attack_figure, ("trajectory:alpha_total",)),
    "ground_track": RunFigure(track.track_figure, ("trajectory:position", "trajectory:longitude")),
    "constraint_innovations": RunFigure(constraints.innovations_figure, ("constraints",)),
    "leave_one_out": RunFigure(constraints.left_out_figure, ("constraints",)),
    "attitude_quaternion": RunFigure(attitude.quaternion_figure, ("trajectory:inertial_from_body",)),
    "mach_and_knudsen": RunFigure(
        atmosphere.mach_and_knudsen,
        _postflight("atmosphere/flight:mach", "atmosphere/preflight:mach", "atmosphere_differences:mach"),
    ),
    "atmosphere_profile": RunFigure(
        atmosphere.atmosphere_profile, _postflight("atmosphere/flight:density", "atmosphere/preflight:density")
    ),
    "database_atmospheres": RunFigure(
        coefficients.database_atmospheres, _postflight("atmosphere_differences:CN_database")
    ),
    "flight_atmospheres": RunFigure(
        coefficients.flight_atmospheres,
        _postflight(
            "coefficients/flight:CN", "coefficients/preflight_density:CN", "atmosphere_differences:CN_flight"
        ),
    ),
    "force_coefficients": RunFigure(
        coefficients.force_coefficients,
        _postflight(
            "coefficients/flight:CN", "coefficients/database:CN_three_sigma", "coefficients/database_measured:CN",
            "combination/moments:CN",
        ),
    ),
    "moment_coefficients": RunFigure(
        coefficients.moment_coefficients,
        _postflight(
            "coefficients/flight:Cm", "coefficients/database:Cm_three_sigma", "coefficients/database_measured:Cm",
            "combination/forces:Cm",
        ),
    ),
    "rolling_moment": RunFigure(rotation.rolling_moment, _postflight("coefficients/flight:Cl", "motion:rolling_spin")),
    "angles_by_method": RunFigure(
        rotation.angles_by_method,
        _postflight("angles:alpha_between", "combination/forces:alpha", "combination/moments:alpha"),
    ),
    "angular_accelerations": RunFigure(rotation.angular_accelerations, _postflight("motion:angular_acceleration")),
    "oscillation": RunFigure(rotation.oscillation, _postflight("oscillation:growth")),
}  # fmt: skip


def available(reader: ResultReader) -> list[str]:
    """Names of the figures for which the result has the variables."""
    return [name for name, figure in FIGURES.items() if all(_has(reader, need) for need in figure.needs)]


def _has(reader: ResultReader, need: str) -> bool:
    if need == "constraints":
        return bool(reader.constraints)
    if need == "imu:specific_force":
        return reader.imu("specific_force") is not None
    if need == "imu:angular_rate":
        return reader.imu("angular_rate") is not None
    return reader.has(need)


def draw_all(
    result: ResultReader | DataTree | Mapping[str, Group], folder: Path, formats: Sequence[str] = ("png",)
) -> list[Path]:
    """Write all figures for which a result has the variables.

    Parameters
    ----------
    result : ResultReader, DataTree or mapping of Group
        Contents of ``result.nc``.
    folder : Path
        Created if it does not exist.
    formats : sequence of str
        Of `results.files.FIGURE_FORMATS`.

    Returns
    -------
    list of Path
        In the order of `FIGURES`, each in all formats.
    """
    reader = ResultReader.of(result)
    return [path for name in available(reader) for path in draw_figure(reader, name, folder, formats)]


def draw_figure(reader: ResultReader, name: str, folder: Path, formats: Sequence[str] = ("png",)) -> list[Path]:
    """Write one figure of `FIGURES` in all formats.

    Parameters
    ----------
    reader : ResultReader
        The result.
    name : str
        Of `available`.
    folder : Path
        Created if it does not exist.
    formats : sequence of str
        Of `results.files.FIGURE_FORMATS`.
    """
    from edl_filter.report.matplotlib_renderer import draw, write_canvas  # imported on use: names need no matplotlib

    canvas = draw(FIGURES[name].describe(reader))
    return [write_canvas(canvas, folder / f"{name}.{kind}") for kind in formats]
