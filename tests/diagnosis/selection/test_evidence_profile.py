"""Evidence of an effect along one of its places."""

from types import SimpleNamespace

import numpy as np
import pytest

from edl_filter.diagnosis.linear_model.effect_jacobian import EffectJacobian
from edl_filter.diagnosis.selection import evidence_profile as module
from edl_filter.diagnosis.selection.evidence_profile import evidence_profile
from edl_filter.effects.base import EffectInstance
from edl_filter.effects.registry import find_effect
from edl_filter.errors import InputError
from edl_filter.estimation.regression import regress
from edl_filter.mission.decision_settings import DecisionSettings

TIME = np.linspace(50.0, 250.0, 400)
SIGMA = np.array([0.2, 0.2, 0.2])


def torque_rows(t0):
    """White columns of a torque about each axis that begins at `t0`."""
    rows = np.zeros((len(TIME), 3))
    for axis in range(3):
        rows[axis::3, axis] = 20.0 * (TIME[axis::3] >= t0)
    return rows


@pytest.fixture
def model(monkeypatch):
    """A flight on which a torque about y begins at 130 s."""
    y = torque_rows(130.0) @ [0.0, 0.1, 0.0] + np.random.default_rng(1).normal(size=len(TIME))

    def jacobian(of_model, instance):
        rows = torque_rows(instance.values["t0"])
        return EffectJacobian(instance, ("Cl", "Cm", "Cn"), SIGMA, rows, np.zeros((2, 3)))

    monkeypatch.setattr(module, "effect_jacobian", jacobian)
    monkeypatch.setattr(module, "scan_range", lambda of_model: (60.0, 5e3))
    monkeypatch.setattr(module, "marginalize_model_effects", lambda of_model, whiten: whiten)
    return SimpleNamespace(
        effects=(), fitted_noise_filter=lambda rows, mean: rows, white_residuals=lambda whiten: y,
        bins=SimpleNamespace(edges=np.array([50.0, 150.0, 240.0])), settings=DecisionSettings(),
    )  # fmt: skip


def test_the_profile_is_a_regression_at_every_value_and_largest_at_the_onset(model):
    times = [70.0, 110.0, 130.0, 131.0, 180.0]
    gains = evidence_profile(model, "remnant_torque", "t0", times[::-1])
    assert gains["t0"].values.tolist() == times and gains.name == "remnant_torque"
    assert gains.attrs["units"] == "nats" and gains["t0"].attrs["units"] == "s"
    y = model.white_residuals(None)
    for t0, gain in zip(times, gains.values, strict=True):
        assert gain == pytest.approx(regress(y, torque_rows(t0), SIGMA).gain, abs=1e-9)
    assert float(gains.idxmax()) == 130.0


def test_the_catalogues_grid_is_from_the_first_air_to_the_end_of_the_comparison(model):
    gains = evidence_profile(model, "remnant_torque")
    scan = next(q.scan for q in find_effect("remnant_torque").parameters if q.name == "t0")
    np.testing.assert_allclose(gains["t0"], np.linspace(60.0, 240.0, scan))
    assert abs(float(gains.idxmax()) - 130.0) <= 180.0 / (scan - 1)


def test_an_effect_of_the_model_and_a_place_that_it_has_not_are_refused(model):
    model.effects = (EffectInstance(find_effect("remnant_torque"), {"t0": 130.0}),)
    with pytest.raises(InputError, match="found remnant_torque in the model already"):
        evidence_profile(model, "remnant_torque")
    model.effects = ()
    with pytest.raises(InputError, match=r"found t9 of remnant_torque; accepted: t0"):
        evidence_profile(model, "remnant_torque", "t9")


def test_values_beyond_the_other_bound_are_not_evaluated(model, monkeypatch):
    """A wind's lower bound above its upper one is no wind."""
    evaluated = []

    def jacobian(of_model, instance):
        evaluated.append((instance.values["h_lo"], instance.values["h_hi"]))
        return SimpleNamespace(rows=np.zeros((3, 2)), initial_mean=None, sigma=np.ones(2))

    monkeypatch.setattr(module, "effect_jacobian", jacobian)
    model.white_residuals = lambda whiten: np.zeros(3)
    evidence_profile(model, "wind", "h_lo", [6e3, 3e4])
    assert evaluated and all(low < high for low, high in evaluated)
    with pytest.raises(InputError, match="scan: found no value of h_lo that is in order"):
        evidence_profile(model, "wind", "h_lo", [1e6])
