"""All that depends on the choice of the atmosphere: coefficients, database, combination coefficients, differences.

The post-flight layer runs twice, with the atmosphere extracted from the flight and with the preflight one: two
instances of `AtmosphereCase`. `SmoothedMotion` holds what both have in common.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from edl_filter.postflight.atmosphere import AtmosphereProfile
from edl_filter.postflight.averages import Difference, average_differences
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
from edl_filter.postflight.inputs import PostflightInputs
from edl_filter.postflight.measured import as_measured
from edl_filter.postflight.moments import Moments, euler
from edl_filter.postflight.rates import BatchSmoother, batch_smoother
from edl_filter.postflight.windows import Window
from edl_filter.types import Array


@dataclass(frozen=True)
class SmoothedMotion:
    """Smoothed forces and rates, and the moments, which do not depend on the atmosphere.

    Attributes
    ----------
    smoother : BatchSmoother
        Batches and bandwidths.
    force, rate, acceleration : (N, 3) arrays
        Smoothed specific force and rate, angular acceleration: m/s², rad/s, rad/s²; body axes.
    force_sigma, rate_sigma, acceleration_sigma : (N,) arrays
        One sigma per axis due to noise.
    moments : Moments
        About the centre of mass.
    """

    smoother: BatchSmoother
    force: Array
    rate: Array
    acceleration: Array
    force_sigma: Array
    rate_sigma: Array
    acceleration_sigma: Array
    moments: Moments


@dataclass(frozen=True)
class AtmosphereCase:
    """Everything that is derived with one atmosphere.

    Attributes
    ----------
    atmosphere : AtmosphereProfile
    coefficients : FlightCoefficients
        From forces, moments and the atmosphere's density.
    database : DatabaseCoefficients
        At the reconstructed angles.
    database_measured : DatabaseCoefficients
        The same after the flight's sampling and smoothing: it is compared in the averages.
    forces, moments : Combination
        Forces → angles → moments, and moments → angles → forces.
    angles : AngleDifferences
    differences : list of Difference
        Averages over the windows.
    """

    atmosphere: AtmosphereProfile
    coefficients: FlightCoefficients
    database: DatabaseCoefficients
    database_measured: DatabaseCoefficients
    forces: Combination
    moments: Combination
    angles: AngleDifferences
    differences: list[Difference]


def smoothed_motion(i: PostflightInputs) -> SmoothedMotion:
    """Smooth forces and rates and compute the moments."""
    smoother = batch_smoother(i.time, i.batch, i.low_pass_hz)
    rate, acceleration = smoother.smooth(i.angular_rate), smoother.differentiate(i.angular_rate)
    rate_sigma, acceleration_sigma = smoother.smoothed_sigma(i.rate_noise), smoother.acceleration_sigma(i.rate_noise)
    return SmoothedMotion(
        smoother=smoother,
        force=smoother.smooth(i.specific_force),
        rate=rate,
        acceleration=acceleration,
        force_sigma=smoother.smoothed_sigma(i.force_noise),
        rate_sigma=rate_sigma,
        acceleration_sigma=acceleration_sigma,
        moments=euler(
            rate, acceleration, i.inertia, rate_sigma, acceleration_sigma, i.inertia_relative, i.product_sigma
        ),
    )


def coefficients_of(
    i: PostflightInputs, motion: SmoothedMotion, atmosphere: AtmosphereProfile
) -> tuple[FlightCoefficients, DatabaseCoefficients]:
    """Coefficients of the flight, and of the database at the reconstructed angles, with one atmosphere."""
    return (
        flight_coefficients(
            motion.force, motion.force_sigma, i.bias_sigma, motion.moments, atmosphere, i.speed, i.mass, i.diameter,
            i.alignment_sigma, i.force_read, i.rate_read,
        ),
        database_coefficients(
            i.database, atmosphere, i.speed, i.velocity_body, i.x_over_d, i.angle_sigma, i.offset
        ),
    )  # fmt: skip


def atmosphere_case(
    i: PostflightInputs,
    motion: SmoothedMotion,
    atmosphere: AtmosphereProfile,
    coefficients: FlightCoefficients,
    database: DatabaseCoefficients,
    windows: Sequence[Window],
) -> AtmosphereCase:
    """Combination coefficients, angles and averages with one atmosphere.

    Parameters
    ----------
    i : PostflightInputs
        Up to the parachute.
    motion : SmoothedMotion
        Of the same samples.
    atmosphere : AtmosphereProfile
        From the flight, or the preflight one.
    coefficients, database : FlightCoefficients, DatabaseCoefficients
        `coefficients_of` that atmosphere.
    windows : sequence of Window
        Windows of the averages.

    Returns
    -------
    AtmosphereCase
    """
    smoother, stride = motion.smoother, stride_of(motion.smoother.points)
    look_up = (i.database, atmosphere, coefficients, i.speed, i.velocity_body, i.x_over_d, stride, i.offset)
    forces, moments = from_forces(*look_up), from_moments(*look_up)
    measured = as_measured(database, atmosphere, smoother, motion.rate, i.speed, i.mass, i.diameter, i.inertia)
    return AtmosphereCase(
        atmosphere=atmosphere,
        coefficients=coefficients,
        database=database,
        database_measured=measured,
        forces=forces,
        moments=moments,
        angles=angle_differences(i.alpha, i.beta, forces, moments, i.angle_sigma),
        differences=average_differences(
            i.time, measured, coefficients, forces, moments, windows, smoother.points, axial=not atmosphere.from_drag
        ),
    )
