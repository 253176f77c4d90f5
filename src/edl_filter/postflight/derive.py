"""The post-flight layer on arrays: atmosphere, coefficients, and their comparison with the database."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from edl_filter.postflight.atmosphere import FlightAtmosphere, preflight
from edl_filter.postflight.averages import Difference, Verdict, average_differences, verdicts
from edl_filter.postflight.coefficients import FlightCoefficients, flight_coefficients
from edl_filter.postflight.comparison import (
    AngleDifferences,
    Combination,
    DatabaseCoefficients,
    angle_differences,
    database_coefficients,
    from_forces,
    from_moments,
    stride_of,
)
from edl_filter.postflight.density import AxialForce, flight_extracted
from edl_filter.postflight.inputs import DeriveInputs
from edl_filter.postflight.measured import as_measured
from edl_filter.postflight.moments import Moments, check_inertia, euler
from edl_filter.postflight.oscillation import Oscillation, oscillation
from edl_filter.postflight.rates import Smoother, smoother
from edl_filter.postflight.two_atmospheres import AtmosphereDifferences, Change, atmosphere_differences, changes
from edl_filter.postflight.windows import (
    Domain,
    Marks,
    Window,
    marks,
    sensed,
    standard_windows,
    stated_windows,
    useful_from,
)

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Derived:
    """What the layer gives, over `time` up to the parachute.

    Attributes
    ----------
    time : (N,) array
        s.
    alpha, beta, alpha_total : (N,) arrays
        Reconstructed, rad.
    filters : Smoother
        Batches and bandwidths.
    force, rate, acceleration : (N, 3) arrays
        Smoothed specific force and rate, angular acceleration: m/s², rad/s, rad/s².
    force_sigma, rate_sigma, acceleration_sigma : (N,) arrays
        One sigma per axis, from noise.
    domain : Domain
    marks : Marks
    windows : tuple of Window
    moments : Moments
    flight, preflight : FlightAtmosphere
    coefficients, coefficients_preflight : FlightCoefficients
        With the two atmospheres.
    database, database_preflight : DatabaseCoefficients
        At the reconstructed angles, with the two atmospheres.
    database_measured : DatabaseCoefficients
        With the flight's atmosphere, through the flight's sampling and smoothing: what the averages compare.
    forces, from_moments : Combination
        Forces → angles → moments, and moments → angles → forces.
    forces_preflight, from_moments_preflight : Combination
        The same with the preflight atmosphere.
    angles, angles_preflight : AngleDifferences
    differences, differences_preflight : list of Difference
    between_atmospheres : AtmosphereDifferences
    changes : list of Change
        Its averages over the windows.
    verdicts : list of Verdict
    oscillation : Oscillation
        Stiffness and damping, window by window, with the flight's atmosphere.
    """

    time: Array
    alpha: Array
    beta: Array
    alpha_total: Array
    filters: Smoother
    force: Array
    rate: Array
    acceleration: Array
    force_sigma: Array
    rate_sigma: Array
    acceleration_sigma: Array
    domain: Domain
    marks: Marks
    windows: tuple[Window, ...]
    moments: Moments
    flight: FlightAtmosphere
    preflight: FlightAtmosphere
    coefficients: FlightCoefficients
    coefficients_preflight: FlightCoefficients
    database: DatabaseCoefficients
    database_preflight: DatabaseCoefficients
    database_measured: DatabaseCoefficients
    forces: Combination
    from_moments: Combination
    forces_preflight: Combination
    from_moments_preflight: Combination
    angles: AngleDifferences
    angles_preflight: AngleDifferences
    differences: list[Difference]
    differences_preflight: list[Difference]
    between_atmospheres: AtmosphereDifferences
    changes: list[Change]
    verdicts: list[Verdict]
    oscillation: Oscillation


def derive(inputs: DeriveInputs) -> Derived:
    """Run the whole layer.

    Raises
    ------
    InputError
        The inertia is no body's, the preflight density does not decrease with altitude, the axial force never
        decelerates.
    """
    check_inertia(inputs.inertia)
    i = inputs.until_parachute()
    filters = smoother(i.time, i.batch)
    force, rate = filters.smooth(i.specific_force), filters.smooth(i.angular_rate)
    acceleration = filters.differentiate(i.angular_rate)
    force_sigma, rate_sigma = filters.smoothed_sigma(i.force_noise), filters.smoothed_sigma(i.rate_noise)
    acceleration_sigma = filters.acceleration_sigma(i.rate_noise)
    # the smoother's gain at the very first sample is that of an end, not of the quiet stretch
    quiet = force_sigma.copy()
    edge = min(int(filters.points[0]), len(quiet) - 1)
    quiet[:edge] = quiet[edge]
    threshold, valid = sensed(i.time, -force[:, 0], quiet)

    axial = AxialForce(force[:, 0], force_sigma, i.force_noise, i.bias_sigma[0], i.mass, i.mass_sigma)
    place = (i.time, i.altitude, i.speed, i.alpha_total)
    flown = flight_extracted(
        *place, i.gravity, axial, valid, i.database, i.gas, i.diameter,
        speed_sigma=i.speed_sigma, wind_sigma=i.wind_sigma, sink_sigma=i.sink_sigma, angle_sigma=i.angle_sigma,
        top_temperature=i.top_temperature, top_temperature_sigma=i.top_temperature_sigma,
    )  # fmt: skip
    expected = preflight(
        *place, i.preflight_density, i.preflight_temperature, i.database, i.gas, i.diameter,
        density_sigma=i.preflight_sigma, mass_relative=i.mass_sigma / np.asarray(i.mass),
        speed_sigma=np.hypot(i.speed_sigma, i.wind_sigma), altitude_sigma=i.altitude_sigma, gravity=i.gravity,
    )  # fmt: skip
    moments = euler(rate, acceleration, i.inertia, rate_sigma, acceleration_sigma, i.inertia_relative)

    def measured(atmosphere: FlightAtmosphere) -> FlightCoefficients:
        return flight_coefficients(
            force, force_sigma, i.bias_sigma, moments, atmosphere, i.speed, i.mass, i.diameter, i.alignment_sigma
        )

    def looked_up(atmosphere: FlightAtmosphere) -> DatabaseCoefficients:
        state = (atmosphere, i.speed, i.velocity_body)
        return database_coefficients(i.database, *state, i.x_over_d, i.angle_sigma, i.offset)

    coefficients, database = measured(flown), looked_up(flown)
    stride = stride_of(filters.points)

    def combined(atmosphere: FlightAtmosphere, flight: FlightCoefficients) -> tuple[Combination, Combination]:
        ways = (i.database, atmosphere, flight, i.speed, i.velocity_body, i.x_over_d)
        return from_forces(*ways, stride, i.offset), from_moments(*ways, stride, i.offset)

    forces, by_moments = combined(flown, coefficients)
    useful = useful_from(i.time, coefficients.noise["CN"], database.three_sigma["CN"])
    start = float(i.time[np.flatnonzero(flown.valid)[0]])
    domain = Domain(threshold, start, useful, float(min(i.parachute, i.time[-1])))
    found = marks(i.time, i.alpha_total, i.speed, flown, i.database, i.x_over_d, domain)
    windows = standard_windows(domain, found) if i.windows is None else stated_windows(i.windows, domain)

    def averaged(
        atmosphere: FlightAtmosphere,
        at: DatabaseCoefficients,
        flight: FlightCoefficients,
        by_force: Combination,
        by_moment: Combination,
    ) -> tuple[DatabaseCoefficients, list[Difference]]:
        seen = as_measured(at, atmosphere, filters, rate, i.speed, i.mass, i.diameter, i.inertia)
        kinds = (i.time, seen, flight, by_force, by_moment)
        return seen, average_differences(*kinds, windows, filters.points, axial=not atmosphere.from_drag)

    seen, differences = averaged(flown, database, coefficients, forces, by_moments)
    coefficients_preflight, database_preflight = measured(expected), looked_up(expected)
    forces_preflight, by_moments_preflight = combined(expected, coefficients_preflight)
    _, differences_preflight = averaged(
        expected, database_preflight, coefficients_preflight, forces_preflight, by_moments_preflight
    )
    between = atmosphere_differences(
        (flown, expected), (database, database_preflight), (coefficients, coefficients_preflight)
    )
    return Derived(
        time=i.time,
        alpha=i.alpha,
        beta=i.beta,
        alpha_total=i.alpha_total,
        filters=filters,
        force=force,
        rate=rate,
        acceleration=acceleration,
        force_sigma=force_sigma,
        rate_sigma=rate_sigma,
        acceleration_sigma=acceleration_sigma,
        domain=domain,
        marks=found,
        windows=windows,
        moments=moments,
        flight=flown,
        preflight=expected,
        coefficients=coefficients,
        coefficients_preflight=coefficients_preflight,
        database=database,
        database_preflight=database_preflight,
        database_measured=seen,
        forces=forces,
        from_moments=by_moments,
        forces_preflight=forces_preflight,
        from_moments_preflight=by_moments_preflight,
        angles=angle_differences(i.alpha, i.beta, forces, by_moments, i.angle_sigma),
        angles_preflight=angle_differences(i.alpha, i.beta, forces_preflight, by_moments_preflight, i.angle_sigma),
        differences=differences,
        differences_preflight=differences_preflight,
        between_atmospheres=between,
        changes=changes(i.time, between, windows),
        verdicts=verdicts(differences, differences_preflight),
        oscillation=_oscillation(i, filters, coefficients, useful),
    )


def _oscillation(i: DeriveInputs, filters: Smoother, coefficients: FlightCoefficients, useful: float) -> Oscillation:
    """From where coefficients count on; angles and rates are seen as moments are."""
    pressure = coefficients.dynamic_pressure[:, None]
    load = np.nan_to_num(pressure)

    def seen(values: Array) -> Array:
        """Through a moment's sampling and smoothing, with the pressure: where that rises, smoothing shifts phases."""
        return filters.as_derived(load * values) / pressure

    moments = np.column_stack((coefficients.value["Cm"], coefficients.value["Cn"]))
    moments = np.where((i.time >= useful)[:, None], moments, np.nan)
    lateral = 0.5 * float(i.inertia[1, 1] + i.inertia[2, 2])
    swing = (seen(np.column_stack((i.alpha, i.beta))), seen(i.angular_rate[:, 1:]), moments)
    return oscillation(i.time, *swing, i.speed, coefficients.dynamic_pressure, i.diameter, lateral)


def at_middles(time: Array, values: Array) -> Array:
    """Values ``(N, ...)`` of a smooth quantity at the middles of its N - 1 intervals, by cubic splines."""
    from scipy.interpolate import CubicSpline  # slow to import, and few runs need it

    return CubicSpline(time, values, axis=0)(0.5 * (time[1:] + time[:-1]))
