"""Algebra of small dense matrices in numba, without calls of a library.

A call of LAPACK costs some microseconds, and several threads of it wait for each other; matrices of 9 to 40 rows, the
covariances of a filter's states, are done by then. Cholesky factorisation and substitution as in Golub & Van Loan 2013,
*Matrix Computations*, sections 3.1, 3.4 and 4.2; the loops run along rows, so that they are vectorised.
"""

import numpy as np
from numba import njit

COMPILED = njit(cache=True, error_model="numpy", nogil=True)


@COMPILED
def upper_cholesky(matrix, scale):
    """Upper Cholesky factor U of ``scale * matrix = UᵀU``.

    Each row is reduced by those above it, four at a time, which quarters the loads and stores of the row.

    Parameters
    ----------
    matrix : (n, n) array
        Of which the upper triangle is used.
    scale : float
        Positive.

    Returns
    -------
    factor : (n, n) array
    valid : bool
        False: the matrix is not positive definite, and the factor is meaningless.
    """
    n = len(matrix)
    u, row = np.zeros((n, n)), np.empty(n)
    for k in range(n):
        for j in range(k, n):
            row[j] = scale * matrix[k, j]
        fours = k - k % 4
        for i in range(0, fours, 4):
            a, b, c, d = u[i, k], u[i + 1, k], u[i + 2, k], u[i + 3, k]
            for j in range(k, n):
                row[j] -= a * u[i, j] + b * u[i + 1, j] + c * u[i + 2, j] + d * u[i + 3, j]
        for i in range(fours, k):
            for j in range(k, n):
                row[j] -= u[i, k] * u[i, j]
        if not row[k] > 0.0:
            return u, False
        root = 1.0 / np.sqrt(row[k])
        for j in range(k, n):
            u[k, j] = root * row[j]
    return u, True


@COMPILED
def weighted_product(a, b, first_weight, weight):
    """``aᵀ W b``, with one weight for the first row and another one for the rest.

    Parameters
    ----------
    a, b : (S, n) and (S, m) arrays
        S rows each.
    first_weight, weight : float
        Of the first row, and of each other row.

    Returns
    -------
    (n, m) array
    """
    out = np.zeros((a.shape[1], b.shape[1]))
    for s in range(len(a)):
        row_weight = first_weight if s == 0 else weight
        for i in range(a.shape[1]):
            factor = row_weight * a[s, i]
            for j in range(b.shape[1]):
                out[i, j] += factor * b[s, j]
    return out


@COMPILED
def weighted_square(a, first_weight, weight):
    """``aᵀ W a`` of an odd number of rows, with one weight for the first row and another one for the rest.

    Only the upper triangle is computed, two rows at a time, which halves the loads and stores of the sum.

    Parameters
    ----------
    a : (2 k + 1, n) array
        Rows.
    first_weight, weight : float
        Of the first row, and of each other row.

    Returns
    -------
    (n, n) array
        Symmetric.
    """
    n = a.shape[1]
    out = np.empty((n, n))
    for i in range(n):
        factor = first_weight * a[0, i]
        for j in range(i, n):
            out[i, j] = factor * a[0, j]
    for s in range(1, len(a), 2):
        for i in range(n):
            factor, second = weight * a[s, i], weight * a[s + 1, i]
            for j in range(i, n):
                out[i, j] += factor * a[s, j] + second * a[s + 1, j]
    for i in range(n):
        for j in range(i):
            out[i, j] = out[j, i]
    return out


@COMPILED
def matrix_product(a, b):
    """``a b``, two rows of `b` at a time.

    Parameters
    ----------
    a : (n, k) array
        Left factor.
    b : (k, m) array
        Right factor.

    Returns
    -------
    (n, m) array
    """
    out = np.zeros((len(a), b.shape[1]))
    even = len(b) - len(b) % 2
    for i in range(len(a)):
        for k in range(0, even, 2):
            factor, second = a[i, k], a[i, k + 1]
            for j in range(b.shape[1]):
                out[i, j] += factor * b[k, j] + second * b[k + 1, j]
        for k in range(even, len(b)):
            for j in range(b.shape[1]):
                out[i, j] += a[i, k] * b[k, j]
    return out


@COMPILED
def weighted_mean(rows, first_weight, weight):
    """Weighted sum of rows, with one weight for the first row and another one for the rest.

    Parameters
    ----------
    rows : (S, n) array
        S rows.
    first_weight, weight : float
        Of the first row, and of each other row.

    Returns
    -------
    (n,) array
    """
    out = np.zeros(rows.shape[1])
    for s in range(1, len(rows)):
        for i in range(rows.shape[1]):
            out[i] += rows[s, i]
    for i in range(rows.shape[1]):
        out[i] = first_weight * rows[0, i] + weight * out[i]
    return out


@COMPILED
def solve_few(matrix, right):
    """``matrix⁻¹ right`` by elimination with row pivoting, for matrices of a few rows.

    Parameters
    ----------
    matrix : (m, m) array
        Not singular.
    right : (m, k) array
        One right-hand side per column.

    Returns
    -------
    (m, k) array
    """
    a, x = matrix.copy(), right.copy()
    m = len(a)
    for k in range(m):
        pivot = k
        for i in range(k + 1, m):
            if abs(a[i, k]) > abs(a[pivot, k]):
                pivot = i
        if pivot != k:
            for j in range(m):
                a[k, j], a[pivot, j] = a[pivot, j], a[k, j]
            for j in range(x.shape[1]):
                x[k, j], x[pivot, j] = x[pivot, j], x[k, j]
        for i in range(k + 1, m):
            factor = a[i, k] / a[k, k]
            for j in range(k, m):
                a[i, j] -= factor * a[k, j]
            for j in range(x.shape[1]):
                x[i, j] -= factor * x[k, j]
    for k in range(m - 1, -1, -1):
        for j in range(x.shape[1]):
            value = x[k, j]
            for i in range(k + 1, m):
                value -= a[k, i] * x[i, j]
            x[k, j] = value / a[k, k]
    return x


@COMPILED
def back_substitution(factor, right):
    """``U⁻¹ right`` with an upper triangular matrix.

    Parameters
    ----------
    factor : (n, n) array
        U, of which the upper triangle is used.
    right : (n, k) array
        One right-hand side per column.

    Returns
    -------
    (n, k) array
    """
    x = right.copy()
    for i in range(len(factor) - 1, -1, -1):
        for j in range(i + 1, len(factor)):
            for c in range(x.shape[1]):
                x[i, c] -= factor[i, j] * x[j, c]
        for c in range(x.shape[1]):
            x[i, c] /= factor[i, i]
    return x


@COMPILED
def symmetric_part(matrix):
    """Symmetric part of a matrix ``(n, n)``."""
    out = np.empty_like(matrix)
    for i in range(len(matrix)):
        for j in range(len(matrix)):
            out[i, j] = 0.5 * (matrix[i, j] + matrix[j, i])
    return out


@COMPILED
def solve_from_right(cross, factor):
    """``cross (UᵀU)⁻¹``, all rows at once.

    Parameters
    ----------
    cross : (m, n) array
        m rows to be divided by the matrix.
    factor : (n, n) array
        Upper Cholesky factor U.

    Returns
    -------
    (m, n) array
    """
    n, m = len(factor), len(cross)
    x = cross.T.copy()  # a right-hand side per column, so that the inner loops are long and independent
    for k in range(n):
        inverse = 1.0 / factor[k, k]
        for r in range(m):
            x[k, r] *= inverse
        for j in range(k + 1, n):
            entry = factor[k, j]
            for r in range(m):
                x[j, r] -= entry * x[k, r]
    for k in range(n - 1, -1, -1):
        inverse = 1.0 / factor[k, k]
        for r in range(m):
            x[k, r] *= inverse
        for j in range(k):
            entry = factor[j, k]
            for r in range(m):
                x[j, r] -= entry * x[k, r]
    return x.T.copy()


@COMPILED
def regression_rows(cross, covariance):
    """Rows of ``cross covariance⁻¹`` that are not those of the unit matrix.

    The regression of n variables on n others, some of which are the same: their rows of both arguments are equal.

    Parameters
    ----------
    cross : (n, n) array
        Covariance of the variables with the others.
    covariance : (n, n) array
        Of the others.

    Returns
    -------
    rows : (k, n) array
        Of the variables that differ from the others.
    index : (k,) array of int
        Indices of these variables.
    valid : bool
        False: the covariance is not positive definite, and the rows are meaningless.
    """
    n, count = len(cross), 0
    index = np.empty(n, np.int64)
    for i in range(n):
        if np.any(cross[i] != covariance[i]):
            index[count] = i
            count += 1
    index = index[:count]
    factor, valid = upper_cholesky(covariance, 1.0)
    if not valid:
        return np.zeros((count, n)), index, False
    return solve_from_right(cross[index], factor), index, True
