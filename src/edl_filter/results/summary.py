"""Main results as plain data: the contents of ``summary.json`` (schema in `edl_filter.results.schema`)."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np

from edl_filter._version import __version__
from edl_filter.effects.base import EffectInstance
from edl_filter.mission import Mission
from edl_filter.mission.measurements import MerImuConfig
from edl_filter.navigation.leave_one_out import ConstraintCheck
from edl_filter.navigation.recovery import Recovery
from edl_filter.pipeline.entry_state import in_j2000
from edl_filter.pipeline.reconstruct import Reconstruction
from edl_filter.pipeline.trust import Trust
from edl_filter.planet.gas import Gas
from edl_filter.postflight.flight import DerivedQuantities
from edl_filter.results import postflight
from edl_filter.results.landing import from_site, landing
from edl_filter.telemetry.calibration import Misalignment, MisalignmentEstimate
from edl_filter.telemetry.record import SampleFinding
from edl_filter.telemetry.relative_calibration import RelativeCalibration


@dataclass(frozen=True)
class RefitSummary:
    """Result of the refit of a mission's effects, and of the comparison of model and measurement.

    Attributes
    ----------
    sigma : dict
        Effect → parameter → one sigma of its estimate; empty where nothing was refitted.
    residuals : dict
        Channel → ``overall`` and every regime → normalised RMS; empty where nothing was compared.
    """

    sigma: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    residuals: Mapping[str, Mapping[str, float]] = field(default_factory=dict)


def summary(
    reconstruction: Reconstruction, derived: DerivedQuantities, refit: RefitSummary, trust: Trust
) -> dict[str, Any]:
    """Main results (design section 7): plain numbers, lists and dicts; numbers may be infinite or NaN.

    `edl_filter.results.schema.Summary` has all keys with their units.
    """
    events = {
        name: _stated(asdict(event)) | from_site(reconstruction, event.time_s) for name, event in derived.events.items()
    }
    return {
        "trustworthy": trust.trustworthy,
        "headline": trust.headline,
        "causes": [asdict(cause) for cause in trust.causes],
        "recovery": None if reconstruction.recovery is None else recovery(reconstruction.recovery),
        "mission": reconstruction.mission.name,
        "title": reconstruction.mission.title,
        "edl_filter_version": __version__,
        "epoch_utc": reconstruction.telemetry.epoch_utc,
        "filter": asdict(reconstruction.problem.settings),
        "gas": gas_content(reconstruction.atmosphere.gas),
        "events": events,
        "landing": landing(reconstruction),
        "constraints": {s.name: constraint(s) for s in reconstruction.constraint_checks},
        "entry_state": entry_state(reconstruction),
        "imu_comparison": {name: comparison(fit) for name, fit in reconstruction.comparison.items()},
        "imu_calibration": {
            name: calibration(fit) | _stated_sigmas(reconstruction.mission)
            for name, fit in reconstruction.calibrations.items()
        },
        "pre_entry_bias_m_s2": _bias(reconstruction),
        "residuals": dict(refit.residuals),
        "innovation_rms": innovation_rms(reconstruction.constraint_checks),
        "postflight": None if derived.postflight is None else postflight.summary(derived.postflight),
        "effects": effects_content(reconstruction, refit.sigma),
        "sample_findings": [finding_content(f) for f in reconstruction.telemetry.findings],
        "notes": list(reconstruction.telemetry.notes),
        "timing_s": dict(reconstruction.timing),
    }


def effects_content(reconstruction: Reconstruction, sigma: Mapping[str, Mapping[str, float]]) -> dict[str, Any]:
    """Effects of a reconstruction by label.

    Parameters
    ----------
    reconstruction : Reconstruction
        With the effects at their estimates.
    sigma : mapping
        Label of the effect → parameter → one sigma, of parameters that were refitted.

    Returns
    -------
    dict
        Label → ``imu``, ``fixed``, and ``parameters``: name → ``estimate``, ``sigma`` (None where it was not refitted),
        ``unit``, ``start`` (the value that the mission states). From the second effect of
        a label on, the label has a number.
    """
    stated = {a.key: a.values for a in reconstruction.mission.active_effects()}
    content: dict[str, Any] = {}
    for label, a in _by_label(reconstruction.effects):
        start, sigmas = stated.get(a.key, {}), sigma.get(a.label, {})
        parameters = {
            q.name: {
                "estimate": a.values[q.name], "sigma": sigmas.get(q.name), "unit": q.unit, "start": start.get(q.name),
            }
            for q in a.effect.parameters
        }  # fmt: skip
        content[label] = {"imu": a.imu, "fixed": a.fixed, "parameters": parameters}
    return content


def effects_at_estimates(mission: Mission, content: Mapping[str, Any]) -> tuple[EffectInstance, ...]:
    """A mission's effects at the estimates of `effects_content`."""
    instances: list[EffectInstance] = []
    for label, a in _by_label(mission.active_effects()):
        parameters = content.get(label, {}).get("parameters", {})
        estimates = {q: v["estimate"] for q, v in parameters.items() if v["estimate"] is not None}
        instances.append(replace(a, values=a.values | estimates))
    return tuple(instances)


def _by_label(instances: Iterable[EffectInstance]) -> list[tuple[str, EffectInstance]]:
    """Each instance with its label in a file."""
    counts: Counter[str] = Counter()
    labelled: list[tuple[str, EffectInstance]] = []
    for a in instances:
        counts[a.label] += 1
        labelled.append((a.label if counts[a.label] == 1 else f"{a.label} ({counts[a.label]})", a))
    return labelled


def finding_content(finding: SampleFinding) -> dict[str, Any]:
    """Missing or bad samples of one IMU, and what was done about them."""
    return {
        "imu": finding.imu,
        "channel": finding.channel,
        "start_s": finding.start,
        "end_s": finding.end,
        "samples": finding.samples,
        "kind": finding.kind,
        "repair": finding.repair,
    }


def recovery(r: Recovery) -> dict[str, Any]:
    """The contradiction of state and measurements, and what was added to the model since."""
    return {
        "time_s": r.divergence.time,
        "constraints": list(r.divergence.names),
        "readings": r.divergence.readings,
        "nis": r.divergence.nis,
        "free_nis": r.divergence.free_nis,
        "directions": r.divergence.directions,
        "cause": r.cause,
        "size": r.size if r.recovered else None,
        "force_noise_m_s2": r.force_noise,
        "rate_noise_rad_s": r.rate_noise,
        "start_s": r.start,
        "end_s": r.end,
        "gain_nats": r.gain,
    }


def gas_content(gas: Gas) -> dict[str, Any]:
    """The gas in which Mach numbers, Knudsen numbers and temperatures are meant."""
    cold, warm = gas.heat_capacity_ratio([200.0, 300.0])
    return {
        "name": gas.name,
        "constant": gas.constant,
        "heat_capacity_ratio_200_k": float(cold),
        "heat_capacity_ratio_300_k": float(warm),
        "description": gas.description,
    }


def _bias(reconstruction: Reconstruction) -> dict[str, Any] | None:
    """Accelerometer bias, body axes: slope of the velocity before entry (thesis), and the filter's estimate."""
    if reconstruction.pre_entry_bias is None:
        return None
    slope, sigma = reconstruction.pre_entry_bias
    layout, smoothed = reconstruction.filter_pass.layout, reconstruction.smoothed
    bias: dict[str, Any] = {"slope": slope.tolist(), "slope_sigma": sigma.tolist()}
    if "accelerometer_bias" in layout:
        where = layout["accelerometer_bias"]
        bias["filter"] = smoothed.states[0].errors[where].tolist()
        bias["filter_sigma"] = np.sqrt(np.diag(smoothed.covariance[0])[where]).tolist()
    return bias


def _stated(event: dict[str, Any]) -> dict[str, Any]:
    """The fields of an event that have a value, without its name."""
    return {key: value for key, value in event.items() if value is not None and key != "name"}


def constraint(s: ConstraintCheck) -> dict[str, Any]:
    """One constraint; of several uses mean innovation, root mean square of the sigmas, sum of the NIS.

    ``accepted`` is whether every use passed the gate; without degrees of freedom (``dof`` 0) there is neither an
    interval nor a judgement of consistency.
    """
    return {
        "source": s.source,
        "components": list(s.components),
        "uses": len(s.time),
        "accepted_uses": int(np.sum(s.accepted)),
        "accepted": bool(np.all(s.accepted)),
        "time_s": float(s.time[0]),
        "innovation": s.innovation.mean(axis=0).tolist(),
        "innovation_sigma": np.sqrt(np.mean(s.innovation_sigma**2, axis=0)).tolist(),
        "nis": float(np.sum(s.nis)),
        "dof": s.dof,
        "nis_interval_99_9": list(s.nis_interval()) if s.dof else None,
        "consistent": s.consistent if s.dof else None,
        "left_out": s.left_out.tolist(),
        "left_out_sigma": s.left_out_sigma.tolist(),
        "left_out_nis": s.left_out_nis,
        "left_out_dof": s.left_out_dof,
        "information_nats": float(np.sum(s.information)),
        "left_out_information_nats": s.left_out_information,
    }


def entry_state(reconstruction: Reconstruction) -> dict[str, Any]:
    """Correction of the entry state, and the rotation of its frame that is nearest to it."""
    entry = reconstruction.entry
    j2000 = in_j2000(reconstruction.mission, entry.rotation)
    names = {"entry_epoch": "s", "entry_frame": "rad", "onboard_attitude": "rad"}
    return {
        "position_change_m": entry.change[:3].tolist(),
        "position_sigma_m": entry.change_sigma[:3].tolist(),
        "velocity_change_m_s": entry.change[3:6].tolist(),
        "velocity_sigma_m_s": entry.change_sigma[3:6].tolist(),
        "attitude_change_deg": np.rad2deg(entry.change[6:]).tolist(),
        "attitude_sigma_deg": np.rad2deg(entry.change_sigma[6:]).tolist(),
        "rotation_deg": float(np.rad2deg(np.linalg.norm(entry.rotation))),
        "rotation_inertial_deg": np.rad2deg(entry.rotation).tolist(),
        "rotation_j2000_deg": None if j2000 is None else np.rad2deg(j2000).tolist(),
        "rotation_leaves_m": entry.rotation_remainder[:3].tolist(),
        "rotation_leaves_m_s": entry.rotation_remainder[3:].tolist(),
        "states": {
            name: {"estimate": estimate.tolist(), "sigma": sigma.tolist(), "unit": names.get(name, "")}
            for name, (estimate, sigma) in entry.states.items()
        },
    }


def comparison(estimate: MisalignmentEstimate) -> dict[str, Any]:
    """Misalignment and bias difference of a checking IMU along y and z: over all windows, and in each."""
    return {"all": _fit(estimate.all), "windows": [_fit(fit) for fit in estimate.windows]}


def calibration(estimate: RelativeCalibration) -> dict[str, Any]:
    """Lever arm, alignment, biases and clock of a checking IMU against the driving one."""
    return {
        "start_s": estimate.start,
        "end_s": estimate.end,
        "samples": estimate.samples,
        "stated_lever_arm_m": estimate.stated_lever_arm.tolist(),
        "lever_arm_m": estimate.lever_arm.tolist(),
        "lever_arm_sigma_m": estimate.lever_arm_sigma.tolist(),
        "rate_alignment_deg": np.rad2deg(estimate.rate_alignment).tolist(),
        "rate_alignment_sigma_deg": np.rad2deg(estimate.rate_alignment_sigma).tolist(),
        "force_alignment_deg": np.rad2deg(estimate.force_alignment).tolist(),
        "force_alignment_sigma_deg": np.rad2deg(estimate.force_alignment_sigma).tolist(),
        "axial_scale": estimate.axial_scale,
        "axial_scale_sigma": estimate.axial_scale_sigma,
        "force_bias_m_s2": estimate.force_bias.tolist(),
        "force_bias_sigma_m_s2": estimate.force_bias_sigma.tolist(),
        "rate_bias_rad_s": estimate.rate_bias.tolist(),
        "rate_bias_sigma_rad_s": estimate.rate_bias_sigma.tolist(),
        "delay_s": estimate.delay,
        "delay_sigma_s": estimate.delay_sigma,
        "force_rms_m_s2": estimate.force_rms.tolist(),
        "rate_rms_rad_s": estimate.rate_rms.tolist(),
    }


def _stated_sigmas(mission: Mission) -> dict[str, float | None]:
    """Sigmas of the lever arm between the IMUs and of their alignment that a mission states; None where it does not."""
    lever_arm = alignment = None
    if isinstance(mission.telemetry, MerImuConfig):
        imus = mission.telemetry.imus.values()
        lever_arm = math.hypot(*(imu.position_sigma for imu in imus)) or None
        alignment = math.hypot(*(imu.alignment_sigma_deg for imu in imus)) or None
    return {"stated_lever_arm_sigma_m": lever_arm, "stated_alignment_sigma_deg": alignment}


def _fit(fit: Misalignment) -> dict[str, Any]:
    return {
        "start_s": float(fit.start),
        "end_s": float(fit.end),
        "misalignment_deg": np.rad2deg(fit.slope).tolist(),
        "misalignment_sigma_deg": np.rad2deg(fit.slope_sigma).tolist(),
        "bias_difference_m_s2": fit.offset.tolist(),
        "bias_difference_sigma_m_s2": fit.offset_sigma.tolist(),
        "residual_rms_m_s2": fit.residual_rms.tolist(),
        "samples": fit.samples,
    }


def innovation_rms(checks: list[ConstraintCheck]) -> dict[str, dict[str, float]]:
    """Normalised RMS of the filter's innovations: constraint → component → 1 where they have their predicted sigma."""
    return {
        c.name: dict(
            zip(c.components, np.sqrt(np.mean((c.innovation / c.innovation_sigma) ** 2, axis=0)).tolist(), strict=True)
        )
        for c in checks
    }
