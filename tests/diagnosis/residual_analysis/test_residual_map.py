"""Normalised RMS of channels and constraints; cells of the residual map: which fail, and their numbers; regimes."""

from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import chi2, norm

from edl_filter.diagnosis.prediction.dead_reckoning import NODES_PER_BIN
from edl_filter.diagnosis.residual_analysis.residual_map import (
    CONSTRAINTS,
    _cell,
    channels,
    failing_cells,
    flow_regimes,
    model_rms,
    normalised_innovations,
    rms_by_channel,
    rms_by_constraint,
)
from edl_filter.mission.decision_settings import DecisionSettings

SETTINGS = DecisionSettings()
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
        fitted_noise_filter=3.0,
        white_residuals=lambda whiten: white,
        normalised_innovations=lambda whiten, white: whiten * white / sigma,
    )


def test_channels_are_force_moment_and_each_checking_imu(model):
    names = [name for name, _ in channels(model)]
    assert names[:6] == ["force_x", "force_y", "force_z", "moment_x", "moment_y", "moment_z"]
    assert names[6:] == [f"secondary_{kind}_{axis}" for kind in ("force", "rate") for axis in "xyz"]
    assert [unit for _, unit in channels(model)][::3] == ["m/s^2", "rad/s^2", "m/s^2", "rad/s"]


def test_innovations_are_those_at_the_fitted_noise(model):
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


def cell_of(normalised, sigma=0.02, database_sigma=None, settings=SETTINGS):
    sigma = np.full(len(normalised), sigma)
    span = (10.0, 20.0)
    return _cell("force_x", "Mach 25 to 15", span, np.asarray(normalised), sigma, "m/s^2", database_sigma, settings)


def test_cells_of_normal_numbers_do_not_fail():
    rng = np.random.default_rng(0)
    cells = [cell_of(rng.normal(size=n)) for n in (5, 20, 200, 2000) for _ in range(500)]
    # five sigmas of a mean square; of five numbers its distribution has a long tail
    assert np.mean([c.fails for c in cells[:500]]) < 0.02
    assert not any(c.fails for c in cells[1000:])


def test_numbers_of_a_cell():
    c = cell_of([1.0, 2.0, 3.0, -2.0])
    assert c.rms == pytest.approx(np.sqrt(18.0 / 4.0)) and c.bias == pytest.approx(1.0) and c.count == 4
    assert c.autocorrelation == pytest.approx((2.0 + 6.0 - 6.0) / 3.0 / 4.5)
    assert c.physical == pytest.approx(0.02 * np.sqrt(18.0 / 4.0 - 1.0))
    assert np.isnan(c.over_database_sigma) and "database" not in c.sentence
    c = cell_of([1.0, 2.0, 3.0, -2.0], database_sigma=np.array([0.03, 0.04, 0.05, 0.0]))
    assert c.over_database_sigma == pytest.approx(0.02 * np.sqrt(3.5) / np.sqrt(0.0050 / 4.0))
    assert c.sentence.startswith("force_x in Mach 25 to 15 (10 to 20 s): 2.12 times its sigma, 0.037 m/s^2 beyond")


def test_a_constraint_and_an_excess_of_small_sigmas_only_in_words():
    """Samples with a large sigma may be so small that nothing is beyond the noise in the unit of the channel."""
    values, sigma = np.array([3.0, 3.0, 0.1, 0.1]), np.array([0.01, 0.01, 1.0, 1.0])
    c = _cell("rest_gravity", CONSTRAINTS, (344.0, 344.0), values, sigma, "m/s^2", np.ones(4), SETTINGS)
    assert c.physical == 0.0 and c.sentence == "rest_gravity (344 s): 2.12 times its sigma."


def test_noise_below_the_stated_noise_has_nothing_beyond_it():
    c = cell_of([0.5, -0.5, 0.5, -0.5])
    assert c.physical == 0.0 and not c.fails
    assert c.autocorrelation == pytest.approx(-1.0)


@pytest.mark.parametrize("n", [50, 400])
def test_a_cell_fails_beyond_chance_only(n):
    """The limit is the quantile of the chi-square distribution of n degrees of freedom."""
    limit = np.sqrt(chi2.isf(norm.sf(SETTINGS.cell_fails_sigmas), n) / n)
    alternating = np.where(np.arange(n) % 2, 1.0, -1.0)
    assert not cell_of(0.99 * limit * alternating).fails
    assert cell_of(1.01 * limit * alternating).fails


def test_a_negligible_excess_does_not_fail():
    """Of a million numbers 5 % more are far beyond chance."""
    alternating = np.where(np.arange(1_000_000) % 2, 1.0, -1.0)
    assert not cell_of(1.05 * alternating).fails and cell_of(1.15 * alternating).fails
    assert cell_of(1.05 * alternating, settings=DecisionSettings(cell_minimum_rms=1.0)).fails


def test_failing_cells_are_sorted():
    base = cell_of(np.ones(10))
    cells = [replace(base, channel=str(r), rms=r, fails=f) for r, f in ((2.0, True), (9.0, False), (5.0, True))]
    assert [c.rms for c in failing_cells(cells)] == [5.0, 2.0]
    assert failing_cells([]) == []


def model_of_flow(flow, continuum_limit=1e-3):
    inputs = SimpleNamespace(forward_model=SimpleNamespace(database=SimpleNamespace(continuum_limit=continuum_limit)))
    return SimpleNamespace(residuals=SimpleNamespace(flow=flow), inputs=inputs)


@pytest.mark.parametrize(("limit", "transitional"), [(1e-3, [1, 2, 3]), (5e-3, [1])])
def test_flow_is_transitional_above_the_continuum_limit_of_the_database(limit, transitional):
    """The columns of the map are those of the tables that the database uses, whatever limit the mission states."""
    knudsen = np.append(np.repeat([20.0, 8e-3, 4e-3, 2e-3, 5e-4], NODES_PER_BIN), 5e-4)
    flow = SimpleNamespace(mach=np.full(len(knudsen), 20.0), knudsen=knudsen)
    regimes = dict(flow_regimes(model_of_flow(flow, limit)))
    assert list(regimes) == ["free-molecular flow", "transitional flow", "Mach 25 to 15"]
    assert np.flatnonzero(regimes["transitional flow"]).tolist() == transitional


def test_every_bin_is_in_one_regime():
    """From free-molecular flow to Mach 4: regimes do not overlap and cover all bins; empty ones are left out."""
    count = 400
    knudsen = np.repeat(np.geomspace(100.0, 1e-9, count), NODES_PER_BIN)
    mach = np.repeat(np.linspace(30.0, 4.0, count), NODES_PER_BIN)
    flow = SimpleNamespace(mach=np.append(mach, 4.0), knudsen=np.append(knudsen, 1e-9))
    regimes = flow_regimes(model_of_flow(flow))
    np.testing.assert_array_equal(np.sum([inside for _, inside in regimes], axis=0), np.ones(count))
    names = [name for name, _ in regimes]
    assert names == ["free-molecular flow", "transitional flow", "Mach 25 to 15", "Mach 15 to 5", "Mach 5 to 3.5"]
    for (_, before), (_, after) in pairwise(regimes):
        assert np.flatnonzero(before).max() < np.flatnonzero(after).min()
    for name, inside in regimes[2:]:
        high, low = (float(x) for x in name.removeprefix("Mach ").split(" to "))
        middle = mach[NODES_PER_BIN // 2 :: NODES_PER_BIN]
        assert np.all((middle[inside] < high) & (middle[inside] >= low))
