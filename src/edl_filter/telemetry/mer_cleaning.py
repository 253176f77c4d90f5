"""The traps of MER's entry telemetry, one small function for each.

Arrays in and out; nothing here knows files or column names. The traps are described where `mer_archive` puts
the functions together.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from edl_filter import rotations

Array = NDArray[np.float64]
Gap = tuple[float, float]

#: What a clipped word of the accumulated-velocity register reads, m/s.
CLIPPED = -512.0
#: One sigma of a component rounded to six decimals.
ROUNDING = 1e-6 / np.sqrt(12.0)


def fuller_rows(time: Array, values: Array) -> NDArray[np.bool_]:
    """Choose rows so that every time occurs once: of rows with one time the fullest, the first of equals.

    A twin is often partly blank (zeros) or clipped (-512), so neither "first" nor "last" is safe.

    Parameters
    ----------
    time : (N,) array
        Not decreasing.
    values : (N, K) array
    """
    fields = np.count_nonzero((values != 0.0) & (values != CLIPPED), axis=1)
    order = np.lexsort((-fields, time))  # stable: the first of equals stays first
    keep = np.zeros(len(time), bool)
    keep[order[np.r_[True, np.diff(time[order]) > 0.0]]] = True
    return keep


def blank_quaternions(quaternion: Array) -> NDArray[np.bool_]:
    """Rows of quaternions that telemetry lost: two or three of the first three elements are exactly zero.

    The fourth was computed afterwards from the others, so a blank row reads (0, 0, 0, 1), a unit quaternion.
    """
    return np.count_nonzero(quaternion[:, :3] == 0.0, axis=1) >= 2


def blank_vectors(vector: Array) -> NDArray[np.bool_]:
    """Rows ``(N, 3)`` that telemetry filled with zeros."""
    return np.all(vector == 0.0, axis=1)


def clipped_register(register: Array) -> NDArray[np.bool_]:
    """Rows of the register with a clipped word: an element of exactly -512 m/s."""
    return np.any(register == CLIPPED, axis=1)


def with_nan(values: Array, missing: NDArray[np.bool_]) -> Array:
    """Copy of `values` with NaN in the rows that are missing."""
    return np.where(missing[:, None], np.nan, values)


def trailing_run(flag: NDArray[np.bool_], shortest: int = 8) -> int:
    """Index at which the run of true values that ends the array begins; ``len(flag)`` if it is shorter.

    A single equal or zero row before the switch-off is chance or a lost row; a run to the table's end is not.
    """
    false = np.flatnonzero(~flag)
    start = int(false[-1]) + 1 if len(false) else 0
    return start if len(flag) - start >= shortest else len(flag)


def backshell_copies(rover: Array, backshell: Array) -> NDArray[np.bool_]:
    """Rows of HIGHRATE after the backshell's IMU went off, where its columns repeat the rover's."""
    off = np.zeros(len(rover), bool)
    off[trailing_run(np.all(rover == backshell, axis=1)) :] = True
    return off


def find_resets(time: Array, register: Array) -> NDArray[np.int64]:
    """Rows at which the accumulated velocity restarted from zero.

    After a reset the register holds what was gathered since: less than 60 m/s² times the step, and less than
    a tenth of the 5 m/s or more that it held before. Missing rows (NaN) are passed over.

    Parameters
    ----------
    time : (N,) array, s
    register : (N, 3) array, m/s

    Returns
    -------
    integer array
        Index of the first row after each reset.
    """
    known = np.flatnonzero(np.isfinite(register).all(axis=1))
    size, step = np.linalg.norm(register[known], axis=1), np.diff(time[known])
    before, after = size[:-1], size[1:]
    return known[1:][(before > 5.0) & (after < 0.1 * before) & (after < 60.0 * step)]


def without_resets(register: Array, resets: NDArray[np.int64]) -> tuple[Array, Array]:
    """Accumulated velocity that does not jump at resets, and its increments.

    Parameters
    ----------
    register : (N, 3) array, m/s
    resets : indices from `find_resets`

    Returns
    -------
    velocity : (N, 3) array
        Each piece continues from the last known value of the piece before.
    increment : (N, 3) array
        Change since the row before; NaN at resets, where part of it is lost, and in the first row.
    """
    velocity = register.copy()
    for i in resets:
        last = np.flatnonzero(np.isfinite(register[:i]).all(axis=1))[-1]
        velocity[i:] += register[last]
    increment = np.full_like(velocity, np.nan)
    increment[1:] = np.diff(velocity, axis=0)
    increment[resets] = np.nan
    return velocity, increment


def find_gaps(time: Array, longest: float) -> tuple[Gap, ...]:
    """``(start, length)`` of the steps in `time` that are longer than `longest`, s."""
    step = np.diff(time)
    return tuple((float(time[i]), float(step[i])) for i in np.flatnonzero(step > longest))


def rounding_sigma(quaternion: Array) -> Array:
    """Attitude error that the archive's six decimals leave, one sigma per axis, rad.

    The first three elements u are rounded, each with sigma e = 1e-6/√12, and the fourth is
    w = √(1 - u·u) of the rounded ones, so that its error is -(u·du)/w. The rotation vector of the error,
    2 vec(q* ⊗ dq) = 2 [w I + u uᵀ/w - [u×]] du, has sigma 2e across u (singular value 1) and 2e/w along u
    (singular value (w² + u·u)/w = 1/w). Near w = 0 the expansion fails: there w² has sigma 2e, so w is
    unknown by about √(2e) and the angle 2 arccos w by twice that, which the term e/2 brings about.
    The value given is the root mean square over the three axes.

    Parameters
    ----------
    quaternion : (N, 4) array

    Returns
    -------
    (N,) array
        NaN where the quaternion is.
    """
    along_squared = (2.0 * ROUNDING) ** 2 / (quaternion[:, 3] ** 2 + 0.5 * ROUNDING)
    return np.sqrt((2.0 * (2.0 * ROUNDING) ** 2 + along_squared) / 3.0)


def j2000_from_sc(archive: Array) -> Array:
    """Read the archive's quaternions as this package's ``j2000_from_sc``, normalised; NaN stays.

    The archive means v_sc = A(q) v_J2000 with Shuster's matrix A(q) = (w² - u·u) I + 2 u uᵀ - 2 w [u×]
    (Shuster 1993, eq. 96). This package's ``rotate(q, ·)`` is the transpose of A(q), so the same four
    numbers, read as Hamilton's, take spacecraft components to J2000: nothing is conjugated.
    """
    return rotations.normalise(archive)
