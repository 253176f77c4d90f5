"""Numbers that stay: bit-identical results of a process that compiles and one that reads the cache; covariances that
stay positive definite through a million epochs."""

import os
import subprocess
import sys

import equal_results
import numpy as np
import pytest
import scipy.linalg

from edl_filter.estimation.block_sparse import BlockSparse, row_pattern
from edl_filter.estimation.kalman import _filter

KERNELS = """
import hashlib
import numpy as np
from edl_filter.estimation.block_sparse import BlockSparse
from edl_filter.estimation.kalman import LinearStateSpace, whitening_filter
from edl_filter.navigation import strapdown

rng = np.random.default_rng(1)
digest = hashlib.sha256()
for _ in range(20):
    state = np.concatenate((rng.normal(0, 3e6, (3, 64)), rng.normal(0, 3e3, (3, 64)), rng.normal(0, 1, (4, 64))))
    state[6:] /= np.linalg.norm(state[6:], axis=0)
    force = np.tile(np.concatenate((np.eye(3).ravel(), np.zeros(3)))[:, None], (1, 64)) + rng.normal(0, 1e-3, (12, 64))
    rate = np.tile([1.0, 1, 1, 0, 0, 0], (64, 1)).T + rng.normal(0, 1e-3, (6, 64))
    samples = np.full(80, 0.125), rng.normal(0, 30, (80, 3)), rng.normal(0, 0.3, (80, 3))
    strapdown.propagate(state, force, rate, *samples, 4.28e13, 1.96e-3, 3.396e6)
    digest.update(state.tobytes())
K, n = 400, 12
rows, columns = np.divmod(np.arange(n * n), n)
model = LinearStateSpace(
    BlockSparse(n, rows, columns, 0.05 * rng.normal(size=(K, n * n)) - 0.1 * (rows == columns)),
    BlockSparse(n, np.arange(n), np.arange(n), rng.uniform(0.1, 1, (K, n))),
    np.arange(K + 1) * 3, rng.normal(size=(3 * K, n)), np.tile(np.eye(3), (K, 1)), np.eye(n),
)
white = whitening_filter(model)(rng.normal(size=(3 * K, 5)), np.zeros((n, 5)))
digest.update(white.tobytes())
print(digest.hexdigest())
"""


@pytest.mark.slow
def test_the_first_run_which_compiles_has_the_same_bits_as_the_next_ones(tmp_path):
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "cache"), "OPENBLAS_NUM_THREADS": "1"}
    digests = [
        subprocess.run(
            [sys.executable, "-c", KERNELS], env=environment, capture_output=True, text=True, check=True
        ).stdout
        for _ in range(3)
    ]
    assert len(digests[0]) == 65
    assert digests[0] == digests[1] == digests[2]


@pytest.mark.slow
def test_a_run_of_spirit_which_compiles_has_the_same_bits_as_the_next_one(tmp_path):
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "cache"), "OPENBLAS_NUM_THREADS": "1"}
    folders = tmp_path / "first", tmp_path / "second"
    for folder in folders:
        command = [sys.executable, "-m", "edl_filter", "run", "builtin:mer_a", "--no-figures", "-o", str(folder)]
        subprocess.run(command, env=environment, check=True, stdout=subprocess.DEVNULL)
    differences = equal_results.compare(*folders)
    assert len(differences["result.nc"]) > 500
    assert {name: value for values in differences.values() for name, value in values.items() if value > 0.0} == {}


@pytest.mark.parametrize("available", ["all", "with gaps and rejections"])
def test_a_covariance_stays_positive_definite_through_a_million_epochs(available):
    steps, n, dt = 1_000_000, 6, 0.1
    measured = np.ones(steps, bool)
    if available != "all":
        measured = np.random.default_rng(1).uniform(size=steps) > 0.3  # rejected
        for start in range(0, steps - 2000, 50_000):
            measured[start : start + 2000] = False  # 200 s without a measurement
        measured[-2000:] = True
    row_start = np.concatenate(([0], np.cumsum(measured)))
    increment = BlockSparse(n, np.arange(3), np.arange(3, 6), np.full((steps, 3), dt))
    noise = np.tile([1e-12, 1e-12, 1e-12, 1e-6, 1e-10, 1e-14], (steps, 1))
    design = np.tile([1.0, 1e-3, -1e-3, 0.0, 0.0, 0.0], (int(measured.sum()), 1))
    design[1::3], design[2::3] = np.roll(design[0], 1), np.roll(design[0], 2)
    design[1::3, 3:] = design[2::3, 3:] = 0.0
    p = np.diag([1e12, 1e6, 1.0, 1e6, 1.0, 1e-6])
    gains, factor, nothing = np.empty_like(design), np.empty((len(design), 1)), np.empty((0, 1))
    log_determinant, _, p = _filter(
        row_pattern(increment), increment.values, np.arange(n), np.arange(n), noise, row_start, design,
        np.full((len(design), 1), 1e-4), p, gains, factor, nothing, nothing,
    )  # fmt: skip
    assert np.isfinite(log_determinant) and np.all(factor[:, 0] > 0.0) and np.isfinite(gains).all()
    scale = np.sqrt(np.diag(p))
    assert np.all(np.isfinite(scale)) and np.all(scale > 0.0)
    assert np.max(np.abs(p - p.T) / np.outer(scale, scale)) < 1e-9
    assert np.linalg.eigvalsh(0.5 * (p + p.T) / np.outer(scale, scale))[0] > 0.0


def test_the_recursion_ends_at_the_solution_of_riccatis_equation():
    steps, dt = 200_000, 0.1
    f, q, h, r = np.array([[1.0, dt], [0.0, 1.0]]), np.diag([1e-8, 1e-6]), np.array([[1.0, 0.0]]), np.array([[1e-2]])
    p = np.diag([1e8, 1e4])
    increment = BlockSparse(2, np.array([0]), np.array([1]), np.full((steps, 1), dt))
    nothing = np.empty((0, 1))
    *_, p = _filter(
        row_pattern(increment), increment.values, np.arange(2), np.arange(2), np.tile(np.diag(q), (steps, 1)),
        np.arange(steps + 1), np.tile(h, (steps, 1)), np.full((steps, 1), r[0, 0]), p, np.empty((0, 2)), nothing,
        nothing, nothing,
    )  # fmt: skip
    predicted = scipy.linalg.solve_discrete_are(f.T, h.T, q, r)
    expected = predicted - predicted @ h.T @ np.linalg.solve(h @ predicted @ h.T + r, h @ predicted)
    np.testing.assert_allclose(p, expected, rtol=1e-8)
