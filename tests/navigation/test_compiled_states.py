"""The compiled states of sigma points against `layout`, which is their readable twin."""

from dataclasses import replace

import numpy as np
import pytest
from compiled_cases import EVERY, FEW, random_state

from edl_filter.navigation.compiled_states import (
    error_between,
    moved_state,
    moving_errors,
    states_of_points,
    turns_between,
)
from edl_filter.navigation.compiled_ukf import state_places
from edl_filter.navigation.layout import State, attitude_errors, sigma_states


@pytest.mark.parametrize("layout", [EVERY, FEW])
def test_states_and_their_errors_are_those_of_the_reference(layout):
    """With turns of about a radian, and with columns that are filled with the reference."""
    random = np.random.default_rng(5)
    reference, onboard = random_state(random, layout), state_places(layout)[-1]
    points = random.standard_normal((8, layout.size))
    points[1, 6:9] = 0.0
    for k in range(3):  # turned about one axis, by less than one radian
        points[3 + k, 6:9] = 0.3 * np.eye(3)[k]
    before = replace(reference, nav=reference.nav.copy(), errors=reference.errors.copy())
    for columns in (8, 12):
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


@pytest.mark.parametrize("layout", [EVERY, FEW])
def test_errors_that_move_are_those_of_the_reference(layout):
    """Of columns about the first one; those after the count are not used."""
    random = np.random.default_rng(6)
    reference = random_state(random, layout).plus(np.zeros(layout.size))  # attitudes of unit length
    points = np.vstack((np.zeros(layout.size), random.standard_normal((4, layout.size))))
    nav, _ = sigma_states(reference, points, 8)
    nav[:, 5:] = np.nan
    moving = np.r_[:9, layout.size - 3 : layout.size] if "onboard_attitude" in layout else np.arange(9)
    np.testing.assert_allclose(moving_errors(nav, 5), points[:, moving], atol=2e-9)  # of 3.4e6 m


def test_turns_between_attitudes_are_those_of_the_reference():
    """Between equal attitudes there is none."""
    random = np.random.default_rng(7)
    attitudes = random.standard_normal((4, 6))
    attitudes /= np.linalg.norm(attitudes, axis=0)
    turns = turns_between(attitudes[:, 2].copy(), attitudes)
    np.testing.assert_allclose(turns, attitude_errors(attitudes[:, 2], attitudes), atol=1e-14)
    np.testing.assert_allclose(turns[2], 0.0, atol=1e-16)
