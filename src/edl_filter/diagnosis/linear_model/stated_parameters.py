"""Constant nuisance parameters: what a mission states with a sigma and the catalogue knows as an effect.

Centre of mass, products of inertia, rolling moment and damping, place, alignment and clock of each IMU are constant
over a flight and change the readings, the path or the loads as effects do. Each is therefore an effect with the
mission's sigma as prior (a consider parameter: Tapley, Schutz and Born, Statistical Orbit Determination, 2004, ch. 6):
its columns are those of `effect_jacobian`, its value belongs to the linearisation point, and it is marginalised as
a constant state. What is stated without a sigma is exact and has no state. The clock of an IMU whose time stamps
scatter has one too, with the sigma of `telemetry.time_stamps.evened`.

Increments that a mission takes from another flight belong to them. Their mean is added to the tables. What remains
uncertain is a Gaussian field with the covariance of the file: its Karhunen–Loève modes have constant amplitudes of unit
variance a priori. Where the file says nothing, the stationary field of `aero.discrepancy` remains.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from edl_filter.aero.increment_tables import IncrementTables, increment_terms
from edl_filter.aero.transition import WeightedSum
from edl_filter.effects.base import Effect, EffectInstance
from edl_filter.effects.parameters import Parameter, Values
from edl_filter.effects.registry import catalogue
from edl_filter.effects.sensors import AXES, components, delayed, vector
from edl_filter.effects.types import AeroCoefficients, FlightCondition
from edl_filter.imu_model.sensor_errors import apply_errors, remove_errors
from edl_filter.mission import Mission
from edl_filter.pipeline.forward_model import database_of
from edl_filter.telemetry.record import Telemetry
from edl_filter.types import Array


class ImuAlignment(Effect):
    """All axes of an IMU rotated: ``f_m = R(m) f``, ``w_m = R(m) w``."""

    name = "imu_alignment"
    parameters = vector("m", "rad", "rotation vector", 1e-3, 0.2)

    def imu(self, p: Values, time: Array, force: Array, rate: Array) -> tuple[Array, Array]:
        """Force and rate rotated by m."""
        m = components(p, "m")
        return apply_errors(force, misalignment=m), apply_errors(rate, misalignment=m)

    def corrected(self, p: Values, time: Array, force: Array, rate: Array) -> tuple[Array, Array]:
        """Force and rate rotated by -m."""
        m = components(p, "m")
        return remove_errors(force, misalignment=m), remove_errors(rate, misalignment=m)


class ImuClock(Effect):
    """All samples of an IMU are later than their time: ``f_m(t) = f(t - tau)``, ``w_m(t) = w(t - tau)``."""

    name = "imu_clock"
    parameters = (Parameter("tau", "s", "delay of the samples", 1e-4, low=-1.0, high=1.0),)

    def imu(self, p: Values, time: Array, force: Array, rate: Array) -> tuple[Array, Array]:
        """Force and rate of the time `tau` earlier."""
        return delayed(time, force, p["tau"]), delayed(time, rate, p["tau"])

    def corrected(self, p: Values, time: Array, force: Array, rate: Array) -> tuple[Array, Array]:
        """Force and rate of the time `tau` later."""
        return delayed(time, force, -p["tau"]), delayed(time, rate, -p["tau"])


class LearnedIncrements(Effect):
    """Increments of the coefficients by amplitudes of the modes of their covariance."""

    name = "database_increments"

    def __init__(self, tables: IncrementTables, continuum_limit: float) -> None:
        self._tables, self._continuum_limit = tables, continuum_limit
        count = len(tables.modes[0])
        # each file has modes of its own
        self.__dict__["parameters"] = tuple(Parameter(f"q{i}", "", f"amplitude of mode {i}", 1.0) for i in range(count))

    @property
    def sigma(self) -> dict[str, float]:
        """Prior standard deviation of each amplitude."""
        return {q.name: 1.0 for q in self.parameters}

    def coefficients(self, p: Values, flow: FlightCondition, totals: AeroCoefficients) -> AeroCoefficients:
        """Coefficients with the increments."""
        amplitudes = np.array([p.get(q.name, 0.0) for q in self.parameters])
        if not np.any(amplitudes):
            return totals
        tables = self._tables.of_amplitudes(amplitudes)
        terms = increment_terms(tables, flow.mach, flow.knudsen, self._continuum_limit)
        ca, cn, cm = WeightedSum(terms).evaluate(flow.alpha_total)
        return replace(totals, ca=totals.ca + ca, cn=totals.cn + cn, cm_nose=totals.cm_nose + cm)


@dataclass(frozen=True)
class StatedParameter:
    """An effect that a mission states as zero with a sigma.

    Attributes
    ----------
    instance : EffectInstance
        At zero.
    sigma : dict
        Parameter → one sigma; parameters without one are exact.
    """

    instance: EffectInstance
    sigma: dict[str, float]


def stated_parameters(mission: Mission, telemetry: Telemetry) -> tuple[StatedParameter, ...]:
    """Constant nuisance parameters of a mission: those with a sigma above zero.

    Parameters
    ----------
    mission : Mission
        The mission, checked.
    telemetry : Telemetry
        Its readings, whose IMUs are compared.
    """
    effects, vehicle, aero = catalogue(), mission.vehicle, mission.aerodynamics
    candidates: list[tuple[Effect, str | None, dict[str, float]]] = [
        (effects["com_offset"], None, _by_axis("d", vehicle.centre_of_mass_sigma)),
    ]
    if vehicle.inertia is not None:
        products = dict(zip("abc", vehicle.inertia.product_sigma, strict=True))
        candidates.append((effects["products_of_inertia"], None, products))
    if aero is not None:
        stated_errors = aero.discrepancy
        candidates.append((effects["rolling_moment"], None, {"c": stated_errors.rolling_sigma}))
        candidates.append((effects["pitch_damping"], None, {"a": stated_errors.damping_sigma}))
    driving = telemetry.driving.units[int(telemetry.driving.unit[0])] if telemetry.driving.units else None
    for name, imu in getattr(mission.telemetry, "imus", {}).items():
        imu_name = None if name in (driving, telemetry.driving.name) else name
        candidates.append((effects["imu_lever_arm"], imu_name, _by_axis("d", (imu.position_sigma,) * 3)))
        if imu_name is not None:  # alignment and clock are those against the driving IMU
            candidates.append((ImuAlignment(), imu_name, _by_axis("m", (imu.alignment_sigma,) * 3)))
            candidates.append((ImuClock(), imu_name, {"tau": imu.clock_sigma_s}))
    for finding in telemetry.findings:
        imu_name = None if finding.imu == telemetry.driving.name else finding.imu
        candidates.append((ImuClock(), imu_name, {"tau": finding.clock_sigma}))
    stated = []
    for effect, imu_name, sigma in candidates:
        uncertain = {name: s for name, s in sigma.items() if s > 0.0}
        if uncertain:
            stated.append(StatedParameter(EffectInstance(effect, {}, imu_name), uncertain))
    if aero is not None and aero.increments is not None and aero.coefficient_sigma > 0.0:
        database = database_of(mission)
        assert database.increments is not None
        increments = LearnedIncrements(database.increments, database.continuum_limit)
        stated.append(StatedParameter(EffectInstance(increments, {}), increments.sigma))
    return tuple(stated)


def _by_axis(prefix: str, sigma: tuple[float, float, float]) -> dict[str, float]:
    return {prefix + axis: s for axis, s in zip(AXES, sigma, strict=True)}
