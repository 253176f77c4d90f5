"""The whitener against a plain Kalman filter, against the full Gaussian, and against sampled errors."""

import numpy as np
import pytest
from linear_problems import joint_covariance, moved, problem

from edl_filter.diagnosis.whitening import whitener


def test_it_is_the_kalman_filter():
    s = problem()
    rng = np.random.default_rng(1)
    columns, start = rng.normal(size=(s.rows[-1], 3)), rng.normal(size=(7, 3))
    w = whitener(s)
    p, x, out, log_det = s.start.copy(), start.copy(), np.zeros_like(columns), 0.0
    for k in range(len(s.change)):
        p, x = moved(s, k) @ p @ moved(s, k).T + s.noise[k], moved(s, k) @ x
        a, b = s.rows[k], s.rows[k + 1]
        if a == b:
            continue
        h = s.design[a:b]
        low = np.linalg.cholesky(h @ p @ h.T + s.row_noise[a:b, : b - a])
        left = columns[a:b] - h @ x
        out[a:b] = np.linalg.solve(low, left)
        gain = p @ h.T @ np.linalg.inv(low @ low.T)
        x, p = x + gain @ left, p - gain @ h @ p
        log_det += 2.0 * np.log(np.diag(low)).sum()
    np.testing.assert_allclose(w(columns, start), out, atol=1e-9)
    assert w.log_determinant == pytest.approx(log_det, abs=1e-9)


def test_white_rows_are_the_whole_gaussian():
    s = problem()
    y = np.random.default_rng(2).normal(size=s.rows[-1])
    w = whitener(s)
    white = w(y[:, None], np.zeros((7, 1)))[:, 0]
    covariance = joint_covariance(s)
    expected = -0.5 * y @ np.linalg.solve(covariance, y) - 0.5 * np.linalg.slogdet(covariance)[1]
    assert w.log_likelihood(white) == pytest.approx(expected, rel=1e-9)


def test_innovations_go_back_and_forth():
    s = problem()
    y = np.random.default_rng(2).normal(size=(s.rows[-1], 1))
    w = whitener(s)
    white = w(y, np.zeros((7, 1)))[:, 0]
    back = w.innovations(white)
    assert np.std(back / w.innovation_sigma) == pytest.approx(np.std(white), rel=0.5)
    first = slice(s.rows[0], s.rows[1]) if s.rows[1] else slice(s.rows[1], s.rows[2])
    np.testing.assert_allclose(back[first], y[first, 0], atol=1e-12)  # nothing was known before


def test_the_smoother_is_the_joint_gaussian():
    """At the beginning and at every step, against the covariance of every unknown with all rows."""
    s = problem()
    rng = np.random.default_rng(5)
    y, stated = rng.normal(size=s.rows[-1]), rng.normal(size=7)
    w = whitener(s)
    first, every = w.smoothed(w(y[:, None], stated[:, None])[:, 0], stated)
    expected = np.zeros(s.rows[-1])  # of the rows, from what is stated
    cross = [np.zeros((7, s.rows[-1])) for _ in range(41)]
    at, means = [stated], stated
    for k in range(len(s.change)):
        means = moved(s, k) @ means
        at.append(means)
        expected[s.rows[k] : s.rows[k + 1]] = s.design[s.rows[k] : s.rows[k + 1]] @ means
    for i in range(41):  # covariance of the unknowns after i moves with every row
        for k in range(len(s.change)):
            row = slice(s.rows[k], s.rows[k + 1])
            cross[i][:, row] = between(s, i, k + 1) @ s.design[row].T
    total = joint_covariance(s)
    left = np.linalg.solve(total, y - expected)
    np.testing.assert_allclose(first, at[0] + cross[0] @ left, atol=1e-8)
    for i in range(40):
        np.testing.assert_allclose(every[i], at[i + 1] + cross[i + 1] @ left, atol=1e-8)
    np.testing.assert_allclose(
        w.start_covariance(7), s.start - cross[0] @ np.linalg.solve(total, cross[0].T), atol=1e-8
    )


def between(s, one, other):
    """Covariance of the unknowns after `one` and after `other` moves."""
    low, high = min(one, other), max(one, other)
    p = s.start
    for k in range(low):
        p = moved(s, k) @ p @ moved(s, k).T + s.noise[k]
    carried = np.eye(len(p))
    for k in range(low, high):
        carried = moved(s, k) @ carried
    return p @ carried.T if one == low else carried @ p
