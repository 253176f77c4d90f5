"""Compiled states of sigma points: errors about a reference.

The compiled twins of `layout.sigma_states`, `State.plus` and `State.minus`, for `compiled_ukf`.
Quaternions are scalar-last; vectors and states have the units of `layout`.
"""

import numpy as np
from numba import njit

from edl_filter.rotation_kernels import product, quaternion, rotation_vector

COMPILED = njit(cache=True, error_model="numpy", nogil=True)


@COMPILED
def turned_attitude(attitude, x, y, z):
    """``attitude ⊗ exp(phi)``, normalised.

    Parameters
    ----------
    attitude : (4,) array
        Quaternion, scalar last.
    x, y, z : float
        Components of the rotation vector phi, rad.

    Returns
    -------
    tuple of four floats
        Unit quaternion, scalar last.
    """
    q = product(attitude, quaternion(x, y, z))
    n = 1.0 / np.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    return n * q[0], n * q[1], n * q[2], n * q[3]


@COMPILED
def turn_between(p, q):
    """Rotation vector phi with ``q = p ⊗ exp(phi)``.

    Parameters
    ----------
    p, q : (4,) arrays
        Unit quaternions, scalar last.

    Returns
    -------
    tuple of three floats
        Components of phi, of at most half a turn, rad.
    """
    x, y, z, w = product((-p[0], -p[1], -p[2], p[3]), (q[0], q[1], q[2], q[3]))
    return rotation_vector(x, y, z, w)


@COMPILED
def turns_between(attitude, attitudes):
    """Rotation vectors in body axes that take one attitude to each of several, as `layout.attitude_errors`.

    Parameters
    ----------
    attitude : (4,) array
        Quaternion, scalar last.
    attitudes : (4, S) array
        Unit quaternions, one per column.

    Returns
    -------
    (S, 3) array
        rad.
    """
    out = np.empty((attitudes.shape[1], 3))
    for s in range(len(out)):
        out[s, 0], out[s, 1], out[s, 2] = turn_between(attitude, attitudes[:, s])
    return out


@COMPILED
def states_of_points(nav, errors, points, columns, onboard):
    """States of sigma points, as `layout.sigma_states`.

    Parameters
    ----------
    nav : (10 or 14,) array
        Reference, as `State.nav`: m, m/s and quaternions.
    errors : (n,) array
        Reference, as `State.errors`, in the units of `layout.UNITS`.
    points : (S, n) array
        Errors about the reference, in the same units.
    columns : int
        Columns of the result; those beyond S are the reference.
    onboard : int
        First index of the on-board attitude's error in the vector; -1: none.

    Returns
    -------
    states : (10 or 14, columns) array
        As `State.nav`.
    full : (n, columns) array
        As `State.errors`.
    """
    n = len(errors)
    states, full = np.empty((len(nav), columns)), np.empty((n, columns))
    unturned = turned_attitude(nav[6:10], 0.0, 0.0, 0.0)
    for s in range(columns):
        if s >= len(points):
            states[:, s], full[:, s] = nav, errors
        else:
            for k in range(6):
                states[k, s] = nav[k] + points[s, k]
            turned = unturned
            if points[s, 6] != 0.0 or points[s, 7] != 0.0 or points[s, 8] != 0.0:  # nine rows of a triangular factor
                turned = turned_attitude(nav[6:10], points[s, 6], points[s, 7], points[s, 8])
            for k in range(4):
                states[6 + k, s] = turned[k]
            for k in range(9):
                full[k, s] = errors[k]
            for k in range(9, n):
                full[k, s] = errors[k] + points[s, k]
            if onboard >= 0:
                turned = turned_attitude(nav[10:], points[s, onboard], points[s, onboard + 1], points[s, onboard + 2])
                for k in range(4):
                    states[10 + k, s] = turned[k]
        if onboard >= 0:
            full[onboard:, s] = 0.0
    return states, full


@COMPILED
def moved_state(nav, errors, delta, onboard):
    """The state moved by an error vector, as `State.plus`.

    Parameters
    ----------
    nav : (10 or 14,) array
        As `State.nav`: m, m/s and quaternions.
    errors : (n,) array
        As `State.errors`, in the units of `layout.UNITS`.
    delta : (n,) array
        Error vector, in the same units.
    onboard : int
        First index of the on-board attitude's error in the vector; -1: none.

    Returns
    -------
    moved : (10 or 14,) array
        As `State.nav`.
    full : (n,) array
        As `State.errors`.
    """
    moved, full = nav.copy(), errors.copy()
    for k in range(6):
        moved[k] += delta[k]
    for k in range(9, len(errors)):
        full[k] += delta[k]
    turned = turned_attitude(nav[6:10], delta[6], delta[7], delta[8])
    for k in range(4):
        moved[6 + k] = turned[k]
    if onboard >= 0:
        turned = turned_attitude(nav[10:], delta[onboard], delta[onboard + 1], delta[onboard + 2])
        for k in range(4):
            moved[10 + k] = turned[k]
        full[onboard:] = 0.0
    return moved, full


@COMPILED
def moving_errors(states, count):
    """Errors of position, velocity and attitudes about the first state, of those states that move between epochs.

    Parameters
    ----------
    states : (10 or 14, S) array
        As `State.nav`, one per column: m, m/s and quaternions.
    count : int
        Columns that are used.

    Returns
    -------
    (count, 9 or 12) array
        m, m/s and rad; the error of an on-board attitude stands last.
    """
    moving = 9 if len(states) == 10 else 12
    out = np.empty((count, moving))
    centre = states[:, 0].copy()
    for s in range(count):
        for k in range(6):
            out[s, k] = states[k, s] - centre[k]
        out[s, 6], out[s, 7], out[s, 8] = turn_between(centre[6:10], states[6:10, s])
        if moving == 12:
            out[s, 9], out[s, 10], out[s, 11] = turn_between(centre[10:], states[10:, s])
    return out


@COMPILED
def error_between(nav, errors, reference_nav, reference_errors, onboard):
    """The error vector from a reference to a state, as `State.minus`.

    Parameters
    ----------
    nav, reference_nav : (10 or 14,) arrays
        As `State.nav`: m, m/s and quaternions.
    errors, reference_errors : (n,) arrays
        As `State.errors`, in the units of `layout.UNITS`.
    onboard : int
        First index of the on-board attitude's error in the vector; -1: none.

    Returns
    -------
    (n,) array
        In the units of `layout.UNITS`.
    """
    delta = errors - reference_errors
    for k in range(6):
        delta[k] = nav[k] - reference_nav[k]
    delta[6], delta[7], delta[8] = turn_between(reference_nav[6:10], nav[6:10])
    if onboard >= 0:
        turn = turn_between(reference_nav[10:], nav[10:])
        delta[onboard], delta[onboard + 1], delta[onboard + 2] = turn
    return delta
