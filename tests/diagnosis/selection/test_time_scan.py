"""The times of effects from which a fit starts: over the flight, and over an interval of excess variance."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from late_torque import TORQUE, with_torque

from edl_filter.diagnosis.selection import time_scan as module
from edl_filter.diagnosis.selection.map_fit import fit_map
from edl_filter.diagnosis.selection.outer_loop import iterate_to_convergence
from edl_filter.diagnosis.selection.time_scan import most_likely, scan_times
from edl_filter.effects import EffectInstance
from edl_filter.effects.registry import find_effect
from edl_filter.mission.decision_settings import DecisionSettings


@pytest.mark.slow
def test_a_scan_corrects_a_time_in_a_local_maximum(late_model):
    """Gauss-Newton ends before the true time: only the bins within the derivative's step change the likelihood."""
    whiten = late_model.fitted_noise_filter
    assert not late_model.excess_variance.is_zero
    local = fit_map(late_model, late_model.effects, whiten, moving=True)
    assert abs(local.effects[0].values["t0"] - TORQUE["t0"]) > 0.3
    (scanned,) = scan_times(late_model, late_model.effects, whiten)
    assert scanned.values["t0"] == pytest.approx(TORQUE["t0"], abs=0.11)
    assert scanned.values["t1"] == late_model.effects[0].values["t1"]
    for name in ("Cm", "Cn"):  # the sizes are estimated anew at each time of the flight
        assert scanned.values[name] == pytest.approx(TORQUE[name], rel=0.01)


@pytest.mark.slow
def test_a_fit_with_a_scan_converges_at_the_true_time(late_model):
    _, model, fit = iterate_to_convergence(late_model.case)
    value, sigma = fit.parameters(("remnant_torque", None))["t0"]
    assert model.holds and abs(value - TORQUE["t0"]) < 3.0 * sigma < 0.2


@pytest.mark.parametrize("true", [110.0, 113.3, 120.0, 130.0])
def test_a_time_is_scanned_as_far_before_its_value_as_after_it(true, monkeypatch):
    """To both ends of `noise_piece_s`, 10 s, where the likelihood has its maximum."""
    monkeypatch.setattr(module, "_screened", lambda *_: [])
    monkeypatch.setattr(
        module, "most_likely", lambda model, trials, _: min(trials, key=lambda t: abs(t[0].values["t0"] - true))
    )
    start = EffectInstance(find_effect("remnant_torque"), TORQUE | {"t0": 120.0})
    (scanned,) = scan_times(SimpleNamespace(settings=DecisionSettings()), (start,), None)
    assert scanned.values["t0"] == pytest.approx(true, abs=1e-9)


def test_a_scan_covers_the_interval_whose_excess_variance_covers_the_misfit(late_model):
    """Seven seconds late, with the true sizes: without a scan the fit stays there."""
    model = with_torque(late_model, t0=127.3)
    assert model.excess_variance.share > 0.01
    local = fit_map(model, model.effects, model.fitted_noise_filter, steps=3)
    assert abs(local.effects[0].values["t0"] - TORQUE["t0"]) > 5.0
    (scanned,) = scan_times(model, model.effects, model.fitted_noise_filter)
    assert scanned.values["t0"] == pytest.approx(TORQUE["t0"], abs=0.11)


def test_a_scan_finds_a_time_elsewhere_in_the_flight(late_model):
    """From a maximum of the screening fifty seconds off, whose sizes are a hundredth of the true ones."""
    model = with_torque(late_model, t0=70.0, Cm=-4e-6, Cn=8e-6)
    (scanned,) = scan_times(model, model.effects, model.fitted_noise_filter)
    assert scanned.values["t0"] == pytest.approx(TORQUE["t0"], abs=0.11)


@pytest.mark.slow
def test_a_fit_whose_time_is_elsewhere_in_the_flight_converges_at_the_true_one(late_model):
    case = with_torque(late_model, t0=70.0, Cm=-4e-6, Cn=8e-6).case
    _, model, fit = iterate_to_convergence(case, iterations=2)
    value, sigma = fit.parameters(("remnant_torque", None))["t0"]
    assert model.holds and abs(value - TORQUE["t0"]) < 3.0 * sigma < 0.2
    for name in ("Cm", "Cn"):
        value, sigma = fit.parameters(("remnant_torque", None))[name]
        assert abs(value - TORQUE[name]) < 3.0 * sigma < 0.1 * abs(TORQUE[name])


def test_the_most_likely_effects_are_those_of_the_largest_likelihood(late_model):
    """As each evaluated alone, with more of them than are whitened together; of equal ones the first."""
    whiten, (late,) = late_model.fitted_noise_filter, late_model.effects
    times = np.linspace(119.0, 122.0, 70)
    candidates = [(replace(late, values=late.values | {"t0": float(t)}),) for t in times]
    likelihoods = [
        whiten.log_likelihood(late_model.with_effects(c).white_residuals(whiten))
        + late_model.case.log_abs_det_jacobian(c)
        for c in candidates
    ]
    assert most_likely(late_model, candidates, whiten) is candidates[int(np.argmax(likelihoods))]
    assert most_likely(late_model, candidates[::-1], whiten) == candidates[int(np.argmax(likelihoods))]
    assert most_likely(late_model, [candidates[3], candidates[3]], whiten) is candidates[3]


def test_fixed_times_are_not_scanned(late_model):
    """Nor effects without a time, and a first time does not pass the last one."""
    (late,) = late_model.effects
    fixed = replace(late, fixed=True)
    assert scan_times(late_model, (fixed,), late_model.fitted_noise_filter) == (fixed,)
    scale = EffectInstance(find_effect("axial_force_scale"), {"k": 0.01})
    assert scan_times(late_model, (fixed, scale), late_model.fitted_noise_filter) == (fixed, scale)
    short = replace(late, values=late.values | {"t0": 120.9, "t1": 121.0})
    (scanned,) = scan_times(late_model, (short,), late_model.fitted_noise_filter)
    assert scanned.values["t0"] < scanned.values["t1"]


def test_a_time_is_screened_where_the_effect_has_sizes_and_the_time_more_than_one_place(late_model):
    (late,), whiten = late_model.effects, late_model.fitted_noise_filter
    (time,) = (q for q in late.effect.parameters if q.name == "t0")
    for places, candidates in ((0, 0), (1, 0), (2, 1)):
        screened = replace(time, scan=places)
        assert len(module._screened(late_model, (late,), late.key, screened, whiten)) == candidates
    without_sizes = SimpleNamespace(key=late.key, fitted=(time,))
    assert module._screened(late_model, (without_sizes,), late.key, time, whiten) == []
