"""Groups of a result that hold estimates: sensor errors, constraints, entry state and nodes."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable

import numpy as np

from edl_filter.imu_model.sensor_errors import SENSOR_STATES
from edl_filter.navigation.filter import Fused
from edl_filter.navigation.layout import UNITS, Layout
from edl_filter.navigation.leave_one_out import ConstraintCheck
from edl_filter.navigation.smoother import Smoothed
from edl_filter.pipeline.entry_state import EntryCorrection
from edl_filter.pipeline.reconstruct import Reconstruction
from edl_filter.results.groups import Group, Groups
from edl_filter.telemetry.calibration import MisalignmentEstimate
from edl_filter.types import AXES, QUATERNION, Array


def add_sensor_errors(groups: Groups, reconstruction: Reconstruction) -> None:
    """Add ``/sensor_errors/<unit>``: estimate, sigma and prior sigma of every error state, body axes.

    The errors are constant while a unit drives; the smoothed estimate at its last epoch is written.
    """
    layout, smoothed = reconstruction.filter_pass.layout, reconstruction.smoothed
    driving = reconstruction.telemetry.driving
    for k, (unit, prior) in enumerate(zip(driving.units, driving.errors, strict=True)):
        nodes = np.flatnonzero(smoothed.unit == k)
        if not len(nodes):
            continue
        estimate = smoothed.states[nodes[-1]].errors
        sigma = np.sqrt(np.diag(smoothed.covariance[nodes[-1]]))
        group = Group(attrs={"unit": unit})
        group.label("axis", AXES, "body axis")
        for name in (n for n in SENSOR_STATES if n in layout and getattr(prior, n) > 0.0):
            where, meaning = layout[name], name.replace("_", " ")
            group.add(name, ("axis",), estimate[where], UNITS[name], meaning)
            group.add(f"{name}_sigma", ("axis",), sigma[where], UNITS[name], f"one sigma of the {meaning}")
            group.add(
                f"{name}_prior_sigma", (), getattr(prior, name), UNITS[name],
                f"one sigma of the {meaning} before the flight, each axis",
            )  # fmt: skip
        groups[f"/sensor_errors/{unit}"] = group


def add_constraints(groups: Groups, checks: Iterable[ConstraintCheck], fused: Iterable[Fused]) -> None:
    """Add ``/constraints/<name>``: innovations of the forward pass, and leave-one-out predictions."""
    by_name: dict[str, list[Fused]] = defaultdict(list)
    for f in fused:
        by_name[f.constraint.name].append(f)
    for s in checks:
        group = Group(
            attrs={
                "source": s.source,
                "dof": s.dof,
                "nis_total": float(np.sum(s.nis)),
                "nis_interval_99_9": np.array(s.nis_interval()),
                "consistent": int(s.consistent or not s.dof),
                "left_out_nis": s.left_out_nis,
                "left_out_dof": s.left_out_dof,
                "left_out_nis_interval_99_9": np.array(s.left_out_nis_interval()),
                "left_out_information_nats": s.left_out_information,
            }
        )
        both = ("time", "component")
        group.add("time", ("time",), s.time, "s", "time since the epoch")
        group.label("component", s.components, "component with its unit")
        unit = "as its component"
        group.add("innovation", both, s.innovation, unit, "measured minus predicted, forward pass")
        group.add("innovation_sigma", both, s.innovation_sigma, unit, "one sigma of the innovation")
        group.add("nis", ("time",), s.nis, "1", "normalised innovation squared")
        group.add("accepted", ("time",), s.accepted, "1", "1 where it was used, 0 where it failed the gate")
        group.add("information", ("time",), s.information, "1", "information gain over all measurements before, nats")
        group.add("left_out", ("component",), s.left_out, unit, "measured minus predicted from all others")
        group.add("left_out_sigma", ("component",), s.left_out_sigma, unit, "one sigma of left_out")
        group.label("component_2", s.components, "component with its unit")
        square = ("component", "component_2")
        group.add("left_out_covariance", square, s.left_out_covariance, unit, "covariance of left_out")
        if by_name[s.name]:
            measured = [f.constraint.measured for f in by_name[s.name]]
            noise = [f.constraint.noise for f in by_name[s.name]]
            group.add("measured", both, measured, unit, "measurement")
            group.add("noise", (*both, "component_2"), noise, unit, "covariance of the measurement")
        groups[f"/constraints/{s.name}"] = group


def add_entry(groups: Groups, entry: EntryCorrection, rotation_j2000: Array | None) -> None:
    """Add ``/entry``: the correction of the entry state, and the rotation of its frame that is nearest to it.

    Parameters
    ----------
    groups : Groups
        To which the group is added.
    entry : EntryCorrection
        Of the reconstruction.
    rotation_j2000 : (3,) array or None
        The rotation in J2000, rad; None where the mission does not state that frame.
    """
    group = Group()
    group.label("axis", AXES, "inertial axis (body axis in the attitude's change)")
    for k, (name, unit) in enumerate((("position", "m"), ("velocity", "m/s"), ("attitude", "rad"))):
        part = slice(3 * k, 3 * k + 3)
        axes = "body axes" if name == "attitude" else "inertial axes"
        group.add(f"{name}_change", ("axis",), entry.change[part], unit, f"smoothed minus stated, {axes}")
        group.add(f"{name}_sigma", ("axis",), entry.change_sigma[part], unit, f"one sigma of the change, {axes}")
    group.add(
        "rotation", ("axis",), entry.rotation, "rad",
        "rotation of the state's frame nearest to the change, inertial axes",
    )  # fmt: skip
    if rotation_j2000 is not None:
        group.add("rotation_j2000", ("axis",), rotation_j2000, "rad", "the same rotation in J2000")
    remainder = "change minus that of the rotation, inertial axes"
    group.add("position_left", ("axis",), entry.rotation_remainder[:3], "m", remainder)
    group.add("velocity_left", ("axis",), entry.rotation_remainder[3:], "m/s", remainder)
    for name, (estimate, sigma) in entry.states.items():
        dims = ("axis",) if len(estimate) == 3 else (f"{name}_part",)
        meaning = name.replace("_", " ")
        group.add(name, dims, estimate, UNITS[name], f"estimated error: {meaning}")
        group.add(f"{name}_state_sigma", dims, sigma, UNITS[name], f"one sigma of the {meaning}")
    groups["/entry"] = group


def add_nodes(groups: Groups, layout: Layout, smoothed: Smoothed) -> None:
    """Add ``/nodes``: every smoothed state with its sigma. Where the driving unit changes there are two states."""
    group = Group()
    group.add("time", ("node",), smoothed.time, "s", "time since the epoch")
    group.add("unit", ("node",), smoothed.unit.astype(np.int8), "1", "instrument that drives from here on")
    group.label("axis", AXES, "axis")
    group.label("quaternion", QUATERNION, "part of a quaternion, scalar last")
    nav = np.array([s.nav for s in smoothed.states])
    errors = np.array([s.errors for s in smoothed.states])
    sigma = np.sqrt(np.diagonal(smoothed.covariance, axis1=1, axis2=2))
    group.add("position", ("node", "axis"), nav[:, :3], "m", "position, inertial axes")
    group.add("velocity", ("node", "axis"), nav[:, 3:6], "m/s", "velocity, inertial axes")
    turn = ("node", "quaternion")
    group.add("inertial_from_body", turn, nav[:, 6:10], "1", "attitude, body to inertial")
    if nav.shape[1] == 14:
        group.add("onboard_attitude", turn, nav[:, 10:], "1", "attitude computed on board, body to inertial")
    for name, where in layout.slices.items():
        width = where.stop - where.start
        dims = ("node", "axis") if width == 3 else ("node", f"{name}_part")
        meaning = name.replace("_", " ")
        if name not in ("attitude", *group.variables):
            group.add(name, dims, errors[:, where], UNITS[name], f"estimated error: {meaning}")
        group.add(f"{name}_sigma", dims, sigma[:, where], UNITS[name], f"one sigma of the {meaning}")
    groups["/nodes"] = group


def add_comparison(groups: Groups, comparison: dict[str, MisalignmentEstimate]) -> None:
    """Add ``/comparison/<name>``: each checking IMU against the driving one, by window and over all windows."""
    for name, estimate in comparison.items():
        fits = (*estimate.windows, estimate.all)
        group = Group(attrs={"reference": "driving", "other": name})
        spans = [f"{fit.start:g} to {fit.end:g} s" for fit in estimate.windows]
        group.label("window", [*spans, "all"], "window of the fit, s since the epoch")
        group.label("lateral", ("y", "z"), "body axis")
        both = ("window", "lateral")
        group.add("start", ("window",), [f.start for f in fits], "s", "begin of the window")
        group.add("end", ("window",), [f.end for f in fits], "s", "end of the window")
        group.add("samples", ("window",), [f.samples for f in fits], "1", "number of common samples")
        for field, unit, meaning in (
            ("slope", "rad", "lateral difference per axial force: misalignment"),
            ("slope_sigma", "rad", "one sigma of the slope"),
            ("offset", "m/s^2", "lateral difference without axial force: difference of the biases"),
            ("offset_sigma", "m/s^2", "one sigma of the offset"),
            ("residual_rms", "m/s^2", "root mean square of the residuals of the fit"),
        ):
            group.add(field, both, [getattr(f, field) for f in fits], unit, meaning)
        groups[f"/comparison/{name}"] = group
