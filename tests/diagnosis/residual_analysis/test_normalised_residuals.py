"""Normalised RMS of channels and constraints."""

from types import SimpleNamespace

import numpy as np
import pytest

from edl_filter.diagnosis.residual_analysis.normalised_residuals import (
    channels,
    model_rms,
    normalised_innovations,
    rms_by_channel,
    rms_by_constraint,
)

#: Rows of four bins: the last channel of the checking IMU is used once, its first one never.
BIN_ROWS = np.arange(48).reshape(4, 12)
BIN_ROWS[:, 6] = -1
BIN_ROWS[1:, 11] = -1


@pytest.fixture
def model():
    """A model with one checking IMU, an altimeter of two samples, and a landing site of three components."""
    names = ("altimeter", "landing", "altimeter")
    white, sigma = np.random.default_rng(1).normal(size=53), np.linspace(1.0, 2.0, 53)
    return SimpleNamespace(
        inputs=SimpleNamespace(
            checking=[SimpleNamespace(name="secondary")],
            problem=SimpleNamespace(constraints=[SimpleNamespace(name=n) for n in names]),
        ),
        index=SimpleNamespace(bin_rows=BIN_ROWS, constraint_rows=(slice(48, 49), slice(49, 52), slice(52, 53))),
        fitted_noise_filter=SimpleNamespace(innovations=lambda rows: 3.0 * rows),
        white_residuals=lambda whiten: white,
        stated_noise_filter=SimpleNamespace(innovation_sigma=sigma),
    )


def test_channels_are_force_moment_and_each_checking_imu(model):
    names = [name for name, _ in channels(model)]
    assert names[:6] == ["force_x", "force_y", "force_z", "moment_x", "moment_y", "moment_z"]
    assert names[6:] == [f"secondary_{kind}_{axis}" for kind in ("force", "rate") for axis in "xyz"]
    assert [unit for _, unit in channels(model)][::3] == ["m/s^2", "rad/s^2", "m/s^2", "rad/s"]


def test_innovations_of_the_fitted_noise_are_divided_by_the_stated_sigma(model):
    expected = 3.0 * np.random.default_rng(1).normal(size=53) / np.linspace(1.0, 2.0, 53)
    np.testing.assert_allclose(normalised_innovations(model), expected)


def test_rms_is_over_the_rows_that_are_used(model):
    values = np.arange(53.0)
    by_channel = rms_by_channel(model, values)
    assert by_channel["force_y"] == pytest.approx(np.sqrt(np.mean(np.square([1.0, 13.0, 25.0, 37.0]))))
    assert by_channel["secondary_rate_z"] == 11.0 and np.isnan(by_channel["secondary_force_x"])
    by_constraint = rms_by_constraint(model, values)
    assert by_constraint == {
        "altimeter": pytest.approx(np.sqrt(0.5 * (48.0**2 + 52.0**2))),
        "landing": pytest.approx(np.sqrt((49.0**2 + 50.0**2 + 51.0**2) / 3.0)),
    }
    normalised = normalised_innovations(model)
    of_model = model_rms(model)
    assert of_model.keys() == by_channel.keys() | by_constraint.keys()
    assert of_model["landing"] == rms_by_constraint(model, normalised)["landing"]
    assert of_model["moment_x"] == rms_by_channel(model, normalised)["moment_x"]
