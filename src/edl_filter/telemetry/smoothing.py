"""The thesis's smoothing of telemetry: rates from quaternions, batch polynomial, low-pass, differences.

All filters are linear and symmetric about the sample, so they shift nothing in time; each has a function
that states its bandwidth. (Thomas 2011, section 3.2.)
"""

from collections.abc import Callable

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import ArrayLike, NDArray

from edl_filter import rotations
from edl_filter.errors import InputError

Array = NDArray[np.float64]

# Steps that agree to this fraction count as equal: clock counts less a large epoch carry rounding of 1e-7
_UNIFORM = 1e-6
# Numbers held at once while batches are fitted one by one
_CHUNK = 2_000_000
_HALF_POWER = np.sqrt(0.5)


def rates_from_quaternions(time: ArrayLike, inertial_from_body: ArrayLike) -> Array:
    """Mean body rates between attitudes: thesis eq. 3.1 over finite intervals.

    Eq. 3.1, ``ω = 2 q⁻¹ ⊗ dq/dt``, needs a derivative of the quaternion. Over an interval its exact
    counterpart is the rotation vector of ``q_i⁻¹ ⊗ q_(i+1)`` divided by the interval: the mean rate, up to
    the coning term ``ω × dω/dt dt² / 12``, whatever the rotation's size below half a turn.

    Parameters
    ----------
    time : (N,) array
        s, strictly increasing.
    inertial_from_body : (N, 4) array
        Unit quaternions, scalar last; either sign.

    Returns
    -------
    (N - 1, 3) array
        rad/s in body axes. Row i is the mean from ``time[i]`` to ``time[i + 1]``, that is the sample whose
        interval ends at ``time[i + 1]``.

    Raises
    ------
    InputError
        Time does not increase, or a quaternion is not finite or not of unit length to 1e-3.
    """
    time, q = _series(time, inertial_from_body, "quaternions")
    bad = np.flatnonzero(np.abs(np.linalg.norm(q, axis=-1) - 1.0) > 1e-3)
    if bad.size:
        raise InputError(
            f"Quaternion {bad[0]} at {time[bad[0]]:.6f} s has length {np.linalg.norm(q[bad[0]]):.6f}; "
            "unit quaternions are needed."
        )
    q = rotations.normalise(q)
    turn = rotations.to_rotation_vector(rotations.multiply(rotations.conjugate(q[:-1]), q[1:]))
    return turn / np.diff(time)[:, None]


def batch_polynomial(time: ArrayLike, values: ArrayLike, points: int, order: int = 2) -> Array:
    """Least-squares polynomial over a sliding batch of samples, evaluated at its centre.

    Where the samples are evenly spaced this is the Savitzky-Golay filter; elsewhere every batch is fitted
    at its own times. The first and last half batches are read off the first and last full batch's
    polynomial. A polynomial of degree `order` passes unchanged. (Thesis section 3.2, order 2.)

    Parameters
    ----------
    time : (N,) array
        s, strictly increasing.
    values : (N,) or (N, K) array
        Finite.
    points : int
        Samples in a batch, odd; the thesis used 7 to 901.
    order : int
        Degree of the polynomial, below `points`.

    Returns
    -------
    array like `values`

    Raises
    ------
    InputError
        `points` is even, not above `order` or more than N; a value is not finite; time does not increase.
    """
    from scipy import signal  # slow to import, and few runs need it

    time, values = _series(time, values, "values")
    _check_batch(points, order)
    n = len(time)
    if points > n:
        raise InputError(f"A batch of {points} points is longer than the data: {n} samples.")
    columns = values.reshape(n, -1)
    smooth = signal.savgol_filter(columns, points, order, axis=0, mode="interp")
    start = np.clip(np.arange(n) - points // 2, 0, n - points)  # first sample of each sample's batch
    uneven = np.flatnonzero(~_evenly_spaced(time, points)[start])
    if uneven.size:
        smooth[uneven] = _fit_each(time, columns, points, order, uneven, start[uneven])
    return smooth.reshape(values.shape)


def batch_polynomial_bandwidth(points: int, order: int, interval: float) -> float:
    """Frequency, Hz, at which `batch_polynomial` first passes half the power (-3 dB).

    Parameters
    ----------
    points, order : int
        As given to `batch_polynomial`.
    interval : float
        Sampling interval, s.

    Returns
    -------
    float
        The Nyquist frequency if the filter never falls so low (as with ``points = order + 1``).
    """
    from scipy import (
        optimize,  # slow to import, and few runs need it
        signal,  # slow to import, and few runs need it
    )

    _check_batch(points, order)
    weights = signal.savgol_coeffs(points, order)
    lag = np.arange(points) - points // 2

    def excess(cycles_per_sample):
        return np.cos(2.0 * np.pi * cycles_per_sample * lag) @ weights - _HALF_POWER

    # The main lobe is a few / points wide, so a grid of 1 / (32 points) cannot step over its edge
    below = np.flatnonzero(np.abs(np.fft.rfft(weights, 32 * points)) < _HALF_POWER)
    if not below.size:
        return 0.5 / interval
    edge = optimize.brentq(excess, (below[0] - 1) / (32 * points), below[0] / (32 * points))
    return float(edge) / interval


def low_pass(values: ArrayLike, interval: float, cutoff_hz: float, order: int = 4) -> Array:
    """Zero-phase low-pass: a Butterworth filter run forward and backward.

    Parameters
    ----------
    values : (N,) or (N, K) array
        Finite, evenly spaced in time.
    interval : float
        Sampling interval, s.
    cutoff_hz : float
        Half-power frequency of one pass, Hz; of both together see `low_pass_bandwidth`. The thesis used
        17 Hz for Phoenix's rates and 15 Hz for its angular accelerations.
    order : int
        Order of one pass.

    Returns
    -------
    array like `values`

    Raises
    ------
    InputError
        The cut-off is not between 0 and the Nyquist frequency, a value is not finite, or the data are
        too short for the filter's run-in.
    """
    from scipy import signal  # slow to import, and few runs need it

    values = np.asarray(values, float)
    _check_cutoff(cutoff_hz, interval)
    _check_finite(values, "values")
    sections = signal.butter(order, cutoff_hz, fs=1.0 / interval, output="sos")
    # Long enough for the filter's slowest pole to settle on the reflected data before the real ones begin
    run_in = int(np.ceil(4.0 / (cutoff_hz * interval)))
    if len(values) <= run_in:
        raise InputError(f"A low-pass at {cutoff_hz} Hz needs more than {run_in} samples; there are {len(values)}.")
    return signal.sosfiltfilt(sections, values, axis=0, padlen=run_in)


def low_pass_bandwidth(cutoff_hz: float, interval: float, order: int = 4) -> float:
    """Frequency, Hz, at which `low_pass` (both passes together) lets half the power through (-3 dB).

    The gain of the two passes is ``1 / (1 + w^(2 order))`` with w the ratio of the prewarped frequencies.
    """
    _check_cutoff(cutoff_hz, interval)
    ratio = (np.sqrt(2.0) - 1.0) ** (0.5 / order)
    return float(np.arctan(np.tan(np.pi * cutoff_hz * interval) * ratio) / (np.pi * interval))


def differentiated_rates(
    time: ArrayLike, rate: ArrayLike, smooth: Callable[[Array, Array], Array] | None = None
) -> Array:
    """Angular acceleration: differences of adjacent filtered rates, filtered again (thesis p. 17).

    The difference of two adjacent rates belongs to the middle between them. The differences are smoothed
    there, and then brought back to the times of the rates by linear interpolation between the two middles
    about each, so nothing is half a sample late. A rate quadratic in time gives its exact derivative, ends
    included (where the interpolation becomes an extrapolation by half a sample). Difference and
    interpolation together pass ``sin(2 pi f dt) / (2 pi f dt)`` of an oscillation of frequency f, before
    what `smooth` takes away.

    Parameters
    ----------
    time : (N,) array
        When each rate holds, s, strictly increasing, N of 3 or more. For means over an interval that is the
        interval's middle: ``record.time - record.interval / 2``.
    rate : (N, 3) array
        Filtered rates, rad/s.
    smooth : callable, optional
        ``smooth(time, values) -> values``, applied to the differences, such as
        ``lambda t, v: batch_polynomial(t, v, 7)``. None leaves them as they are.

    Returns
    -------
    (N, 3) array
        rad/s², at `time`.

    Raises
    ------
    InputError
        Fewer than 3 samples, time does not increase, or a rate is not finite.
    """
    time, rate = _series(time, rate, "rates")
    if len(time) < 3:
        raise InputError(f"Angular acceleration needs at least 3 rates; there are {len(time)}.")
    step = np.diff(time).reshape(-1, *(1,) * (rate.ndim - 1))
    middle = 0.5 * (time[:-1] + time[1:])
    acceleration = np.diff(rate, axis=0) / step
    if smooth is not None:
        acceleration = smooth(middle, acceleration)
    left = np.clip(np.arange(len(time)) - 1, 0, len(middle) - 2)
    share = ((time - middle[left]) / (middle[left + 1] - middle[left])).reshape(-1, *(1,) * (rate.ndim - 1))
    return (1.0 - share) * acceleration[left] + share * acceleration[left + 1]


def _evenly_spaced(time: Array, points: int) -> NDArray[np.bool_]:
    """Whether the batch of `points` samples that begins at each sample has equal steps."""
    step = np.diff(time)
    if np.ptp(step) <= _UNIFORM * step.min() or points < 3:
        return np.ones(len(time) - points + 1, bool)
    batch = sliding_window_view(step, points - 1)
    return batch.max(axis=-1) - batch.min(axis=-1) <= _UNIFORM * batch.min(axis=-1)


def _fit_each(
    time: Array, columns: Array, points: int, order: int, sample: NDArray[np.int64], start: NDArray[np.int64]
) -> Array:
    """Value at each `sample` of the polynomial fitted to the batch that begins at `start`."""
    result = np.empty((len(sample), columns.shape[1]))
    size = max(1, _CHUNK // (points * (order + 1 + columns.shape[1])))
    for first in range(0, len(sample), size):
        part = slice(first, first + size)
        window = start[part, None] + np.arange(points)
        t = time[window]
        # Times scaled to [-1, 1] keep the powers well conditioned
        centre, half = 0.5 * (t[:, :1] + t[:, -1:]), 0.5 * (t[:, -1:] - t[:, :1])
        powers = np.arange(order + 1)
        q, r = np.linalg.qr(((t - centre) / half)[..., None] ** powers)
        coefficients = np.linalg.solve(r, q.swapaxes(-1, -2) @ columns[window])
        here = ((time[sample[part], None] - centre) / half) ** powers
        result[part] = (here[:, None, :] @ coefficients)[:, 0, :]
    return result


def _series(time: ArrayLike, values: ArrayLike, what: str) -> tuple[Array, Array]:
    """Both as arrays, checked: same length, time increasing, values finite."""
    time, values = np.asarray(time, float), np.asarray(values, float)
    if time.ndim != 1 or values.shape[:1] != time.shape:
        raise InputError(f"The {what} have shape {values.shape}, the times {time.shape}: first axes must agree.")
    back = np.flatnonzero(~(np.diff(time) > 0.0))
    if back.size:
        raise InputError(f"Time must increase, but {time[back[0] + 1]!r} s follows {time[back[0]]!r} s.")
    _check_finite(values, what)
    return time, values


def _check_finite(values: Array, what: str) -> None:
    bad = np.flatnonzero(~np.isfinite(values.reshape(len(values), -1)).all(axis=-1))
    if bad.size:
        raise InputError(f"The {what} have NaN or infinity in row {bad[0]}; fill or cut the gap first.")


def _check_batch(points: int, order: int) -> None:
    if points < 1 or points % 2 == 0:
        raise InputError(f"A batch of {points} points has no middle sample; an odd number is needed.")
    if not 0 <= order < points:
        raise InputError(f"A polynomial of degree {order} needs 0 <= degree < points; points is {points}.")


def _check_cutoff(cutoff_hz: float, interval: float) -> None:
    if not 0.0 < cutoff_hz < 0.5 / interval:
        raise InputError(f"A cut-off of {cutoff_hz} Hz is not between 0 and the Nyquist frequency {0.5 / interval} Hz.")
