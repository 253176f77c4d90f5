"""Inverse look-up: the angle that a measured force or moment asks for, and whether it is the only one.

Where the moment is not monotone in the angle, as in the bounded static instabilities, several angles give the
same moment; where a measurement exceeds the table's largest value, none does. Both are said, not hidden.

Each sample's curve is laid over a grid of signed angles (the table's own, every half degree, and closer at
zero). Its changes of sign give brackets, folds that hide a pair of solutions between two grid points are searched
for, and the chosen bracket is closed by bisection and inverse quadratic interpolation (Chandrupatla 1997), all
samples at once.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from edl_filter.aero.database import Database
from edl_filter.aero.grid import Array, Slice, Weights

#: Samples worked on at once; bounds the memory to some megabytes.
_CHUNK = 8192
#: Angles at which curves are laid out, rad: closer where instabilities begin, at zero.
_STEPS = np.concatenate(
    [[0.0, 1e-4, 5e-4, 2e-3, 4e-3, 6e-3], np.radians([*np.arange(0.5, 10.0, 0.5), *np.arange(10.0, 181.0)])]
)


class Solutions(IntEnum):
    """How many angles give the coefficient, within the tables' range of angles."""

    NONE = 0
    UNIQUE = 1
    SEVERAL = 2


@dataclass(frozen=True, eq=False)
class InverseResult:
    """Angles found.

    Attributes
    ----------
    alpha : (N,) array
        rad, with sign; NaN where there is none. Of several, the one nearest to the hint, or to zero.
    status : (N,) array of int8
        `Solutions`.
    count : (N,) array of int
        Number of solutions.
    """

    alpha: Array
    status: NDArray[np.int8]
    count: NDArray[np.intp]


def angle_from_cn(
    database: Database,
    cn: ArrayLike,
    mach: ArrayLike,
    knudsen: ArrayLike,
    speed: ArrayLike | None = None,
    *,
    hint: ArrayLike | None = None,
    signed: bool = True,
) -> InverseResult:
    """Angle that gives a normal-force coefficient.

    Parameters
    ----------
    database : Database
    cn : (N,) array_like
        Total coefficient, or that of a plane with its sign; for sideways, −CY gives the angle towards +v.
    mach, knudsen, speed : (N,) array_like
        As for `Database.lookup`.
    hint : (N,) array_like, optional
        rad; the reconstructed angle, to choose among several.
    signed : bool
        Search negative angles as well (coefficients are odd in the angle); otherwise only 0 and above.
    """
    return _solve(database, (0.0, 1.0, 0.0), cn, mach, knudsen, speed, hint, signed)


def angle_from_cm(
    database: Database,
    cm: ArrayLike,
    mach: ArrayLike,
    knudsen: ArrayLike,
    speed: ArrayLike | None = None,
    *,
    x_over_d: float,
    z_over_d: float = 0.0,
    hint: ArrayLike | None = None,
    signed: bool = True,
) -> InverseResult:
    """Angle that gives a pitching moment about the centre of mass.

    As `angle_from_cn`; for sideways, −Cn gives the angle towards +v, with the offset to the right in place of
    the one below the axis.

    Parameters
    ----------
    x_over_d, z_over_d : float
        Centre of mass behind the nose and below the axis, in diameters.
    """
    return _solve(database, (z_over_d, x_over_d, 1.0), cm, mach, knudsen, speed, hint, signed)


def _solve(
    database: Database,
    weights: Weights,
    target: ArrayLike,
    mach: ArrayLike,
    knudsen: ArrayLike,
    speed: ArrayLike | None,
    hint: ArrayLike | None,
    signed: bool,
) -> InverseResult:
    inputs = (target, mach, knudsen, np.nan if speed is None else speed, 0.0 if hint is None else hint)
    wanted, mach, knudsen, speeds, near = np.broadcast_arrays(*(np.atleast_1d(np.asarray(x, float)) for x in inputs))
    alpha, count = np.full(len(wanted), np.nan), np.zeros(len(wanted), np.intp)
    for start in range(0, len(wanted), _CHUNK):
        part = slice(start, start + _CHUNK)
        cut = database.at(mach[part], knudsen[part], None if speed is None else speeds[part])
        alpha[part], count[part] = _solve_chunk(_Curves(cut, weights), wanted[part], near[part], signed)
    return InverseResult(alpha, np.minimum(count, 2).astype(np.int8), count)


class Brackets(NamedTuple):
    """Steps of the angle across which curves change sign: sample, ends, and residuals there."""

    row: NDArray[np.intp]
    low: Array
    high: Array
    g_low: Array
    g_high: Array


_NO_BRACKETS = Brackets(np.zeros(0, np.intp), *(np.zeros(0),) * 4)


@dataclass(frozen=True, eq=False)
class _Curves:
    """One signed curve per sample: CN and Cm odd in the angle, CA even."""

    cut: Slice
    weights: Weights

    def at(self, alpha: Array) -> Array:
        ca, cn, cm = self.cut.evaluate(np.abs(alpha))
        wa, wn, wm = self.weights
        return wa * ca + np.sign(alpha) * (wn * cn + wm * cm)

    def take(self, index: NDArray[np.intp]) -> _Curves:
        return _Curves(self.cut.take(index), self.weights)

    def grid(self, signed: bool) -> tuple[Array, Array]:
        """Angles (G,) and curves there (N, G)."""
        nodes = self.cut.alpha_nodes
        steps = _STEPS[nodes[-1] > _STEPS]
        far = np.min(np.abs(steps[:, None] - nodes), axis=1) > 1e-6
        alpha = np.sort(np.concatenate([nodes, steps[far & (steps > nodes[0])]]))
        wa, wn, wm = self.weights
        odd = self.cut.rows(alpha, (0.0, wn, wm))
        even = self.cut.rows(alpha, (wa, 0.0, 0.0)) if wa else 0.0
        if not signed:
            return alpha, odd + even
        zero = int(alpha[0] == 0.0)
        both = np.concatenate([(even - odd)[:, : zero - 1 if zero else None : -1], odd + even], axis=1)
        return np.concatenate([-alpha[: zero - 1 if zero else None : -1], alpha]), both


def _solve_chunk(curves: _Curves, target: Array, hint: Array, signed: bool) -> tuple[Array, NDArray[np.intp]]:
    """Angle nearest to the hint (NaN if none) and number of solutions of each sample."""
    grid, g = curves.grid(signed)
    g = g - target[:, None]
    above = g >= 0.0
    # A solution on the edge itself must not hang on the last bit of a sum
    for edge, inner in ((0, 1), (-1, -2)):
        above[:, edge] = np.where(np.abs(g[:, edge]) < 1e-13, ~above[:, inner], above[:, edge])
    row, column = np.nonzero(above[:, 1:] != above[:, :-1])
    seen = Brackets(row, grid[column], grid[column + 1], g[row, column], g[row, column + 1])
    folds = _hidden_pairs(curves, target, grid, g)
    row, low, high, g_low, g_high = (np.concatenate(pair) for pair in zip(seen, folds, strict=True))
    if 0.0 not in grid:  # the jump of a table that does not start at zero angle is no solution
        real = ~((low < 0.0) & (high > 0.0))
        row, low, high, g_low, g_high = (x[real] for x in (row, low, high, g_low, g_high))
    count = np.bincount(row, minlength=len(target))
    flat = g_high == g_low
    guess = low - np.where(flat, 0.0, g_low) * (high - low) / np.where(flat, 1.0, g_high - g_low)
    order = np.lexsort((np.abs(guess - hint[row]), row))
    _, first = np.unique(row[order], return_index=True)
    chosen = order[first]
    alpha = np.full(len(target), np.nan)
    found = row[chosen]
    alpha[found] = _close(curves.take(found), target[found], low[chosen], high[chosen])
    return alpha, count


def _hidden_pairs(curves: _Curves, target: Array, grid: Array, g: Array) -> Brackets:
    """Brackets of solutions that lie in pairs between two grid points, beside a fold of the curve.

    Where a curve heads for zero from both ends of a step and is near enough to reach it, it is followed to its
    extremum; if that lies across, it parts the step into two brackets.
    """
    rise = np.diff(g, axis=1)
    # Slopes at a step's ends turn only where the rise of neighbouring steps does
    turns = (rise[:, :-1] < 0.0) != (rise[:, 1:] < 0.0)
    near = np.zeros(rise.shape, bool)
    near[:, [0, -1]] = True  # a turn in the last step has no neighbour to show it
    near[:, :-1] |= turns
    near[:, 1:] |= turns
    row, column = np.nonzero(near)
    g_low, g_high = g[row, column], g[row, column + 1]
    reach = np.abs(rise[row, column])
    for beside in (np.maximum(column - 1, 0), np.minimum(column + 1, g.shape[1] - 2)):
        reach = np.maximum(reach, np.abs(rise[row, beside]))
    close = ((g_low >= 0.0) == (g_high >= 0.0)) & (np.minimum(np.abs(g_low), np.abs(g_high)) < reach)
    row, column = row[close], column[close]
    if not len(row):
        return _NO_BRACKETS
    some, wanted = curves.take(row), target[row]
    sign = np.where(g[row, column] >= 0.0, 1.0, -1.0)
    left, right = grid[column], grid[column + 1]
    golden = (np.sqrt(5.0) - 1.0) / 2.0
    best, depth = left, np.full(len(row), np.inf)
    for _ in range(22):  # golden section to 1e-6 rad, a depth of 1e-13
        c, d = right - golden * (right - left), left + golden * (right - left)
        f_c, f_d = sign * (some.at(c) - wanted), sign * (some.at(d) - wanted)
        for x, f in ((c, f_c), (d, f_d)):
            best, depth = np.where(f < depth, x, best), np.minimum(f, depth)
        left, right = np.where(f_c < f_d, left, c), np.where(f_c < f_d, d, right)
    cross = depth < 0.0
    row, column, best, bottom = row[cross], column[cross], best[cross], (sign * depth)[cross]
    return Brackets(
        np.concatenate([row, row]),
        np.concatenate([grid[column], best]),
        np.concatenate([best, grid[column + 1]]),
        np.concatenate([g[row, column], bottom]),
        np.concatenate([bottom, g[row, column + 1]]),
    )


def _close(curves: _Curves, target: Array, low: Array, high: Array) -> Array:
    """Roots in brackets, all at once (Chandrupatla 1997)."""
    a, b = high.copy(), low.copy()  # b is the newest point, a the other end of its bracket
    f_a, f_b = curves.at(a) - target, curves.at(b) - target
    best, f_best = np.where(np.abs(f_a) < np.abs(f_b), a, b), np.minimum(np.abs(f_a), np.abs(f_b))
    part = np.full(len(a), 0.5)
    for _ in range(60):
        width = np.abs(b - a)
        if np.all((f_best < 1e-16) | (width < 1e-13)):
            break
        x = a + part * (b - a)
        f_x = curves.at(x) - target
        better = np.abs(f_x) < f_best
        best, f_best = np.where(better, x, best), np.minimum(np.abs(f_x), f_best)
        same = np.sign(f_x) == np.sign(f_a)
        c, f_c = np.where(same, a, b), np.where(same, f_a, f_b)
        b, f_b = np.where(same, b, a), np.where(same, f_b, f_a)
        a, f_a = x, f_x
        part = _next_part(a, b, c, f_a, f_b, f_c)
    return best


def _next_part(a: Array, b: Array, c: Array, f_a: Array, f_b: Array, f_c: Array) -> Array:
    """Where to go between a and b: inverse quadratic if the three points allow it, else the middle."""
    with np.errstate(divide="ignore", invalid="ignore"):
        xi, phi = (a - b) / (c - b), (f_a - f_b) / (f_c - f_b)
        smooth = (phi**2 < xi) & ((1.0 - phi) ** 2 < 1.0 - xi)
        quadratic = f_a / (f_b - f_a) * f_c / (f_b - f_c) + (c - a) / (b - a) * f_a / (f_c - f_a) * f_b / (f_c - f_b)
    smooth &= np.isfinite(quadratic)
    # never closer to an end than round-off of the bracket can tell
    edge = np.minimum(1e-14 / np.maximum(np.abs(b - a), 1e-14), 0.5)
    return np.where(smooth, np.clip(quadratic, edge, 1.0 - edge), 0.5)
