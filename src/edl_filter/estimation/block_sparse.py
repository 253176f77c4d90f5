"""Sequences of square matrices that share one pattern of non-zero elements.

The transition matrices and process-noise matrices of a linear state-space model with many constant states are mostly
zero, at the same places in every step. Storing the non-zero elements only reduces a product with an ``(n, n)`` matrix
from n² to a few times n elements per column (coordinate format: Golub and Van Loan, Matrix Computations, 2013, ch. 11).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit

from edl_filter.types import Array, IntArray

#: Lets a compiled loop contract a product and a sum into one rounding. A function with it is put in line into its
#: callers: as a function of its own it would be compiled twice, once by itself and once within its caller, with
#: different roundings, and which of the two runs depends on whether the process compiled it or read it from the cache.
FUSED = {"contract"}

#: Number of columns below which an array is transformed column by column.
FEW_COLUMNS = 5


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
        Rows and columns of a block, and its values in each of the K matrices. Of an iterator that computes the values,
        only one block is kept.
    """
    elements: dict[tuple[int, int], Array] = {}
    count = 0
    for rows, columns, values in blocks:
        count = len(values)
        for i, j in np.argwhere(np.any(values != 0.0, axis=0)):
            place = (rows.start + int(i), columns.start + int(j))
            # a copy: a view would keep the whole block
            elements[place] = elements[place] + values[:, i, j] if place in elements else values[:, i, j].copy()
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


class RowPattern(NamedTuple):
    """Places of the elements of increments ``D_k``, by row, as `transform_rows` needs them.

    Two rows are a pair if both have elements in the columns of these two rows and in no other column, as the value and
    the derivative of a process of second order. A row decays if its only element is on the diagonal. Pairs and decays
    are transformed in one pass and without a copy.

    Attributes
    ----------
    rows : (m,) array of int
        Rows that are not zero, belong to no pair and do not decay.
    elements : (m, 2) array of int
        Index of the first element of each of these rows, and of the one after its last.
    column : (z,) array of int
        Of every element.
    pairs : (q, 2) array of int
        Rows of each pair, the lower one first.
    pair_elements : (q, 2) array of int
        Index of the first of the two elements of each of these rows.
    decays : (s,) array of int
        Rows that decay.
    decay_elements : (s,) array of int
        Index of the element of each of these rows.
    """

    rows: IntArray
    elements: IntArray
    column: IntArray
    pairs: IntArray
    pair_elements: IntArray
    decays: IntArray
    decay_elements: IntArray


def row_pattern(increment: BlockSparse) -> RowPattern:
    """The pattern of the rows of increments ``D_k``."""
    rows, first, count = np.unique(increment.row, return_index=True, return_counts=True)
    elements = np.stack((first, first + count), axis=1)
    columns = increment.column.tolist()
    columns_of = {row: columns[a:b] for row, (a, b) in zip(rows.tolist(), elements.tolist(), strict=True)}
    pairs = [
        own for row, own in columns_of.items() if len(own) == 2 and own[0] == row and columns_of.get(own[1]) == own
    ]
    paired = np.array(pairs, np.int64).reshape(-1, 2)
    decays = (count == 1) & (increment.column[first] == rows)
    others = ~(np.isin(rows, paired) | decays)
    return RowPattern(
        rows=rows[others],
        elements=elements[others],
        column=increment.column,
        pairs=paired,
        pair_elements=first[np.searchsorted(rows, paired)],
        decays=rows[decays],
        decay_elements=first[decays],
    )


@njit(cache=True, error_model="numpy", fastmath=FUSED, inline="always")
def transform_rows(p, pattern, values, work):
    """``(I + D) p``, in place.

    Parameters
    ----------
    p : (n, c) array
        Changed in place.
    pattern : RowPattern
        Places of the elements of D.
    values : (z,) array
        Elements of D.
    work : (m, c) array
        Working space, as many rows as `pattern.rows`.
    """
    if p.shape[1] < FEW_COLUMNS:
        transform_columns(p, pattern, values, work)
    else:
        transform_wide_rows(p, pattern, values, work)


@njit(cache=True, error_model="numpy", fastmath=FUSED, inline="always")
def transform_columns(p, pattern, values, work):
    """`transform_rows` of ``(n, c)``, element by element of each column: faster for few columns than along the rows."""
    rows, elements, column = pattern.rows, pattern.elements, pattern.column
    pairs, pair_elements = pattern.pairs, pattern.pair_elements
    decays, decay_elements = pattern.decays, pattern.decay_elements
    for j in range(p.shape[1]):
        for i in range(rows.size):
            total = p[rows[i], j]
            for z in range(elements[i, 0], elements[i, 1]):
                total += values[z] * p[column[z], j]
            work[i, j] = total
        for i in range(rows.size):
            p[rows[i], j] = work[i, j]
        for i in range(len(pairs)):
            lower, upper = pairs[i, 0], pairs[i, 1]
            a, b, x, y = pair_elements[i, 0], pair_elements[i, 1], p[lower, j], p[upper, j]
            p[lower, j] = x + values[a] * x + values[a + 1] * y
            p[upper, j] = y + values[b] * x + values[b + 1] * y
        for i in range(decays.size):
            p[decays[i], j] += values[decay_elements[i]] * p[decays[i], j]


@njit(cache=True, error_model="numpy", fastmath=FUSED, inline="always")
def transform_wide_rows(p, pattern, values, work):
    """`transform_rows` of ``(n, c)``, by operations on entire rows.

    The rows of `RowPattern.rows` are first, since pairs and decays may be their sources. Those whose elements are all
    zero in this step are left out.
    """
    rows, elements, column = pattern.rows, pattern.elements, pattern.column
    pairs, pair_elements = pattern.pairs, pattern.pair_elements
    decays, decay_elements = pattern.decays, pattern.decay_elements
    width = p.shape[1]
    for i in range(rows.size):
        if any_nonzero(values, elements[i, 0], elements[i, 1]):
            row, out = p[rows[i]], work[i]
            for j in range(width):
                out[j] = row[j]
            add_rows(out, p, column, values, elements[i, 0], elements[i, 1])
    for i in range(rows.size):
        if any_nonzero(values, elements[i, 0], elements[i, 1]):
            row, out = p[rows[i]], work[i]
            for j in range(width):
                row[j] = out[j]
    for i in range(len(pairs)):
        lower, upper, a, b = p[pairs[i, 0]], p[pairs[i, 1]], pair_elements[i, 0], pair_elements[i, 1]
        v1, v2, v3, v4 = values[a], values[a + 1], values[b], values[b + 1]
        for j in range(width):
            x, y = lower[j], upper[j]
            lower[j] = x + v1 * x + v2 * y
            upper[j] = y + v3 * x + v4 * y
    for i in range(decays.size):
        row, v = p[decays[i]], values[decay_elements[i]]
        for j in range(width):
            row[j] += v * row[j]


@njit(cache=True, error_model="numpy", fastmath=FUSED, inline="always")
def add_rows(out, p, column, values, begin, end):
    """Add ``values[z] p[column[z]]`` to `out` ``(c,)`` for z from `begin` to `end`, four rows in one pass.

    Most of the time of a pass is the access to memory: four rows in one pass read and write `out` once.
    """
    width = out.size
    remaining = begin + (end - begin) % 4
    for z in range(begin, remaining):
        v, row = values[z], p[column[z]]
        for j in range(width):
            out[j] += v * row[j]
    for z in range(remaining, end, 4):
        v1, v2, v3, v4 = values[z], values[z + 1], values[z + 2], values[z + 3]
        row1, row2, row3, row4 = p[column[z]], p[column[z + 1]], p[column[z + 2]], p[column[z + 3]]
        for j in range(width):
            out[j] = out[j] + v1 * row1[j] + v2 * row2[j] + v3 * row3[j] + v4 * row4[j]


@njit(cache=True)
def any_nonzero(values, begin, end):
    """Whether any of the values ``(z,)`` from `begin` to `end` is not zero."""
    nonzero = False
    for z in range(begin, end):
        nonzero |= values[z] != 0.0
    return nonzero


@njit(cache=True, error_model="numpy", fastmath=FUSED, inline="always")
def transform_both_sides(p, out, pattern, values, work):
    """``(I + D) p (I + D)ᵀ`` of a symmetric array.

    Parameters
    ----------
    p : (n, n) array
        Symmetric; overwritten.
    out : (n, n) array
        The product.
    pattern : RowPattern
        Places of the elements of D.
    values : (z,) array
        Elements of D.
    work : (m, n) array
        Working space, as many rows as `pattern.rows`.
    """
    for side in range(2):  # not two calls in succession, each of which would be compiled in line
        transform_wide_rows(p, pattern, values, work)
        if side == 0:
            for i in range(p.shape[0]):
                row = out[i]
                for j in range(p.shape[0]):
                    row[j] = p[j, i]
            p = out
