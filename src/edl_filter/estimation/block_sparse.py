"""Matrices of one pattern: what moves the unknowns, and what noise they get, step by step.

Of some eighty unknowns most stay as they are, and those that move hang on three or four others: a few hundred numbers
a step instead of six thousand.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: A product and its sum in one rounding, for compiled loops that do little else.
FUSED = {"contract"}


@dataclass(frozen=True)
class Sparse:
    """K square matrices that are zero at the same places.

    Attributes
    ----------
    size : int
        n.
    row, column : (z,) arrays of int
        Places that are not zero throughout, sorted by row.
    values : (K, z) array
    """

    size: int
    row: NDArray[np.int64]
    column: NDArray[np.int64]
    values: Array

    def __len__(self) -> int:
        return len(self.values)

    @property
    def transposed(self) -> Sparse:
        """The same matrices, transposed."""
        order = np.lexsort((self.row, self.column))
        return Sparse(self.size, self.column[order], self.row[order], np.ascontiguousarray(self.values[:, order]))

    def __getitem__(self, k: int) -> Array:
        """The whole k-th matrix ``(n, n)``."""
        out = np.zeros((self.size, self.size))
        out[self.row, self.column] = self.values[k]
        return out


def sparse(size: int, blocks: Iterable[tuple[slice, slice, Array]]) -> Sparse:
    """Matrices from blocks ``(rows, columns, (K, r, c) values)``; blocks at the same place add up."""
    found: dict[tuple[int, int], Array] = {}
    count = 0
    for rows, columns, values in blocks:
        count = len(values)
        for i, j in np.argwhere(np.any(values != 0.0, axis=0)):
            at = (rows.start + int(i), columns.start + int(j))
            found[at] = found[at] + values[:, i, j] if at in found else values[:, i, j]
    places = sorted(found)
    return Sparse(
        size=size,
        row=np.array([p[0] for p in places], np.int64),
        column=np.array([p[1] for p in places], np.int64),
        values=np.stack([found[p] for p in places], axis=1) if places else np.zeros((count, 0)),
    )


def dense(matrices: Array) -> Sparse:
    """From whole matrices ``(K, n, n)``."""
    n = matrices.shape[1]
    return sparse(n, [(slice(0, n), slice(0, n), matrices)])


def joined(a: Sparse, b: Sparse, size: int) -> Sparse:
    """Two patterns that share no place, in matrices of `size`."""
    row, column = np.concatenate((a.row, b.row)), np.concatenate((a.column, b.column))
    order = np.lexsort((column, row))
    return Sparse(size, row[order], column[order], np.concatenate((a.values, b.values), axis=1)[:, order])


def pattern(change: Sparse) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64], Array]:
    """Rows that move, where the entries of each begin, their columns, and their values step by step."""
    moving, first = np.unique(change.row, return_index=True)
    return moving, np.append(first, len(change.row)), change.column, change.values


@njit(cache=True, error_model="numpy", fastmath=FUSED)
def move_rows(p, moving, first, column, values, moved):
    """Rows of ``(I + change) p``, in place; `moved` is room for them."""
    width = p.shape[1]
    for i in range(moving.size):
        row, out = p[moving[i]], moved[i]
        for j in range(width):
            out[j] = row[j]
        for z in range(first[i], first[i + 1]):
            v, source = values[z], p[column[z]]
            for j in range(width):
                out[j] += v * source[j]
    for i in range(moving.size):
        row, out = p[moving[i]], moved[i]
        for j in range(width):
            row[j] = out[j]


@njit(cache=True, error_model="numpy")
def transpose(p):
    """In place."""
    for i in range(p.shape[0]):
        for j in range(i):
            p[i, j], p[j, i] = p[j, i], p[i, j]
