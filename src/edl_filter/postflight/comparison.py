"""Database and combination coefficients, and angle differences (thesis chapters 7 and 8).

Figure 7.1 in both directions: inverse look-up of the flight's forces gives an angle, at which the database gives
moments; inverse look-up of the flight's moments gives an angle, at which it gives forces. The database depends on the
total angle, so each pair of in-plane coefficients is taken as one vector: its magnitude gives the total angle and its
direction the plane of the lateral flow. At small angles that is the thesis's CN → alpha and CY → beta; at large ones it
is independent of the body's roll angle.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from edl_filter.aero.conventions import total_angle
from edl_filter.aero.database import Database, moments_at_cm, split
from edl_filter.aero.inverse import InverseResult, angle_from_cm, angle_from_cn
from edl_filter.postflight.atmosphere import AtmosphereProfile, scatter
from edl_filter.postflight.coefficients import FlightCoefficients
from edl_filter.types import Array, BoolArray, IntArray

#: Step of the angle for the database's slope, rad.
_STEP = 1e-3
#: Upper bound of the sigma of an angle, rad: an angle with a larger one is undetermined.
_UNDETERMINED = 0.5
#: Iterations of CA at the angle of the inverse look-up: each leaves less than a hundredth of the change before.
_ITERATIONS = 3
#: Samples in a smoothing batch at which the inverse look-up is made.
_SAMPLES = 35


@dataclass(frozen=True)
class DatabaseCoefficients:
    """The database at the reconstructed angles, ``(N,)`` each.

    Attributes
    ----------
    value : dict
        CA, CN, CY, Cl, Cm, Cn at the centre of mass; Cl is zero with the centre of mass on the axis.
    angle_sigma : dict
        One sigma of each due to the sigma of the angle.
    three_sigma : dict
        The database's own 3 sigma of CA, CN, CY, Cl, Cm, Cn.
    outside : array of bool
        True where a table is held at its edge.
    """

    value: dict[str, Array]
    angle_sigma: dict[str, Array]
    three_sigma: dict[str, Array]
    outside: BoolArray


@dataclass(frozen=True)
class Combination:
    """Angles from the flight's forces or moments, and the database's coefficients there, ``(N,)`` each.

    Attributes
    ----------
    alpha, beta, alpha_total : arrays
        rad; NaN where there is no solution.
    value : dict
        The other pair of coefficients: Cm and Cn from forces, CN and CY from moments.
    noise, systematic : arrays
        One sigma of each of the two, from the flight's coefficients through the database's slopes: the part that is
        independent from batch to batch, and the part that is common to the flight.
    angle_noise, angle_systematic : arrays
        The same of the angle in each plane, rad; half a radian where the angle is undetermined.
    status : array of int8
        Number of solutions of the inverse look-up: 0 none, 1 one, 2 several (the one nearest to the reconstructed angle
        is taken); -1 where none was made. With a stride, a sample between two look-ups has the earlier one's status,
        while its values are interpolated and NaN where either has no solution: NaN alone says whether there is a value.
    """

    alpha: Array
    beta: Array
    alpha_total: Array
    value: dict[str, Array]
    noise: Array
    systematic: Array
    angle_noise: Array
    angle_systematic: Array
    status: NDArray[np.int8]


@dataclass(frozen=True)
class AngleDifferences:
    """Differences of the angles, ``(N,)`` each, rad.

    ``*_forces``: reconstructed minus from forces; ``*_moments``: reconstructed minus from moments; ``*_between``: from
    forces minus from moments. ``forces_sigma``, ``moments_sigma`` and ``between_sigma`` are one sigma of each, in
    either plane.
    """

    alpha_forces: Array
    alpha_moments: Array
    alpha_between: Array
    beta_forces: Array
    beta_moments: Array
    beta_between: Array
    forces_sigma: Array
    moments_sigma: Array
    between_sigma: Array


def database_coefficients(
    database: Database,
    atmosphere: AtmosphereProfile,
    speed: Array,
    velocity_body: Array,
    x_over_d: ArrayLike,
    alpha_sigma: Array | float = 0.0,
    offset: tuple[ArrayLike, ArrayLike] = (0.0, 0.0),
) -> DatabaseCoefficients:
    """Coefficients of the database at the reconstructed angles.

    Parameters
    ----------
    database : Database
        Aerodynamic database.
    atmosphere : AtmosphereProfile
        Mach and Knudsen numbers.
    speed : (N,) array
        Air-relative, m/s.
    velocity_body : (N, 3) array
        Air-relative, body axes, any scale.
    x_over_d : float or (N,) array
        Centre of mass behind the nose, diameters.
    alpha_sigma : (N,) array or float
        One sigma of the direction of the air-relative velocity in each plane, rad.
    offset : tuple of float or of (N,) array
        Centre of mass to the right of the axis (+y) and below it (+z), diameters.

    Returns
    -------
    DatabaseCoefficients
    """
    valid = atmosphere.valid
    _, v, w = velocity_body[valid].T
    total = total_angle(velocity_body[valid])
    flow = atmosphere.mach[valid], atmosphere.knudsen[valid]
    entry = database.lookup(*flow, total, speed[valid])
    x, y, z = (np.broadcast_to(np.asarray(p, float), speed.shape)[valid] for p in (x_over_d, *offset))
    cm = entry.cm_at(x)
    cn, cy, pitch_nose, yaw_nose = split(entry.cn, entry.cm_nose, v, w)
    roll, pitch, yaw = moments_at_cm((entry.ca, cy, cn), (0.0, pitch_nose, yaw_nose), (x, y, z))
    above = database.lookup(*flow, total + _STEP, speed[valid])
    # an error across the plane rotates a coefficient by C/alpha, one in the plane changes it by its slope: the larger
    # of the two is a bound
    safe = np.maximum(total, _STEP)
    force_slope = np.maximum(np.abs(above.cn - entry.cn) / _STEP, np.abs(entry.cn) / safe)
    moment_slope = np.maximum(np.abs(above.cm_at(x) - cm) / _STEP, np.abs(cm) / safe)
    sigma = np.broadcast_to(np.asarray(alpha_sigma, float), speed.shape)[valid]
    limits = entry.three_sigma

    def full(values: Array) -> Array:
        return scatter(valid, values)

    off_axis, axial_slope = np.hypot(y, z), np.abs(above.ca - entry.ca) / _STEP
    by_force, by_moment = full(force_slope * sigma), full((moment_slope + off_axis * axial_slope) * sigma)
    force, moment = full(limits.cn), full(limits.cm)
    return DatabaseCoefficients(
        value={
            "CA": full(entry.ca), "CN": full(cn), "CY": full(cy), "Cl": full(roll), "Cm": full(pitch), "Cn": full(yaw)
        },
        angle_sigma={
            "CA": full(axial_slope * sigma), "CN": by_force, "CY": by_force,
            "Cl": full(off_axis * force_slope * sigma), "Cm": by_moment, "Cn": by_moment,
        },
        three_sigma={
            "CA": full(limits.ca), "CN": force, "CY": force, "Cl": full(limits.cl), "Cm": moment, "Cn": moment
        },
        outside=scatter(valid, entry.outside, False),
    )  # fmt: skip


def from_forces(
    database: Database,
    atmosphere: AtmosphereProfile,
    flight: FlightCoefficients,
    speed: Array,
    velocity_body: Array,
    x_over_d: ArrayLike,
    stride: int = 1,
    offset: tuple[ArrayLike, ArrayLike] = (0.0, 0.0),
) -> Combination:
    """Forces → angles → moments: the lateral flow has the direction of (−CY, CN).

    The inverse look-up is made at every `stride`-th sample, and the samples between are interpolated linearly (NaN next
    to a sample without solution); `stride_of` gives the stride that a smoothed series allows.

    Parameters
    ----------
    database, atmosphere, x_over_d, offset
        As in `database_coefficients`.
    flight : FlightCoefficients
        Of N samples.
    speed : (N,) array
        Air-relative, m/s.
    velocity_body : (N, 3) array
        Air-relative velocity, m/s, body axes.
    stride : int
        Samples from one look-up to the next.

    Returns
    -------
    Combination
    """
    direction = np.stack((-flight.value["CY"], flight.value["CN"]), axis=1)
    return _combine(
        database, atmosphere, flight, direction, speed, velocity_body, x_over_d, stride, offset, forces=True
    )


def from_moments(
    database: Database,
    atmosphere: AtmosphereProfile,
    flight: FlightCoefficients,
    speed: Array,
    velocity_body: Array,
    x_over_d: ArrayLike,
    stride: int = 1,
    offset: tuple[ArrayLike, ArrayLike] = (0.0, 0.0),
) -> Combination:
    """Moments → angles → forces: the lateral flow has the direction of (Cn, −Cm), or the opposite one if unstable.

    As `from_forces`. The search covers both directions; of several solutions the one nearest to the reconstructed angle
    is taken. The moments of the axial force about a centre of mass off the axis (``z CA``, ``−y CA``) are subtracted
    first, with CA at the reconstructed angle and then at the angle of the look-up.

    Parameters
    ----------
    database, atmosphere, flight, speed, velocity_body, x_over_d, stride, offset
        As in `from_forces`.

    Returns
    -------
    Combination
    """
    y, z = (np.asarray(p, float) for p in offset)
    off_axis = bool(np.any(y) or np.any(z))
    axial = atmosphere.ca.copy()
    for _ in range(_ITERATIONS if off_axis else 1):
        direction = np.stack((flight.value["Cn"] + y * axial, z * axial - flight.value["Cm"]), axis=1)
        combination = _combine(
            database, atmosphere, flight, direction, speed, velocity_body, x_over_d, stride, offset, forces=False
        )
        if off_axis:
            solved = atmosphere.valid & np.isfinite(combination.alpha_total)
            mach, knudsen = atmosphere.mach[solved], atmosphere.knudsen[solved]
            axial[solved] = database.lookup(mach, knudsen, combination.alpha_total[solved], speed[solved]).ca
    return combination


def stride_of(points: IntArray) -> int:
    """Stride with 35 look-ups in the shortest smoothing batch of `points` ``(N,)``, which resolves the series."""
    return max(1, int(points.min()) // _SAMPLES)


def angle_differences(
    alpha: Array, beta: Array, forces: Combination, moments: Combination, sigma: Array
) -> AngleDifferences:
    """Differences of the angles by three methods, in both planes (thesis chapter 8, figures 8.1 and 8.2).

    Parameters
    ----------
    alpha, beta : (N,) arrays
        Reconstructed angles, rad.
    forces, moments : Combination
        Angles from forces and from moments.
    sigma : (N,) array
        One sigma of the reconstructed angle in a plane, rad.

    Returns
    -------
    AngleDifferences
    """
    by_forces = np.hypot(forces.angle_noise, forces.angle_systematic)
    by_moments = np.hypot(moments.angle_noise, moments.angle_systematic)
    return AngleDifferences(
        alpha_forces=alpha - forces.alpha,
        alpha_moments=alpha - moments.alpha,
        alpha_between=forces.alpha - moments.alpha,
        beta_forces=beta - forces.beta,
        beta_moments=beta - moments.beta,
        beta_between=forces.beta - moments.beta,
        forces_sigma=np.hypot(sigma, by_forces),
        moments_sigma=np.hypot(sigma, by_moments),
        between_sigma=np.hypot(by_forces, by_moments),
    )


def _angle_from_cm(
    database: Database, cm: Array, mach: Array, knudsen: Array, speed: Array, x_over_d: Array, hint: Array
) -> InverseResult:
    """`angle_from_cm` with a centre of mass for each sample, ``(N,)`` as all arguments: it has few values."""
    alpha, status = np.full(len(cm), np.nan), np.zeros(len(cm), np.int8)
    for x in np.unique(x_over_d):
        part = x_over_d == x
        inverse = angle_from_cm(
            database, cm[part], mach[part], knudsen[part], speed[part], x_over_d=float(x), hint=hint[part]
        )
        alpha[part], status[part] = inverse.alpha, inverse.status
    return InverseResult(alpha, status)


def _combine(
    database: Database,
    atmosphere: AtmosphereProfile,
    flight: FlightCoefficients,
    direction: Array,
    speed: Array,
    velocity_body: Array,
    x_over_d: ArrayLike,
    stride: int,
    offset: tuple[ArrayLike, ArrayLike],
    *,
    forces: bool,
) -> Combination:
    """Inverse look-up of the coefficient vectors ``(N, 2)``, which point along the lateral flow, and what follows."""
    usable = np.flatnonzero(atmosphere.valid & np.all(np.isfinite(direction), axis=1))
    at = usable[::stride]
    mach, knudsen, fast = atmosphere.mach[at], atmosphere.knudsen[at], speed[at]
    x, y, z = (np.broadcast_to(np.asarray(p, float), speed.shape)[at] for p in (x_over_d, *offset))
    u, v, w = velocity_body[at].T
    size = np.linalg.norm(direction[at], axis=1)
    right, down = (direction[at] / np.where(size > 0.0, size, 1.0)[:, None]).T
    # reconstructed angle in the plane of the flight's coefficient
    hint = np.arctan2(v * right + w * down, u)
    inverse: InverseResult
    if forces:
        inverse = angle_from_cn(database, size, mach, knudsen, fast, hint=hint)
    else:
        inverse = _angle_from_cm(database, -size, mach, knudsen, fast, x, hint)
    angle = inverse.alpha
    sideways, along = np.sin(angle) * right, np.sin(angle) * down
    solved = np.isfinite(angle)
    value = {k: np.full(len(angle), np.nan) for k in (("Cm", "Cn") if forces else ("CN", "CY"))}
    output_slope = np.full(len(angle), np.nan)
    angle_per_size = np.full(len(angle), np.nan)
    angle_per_turn = np.full(len(angle), np.nan)
    if solved.any():
        flow, total = (mach[solved], knudsen[solved]), np.abs(angle[solved])
        entry = database.lookup(*flow, total, fast[solved])
        above = database.lookup(*flow, total + _STEP, fast[solved])
        cm, cm_above = entry.cm_at(x[solved]), above.cm_at(x[solved])
        parts = split(entry.cn, cm, sideways[solved], along[solved])
        moments = parts[2] + z[solved] * entry.ca, parts[3] - y[solved] * entry.ca
        for name, part in zip(value, moments if forces else parts[:2], strict=True):
            value[name][solved] = part
        slopes = np.abs(np.stack((above.cn - entry.cn, cm_above - cm))) / _STEP
        input_slope, output_slope[solved] = slopes if forces else slopes[::-1]
        angle_per_size[solved] = 1.0 / np.maximum(input_slope, 1e-12)
        # an error across the coefficient rotates the plane, by the error over the coefficient, and the angle with it;
        # where the curve folds, the slope at the solution does not show how flat the curve is between it and the hint
        at_hint = database.lookup(*flow, np.abs(hint[solved]), fast[solved])
        expected = np.sign(hint[solved]) * (at_hint.cn if forces else at_hint.cm_at(x[solved]))
        rise = np.abs(expected - (1.0 if forces else -1.0) * size[solved])
        run = np.abs(hint[solved] - angle[solved])
        folded = np.where(run > _STEP, run / np.maximum(rise, 1e-12), 0.0)
        angle_per_turn[solved] = np.maximum(total / np.maximum(size[solved], 1e-12), folded)
    pair = ("CN", "CY") if forces else ("Cm", "Cn")

    def full(values: Array) -> Array:
        out = np.full(len(speed), np.nan)
        out[usable] = values if stride == 1 or not len(at) else np.interp(usable, at, values)
        return out

    def sigmas(flight_sigma: dict[str, Array]) -> tuple[Array, Array]:
        """One sigma of the other pair of coefficients, and of the angle."""
        size_sigma = np.sqrt(0.5 * (flight_sigma[pair[0]][at] ** 2 + flight_sigma[pair[1]][at] ** 2))
        angle_sigma = np.minimum(size_sigma * np.maximum(angle_per_size, angle_per_turn), _UNDETERMINED)
        return full(output_slope * np.minimum(size_sigma * angle_per_size, _UNDETERMINED)), full(angle_sigma)

    noise, angle_noise = sigmas(flight.noise)
    systematic, angle_systematic = sigmas(flight.systematic)
    status = np.full(len(speed), -1, np.int8)
    status[usable] = np.repeat(inverse.status, stride)[: len(usable)]
    return Combination(
        alpha=full(np.arctan2(along, np.cos(angle))),
        beta=full(np.arcsin(sideways)),
        alpha_total=full(np.abs(angle)),
        value={k: full(x) for k, x in value.items()},
        noise=noise,
        systematic=systematic,
        angle_noise=angle_noise,
        angle_systematic=angle_systematic,
        status=status,
    )
