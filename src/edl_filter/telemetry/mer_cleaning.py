"""Corrections of known defects of MER's entry telemetry, one function for each defect.

Input and output are arrays; files and column names are in `mer_archive`, which applies the functions in order. Missing
values become NaN.
"""

from __future__ import annotations

import numpy as np

from edl_filter import rotations
from edl_filter.estimation.series import finite_rows
from edl_filter.types import Array, BoolArray, IntArray

Gap = tuple[float, float]

#: Value of a clipped word of the accumulated-velocity register, m/s.
CLIPPED = -512.0
#: One sigma of a component rounded to six decimals.
ROUNDING = 1e-6 / np.sqrt(12.0)
#: Least length of a run of rows at the end of a table.
_SHORTEST_RUN = 8


def select_fullest_rows(time: Array, values: Array) -> BoolArray:
    """Select rows so that every time occurs once.

    Of the rows with equal times it is the fullest, or the first of several equally full ones. A duplicate row is often
    partly blank (zeros) or clipped (-512), so that neither the first nor the last row of a time is always valid.

    Parameters
    ----------
    time : (N,) array
        s, not decreasing.
    values : (N, K) array
        In the units of the table.

    Returns
    -------
    (N,) boolean array
    """
    valid_fields = np.count_nonzero((values != 0.0) & (values != CLIPPED), axis=1)
    order = np.lexsort((-valid_fields, time))  # stable: the first of equally full rows comes first
    selected = np.zeros(len(time), bool)
    selected[order[np.r_[True, np.diff(time[order]) > 0.0]]] = True
    return selected


def blank_quaternions(quaternion: Array) -> BoolArray:
    """Find quaternions that were lost: two or three of the first three elements are exactly zero.

    The fourth element was computed afterwards from the others, so that a blank row is (0, 0, 0, 1), a unit quaternion.

    Parameters
    ----------
    quaternion : (N, 4) array
        Quaternions of the archive.

    Returns
    -------
    (N,) boolean array
    """
    return np.count_nonzero(quaternion[:, :3] == 0.0, axis=1) >= 2


def blank_vectors(vector: Array) -> BoolArray:
    """Find vectors that were lost: all elements are exactly zero.

    Parameters
    ----------
    vector : (N, 3) array
        Any unit.

    Returns
    -------
    (N,) boolean array
    """
    return np.all(vector == 0.0, axis=1)


def clipped_register(register: Array) -> BoolArray:
    """Find rows of the velocity register with a clipped word: an element of exactly -512 m/s.

    Parameters
    ----------
    register : (N, 3) array
        m/s.

    Returns
    -------
    (N,) boolean array
    """
    return np.any(register == CLIPPED, axis=1)


def with_nan(values: Array, missing: BoolArray) -> Array:
    """Copy of `values` (N, K) with NaN in the rows where `missing` (N,) is true."""
    return np.where(missing[:, None], np.nan, values)


def trailing_run(flag: BoolArray) -> int:
    """Find the run of true values that ends an array.

    A single equal or zero row before the switch-off is a coincidence or a lost row; a run to the table's end is not.

    Parameters
    ----------
    flag : (N,) boolean array
        Condition of each row.

    Returns
    -------
    int
        Index of the first element of the run; N if the run has fewer than `_SHORTEST_RUN` elements.
    """
    false = np.flatnonzero(~flag)
    start = int(false[-1]) + 1 if len(false) else 0
    return start if len(flag) - start >= _SHORTEST_RUN else len(flag)


def backshell_copies(rover: Array, backshell: Array) -> BoolArray:
    """Find the rows of HIGHRATE after the backshell's IMU was switched off, where its columns repeat the rover's.

    Parameters
    ----------
    rover, backshell : (N, 6) arrays
        Increments of angle and velocity, rad and m/s.

    Returns
    -------
    (N,) boolean array
    """
    off = np.zeros(len(rover), bool)
    off[trailing_run(np.all(rover == backshell, axis=1)) :] = True
    return off


def find_resets(time: Array, register: Array) -> IntArray:
    """Find the rows at which the accumulated velocity restarted from zero.

    After a reset the register has accumulated less than 60 m/s² times the step, and less than a tenth of its value
    before the reset, which was more than 5 m/s. Missing rows (NaN) are ignored.

    Parameters
    ----------
    time : (N,) array
        s.
    register : (N, 3) array
        m/s.

    Returns
    -------
    (R,) integer array
        Index of the first row after each reset.
    """
    rows = np.flatnonzero(finite_rows(register))
    norm, step = np.linalg.norm(register[rows], axis=1), np.diff(time[rows])
    before, after = norm[:-1], norm[1:]
    return rows[1:][(before > 5.0) & (after < 0.1 * before) & (after < 60.0 * step)]


def remove_resets(register: Array, resets: IntArray) -> Array:
    """Remove the jumps of the accumulated velocity at its resets.

    Parameters
    ----------
    register : (N, 3) array
        m/s.
    resets : (R,) integer array
        Result of `find_resets`.

    Returns
    -------
    (N, 3) array
        Velocity, m/s. Each part continues from the last valid value before its reset.
    """
    velocity = register.copy()
    for i in resets:
        last = np.flatnonzero(finite_rows(register[:i]))[-1]
        velocity[i:] += register[last]
    return velocity


def find_gaps(time: Array, longest_step: float) -> tuple[Gap, ...]:
    """Find the steps in time that are too long.

    Parameters
    ----------
    time : (N,) array
        s.
    longest_step : float
        Longest step that is no gap, s.

    Returns
    -------
    tuple of (start, length)
        s.
    """
    step = np.diff(time)
    return tuple((float(time[i]), float(step[i])) for i in np.flatnonzero(step > longest_step))


def rounding_sigma(quaternion: Array) -> Array:
    """Attitude error due to the rounding of the archive's quaternions to six decimals, one sigma per axis.

    The first three elements u are rounded, each with sigma e = 1e-6/√12. The fourth is w = √(1 - u·u) of the rounded
    elements, so that its error is -(u·du)/w. The rotation vector of the error,
    2 vec(q* ⊗ dq) = 2 [w I + u uᵀ/w - [u×]] du, has sigma 2e perpendicular to u (singular value 1) and 2e/w along u
    (singular value (w² + u·u)/w = 1/w). Near w = 0 the expansion is not valid: w² has sigma 2e there, so that the
    uncertainty of w is about √(2e) and that of the angle 2 arccos w twice as large; the term e/2 accounts for this. The
    result is the root mean square over the three axes.

    Parameters
    ----------
    quaternion : (N, 4) array
        Quaternions of the archive, NaN where missing.

    Returns
    -------
    (N,) array
        rad; NaN where the quaternion is NaN.
    """
    along_squared = (2.0 * ROUNDING) ** 2 / (quaternion[:, 3] ** 2 + 0.5 * ROUNDING)
    return np.sqrt((2.0 * (2.0 * ROUNDING) ** 2 + along_squared) / 3.0)


def j2000_from_sc(archive: Array) -> Array:
    """Quaternions of the archive in this package's convention, normalised.

    In the archive v_sc = A(q) v_J2000 with Shuster's matrix A(q) = (w² - u·u) I + 2 u uᵀ - 2 w [u×] (Shuster 1993,
    eq. 96). This package's ``rotate(q, ·)`` is the transpose of A(q). Hence the same four numbers, as a Hamilton
    quaternion, take spacecraft components to J2000, and no conjugation is needed.

    Parameters
    ----------
    archive : (N, 4) array
        Quaternions of the archive, rounded; NaN where missing.

    Returns
    -------
    (N, 4) array
        ``j2000_from_sc``; NaN where missing.
    """
    return rotations.normalise(archive)
