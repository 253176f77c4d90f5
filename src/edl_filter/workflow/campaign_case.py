"""One case of a campaign: draw, simulate, reconstruct (or diagnose), and the numbers that are kept.

The record of a case is plain data: its number, flight, dispersion and seed, what was drawn, and ``values``, whose names
are those of `edl_filter.results.campaign_variables.VARIABLES`. It depends on the campaign's seed and the case's number
alone, except ``seconds`` and ``processor_seconds``.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

import numpy as np

from edl_filter import rotations
from edl_filter.effects.base import EffectInstance, label_of
from edl_filter.effects.sensor_chain import canonical_key
from edl_filter.navigation.leave_one_out import ConstraintCheck
from edl_filter.pipeline.load import check_settings, prepare_telemetry, read_atmosphere, read_telemetry
from edl_filter.pipeline.reconstruct import FlightInputs, Reconstruction, reconstruct
from edl_filter.pipeline.redundancy import contradicting
from edl_filter.pipeline.trust import lost_motion
from edl_filter.postflight.airdata import air_data
from edl_filter.postflight.events import events
from edl_filter.results.campaign_variables import AXES, EVENT_VALUES, PARTS, PHASES, STATE
from edl_filter.results.landing import landing_sample
from edl_filter.simulation import simulate
from edl_filter.simulation.campaign_config import Campaign
from edl_filter.simulation.dispersion import CampaignFlight, CaseDraw, draw_case, load_flight
from edl_filter.simulation.motion import Motion
from edl_filter.types import Array

#: Time after the parachute's deployment, and after rest, at which errors of the state are recorded, s.
_AFTER_DEPLOYMENT, _AFTER_REST = 20.0, 10.0


class CaseRunner:
    """Runs cases of one campaign; scenarios, missions and telemetry are read once.

    Parameters
    ----------
    campaign : Campaign
        The campaign, checked.
    """

    def __init__(self, campaign: Campaign) -> None:
        self.campaign = campaign
        self._flights: dict[str, CampaignFlight] = {}
        self._inputs: dict[str, FlightInputs] = {}

    def run(self, number: int) -> dict[str, Any]:
        """The record of a case.

        Raises
        ------
        InputError
            Its input is wrong, or its flight cannot be simulated or reconstructed.
        """
        begin, processor = time.perf_counter(), time.process_time()
        key = self.campaign.case(number)
        flight = self._flight(key.flight)
        draw = draw_case(self.campaign, key, flight)
        measured = flight.scenario is None
        values = self._measured(key.flight, flight, draw) if measured else self._simulated(flight, draw)
        return {
            "case": number,
            "flight": key.flight,
            "dispersion": key.dispersion,
            "seed": draw.seed,
            "hidden": [a.label for a in draw.hidden],
            "values": values | {"drawn": dict(draw.values)},
            "seconds": time.perf_counter() - begin,
            "processor_seconds": time.process_time() - processor,
        }

    def _flight(self, name: str) -> CampaignFlight:
        if name not in self._flights:
            self._flights[name] = load_flight(self.campaign, name)
        return self._flights[name]

    def _measured(self, name: str, flight: CampaignFlight, draw: CaseDraw) -> dict[str, Any]:
        """Values of a measured flight, in whose model everything is drawn."""
        if name not in self._inputs:
            self._inputs[name] = FlightInputs(read_telemetry(flight.mission), read_atmosphere(flight.mission))
        inputs = self._inputs[name]
        driving = inputs.telemetry.driving
        drawn = (*draw.effects, *draw.model_errors, *draw.imu_errors(driving.errors[int(driving.unit[0])]))
        present = {a.key for a in drawn}
        stated = tuple(a for a in flight.mission.active_effects() if a.key not in present)
        return self._analysed(flight, inputs, (*stated, *drawn), draw)

    def _simulated(self, flight: CampaignFlight, draw: CaseDraw) -> dict[str, Any]:
        """Values of a simulated flight, with the errors of its reconstruction."""
        scenario, mission = flight.scenario, flight.mission
        assert scenario is not None
        flown = simulate(scenario, (*scenario.active_effects(), *draw.effects), draw.seed, draw.errors)
        telemetry = prepare_telemetry(mission, flown.telemetry(check_settings(mission)), f"case {draw.key.number}")
        inputs = FlightInputs(telemetry, read_atmosphere(mission))
        reconstruction = self._reconstructed(flight, inputs, mission.active_effects())
        values = self._values(reconstruction) | state_errors(reconstruction, flown.motion)
        rest = flown.motion.at(np.array([flown.motion.stopped]))[0, :3]
        fixed = flown.forward_model.planet.rotation.to_fixed(flown.motion.stopped, rest)
        values["true_landing_position"] = dict(zip(AXES, fixed.tolist(), strict=True))
        if self.campaign.analysis == "diagnose":
            values |= diagnosis_values(flight, inputs, mission.active_effects(), draw.hidden)
        return values

    def _analysed(
        self, flight: CampaignFlight, inputs: FlightInputs, effects: tuple[EffectInstance, ...], draw: CaseDraw
    ) -> dict[str, Any]:
        values = self._values(self._reconstructed(flight, inputs, effects))
        if self.campaign.analysis == "diagnose":
            values |= diagnosis_values(flight, inputs, effects, ())
        return values

    def _reconstructed(
        self, flight: CampaignFlight, inputs: FlightInputs, effects: tuple[EffectInstance, ...]
    ) -> Reconstruction:
        return reconstruct(flight.mission, effects, self.campaign.leave_one_out, inputs=inputs, compare_imus=False)

    def _values(self, reconstruction: Reconstruction) -> dict[str, Any]:
        """Events, landing and constraints of a reconstruction."""
        r = reconstruction
        air = air_data(r.trajectory, r.planet, r.atmosphere, r.effects)
        values: dict[str, Any] = {name: {} for name in EVENT_VALUES.values()}
        for event in events(r, air).values():
            for attribute, name in EVENT_VALUES.items():
                values[name][event.name] = getattr(event, attribute)
        rejected = contradicting(r.filter_pass)
        diverged = r.recovery is not None and r.recovery.cause != "gap"
        values["trustworthy"] = float(not rejected and not diverged and lost_motion(r) is None)
        return values | landing_values(r) | constraint_values(r)


def landing_values(reconstruction: Reconstruction) -> dict[str, Any]:
    """Planet-fixed landing position as estimated, and as predicted without the landing constraint, with their sigmas.

    A sigma is the root of the sum of the horizontal variances. Empty if the record ends before the landing.
    """
    r, (k, landed) = reconstruction, landing_sample(reconstruction)
    if not landed:
        return {}
    rotation, instant = r.planet.rotation, float(r.trajectory.time[k])
    position = rotation.to_fixed(instant, r.trajectory.position[k])
    inertial_covariance = r.trajectory.covariance_at(r.trajectory.time[k : k + 1])[0, :3, :3]
    covariance = rotation.to_fixed(instant, rotation.to_fixed(instant, inertial_covariance).T)
    values: dict[str, Any] = {
        "landing_position": dict(zip(AXES, position.tolist(), strict=True)),
        "landing_sigma": _horizontal_sigma(position, covariance),
    }
    check = next((c for c in r.constraint_checks if c.name == "landing"), None)
    if check is not None and r.site is not None:
        predicted = r.site - check.left_out
        values["predicted_landing_position"] = dict(zip(AXES, predicted.tolist(), strict=True))
        values["predicted_landing_sigma"] = _horizontal_sigma(predicted, check.left_out_covariance)
    return values


def _horizontal_sigma(position: Array, covariance: Array) -> float:
    up = position / np.linalg.norm(position)
    return float(np.sqrt(max(float(np.trace(covariance) - up @ covariance @ up), 0.0)))


def constraint_values(reconstruction: Reconstruction) -> dict[str, Any]:
    """NIS and degrees of freedom of each constraint, also against all others where that was computed."""
    nis: dict[str, float] = {}
    dof: dict[str, float] = {}
    rejected: dict[str, float] = {}
    for f in reconstruction.filter_pass.fused:
        name = f.constraint.name
        nis[name] = nis.get(name, 0.0) + float(f.innovation.nis)
        dof[name] = dof.get(name, 0.0) + len(f.innovation.residual)
        rejected[name] = rejected.get(name, 0.0) + float(not f.accepted)
    checks: list[ConstraintCheck] = reconstruction.constraint_checks
    return {
        "nis": nis,
        "dof": dof,
        "rejected": rejected,
        "left_out_nis": {c.name: float(c.left_out_nis) for c in checks},
        "left_out_dof": {c.name: float(c.left_out_dof) for c in checks},
    }


def state_errors(reconstruction: Reconstruction, motion: Motion) -> dict[str, Any]:
    """Errors of the smoothed state against the truth, their sigmas and NEES, at the `PHASES` of a simulated flight.

    Parameters
    ----------
    reconstruction : Reconstruction
        Of the simulated flight.
    motion : Motion
        The true motion.

    Returns
    -------
    dict
        ``state_error`` and ``state_sigma``: phase → component of `STATE` (true minus estimate; position and velocity
        inertial, attitude about body axes); ``nees``: phase → part of `PARTS`.
    """
    nodes = np.array([node.time for node in reconstruction.filter_pass.nodes])
    force = np.linalg.norm(motion.before[:, 13:16], axis=1) * (motion.time[:-1] < motion.deployed)
    times = (
        0.0, float(motion.time[int(np.argmax(force))]), motion.deployed - 1.0, motion.deployed + _AFTER_DEPLOYMENT,
        motion.stopped + _AFTER_REST,
    )  # fmt: skip
    values: dict[str, Any] = {"state_error": {}, "state_sigma": {}, "nees": {}}
    for phase, instant in zip(PHASES, times, strict=True):
        i = int(np.argmin(np.abs(nodes - instant)))
        nav = reconstruction.smoothed.states[i].nav
        covariance = reconstruction.smoothed.covariance[i][:9, :9]
        true = motion.at(nodes[i : i + 1])[0]
        turn = rotations.multiply(rotations.conjugate(nav[6:10]), true[6:10])
        error = np.concatenate((true[:6] - nav[:6], rotations.to_rotation_vector(turn)))
        values["state_error"][phase] = dict(zip(STATE, error.tolist(), strict=True))
        values["state_sigma"][phase] = dict(zip(STATE, np.sqrt(np.diag(covariance)).tolist(), strict=True))
        values["nees"][phase] = {
            name: float(error[part] @ np.linalg.solve(covariance[part, part], error[part]))
            for name, part in PARTS.items()
        }
    return values


def diagnosis_values(
    flight: CampaignFlight,
    inputs: FlightInputs,
    effects: tuple[EffectInstance, ...],
    hidden: Sequence[EffectInstance],
) -> dict[str, Any]:
    """Verdict and probabilities of a diagnosis with the whole catalogue.

    Parameters
    ----------
    flight : CampaignFlight
        Its mission.
    inputs : FlightInputs
        Telemetry and atmosphere.
    effects : tuple of EffectInstance
        Of the model.
    hidden : sequence of EffectInstance
        Effects that are in the flight and not in the model. A sensor effect is named rightly in its own IMU only.
    """
    from edl_filter.diagnosis.diagnosis import diagnose
    from edl_filter.diagnosis.linear_model.flight_case import flight_case
    from edl_filter.effects.registry import known_effects
    from edl_filter.results.schema import DiagnosisContent
    from edl_filter.results.verdicts import VERDICTS

    reconstruction = reconstruct(flight.mission, effects, False, recover=False, inputs=inputs, compare_imus=False)
    diagnosis = DiagnosisContent.of(diagnose(flight_case(reconstruction), known_effects().values()).content())
    true = {label_of(canonical_key(a, inputs.telemetry.driving)) for a in hidden}
    ranking = diagnosis.ranking
    named = {ranking[0].label, *ranking[0].same_as} if ranking else set()
    return {
        "verdict": float(VERDICTS.index(diagnosis.verdict)),
        "none_probability": diagnosis.none,
        "leader_probability": ranking[0].probability if ranking else 0.0,
        "leader_right": float(not named.isdisjoint(true)),
        "named": float(diagnosis.verdict == "missing" and bool(ranking)),
        "probability": {h.label: h.probability for h in ranking[:10]},
    }
