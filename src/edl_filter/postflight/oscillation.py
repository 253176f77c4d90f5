"""Stiffness and damping of the oscillation in angle, window by window.

A body-fixed torque changes the angle about which the vehicle oscillates; it does not change the amplitude. The
amplitude grows or decays by a moment in phase with the *rates*. Over a window of a few periods

    Cm(t) =  (Cm_alpha + a tau) alpha(t) + Cmq q(t) D / 2V + m(t),
    Cn(t) = -(Cm_alpha + a tau) beta(t)  + Cmq r(t) D / 2V + n(t)

with one slope, which may change linearly along the window (tau runs from -1 to 1), and one damping for both planes (an
axisymmetric vehicle), and a parabola ``m``, ``n`` each for everything that varies slowly: trim, body-fixed torques,
wind, a small error of the attitude. For an oscillation of constant frequency ``Cmq`` is what aerodynamicists call Cmq +
Cm_alpha-dot. The relative growth rate of the amplitude is ``Cmq q S D² / (4 V I)`` (``q`` there the dynamic pressure).

In: the flight's coefficients, and angles and rates after the same sampling and smoothing (`BatchSmoother`). Out: one
row per window. Sigmas are computed from the residuals, whose correlation in time is taken as first-order autoregressive
and estimated from their lag-one product, corrected for the degrees of freedom of the fit. A slope that depends on the
angle, or varies nonlinearly within the window, biases the damping by more than its sigma: on simulated flights by up to
0.05 at Mach 9 to 12 and 0.15 at Mach 20 to 23, below Mach 5 by less than 0.01.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from edl_filter.aero.conventions import reference_area
from edl_filter.estimation.series import finite_rows
from edl_filter.types import Array

#: Length of a window and distance between two, s.
_WIDTH, _STEP = 8.0, 4.0
#: Least number of periods in a window: with fewer, trim and oscillation cannot be separated.
_PERIODS = 1.5
#: Least number of samples in a window, for a fit of nine parameters.
_LEAST = 12
#: Least distance between samples that are used, s: data smoothed over 0.875 s have no more information.
_CLOSEST = 0.25
#: Largest lag-one correlation, and number of bisections in its estimation.
_MOST_CORRELATED, _HALVINGS = 0.97, 8


@dataclass(frozen=True)
class Oscillation:
    """One row per window, ``(K,)`` each; NaN where the window has too few periods or samples.

    Attributes
    ----------
    time : array
        The window's middle, s.
    stiffness, stiffness_sigma : array
        Cm_alpha, 1/rad; negative where the vehicle is stable.
    damping, damping_sigma : array
        Cmq, moment coefficient over rate D / 2V; positive where it amplifies the oscillation.
    growth, growth_sigma : array
        Relative growth rate of the amplitude at constant dynamic pressure, 1/s.
    rate : array
        RMS of the lateral rates about their parabola, rad/s.
    """

    time: Array
    stiffness: Array
    stiffness_sigma: Array
    damping: Array
    damping_sigma: Array
    growth: Array
    growth_sigma: Array
    rate: Array


def oscillation(
    time: Array,
    angles: Array,
    rates: Array,
    moments: Array,
    speed: Array,
    pressure: Array,
    diameter: float,
    inertia: Array | float,
) -> Oscillation:
    """Stiffness and damping along the flight.

    Parameters
    ----------
    time : (N,) array
        s.
    angles : (N, 2) array
        Angle of attack and sideslip, rad.
    rates : (N, 2) array
        About body y and z, rad/s.
    moments : (N, 2) array
        Cm and Cn at the centre of mass; NaN where they are not defined.
    speed, pressure : (N,) arrays
        Air-relative speed, m/s; dynamic pressure, Pa.
    diameter : float
        m.
    inertia : float or (N,) array
        Mean of the lateral moments of inertia, kg m².

    Returns
    -------
    Oscillation
    """
    usable = finite_rows(moments) & np.isfinite(pressure)
    usable &= np.arange(len(time)) % max(1, round(_CLOSEST / float(np.median(np.diff(time))))) == 0
    first, last = (time[usable][0], time[usable][-1]) if usable.any() else (0.0, 0.0)
    middles = np.arange(first + 0.5 * _WIDTH, last - 0.5 * _WIDTH, _STEP)
    rows, lateral = np.full((len(middles), 7), np.nan), np.broadcast_to(inertia, time.shape)
    for k, middle in enumerate(middles):
        part = usable & (np.abs(time - middle) <= 0.5 * _WIDTH)
        if np.count_nonzero(part) < _LEAST:
            continue
        tau = (time[part] - middle) / (0.5 * _WIDTH)
        half_span = 0.5 * diameter / speed[part]
        fit = _fit(tau, angles[part], rates[part], moments[part], half_span)
        load = float(np.mean(pressure[part]) / np.mean(lateral[part])) * reference_area(diameter) * diameter
        if fit is None or np.sqrt(max(-fit[0][0] * load, 0.0)) * _WIDTH < 2.0 * np.pi * _PERIODS:
            continue
        value, sigma, rate_rms = fit
        growth = 0.5 * load * float(np.mean(half_span))
        rows[k] = value[0], sigma[0], value[1], sigma[1], growth * value[1], growth * sigma[1], rate_rms
    return Oscillation(middles, *rows.T)


def _fit(
    tau: Array, angles: Array, rates: Array, moments: Array, half_span: Array
) -> tuple[Array, Array, float] | None:
    """Slope and damping ``(2,)``, their sigmas ``(2,)`` and the RMS of the oscillating rates of one window.

    None where nothing oscillates.
    """
    slow, _ = np.linalg.qr(np.vander(tau, 3))

    def detrended(values: Array) -> Array:
        return values - slow @ (slow.T @ values)

    signed = angles * (1.0, -1.0)
    columns = [detrended(v) for v in (signed, rates * half_span[:, None], tau[:, None] * signed)]
    design = np.column_stack([np.concatenate(c.T) for c in columns])  # one plane below the other
    if np.linalg.matrix_rank(design) < design.shape[1]:
        return None
    value, *_ = np.linalg.lstsq(design, np.concatenate(detrended(moments).T), rcond=None)
    residuals = np.concatenate(detrended(moments).T) - design @ value
    both = np.block([[slow, np.zeros_like(slow)], [np.zeros_like(slow), slow]])
    sigma = np.sqrt(np.diag(_covariance(residuals, design, both)))
    return np.asarray(value[:2]), sigma[:2], float(np.sqrt(np.mean(np.sum(detrended(rates) ** 2, axis=1))))


def _covariance(residuals: Array, design: Array, slow: Array) -> Array:
    """Covariance ``(p, p)`` of a least-squares fit in two planes whose errors are first-order autoregressive.

    Parameters
    ----------
    residuals : (2n,) array
        Of the fit, one plane after the other.
    design : (2n, p) array
        Detrended columns.
    slow : (2n, s) array
        Orthonormal columns of the trend, which are fitted too.
    """
    count = len(residuals) // 2
    apart = np.abs(np.subtract.outer(np.arange(count), np.arange(count)))
    fitted, _ = np.linalg.qr(np.column_stack((slow, design)))

    def planes(matrix: Array, values: Array) -> Array:
        return np.concatenate((matrix @ values[:count], matrix @ values[count:]))

    neighbours = 0.5 * (apart == 1)
    near = planes(neighbours, fitted)

    def expected(rho: float) -> tuple[float, float]:
        """Expected sum of squares, and of lag-one products, of the residuals of errors of unit variance."""
        spread = planes(rho**apart, fitted)
        absorbed = fitted.T @ spread
        return 2.0 * count - float(np.trace(absorbed)), (
            2.0 * (count - 1) * rho - 2.0 * float(np.sum(near * spread)) + float(np.sum((fitted.T @ near) * absorbed))
        )

    square = float(residuals @ residuals)
    lag_one = float(residuals @ planes(neighbours, residuals)) / max(square, np.finfo(float).tiny)
    low, high = 0.0, _MOST_CORRELATED
    for _ in range(_HALVINGS):
        rho = 0.5 * (low + high)
        squares, products = expected(rho)
        low, high = (rho, high) if products < lag_one * squares else (low, rho)
    inverse = np.linalg.inv(design.T @ design)
    middle = design.T @ planes(rho**apart, design)
    return square / expected(rho)[0] * inverse @ middle @ inverse
