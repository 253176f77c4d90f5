"""Constant nuisance parameters: which a mission yields, their states, and a point that has their values.

The increments of another flight are an effect whose parameters are the amplitudes of the modes of their covariance.
"""

from dataclasses import replace

import numpy as np
import pytest
from standins import N, flow, totals

from edl_filter import Mission
from edl_filter.aero.discrepancy import DiscrepancyPrior
from edl_filter.aero.increment_tables import IncrementTables
from edl_filter.aero.increments import DatabaseUpdate, RegimeUpdate
from edl_filter.diagnosis.linear_model.effect_jacobian import effect_jacobian
from edl_filter.diagnosis.linear_model.flight_case import load_case
from edl_filter.diagnosis.linear_model.linearization import linearize_at, map_point
from edl_filter.diagnosis.linear_model.linearization_point import smoothed_point
from edl_filter.diagnosis.linear_model.stated_parameters import (
    ImuAlignment,
    ImuClock,
    LearnedIncrements,
    stated_parameters,
)
from edl_filter.effects.base import EffectInstance
from edl_filter.effects.registry import catalogue
from edl_filter.estimation.kalman import whitening_filter
from edl_filter.estimation.linear_state_space import with_known_states
from edl_filter.telemetry.record import SampleFinding

STATED = ("vehicle.centre_of_mass_sigma=[0.002, 0.0, 0.001]",)
MACH, ALPHA = np.array([5.0, 10.0, 20.0]), np.array([0.0, 0.05, 0.1])
LIMIT = 1e-3
#: One sample at each of some knots: index of the Mach number and of the angle.
KNOTS = np.array([[0, 1], [1, 1], [2, 1], [0, 2], [1, 2], [2, 2], [1, 0]])


def stated_by(changes, telemetry, name="practice_mer"):
    """Key of the effect → sigma by parameter, of a shipped mission with changes."""
    stated = stated_parameters(Mission.load(f"builtin:{name}", changes), telemetry)
    assert all(not any(s.instance.values.values()) for s in stated)  # each is stated as zero
    return {s.instance.key: s.sigma for s in stated}


def test_what_a_mission_states_as_exact_is_no_parameter(practice_06):
    assert stated_by((), practice_06.telemetry) == {}
    exact = ("vehicle.centre_of_mass_sigma=[0.0, 0.0, 0.0]", "aerodynamics.coefficient_sigma=1.0")
    assert stated_by(exact, practice_06.telemetry) == {}


@pytest.mark.parametrize(("name", "imu"), [("primary", None), ("secondary", "secondary")])
def test_the_clock_of_an_imu_whose_stamps_scatter_is_uncertain_by_the_scatter(practice_06, name, imu):
    finding = SampleFinding(name, "all", 0.0, 300.0, 2400, "jitter", clock_sigma=7e-3)
    telemetry = replace(practice_06.telemetry, findings=(finding,))
    assert stated_by((), telemetry) == {("imu_clock", imu): {"tau": 7e-3}}


@pytest.mark.parametrize(
    ("change", "key", "sigma"),
    [
        ("vehicle.centre_of_mass_sigma=[0.002, 0.0, 0.001]", "com_offset", {"dx": 2e-3, "dz": 1e-3}),
        (
            "vehicle.inertia={xx: 270.0, yy: 205.0, zz: 210.0, xy: 0.0, xz: 0.0, yz: 0.0, xy_sigma: 0.5, yz_sigma: 2}",
            "products_of_inertia",
            {"a": 0.5, "c": 2.0},
        ),
        ("aerodynamics.discrepancy.rolling_sigma=4.1e-7", "rolling_moment", {"c": 4.1e-7}),
        ("aerodynamics.discrepancy.damping_sigma=0.1", "pitch_damping", {"a": 0.1}),
    ],
)
@pytest.mark.parametrize("coefficient_sigma", [0.0, 1.0])
def test_vehicle_and_database(practice_06, change, key, sigma, coefficient_sigma):
    """Whether the tables are exact or not."""
    changes = (change, f"aerodynamics.coefficient_sigma={coefficient_sigma}")
    assert stated_by(changes, practice_06.telemetry) == {(key, None): sigma}


def imu_changes(imu, **sigma):
    return [f"telemetry.imus.{imu}.{name}={value}" for name, value in sigma.items()]


def test_each_imu_has_a_place_and_those_that_check_an_alignment_and_a_clock(spirit):
    """Which are those against the driving IMU: of the driving one itself they are zero."""
    telemetry = spirit.telemetry
    driving = telemetry.driving.units[int(telemetry.driving.unit[0])]
    checking = {record.name for record in telemetry.checking}
    sigma = {"position_sigma": 0.01, "alignment_sigma_deg": 0.1, "clock_sigma_s": 0.002}
    changes = [c for imu in spirit.mission.telemetry.imus for c in imu_changes(imu, **sigma)]
    place = dict.fromkeys(("dx", "dy", "dz"), 0.01)
    expected = {("imu_lever_arm", None): place}
    for name in set(spirit.mission.telemetry.imus) - {driving}:
        assert name in checking
        expected |= {
            ("imu_lever_arm", name): place,
            ("imu_alignment", name): dict.fromkeys(("mx", "my", "mz"), pytest.approx(np.radians(0.1))),
            ("imu_clock", name): {"tau": 0.002},
        }
    imus = {key: s for key, s in stated_by(changes, telemetry, "mer_a").items() if "imu" in key[0]}
    assert imus == expected


def test_an_imu_without_sigmas_has_no_parameters(spirit):
    names = spirit.mission.telemetry.imus
    changes = [c for imu in names for c in imu_changes(imu, position_sigma=0.0, alignment_sigma_deg=0.0)]
    stated = stated_by(changes, spirit.telemetry, "mer_a")
    assert not [key for key in stated if "imu" in key[0]]


@pytest.mark.parametrize("effect", [ImuAlignment(), ImuClock()])
def test_a_corrected_reading_is_the_true_one(effect):
    time = np.arange(0.0, 20.0, 0.05)
    force = np.column_stack((np.sin(0.3 * time), np.cos(0.2 * time), 5.0 + 0.1 * time))
    rate = 0.1 * force[:, ::-1]
    values = {"tau": 0.02} if effect.name == "imu_clock" else {"mx": 1e-3, "my": -2e-3, "mz": 3e-3}
    readings = effect.imu(values, time, force, rate)
    assert np.abs(readings[0] - force).max() > 1e-3
    corrected = effect.corrected(values, time, *readings)
    for actual, expected in zip(corrected, (force, rate), strict=True):
        np.testing.assert_allclose(actual[20:-20], expected[20:-20], rtol=0.0, atol=2e-5)


# --- states and the point -------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def case(practice_06):
    """The shipped flight with an uncertain centre of mass, roll and damping beside an uncertain database."""
    changes = (*STATED,
        "aerodynamics.discrepancy.rolling_sigma=2e-6", "aerodynamics.discrepancy.damping_sigma=0.1",
        "aerodynamics.coefficient_sigma=0.5",
    )  # fmt: skip
    return load_case(Mission.load("builtin:practice_mer", changes))


@pytest.fixture(scope="module")
def model(case):
    return linearize_at(case, smoothed_point(case.reconstruction))


def at_constants(model, values):
    """The same Jacobians about a point with other values of the constants."""
    constants = tuple(
        replace(c.instance, values=c.instance.values | {name: next(values) for name in c.sigma})
        for c in model.case.constants
    )
    return model.at_point(replace(model.point, constants=constants), model.effects)


def test_the_columns_are_constant_states_with_the_stated_sigmas(case, model):
    sigma = [s for c in case.constants for s in c.sigma.values()]
    assert sigma == [2e-3, 1e-3, 2e-6, 0.1]
    s, count = model.state_space, len(sigma)
    assert s.size == model.nuisance.size + count
    np.testing.assert_allclose(np.diag(s.initial_covariance)[-count:], np.square(sigma), rtol=1e-12)
    assert not s.initial_covariance[-count:, :-count].any()
    np.testing.assert_array_equal(s.design[:, -count:], model.constant_columns)
    steps = [0, len(s.increment) // 2, len(s.increment) - 1]
    assert all(not s.increment[k][-count:].any() and not s.process_noise[k][-count:].any() for k in steps)
    np.testing.assert_array_equal(model.constant_values, 0.0)
    by_name = [("rolling_moment", ("c",)), ("pitch_damping", ("a",))]
    expected = [effect_jacobian(model, EffectInstance(catalogue()[n], {}), p).rows for n, p in by_name]
    np.testing.assert_allclose(model.constant_columns[:, 2:], np.concatenate(expected, axis=1), rtol=1e-9, atol=1e-15)
    assert all(np.linalg.norm(column) > 0.0 for column in model.constant_columns.T)


@pytest.mark.parametrize("index", [0, 1, 2, 3])
def test_a_point_with_the_value_of_a_constant_has_the_same_white_residuals(model, index):
    """To first order: what the point has is added again by the column, so that the prior keeps its mean of zero."""
    size = 1e-2 * np.sqrt(np.diag(model.state_space.initial_covariance))[model.nuisance.size + index]
    moved = at_constants(model, iter(np.where(np.arange(4) == index, size, 0.0).tolist()))
    assert moved.constant_values[index] == size
    whiten = model.stated_noise_filter
    change = moved.index.stack(moved.residuals) - model.index.stack(model.residuals)
    np.testing.assert_allclose(
        np.linalg.norm(change), size * np.linalg.norm(model.constant_columns[:, index]), rtol=1e-2
    )
    zero = np.zeros((model.nuisance.size, 1))
    in_residuals = np.linalg.norm(change / whiten.innovation_sigma)
    remaining = whiten((moved.residual_vector - model.residual_vector)[:, None], zero)
    assert in_residuals > 0.01 and np.linalg.norm(remaining) < 0.01 * in_residuals


def test_the_most_probable_point_has_the_most_probable_constants(model):
    """Those of a regression on their white columns under the same model without them, with their sigmas as priors."""
    count = model.constant_columns.shape[1]
    n, s = model.nuisance.size, model.state_space
    without = replace(
        s,
        increment=replace(s.increment, size=n),
        process_noise=replace(s.process_noise, size=n),
        design=np.ascontiguousarray(s.design[:, :n]),
        initial_covariance=s.initial_covariance[:n, :n],
    )
    plain = whitening_filter(without)
    columns = plain(model.constant_columns, np.zeros((n, count)))
    residuals = plain(model.residual_vector[:, None], model.initial_mean[:, None])[:, 0]
    prior = np.diag(s.initial_covariance)[n:]
    expected = np.linalg.solve(columns.T @ columns + np.diag(1.0 / prior), columns.T @ residuals)
    whiten = model.stated_noise_filter
    point = map_point(model, whiten, model.white_residuals(whiten))
    pairs = zip(model.case.constants, point.constants, strict=True)
    estimate = [instance.values[name] for stated, instance in pairs for name in stated.sigma]
    np.testing.assert_allclose(estimate, expected, rtol=1e-5, atol=1e-6 * np.sqrt(prior).min())
    assert np.all(np.abs(estimate) > 0.0)


def test_an_effect_is_known_no_better_than_the_stated_error_of_its_coefficient(practice_06):
    """The variance of its size is that with an exact coefficient, plus that of the stated error."""
    sigma = 4.1e-7
    mission = Mission.load("builtin:practice_mer", [f"aerodynamics.discrepancy.rolling_sigma={sigma}"])
    case = load_case(mission)
    model = linearize_at(case, smoothed_point(case.reconstruction))
    column = effect_jacobian(model, EffectInstance(catalogue()["rolling_moment"], {}), ["c"])
    exact = with_known_states(model.state_space, [model.nuisance.size])
    variance, variance_of_exact = (
        1.0 / float(np.sum(whitening_filter(space)(column.rows, column.initial_mean) ** 2))
        for space in (model.state_space, exact)
    )
    assert variance_of_exact < 0.1 * sigma**2
    assert variance == pytest.approx(variance_of_exact + sigma**2, rel=1e-6)


def covariance():
    """A covariance of rank 4 of all increments, in which CN and Cm are certain at zero angle."""
    roots = np.random.default_rng(4).normal(size=(4, 3, len(MACH), len(ALPHA)))
    roots[:, 1:, :, 0] = 0.0
    roots = roots.reshape(4, -1)
    return roots.T @ roots


@pytest.fixture(scope="module")
def increments():
    shape = (3, len(MACH), len(ALPHA))
    sigma = np.sqrt(np.diag(covariance())).reshape(shape)
    regime = RegimeUpdate("mach", MACH, ALPHA, np.zeros(shape), sigma, sigma, np.ones(shape[1:], int))
    return LearnedIncrements(IncrementTables(DatabaseUpdate("MER", DiscrepancyPrior(), (regime,), covariance())), LIMIT)


def at_knots(**changes):
    values = {"mach": MACH[KNOTS[:, 0]], "alpha_total": ALPHA[KNOTS[:, 1]], "knudsen": np.full(N, 1e-5)}
    return flow(**(values | changes))


def change(effect, amplitudes, flight):
    """Changes of CA, CN and Cm ``(3, N)``."""
    before = totals()
    after = effect.coefficients(amplitudes, flight, before)
    return np.stack([getattr(after, c) - getattr(before, c) for c in ("ca", "cn", "cm_nose")])


def test_there_is_one_amplitude_of_unit_variance_for_each_mode(increments):
    assert [q.name for q in increments.parameters] == ["q0", "q1", "q2", "q3"]
    assert increments.sigma == dict.fromkeys(("q0", "q1", "q2", "q3"), 1.0)


def test_files_of_another_rank_have_parameters_of_their_own(increments):
    update = increments._tables.update
    one_mode = np.outer(*[np.sqrt(np.diag(update.covariance))] * 2)
    smaller = LearnedIncrements(IncrementTables(replace(update, covariance=one_mode)), LIMIT)
    assert (len(smaller.parameters), len(increments.parameters)) == (1, 4)


def test_amplitudes_of_unit_variance_have_the_covariance_of_the_file(increments):
    """The covariance of the coefficients at the knots, summed over the modes."""
    changes = np.stack([change(increments, {q.name: 1.0}, at_knots()).ravel() for q in increments.parameters])
    places = (
        np.arange(3 * len(MACH) * len(ALPHA)).reshape(3, len(MACH), len(ALPHA))[:, KNOTS[:, 0], KNOTS[:, 1]].ravel()
    )
    np.testing.assert_allclose(changes.T @ changes, covariance()[np.ix_(places, places)], atol=1e-10)


def test_the_change_is_linear_in_the_amplitudes_and_nothing_else_changes(increments):
    single = change(increments, {"q0": 1.0}, at_knots()), change(increments, {"q2": 1.0}, at_knots())
    both = increments.coefficients({"q0": -2.0, "q2": 0.5}, at_knots(), totals())
    np.testing.assert_allclose(both.ca - totals().ca, -2.0 * single[0][0] + 0.5 * single[1][0], atol=1e-12)
    np.testing.assert_array_equal(both.cl, totals().cl)
    np.testing.assert_array_equal(both.cmq, totals().cmq)


def test_without_amplitudes_the_coefficients_are_those_given(increments):
    before = totals()
    assert increments.coefficients({}, at_knots(), before) is before


def test_a_regime_that_the_file_does_not_have_is_not_changed(increments):
    assert not change(increments, {"q0": 1.0}, at_knots(knudsen=np.full(N, 2.0 * LIMIT))).any()
    assert change(increments, {"q0": 1.0}, at_knots(knudsen=np.full(N, 0.5 * LIMIT))).any()
