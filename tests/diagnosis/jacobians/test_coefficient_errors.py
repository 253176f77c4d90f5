"""Errors of the coefficients: their sigmas, their loads in closed form, and the information that gives the modes.

The field of a database's discrepancy in the state-space model of a flight is compared with a dense Gaussian process.
"""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from dense_field import (
    STRETCH,
    bin_of_regime_change,
    dense_covariances,
    first_bin,
    refined_solution,
    row_noise_of,
    scaled_cholesky,
    stretch_of,
)
from hypothesis import given
from hypothesis import strategies as st

from edl_filter import Mission
from edl_filter.aero.damping import Damping
from edl_filter.aero.database import load_database
from edl_filter.aero.discrepancy import DiscrepancyPrior
from edl_filter.aero.grid import GridTable
from edl_filter.aero.surrogate import phoenix_surrogate
from edl_filter.aero.uncertainty import three_sigma
from edl_filter.diagnosis.jacobians.coefficient_errors import (
    coefficient_loads,
    database_units,
    field_modes,
    interpolated_angles,
    numerical_error_units,
)
from edl_filter.diagnosis.linear_model.flight_case import load_case
from edl_filter.diagnosis.linear_model.linearization import linearize_at
from edl_filter.diagnosis.linear_model.linearization_point import smoothed_point
from edl_filter.diagnosis.prediction.dead_reckoning import NODES_PER_BIN
from edl_filter.diagnosis.prediction.time_bins import TimeBins
from edl_filter.effects import EffectInstance
from edl_filter.effects.forward_model import ForwardModel
from edl_filter.effects.perturbation import CoefficientUnits, Perturbation
from edl_filter.effects.registry import find_effect
from edl_filter.effects.types import AeroCoefficients, Body, FlightCondition
from edl_filter.estimation.kalman import whitening_filter
from edl_filter.estimation.smoothing import smoothed_states

BINS = TimeBins(np.array([0.0, 0.1, 0.3, 0.4, 0.6, 0.7]), np.array([True, True, False, True, True]))
COUNT = NODES_PER_BIN * len(BINS.interval) + 1
TIME = np.append((BINS.edges[:-1, None] + BINS.interval[:, None] * np.arange(4) / 4.0).ravel(), BINS.edges[-1])
DIAMETER, X_OVER_D = 2.65, 0.3
AREA = np.pi / 4.0 * DIAMETER**2
INERTIA = np.array([[270.0, 5.0, -3.0], [5.0, 205.0, 2.0], [-3.0, 2.0, 210.0]])
BODY = Body(832.0, INERTIA, np.array([0.01, -0.02, 0.03]))


def flow_of(rng, knudsen=1e-5):
    """A flow of random direction about a vehicle that decelerates."""
    velocity = np.column_stack((np.linspace(4e3, 3e3, COUNT), *rng.normal(0.0, 100.0, (2, COUNT))))
    speed = np.linalg.norm(velocity, axis=1)
    return FlightCondition(
        time=TIME, altitude=np.linspace(4e4, 3e4, COUNT), velocity_body=velocity, rate=rng.normal(0.0, 0.1, (COUNT, 3)),
        speed=speed, density=np.full(COUNT, 1e-3), mach=speed / 200.0, knudsen=np.full(COUNT, knudsen),
        dynamic_pressure=rng.uniform(1e3, 5e3, COUNT), alpha_total=np.hypot(*velocity[:, 1:].T) / velocity[:, 0],
        diameter=DIAMETER,
    )  # fmt: skip


def tables_of(rng):
    return AeroCoefficients(*rng.normal([[1.6], [0.0], [0.0], [0.0], [-0.1]], 0.1, (5, COUNT)))


def units_of(rng):
    return CoefficientUnits(TIME, *rng.uniform(0.01, 0.1, (3, COUNT)))


def model_of(**changes):
    """A forward model that needs no air: only loads of a known flow are computed."""
    model = ForwardModel(None, None, None, None, Damping(), BODY, DIAMETER, X_OVER_D)
    return replace(model, **changes)


def case_of(seed, **changes):
    """Model inputs and residuals with a random flow and random tables."""
    rng = np.random.default_rng(seed)
    residuals = SimpleNamespace(flow=flow_of(rng), tables=tables_of(rng))
    return SimpleNamespace(forward_model=model_of(**changes), driving=driving_record()), residuals, units_of(rng)


def driving_record(begin=0.0):
    """Two samples a bin, of uneven noise; samples before `begin` are missing."""
    edges = np.sort(np.concatenate((BINS.edges, BINS.middle)))
    kept = edges[:-1] >= begin
    rng = np.random.default_rng(1)
    noise = rng.uniform(1e-3, 3e-3, (2, len(edges) - 1))
    return SimpleNamespace(
        time=edges[1:][kept],
        interval=np.diff(edges)[kept],
        force_noise=noise[0][kept],
        rate_noise=1e-3 * noise[1][kept],
    )


def loads_by_hand(flow, k, name, unit, centre):
    """Force and moment about the centre of mass at one node by one unit of a coefficient.

    The force acts at the nose, the moment about it is nose-up in the plane of the lateral flow.
    """
    push = flow.dynamic_pressure[k] * AREA * unit
    lateral = flow.velocity_body[k, 1:] / np.linalg.norm(flow.velocity_body[k, 1:])
    force, moment = np.zeros(3), np.zeros(3)
    if name == "ca":
        force[0] = -push
    elif name == "cn":
        force[1:] = -push * lateral
    else:
        moment[1:] = push * DIAMETER * np.array([lateral[1], -lateral[0]])
    return force, moment + np.cross(-np.asarray(centre), force)


def centre_from_nose(body):
    """Position of the centre of mass from the nose, m: x forward, y right, z down."""
    return np.array([-X_OVER_D * DIAMETER, 0.0, 0.0]) + body.offset


@pytest.mark.parametrize("name", ["ca", "cn", "cm"])
@given(seed=st.integers(0, 1000))
def test_loads_of_a_unit_are_those_of_a_force_at_the_nose(name, seed):
    """Dynamic pressure times area times unit, along the axis or against the lateral flow; the lever arm by hand."""
    inputs, residuals, units = case_of(seed)
    force, moment = coefficient_loads(inputs, residuals, name, units)
    for k in range(COUNT):
        expected = loads_by_hand(residuals.flow, k, name, getattr(units, name)[k], centre_from_nose(BODY))
        scale = residuals.flow.dynamic_pressure[k] * AREA * getattr(units, name)[k]
        np.testing.assert_allclose(force[k], expected[0], rtol=0.0, atol=1e-10 * scale)
        np.testing.assert_allclose(moment[k], expected[1], rtol=0.0, atol=1e-10 * scale)


@pytest.mark.parametrize("name", ["ca", "cn", "cm"])
def test_loads_of_a_unit_depend_neither_on_the_point_nor_on_effects_that_change_the_tables(name):
    """An effect multiplies what the tables say and not their error; a perturbation at the point is not in a unit."""
    inputs, residuals, units = case_of(3)
    expected = coefficient_loads(inputs, residuals, name, units)
    effects = (EffectInstance(find_effect("pitching_moment_scale"), {"k": 0.5}),)
    point = replace(Perturbation.zero(units), ca=np.full(1, 3.0), cn=np.full(1, -2.0), cm=np.full(1, 4.0), mass=0.1)
    changed, *_ = case_of(3, effects=effects, perturbation=point)
    for actual, value in zip(coefficient_loads(changed, residuals, name, units), expected, strict=True):
        np.testing.assert_allclose(actual, value, rtol=1e-9, atol=1e-9 * np.abs(value).max())


@given(st.integers(0, 1000), st.floats(0.1, 10.0))
def test_loads_are_linear_in_the_unit(seed, factor):
    inputs, residuals, units = case_of(seed)
    larger = CoefficientUnits(units.time, *(factor * getattr(units, n) for n in ("ca", "cn", "cm")))
    for name in ("ca", "cn", "cm"):
        pairs = zip(*(coefficient_loads(inputs, residuals, name, u) for u in (units, larger)), strict=True)
        for unit, scaled in pairs:
            np.testing.assert_allclose(scaled, factor * unit, rtol=1e-8, atol=1e-9 * np.abs(unit).max())


# --- sizes -----------------------------------------------------------------------------------------------------------


def test_the_numerical_error_is_relative_to_each_coefficient():
    """Cm is negative where a vehicle is stable: one sigma is not."""
    residuals = SimpleNamespace(flow=SimpleNamespace(time=np.array([3.0, 4.0])), tables=AeroCoefficients(
        np.array([1.6, 1.5]), np.array([0.02, 0.0]), np.array([-0.03, 0.01]), *np.zeros((2, 2))
    ))  # fmt: skip
    units = numerical_error_units(residuals, SimpleNamespace(numerical=2e-4))
    np.testing.assert_array_equal(units.time, [3.0, 4.0])
    np.testing.assert_allclose(units.ca, [3.2e-4, 3.0e-4], rtol=1e-12)
    np.testing.assert_allclose(units.cn, [4e-6, 0.0], rtol=1e-12)
    np.testing.assert_allclose(units.cm, [6e-6, 2e-6], rtol=1e-12)


@pytest.mark.parametrize("knudsen", [1e-5, 0.5])
def test_the_databases_sigma_is_a_third_of_its_limits_times_the_scale(knudsen):
    """Node by node, of a database that is indexed by speed; that of CA is a fraction of CA itself."""
    database = load_database(family="MER", speed_per_mach=205.8)
    flow = flow_of(np.random.default_rng(2), knudsen)
    inputs = SimpleNamespace(forward_model=SimpleNamespace(database=database))
    units = database_units(inputs, SimpleNamespace(flow=flow), DiscrepancyPrior(scale=0.6))
    np.testing.assert_array_equal(units.time, TIME)
    for k in range(COUNT):
        at_node = (flow.mach[k], flow.knudsen[k])
        ca = float(database.lookup(*at_node, flow.alpha_total[k], flow.speed[k]).ca)
        limits = three_sigma("MER", *at_node, ca)
        for name in ("ca", "cn", "cm"):
            assert getattr(units, name)[k] == pytest.approx(0.2 * float(getattr(limits, name)), rel=1e-12)


def test_where_increments_apply_the_databases_sigma_is_that_of_the_remainder():
    """A quarter of the variance remains in one half of the flight, all of it in the other: half a sigma, and one."""
    flow = flow_of(np.random.default_rng(2))
    share, arguments = np.where(np.arange(COUNT) < 10, 0.25, 1.0), []
    stub = SimpleNamespace(mean=(), remainder=lambda *args: arguments.append(args) or share)
    plain = load_database(family="MER")
    units, learned = (
        database_units(
            SimpleNamespace(forward_model=SimpleNamespace(database=d)),
            SimpleNamespace(flow=flow),
            DiscrepancyPrior(1.0),
        )
        for d in (plain, replace(plain, increments=stub))
    )
    for name in ("ca", "cn", "cm"):
        expected = getattr(units, name) * np.where(np.arange(COUNT) < 10, 0.5, 1.0)
        np.testing.assert_allclose(getattr(learned, name), expected, rtol=1e-12)
    (values,) = arguments
    for value, expected in zip(values, (flow.mach, flow.knudsen, flow.alpha_total, plain.continuum_limit), strict=True):
        np.testing.assert_array_equal(value, expected)


def test_only_a_linear_table_has_angles_at_which_its_error_changes_slope():
    alpha, values = np.radians([0.0, 5.0, 20.0]), np.ones((2, 3))
    table = GridTable("mach", np.array([5.0, 20.0]), alpha, values, values, values)
    np.testing.assert_array_equal(interpolated_angles(table), alpha)
    assert interpolated_angles(replace(table, interpolation="pchip")).shape == (0,)
    assert interpolated_angles(phoenix_surrogate()).shape == (0,)


# --- modes -----------------------------------------------------------------------------------------------------------


class RecordingPrior:
    """Keeps the arguments of `angle_modes` by coefficient, and returns them as the modes."""

    def angle_modes(self, name, angle, information, table_angles):
        return {"name": name, "angle": angle, "information": information, "tables": table_angles}


def with_database(inputs, continuum="continuum", rarefied="rarefied"):
    model = inputs.forward_model
    return SimpleNamespace(
        driving=inputs.driving,
        forward_model=replace(model, database=SimpleNamespace(continuum=continuum, rarefied=rarefied)),
    )


def bin_noise(record, name, b):
    """Sigma of a bin's mean of independent samples."""
    total = 0.0
    for time, interval, noise in zip(record.time, record.interval, getattr(record, name), strict=True):
        if BINS.edges[b] < time - 0.5 * interval < BINS.edges[b + 1]:
            total += (noise * interval) ** 2
    return np.sqrt(total) / BINS.interval[b]


@pytest.mark.parametrize("begin", [0.0, 0.1])
def test_modes_are_those_of_the_information_of_each_bin(begin):
    """Squares of force and rate step over their variances, a quarter for each node of the bin, by hand.

    A bin that is not compared, or in which the driving IMU has no samples, has none; a rate step is compared where both
    of its bins are.
    """
    inputs, residuals, units = case_of(4)
    inputs.driving = driving_record(begin)
    modes = field_modes(with_database(inputs), BINS, residuals, RecordingPrior(), units)
    assert list(modes) == ["ca", "cn", "cm"]
    simpson = np.array([1.0, 4.0, 2.0, 4.0, 1.0]) / 12.0
    rising = simpson * np.arange(5) / 4.0
    for name, recorded in modes.items():
        assert recorded["name"] == name
        np.testing.assert_array_equal(recorded["angle"], residuals.flow.alpha_total[:-1])
        force, moment = coefficient_loads(inputs, residuals, name, units)
        expected = []
        for b in range(len(BINS.interval)):
            nodes = slice(4 * b, 4 * b + 5)
            sigma = bin_noise(inputs.driving, "force_noise", b)
            information = np.sum((simpson @ force[nodes] / BODY.mass) ** 2) / sigma**2 if sigma else 0.0
            if b + 1 < len(BINS.interval) and BINS.valid[b + 1]:
                following = slice(4 * b + 4, 4 * b + 9)
                impulse = BINS.interval[b] * rising @ moment[nodes]
                impulse = impulse + BINS.interval[b + 1] * rising[::-1] @ moment[following]
                sigma = np.sqrt(2.0) * bin_noise(inputs.driving, "rate_noise", b)
                information += np.sum(np.linalg.solve(INERTIA, impulse) ** 2) / sigma**2 if sigma else 0.0
            expected += [information / 4.0 if BINS.valid[b] else 0.0] * 4
        np.testing.assert_allclose(recorded["information"], expected, rtol=1e-9)
        assert (recorded["information"][0] > 0.0) == (begin == 0.0)
        # before the bin that is not compared there is a force, and no step that would show a pitching moment
        assert not recorded["information"][8:12].any()
        assert np.all((recorded["information"][4:8] > 0.0) == (name != "cm"))


def test_modes_are_linear_between_the_angles_of_the_tables():
    inputs, residuals, units = case_of(4)
    alpha, values = np.radians([0.0, 5.0, 20.0]), np.ones((2, 3))
    table = GridTable("knudsen", np.array([1e-2, 10.0]), alpha, values, values, values)
    modes = field_modes(with_database(inputs, rarefied=table), BINS, residuals, RecordingPrior(), units)
    for recorded in modes.values():
        continuum, rarefied = recorded["tables"]
        assert continuum.shape == (0,)
        np.testing.assert_array_equal(rarefied, alpha)


def test_without_air_no_mode_is_resolved():
    """The modes are those of the prior: some where the flight has information, none where it has none."""
    inputs, residuals, units = case_of(4)
    counts = []
    for factor in (1.0, 1e-9):
        flow = replace(residuals.flow, dynamic_pressure=factor * residuals.flow.dynamic_pressure)
        thin = SimpleNamespace(flow=flow, tables=residuals.tables)
        modes = field_modes(with_database(inputs), BINS, thin, DiscrepancyPrior(scale=1.0), units)
        counts.append([m.count for m in modes.values()])
    assert min(counts[0]) >= 1 and counts[1] == [0, 0, 0]


# --- the field in the state-space model ------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def field_model():
    """The shipped flight, a simulated one, with a database that errs, an asymmetry, and an uncertain centre of mass.

    About the step between its tables the errors of both are noise, within three sigmas of the density: with 5 % the
    stretch that is tested extends beyond.
    """
    changes = (
        "aerodynamics.coefficient_sigma=1.0", "atmosphere.density_sigma=0.05", "atmosphere.wind_sigma=10.0",
        "vehicle.mass_sigma=4.0", "vehicle.centre_of_mass_sigma=[0.001, 0.001, 0.001]",
        "aerodynamics.discrepancy.asymmetry_sigma=0.5",
    )  # fmt: skip
    case = load_case(Mission.load("builtin:practice_mer", changes))
    return linearize_at(case, smoothed_point(case.reconstruction))


@pytest.fixture(scope="module", params=["regime change", "largest dynamic pressure"])
def stretch(request, field_model):
    return stretch_of(field_model, first_bin(field_model, request.param))


@pytest.fixture(scope="module")
def dense(field_model, stretch):
    return dense_covariances(field_model, stretch)


def white_of(stretch):
    whiten = whitening_filter(stretch.model)
    return whiten, whiten(stretch.residuals[:, None], np.zeros((stretch.model.size, 1)))[:, 0]


def test_the_stretches_have_what_they_are_to_test(field_model, stretch, dense):
    """The field matters in them; one contains both regimes, whose errors are independent."""
    assert len(stretch.residuals) > 8 * STRETCH and field_model.jacobian.columns["field_cm"].stop > 30
    covariance, by_field, _ = dense
    forces = [stretch.model.row_start[k] + c for k in range(STRETCH) for c in range(3)]
    assert np.max(np.sqrt(np.diag(by_field)[forces] / np.diag(row_noise_of(stretch))[forces])) > 10.0
    change = bin_of_regime_change(field_model)
    if change in stretch.bins:
        k = int(np.flatnonzero(stretch.bins == change)[0])
        before, after = (slice(0, stretch.model.row_start[k - 1]), slice(stretch.model.row_start[k + 1], None))
        assert np.abs(by_field[before, after]).max() < 1e-60 < np.abs(covariance[before, after]).max()


def test_the_log_likelihood_is_that_of_the_dense_gaussian_process(stretch, dense):
    whiten, white = white_of(stretch)
    scale, lower = scaled_cholesky(dense[0])
    standardised = np.linalg.solve(lower, stretch.residuals / scale)
    log_determinant = 2.0 * np.sum(np.log(scale)) + 2.0 * np.sum(np.log(np.diag(lower)))
    assert whiten.log_determinant == pytest.approx(log_determinant, rel=1e-8)
    expected = -0.5 * standardised @ standardised - 0.5 * log_determinant
    assert whiten.log_likelihood(white) == pytest.approx(expected, rel=1e-8)


def test_the_posterior_of_the_field_is_that_of_the_dense_gaussian_process(field_model, stretch, dense):
    """Of every amplitude at every bin's end, relative to the largest of them."""
    whiten, white = white_of(stretch)
    _, states = smoothed_states(whiten, white, np.zeros(stretch.model.size))
    actual = np.concatenate([states[:, f] for f in field_model.nuisance.fields.values()], axis=1)
    covariance, _, of_amplitudes = dense
    weighted = refined_solution(covariance, stretch.residuals)
    expected = np.einsum("sjr,r->sj", of_amplitudes, weighted)
    assert np.abs(expected).max() > 0.1
    np.testing.assert_allclose(actual, expected, rtol=0.0, atol=1e-8 * np.abs(expected).max())
