import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from edl_filter.aero.database import load_database, shipped_database
from edl_filter.aero.grid import GridTable
from edl_filter.aero.inverse import Solutions, angle_from_cm, angle_from_cn

X = 0.253
SMOOTH = shipped_database()
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
def test_inverse_of_a_look_up_is_the_angle(database, mach, knudsen, alpha, sign):
    c = database.lookup(mach, knudsen, alpha)
    for solve, target, how in ((angle_from_cn, c.cn, {}), (angle_from_cm, c.cm_at(X), {"x_over_d": X})):
        found = solve(database, sign * target, mach, knudsen, hint=sign * alpha, **how)
        assert found.status[0] != Solutions.NONE
        again = database.lookup(mach, knudsen, abs(found.alpha[0]))
        value = again.cn if solve is angle_from_cn else again.cm_at(X)
        assert np.sign(found.alpha[0]) * value == pytest.approx(sign * target, abs=1e-10)
        # Where the curve is flat the angle is as uncertain as the sum's last bits
        near = database.lookup(mach, knudsen, np.clip([alpha - 1e-6, alpha + 1e-6], 0.0, np.radians(25.0)))
        change = np.ptp(near.cn if solve is angle_from_cn else near.cm_at(X))
        assume(change > 1e-12)
        if found.status[0] == Solutions.UNIQUE:
            assert found.alpha[0] == pytest.approx(sign * alpha, abs=1e-6)


def test_the_bounded_instability_has_several_angles():
    """At Mach 18 the moment is nose-up at small angles: zero moment at zero and at plus and minus the trim."""
    zero = angle_from_cm(SMOOTH, 0.0, 18.0, 1e-5, x_over_d=X)
    assert zero.status[0] == Solutions.SEVERAL and zero.count[0] == 3 and abs(zero.alpha[0]) < 1e-9
    trim = [angle_from_cm(SMOOTH, 0.0, 18.0, 1e-5, x_over_d=X, hint=h).alpha[0] for h in (0.05, -0.05)]
    assert np.degrees(trim[0]) == pytest.approx(1.01, abs=0.01) and trim[1] == pytest.approx(-trim[0])
    assert angle_from_cm(SMOOTH, 0.0, 18.0, 1e-5, x_over_d=X, signed=False).count[0] == 2
    assert angle_from_cm(SMOOTH, 0.0, 12.0, 1e-5, x_over_d=X).status[0] == Solutions.UNIQUE


def test_the_hint_chooses():
    c = SMOOTH.lookup(18.0, 1e-5, np.radians([0.4, 0.9])).cm_at(X)
    found = angle_from_cm(SMOOTH, c, 18.0, 1e-5, x_over_d=X, hint=np.radians([0.4, 0.9]))
    np.testing.assert_allclose(np.degrees(found.alpha), [0.4, 0.9], atol=1e-6)
    assert (found.status == Solutions.SEVERAL).all()


def test_beyond_the_table_there_is_none():
    found = angle_from_cn(SMOOTH, [0.5, -0.5, np.nan, 0.01], 20.0, 1e-5)
    np.testing.assert_array_equal(found.status, [Solutions.NONE] * 3 + [Solutions.UNIQUE])
    assert np.isnan(found.alpha[:3]).all()


def test_an_offset_shifts_the_trim():
    """With the centre of mass below the axis the body trims nose up, and curves are not odd any more."""
    found = angle_from_cm(SMOOTH, 0.0, 12.0, 1e-5, x_over_d=X, z_over_d=0.003)
    assert found.status[0] == Solutions.UNIQUE and found.alpha[0] > 0.0
    assert SMOOTH.lookup(12.0, 1e-5, found.alpha[0]).cm_at(X, 0.003) == pytest.approx(0.0, abs=1e-12)


def test_a_pair_hidden_between_grid_points_is_found():
    """Two solutions 0.1 degrees apart, just below the top of the nose-up moment."""
    angles = np.radians(np.linspace(0.1, 2.0, 4001))
    cm = SMOOTH.lookup(18.0, 1e-5, angles).cm_at(X)
    top = int(np.argmax(cm))
    truth = angles[top] + np.radians(0.05)
    target = SMOOTH.lookup(18.0, 1e-5, truth).cm_at(X)
    found = angle_from_cm(SMOOTH, target, 18.0, 1e-5, x_over_d=X, hint=truth, signed=False)
    assert found.count[0] == 2 and found.alpha[0] == pytest.approx(truth, abs=1e-8)
    assert angle_from_cm(SMOOTH, cm[top] + 1e-7, 18.0, 1e-5, x_over_d=X, signed=False).status[0] == Solutions.NONE


def test_a_fold_in_the_tables_last_step_is_found():
    mach, knudsen, alpha = 13.67866988489261, 0.5767935835194304, np.radians(24.925589702593047)
    target = CUBIC.lookup(mach, knudsen, alpha).cm_at(X)
    found = angle_from_cm(CUBIC, target, mach, knudsen, x_over_d=X, hint=alpha)
    assert found.status[0] == Solutions.SEVERAL and found.alpha[0] == pytest.approx(alpha, abs=1e-8)


def test_the_jump_of_a_table_that_starts_above_zero_is_no_solution():
    alpha = np.radians([2.0, 6.0, 10.0])
    row = np.array([0.02, 0.05, 0.09])
    both = np.stack([row, row])
    table = GridTable("mach", np.array([1.0, 30.0]), alpha, both + 1.5, both, -both)
    database = load_database()
    own = type(database)(table, database.rarefied)
    found = angle_from_cn(own, [0.01, 0.05, -0.05], 10.0, 1e-6)
    np.testing.assert_array_equal(found.status, [0, 1, 1])
    np.testing.assert_allclose(found.alpha[1:], np.radians([6.0, -6.0]), atol=1e-12)


def test_many_samples_equal_one_at_a_time():
    t = np.linspace(0.0, 1.0, 7000)
    mach, knudsen = 29.0 - 28.0 * t, 10.0 ** (-6.0 + 8.0 * (1.0 - t) ** 3)
    alpha = np.radians(3.0 + 2.9 * np.sin(100.0 * t))
    cn = SMOOTH.lookup(mach, knudsen, alpha).cn
    found = angle_from_cn(SMOOTH, cn, mach, knudsen, hint=alpha)
    np.testing.assert_allclose(found.alpha, alpha, atol=1e-6)
    some = slice(None, None, 701)
    one = [
        angle_from_cn(SMOOTH, *point, hint=h).alpha[0]
        for *point, h in zip(cn[some], mach[some], knudsen[some], alpha[some], strict=True)
    ]
    np.testing.assert_allclose(one, found.alpha[some], atol=1e-12)
