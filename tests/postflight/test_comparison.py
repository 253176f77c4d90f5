"""Combinations of coefficients against look-ups of the database, and their angles."""

from dataclasses import replace

import numpy as np
from model_flights import X, flight

from edl_filter.postflight.comparison import database_coefficients, from_forces, from_moments
from edl_filter.postflight.derive import derive


def cut(i, case):
    """Speed and velocity up to the parachute."""
    n = len(case.atmosphere.time)
    return i.speed[:n], i.velocity_body[:n]


def with_values(coefficients, values):
    """Flight coefficients with other values."""
    return replace(coefficients, value={**coefficients.value, **values})


def test_combinations_return_the_angle_of_a_look_up():
    i = flight(noisy=False)
    result = derive(i)
    case, n = result.flight, len(result.time)
    part = (result.time > 60) & (result.time < 235)
    database = database_coefficients(i.database, case.atmosphere, *cut(i, case), X)
    exact = with_values(case.coefficients, database.value)
    forces = from_forces(i.database, case.atmosphere, exact, *cut(i, case), X)
    moments = from_moments(i.database, case.atmosphere, exact, *cut(i, case), X)
    for combination in (forces, moments):
        assert np.abs(combination.alpha - i.alpha[:n])[part].max() < 1e-6
        assert np.abs(combination.beta - i.beta[:n])[part].max() < 1e-6
        for name, value in combination.value.items():
            np.testing.assert_allclose(value[part], database.value[name][part], atol=1e-8)
    assert (moments.status[part] == 2).any()  # the bounded instability


def test_a_centre_of_mass_off_the_axis():
    """The moment about the displaced point is ``M - d × F``, and its inverse look-up returns the angle."""
    i, (y, z) = flight(noisy=False), (0.004, -0.003)
    result = derive(i)
    case = result.flight
    on_axis = case.database.value
    database = database_coefficients(i.database, case.atmosphere, *cut(i, case), X, 0.0, (y, z))
    force = np.stack((-on_axis["CA"], on_axis["CY"], -on_axis["CN"]), axis=1)
    displaced = np.stack([on_axis[k] for k in ("Cl", "Cm", "Cn")], axis=1) - np.cross([0.0, y, z], force)
    for k, name in enumerate(("Cl", "Cm", "Cn")):
        np.testing.assert_allclose(database.value[name], displaced[:, k], atol=1e-15)
    exact = with_values(case.coefficients, database.value)
    part = (result.time > 60) & (result.time < 235)
    alpha = i.alpha[: len(result.time)]
    moments = from_moments(i.database, case.atmosphere, exact, *cut(i, case), X, 1, (y, z))
    assert np.abs(moments.alpha - alpha)[part].max() < 1e-5
    for name in ("CN", "CY"):
        np.testing.assert_allclose(moments.value[name][part], database.value[name][part], atol=1e-6)
    forces = from_forces(i.database, case.atmosphere, exact, *cut(i, case), X, 1, (y, z))
    unique = part & (forces.status == 1)
    np.testing.assert_allclose(forces.value["Cm"][unique], database.value["Cm"][unique], atol=1e-8)
    # with a centre of mass on the axis, the same moments would give an angle with an error of degrees
    wrong = from_moments(i.database, case.atmosphere, exact, *cut(i, case), X)
    assert np.nanmax(np.abs(wrong.alpha - alpha)[part]) > np.deg2rad(1.0)


def test_a_force_beyond_the_table_has_no_angle():
    i = flight(noisy=False)
    case = derive(i).flight
    valid = case.atmosphere.valid
    beyond = with_values(case.coefficients, {"CN": np.full(len(valid), 5.0)})
    combination = from_forces(i.database, case.atmosphere, beyond, *cut(i, case), X)
    assert (combination.status[valid] == 0).all() and (combination.status[~valid] == -1).all()
    assert np.isnan(combination.alpha).all() and np.isnan(combination.value["Cm"]).all()


def test_a_stride_resolves_the_smoothed_series():
    i = flight(noisy=False)
    result = derive(i)
    case = result.flight
    every, second = (
        from_moments(i.database, case.atmosphere, case.coefficients, *cut(i, case), X, stride) for stride in (1, 2)
    )
    part = (every.status == 1) & (result.time > 60) & (result.time < 95)
    # relative error of linear interpolation: (1.3 rad/s * 0.25 s)^2 / 8
    assert np.abs(every.alpha - second.alpha)[part].max() < 0.02 * np.abs(every.alpha[part]).max()
    assert (second.status[part] == 1).all()


def test_with_a_stride_only_nan_says_whether_there_is_a_value():
    """The status between two look-ups is the earlier one's; the values are NaN if either has no solution."""
    i = flight(noisy=False)
    case = derive(i).flight
    cn = case.coefficients.value["CN"].copy()
    hole = np.flatnonzero(case.atmosphere.valid)[::4][200]
    cn[hole] = 5.0  # beyond the table
    holed = with_values(case.coefficients, {"CN": cn})
    fourth = from_forces(i.database, case.atmosphere, holed, *cut(i, case), X, 4)
    assert np.isnan(fourth.alpha[hole]) and fourth.status[hole] == 0
    before, after = slice(hole - 3, hole), slice(hole + 1, hole + 4)
    assert (fourth.status[before] >= 1).all() and np.isnan(fourth.alpha[before]).all()
    assert (fourth.status[after] == 0).all() and np.isnan(fourth.alpha[after]).all()
    assert np.isfinite(fourth.alpha[hole - 4]) and np.isfinite(fourth.alpha[hole + 4])
