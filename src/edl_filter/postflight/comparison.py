"""Database and combination coefficients, and angle differences (thesis chapters 7 and 8, eqs. 8.1 to 8.3).

Figure 7.1 both ways: the flight's forces ask the database for an angle, at which it gives moments; the flight's moments
ask for an angle, at which it gives forces. The database knows total angles, so each pair of in-plane coefficients
is taken as one vector: its size gives the total angle and its direction the plane of the lateral flow. In small angles
that is the thesis's CN → alpha and CY → beta; at large ones it does not depend on how the body is rolled.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from edl_filter.aero.database import Database, moments_at_cm, split
from edl_filter.aero.inverse import InverseResult, angle_from_cm, angle_from_cn
from edl_filter.postflight.atmosphere import FlightAtmosphere
from edl_filter.postflight.coefficients import FlightCoefficients

Array = NDArray[np.float64]

#: Step of the angle for the database's slope, rad.
_STEP = 1e-3
#: An angle that the slope would leave less known than this is not known at all, rad.
_UNKNOWN = 0.5
#: Passes in which CA settles at the angle found: each leaves under a hundredth of the change before.
_PASSES = 3
#: Samples in a smoothing batch that are asked for their angle.
_SAMPLES = 35


@dataclass(frozen=True)
class DatabaseCoefficients:
    """The database at given angles, ``(N,)`` each.

    Attributes
    ----------
    value : dict
        CA, CN, CY, Cl, Cm, Cn at the centre of mass; Cl is zero with the centre of mass on the axis.
    angle_sigma : dict
        One sigma of each that comes from the angle's.
    three_sigma : dict
        The database's own, for CA, CN, CY, Cl, Cm, Cn.
    outside : array of bool
        Held at the edge of a table.
    """

    value: dict[str, Array]
    angle_sigma: dict[str, Array]
    three_sigma: dict[str, Array]
    outside: NDArray[np.bool_]


@dataclass(frozen=True)
class Combination:
    """Angles from the flight's forces or moments, and what the database gives there, ``(N,)`` each.

    Attributes
    ----------
    alpha, beta, alpha_total : arrays
        rad; NaN where there is no solution.
    value : dict
        The other pair of coefficients: Cm and Cn from forces, CN and CY from moments.
    noise, systematic : arrays
        One sigma of each of the two, from the flight's coefficients through the database's slopes: what changes from
        batch to batch, and what is common to the flight.
    angle_noise, angle_systematic : arrays
        The same of the angle in each plane, rad; an angle that nothing holds has half a radian.
    status : array of int8
        0 no solution, 1 one, 2 several (the one nearest to the reconstructed angle is taken); -1 where nothing was
        asked. With a stride, a sample between two that were asked has the earlier one's status, while its values lie
        between the two and are NaN where either has no solution: whether there is a value only NaN tells.
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
    """Differences of the angles, rad: reconstructed less forces, reconstructed less moments, forces less moments.

    ``forces_sigma``, ``moments_sigma`` and ``between_sigma`` are one sigma of each in either plane.
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
    atmosphere: FlightAtmosphere,
    speed: Array,
    velocity_body: Array,
    x_over_d: float,
    alpha_sigma: Array | float = 0.0,
    offset: tuple[float, float] = (0.0, 0.0),
) -> DatabaseCoefficients:
    """Coefficients at the reconstructed angles.

    Parameters
    ----------
    database : Database
    atmosphere : FlightAtmosphere
        Mach and Knudsen numbers.
    speed : (N,) array
        m/s.
    velocity_body : (N, 3) array
        Air-relative, any scale.
    x_over_d : float
        Centre of mass behind the nose, diameters.
    alpha_sigma : (N,) array or float
        One sigma of the air's direction in each plane, rad.
    offset : tuple of float
        Centre of mass right of the axis (+y) and below it (+z), diameters.
    """
    ok = atmosphere.valid
    u, v, w = velocity_body[ok].T
    total = np.arctan2(np.hypot(v, w), u)
    arguments = atmosphere.mach[ok], atmosphere.knudsen[ok]
    found = database.lookup(*arguments, total, speed[ok])
    cm = found.cm_at(x_over_d)
    cn, cy, pitch_nose, yaw_nose = split(found.cn, found.cm_nose, v, w)
    roll, pitch, yaw = moments_at_cm((found.ca, cy, cn), (0.0, pitch_nose, yaw_nose), (x_over_d, *offset))
    above = database.lookup(*arguments, total + _STEP, speed[ok])
    # a coefficient turns with the plane by C/alpha, and grows in it by its slope: the larger of the two bounds it
    safe = np.maximum(total, _STEP)
    force_slope = np.maximum(np.abs(above.cn - found.cn) / _STEP, np.abs(found.cn) / safe)
    moment_slope = np.maximum(np.abs(above.cm_at(x_over_d) - cm) / _STEP, np.abs(cm) / safe)
    sigma = np.broadcast_to(np.asarray(alpha_sigma, float), speed.shape)[ok]
    limits = found.three_sigma

    def full(values: Array) -> Array:
        return scatter(ok, values)

    aside, axial_slope = float(np.hypot(*offset)), np.abs(above.ca - found.ca) / _STEP
    by_force, by_moment = full(force_slope * sigma), full((moment_slope + aside * axial_slope) * sigma)
    force, moment = full(limits.cn), full(limits.cm)
    return DatabaseCoefficients(
        value={
            "CA": full(found.ca), "CN": full(cn), "CY": full(cy), "Cl": full(roll), "Cm": full(pitch), "Cn": full(yaw)
        },
        angle_sigma={
            "CA": full(axial_slope * sigma), "CN": by_force, "CY": by_force,
            "Cl": aside * by_force, "Cm": by_moment, "Cn": by_moment,
        },
        three_sigma={
            "CA": full(limits.ca), "CN": force, "CY": force, "Cl": full(limits.cl), "Cm": moment, "Cn": moment
        },
        outside=scatter(ok, found.outside, False),
    )  # fmt: skip


def from_forces(
    database: Database,
    atmosphere: FlightAtmosphere,
    flight: FlightCoefficients,
    speed: Array,
    velocity_body: Array,
    x_over_d: float,
    stride: int = 1,
    offset: tuple[float, float] = (0.0, 0.0),
) -> Combination:
    """Forces → angles → moments: the lateral flow lies along (−CY, CN).

    Every `stride`-th sample is asked, and the others lie on straight lines between (NaN beside a sample without
    solution); `stride_of` says how many a smoothed series allows.
    """
    toward = np.stack((-flight.value["CY"], flight.value["CN"]), axis=1)
    return _combine(database, atmosphere, flight, toward, speed, velocity_body, x_over_d, stride, offset, forces=True)


def from_moments(
    database: Database,
    atmosphere: FlightAtmosphere,
    flight: FlightCoefficients,
    speed: Array,
    velocity_body: Array,
    x_over_d: float,
    stride: int = 1,
    offset: tuple[float, float] = (0.0, 0.0),
) -> Combination:
    """Moments → angles → forces: the lateral flow lies along (Cn, −Cm) if the body is stable, against it if not.

    As `from_forces`. The search covers both directions; of several solutions the one nearest to the reconstructed angle
    is taken. What a centre of mass beside the axis adds (``z CA``, ``−y CA``) is taken off first, with CA of the
    reconstructed angle and then of the angle found.
    """
    y, z = offset
    axial, ok = atmosphere.ca.copy(), atmosphere.valid
    for _ in range(_PASSES if y or z else 1):
        toward = np.stack((flight.value["Cn"] + y * axial, z * axial - flight.value["Cm"]), axis=1)
        found = _combine(
            database, atmosphere, flight, toward, speed, velocity_body, x_over_d, stride, offset, forces=False
        )
        there = ok & np.isfinite(found.alpha_total)
        mach, knudsen = atmosphere.mach[there], atmosphere.knudsen[there]
        if y or z:
            axial[there] = database.lookup(mach, knudsen, found.alpha_total[there], speed[there]).ca
    return found


def stride_of(points: NDArray[np.int64]) -> int:
    """Stride that leaves 35 samples in the shortest smoothing batch: no change of the smoothed series is lost."""
    return max(1, int(points.min()) // _SAMPLES)


def angle_differences(
    alpha: Array, beta: Array, forces: Combination, moments: Combination, sigma: Array
) -> AngleDifferences:
    """Eqs. 8.1 to 8.3 in both planes; `sigma` is the reconstructed angle's in a plane, rad."""
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


def _combine(
    database: Database,
    atmosphere: FlightAtmosphere,
    flight: FlightCoefficients,
    toward: Array,
    speed: Array,
    velocity_body: Array,
    x_over_d: float,
    stride: int,
    offset: tuple[float, float],
    *,
    forces: bool,
) -> Combination:
    asked_at = np.flatnonzero(atmosphere.valid & np.all(np.isfinite(toward), axis=1))
    ok = asked_at[::stride]
    mach, knudsen, fast = atmosphere.mach[ok], atmosphere.knudsen[ok], speed[ok]
    u, v, w = velocity_body[ok].T
    size = np.linalg.norm(toward[ok], axis=1)
    east, down = (toward[ok] / np.where(size > 0.0, size, 1.0)[:, None]).T
    # reconstructed angle in the plane that the flight's coefficient shows
    hint = np.arctan2(v * east + w * down, u)
    found: InverseResult
    if forces:
        found = angle_from_cn(database, size, mach, knudsen, fast, hint=hint)
    else:
        found = angle_from_cm(database, -size, mach, knudsen, fast, x_over_d=x_over_d, hint=hint)
    angle = found.alpha
    sideways, along = np.sin(angle) * east, np.sin(angle) * down
    known = np.isfinite(angle)
    value = {k: np.full(len(angle), np.nan) for k in (("Cm", "Cn") if forces else ("CN", "CY"))}
    passed = np.full(len(angle), np.nan)
    unsure = np.full(len(angle), np.nan)
    turned = np.full(len(angle), np.nan)
    if known.any():
        arguments, total = (mach[known], knudsen[known]), np.abs(angle[known])
        there = database.lookup(*arguments, total, fast[known])
        above = database.lookup(*arguments, total + _STEP, fast[known])
        cm, cm_above = there.cm_at(x_over_d), above.cm_at(x_over_d)
        parts = split(there.cn, cm, sideways[known], along[known])
        y, z = offset
        moments = parts[2] + z * there.ca, parts[3] - y * there.ca
        for name, part in zip(value, moments if forces else parts[:2], strict=True):
            value[name][known] = part
        slopes = np.abs(np.stack((above.cn - there.cn, cm_above - cm))) / _STEP
        into, passed[known] = slopes if forces else slopes[::-1]
        unsure[known] = 1.0 / np.maximum(into, 1e-12)
        # an error across the coefficient turns the plane, by itself over the coefficient, and the angle with it;
        # where the curve folds, the slope at the angle found does not tell how flat it is on the way there
        at_hint = database.lookup(*arguments, np.abs(hint[known]), fast[known])
        expected = np.sign(hint[known]) * (at_hint.cn if forces else at_hint.cm_at(x_over_d))
        rise = np.abs(expected - (1.0 if forces else -1.0) * size[known])
        way = np.abs(hint[known] - angle[known])
        folded = np.where(way > _STEP, way / np.maximum(rise, 1e-12), 0.0)
        turned[known] = np.maximum(total / np.maximum(size[known], 1e-12), folded)
    pair = ("CN", "CY") if forces else ("Cm", "Cn")

    def full(values: Array) -> Array:
        out = np.full(len(speed), np.nan)
        out[asked_at] = values if stride == 1 or not len(ok) else np.interp(asked_at, ok, values)
        return out

    def sigma(of: dict[str, Array]) -> tuple[Array, Array]:
        """Of the other coefficients, and of the angle."""
        one = np.sqrt(0.5 * (of[pair[0]][ok] ** 2 + of[pair[1]][ok] ** 2))
        angle = np.minimum(one * np.maximum(unsure, turned), _UNKNOWN)
        return full(passed * np.minimum(one * unsure, _UNKNOWN)), full(angle)

    noise, angle_noise = sigma(flight.noise)
    systematic, angle_systematic = sigma(flight.systematic)
    status = np.full(len(speed), -1, np.int8)
    status[asked_at] = np.repeat(found.status, stride)[: len(asked_at)]
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


def scatter(ok: NDArray[np.bool_], values: NDArray, fill: float = np.nan) -> NDArray:
    """Values where `ok`, `fill` elsewhere."""
    out = np.full((len(ok), *values.shape[1:]), fill, dtype=values.dtype)
    out[ok] = values
    return out
