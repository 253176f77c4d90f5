"""Density, pressure and temperature extracted from the flight (thesis section 4.1), with bands.

Density follows from the axial force and the database's CA, which hangs on Mach and Knudsen number and so on density and
pressure: all are iterated together.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from edl_filter.aero.database import Database
from edl_filter.errors import InputError
from edl_filter.postflight.atmosphere import FlightAtmosphere
from edl_filter.postflight.gas import Gas

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

_TOLERANCE = 1e-8
_MOST_ITERATIONS = 60
#: Step of the angle, rad, and relative one of the speed for the slopes of CA.
_STEP = 1e-3
#: No air is colder or hotter (K): keeps the Mach number finite where the pressure begins at zero.
_COLDEST, _HOTTEST = 20.0, 2000.0
#: Fall of density over which the density at the top is fitted: one scale height.
_FIT_FALL = np.e


@dataclass(frozen=True)
class AxialForce:
    """What the axial accelerometer says, and what else goes into density.

    Attributes
    ----------
    acceleration : (N,) array
        Smoothed axial specific force at the centre of mass, m/s²; drag is negative.
    noise : (N,) array
        Its one sigma after smoothing, m/s².
    noise_raw : (N,) array
        The same before smoothing: the independent part of one sample.
    bias_sigma : float or (N,) array
        m/s², constant in flight.
    mass : float or (N,) array
        kg.
    mass_sigma : float
        kg.
    """

    acceleration: Array
    noise: Array
    noise_raw: Array
    bias_sigma: ArrayLike
    mass: ArrayLike
    mass_sigma: float = 0.0


def flight_extracted(
    time: Array,
    altitude: Array,
    speed: Array,
    alpha_total: Array,
    gravity: Array,
    axial: AxialForce,
    valid: Bools,
    database: Database,
    gas: Gas,
    diameter: float,
    *,
    speed_sigma: ArrayLike = 0.0,
    wind_sigma: ArrayLike = 0.0,
    sink_sigma: ArrayLike = 0.0,
    angle_sigma: ArrayLike = 0.0,
    top_temperature: float | None = None,
    top_temperature_sigma: float = 0.0,
) -> FlightAtmosphere:
    """Density ``ρ = -2 m a_x/(CA S V²)`` (eq. 4.1), pressure ``∫ρ g dh`` (eq. 4.2), temperature ``p/(ρ R)``.

    Parameters
    ----------
    time, altitude, speed, alpha_total : (N,) arrays
        s, m, m/s, rad.
    gravity : (N,) array
        Along the local vertical, m/s².
    axial : AxialForce
    valid : (N,) array of bool
        Where the acceleration is above its threshold; one stretch is used, from the first to the last.
    database : Database
    gas : Gas
    diameter : float
        m.
    speed_sigma : float or (N,) array
        From the smoother, m/s; taken as common to the whole flight.
    wind_sigma : float or (N,) array
        What the wind may add to the speed, m/s; common to the flight.
    sink_sigma : float or (N,) array
        Of the vertical velocity, m/s, common to the flight: an error of the altitude that stays the same changes no
        pressure, one that grows does.
    angle_sigma : float or (N,) array
        Of the angle, rad, common to the flight: CA is looked up with it.
    top_temperature, top_temperature_sigma : float, optional
        K: the air above the first valid sample is isothermal. None: the pressure begins at zero there.

    Returns
    -------
    FlightAtmosphere

    Raises
    ------
    InputError
        Nothing is valid, the axial force does not decelerate in it, or the iteration does not settle.

    Notes
    -----
    Where the database steps (regimes that switch) a sample may have no solution: its density with either side's CA asks
    for the other side. It takes the mean of the two, if they differ by less than CA's own 3 sigma.

    Pressure is integrated in altitude along the trajectory with the logarithmic mean of ρg between samples, exact for
    an exponential atmosphere and the trapezoid rule otherwise to second order. The density at the top is that of a
    log-linear fit over the first scale height, so that one noisy sample does not set the boundary.

    Bands are linear. Density: noise, bias, CA (a third of the database's 3 sigma, and what the angle's error changes in
    it), mass, speed and wind (squared, and in the Mach number of CA), added in quadrature; that CA itself moves with
    density and temperature is left out (``dlnCA/dlnρ`` below 0.05). All but noise are each taken as one error common to
    all altitudes and carried through the integral with their sign; noise adds independently from sample to sample. In
    temperature the common relative errors cancel between p and ρ. The height fallen through has the error of the
    vertical velocity, in p and T alone.
    """
    inside = np.flatnonzero(valid)
    if not inside.size:
        raise InputError(
            "Density: the axial acceleration never rises above its threshold; there is nothing to derive from."
        )
    part = slice(int(inside[0]), int(inside[-1]) + 1)
    area = np.pi / 4.0 * diameter**2
    mass = np.broadcast_to(np.asarray(axial.mass, float), time.shape)[part]
    force, v, h = -axial.acceleration[part], speed[part], altitude[part]
    bad = np.flatnonzero(~(force > 0.0))
    if bad.size:
        raise InputError(
            f"Density: the axial specific force at {time[part][bad[0]]:.6g} s is {-force[bad[0]]:.4g} m/s^2; "
            "it must be negative (a deceleration) throughout the valid stretch."
        )
    product = 2.0 * mass * force / (area * v**2)  # density times CA
    weight = gravity[part]
    temperature = np.full(len(h), 200.0 if top_temperature is None else top_temperature)
    density = product / 1.7
    ca = np.full((3, len(h)), np.nan)  # of this iteration, the last and the one before
    held = np.full(len(h), np.nan)
    for count in range(1, _MOST_ITERATIONS + 1):
        mach, knudsen = gas.mach(v, temperature), gas.knudsen(density, diameter)
        found = database.lookup(mach, knudsen, alpha_total[part], v)
        ca = np.stack((found.ca, ca[0], ca[1]))
        held = np.where(np.isnan(held), _between_sides(ca, found.three_sigma.ca), held)
        new = product / np.where(np.isnan(held), found.ca, held)
        top = top_density(h, new)
        start = 0.0 if top_temperature is None else top * gas.constant * top_temperature
        pressure = start + _running_integral(h, new * weight)
        warm = np.clip(gas.temperature(pressure, new), _COLDEST, _HOTTEST)
        change = np.max(np.abs(new - density) / new)
        settled = change < _TOLERANCE and np.max(np.abs(warm - temperature) / warm) < _TOLERANCE
        density, temperature = new, warm
        if settled:
            iterations = count
            break
    else:
        raise InputError(
            f"Density: {_MOST_ITERATIONS} iterations on CA leave a change of {change:.2g}; check the database."
        )

    def along(values: ArrayLike) -> Array:
        return np.broadcast_to(np.asarray(values, float), time.shape)[part]

    turned = database.lookup(mach, knudsen, alpha_total[part] + _STEP, v)
    faster = database.lookup(mach * (1.0 + _STEP), knudsen, alpha_total[part], v * (1.0 + _STEP))
    steeper = (faster.ca / found.ca - 1.0) / _STEP  # a wrong speed is a wrong Mach number too
    relative = {
        "noise": axial.noise[part] / force,
        "bias": along(axial.bias_sigma) / force,
        "ca": found.three_sigma.ca / 3.0 / found.ca,
        "mass": axial.mass_sigma / mass,
        "speed": -(2.0 + steeper) * along(speed_sigma) / v,
        "wind": -(2.0 + steeper) * along(wind_sigma) / v,
        "angle": (found.ca - turned.ca) / _STEP * along(angle_sigma) / found.ca,
    }
    shared = [name for name in relative if name != "noise"]
    step = _running_integral(h, density * weight, total=False)
    raw = axial.noise_raw[part] / force
    fitted = np.zeros(len(h))
    weights = top_weights(h, density)
    fitted[: len(weights)] = start * weights
    # a sample's noise is in the density at the top, and below the sample in the integral as well
    above, below = np.cumsum(((fitted + step) * raw) ** 2), np.cumsum((fitted * raw) ** 2)
    p_noise = np.sqrt(above + below[-1] - below)
    p_common, t_common = np.zeros(len(h)), (p_noise / pressure_or_one(pressure)) ** 2 + relative["noise"] ** 2
    for name in shared:
        moved = fitted @ relative[name] + _running_integral(h, density * weight * relative[name])
        p_common += moved**2
        if name == "angle":  # fixed in space, it comes and goes in alpha_total as the body rolls: nothing cancels
            t_common += (moved / pressure_or_one(pressure)) ** 2 + relative[name] ** 2
        else:
            t_common += (moved / pressure_or_one(pressure) - relative[name]) ** 2
    fallen = _running_integral(-time[part], density * weight * along(sink_sigma))
    p_common += fallen**2
    t_common += (fallen / pressure_or_one(pressure)) ** 2
    if top_temperature is not None:
        edge = top * gas.constant * top_temperature_sigma
        p_common += edge**2
        t_common += (edge / pressure_or_one(pressure)) ** 2
    common = np.sqrt(sum(relative[k] ** 2 for k in shared))
    force_scale = np.stack((relative["noise"], np.hypot(relative["bias"], relative["ca"])), axis=1)
    moment_scale = force_scale.copy()
    moment_scale[:, 1] = np.hypot(moment_scale[:, 1], relative["mass"])

    def full(values: Array) -> Array:
        out = np.full((len(time), *values.shape[1:]), np.nan)
        out[part] = values
        return out

    whole = np.zeros(len(time), bool)
    whole[part] = True
    return FlightAtmosphere(
        time=time,
        altitude=altitude,
        density=full(density),
        pressure=full(pressure),
        temperature=full(temperature),
        mach=full(gas.mach(v, temperature)),
        knudsen=full(gas.knudsen(density, diameter)),
        ca=full(found.ca),
        ca_sigma=full(found.three_sigma.ca / 3.0),
        iterations=iterations,
        valid=whole,
        density_sigma=full(density * np.hypot(common, relative["noise"])),
        pressure_sigma=full(np.sqrt(p_noise**2 + p_common)),
        temperature_sigma=full(temperature * np.sqrt(t_common)),
        density_noise=full(density * relative["noise"]),
        force_scale=full(force_scale),
        moment_scale=full(moment_scale),
    )


def top_density(altitude: Array, density: Array) -> float:
    """Density at the first sample by a log-linear fit over the first scale height (three samples at least)."""
    weights = top_weights(altitude, density)
    return float(np.exp(weights @ np.log(density[: len(weights)])))


def top_weights(altitude: Array, density: Array) -> Array:
    """Weights of the first samples' logarithms in that fit, ``(n,)``: so their relative errors reach the top's."""
    deep = np.flatnonzero(density > _FIT_FALL * density[0])
    n = min(len(density), max(3, int(deep[0]) if deep.size else len(density)))
    h = altitude[:n] - altitude[0]
    if np.ptp(h) == 0.0:
        return np.full(n, 1.0 / n)
    return np.linalg.pinv(np.stack((np.ones(n), h / np.ptp(h)), axis=1))[0]


def pressure_or_one(pressure: Array) -> Array:
    """Pressure to divide by: infinite where it begins at zero, so that nothing relative is said there."""
    return np.where(pressure > 0.0, pressure, np.inf)


def _running_integral(altitude: Array, weight: Array, total: bool = True) -> Array:
    """Integral of `weight` downwards from the first sample, ``(N,)``; or, not `total`, each step's share."""
    a, b = weight[:-1], weight[1:]
    ratio = np.divide(b, a, out=np.ones_like(a), where=(a != 0.0) & (a * b > 0.0))
    curved = np.abs(ratio - 1.0) > 1e-4
    log = np.log(ratio, out=np.ones_like(a), where=curved)
    mean = np.where(curved & (a * b > 0.0), (b - a) / log, 0.5 * (a + b))
    steps = np.concatenate(([0.0], -np.diff(altitude) * mean))
    return np.cumsum(steps) if total else steps


def _between_sides(ca: Array, three_sigma: Array) -> Array:
    """Mean of the two CA between which a sample alternates in the iteration, ``(3, N)`` latest first; nan elsewhere."""
    latest, last, before = ca
    apart = np.abs(latest - last)
    alternates = (apart > _TOLERANCE * latest) & (np.abs(latest - before) < 0.01 * apart) & (apart < three_sigma)
    return np.where(alternates, 0.5 * (latest + last), np.nan)
