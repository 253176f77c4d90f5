"""Small linear problems with everything in them, and the joint covariance of their rows by the slow way."""

import numpy as np

from edl_filter.diagnosis.sparse import dense
from edl_filter.diagnosis.whitening import Steps


def problem(seed=3, steps=40, n=7, moving=3):
    """A linear problem whose first unknowns move while the others keep still, and steps without rows."""
    rng = np.random.default_rng(seed)
    move = np.tile(np.eye(n), (steps, 1, 1))
    move[:, :moving, :moving] += 0.1 * rng.normal(size=(steps, moving, moving))
    noise = np.zeros((steps, n, n))
    for k in range(steps):
        root = 0.1 * rng.normal(size=(moving, moving))
        noise[k, :moving, :moving] = root @ root.T
    counts = rng.integers(0, 4, steps)
    rows = np.concatenate(([0], np.cumsum(counts)))
    design = rng.normal(size=(rows[-1], n))
    row_noise = np.zeros((rows[-1], 3))
    for k in range(steps):
        root = rng.normal(size=(counts[k], counts[k]))
        row_noise[rows[k] : rows[k + 1], : counts[k]] = root @ root.T + 0.5 * np.eye(counts[k])
    root = rng.normal(size=(n, n))
    return Steps(dense(move - np.eye(n)), dense(noise), rows, design, row_noise, root @ root.T)


def moved(s, k):
    """The whole transition."""
    return np.eye(len(s.start)) + s.change[k]


def joint_covariance(s):
    """Covariance of all rows, by carrying every source of error to every row."""
    n, count = len(s.start), s.rows[-1]
    sources, at = [], [(np.linalg.cholesky(s.start + 1e-14 * np.eye(n)), 0)]
    for k in range(len(s.change)):
        w, v = np.linalg.eigh(s.noise[k])
        at.append((v * np.sqrt(np.maximum(w, 0.0)), k + 1))
    for root, begin in at:
        column, carried = np.zeros((count, n)), root
        for k in range(max(begin - 1, 0), len(s.change)):
            if k >= begin:
                carried = moved(s, k) @ carried
            a, b = s.rows[k], s.rows[k + 1]
            if begin <= k + 1:
                column[a:b] = s.design[a:b] @ carried
        sources.append(column)
    total = sum(c @ c.T for c in sources)
    for a, b in zip(s.rows, s.rows[1:], strict=False):
        total[a:b, a:b] += s.row_noise[a:b, : b - a]
    return total
