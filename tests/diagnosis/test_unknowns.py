"""The Matérn process of density, wind and coefficients."""

import numpy as np
import pytest

from edl_filter.diagnosis.unknowns import smooth_step


@pytest.mark.parametrize("passed", [0.0, 0.03, 0.5, 4.0])
def test_stationary_with_the_stated_correlation(passed):
    move, noise = smooth_step(np.array(passed))
    rest = np.diag([1.0, 3.0])
    np.testing.assert_allclose(move @ rest @ move.T + noise, rest, atol=1e-12)
    d = np.sqrt(3.0) * passed
    assert (move @ rest)[0, 0] == pytest.approx((1.0 + d) * np.exp(-d))
    assert np.linalg.eigvalsh(noise).min() > -1e-12


def test_two_steps_are_one():
    (a, p), (b, q) = smooth_step(np.array(0.2)), smooth_step(np.array(0.5))
    whole, noise = smooth_step(np.array(0.7))
    np.testing.assert_allclose(b @ a, whole, atol=1e-12)
    np.testing.assert_allclose(b @ p @ b.T + q, noise, atol=1e-12)
