"""Inverse look-up against the look-up, with several solutions, none, and solutions between grid points."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from edl_filter.aero.database import Database, load_database
from edl_filter.aero.grid import GridTable
from edl_filter.aero.inverse import Solutions, angle_from_cm, angle_from_cn

X = 0.253
SMOOTH = load_database()
LINEAR = load_database("builtin:continuum_grid", "builtin:rarefied_grid")
CUBIC = load_database("builtin:continuum_grid", "builtin:rarefied_grid", join="continuous", interpolation="pchip")

flights = {
    "database": st.sampled_from([SMOOTH, LINEAR, CUBIC]),
    "mach": st.floats(0.4, 30.0),
    "knudsen": st.floats(-7.0, 2.0).map(lambda e: 10.0**e),
    "alpha": st.floats(0.0, np.radians(25.0)),
    "sign": st.sampled_from([-1.0, 1.0]),
}


@given(**flights)
def test_inverse_of_a_look_up_gives_the_angle(database, mach, knudsen, alpha, sign):
    c = database.lookup(mach, knudsen, alpha)
    for solve, target, options in ((angle_from_cn, c.cn, {}), (angle_from_cm, c.cm_at(X), {"x_over_d": X})):
        solution = solve(database, sign * target, mach, knudsen, hint=sign * alpha, **options)
        assert solution.status[0] != Solutions.NONE
        at_solution = database.lookup(mach, knudsen, abs(solution.alpha[0]))
        value = at_solution.cn if solve is angle_from_cn else at_solution.cm_at(X)
        assert np.sign(solution.alpha[0]) * value == pytest.approx(sign * target, abs=1e-10)
        # Where the curve is flat the angle depends on the rounding of the sum
        near = database.lookup(mach, knudsen, np.clip([alpha - 1e-6, alpha + 1e-6], 0.0, np.radians(25.0)))
        change = np.ptp(near.cn if solve is angle_from_cn else near.cm_at(X))
        assume(change > 1e-12)
        if solution.status[0] == Solutions.UNIQUE:
            assert solution.alpha[0] == pytest.approx(sign * alpha, abs=1e-6)


def test_bounded_instability_has_several_angles():
    """At Mach 18 the moment is nose-up at small angles: it vanishes at zero and at both trim angles."""
    zero = angle_from_cm(SMOOTH, 0.0, 18.0, 1e-5, x_over_d=X)
    assert zero.status[0] == Solutions.SEVERAL and abs(zero.alpha[0]) < 1e-9
    trim = [angle_from_cm(SMOOTH, 0.0, 18.0, 1e-5, x_over_d=X, hint=h).alpha[0] for h in (0.05, -0.05)]
    assert np.degrees(trim[0]) == pytest.approx(1.01, abs=0.01) and trim[1] == pytest.approx(-trim[0])
    assert angle_from_cm(SMOOTH, 0.0, 12.0, 1e-5, x_over_d=X).status[0] == Solutions.UNIQUE


def test_hint_selects_the_solution():
    c = SMOOTH.lookup(18.0, 1e-5, np.radians([0.4, 0.9])).cm_at(X)
    solution = angle_from_cm(SMOOTH, c, 18.0, 1e-5, x_over_d=X, hint=np.radians([0.4, 0.9]))
    np.testing.assert_allclose(np.degrees(solution.alpha), [0.4, 0.9], atol=1e-6)
    assert (solution.status == Solutions.SEVERAL).all()


def test_no_solution_beyond_the_table():
    solution = angle_from_cn(SMOOTH, [0.5, -0.5, np.nan, 0.01], 20.0, 1e-5)
    np.testing.assert_array_equal(solution.status, [Solutions.NONE] * 3 + [Solutions.UNIQUE])
    assert np.isnan(solution.alpha[:3]).all()


def test_pair_of_solutions_between_grid_points():
    """Two solutions 0.1 degrees apart, just below the maximum of the nose-up moment; above it only one, nose-down."""
    angles = np.radians(np.linspace(0.1, 2.0, 4001))
    cm = SMOOTH.lookup(18.0, 1e-5, angles).cm_at(X)
    peak = int(np.argmax(cm))
    truth = angles[peak] + np.radians(0.05)
    target = SMOOTH.lookup(18.0, 1e-5, truth).cm_at(X)
    solution = angle_from_cm(SMOOTH, target, 18.0, 1e-5, x_over_d=X, hint=truth)
    assert solution.status[0] == Solutions.SEVERAL and solution.alpha[0] == pytest.approx(truth, abs=1e-8)
    above = angle_from_cm(SMOOTH, cm[peak] + 1e-7, 18.0, 1e-5, x_over_d=X, hint=truth)
    assert above.status[0] == Solutions.UNIQUE and above.alpha[0] < 0.0


def test_extremum_in_the_last_interval_of_the_table():
    mach, knudsen, alpha = 13.67866988489261, 0.5767935835194304, np.radians(24.925589702593047)
    target = CUBIC.lookup(mach, knudsen, alpha).cm_at(X)
    solution = angle_from_cm(CUBIC, target, mach, knudsen, x_over_d=X, hint=alpha)
    assert solution.status[0] == Solutions.SEVERAL and solution.alpha[0] == pytest.approx(alpha, abs=1e-8)


def test_discontinuity_of_a_table_that_starts_above_zero_is_no_solution():
    alpha = np.radians([2.0, 6.0, 10.0])
    row = np.array([0.02, 0.05, 0.09])
    rows = np.stack([row, row])
    table = GridTable("mach", np.array([1.0, 30.0]), alpha, rows + 1.5, rows, -rows)
    database = Database(table, SMOOTH.rarefied)
    solution = angle_from_cn(database, [0.01, 0.05, -0.05], 10.0, 1e-6)
    np.testing.assert_array_equal(solution.status, [0, 1, 1])
    np.testing.assert_allclose(solution.alpha[1:], np.radians([6.0, -6.0]), atol=1e-12)


def test_many_samples_equal_one_at_a_time():
    t = np.linspace(0.0, 1.0, 7000)
    mach, knudsen = 29.0 - 28.0 * t, 10.0 ** (-6.0 + 8.0 * (1.0 - t) ** 3)
    alpha = np.radians(3.0 + 2.9 * np.sin(100.0 * t))
    cn = SMOOTH.lookup(mach, knudsen, alpha).cn
    solution = angle_from_cn(SMOOTH, cn, mach, knudsen, hint=alpha)
    np.testing.assert_allclose(solution.alpha, alpha, atol=1e-6)
    subset = slice(None, None, 701)
    single = [
        angle_from_cn(SMOOTH, *point, hint=h).alpha[0]
        for *point, h in zip(cn[subset], mach[subset], knudsen[subset], alpha[subset], strict=True)
    ]
    np.testing.assert_allclose(single, solution.alpha[subset], atol=1e-12)
