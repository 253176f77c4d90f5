"""Weights of a robust update."""

import numpy as np
import pytest

from edl_filter.navigation.estimator import Innovation
from edl_filter.navigation.robust import HUBER, STUDENT_DOF, measurement_weight, weighted


def innovation(residual, spread=4.0, noise=1.0):
    residual = np.atleast_1d(np.asarray(residual, float))
    eye = np.eye(len(residual))
    return Innovation.of(residual, spread * eye, noise * eye, np.zeros(0))


@pytest.mark.parametrize("robust", ["none", "huber", "student_t"])
def test_a_reading_as_predicted_keeps_its_noise(robust):
    assert measurement_weight(innovation(0.0), robust) == 1.0
    unchanged = innovation(0.3)
    assert weighted(unchanged, 1.0) is unchanged


def test_huber_minimises_hubers_function():
    r, spread, noise = 30.0, 4.0, 1.0
    weight = measurement_weight(innovation(r, spread, noise), "huber")
    x = np.linspace(0.0, r, 300_001)  # the state's change, by brute force
    e = np.abs(r - x) / np.sqrt(noise)
    cost = 0.5 * x**2 / spread + np.where(e <= HUBER, 0.5 * e**2, HUBER * e - 0.5 * HUBER**2)
    assert spread / (spread + noise / weight) * r == pytest.approx(x[np.argmin(cost)], abs=2e-4)


def test_students_weight_is_the_fixed_point_of_its_expectation():
    r, spread, noise = np.array([20.0, -3.0]), 4.0, 1.0
    weight = measurement_weight(innovation(r, spread, noise), "student_t")
    gain = spread / (spread + noise / weight)
    expected = ((1.0 - gain) ** 2 * (r @ r) + 2.0 * (1.0 - gain) * spread) / noise
    assert weight == pytest.approx((STUDENT_DOF + 2.0) / (STUDENT_DOF + expected), rel=1e-4)
    assert 0.0 < weight < 0.2


@pytest.mark.parametrize("robust", ["huber", "student_t"])
def test_weights_fall_with_the_innovation(robust):
    weights = [measurement_weight(innovation(r), robust) for r in (1.0, 5.0, 20.0, 100.0)]
    assert weights == sorted(weights, reverse=True)
    assert weights[-1] < 0.03
