"""What the whole flight says of each row, against the inverse of the rows' joint covariance."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from linear_problems import joint_covariance, problem

from edl_filter.diagnosis.hindsight import in_hindsight
from edl_filter.diagnosis.whitening import whitener


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 1000))
def test_it_is_the_inverse_of_the_joint_covariance(seed):
    s = problem(seed)
    y = np.random.default_rng(seed).normal(size=s.rows[-1])
    w = whitener(s)
    weighed, diagonal = in_hindsight(w, w(y[:, None], np.zeros((len(s.start), 1)))[:, 0])
    inverse = np.linalg.inv(joint_covariance(s))
    np.testing.assert_allclose(weighed, inverse @ y, rtol=1e-6, atol=1e-8)
    np.testing.assert_allclose(diagonal, np.diag(inverse), rtol=1e-6)


def test_it_is_the_slope_of_the_likelihood_in_a_rows_own_noise():
    s = problem()
    y = np.random.default_rng(3).normal(size=s.rows[-1])
    w = whitener(s)
    weighed, diagonal = in_hindsight(w, w(y[:, None], np.zeros((len(s.start), 1)))[:, 0])
    c, step = joint_covariance(s), 1e-5

    def likelihood(covariance):
        return -0.5 * y @ np.linalg.solve(covariance, y) - 0.5 * np.linalg.slogdet(covariance)[1]

    for i in range(len(y)):
        more = step * np.outer(np.eye(len(y))[i], np.eye(len(y))[i])
        slope = (likelihood(c + more) - likelihood(c - more)) / (2.0 * step)
        np.testing.assert_allclose(0.5 * (weighed[i] ** 2 - diagonal[i]), slope, rtol=1e-4, atol=1e-6)
