"""Readings of a checking IMU, the correction of interpolated readings, and the order of the residual vector."""

from dataclasses import fields, replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from edl_filter.diagnosis.linear_model.flight_case import flight_case
from edl_filter.diagnosis.linear_model.linearization import linearize
from edl_filter.diagnosis.prediction.dead_reckoning import path_nodes
from edl_filter.diagnosis.prediction.interpolation_error import InterpolationErrors, PredictedRotation, node_errors
from edl_filter.diagnosis.prediction.predicted_readings import (
    FINE_NODES_PER_BIN,
    accelerations_at_nodes,
    fine_rule_sigma,
    flow_at,
    predict,
)
from edl_filter.diagnosis.prediction.residuals import (
    Residuals,
    RowIndex,
    _checking_residuals,
    bin_readings,
    compute_residuals,
    correct_interpolation,
)
from edl_filter.diagnosis.prediction.time_bins import TimeBins
from edl_filter.effects import EffectInstance
from edl_filter.effects.registry import find_effect
from edl_filter.imu_model.sensor_errors import SensorErrors
from edl_filter.navigation.increments import effective_samples
from edl_filter.telemetry.record import ImuRecord


def bins_of(edges):
    edges = np.asarray(edges, float)
    return TimeBins(edges, np.ones(len(edges) - 1, bool))


def test_a_checking_imu_is_predicted_at_the_place_of_each_sample():
    """A body that turns at a constant rate: centripetal acceleration alone; the record begins with a place at zero."""
    rng = np.random.default_rng(4)
    n, dt, rate = 40, 0.125, np.array([0.3, -0.2, 0.5])
    time, force = dt * np.arange(1, n + 1), rng.normal(size=(n, 3))
    place = np.where((time <= 2.0)[:, None], 0.0, [0.4, -0.3, 0.2])
    rates, zeros = np.tile(rate, (n, 1)), np.zeros(n)
    record = ImuRecord(
        "second", time, np.full(n, dt), force + np.cross(rate, np.cross(rate, place)), rates, place, zeros, zeros,
        zeros, zeros.astype(bool), zeros.astype(bool), (time > 2.0).astype(int), ("register", "second"),
        zeros.astype(int), ("test",), (SensorErrors(), SensorErrors()),
    )  # fmt: skip
    driving = replace(record, specific_force=force, position=np.zeros((n, 3)), unit=zeros.astype(int))
    bins = bins_of(np.append(0.0, time))
    residuals = _checking_residuals(record, bins, effective_samples(driving), rates, force, rates)
    np.testing.assert_allclose(residuals, 0.0, atol=1e-12)


def test_an_error_that_both_imus_have_is_no_difference_between_them():
    """The driving IMU is corrected by its own error; a checking one by its own less that of the driving IMU."""
    values, checking = np.arange(12.0).reshape(4, 3), 10.0 + np.arange(12.0).reshape(4, 3)
    error, further = np.full((4, 3), 0.25), np.full((4, 3), 0.5)
    residuals = Residuals(
        **{f.name: None for f in fields(Residuals)}
        | {
            "force": values, "checking_force": (checking, checking), "rate_step": values[1:],
            "checking_rate": (checking, checking),
        }
    )  # fmt: skip
    both = (error, error, error + further)
    at_nodes = np.zeros((4 * FINE_NODES_PER_BIN + 1, 3))  # of no reading
    corrected = correct_interpolation(residuals, InterpolationErrors(both, both, (0.0,) * 3, at_nodes, at_nodes))
    np.testing.assert_array_equal(corrected.force, values - 0.25)
    np.testing.assert_array_equal(corrected.checking_force[0], checking)
    np.testing.assert_array_equal(corrected.checking_force[1], checking - 0.5)
    np.testing.assert_array_equal(corrected.rate_step, values[1:])  # a constant error has no step
    np.testing.assert_array_equal(corrected.checking_rate[0], checking)
    np.testing.assert_array_equal(corrected.checking_rate[1], checking + 0.5)
    growing = (values, values, values)
    np.testing.assert_array_equal(
        correct_interpolation(residuals, InterpolationErrors(both, growing, (0.0,) * 3, at_nodes, at_nodes)).rate_step,
        values[1:] + np.diff(values, axis=0),
    )
    assert correct_interpolation(residuals, None) is residuals
    with pytest.raises(ValueError, match="shorter"):
        correct_interpolation(  # an IMU without its error
            residuals, InterpolationErrors((error, error), both, (0.0, 0.0), at_nodes, at_nodes)
        )


# --- quadrature of the predictions -----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def model(practice_06):
    """The shipped flight, linearised about its reconstruction."""
    return linearize(flight_case(practice_06))


def test_the_predictions_are_those_of_a_much_finer_rule(model):
    """The angle of attack passes nodes of the tables, so that four nodes in a bin are too few for the moments."""
    residuals, bins, path = model.residuals, model.bins, model.residuals.path
    _, mean_rate = bin_readings(bins, model.inputs.problem.samples, (path.force, path.rate))
    first = compute_residuals(replace(model.reference, interpolation_errors=None), model.inputs)
    _, acceleration = accelerations_at_nodes(model.inputs.forward_model, first.flow, first.tables)
    errors = node_errors(PredictedRotation(first.nodes.time, acceleration), bins, 128)
    flow = flow_at(model.inputs.forward_model, path_nodes(path, bins, mean_rate, 128, errors))
    exact = predict(model.inputs.forward_model, bins, flow)
    predicted = residuals.predicted_force, residuals.predicted_rate_step
    for value, reference, correction, lateral in zip(
        predicted, exact, residuals.quadrature_correction, (slice(0, 1), slice(1, 3)), strict=True
    ):
        error = (value - reference)[:, lateral]
        by_nodes = error - correction[:, lateral]
        rms, sigma = np.sqrt(np.mean(error**2)), np.sqrt(np.mean(fine_rule_sigma(correction)[:, lateral] ** 2))
        assert 0.5 * sigma < rms < 1.3 * sigma
        assert rms < 0.12 * np.sqrt(np.mean(by_nodes**2))


def test_the_correction_is_kept_where_an_effect_changes_the_model_alone(model):
    effect = EffectInstance(find_effect("axial_force_scale"), {"k": 0.1})
    changed = model.with_effects([effect])
    by_nodes = predict(changed.inputs.forward_model, model.bins, model.residuals.flow, model.residuals.tables)
    before, after = model.residuals, changed.residuals
    np.testing.assert_array_equal(after.predicted_force, by_nodes[0] + before.quadrature_correction[0])
    np.testing.assert_array_equal(after.predicted_rate_step, by_nodes[1] + before.quadrature_correction[1])
    assert np.abs(after.predicted_force - before.predicted_force).max() > 1.0


# --- rows as one vector ----------------------------------------------------------------------------------------------


def random_index(rng, bins, imus):
    """Rows in any order, some channels not used; two constraints of one and three components among them."""
    width = 6 + 6 * imus
    used = rng.random((bins, width)) < 0.7
    used[-1, 3:6] = False  # no step of the rate follows the last bin
    count = int(used.sum()) + 4
    constraints = (slice(0, 1), slice(count - 3, count))
    rows = np.full((bins, width), -1)
    rows[used] = rng.permutation(np.arange(1, count - 3))
    return RowIndex(rows, constraints, count, np.zeros(0), np.zeros(count), np.zeros(count, int))


def random_residuals(rng, bins, imus):
    """Residuals of the bins; those of the constraints in addition."""
    return SimpleNamespace(
        force=rng.normal(size=(bins, 3)),
        rate_step=rng.normal(size=(bins - 1, 3)),
        checking_force=tuple(rng.normal(size=(imus, bins, 3))),
        checking_rate=tuple(rng.normal(size=(imus, bins, 3))),
        constraints=(rng.normal(size=1), rng.normal(size=3)),
    )


def stacked(index, residuals, imus, constraints=True):
    """Twin of `stack`, number by number; channels are force, rate step, then force and rate of each checking IMU."""
    out = np.zeros(index.count)
    for b in range(len(index.bin_rows)):
        channels = [*residuals.force[b], *(residuals.rate_step[b] if b < len(residuals.rate_step) else [np.nan] * 3)]
        for i in range(imus):
            channels += [*residuals.checking_force[i][b], *residuals.checking_rate[i][b]]
        for row, value in zip(index.bin_rows[b], channels, strict=False):
            if row >= 0:
                out[row] = value
    if constraints:
        out[0], out[-3:] = residuals.constraints[0][0], residuals.constraints[1]
    return out


@given(st.integers(0, 10_000), st.integers(1, 6), st.integers(0, 3))
def test_each_residual_is_in_its_own_row(seed, bins, imus):
    rng = np.random.default_rng(seed)
    index, residuals = random_index(rng, bins, imus), random_residuals(rng, bins, imus)
    np.testing.assert_array_equal(index.stack(residuals), stacked(index, residuals, imus))
    changes = index.stack_predictions(
        residuals.force, residuals.rate_step, residuals.checking_force, residuals.checking_rate
    )
    np.testing.assert_array_equal(changes, stacked(index, residuals, imus, constraints=False))


@given(st.integers(0, 10_000), st.integers(1, 6), st.integers(0, 3))
def test_a_prediction_has_no_rows_of_checking_imus_and_constraints(seed, bins, imus):
    rng = np.random.default_rng(seed)
    index, residuals = random_index(rng, bins, imus), random_residuals(rng, bins, imus)
    expected = stacked(index, residuals, 0, constraints=False)
    np.testing.assert_array_equal(index.stack_predictions(residuals.force, residuals.rate_step), expected)


def test_residuals_of_another_number_of_constraints_are_refused():
    rng = np.random.default_rng(0)
    index, residuals = random_index(rng, 3, 1), random_residuals(rng, 3, 1)
    with pytest.raises(ValueError):
        index.stack(SimpleNamespace(**(vars(residuals) | {"constraints": residuals.constraints[:1]})))


@given(st.integers(0, 10_000), st.integers(1, 8))
def test_the_step_of_a_bin_is_the_one_that_has_its_rows(seed, bins):
    """Steps without rows, and with rows of constraints, lie between those of the bins; some bins are not compared."""
    rng = np.random.default_rng(seed)
    row_start, rows, expected = [0], np.full((bins, 6), -1), []
    for b in range(bins):
        for width in (*([0] * rng.integers(0, 3)), *([2] * rng.integers(0, 2))):
            row_start.append(row_start[-1] + width)
        begin = int(rng.choice([0, 0, 1, 3, 6]))  # the first channel that is used; 6: none
        rows[b, begin:] = row_start[-1] + np.arange(6 - begin)
        if begin == 0:
            expected.append((b, len(row_start) - 1))
        row_start.append(row_start[-1] + 6 - begin)
    count = row_start[-1]
    index = RowIndex(rows, (), count, np.zeros(0), np.zeros(count), np.zeros(count, int))
    used, steps = index.step_of_bins(np.array(row_start))
    assert list(zip(used.tolist(), steps.tolist(), strict=True)) == expected
