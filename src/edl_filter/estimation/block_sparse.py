"""Sequences of square matrices that share one pattern of non-zero elements.

The transition matrices and process-noise matrices of a linear state-space model with many constant states are mostly
zero, at the same places in every step. Storing the non-zero elements only reduces a product with an ``(n, n)`` matrix
from n² to a few times n elements per column (coordinate format: Golub and Van Loan, Matrix Computations, 2013, ch. 11).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numba import njit

from edl_filter.types import Array, IntArray

#: Lets a compiled loop contract a product and a sum into one rounding. A function with it is put in line into its
#: callers: as a function of its own it would be compiled twice, once by itself and once within its caller, with
#: different roundings, and which of the two runs depends on whether the process compiled it or read it from the cache.
FUSED = {"contract"}


@dataclass(frozen=True)
class BlockSparse:
    """K square matrices with the same pattern of non-zero elements.

    Attributes
    ----------
    size : int
        n, the order of each matrix.
    row, column : (z,) arrays of int
        Places of the elements that are not zero in all matrices, sorted by row.
    values : (K, z) array
        Elements at these places.
    """

    size: int
    row: IntArray
    column: IntArray
    values: Array

    def __len__(self) -> int:
        return len(self.values)

    @property
    def transposed(self) -> BlockSparse:
        """The transposed matrices."""
        order = np.lexsort((self.row, self.column))
        return BlockSparse(self.size, self.column[order], self.row[order], np.ascontiguousarray(self.values[:, order]))

    def __getitem__(self, k: int) -> Array:
        """The k-th matrix in full, ``(n, n)``."""
        out = np.zeros((self.size, self.size))
        out[self.row, self.column] = self.values[k]
        return out


def from_blocks(size: int, blocks: Iterable[tuple[slice, slice, Array]]) -> BlockSparse:
    """Matrices composed of dense blocks; blocks at the same place add up.

    Parameters
    ----------
    size : int
        n, the order of each matrix.
    blocks : iterable of (slice, slice, (K, r, c) array)
        Rows and columns of a block, and its values in each of the K matrices.
    """
    elements: dict[tuple[int, int], Array] = {}
    count = 0
    for rows, columns, values in blocks:
        count = len(values)
        for i, j in np.argwhere(np.any(values != 0.0, axis=0)):
            place = (rows.start + int(i), columns.start + int(j))
            elements[place] = elements[place] + values[:, i, j] if place in elements else values[:, i, j]
    places = sorted(elements)
    return BlockSparse(
        size=size,
        row=np.array([p[0] for p in places], np.int64),
        column=np.array([p[1] for p in places], np.int64),
        values=np.stack([elements[p] for p in places], axis=1) if places else np.zeros((count, 0)),
    )


def merge(a: BlockSparse, b: BlockSparse, size: int) -> BlockSparse:
    """The sum of two sequences whose patterns share no place, as matrices of order `size`."""
    row, column = np.concatenate((a.row, b.row)), np.concatenate((a.column, b.column))
    order = np.lexsort((column, row))
    return BlockSparse(size, row[order], column[order], np.concatenate((a.values, b.values), axis=1)[:, order])


def row_pattern(increment: BlockSparse) -> tuple[IntArray, IntArray, IntArray, Array]:
    """The arguments that `transform_rows` needs of increments ``D_k``.

    Returns
    -------
    rows : (m,) array of int
        Rows that are not zero.
    first : (m + 1,) array of int
        Index of the first element of each of these rows, and the number of elements.
    columns : (z,) array of int
    values : (K, z) array
    """
    rows, first = np.unique(increment.row, return_index=True)
    return rows, np.append(first, len(increment.row)), increment.column, increment.values


@njit(cache=True, error_model="numpy", fastmath=FUSED, inline="always")
def transform_rows(p, rows, first, column, values, work):
    """``(I + D) p``, in place.

    Parameters
    ----------
    p : (n, c) array
        Changed in place.
    rows, first, column : arrays of int
        Of `row_pattern`.
    values : (z,) array
        Elements of D.
    work : (m, c) array
        Working space.
    """
    width = p.shape[1]
    for i in range(rows.size):
        row, out = p[rows[i]], work[i]
        for j in range(width):
            out[j] = row[j]
        for z in range(first[i], first[i + 1]):
            v, source = values[z], p[column[z]]
            for j in range(width):
                out[j] += v * source[j]
    for i in range(rows.size):
        row, out = p[rows[i]], work[i]
        for j in range(width):
            row[j] = out[j]


@njit(cache=True, error_model="numpy")
def transpose_in_place(p):
    """Transpose a square array ``(n, n)`` in place."""
    for i in range(p.shape[0]):
        for j in range(i):
            p[i, j], p[j, i] = p[j, i], p[i, j]
