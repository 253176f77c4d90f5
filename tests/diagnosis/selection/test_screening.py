"""Screening: one regression for each effect and place, the model's own effects marginalised, places refined."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from edl_filter.diagnosis.linear_model.effect_jacobian import EffectJacobian
from edl_filter.diagnosis.selection import screening
from edl_filter.diagnosis.selection.screening import (
    correlation,
    marginalize_model_effects,
    refine_places,
    scan_jacobians,
    screen,
    shortlist,
)
from edl_filter.effects.base import EffectInstance
from edl_filter.effects.registry import find_effect
from edl_filter.errors import InputError
from edl_filter.estimation.regression import regress
from edl_filter.mission.decision_settings import DecisionSettings

SETTINGS = DecisionSettings()
ROWS = 200


def identity(columns, initial_mean):
    """A whitening filter of rows that are white already."""
    return columns


def jacobian_of(name, places, columns, sigma):
    """Given columns of an effect."""
    instance = EffectInstance(find_effect(name), places)
    names = tuple(q.name for q in instance.effect.sizes)
    return EffectJacobian(instance, names, np.asarray(sigma), columns, np.zeros((2, len(names))))


def model_of(residuals, effects=()):
    return SimpleNamespace(
        residual_vector=residuals, initial_mean=np.zeros(2), settings=SETTINGS, effects=tuple(effects)
    )


# --- screen ---------------------------------------------------------------------------------------------------------


@settings(max_examples=20)
@given(st.integers(0, 1000))
def test_screening_is_one_regression_for_each_effect_and_place(seed):
    """The gain is the mean of the evidence over the places, the fit that at the best place."""
    rng = np.random.default_rng(seed)
    times = (60.0, 100.0, 140.0)
    onsets = [jacobian_of("remnant_torque", {"t0": t}, rng.normal(size=(ROWS, 3)), [0.1, 0.2, 0.3]) for t in times]
    mass = [jacobian_of("mass", {}, rng.normal(size=(ROWS, 1)), [0.5])]
    residuals = onsets[1].rows @ [0.1, -0.2, 0.2] + rng.normal(size=ROWS)
    results = screen(model_of(residuals), identity, [onsets, mass])
    fits = [regress(residuals, j.rows, j.sigma) for j in onsets]
    gains = np.array([f.gain for f in fits])
    best = int(np.argmax(gains))
    torque = results["remnant_torque", None]
    assert torque.gain == pytest.approx(np.log(np.mean(np.exp(gains - gains.max()))) + gains.max())
    assert torque.jacobian is onsets[best] and torque.instance.values["t0"] == times[best]
    np.testing.assert_allclose(torque.fit.estimate, fits[best].estimate)
    np.testing.assert_allclose(torque.explained, onsets[best].rows @ fits[best].estimate)
    sizes = [torque.instance.values[n] for n in onsets[best].names]
    np.testing.assert_allclose(sizes, fits[best].estimate)
    assert results["mass", None].gain == pytest.approx(regress(residuals, mass[0].rows, mass[0].sigma).gain)


def test_alternatives_are_the_next_places_with_dissimilar_columns():
    """Not one whose columns are nearly those of the best, nor one without a gain; two at most besides the best."""
    rng = np.random.default_rng(4)
    basis = np.linalg.qr(rng.normal(size=(ROWS, 5)))[0] * 30.0
    columns = {60.0: basis[:, 0], 70.0: basis[:, 0] + 0.3 * basis[:, 4], 100.0: basis[:, 1], 140.0: basis[:, 2],
               180.0: basis[:, 3], 200.0: basis[:, 4]}  # fmt: skip
    residuals = basis @ [1.0, 0.8, 0.6, 0.4, 0.0]
    jacobians = [
        jacobian_of("remnant_torque", {"t0": t0}, np.column_stack((c, np.zeros((ROWS, 2)))), np.ones(3))
        for t0, c in columns.items()
    ]
    result = screen(model_of(residuals), identity, [jacobians])["remnant_torque", None]
    assert result.instance.values["t0"] == 60.0
    assert [a.values["t0"] for a in result.alternatives] == [100.0, 140.0]
    assert SETTINGS.starting_places == 3


def test_nothing_to_screen():
    assert screen(model_of(np.zeros(ROWS)), identity, []) == {}


def test_an_effect_whose_hooks_fail_is_reported_or_raised(monkeypatch):
    def effect_jacobian(model, instance):
        if instance.name == "wind":
            raise InputError("no wind")
        return instance

    monkeypatch.setattr(screening, "scan_range", lambda model: (60.0, 8e3))
    monkeypatch.setattr(screening, "effect_jacobian", effect_jacobian)
    effects, failed = [EffectInstance(find_effect(n), {}) for n in ("wind", "mass")], {}
    by_effect = scan_jacobians(model_of(None), effects, 240.0, failed)
    assert [[i.name for i in group] for group in by_effect] == [["mass"]] and failed == {"wind": "no wind"}
    with pytest.raises(InputError, match="no wind"):
        scan_jacobians(model_of(None), effects, 240.0)


# --- effects of the model -------------------------------------------------------------------------------------------


def marginalized(patch, own_columns, sigma, fixed=False):
    """The whitening filter under which an effect of the model with given columns is marginalised."""
    instance = EffectInstance(find_effect("gyro_bias"), {}, fixed=fixed)
    jacobian = SimpleNamespace(rows=own_columns, initial_mean=np.zeros((2, own_columns.shape[1])), sigma=sigma)
    patch.setattr(screening, "effect_jacobian", lambda model, effect, names: jacobian)
    return marginalize_model_effects(model_of(None, [instance]), identity)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10_000), st.floats(-3.0, 3.0), st.floats(0.0, 1.0))
def test_gain_and_estimate_are_those_of_one_regression_on_both(seed, magnitude, similarity):
    """However large the columns of the model's own effects are, and however similar to those of the candidate."""
    rng = np.random.default_rng(seed)
    own, noise = rng.normal(size=(ROWS, 3)) * 10.0**magnitude, rng.normal(size=ROWS)
    candidate = similarity * own[:, :2] / 10.0**magnitude + (1.0 - similarity) * rng.normal(size=(ROWS, 2))
    y = own @ rng.normal(size=3) + candidate @ rng.normal(size=2) + noise
    own_sigma, sigma = np.array([0.5, 1.0, 2.0]), np.array([1.5, 0.7])
    with pytest.MonkeyPatch.context() as patch:
        whiten = marginalized(patch, own, own_sigma)
    initial_mean = np.zeros((2, 1))
    fit = regress(whiten(y[:, None], initial_mean)[:, 0], whiten(candidate, initial_mean), sigma)
    joint = regress(y, np.concatenate((own, candidate), axis=1), np.concatenate((own_sigma, sigma)))
    without_candidate = regress(y, own, own_sigma)
    scale = 1.0 + abs(joint.gain)
    assert fit.gain == pytest.approx(joint.gain - without_candidate.gain, abs=1e-7 * scale)
    np.testing.assert_allclose(fit.estimate, joint.estimate[3:], rtol=1e-5, atol=1e-7)
    deviation = np.sqrt(
        np.diag(joint.covariance[3:, 3:])
    )  # an element is as precise as its sigmas, not as its own size
    normalised = (c / np.outer(deviation, deviation) for c in (fit.covariance, joint.covariance[3:, 3:]))
    np.testing.assert_allclose(*normalised, rtol=1e-5, atol=1e-9)


def test_an_effect_similar_to_one_of_the_model_does_not_gain(monkeypatch):
    """Residuals that the model's own effect could explain, away from its best value, are no evidence for another."""
    rng = np.random.default_rng(1)
    own = rng.normal(size=(400, 1))
    y = 0.3 * own[:, 0] + rng.normal(size=400)
    similar = own + 0.1 * rng.normal(size=(400, 1))
    with_own_fixed = regress(y, similar, np.array([1.0]))
    whiten = marginalized(monkeypatch, own, np.array([1.0]))
    with_own_free = regress(
        whiten(y[:, None], np.zeros((2, 1)))[:, 0], whiten(similar, np.zeros((2, 1))), np.array([1.0])
    )
    assert with_own_fixed.gain > 10.0 and with_own_free.gain < 0.0


def test_without_free_effects_it_is_the_filter_itself(monkeypatch):
    assert marginalized(monkeypatch, np.ones((5, 3)), np.ones(3), fixed=True) is identity
    assert marginalize_model_effects(model_of(None), identity) is identity


# --- places ---------------------------------------------------------------------------------------------------------


def refined(monkeypatch, effect, start, evidence):
    """Places of an effect after refinement, where `evidence` is a function of its values."""
    model = SimpleNamespace(
        white_residuals=lambda whiten: np.zeros(3),
        bins=SimpleNamespace(edges=np.array([0.0, 250.0])),
        settings=SETTINGS,
    )

    def effect_jacobian(model, instance):
        names = [q.name for q in instance.effect.sizes]
        return SimpleNamespace(names=names, sigma=None, rows=instance.values, initial_mean=None)

    def fit(y, values, sigma):
        return SimpleNamespace(gain=evidence(values), estimate=np.array([1e-3]))

    monkeypatch.setattr(screening, "effect_jacobian", effect_jacobian)
    monkeypatch.setattr(screening, "regress", fit)
    return refine_places(model, EffectInstance(find_effect(effect), start), lambda rows, mean: rows).values


@pytest.mark.parametrize(("start", "peak", "expected"), [(18.0, 17.3, 17.3), (26.0, 28.0, 26.0), (10.0, 3.0, 10.0)])
def test_a_place_moves_to_the_largest_evidence_within_its_bounds(monkeypatch, start, peak, expected):
    values = refined(monkeypatch, "static_instability", {"M0": start}, lambda v: -((v["M0"] - peak) ** 2))
    assert values["M0"] == pytest.approx(expected, abs=0.2) and values["a"] == 1e-3


def test_an_effect_without_a_place_stays_as_it_is():
    instance = EffectInstance(find_effect("mass"), {})
    assert refine_places(None, instance, None) is instance


# --- shortlist and similarity ---------------------------------------------------------------------------------------


def test_the_shortlist_has_the_first_of_every_screening_once():
    def results(**gains):
        return {name: SimpleNamespace(gain=gain) for name, gain in gains.items()}

    first = results(a=9.0, b=8.0, c=7.0, d=6.0, e=5.0)
    second = results(a=1.0, b=-1.0, c=0.0, d=-2.0, e=3.0)
    assert shortlist([first], SETTINGS) == ["a", "b", "c", "d"]
    assert shortlist([first, second], SETTINGS) == ["a", "b", "c", "d", "e"]
    assert shortlist([second], SETTINGS) == ["e", "a"]  # those with a positive gain
    assert shortlist([first], SETTINGS.model_copy(update={"shortlist_size": 1})) == ["a"]
    assert shortlist([{}], SETTINGS) == []


def test_correlation():
    a, b = np.array([3.0, 4.0]), np.array([4.0, 3.0])
    assert correlation(a, b) == pytest.approx(24.0 / 25.0) and correlation(b, a) == correlation(a, b)
    assert correlation(a, -2.0 * a) == pytest.approx(1.0)
    assert correlation(a, np.zeros(2)) == 0.0
    assert correlation(a, np.array([3.0, 4.0, 0.0])) == 0.0  # about another path
