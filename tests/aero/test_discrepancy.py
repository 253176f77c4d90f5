"""The prior of a database's discrepancy: kernels, modes that a flight resolves, flow distances."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from edl_filter import InputError, Mission
from edl_filter.aero.discrepancy import FIELD_COEFFICIENTS, NEGLIGIBLE_INFORMATION, AngleModes, DiscrepancyPrior

PRIOR = DiscrepancyPrior(scale=1.0)
ANGLES = np.radians(np.array([0.0, 0.3, 1.0, 2.5, 4.0, 7.0, 11.0, 16.0, 30.0]))
angles = st.lists(st.floats(0.0, 1.0), min_size=1, max_size=12).map(np.array)


def kernel_by_hand(coefficient, a, b, prior=PRIOR):
    """The covariance over the angle, element by element."""
    value = np.exp(-((a - b) ** 2) / (2.0 * prior.angle_length**2))
    if coefficient != "ca":
        value *= np.tanh(a / prior.vanishing_angle) * np.tanh(b / prior.vanishing_angle)
    return value


# --- kernels --------------------------------------------------------------------------------------------------------


@given(st.sampled_from(FIELD_COEFFICIENTS), angles, angles)
def test_kernels_are_the_stated_functions(coefficient, a, b):
    kernel = PRIOR.angle_kernel(coefficient, a, b)
    expected = [[kernel_by_hand(coefficient, x, y) for y in b] for x in a]
    np.testing.assert_allclose(kernel, expected, rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(kernel, PRIOR.angle_kernel(coefficient, b, a).T, rtol=1e-14)


@given(st.sampled_from(FIELD_COEFFICIENTS), angles)
def test_kernels_are_covariances(coefficient, a):
    assert np.linalg.eigvalsh(PRIOR.angle_kernel(coefficient, a, a)).min() > -1e-12 * len(a)


def test_the_marginal_sigma_is_that_of_the_database():
    """Of CA everywhere; those of CN and Cm vanish at zero angle and reach it beyond the vanishing angle."""
    variance = {name: np.diag(PRIOR.angle_kernel(name, ANGLES, ANGLES)) for name in FIELD_COEFFICIENTS}
    np.testing.assert_array_equal(variance["ca"], 1.0)
    for name in ("cn", "cm"):
        assert variance[name][0] == 0.0 and np.all(np.diff(variance[name]) > 0.0)
        np.testing.assert_allclose(np.sqrt(variance[name]), np.tanh(ANGLES / PRIOR.vanishing_angle), rtol=1e-12)
        assert variance[name][-1] == pytest.approx(1.0, abs=1e-5)
        assert not PRIOR.angle_kernel(name, np.zeros(1), ANGLES).any()


# --- modes ----------------------------------------------------------------------------------------------------------


SMOOTH = (np.zeros(0), np.zeros(0))


def modes_of(coefficient, angle, information, table_angles=SMOOTH):
    """Modes of two tables that are smooth, unless their angles are given."""
    return PRIOR.angle_modes(coefficient, angle, information, table_angles)


def in_continuum(modes, angle):
    """Values of the modes in continuum flow."""
    return modes.at(angle, np.zeros(len(angle), bool))


def oscillation(amplitude_deg, count=4000, mean_deg=0.0):
    """Total angles (rad) of an oscillation, up to its amplitude."""
    return np.radians(np.abs(mean_deg + amplitude_deg * np.sin(np.linspace(0.0, 60.0, count))))


@pytest.mark.parametrize("coefficient", FIELD_COEFFICIENTS)
@pytest.mark.parametrize("amplitude", [0.5, 5.0, 14.0])
def test_modes_reproduce_the_kernel_where_there_is_information(coefficient, amplitude):
    """The sum of their products is the covariance, to the variance that a datum cannot resolve."""
    angle = oscillation(amplitude)
    information = 1e4
    modes = modes_of(coefficient, angle, np.full(len(angle), information))
    at = np.radians(np.linspace(0.1, 0.95, 15) * amplitude)
    values = in_continuum(modes, at)
    missing = PRIOR.angle_kernel(coefficient, at, at) - values @ values.T
    # what is left out is positive, and no more than data of negligible information leave
    variance = np.diag(missing)
    assert variance.min() > -2e-3
    assert np.abs(missing).max() < 2e-3
    assert modes.count >= (1 if amplitude < 1.0 else 3)


@pytest.mark.parametrize("coefficient", FIELD_COEFFICIENTS)
def test_modes_give_the_posterior_of_the_dense_field(coefficient):
    """Rasmussen and Williams: regression on the modes against regression on the kernel, from the same data."""
    random = np.random.default_rng(4)
    angle = oscillation(9.0, 400)
    sigma = 0.02
    modes = modes_of(coefficient, angle, np.full(len(angle), sigma**-2))
    kernel = PRIOR.angle_kernel(coefficient, angle, angle)
    truth = np.linalg.cholesky(kernel + 1e-10 * np.eye(len(angle))) @ random.standard_normal(len(angle))
    data = truth + sigma * random.standard_normal(len(angle))
    at = np.radians(np.linspace(0.0, 9.0, 10))
    cross = PRIOR.angle_kernel(coefficient, at, angle)
    dense = cross @ np.linalg.solve(kernel + sigma**2 * np.eye(len(angle)), data)
    x = in_continuum(modes, angle)
    amplitude = np.linalg.solve(x.T @ x / sigma**2 + np.eye(modes.count), x.T @ data / sigma**2)
    posterior = PRIOR.angle_kernel(coefficient, at, at) - cross @ np.linalg.solve(
        kernel + sigma**2 * np.eye(len(angle)), cross.T
    )
    spread = np.sqrt(np.maximum(np.diag(posterior), 1e-12))
    assert np.all(np.abs(in_continuum(modes, at) @ amplitude - dense) < 2.0 * spread + 1e-3)


def test_fewer_modes_where_there_is_less_information():
    """None where the posterior is the prior; more for more information and for a wider range of angles."""
    angle = oscillation(9.0)

    def count(information, amplitude=9.0):
        angle = oscillation(amplitude)
        return modes_of("ca", angle, np.full(len(angle), information)).count

    counts = [count(i) for i in (1e-5, 1e-3, 1e-1, 1e1, 1e3)]
    assert counts[0] == 0 and counts == sorted(counts) and len(set(counts)) == len(counts)
    assert count(1.0, 0.5) < count(1.0, 5.0) < count(1.0, 20.0)
    for zero in (np.zeros(len(angle)), np.zeros(0)):
        assert modes_of("ca", angle[: len(zero)], zero).count == 0
    at_zero = modes_of("cm", np.zeros(9), np.full(9, 1e6))
    assert at_zero.count == 0  # a moment that vanishes is known


def test_one_datum_has_one_mode_that_is_its_covariance():
    """Which is left out where its variance and information are less than the threshold."""
    angle = PRIOR.angle_length * np.array([1.0])  # at a node of the eigenvalue problem
    for factor, count in ((1.01, 1), (0.99, 0)):
        modes = modes_of("ca", angle, np.array([factor * NEGLIGIBLE_INFORMATION]))
        assert modes.count == count
    (mode,) = in_continuum(modes_of("ca", angle, np.array([7.0])), ANGLES).T
    np.testing.assert_allclose(np.abs(mode), PRIOR.angle_kernel("ca", ANGLES, angle)[:, 0], rtol=1e-4)


def test_modes_are_in_the_order_of_their_information():
    angle = oscillation(12.0)
    information = np.full(len(angle), 10.0)
    modes = modes_of("cm", angle, information)
    size = np.sum(in_continuum(modes, angle) ** 2 * information[:, None], axis=0)
    assert np.all(np.diff(size) < 0.0) and size[-1] > NEGLIGIBLE_INFORMATION * 0.99


def test_modes_are_linear_between_tabulated_angles_and_constant_beyond_them():
    step = np.radians(0.05)
    table = np.array([[0.0, 1.0], [1.0, 3.0], [4.0, -1.0]])
    modes = AngleModes(table, 10.0 * table)
    assert modes.count == 2
    np.testing.assert_allclose(
        in_continuum(modes, step * np.array([0.0, 0.25, 1.0, 1.5])), [[0, 1], [0.25, 1.5], [1, 3], [2.5, 1]]
    )
    np.testing.assert_allclose(in_continuum(modes, np.array([step * 2.0, 3.0])), [[4.0, -1.0]] * 2, atol=0.01)


@pytest.mark.parametrize("coefficient", FIELD_COEFFICIENTS)
def test_the_error_of_a_table_is_linear_between_its_angles(coefficient):
    """That of each regime between its own; at the angles it is that of the smooth field."""
    tables = np.radians([0.0, 2.0, 5.0, 10.0, 16.0]), np.radians([0.0, 8.0, 16.0])
    angle = oscillation(14.0)
    information = np.full(len(angle), 1e4)
    smooth = modes_of(coefficient, angle, information)
    linear = modes_of(coefficient, angle, information, tables)
    assert smooth.count == linear.count > 2
    at = np.radians(np.arange(0.0, 16.0, 0.05))
    for nodes, rarefied in zip(tables, (False, True), strict=True):
        regime = np.full(len(at), rarefied)
        expected = [np.interp(at, nodes, v) for v in smooth.at(nodes, np.full(len(nodes), rarefied)).T]
        np.testing.assert_allclose(linear.at(at, regime).T, expected, rtol=0.0, atol=1e-9)
        np.testing.assert_array_equal(smooth.at(at, regime), smooth.at(at, ~regime))
        assert np.abs(linear.at(at, regime) - smooth.at(at, regime)).max() > 0.01
    one_table = modes_of(coefficient, angle, information, (tables[0], np.zeros(0)))
    np.testing.assert_array_equal(one_table.at(at, np.ones(len(at), bool)), smooth.at(at, np.ones(len(at), bool)))


def test_each_sample_has_the_modes_of_its_regime():
    table = np.array([[0.0, 1.0], [1.0, 3.0], [4.0, -1.0]])
    modes, angle = AngleModes(table, 10.0 * table), np.radians(0.05) * np.array([0.5, 0.5, 1.0])
    np.testing.assert_allclose(modes.at(angle, np.array([False, True, True])), [[0.5, 2.0], [5.0, 20.0], [10.0, 30.0]])


# --- distances along the flow ---------------------------------------------------------------------------------------

MACH = np.array([25.0, 24.0, 20.0, 18.0, 18.0])
KNUDSEN = np.array([1e-1, 1e-2, 2e-3, 5e-4, 4e-4])


@pytest.mark.parametrize("separate", [True, False])
def test_flow_distances_are_in_correlation_lengths_of_each_regime(separate):
    prior = DiscrepancyPrior(log_mach_length=0.25, log_knudsen_length=2.0)
    distance = prior.flow_distance(MACH, KNUDSEN, 1e-3, separate)
    rarefied = [0.5, 0.5 * np.log10(5.0)]
    between = 100.0 if separate else 4.0 * np.log(20.0 / 18.0)
    np.testing.assert_allclose(distance, [*rarefied, between, 0.0], rtol=1e-12, atol=1e-15)
    if separate:  # the errors of the two regimes are independent
        d = np.sqrt(3.0) * distance[2]
        assert (1.0 + d) * np.exp(-d) < 1e-70


@given(st.integers(0, 1000), st.booleans())
def test_flow_distances_do_not_depend_on_the_direction(seed, separate):
    random = np.random.default_rng(seed)
    mach, knudsen = np.exp(random.normal(size=20)), 10.0 ** random.uniform(-5.0, 1.0, 20)
    forth = PRIOR.flow_distance(mach, knudsen, 1e-3, separate)
    back = PRIOR.flow_distance(mach[::-1], knudsen[::-1], 1e-3, separate)
    np.testing.assert_allclose(back[::-1], forth, rtol=1e-12)
    assert np.all(forth >= 0.0) and len(forth) == 19


# --- mission keys ---------------------------------------------------------------------------------------------------

LENGTHS = ("log_mach_length", "log_knudsen_length", "angle_length_deg", "vanishing_angle_deg")


def prior_of(*changes):
    mission = Mission.load("builtin:practice_mer", [f"aerodynamics.{change}" for change in changes])
    return mission.aerodynamics.discrepancy_prior


@pytest.mark.parametrize("name", LENGTHS)
@pytest.mark.parametrize("value", ["0.0", "-1.0", ".nan", ".inf", "long"])
def test_a_length_that_is_not_positive_is_refused(name, value):
    with pytest.raises(InputError, match=rf"^--set aerodynamics\.discrepancy\.{name}: found .*; expected "):
        prior_of(f"discrepancy.{name}={value}")


def test_an_unknown_key_is_refused():
    with pytest.raises(InputError, match=r"discrepancy\.mach_length: found an unknown key; nearest accepted: "):
        prior_of("discrepancy.mach_length=1.0")


def test_the_prior_of_a_mission():
    stated = prior_of(
        "coefficient_sigma=1.5", "discrepancy.log_mach_length=0.3", "discrepancy.log_knudsen_length=0.7",
        "discrepancy.angle_length_deg=9.0", "discrepancy.vanishing_angle_deg=2.0",
    )  # fmt: skip
    assert stated == DiscrepancyPrior(1.5, 0.3, 0.7, pytest.approx(np.radians(9.0)), pytest.approx(np.radians(2.0)))
    assert prior_of("coefficient_sigma=1.0") == DiscrepancyPrior(
        1.0, angle_length=pytest.approx(np.radians(6.0)), vanishing_angle=pytest.approx(np.radians(4.0))
    )
    assert prior_of("coefficient_sigma=0.0").scale == 0.0


# --- the error of CA along a trajectory as a sum of independent errors ------------------------------------------------


@pytest.mark.parametrize("separate", [False, True])
def test_independent_errors_of_ca_have_the_correlation_of_the_field(separate):
    """A trajectory through rarefied and continuum flow that meets Mach numbers and angles again, pair by pair."""
    time = np.linspace(0.0, 1.0, 240)
    knudsen = 10.0 ** (2.0 - 7.0 * time)
    mach = 26.0 - 24.0 * time**2 + 0.8 * np.sin(12.0 * time)
    angle = np.radians(1.0 + 9.0 * (0.5 + 0.5 * np.sin(60.0 * time)))
    along, over = PRIOR.axial_errors(mach, knudsen, angle, 1e-3, separate)
    rarefied = knudsen > 1e-3
    fastest = mach[~rarefied].max()
    expected = np.empty((240, 240))
    for i in range(240):
        for j in range(240):
            x, y = (np.log10(knudsen[k] / 1e-3) if rarefied[k] else np.log(mach[k] / fastest) / 0.5 for k in (i, j))
            r = np.sqrt(3.0) * abs(x - y)
            apart = separate and rarefied[i] != rarefied[j]
            expected[i, j] = 0.0 if apart else (1.0 + r) * np.exp(-r) * kernel_by_hand("ca", angle[i], angle[j])
    np.testing.assert_allclose((along.T @ along) * (over.T @ over), expected, atol=0.01)
    for factor in (along, over):
        np.testing.assert_allclose(np.sum(factor**2, axis=0), 1.0, rtol=1e-12)


def test_with_long_correlation_lengths_ca_has_one_error():
    prior = DiscrepancyPrior(1.0, 1e6, 1e6, 1e6)
    mach, knudsen = np.linspace(25.0, 2.0, 50), np.logspace(1, -5, 50)
    for factor in prior.axial_errors(mach, knudsen, np.linspace(0.0, 0.2, 50), 1e-3, False):
        np.testing.assert_allclose(factor.T @ factor, 1.0, atol=1e-9)
