"""One case of a campaign: everything that is drawn, from the campaign's seed and the case's number alone."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from edl_filter.effects.base import EffectInstance
from edl_filter.effects.registry import find_effect
from edl_filter.errors import InputError
from edl_filter.imu_model.sensor_errors import SENSOR_STATES, SensorErrors
from edl_filter.mission import Mission
from edl_filter.mission.fields import DEG
from edl_filter.pipeline.forward_model import database_of
from edl_filter.simulation.air_errors import AirError
from edl_filter.simulation.campaign_config import (
    Campaign,
    CaseKey,
    DispersedEffectConfig,
    Distribution,
)
from edl_filter.simulation.database_errors import database_with_errors
from edl_filter.simulation.model_errors import DatabaseError, EntryStateError, ImuErrors
from edl_filter.simulation.scenario import Scenario, Weather
from edl_filter.simulation.world_errors import WorldErrors
from edl_filter.types import Array

#: Streams of random numbers, one for each purpose, so that a change of one does not change the others.
_FLIGHT, _ENTRY, _IMU, _DATABASE, _AIR, _VEHICLE, _EFFECTS = range(7)
#: Trials to draw a parameter within the bounds of its effect.
_TRIALS = 1000
_COMPONENTS = tuple(f"{name}_{axis}" for name in ("position", "velocity", "attitude") for axis in "xyz")


@dataclass(frozen=True)
class CampaignFlight:
    """A flight of a campaign, read once.

    Attributes
    ----------
    scenario : Scenario or None
        None for a measured flight.
    mission : Mission
        With which it is reconstructed.
    """

    scenario: Scenario | None
    mission: Mission


@dataclass(frozen=True, eq=False)
class CaseDraw:
    """What was drawn for a case.

    Attributes
    ----------
    key : CaseKey
    seed : int
        Of the scenario's own random quantities.
    errors : WorldErrors
        Of a simulated flight.
    effects : tuple of EffectInstance
        Flown, or in the model of a measured flight: those of the catalogue, and errors of the air.
    model_errors : tuple of EffectInstance
        Errors of the entry state and of the database, in the model of a measured flight.
    imu_deviates : dict of str to (3,) array
        Sensor errors in sigmas, for a measured flight; empty if there are none.
    values : dict
        Name of each drawn number → value, SI units.
    """

    key: CaseKey
    seed: int
    errors: WorldErrors
    effects: tuple[EffectInstance, ...]
    model_errors: tuple[EffectInstance, ...] = ()
    imu_deviates: dict[str, Array] = field(default_factory=dict)
    values: dict[str, float] = field(default_factory=dict)

    @property
    def hidden(self) -> tuple[EffectInstance, ...]:
        """Effects of the catalogue, or of the user, that the flight has."""
        return tuple(a for a in self.effects if not isinstance(a.effect, AirError))

    def imu_errors(self, sigmas: SensorErrors) -> tuple[EffectInstance, ...]:
        """Sensor errors of the driving IMU, whose constant errors have these sigmas; none if none were drawn.

        They are added to `values`.
        """
        if not self.imu_deviates:
            return ()
        errors = {name: getattr(sigmas, name) * deviates for name, deviates in self.imu_deviates.items()}
        for name, error in errors.items():
            if error.any():
                numbers = zip("xyz", error.tolist(), strict=True)
                self.values.update({f"imu_errors.{name}_{axis}": value for axis, value in numbers})
        return (EffectInstance(ImuErrors(errors), {}, fixed=True),)


def load_flight(campaign: Campaign, name: str) -> CampaignFlight:
    """Read scenario and mission of one of the campaign's flights.

    Raises
    ------
    InputError
        A file cannot be read or is wrong.
    """
    stated = campaign.flights[name]
    if stated.scenario is None:
        assert stated.mission is not None  # the file is checked
        return CampaignFlight(None, Mission.load(campaign.path(stated.mission), stated.set))
    scenario = Scenario.load(campaign.path(stated.scenario), stated.scenario_set)
    path = campaign.path(stated.mission) if stated.mission is not None else scenario.model.source
    assert path is not None  # a scenario names a file
    return CampaignFlight(scenario, Mission.load(path, ("telemetry.path=simulated.h5", *stated.set)))


def draw_case(campaign: Campaign, key: CaseKey, flight: CampaignFlight) -> CaseDraw:
    """Draw a case.

    Parameters
    ----------
    campaign : Campaign
        Its seed and the case's number determine everything.
    key : CaseKey
        Of the case.
    flight : CampaignFlight
        Of the case (`load_flight`).

    Raises
    ------
    InputError
        An effect does not exist, or its parameters cannot be drawn within their bounds.
    """
    stated = campaign.dispersions[key.dispersion]

    def random(purpose: int) -> np.random.Generator:
        return np.random.default_rng([campaign.seed, key.number, purpose])

    entry, values = stated.initial_state, dict[str, float]()
    sigma = np.repeat([entry.position_sigma, entry.velocity_sigma, entry.attitude_sigma_deg * DEG], 3)
    start = sigma * random(_ENTRY).standard_normal(9)
    if sigma.any():
        drawn = zip(_COMPONENTS, start, sigma, strict=True)
        values |= {f"initial_state.{name}": float(value) for name, value, spread in drawn if spread > 0.0}
    effects = list(_drawn_effects(campaign, key, random(_EFFECTS)))
    for instance in effects:
        values |= {f"{instance.label}.{name}": float(v) for name, v in instance.values.items()}
    if stated.air.density_sigma or stated.air.wind_sigma:
        effects.append(_air(stated.air, random(_AIR)))
    seed = int(random(_FLIGHT).integers(2**31))
    if flight.scenario is None:
        return _measured(campaign, key, flight.mission, seed, start, tuple(effects), values, random)
    database = None
    if stated.database:
        model, mission = flight.scenario.model, flight.mission
        assert model.aerodynamics is not None  # a scenario is checked
        database = database_with_errors(
            random(_DATABASE), database_of(model), model.aerodynamics.family, mission.label, stated.database
        )
    mass, inertia = random(_VEHICLE).standard_normal(2)
    errors = WorldErrors(
        database,
        float(1.0 + stated.vehicle.mass_sigma * mass),
        float(1.0 + stated.vehicle.inertia_sigma * inertia),
        start,
        1.0 if stated.imu_errors is None else stated.imu_errors,
    )
    if stated.vehicle.mass_sigma:
        values["mass_factor"] = errors.mass_factor
    if stated.vehicle.inertia_sigma:
        values["inertia_factor"] = errors.inertia_factor
    return CaseDraw(key, seed, errors, tuple(effects), values=values)


def _measured(
    campaign: Campaign,
    key: CaseKey,
    mission: Mission,
    seed: int,
    start: Array,
    effects: tuple[EffectInstance, ...],
    values: dict[str, float],
    random: Callable[[int], np.random.Generator],
) -> CaseDraw:
    """The draw of a measured flight, whose errors are in the model."""
    stated = campaign.dispersions[key.dispersion]
    model = [EffectInstance(EntryStateError(start), {}, fixed=True)] if start.any() else []
    if stated.database:
        if mission.aerodynamics is None:
            raise InputError(
                f"{campaign.label}: dispersions.{key.dispersion}.database: found {stated.database}; "
                f"{mission.label} has no aerodynamic database."
            )
        field_of_errors = DatabaseError(random(_DATABASE), mission.aerodynamics.family, stated.database)
        model.append(EffectInstance(field_of_errors, {}, fixed=True))
    deviates = {}
    if stated.imu_errors:
        generator = random(_IMU)
        deviates = {name: stated.imu_errors * generator.standard_normal(3) for name in SENSOR_STATES}
        if mission.constraints.onboard_attitude is not None:  # computed from the same gyros, with the same errors
            deviates |= {name: np.zeros(3) for name in SENSOR_STATES if name.startswith("gyro")}
    return CaseDraw(key, seed, WorldErrors(), effects, tuple(model), deviates, values)


def _air(stated: Weather, random: np.random.Generator) -> EffectInstance:
    error = AirError(random, stated.density_sigma, stated.wind_sigma, stated.correlation_length)
    return EffectInstance(error, {}, fixed=True)


def _drawn_effects(campaign: Campaign, key: CaseKey, random: np.random.Generator) -> Iterator[EffectInstance]:
    """The effects of a case; each takes the same deviates whether it is present or not."""
    for k, stated in enumerate(campaign.dispersions[key.dispersion].effects):
        label = f"{campaign.label}: dispersions.{key.dispersion}.effects.{k}"
        generator = np.random.default_rng(random.integers(2**63))
        present = generator.random() < stated.probability
        instance = _drawn_effect(campaign, stated, label, generator)
        if present:
            yield instance


def _drawn_effect(
    campaign: Campaign, stated: DispersedEffectConfig, label: str, random: np.random.Generator
) -> EffectInstance:
    """An effect with its parameters drawn within their bounds."""
    effect = find_effect(stated.name, None if stated.file is None else Path(campaign.path(stated.file)))
    unknown = set(stated.parameters) - {q.name for q in effect.parameters}
    if unknown:
        names = ", ".join(q.name for q in effect.parameters)
        raise InputError(f"{label}.parameters: found {min(unknown)}; {stated.name} has {names}.")
    if stated.imu is not None and not effect.is_sensor_effect:
        raise InputError(f"{label}.imu: found {stated.imu!r}; expected none: {stated.name} sits in no IMU.")
    values: dict[str, float] = {}
    for q in effect.parameters:
        if q.name in stated.parameters:
            distribution = stated.parameters[q.name]
        elif q.kind == "size":
            distribution = Distribution(sigma=stated.size * q.sigma)
        else:
            continue
        for _ in range(_TRIALS):
            values[q.name] = _number(distribution, random)
            invalid = [p for p in effect.problems(values) if p.parameter == q.name]
            if not invalid:
                break
        else:
            raise InputError(
                f"{label}.parameters.{q.name}: found {invalid[0].actual} in {_TRIALS} draws; "
                f"expected {invalid[0].expected}."
            )
    return EffectInstance(effect, values, stated.imu, fixed=True)


def _number(distribution: Distribution, random: np.random.Generator) -> float:
    if distribution.value is not None:
        return distribution.value
    if distribution.sigma is not None:
        return float(distribution.mean + distribution.sigma * random.standard_normal())
    assert distribution.low is not None and distribution.high is not None  # the file is checked
    return float(random.uniform(distribution.low, distribution.high))
