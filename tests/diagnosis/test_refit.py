"""Refits on a simulated flight: along a bent valley, and where nothing may be believed."""

import numpy as np
import pytest

from edl_filter import Mission
from edl_filter.diagnosis import refit as refit_module
from edl_filter.diagnosis.case import load_case
from edl_filter.diagnosis.refit import refit
from edl_filter.diagnosis.rounds import linearise
from edl_filter.effects import Active
from edl_filter.effects.catalogue import effect_named
from edl_filter.simulation import Scenario, simulate

TRUTH = {"sx": 1.2e-3, "sy": -4e-4, "sz": 7e-4}


@pytest.fixture(scope="module")
def linear(tmp_path_factory):
    """A spinning vehicle whose gyros have a scale error, compared with a model that has it at half its size."""
    scale = effect_named("gyro_scale")
    path = tmp_path_factory.mktemp("refit") / "flight.h5"
    simulate(Scenario.load("builtin:mer"), [Active(scale, TRUTH)], 11).write(path)
    half = Active(scale, {name: 0.5 * value for name, value in TRUTH.items()})
    return linearise(load_case(Mission.load("builtin:practice_mer", [f"telemetry.path={path}"]), (half,)), rounds=2)


def test_what_the_entry_state_can_make_up_for_is_found_all_the_same(linear):
    """About x the scale turns the roll by degrees, and the roll at the start makes up for it: both have to move."""
    found = refit(linear, linear.ground.effects, linear.soft, moving=True)
    values, at = found.parameters("gyro_scale"), found.point.start
    off = {name: (values[name][0] - true) / values[name][1] for name, true in TRUTH.items()}
    assert max(map(abs, off.values())) < 4.0, off
    assert values["sx"][1] < 0.1 * TRUTH["sx"]
    assert abs(at.minus(linear.ground.point.start)[8]) + abs(at.minus(linear.ground.point.start)[6]) > 1e-4


def test_at_its_end_it_stays(linear):
    """A second refit that begins where the first ended goes nowhere."""
    first = refit(linear, linear.ground.effects, linear.soft, moving=True)
    again = refit(linear, first.effects, linear.soft, moving=True)
    for name, (value, sigma) in first.parameters("gyro_scale").items():
        assert again.parameters("gyro_scale")[name][0] == pytest.approx(value, abs=0.5 * sigma)


def test_a_point_beyond_belief_is_not_gone_to(linear, monkeypatch):
    """Then the effects stay as they are, and nothing raises."""
    monkeypatch.setattr(refit_module, "told", lambda *_, **__: None)
    found = refit(linear, linear.ground.effects, linear.soft, moving=True)
    assert found.effects == linear.ground.effects
    assert np.isfinite(found.evidence)


def test_a_wave_found_upside_down_is_told_upright(linear):
    """With its signature and covariance: what it explains stays the same, and the two agree with the values told."""
    wave = effect_named("density_wave")
    start = {"A": 0.01, "L": 12e3, "phase": 1.0}
    upside = {"A": -0.01, "L": 12e3, "phase": 1.0 + np.pi}
    up, down = (
        refit(linear, (*linear.ground.effects, Active(wave, values)), linear.plain, steps=1)
        for values in (start, upside)
    )
    assert up.parameters("density_wave")["A"][0] >= 0.0
    i, k = (up.names.index(("density_wave", name)) for name in ("A", "phase"))
    for name, (value, sigma) in up.parameters("density_wave").items():
        assert down.parameters("density_wave")[name] == pytest.approx((value, sigma), rel=1e-3)
    np.testing.assert_allclose(down.signature[:, i], up.signature[:, i], atol=1e-4 * np.abs(up.signature[:, i]).max())
    assert down.covariance[i, k] == pytest.approx(up.covariance[i, k], rel=1e-2)
