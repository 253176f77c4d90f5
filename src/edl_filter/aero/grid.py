"""Aerodynamic table: coefficients on a full grid of Mach (or Knudsen) number and angle of attack.

Input: arrays of nodes, angles and coefficients. Method: interpolation, linear in Mach number (or in the logarithm of
the Knudsen number) and linear or monotone-cubic in the angle. A table at given Mach numbers is a *slice*: one curve
of the coefficients over the angle for each sample. The look-up evaluates a slice once, the inverse look-up many
times; computing the slice is the expensive step. Output: CA, CN and Cm about the nose.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from edl_filter.aero.pchip import pchip_coefficients
from edl_filter.types import Array, BoolArray

Kind = Literal["mach", "knudsen"]
Interpolation = Literal["linear", "pchip"]
#: Factors of CA, CN and Cm_nose in the sum that an inverse look-up solves for.
Weights = tuple[float, float, float]


class Slice(Protocol):
    """Coefficients as functions of the angle, one curve for each of N samples."""

    @property
    def outside(self) -> BoolArray:
        """True (N,) for samples whose Mach or Knudsen number is outside the table."""
        ...

    @property
    def alpha_nodes(self) -> Array:
        """Angles (A,), rad, at which the slope of a curve may be discontinuous; the first and last bound the table."""
        ...

    def evaluate(self, alpha: Array) -> Array:
        """Evaluate each curve at an angle of its own.

        Parameters
        ----------
        alpha : (N,) array
            rad.

        Returns
        -------
        (3, N) array
            CA, CN and Cm_nose, constant beyond the table's edges.
        """
        ...

    def rows(self, alpha: Array, weights: Weights) -> Array:
        """Evaluate a weighted sum of the coefficients, every curve at the same angles.

        Parameters
        ----------
        alpha : (G,) array
            rad.
        weights : tuple of float
            Factors of CA, CN and Cm_nose.

        Returns
        -------
        (N, G) array
        """
        ...

    def take(self, index: NDArray[np.intp]) -> Slice:
        """Select samples.

        Parameters
        ----------
        index : (S,) integer array
            Indices of the samples.

        Returns
        -------
        Slice
            Of S samples.
        """
        ...


class Table(ABC):
    """Table of coefficients over Mach (or Knudsen) number and angle: `GridTable` or `Surrogate`."""

    @property
    @abstractmethod
    def alpha_max(self) -> float:
        """Largest angle of the table, rad."""

    @abstractmethod
    def at(self, x: ArrayLike) -> Slice:
        """Slice of the table: the curves over the angle.

        Parameters
        ----------
        x : (N,) array
            Mach (or Knudsen) numbers.

        Returns
        -------
        Slice
            Of N samples.
        """

    def lookup(self, x: ArrayLike, alpha: ArrayLike) -> tuple[Array, Array, Array, BoolArray]:
        """Evaluate the table.

        Parameters
        ----------
        x : (...) array
            Mach (or Knudsen) numbers.
        alpha : (...) array
            Angles, rad; broadcast against `x`.

        Returns
        -------
        ca, cn, cm_nose : (...) arrays
            Coefficients, constant beyond the table's edges.
        outside : (...) boolean array
            True outside the table and for NaN.
        """
        x, alpha = np.broadcast_arrays(np.asarray(x, float), np.asarray(alpha, float))
        curves = self.at(x.ravel())
        ca, cn, cm = curves.evaluate(alpha.ravel()).reshape(3, *x.shape)
        outside = curves.outside.reshape(x.shape) | ~within(alpha, curves.alpha_nodes)
        return ca, cn, cm, outside


def within(x: Array, nodes: Array) -> BoolArray:
    """True (...) where x (...) is between the first and the last node; false for NaN."""
    return (x >= nodes[0]) & (x <= nodes[-1])


@dataclass(frozen=True, eq=False)
class GridTable(Table):
    """Table on a full grid: bilinear, or monotone-cubic (PCHIP) in the angle and linear in Mach number.

    Attributes
    ----------
    kind : "mach" or "knudsen"
        Quantity of the nodes; Knudsen numbers are interpolated in log10.
    nodes : (M,) array
        Mach or Knudsen numbers, increasing.
    alpha : (A,) array
        rad, increasing, A ≥ 2.
    CA, CN, Cm : (M, A) arrays
        Cm about the nose.
    interpolation : "linear" or "pchip"
        For PCHIP, CA is continued to negative angles as an even function, CN and Cm as odd ones, so that the curves are
        smooth at zero.
    source : str
        Origin of the numbers.
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

    def at(self, x: ArrayLike) -> GridSlice:
        """Slice at Mach (or Knudsen) numbers (N,)."""
        x = np.asarray(x, float)
        coordinate = np.clip(x, self.nodes[0], self.nodes[-1])
        if self.kind == "knudsen":
            coordinate = np.log10(coordinate)
        scale = self._scale
        last = max(len(scale) - 2, 0)
        lower = np.clip(np.searchsorted(scale, coordinate, side="right") - 1, 0, last)
        upper = np.minimum(lower + 1, len(scale) - 1)
        step = np.where(upper > lower, scale[upper] - scale[lower], 1.0)
        return GridSlice(self, lower, upper, (coordinate - scale[lower]) / step, ~within(x, self.nodes))

    @cached_property
    def _scale(self) -> Array:
        """Nodes (M,) in the coordinate of the interpolation."""
        return np.log10(self.nodes) if self.kind == "knudsen" else self.nodes

    @cached_property
    def pieces(self) -> Array:
        """Polynomials ``(M (A − 1), K, 3)`` of CA, CN and Cm between the angles (rad), highest power first."""
        values = np.stack([self.CA, self.CN, self.Cm])  # (3, M, A)
        if self.interpolation == "pchip":
            start = int(self.alpha[0] == 0.0)
            mirror = np.array([1.0, -1.0, -1.0])[:, None, None] * values[:, :, ::-1][:, :, : len(self.alpha) - start]
            angles = np.concatenate([-self.alpha[::-1][: len(self.alpha) - start], self.alpha])
            mirrored = np.concatenate([mirror, values], axis=2)
            by_angle = np.moveaxis(mirrored, 2, 0)  # (angles, 3, M)
            c = pchip_coefficients(angles, by_angle)[:, -(len(self.alpha) - 1) :]  # (4, A−1, 3, M)
        else:
            slope = np.diff(values, axis=2) / np.diff(self.alpha)
            c = np.moveaxis(np.stack([slope, values[:, :, :-1]]), 3, 1)  # (2, A−1, 3, M)
        c = np.ascontiguousarray(np.transpose(c, (3, 1, 0, 2)))
        return c.reshape(-1, *c.shape[2:])


@dataclass(frozen=True, eq=False)
class GridSlice:
    """Slice of a `GridTable` at N samples.

    Attributes
    ----------
    table : GridTable
    lower, upper : (N,) integer arrays
        Indices of the two rows of the table that are interpolated.
    fraction : (N,) array
        Weight of the upper row.
    outside : (N,) boolean array
    """

    table: GridTable
    lower: NDArray[np.intp]
    upper: NDArray[np.intp]
    fraction: Array
    outside: BoolArray

    @property
    def alpha_nodes(self) -> Array:
        """Angles (A,), rad, at which the slope of the curves may be discontinuous."""
        return self.table.alpha

    def evaluate(self, alpha: Array) -> Array:
        """CA, CN, Cm_nose (3, N), each curve at its own angle (N,), rad."""
        nodes = self.table.alpha
        clipped = np.clip(alpha, nodes[0], nodes[-1])
        piece = np.clip(np.searchsorted(nodes, clipped, side="right") - 1, 0, len(nodes) - 2)
        offset = (clipped - nodes[piece])[:, None]
        below = _horner(self.table.pieces, self.lower * (len(nodes) - 1) + piece, offset)
        if not np.any(self.fraction):
            return np.ascontiguousarray(below.T)
        above = _horner(self.table.pieces, self.upper * (len(nodes) - 1) + piece, offset)
        return np.ascontiguousarray((below + self.fraction[:, None] * (above - below)).T)

    def rows(self, alpha: Array, weights: Weights) -> Array:
        """Weighted sum of the coefficients (N, G) at common angles (G,), rad."""
        count = len(self.table.nodes)
        all_nodes = GridSlice(
            self.table,
            *(np.repeat(np.arange(count), len(alpha)),) * 2,
            np.zeros(count * len(alpha)),
            np.zeros(count * len(alpha), bool),
        )
        basis = np.tensordot(weights, all_nodes.evaluate(np.tile(alpha, count)), 1).reshape(count, -1)
        below = basis[self.lower]
        return below + self.fraction[:, None] * (basis[self.upper] - below)

    def take(self, index: NDArray[np.intp]) -> GridSlice:
        """Slice of the samples at the indices (S,)."""
        return GridSlice(self.table, self.lower[index], self.upper[index], self.fraction[index], self.outside[index])


def _horner(pieces: Array, index: NDArray[np.intp], offset: Array) -> Array:
    """Values (N, 3) of the polynomials at the indices (N,), offset (N, 1) from their first angle."""
    c = pieces[index]
    value = c[:, 0]
    for k in range(1, c.shape[1]):
        value = value * offset + c[:, k]
    return value
