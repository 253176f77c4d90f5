"""The post-flight layer on arrays: two atmospheres, coefficients with each, and their comparison with the database."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from edl_filter.postflight.atmosphere import AtmosphereProfile, preflight_atmosphere
from edl_filter.postflight.atmosphere_case import (
    AtmosphereCase,
    SmoothedMotion,
    atmosphere_case,
    coefficients_of,
    smoothed_motion,
)
from edl_filter.postflight.averages import Verdict, verdicts
from edl_filter.postflight.coefficients import FlightCoefficients
from edl_filter.postflight.density import AxialForce, extract_atmosphere
from edl_filter.postflight.inputs import PostflightInputs
from edl_filter.postflight.moments import check_inertia
from edl_filter.postflight.oscillation import Oscillation, oscillation
from edl_filter.postflight.rates import BatchSmoother
from edl_filter.postflight.two_atmospheres import AtmosphereDifferences, Change, atmosphere_differences, changes
from edl_filter.postflight.windows import (
    Domain,
    FlightRegimes,
    Window,
    detect_deceleration,
    flight_regimes,
    standard_windows,
    stated_windows,
    useful_start,
)
from edl_filter.types import Array, BoolArray


@dataclass(frozen=True)
class PostflightResult:
    """Result of the post-flight layer, over `time` up to the parachute.

    Attributes
    ----------
    time : (N,) array
        s.
    alpha, beta, alpha_total : (N,) arrays
        Reconstructed, rad.
    motion : SmoothedMotion
        Smoothed forces and rates, and moments.
    domain : Domain
    regimes : FlightRegimes
    windows : tuple of Window
    flight, preflight : AtmosphereCase
        With the atmosphere extracted from the flight, and with the preflight one.
    between_atmospheres : AtmosphereDifferences
    changes : list of Change
        Averages of these differences over the windows.
    verdicts : list of Verdict
    oscillation : Oscillation
        Stiffness and damping, window by window, with the flight's atmosphere.
    """

    time: Array
    alpha: Array
    beta: Array
    alpha_total: Array
    motion: SmoothedMotion
    domain: Domain
    regimes: FlightRegimes
    windows: tuple[Window, ...]
    flight: AtmosphereCase
    preflight: AtmosphereCase
    between_atmospheres: AtmosphereDifferences
    changes: list[Change]
    verdicts: list[Verdict]
    oscillation: Oscillation


def derive(inputs: PostflightInputs) -> PostflightResult:
    """Run the whole layer.

    Raises
    ------
    InputError
        The inertia is not that of a physical body, the preflight density does not decrease with altitude, or the axial
        force is never a deceleration.
    """
    check_inertia(inputs.inertia)
    i = inputs.until_parachute()
    motion = smoothed_motion(i)
    threshold, valid = detect_deceleration(i.time, -motion.force[:, 0], _noise_without_ends(motion))
    atmospheres = _atmospheres(i, motion, valid)
    (coefficients, database), of_preflight = (coefficients_of(i, motion, a) for a in atmospheres)
    useful = useful_start(i.time, coefficients.noise["CN"], database.three_sigma["CN"])
    start = float(i.time[np.flatnonzero(atmospheres[0].valid)[0]])
    domain = Domain(threshold, start, useful, float(min(i.parachute, i.time[-1])))
    regimes = flight_regimes(i.time, i.alpha_total, i.speed, atmospheres[0], i.database, i.x_over_d, domain)
    windows = standard_windows(domain, regimes) if i.windows is None else stated_windows(i.windows, domain)
    flight = atmosphere_case(i, motion, atmospheres[0], coefficients, database, windows)
    preflight = atmosphere_case(i, motion, atmospheres[1], *of_preflight, windows)
    between = atmosphere_differences(flight, preflight)
    return PostflightResult(
        time=i.time,
        alpha=i.alpha,
        beta=i.beta,
        alpha_total=i.alpha_total,
        motion=motion,
        domain=domain,
        regimes=regimes,
        windows=windows,
        flight=flight,
        preflight=preflight,
        between_atmospheres=between,
        changes=changes(i.time, between, windows),
        verdicts=verdicts(flight.differences, preflight.differences),
        oscillation=_oscillation(i, motion.smoother, coefficients, useful),
    )


def _noise_without_ends(motion: SmoothedMotion) -> Array:
    """Sigma ``(N,)`` of the smoothed force; in the first batch that behind it, as the gain of an end is larger."""
    noise = motion.force_sigma.copy()
    edge = min(int(motion.smoother.points[0]), len(noise) - 1)
    noise[:edge] = noise[edge]
    return noise


def _atmospheres(
    i: PostflightInputs, motion: SmoothedMotion, valid: BoolArray
) -> tuple[AtmosphereProfile, AtmosphereProfile]:
    """The atmosphere extracted from the flight, and the preflight one."""
    axial = AxialForce(
        motion.force[:, 0], motion.force_sigma, i.force_noise, i.bias_sigma[0], i.mass, i.mass_sigma, motion.smoother
    )
    path = (i.time, i.altitude, i.speed, i.alpha_total)
    return (
        extract_atmosphere(
            *path, i.gravity, i.geopotential, axial, valid, i.database, i.gas, i.diameter,
            discrepancy=i.discrepancy, speed_sigma=i.speed_sigma, wind_sigma=i.wind_sigma, sink_sigma=i.sink_sigma,
            angle_sigma=i.angle_sigma, top_temperature=i.top_temperature, top_temperature_sigma=i.top_temperature_sigma,
        ),
        preflight_atmosphere(
            *path, i.preflight_density, i.preflight_temperature, i.database, i.gas, i.diameter,
            density_sigma=i.preflight_sigma, mass_relative=i.mass_sigma / np.asarray(i.mass),
            speed_sigma=np.hypot(i.speed_sigma, i.wind_sigma), altitude_sigma=i.altitude_sigma, gravity=i.gravity,
        ),
    )  # fmt: skip


def _oscillation(
    i: PostflightInputs, smoother: BatchSmoother, coefficients: FlightCoefficients, useful: float
) -> Oscillation:
    """Stiffness and damping from time `useful` on; angles and rates go through the same operations as the moments."""
    pressure = coefficients.dynamic_pressure[:, None]
    load = np.nan_to_num(pressure)

    def as_moments(values: Array) -> Array:
        """Through a moment's sampling and smoothing, times the pressure: smoothing shifts phases where that rises."""
        return smoother.as_derived(load * values) / pressure

    moments = np.column_stack((coefficients.value["Cm"], coefficients.value["Cn"]))
    moments = np.where((i.time >= useful)[:, None], moments, np.nan)
    lateral = 0.5 * (i.inertia[..., 1, 1] + i.inertia[..., 2, 2])
    angles, rates = as_moments(np.column_stack((i.alpha, i.beta))), as_moments(i.angular_rate[:, 1:])
    return oscillation(
        i.time, angles, rates, moments, i.speed, coefficients.dynamic_pressure, i.diameter, lateral
    )  # fmt: skip
