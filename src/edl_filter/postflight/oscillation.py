"""Stiffness and damping of the oscillation, window by window: what feeds it and when.

A torque that is fixed to the body moves the angle about which the vehicle swings; it cannot make the swing grow.
What makes it grow or fade is a moment in phase with the *rates*. Over a window of a few swings

    Cm(t) =  (Cm_alpha + a tau) alpha(t) + Cmq q(t) D / 2V + m(t),
    Cn(t) = -(Cm_alpha + a tau) beta(t)  + Cmq r(t) D / 2V + n(t)

with one slope, which may change along the window (tau runs from -1 to 1), and one damping for both planes (an
axisymmetric vehicle), and a parabola ``m``, ``n`` each for all that is slow: trim, body-fixed torques, wind, an
attitude that is a little off. For a swing of constant frequency ``Cmq`` is what aerodynamicists call
Cmq + Cm_alpha-dot. The amplitude grows by ``Cmq q S D² / (4 V I)`` a second (``q`` there the dynamic pressure).

In: the flight's coefficients, and angles and rates that went through the same sampling and smoothing (`Smoother`).
Out: one row a window. Sigmas come from the residuals, whose correlation in time is taken as first-order autoregressive
and found from their lag-one product, with what the fit has taken from both. A slope that bends with the angle or within
the window biases the damping beyond them: on simulated flights by up to 0.05 at Mach 9 to 12 and 0.15 at Mach 20 to 23,
below Mach 5 by less than 0.01.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: Length of a window and distance between two, s.
_WIDTH, _STEP = 8.0, 4.0
#: A window must hold this many swings, or trim and swing cannot be told apart.
_SWINGS = 1.5
#: Fewer samples than this a window are not enough for nine numbers.
_LEAST = 12
#: Samples closer than this are thinned, s: what was smoothed over 0.875 s holds nothing more.
_CLOSEST = 0.25
#: Largest correlation of neighbours, and steps of the search for it.
_MOST_CORRELATED, _HALVINGS = 0.97, 8


@dataclass(frozen=True)
class Oscillation:
    """One row a window, ``(K,)`` each; NaN where the window holds too few swings or samples.

    Attributes
    ----------
    time : array
        The window's middle, s.
    stiffness, stiffness_sigma : array
        Cm_alpha, 1/rad; negative where the vehicle is stable.
    damping, damping_sigma : array
        Cmq, moment coefficient over rate D / 2V; positive where it feeds the oscillation.
    growth, growth_sigma : array
        Of the amplitude, 1/s, at constant dynamic pressure.
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
    inertia: float,
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
        Cm and Cn at the centre of mass; NaN where they are not known.
    speed, pressure : (N,) arrays
        m/s, Pa (dynamic).
    diameter, inertia : float
        m; kg m², mean of the lateral moments of inertia.

    Returns
    -------
    Oscillation
    """
    known = np.isfinite(moments).all(axis=1) & np.isfinite(pressure)
    known &= np.arange(len(time)) % max(1, round(_CLOSEST / float(np.median(np.diff(time))))) == 0
    first, last = (time[known][0], time[known][-1]) if known.any() else (0.0, 0.0)
    middles = np.arange(first + 0.5 * _WIDTH, last - 0.5 * _WIDTH, _STEP)
    rows = np.full((len(middles), 7), np.nan)
    for k, middle in enumerate(middles):
        part = known & (np.abs(time - middle) <= 0.5 * _WIDTH)
        if np.count_nonzero(part) < _LEAST:
            continue
        tau = (time[part] - middle) / (0.5 * _WIDTH)
        half_span = 0.5 * diameter / speed[part]
        found = _fit(tau, angles[part], rates[part], moments[part], half_span)
        load = float(np.mean(pressure[part])) * np.pi / 4.0 * diameter**3 / inertia
        if found is None or np.sqrt(max(-found[0][0] * load, 0.0)) * _WIDTH < 2.0 * np.pi * _SWINGS:
            continue
        value, sigma, swing = found
        growth = 0.5 * load * float(np.mean(half_span))
        rows[k] = value[0], sigma[0], value[1], sigma[1], growth * value[1], growth * sigma[1], swing
    return Oscillation(middles, *rows.T)


def _fit(
    tau: Array, angles: Array, rates: Array, moments: Array, half_span: Array
) -> tuple[Array, Array, float] | None:
    """Slope and damping, their sigmas, and the RMS of the swinging rates, of one window; None where nothing swings."""
    slow, _ = np.linalg.qr(np.vander(tau, 3))

    def swinging(values: Array) -> Array:
        return values - slow @ (slow.T @ values)

    turning = swinging(rates)
    signed = angles * (1.0, -1.0)
    columns = [swinging(v) for v in (signed, rates * half_span[:, None], tau[:, None] * signed)]
    design = np.column_stack([np.concatenate(c.T) for c in columns])  # one plane below the other
    if np.linalg.matrix_rank(design) < design.shape[1]:
        return None
    value, *_ = np.linalg.lstsq(design, np.concatenate(swinging(moments).T), rcond=None)
    left = np.concatenate(swinging(moments).T) - design @ value
    both = np.block([[slow, np.zeros_like(slow)], [np.zeros_like(slow), slow]])
    sigma = np.sqrt(np.diag(_covariance(left, design, both)))
    return np.asarray(value[:2]), sigma[:2], float(np.sqrt(np.mean(np.sum(turning**2, axis=1))))


def _covariance(left: Array, design: Array, slow: Array) -> Array:
    """Covariance of a least-squares fit in two planes whose errors are first-order autoregressive.

    Parameters
    ----------
    left : (2n,) array
        Residuals.
    design : (2n, p) array
        Columns, free of what is slow.
    slow : (2n, s) array
        Orthonormal columns that were fitted too.
    """
    count = len(left) // 2
    apart = np.abs(np.subtract.outer(np.arange(count), np.arange(count)))
    taken, _ = np.linalg.qr(np.column_stack((slow, design)))

    def planes(matrix: Array, values: Array) -> Array:
        return np.concatenate((matrix @ values[:count], matrix @ values[count:]))

    neighbours = 0.5 * (apart == 1)
    near = planes(neighbours, taken)

    def expected(rho: float) -> tuple[float, float]:
        """Of unit errors' residuals: sum of squares, and of products of neighbours."""
        spread = planes(rho**apart, taken)
        kept = taken.T @ spread
        return 2.0 * count - float(np.trace(kept)), (
            2.0 * (count - 1) * rho - 2.0 * float(np.sum(near * spread)) + float(np.sum((taken.T @ near) * kept))
        )

    found = float(left @ planes(neighbours, left)) / max(float(left @ left), np.finfo(float).tiny)
    low, high = 0.0, _MOST_CORRELATED
    for _ in range(_HALVINGS):
        rho = 0.5 * (low + high)
        squares, products = expected(rho)
        low, high = (rho, high) if products < found * squares else (low, rho)
    inverse = np.linalg.inv(design.T @ design)
    middle = design.T @ planes(rho**apart, design)
    return float(left @ left) / expected(rho)[0] * inverse @ middle @ inverse
