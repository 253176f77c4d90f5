"""The compiled states of sigma points against `layout`, which is their readable twin."""

from dataclasses import replace

import numpy as np
import pytest
from compiled_cases import EVERY, FEW, random_state

from edl_filter.navigation.compiled_states import error_between, moved_state, states_of_points
from edl_filter.navigation.compiled_ukf import state_places
from edl_filter.navigation.layout import State, sigma_states


@pytest.mark.parametrize("layout", [EVERY, FEW])
def test_states_and_their_errors_are_those_of_the_reference(layout):
    """With turns of about a radian, and with columns that are filled with the reference."""
    random = np.random.default_rng(5)
    reference, onboard = random_state(random, layout), state_places(layout)[-1]
    points = random.standard_normal((5, layout.size))
    before = replace(reference, nav=reference.nav.copy(), errors=reference.errors.copy())
    for columns in (5, 8):
        states = states_of_points(reference.nav, reference.errors, points, columns, onboard)
        for array, expected in zip(states, sigma_states(reference, points, columns), strict=True):
            np.testing.assert_allclose(array, expected, rtol=1e-14, atol=1e-14)
    moved = State(*moved_state(reference.nav, reference.errors, points[0], onboard))
    expected = reference.plus(points[0])
    np.testing.assert_allclose(moved.nav, expected.nav, rtol=1e-14, atol=1e-14)
    np.testing.assert_allclose(moved.errors, expected.errors, rtol=1e-14, atol=1e-14)
    delta = error_between(expected.nav, expected.errors, reference.nav, reference.errors, onboard)
    np.testing.assert_allclose(delta, expected.minus(reference), rtol=1e-13, atol=1e-13)
    np.testing.assert_array_equal(reference.nav, before.nav)
    np.testing.assert_array_equal(reference.errors, before.errors)
