"""The smoothed missing force and moment: against the joint Gaussian, and found again where one was drawn."""

import numpy as np
from linear_problems import problem

from edl_filter.diagnosis.latent import smoothed
from edl_filter.diagnosis.whitening import whitener


def test_it_is_the_joint_gaussians_answer():
    s = problem(seed=4, steps=30, n=5, moving=5)
    n, steps = len(s.start), len(s.change)
    y, start = np.random.default_rng(5).normal(size=s.rows[-1]), np.array([0.3, -0.2, 0.1])
    whiten = whitener(s)
    mean, covariance = smoothed(whiten, whiten(y[:, None], start[:, None])[:, 0], start, 2)
    # all states as one vector: how each source of randomness gets everywhere
    size = n * (steps + 1)
    roots = [np.linalg.cholesky(s.start), *(np.linalg.cholesky(s.noise[k]) for k in range(steps))]
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
