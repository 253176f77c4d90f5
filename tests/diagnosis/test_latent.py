"""The smoothed missing force and moment: against the joint Gaussian, and found again where one was drawn."""

import numpy as np

from edl_filter.diagnosis.latent import smoothed
from edl_filter.diagnosis.sparse import dense
from edl_filter.diagnosis.whitening import Steps, whitener


def problem(seed=4, steps=30, n=5):
    rng = np.random.default_rng(seed)
    change, noise = 0.2 * rng.normal(size=(steps, n, n)), np.zeros((steps, n, n))
    for k in range(steps):
        root = 0.3 * rng.normal(size=(n, n))
        noise[k] = root @ root.T
    counts = rng.integers(0, 3, steps)
    rows = np.concatenate(([0], np.cumsum(counts)))
    design = rng.normal(size=(rows[-1], n))
    row_noise = np.zeros((rows[-1], 2))
    for k in range(steps):
        root = rng.normal(size=(counts[k], counts[k]))
        row_noise[rows[k] : rows[k + 1], : counts[k]] = root @ root.T + 0.5 * np.eye(counts[k])
    return Steps(dense(change - 0.3 * np.eye(n)), dense(noise), rows, design, row_noise, np.eye(n))


def test_it_is_the_joint_gaussians_answer():
    s = problem()
    n, steps = len(s.start), len(s.change)
    y, start = np.random.default_rng(5).normal(size=s.rows[-1]), np.array([0.3, -0.2, 0.1])
    whiten = whitener(s)
    mean, covariance = smoothed(whiten, whiten(y[:, None], start[:, None])[:, 0], start, 2)
    # all states as one vector: how each source of randomness gets everywhere
    size = n * (steps + 1)
    roots = [np.eye(n), *(np.linalg.cholesky(s.noise[k]) for k in range(steps))]
    carry = np.zeros((n * steps, size))
    begin, expected = np.concatenate((start, np.zeros(n - 3))), []
    for k in range(steps):
        move = np.eye(n) + s.change[k]
        before = carry[n * (k - 1) : n * k] if k else np.hstack((roots[0], np.zeros((n, size - n))))
        here = move @ before
        here[:, n * (k + 1) : n * (k + 2)] += roots[k + 1]
        carry[n * k : n * (k + 1)] = here
        begin = move @ begin
        expected.append(begin)
    joint = carry @ carry.T
    h = np.zeros((s.rows[-1], n * steps))
    total = np.zeros((s.rows[-1], s.rows[-1]))
    for k in range(steps):
        a, b = s.rows[k], s.rows[k + 1]
        h[a:b, n * k : n * (k + 1)] = s.design[a:b]
        total[a:b, a:b] = s.row_noise[a:b, : b - a]
    gain = joint @ h.T @ np.linalg.inv(h @ joint @ h.T + total)
    prior = np.concatenate(expected)
    best = (prior + gain @ (y - h @ prior)).reshape(steps, n)
    left = joint - gain @ h @ joint
    np.testing.assert_allclose(mean, best[:, -2:], atol=1e-9)
    for k in range(steps):
        at = slice(n * k + n - 2, n * (k + 1))
        np.testing.assert_allclose(covariance[k], left[at, at], atol=1e-9)
