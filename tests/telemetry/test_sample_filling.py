"""Samples that stand for lost ones: from which side they are filled, and the rotation across a gap."""

from dataclasses import replace

import numpy as np
import pytest

from edl_filter import rotations
from edl_filter.navigation.noise import IDENTITY, sample_attitudes
from edl_filter.telemetry.flight_file import read_flight_file
from edl_filter.telemetry.sample_checks import CheckSettings
from edl_filter.telemetry.sample_repair import repaired


def alone(telemetry):
    return replace(telemetry, checking=())


def test_filled_stretches_are_not_extrapolated_from_each_other(builtin_flight):
    """Many short stretches where a reading begins to vary: no filled value is far outside the range of the readings."""
    telemetry = alone(read_flight_file(builtin_flight))
    force = telemetry.driving.specific_force.copy()
    force[:300] = 0.0
    force[:600][np.random.default_rng(3).random(600) < 0.5] = np.nan
    record = replace(telemetry.driving, specific_force=force)
    filled = repaired(replace(telemetry, driving=record), parachute=252.75).driving
    low, high = np.nanmin(force, axis=0), np.nanmax(force, axis=0)
    assert np.isfinite(filled.specific_force).all()
    assert np.all((filled.specific_force >= 2 * low - high) & (filled.specific_force <= 2 * high - low))
    assert np.all(filled.force_fill_sigma < 10.0 * (high - low))


@pytest.mark.parametrize(("begin", "end"), [(283.0, 303.0), (206.0, 226.0)], ids=["after", "before"])
def test_a_stretch_on_one_side_of_the_parachute_is_filled_from_that_side(begin, end, builtin_flight):
    """Another process acts on the other side, and the shock between them is part of neither."""
    telemetry, deployment = alone(read_flight_file(builtin_flight)), 252.75
    record = telemetry.driving
    lost = (record.time > begin) & (record.time <= end)
    beyond = record.time < deployment + 1.5 if begin > deployment else record.time > deployment - 0.5
    fills = []
    for factor in (1.0, 3.0):  # the other side and the shock, changed
        force, rate = record.specific_force.copy(), record.angular_rate.copy()
        for values in (force, rate):
            values[beyond] *= factor
            values[lost] = np.nan
        changed = replace(record, specific_force=force, angular_rate=rate)
        outcome = repaired(replace(telemetry, driving=changed), CheckSettings(enabled=False), deployment).driving
        fills.append(
            np.hstack([v[lost] for v in (outcome.specific_force, outcome.angular_rate,
                                         outcome.force_fill_sigma, outcome.rate_fill_sigma)])
        )  # fmt: skip
    np.testing.assert_array_equal(*fills)
    deceleration = np.abs(record.specific_force[lost, 0]).mean()
    assert np.abs(fills[0][:, 0] - record.specific_force[lost, 0]).mean() < 0.1 * deceleration


@pytest.mark.slow
def test_the_rotation_across_a_gap_has_the_coning_of_an_oscillation_whose_phase_is_lost(builtin_flight):
    """The rates' sums alone have 8 times the square of the error about the spin axis that is stated here."""
    telemetry = alone(read_flight_file(builtin_flight))
    record, squares = telemetry.driving, []
    for begin in (60.0, 75.0, 140.0, 150.0, 160.0, 170.0, 180.0, 190.0, 200.0, 210.0):
        lost = (record.time > begin) & (record.time <= begin + 20.0)
        values = {k: np.where(lost[:, None], np.nan, getattr(record, k)) for k in ("specific_force", "angular_rate")}
        gap = replace(telemetry, driving=replace(record, **values))
        filled = repaired(gap, CheckSettings(enabled=False), 252.75).driving
        dt = record.interval[lost]
        middle, end = sample_attitudes(dt, filled.angular_rate[lost], IDENTITY)
        true = sample_attitudes(dt, record.angular_rate[lost], IDENTITY)[1]
        error = rotations.to_rotation_vector(rotations.multiply(rotations.conjugate(end), true))
        to_end = rotations.to_matrix(rotations.multiply(rotations.conjugate(end), middle))
        sigma = np.hypot(filled.rate_fill_sigma[lost], filled.rate_noise[lost, None]) * dt[:, None]
        covariance = np.einsum("nij,nj,nkj->ik", to_end, sigma**2, to_end)
        squares.append(error**2 / np.diag(covariance))
    assert np.max(squares) < 9.0
    assert np.all(np.mean(squares, axis=0) < 2.0)
