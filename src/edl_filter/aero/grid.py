"""One aerodynamic table: coefficients on a full grid of Mach (or Knudsen) number and angle.

Every table can be cut at given nodes into a *slice*, one curve over the angle per sample. The look-up
evaluates a slice once, the inverse look-up many times, and the cut is what is dear.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import PchipInterpolator

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]
Kind = Literal["mach", "knudsen"]
Interpolation = Literal["linear", "pchip"]
#: Parts of CA, CN and Cm_nose in a sum that an inverse look-up solves for.
Weights = tuple[float, float, float]


class Slice(Protocol):
    """Coefficients over the angle, one curve for each of N samples."""

    @property
    def outside(self) -> Bools:
        """(N,) samples whose Mach or Knudsen number lies outside the table."""
        ...

    @property
    def alpha_nodes(self) -> Array:
        """Angles in rad where a curve may have a kink; the first and last bound the table."""
        ...

    def evaluate(self, alpha: Array) -> Array:
        """(3, N) CA, CN and Cm_nose, each curve at its own angle (N,), held at the edges."""
        ...

    def rows(self, alpha: Array, weights: Weights) -> Array:
        """(N, G) weighted sum of CA, CN and Cm_nose, every curve at the same angles (G,)."""
        ...

    def take(self, index: NDArray[np.intp]) -> Slice:
        """The slice of some of the samples."""
        ...


class Table(Protocol):
    """What `GridTable` and `Surrogate` have in common."""

    @property
    def alpha_max(self) -> float:
        """Largest angle of the table, rad."""
        ...

    def at(self, x: ArrayLike) -> Slice:
        """The curves at Mach (or Knudsen) numbers (N,)."""
        ...


def look_up(table: Table, x: ArrayLike, alpha: ArrayLike) -> tuple[Array, Array, Array, Bools]:
    """Evaluate a table at Mach (or Knudsen) numbers and angles that broadcast against each other.

    Returns
    -------
    tuple of arrays
        CA, CN, Cm_nose and whether the point lies outside the table (NaN does).
    """
    x, alpha = np.broadcast_arrays(np.asarray(x, float), np.asarray(alpha, float))
    cut = table.at(x.ravel())
    ca, cn, cm = cut.evaluate(alpha.ravel()).reshape(3, *x.shape)
    outside = cut.outside.reshape(x.shape) | ~within(alpha, cut.alpha_nodes)
    return ca, cn, cm, outside


def within(x: Array, nodes: Array) -> Bools:
    """Whether x lies between the first and the last node; NaN does not."""
    return (x >= nodes[0]) & (x <= nodes[-1])


@dataclass(frozen=True, eq=False)
class GridTable:
    """A table on a full grid: bilinear, or monotone-cubic (PCHIP) in the angle and linear in Mach.

    Attributes
    ----------
    kind : "mach" or "knudsen"
        What the nodes are; Knudsen numbers are interpolated in their log10.
    nodes : (M,) array
        Increasing.
    alpha : (A,) array
        rad, increasing, A ≥ 2.
    CA, CN, Cm : (M, A) arrays
        Cm about the nose.
    interpolation : "linear" or "pchip"
        PCHIP takes CA as even and CN and Cm as odd in the angle, so that the curve is smooth at zero.
    source : str
        Where the numbers come from.
    """

    kind: Kind
    nodes: Array
    alpha: Array
    CA: Array
    CN: Array
    Cm: Array
    interpolation: Interpolation = "linear"
    source: str = ""

    @property
    def alpha_max(self) -> float:
        """Largest angle, rad."""
        return float(self.alpha[-1])

    def lookup(self, x: ArrayLike, alpha: ArrayLike) -> tuple[Array, Array, Array, Bools]:
        """CA, CN, Cm_nose and whether the point lies outside (`look_up`)."""
        return look_up(self, x, alpha)

    def at(self, x: ArrayLike) -> GridSlice:
        """The curves at Mach (or Knudsen) numbers (N,)."""
        x = np.asarray(x, float)
        held = np.clip(x, self.nodes[0], self.nodes[-1])
        if self.kind == "knudsen":
            held = np.log10(held)
        scale = self._scale
        last = max(len(scale) - 2, 0)
        lower = np.clip(np.searchsorted(scale, held, side="right") - 1, 0, last)
        upper = np.minimum(lower + 1, len(scale) - 1)
        step = np.where(upper > lower, scale[upper] - scale[lower], 1.0)
        return GridSlice(self, lower, upper, (held - scale[lower]) / step, ~within(x, self.nodes))

    @cached_property
    def _scale(self) -> Array:
        return np.log10(self.nodes) if self.kind == "knudsen" else self.nodes

    @cached_property
    def pieces(self) -> Array:
        """(M (A−1), K, 3) coefficients of the pieces between angles, highest power first."""
        values = np.stack([self.CA, self.CN, self.Cm])  # (3, M, A)
        if self.interpolation == "pchip":
            start = int(self.alpha[0] == 0.0)
            mirror = np.array([1.0, -1.0, -1.0])[:, None, None] * values[:, :, ::-1][:, :, : len(self.alpha) - start]
            angles = np.concatenate([-self.alpha[::-1][: len(self.alpha) - start], self.alpha])
            whole = np.concatenate([mirror, values], axis=2)
            c = PchipInterpolator(angles, whole, axis=2).c[:, -(len(self.alpha) - 1) :]  # (4, A−1, 3, M)
        else:
            slope = np.diff(values, axis=2) / np.diff(self.alpha)
            c = np.moveaxis(np.stack([slope, values[:, :, :-1]]), 3, 1)  # (2, A−1, 3, M)
        c = np.ascontiguousarray(np.transpose(c, (3, 1, 0, 2)))
        return c.reshape(-1, *c.shape[2:])


@dataclass(frozen=True, eq=False)
class GridSlice:
    """A `GridTable` cut at N nodes: two of its rows each, and the part of the upper one."""

    table: GridTable
    lower: NDArray[np.intp]
    upper: NDArray[np.intp]
    part: Array
    outside: Bools

    @property
    def alpha_nodes(self) -> Array:
        """Angles where the curves may have a kink, rad."""
        return self.table.alpha

    def evaluate(self, alpha: Array) -> Array:
        """(3, N) coefficients, each curve at its own angle."""
        nodes = self.table.alpha
        held = np.clip(alpha, nodes[0], nodes[-1])
        piece = np.clip(np.searchsorted(nodes, held, side="right") - 1, 0, len(nodes) - 2)
        beyond = (held - nodes[piece])[:, None]
        below = _horner(self.table.pieces, self.lower * (len(nodes) - 1) + piece, beyond)
        if not np.any(self.part):
            return np.ascontiguousarray(below.T)
        above = _horner(self.table.pieces, self.upper * (len(nodes) - 1) + piece, beyond)
        return np.ascontiguousarray((below + self.part[:, None] * (above - below)).T)

    def rows(self, alpha: Array, weights: Weights) -> Array:
        """(N, G) weighted sum of the coefficients at common angles (G,)."""
        count = len(self.table.nodes)
        every = GridSlice(
            self.table,
            *(np.repeat(np.arange(count), len(alpha)),) * 2,
            np.zeros(count * len(alpha)),
            np.zeros(count * len(alpha), bool),
        )
        basis = np.tensordot(weights, every.evaluate(np.tile(alpha, count)), 1).reshape(count, -1)
        below = basis[self.lower]
        return below + self.part[:, None] * (basis[self.upper] - below)

    def take(self, index: NDArray[np.intp]) -> GridSlice:
        """The slice of some of the samples."""
        return GridSlice(self.table, self.lower[index], self.upper[index], self.part[index], self.outside[index])


def _horner(pieces: Array, index: NDArray[np.intp], beyond: Array) -> Array:
    c = pieces[index]
    value = c[:, 0]
    for k in range(1, c.shape[1]):
        value = value * beyond + c[:, k]
    return value
