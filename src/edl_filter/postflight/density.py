"""Density, pressure and temperature extracted from the flight (thesis section 4.1), with bands.

Density follows from the axial force and the database's CA, which depends on Mach and Knudsen number and so on density
and pressure: all are iterated together. The force is that of the sensor's means after smoothing, which attenuates an
oscillation; the predicted force goes through the same operations.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from edl_filter.aero.conventions import reference_area
from edl_filter.aero.database import Database
from edl_filter.aero.discrepancy import DiscrepancyPrior
from edl_filter.errors import InputError
from edl_filter.planet.gas import Gas
from edl_filter.postflight.atmosphere import AtmosphereProfile, scatter
from edl_filter.postflight.rates import BatchSmoother
from edl_filter.types import Array, BoolArray

_TOLERANCE = 1e-8
_MOST_ITERATIONS = 60
#: Most iterations after which a sample at a step of the database returns to a CA.
_LONGEST_CYCLE = 4
#: Step of the angle, rad, and relative one of the speed for the slopes of CA.
_STEP = 1e-3
#: Bounds of the temperature (K), which keep the Mach number finite where the pressure begins at zero.
_COLDEST, _HOTTEST = 20.0, 2000.0
#: Ratio of densities over which the density at the top is fitted: one scale height.
_FIT_RATIO = math.e


@dataclass(frozen=True)
class AxialForce:
    """Axial specific force and mass, from which the density is computed, with their uncertainties.

    Attributes
    ----------
    acceleration : (N,) array
        Smoothed axial specific force at the centre of mass, m/s²; drag is negative.
    noise : (N,) array
        One sigma of the noise after smoothing, m/s².
    noise_raw : (N,) array
        The same before smoothing, which is independent from sample to sample.
    bias_sigma : float or (N,) array
        One sigma of the bias, which is constant in flight, m/s².
    mass : float or (N,) array
        kg.
    mass_sigma : float
        One sigma of the mass, kg.
    smoother : BatchSmoother, optional
        With which the force was smoothed. None: the force is that at the middles of the samples.
    """

    acceleration: Array
    noise: Array
    noise_raw: Array
    bias_sigma: ArrayLike
    mass: ArrayLike
    mass_sigma: float = 0.0
    smoother: BatchSmoother | None = None

    def mean_coefficient(self, coefficient: Array, load: Array, part: slice) -> Array:
        """Coefficient ``(n,)`` of the smoothed force, of one at the middles of the samples in `part`.

        That of the force in proportion to the `load` ``(n,)``, after the sensor's means and smoothing. Beyond the part
        the coefficient is taken as constant.
        """
        if self.smoother is None:
            return coefficient
        before, after = part.start, len(self.acceleration) - part.stop
        both = np.stack((load * coefficient, load), axis=1)
        force, smooth = self.smoother.as_smoothed(np.pad(both, ((before, after), (0, 0)), mode="edge"))[part].T
        return np.asarray(force / smooth)


def extract_atmosphere(
    time: Array,
    altitude: Array,
    speed: Array,
    alpha_total: Array,
    gravity: Array,
    geopotential: Array,
    axial: AxialForce,
    valid: BoolArray,
    database: Database,
    gas: Gas,
    diameter: float,
    *,
    discrepancy: DiscrepancyPrior,
    speed_sigma: ArrayLike = 0.0,
    wind_sigma: ArrayLike = 0.0,
    sink_sigma: ArrayLike = 0.0,
    angle_sigma: ArrayLike = 0.0,
    top_temperature: float | None = None,
    top_temperature_sigma: float = 0.0,
) -> AtmosphereProfile:
    """Density ``ρ = -2 m a_x/(CA S V²)`` (eq. 4.1), pressure ``∫ρ dW`` (eq. 4.2), temperature ``p/(ρ R)``.

    Parameters
    ----------
    time, altitude, speed, alpha_total : (N,) arrays
        s, m, m/s, rad.
    gravity : (N,) array
        Apparent gravity (with the centrifugal acceleration of the air) along the local vertical, m/s²: it turns errors
        of the vertical velocity into errors of the pressure.
    geopotential : (N,) array
        Potential W of the apparent gravity, m²/s², growing upwards (`Planet.geopotential`): the weight of the air.
    axial : AxialForce
        Of the same samples.
    valid : (N,) array of bool
        Samples at which the acceleration is above its threshold; all from the first to the last of them are used.
    database : Database
        Its CA is looked up.
    gas : Gas
        Of the atmosphere.
    diameter : float
        m.
    discrepancy : DiscrepancyPrior
        Correlation of the error of CA over the flow. Its scale is that of the database's own sigma, whatever
        `DiscrepancyPrior.scale` says.
    speed_sigma : float or (N,) array
        One sigma of the speed from the smoother, m/s; taken as common to the whole flight.
    wind_sigma : float or (N,) array
        One sigma of the wind's component along the speed, m/s; common to the flight.
    sink_sigma : float or (N,) array
        One sigma of the vertical velocity, m/s; common to the flight. (A constant error of the altitude does not change
        the pressure, one that grows does.)
    angle_sigma : float or (N,) array
        One sigma of the angle at which CA is looked up, rad; common to the flight.
    top_temperature : float, optional
        K: the air above the first valid sample is isothermal. None: the pressure begins at zero there.
    top_temperature_sigma : float
        One sigma of it, K.

    Returns
    -------
    AtmosphereProfile

    Raises
    ------
    InputError
        No sample is valid, the axial force is not a deceleration in all of them, or the iteration does not converge.

    Notes
    -----
    Where the database has a step (regimes that switch) a sample may have no solution: with the CA of either side its
    density lies on the other side, and the iteration goes through both sides in a cycle, which need not have one value
    on each. The sample takes the mean of the two sides, if they differ by less than CA's own 3 sigma.

    The air is taken to rotate with the planet and to be in equilibrium with gravitation and centrifugal acceleration,
    so that its pressure depends on the geopotential alone and the slant of the trajectory has no effect (eq. 4.2 has
    ``g dh`` in place of ``dW``). Pressure is integrated in the geopotential along the trajectory with the logarithmic
    mean of ρ between samples, exact for an isothermal atmosphere and the trapezoid rule otherwise to second order. The
    density at the top is that of a fit over the first scale height that is log-linear in the geopotential, so that one
    noisy sample does not determine the boundary.

    Bands are linear. Density: noise, bias, CA (a third of the database's 3 sigma, and its change by the error of the
    angle), mass, speed and wind (squared, and in the Mach number of CA), added in quadrature; the change of CA by
    density and temperature is neglected (``dlnCA/dlnρ`` below 0.05). Each error except noise is taken as one error
    common to all altitudes and propagated through the integral with its sign; noise adds independently from sample to
    sample. In temperature the common relative errors cancel between p and ρ. The error of CA is a field over Mach or
    Knudsen number and angle (`DiscrepancyPrior.axial_errors`): it cancels as far as it is the same where the air above
    was measured. The descent between samples has the error of the vertical velocity, in p and T alone.
    """
    inside = np.flatnonzero(valid)
    if not inside.size:
        raise InputError(
            "Density: the axial acceleration never rises above its threshold; there is nothing to derive from."
        )
    part = slice(int(inside[0]), int(inside[-1]) + 1)
    area = reference_area(diameter)
    mass = np.broadcast_to(np.asarray(axial.mass, float), time.shape)[part]
    force, v, level = -axial.acceleration[part], speed[part], geopotential[part]
    invalid = np.flatnonzero(~(force > 0.0))
    if invalid.size:
        raise InputError(
            f"Density: the axial specific force at {time[part][invalid[0]]:.6g} s is {-force[invalid[0]]:.4g} m/s^2; "
            "it must be negative (a deceleration) throughout the valid stretch."
        )
    product = 2.0 * mass * force / (area * v**2)  # density times CA
    temperature = np.full(len(v), 200.0 if top_temperature is None else top_temperature)
    density = product / 1.7
    ca = np.full((2 * _LONGEST_CYCLE, len(v)), np.nan)  # of this iteration and those before, latest first
    fixed_ca = np.full(len(v), np.nan)  # CA of samples at a step of the database
    for count in range(1, _MOST_ITERATIONS + 1):
        mach, knudsen = gas.mach(v, temperature), gas.knudsen(density, diameter)
        entry = database.lookup(mach, knudsen, alpha_total[part], v)
        ca = np.vstack((entry.ca, ca[:-1]))
        fixed_ca = np.where(np.isnan(fixed_ca), _mean_across_step(ca, entry.three_sigma.ca), fixed_ca)
        at_middle = np.where(np.isnan(fixed_ca), entry.ca, fixed_ca)
        new = product / axial.mean_coefficient(at_middle, density * v**2, part)
        top = top_density(level, new)
        start = 0.0 if top_temperature is None else top * gas.constant * top_temperature
        pressure = start + _running_integral(level, new)
        new_temperature = np.clip(gas.temperature(pressure, new), _COLDEST, _HOTTEST)
        change = np.max(np.abs(new - density) / new)
        temperature_change = np.max(np.abs(new_temperature - temperature) / new_temperature)
        density, temperature = new, new_temperature
        if change < _TOLERANCE and temperature_change < _TOLERANCE:
            iterations = count
            break
    else:
        raise InputError(
            f"Density: {_MOST_ITERATIONS} iterations on CA leave a change of {change:.2g}; check the database."
        )

    def along(values: ArrayLike) -> Array:
        return np.broadcast_to(np.asarray(values, float), time.shape)[part]

    at_angle = database.lookup(mach, knudsen, alpha_total[part] + _STEP, v)
    at_speed = database.lookup(mach * (1.0 + _STEP), knudsen, alpha_total[part], v * (1.0 + _STEP))
    by_speed = (at_speed.ca / entry.ca - 1.0) / _STEP  # an error of the speed is one of the Mach number too
    ca_relative = entry.three_sigma.ca / 3.0 / entry.ca
    field, over_angle = discrepancy.axial_errors(
        mach, knudsen, alpha_total[part], database.continuum_limit, database.join == "switch"
    )
    relative = {
        "noise": axial.noise[part] / force,
        "bias": along(axial.bias_sigma) / force,
        "mass": axial.mass_sigma / mass,
        "speed": -(2.0 + by_speed) * along(speed_sigma) / v,
        "wind": -(2.0 + by_speed) * along(wind_sigma) / v,
        "angle": (entry.ca - at_angle.ca) / _STEP * along(angle_sigma) / entry.ca,
    }
    step = _running_integral(level, density, total=False)
    raw = axial.noise_raw[part] / force
    fitted = np.zeros(len(v))
    weights = top_weights(level, density)
    fitted[: len(weights)] = start * weights
    # the noise of a sample is in the density at the top, and below the sample in the integral too
    above, below = np.cumsum(((fitted + step) * raw) ** 2), np.cumsum((fitted * raw) ** 2)
    p_noise = np.sqrt(above + below[-1] - below)
    # infinite where the pressure begins at zero: no relative error is defined there
    safe_pressure = np.where(pressure > 0.0, pressure, np.inf)
    p_common, t_common = np.zeros(len(v)), (p_noise / safe_pressure) ** 2 + relative["noise"] ** 2

    def of_pressure(errors: Array) -> Array:
        """Errors ``(K, N)`` of the pressure, Pa, by relative errors of the density."""
        return np.asarray((errors @ fitted)[:, None] + _running_integral(level, density * errors), float)

    # that of the angle is fixed in space and oscillates in alpha_total as the body rolls: nothing cancels
    by_angle = of_pressure(relative["angle"][None])[0]
    p_common += by_angle**2
    t_common += (by_angle / safe_pressure) ** 2 + relative["angle"] ** 2
    remaining = np.stack([relative[name] for name in relative if name not in ("noise", "angle")])
    for errors in (remaining, *(ca_relative * factor * over_angle for factor in field)):
        by_errors = of_pressure(errors)
        p_common += np.sum(by_errors**2, axis=0)
        t_common += np.sum((by_errors / safe_pressure - errors) ** 2, axis=0)
    by_descent = _running_integral(-time[part], density * gravity[part] * along(sink_sigma))
    p_common += by_descent**2
    t_common += (by_descent / safe_pressure) ** 2
    if top_temperature is not None:
        by_top = top * gas.constant * top_temperature_sigma
        p_common += by_top**2
        t_common += (by_top / safe_pressure) ** 2
    common = np.sqrt(ca_relative**2 + sum(relative[name] ** 2 for name in relative if name != "noise"))
    force_scale = np.stack((relative["noise"], np.hypot(relative["bias"], ca_relative)), axis=1)
    moment_scale = force_scale.copy()
    moment_scale[:, 1] = np.hypot(moment_scale[:, 1], relative["mass"])

    used = np.zeros(len(time), bool)
    used[part] = True

    def full(values: Array) -> Array:
        return scatter(used, values)

    return AtmosphereProfile(
        time=time,
        altitude=altitude,
        density=full(density),
        pressure=full(pressure),
        temperature=full(temperature),
        mach=full(gas.mach(v, temperature)),
        knudsen=full(gas.knudsen(density, diameter)),
        ca=full(entry.ca),
        ca_sigma=full(entry.three_sigma.ca / 3.0),
        iterations=iterations,
        valid=used,
        density_sigma=full(density * np.hypot(common, relative["noise"])),
        pressure_sigma=full(np.sqrt(p_noise**2 + p_common)),
        temperature_sigma=full(temperature * np.sqrt(t_common)),
        density_noise=full(density * relative["noise"]),
        force_scale=full(force_scale),
        moment_scale=full(moment_scale),
    )


def top_density(level: Array, density: Array) -> float:
    """Density at the first sample by a log-linear fit over the first scale height (three samples at least).

    Parameters
    ----------
    level, density : (N,) arrays
        Geopotential (m²/s²), in which an isothermal atmosphere is log-linear, from the top downwards; kg/m³.

    Returns
    -------
    float
        kg/m³.
    """
    weights = top_weights(level, density)
    return float(np.exp(weights @ np.log(density[: len(weights)])))


def top_weights(level: Array, density: Array) -> Array:
    """Weights of the first samples' log densities in the fit of `top_density`, ``(n,)``.

    The relative error of the density at the top is the weighted sum of the samples' relative errors.

    Parameters
    ----------
    level, density : (N,) arrays
        Geopotential (m²/s²), in which an isothermal atmosphere is log-linear, from the top downwards; kg/m³.

    Returns
    -------
    (n,) array
        n samples, those of the first scale height.
    """
    deep = np.flatnonzero(density > _FIT_RATIO * density[0])
    n = min(len(density), max(3, int(deep[0]) if deep.size else len(density)))
    x = level[:n] - level[0]
    if np.ptp(x) == 0.0:
        return np.full(n, 1.0 / n)
    return np.linalg.pinv(np.stack((np.ones(n), x / np.ptp(x)), axis=1))[0]


def _running_integral(level: Array, weight: Array, total: bool = True) -> Array:
    """Integral of `weight` ``(..., N)`` over falling `level` ``(N,)`` from the first sample; or that of each step."""
    a, b = weight[..., :-1], weight[..., 1:]
    ratio = np.divide(b, a, out=np.ones_like(a), where=(a != 0.0) & (a * b > 0.0))
    curved = np.abs(ratio - 1.0) > 1e-4
    log = np.log(ratio, out=np.ones_like(a), where=curved)
    mean = np.where(curved & (a * b > 0.0), (b - a) / log, 0.5 * (a + b))
    steps = np.concatenate((np.zeros_like(weight[..., :1]), -np.diff(level) * mean), axis=-1)
    return np.cumsum(steps, axis=-1) if total else steps


def _mean_across_step(ca: Array, three_sigma: Array) -> Array:
    """Mean of the extreme CA through which a sample goes in a cycle of the iteration; NaN where it is in none.

    `ca` is ``(2 K, N)``: those of the last iterations, latest first; cycles of two to K iterations are found. A cycle
    is gone through twice: a single return happens in a sequence that converges, too.
    """
    mean = np.full(ca.shape[1], np.nan)
    for period in range(2, len(ca) // 2 + 1):
        low, high = np.min(ca[:period], axis=0), np.max(ca[:period], axis=0)
        apart = high - low
        returns = np.all(np.abs(ca[:period] - ca[period : 2 * period]) < 0.01 * apart, axis=0)
        cycles = returns & (apart > _TOLERANCE * ca[0]) & (apart < three_sigma)
        mean = np.where(np.isnan(mean) & cycles, 0.5 * (low + high), mean)
    return mean
