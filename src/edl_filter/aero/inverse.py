"""Inverse look-up: angle of attack from a normal-force or pitching-moment coefficient.

Input: coefficients of a flight, Mach and Knudsen numbers. Output: an angle for each sample and whether it is unique.
Where the moment is not monotone in the angle, as in the bounded static instabilities, several angles give the same
moment; where a coefficient exceeds the largest value of the table there is no solution.

Method: the curve of each sample is evaluated on a grid of signed angles (those of the table, every half degree, and
more closely near zero). Sign changes of the residual are brackets. Extrema between two grid points, which can hide a
pair of solutions, are located by golden-section search. The root in the selected bracket is computed by bisection and
inverse quadratic interpolation (Chandrupatla 1997), for all samples at once.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from edl_filter.aero.database import Database
from edl_filter.aero.grid import Slice, Weights
from edl_filter.types import Array

#: Samples processed at once; limits the memory to some megabytes.
_CHUNK = 8192
#: Angles of the grid, rad: more closely spaced near zero, where the instabilities begin.
_STEPS = np.concatenate(
    [[0.0, 1e-4, 5e-4, 2e-3, 4e-3, 6e-3], np.radians([*np.arange(0.5, 10.0, 0.5), *np.arange(10.0, 181.0)])]
)


class Solutions(IntEnum):
    """Number of angles, within the range of the tables, that give the coefficient."""

    NONE = 0
    UNIQUE = 1
    SEVERAL = 2


@dataclass(frozen=True, eq=False)
class InverseResult:
    """Solutions of an inverse look-up.

    Attributes
    ----------
    alpha : (N,) array
        Signed angle, rad; NaN without a solution. Of several solutions, the one nearest to the hint, or to zero.
    status : (N,) array of int8
        Value of `Solutions`.
    """

    alpha: Array
    status: NDArray[np.int8]


def angle_from_cn(
    database: Database,
    cn: ArrayLike,
    mach: ArrayLike,
    knudsen: ArrayLike,
    speed: ArrayLike | None = None,
    *,
    hint: ArrayLike | None = None,
) -> InverseResult:
    """Angle of attack that gives a normal-force coefficient.

    Parameters
    ----------
    database : Database
        Tables that are inverted.
    cn : (N,) array
        Total coefficient, or the signed component in one plane; in the yaw plane −CY gives the angle towards +v.
    mach, knudsen : (N,) arrays
        Mach number, and Knudsen number based on the diameter.
    speed : (N,) array, optional
        Air-relative speed, m/s; needed if the database is indexed by speed.
    hint : (N,) array, optional
        rad; the reconstructed angle, to select one of several solutions.

    Returns
    -------
    InverseResult
    """
    return _solve(database, (0.0, 1.0, 0.0), cn, mach, knudsen, speed, hint)


def angle_from_cm(
    database: Database,
    cm: ArrayLike,
    mach: ArrayLike,
    knudsen: ArrayLike,
    speed: ArrayLike | None = None,
    *,
    x_over_d: float,
    hint: ArrayLike | None = None,
) -> InverseResult:
    """Angle of attack that gives a pitching-moment coefficient about the centre of mass.

    Parameters
    ----------
    database : Database
        Tables that are inverted.
    cm : (N,) array
        Total coefficient, or the signed component in one plane; in the yaw plane −Cn gives the angle towards +v.
    mach, knudsen, speed, hint
        As for `angle_from_cn`.
    x_over_d : float
        Centre of mass behind the nose, in diameters.

    Returns
    -------
    InverseResult
    """
    return _solve(database, (0.0, x_over_d, 1.0), cm, mach, knudsen, speed, hint)


def _solve(
    database: Database,
    weights: Weights,
    target: ArrayLike,
    mach: ArrayLike,
    knudsen: ArrayLike,
    speed: ArrayLike | None,
    hint: ArrayLike | None,
) -> InverseResult:
    """Angles at which the weighted sum of CN and Cm_nose is the target."""
    inputs = (target, mach, knudsen, np.nan if speed is None else speed, 0.0 if hint is None else hint)
    target, mach, knudsen, speeds, hint = np.broadcast_arrays(*(np.atleast_1d(np.asarray(x, float)) for x in inputs))
    alpha, count = np.full(len(target), np.nan), np.zeros(len(target), np.intp)
    for start in range(0, len(target), _CHUNK):
        chunk = slice(start, start + _CHUNK)
        curves = _Curves(database.at(mach[chunk], knudsen[chunk], None if speed is None else speeds[chunk]), weights)
        alpha[chunk], count[chunk] = _solve_chunk(curves, target[chunk], hint[chunk])
    return InverseResult(alpha, np.minimum(count, Solutions.SEVERAL).astype(np.int8))


class Brackets(NamedTuple):
    """Intervals of the angle in which the residual of a sample changes sign.

    Attributes
    ----------
    row : (B,) integer array
        Sample.
    low, high : (B,) arrays
        Ends of the interval, rad.
    g_low, g_high : (B,) arrays
        Residuals at the ends.
    """

    row: NDArray[np.intp]
    low: Array
    high: Array
    g_low: Array
    g_high: Array


_NO_BRACKETS = Brackets(np.zeros(0, np.intp), *(np.zeros(0),) * 4)


@dataclass(frozen=True, eq=False)
class _Curves:
    """One curve over the signed angle per sample, from a slice over angles ≥ 0: CN and Cm are odd."""

    unsigned: Slice
    weights: Weights

    def at(self, alpha: Array) -> Array:
        """Values (N,), each curve at its own angle (N,), rad."""
        _, cn, cm = self.unsigned.evaluate(np.abs(alpha))
        _, wn, wm = self.weights
        return np.sign(alpha) * (wn * cn + wm * cm)

    def take(self, index: NDArray[np.intp]) -> _Curves:
        """Curves of the samples at the indices (S,)."""
        return _Curves(self.unsigned.take(index), self.weights)

    def grid(self) -> tuple[Array, Array]:
        """Angles (G,), rad, and values of the curves at them (N, G)."""
        nodes = self.unsigned.alpha_nodes
        steps = _STEPS[nodes[-1] > _STEPS]
        distinct = np.min(np.abs(steps[:, None] - nodes), axis=1) > 1e-6
        alpha = np.sort(np.concatenate([nodes, steps[distinct & (steps > nodes[0])]]))
        odd = self.unsigned.rows(alpha, self.weights)
        zero = int(alpha[0] == 0.0)
        both_signs = np.concatenate([-odd[:, : zero - 1 if zero else None : -1], odd], axis=1)
        return np.concatenate([-alpha[: zero - 1 if zero else None : -1], alpha]), both_signs


def _solve_chunk(curves: _Curves, target: Array, hint: Array) -> tuple[Array, NDArray[np.intp]]:
    """Solution nearest to the hint (N,), rad, NaN if there is none, and number of solutions of each sample (N,)."""
    grid, g = curves.grid()
    g = g - target[:, None]
    above = g >= 0.0
    # A solution at the edge of the table must not depend on the rounding of a sum
    for edge, inner in ((0, 1), (-1, -2)):
        above[:, edge] = np.where(np.abs(g[:, edge]) < 1e-13, ~above[:, inner], above[:, edge])
    row, column = np.nonzero(above[:, 1:] != above[:, :-1])
    sign_changes = Brackets(row, grid[column], grid[column + 1], g[row, column], g[row, column + 1])
    hidden_pairs = _hidden_pairs(curves, target, grid, g)
    row, low, high, g_low, g_high = (np.concatenate(pair) for pair in zip(sign_changes, hidden_pairs, strict=True))
    if 0.0 not in grid:  # the discontinuity at zero of a table that does not start at zero angle is no solution
        continuous = ~((low < 0.0) & (high > 0.0))
        row, low, high, g_low, g_high = (x[continuous] for x in (row, low, high, g_low, g_high))
    count = np.bincount(row, minlength=len(target))
    flat = g_high == g_low
    linear_root = low - np.where(flat, 0.0, g_low) * (high - low) / np.where(flat, 1.0, g_high - g_low)
    order = np.lexsort((np.abs(linear_root - hint[row]), row))
    _, first = np.unique(row[order], return_index=True)
    nearest = order[first]
    alpha = np.full(len(target), np.nan)
    solved = row[nearest]
    alpha[solved] = _find_roots(curves.take(solved), target[solved], low[nearest], high[nearest])
    return alpha, count


def _hidden_pairs(curves: _Curves, target: Array, grid: Array, g: Array) -> Brackets:
    """Brackets of pairs of solutions between two grid points, on both sides of an extremum of the curve.

    Candidates are the intervals in which the residual may have an extremum and is closer to zero than it changes over
    neighbouring intervals. The extremum is located; if the residual has the opposite sign there, it divides the
    interval into two brackets.
    """
    change = np.diff(g, axis=1)
    # The slope can change sign within an interval only where the change over neighbouring intervals has different signs
    reverses = (change[:, :-1] < 0.0) != (change[:, 1:] < 0.0)
    candidate = np.zeros(change.shape, bool)
    candidate[:, [0, -1]] = True  # the first and the last interval have only one neighbour
    candidate[:, :-1] |= reverses
    candidate[:, 1:] |= reverses
    row, column = np.nonzero(candidate)
    g_low, g_high = g[row, column], g[row, column + 1]
    largest_change = np.abs(change[row, column])
    for neighbour in (np.maximum(column - 1, 0), np.minimum(column + 1, g.shape[1] - 2)):
        largest_change = np.maximum(largest_change, np.abs(change[row, neighbour]))
    same_sign = (g_low >= 0.0) == (g_high >= 0.0)
    near_zero = same_sign & (np.minimum(np.abs(g_low), np.abs(g_high)) < largest_change)
    row, column = row[near_zero], column[near_zero]
    if not len(row):
        return _NO_BRACKETS
    curves, target = curves.take(row), target[row]
    sign = np.where(g[row, column] >= 0.0, 1.0, -1.0)
    low, high = grid[column], grid[column + 1]
    golden = (np.sqrt(5.0) - 1.0) / 2.0
    extremum, minimum = low, np.full(len(row), np.inf)
    for _ in range(22):  # golden section to 1e-6 rad, where the residual is accurate to 1e-13
        c, d = high - golden * (high - low), low + golden * (high - low)
        f_c, f_d = sign * (curves.at(c) - target), sign * (curves.at(d) - target)
        for x, f in ((c, f_c), (d, f_d)):
            extremum, minimum = np.where(f < minimum, x, extremum), np.minimum(f, minimum)
        low, high = np.where(f_c < f_d, low, c), np.where(f_c < f_d, d, high)
    crosses = minimum < 0.0
    row, column, extremum, g_extremum = row[crosses], column[crosses], extremum[crosses], (sign * minimum)[crosses]
    return Brackets(
        np.concatenate([row, row]),
        np.concatenate([grid[column], extremum]),
        np.concatenate([extremum, grid[column + 1]]),
        np.concatenate([g[row, column], g_extremum]),
        np.concatenate([g_extremum, g[row, column + 1]]),
    )


def _find_roots(curves: _Curves, target: Array, low: Array, high: Array) -> Array:
    """Roots (B,), rad, in brackets, all at once (Chandrupatla 1997)."""
    a, b = high.copy(), low.copy()  # a becomes the newest point, b the opposite end of its bracket
    f_a, f_b = curves.at(a) - target, curves.at(b) - target
    best, f_best = np.where(np.abs(f_a) < np.abs(f_b), a, b), np.minimum(np.abs(f_a), np.abs(f_b))
    fraction = np.full(len(a), 0.5)
    for _ in range(60):
        width = np.abs(b - a)
        if np.all((f_best < 1e-16) | (width < 1e-13)):
            break
        x = a + fraction * (b - a)
        f_x = curves.at(x) - target
        better = np.abs(f_x) < f_best
        best, f_best = np.where(better, x, best), np.minimum(np.abs(f_x), f_best)
        same_sign = np.sign(f_x) == np.sign(f_a)
        c, f_c = np.where(same_sign, a, b), np.where(same_sign, f_a, f_b)
        b, f_b = np.where(same_sign, b, a), np.where(same_sign, f_b, f_a)
        a, f_a = x, f_x
        fraction = _next_fraction(a, b, c, f_a, f_b, f_c)
    return best


def _next_fraction(a: Array, b: Array, c: Array, f_a: Array, f_b: Array, f_c: Array) -> Array:
    """Next point between a (0) and b (1): inverse quadratic interpolation if it is valid, otherwise bisection."""
    with np.errstate(divide="ignore", invalid="ignore"):
        xi, phi = (a - b) / (c - b), (f_a - f_b) / (f_c - f_b)
        valid = (phi**2 < xi) & ((1.0 - phi) ** 2 < 1.0 - xi)
        quadratic = f_a / (f_b - f_a) * f_c / (f_b - f_c) + (c - a) / (b - a) * f_a / (f_c - f_a) * f_b / (f_c - f_b)
    valid &= np.isfinite(quadratic)
    # The distance from an end of the bracket is at least its rounding error
    margin = np.minimum(1e-14 / np.maximum(np.abs(b - a), 1e-14), 0.5)
    return np.where(valid, np.clip(quadratic, margin, 1.0 - margin), 0.5)
