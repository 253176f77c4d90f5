"""Smoothing of telemetry as in the thesis (Thomas 2011, section 3.2).

Input: times and values, evenly spaced or not. Output: body rates from quaternions, values smoothed by a batch
polynomial or a low-pass, and angular acceleration from rates. All filters are linear and symmetric about the sample, so
that they cause no delay; a separate function gives the bandwidth of each smoothing filter.
"""

from collections.abc import Callable

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import ArrayLike

from edl_filter import rotations
from edl_filter.errors import InputError
from edl_filter.types import Array, BoolArray, IntArray

# Steps that agree to this fraction count as equal: clock counts minus a large epoch have a rounding error of 1e-7
_UNIFORM = 1e-6
# Array elements processed at once while batches are fitted one by one; limits the memory
_CHUNK = 2_000_000
_HALF_POWER_GAIN = np.sqrt(0.5)
# Halvings of an interval until rounding ends them
_BISECTIONS = 50


def rates_from_quaternions(time: ArrayLike, inertial_from_body: ArrayLike) -> Array:
    """Mean body rates between attitudes: thesis eq. 3.1 over finite intervals.

    Eq. 3.1, ``ω = 2 q⁻¹ ⊗ dq/dt``, contains the derivative of the quaternion. Over a finite interval the rate is the
    rotation vector of ``q_i⁻¹ ⊗ q_(i+1)`` divided by the interval. For rotations of less than 180 degrees it is the
    mean rate up to the coning term ``ω × dω/dt dt² / 12``.

    Parameters
    ----------
    time : (N,) array
        s, strictly increasing.
    inertial_from_body : (N, 4) array
        Unit quaternions, scalar last; either sign.

    Returns
    -------
    (N - 1, 3) array
        rad/s, body axes. Row i is the mean from ``time[i]`` to ``time[i + 1]``: the sample whose interval ends at
        ``time[i + 1]``.

    Raises
    ------
    InputError
        Time does not increase, or a quaternion is not finite or not of unit length to 1e-3.
    """
    time, q = _checked_series(time, inertial_from_body, "quaternions")
    rows = np.flatnonzero(np.abs(np.linalg.norm(q, axis=-1) - 1.0) > 1e-3)
    if rows.size:
        raise InputError(
            f"Quaternion {rows[0]} at {time[rows[0]]:.6f} s has length {np.linalg.norm(q[rows[0]]):.6f}; "
            "unit quaternions are needed."
        )
    q = rotations.normalise(q)
    return rotations.rotation_vector_between(q[:-1], q[1:]) / np.diff(time)[:, None]


def batch_polynomial(time: ArrayLike, values: ArrayLike, points: int, order: int = 2) -> Array:
    """Least-squares polynomial over a sliding batch of samples, evaluated at its centre.

    Where the samples are evenly spaced this is the Savitzky-Golay filter; elsewhere every batch is fitted at its own
    times. In the first and last half batches the values are those of the first and last full batch's polynomial. A
    polynomial of degree `order` passes unchanged. (Thesis section 3.2, order 2.)

    Parameters
    ----------
    time : (N,) array
        s, strictly increasing.
    values : (N,) or (N, K) array
        Finite, any unit.
    points : int
        Samples in a batch, odd; the thesis used 7 to 901.
    order : int
        Degree of the polynomial, below `points`.

    Returns
    -------
    (N,) or (N, K) array
        In the unit of `values`.

    Raises
    ------
    InputError
        `points` is even, not above `order` or more than N; a value is not finite; time does not increase.
    """
    time, values = _checked_series(time, values, "values")
    _check_batch(points, order)
    n = len(time)
    if points > n:
        raise InputError(f"A batch of {points} points is longer than the data: {n} samples.")
    columns = values.reshape(n, -1)
    start = np.clip(np.arange(n) - points // 2, 0, n - points)  # first sample of each sample's batch
    smoothed = np.empty_like(columns)
    weights = batch_weights(points, order)
    inner = slice(points // 2, n - points // 2)
    for k in range(columns.shape[1]):
        smoothed[inner, k] = np.correlate(columns[:, k], weights, "valid")
    ends = np.concatenate((np.arange(inner.start), np.arange(inner.stop, n)))
    smoothed[ends] = _fit_batches(np.arange(float(n)), columns, points, order, ends, start[ends])
    uneven = np.flatnonzero(~_evenly_spaced(time, points)[start])
    if uneven.size:
        smoothed[uneven] = _fit_batches(time, columns, points, order, uneven, start[uneven])
    return smoothed.reshape(values.shape)


def batch_weights(points: int, order: int) -> Array:
    """Weights of a batch of evenly spaced samples: `batch_polynomial` at its centre is their sum of products.

    Parameters
    ----------
    points, order : int
        As for `batch_polynomial`.

    Returns
    -------
    (points,) array
    """
    position = np.linspace(-1.0, 1.0, points) if points > 1 else np.zeros(1)
    q, _ = np.linalg.qr(position[:, None] ** np.arange(order + 1))
    return q @ q[points // 2]


def batch_polynomial_gain(frequency: ArrayLike, points: int, order: int) -> Array:
    """Gain of `batch_polynomial` at the centre of a batch of evenly spaced samples.

    Parameters
    ----------
    frequency : (...) array
        Cycles per sample, 0 to 0.5.
    points, order : int
        As for `batch_polynomial`.

    Returns
    -------
    (...) array
        1 at zero frequency; negative where the phase is opposite.
    """
    lag = np.arange(points) - points // 2
    return np.cos(2.0 * np.pi * np.multiply.outer(frequency, lag)) @ batch_weights(points, order)


def batch_polynomial_bandwidth(points: int, order: int, interval: float) -> float:
    """Bandwidth of `batch_polynomial`: the lowest frequency at which it passes half the power (-3 dB).

    Parameters
    ----------
    points, order : int
        As for `batch_polynomial`.
    interval : float
        Sampling interval, s.

    Returns
    -------
    float
        Hz; the Nyquist frequency if the filter passes more at all frequencies (as with ``points = order + 1``).
    """
    _check_batch(points, order)
    # The main lobe is a few / points wide: a grid of 1 / (32 points) resolves its edge
    response = np.abs(np.fft.rfft(batch_weights(points, order), 32 * points))
    below = np.flatnonzero(response < _HALF_POWER_GAIN)
    if not below.size:
        return 0.5 / interval
    low, high = (below[0] - 1) / (32 * points), below[0] / (32 * points)
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        above = batch_polynomial_gain(middle, points, order) > _HALF_POWER_GAIN
        low, high = (middle, high) if above else (low, middle)
    return float(0.5 * (low + high)) / interval


def low_pass(values: ArrayLike, interval: float, cutoff_hz: float, order: int = 4) -> Array:
    """Zero-phase low-pass: a Butterworth filter applied forward and backward.

    Parameters
    ----------
    values : (N,) or (N, K) array
        Finite, evenly spaced in time, any unit.
    interval : float
        Sampling interval, s.
    cutoff_hz : float
        Half-power frequency of one pass, Hz. The thesis used 17 Hz for Phoenix's rates and 15 Hz for its
        accelerations and angular accelerations.
    order : int
        Order of one pass.

    Returns
    -------
    (N,) or (N, K) array
        In the unit of `values`.

    Raises
    ------
    InputError
        The cut-off is not between 0 and the Nyquist frequency, a value is not finite, or there are fewer samples
        than the filter's transient needs.
    """
    from scipy import signal  # imported on use: the import is slow, and few runs need it

    values = np.asarray(values, float)
    _check_cutoff(cutoff_hz, interval)
    _check_finite(values, "values")
    sections = signal.butter(order, cutoff_hz, fs=1.0 / interval, output="sos")
    # The transient of the filter's slowest pole decays within the reflected samples that are put before the data
    padding = int(np.ceil(4.0 / (cutoff_hz * interval)))
    if len(values) <= padding:
        raise InputError(f"A low-pass at {cutoff_hz} Hz needs more than {padding} samples; there are {len(values)}.")
    return signal.sosfiltfilt(sections, values, axis=0, padlen=padding)


def low_pass_gain(frequency: ArrayLike, cutoff: float, order: int = 4) -> Array:
    """Gain of `low_pass`, both passes together.

    Parameters
    ----------
    frequency : (...) array
        Cycles per sample, 0 to 0.5.
    cutoff : float
        Half-power frequency of one pass, cycles per sample, below 0.5.
    order : int
        Order of one pass.

    Returns
    -------
    (...) array
        1 at zero frequency.
    """
    _check_cutoff(cutoff, 1.0)
    ratio = np.tan(np.pi * np.minimum(np.asarray(frequency, float), 0.5 - 1e-12)) / np.tan(np.pi * cutoff)
    return 1.0 / (1.0 + ratio ** (2 * order))


def differentiated_rates(
    time: ArrayLike, rate: ArrayLike, smooth: Callable[[Array, Array], Array] | None = None
) -> Array:
    """Angular acceleration: differences of adjacent filtered rates, filtered again (thesis p. 17).

    The difference of two adjacent rates is the derivative at the midpoint between them. The differences are smoothed
    at the midpoints, then interpolated linearly to the times of the rates, which avoids a delay of half a sample. A
    rate that is quadratic in time gives its exact derivative, also at the two ends (where the interpolation is an
    extrapolation by half a sample). Without `smooth`, an oscillation of frequency f passes with the gain
    ``sin(2 pi f dt) / (2 pi f dt)``.

    Parameters
    ----------
    time : (N,) array
        Times at which the rates apply, s, strictly increasing, N ≥ 3. For means over an interval that is the middle
        of the interval: ``record.time - record.interval / 2``.
    rate : (N, 3) array
        Filtered rates, rad/s.
    smooth : callable, optional
        ``smooth(time, values) -> values``, applied to the differences, such as
        ``lambda t, v: batch_polynomial(t, v, 7)``. With None they are not smoothed.

    Returns
    -------
    (N, 3) array
        rad/s², at `time`.

    Raises
    ------
    InputError
        Fewer than 3 samples, time does not increase, or a rate is not finite.
    """
    time, rate = _checked_series(time, rate, "rates")
    if len(time) < 3:
        raise InputError(f"Angular acceleration needs at least 3 rates; there are {len(time)}.")
    step = np.diff(time).reshape(-1, *(1,) * (rate.ndim - 1))
    midpoint = 0.5 * (time[:-1] + time[1:])
    acceleration = np.diff(rate, axis=0) / step
    if smooth is not None:
        acceleration = smooth(midpoint, acceleration)
    index = np.clip(np.arange(len(time)) - 1, 0, len(midpoint) - 2)
    fraction = ((time - midpoint[index]) / (midpoint[index + 1] - midpoint[index])).reshape(-1, *(1,) * (rate.ndim - 1))
    return (1.0 - fraction) * acceleration[index] + fraction * acceleration[index + 1]


def _evenly_spaced(time: Array, points: int) -> BoolArray:
    """True where the batch of `points` samples that begins at a sample has equal steps."""
    step = np.diff(time)
    if np.ptp(step) <= _UNIFORM * step.min() or points < 3:
        return np.ones(len(time) - points + 1, bool)
    steps_of_batch = sliding_window_view(step, points - 1)
    shortest = steps_of_batch.min(axis=-1)
    return steps_of_batch.max(axis=-1) - shortest <= _UNIFORM * shortest


def _fit_batches(time: Array, columns: Array, points: int, order: int, sample: IntArray, start: IntArray) -> Array:
    """Values (S, K) at the samples (S,) of the polynomials fitted to the batches that begin at `start` (S,)."""
    out = np.empty((len(sample), columns.shape[1]))
    size = max(1, _CHUNK // (points * (order + 1 + columns.shape[1])))
    for first in range(0, len(sample), size):
        chunk = slice(first, first + size)
        batch = start[chunk, None] + np.arange(points)
        t = time[batch]
        # Powers of times that are scaled to [-1, 1] are well conditioned
        centre, half = 0.5 * (t[:, :1] + t[:, -1:]), 0.5 * (t[:, -1:] - t[:, :1])
        exponents = np.arange(order + 1)
        q, r = np.linalg.qr(((t - centre) / half)[..., None] ** exponents)
        coefficients = np.linalg.solve(r, q.swapaxes(-1, -2) @ columns[batch])
        powers_at_sample = ((time[sample[chunk], None] - centre) / half) ** exponents
        out[chunk] = (powers_at_sample[:, None, :] @ coefficients)[:, 0, :]
    return out


def _checked_series(time: ArrayLike, values: ArrayLike, quantity: str) -> tuple[Array, Array]:
    """Times and values as arrays; raises if lengths differ, time does not increase or a value is not finite."""
    time, values = np.asarray(time, float), np.asarray(values, float)
    if time.ndim != 1 or values.shape[:1] != time.shape:
        raise InputError(f"The {quantity} have shape {values.shape}, the times {time.shape}: first axes must agree.")
    rows = np.flatnonzero(~(np.diff(time) > 0.0))
    if rows.size:
        raise InputError(f"Time must increase, but {time[rows[0] + 1]!r} s follows {time[rows[0]]!r} s.")
    _check_finite(values, quantity)
    return time, values


def _check_finite(values: Array, quantity: str) -> None:
    rows = np.flatnonzero(~np.isfinite(values.reshape(len(values), -1)).all(axis=-1))
    if rows.size:
        raise InputError(f"The {quantity} have NaN or infinity in row {rows[0]}; fill or cut the gap first.")


def _check_batch(points: int, order: int) -> None:
    if points < 1 or points % 2 == 0:
        raise InputError(f"A batch of {points} points has no middle sample; an odd number is needed.")
    if not 0 <= order < points:
        raise InputError(f"A polynomial of degree {order} needs 0 <= degree < points; points is {points}.")


def _check_cutoff(cutoff_hz: float, interval: float) -> None:
    if not 0.0 < cutoff_hz < 0.5 / interval:
        raise InputError(f"A cut-off of {cutoff_hz} Hz is not between 0 and the Nyquist frequency {0.5 / interval} Hz.")
