"""Screening: one regression for each effect and place, the model's own effects marginalised, places refined."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from edl_filter.diagnosis.linear_model.effect_jacobian import EffectJacobian
from edl_filter.diagnosis.residual_analysis.unexplained import Remainder
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
from edl_filter.effects.parameters import Parameter
from edl_filter.effects.registry import find_effect
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
        residual_vector=residuals, initial_mean=np.zeros(2), settings=SETTINGS, effects=tuple(effects),
        white_residuals=lambda whiten: whiten(residuals[:, None], np.zeros((2, 1)))[:, 0],
    )  # fmt: skip


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
    (results,) = screen(model_of(residuals), [identity], [*onsets, *mass])
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
    result = screen(model_of(residuals), [identity], jacobians)[0]["remnant_torque", None]
    assert result.instance.values["t0"] == 60.0
    assert [a.values["t0"] for a in result.alternatives] == [100.0, 140.0]
    assert SETTINGS.starting_places == 3


def test_information_is_that_of_the_most_informative_place_of_each_column():
    """Whatever the gains are; squares of lengths 3, 4 and of 12, 5."""
    first, second = np.zeros((ROWS, 3)), np.zeros((ROWS, 3))
    first[:2, 0], first[0, 1] = [3.0, 4.0], 1.0
    second[0, 0], second[:2, 1], second[5, 2] = 2.0, [12.0, 5.0], 0.5
    places = [jacobian_of("remnant_torque", {"t0": 60.0 + k}, x, np.ones(3)) for k, x in enumerate((first, second))]
    result = screen(model_of(np.zeros(ROWS)), [identity], places)[0]["remnant_torque", None]
    np.testing.assert_array_equal(result.information, [25.0, 169.0, 0.25])


def test_each_alternative_is_dissimilar_to_those_before_it_too():
    """In the order of their gains; the third place resembles the second."""
    basis = np.linalg.qr(np.random.default_rng(4).normal(size=(ROWS, 4)))[0] * 30.0
    columns = {60.0: basis[:, 0], 90.0: basis[:, 1], 100.0: basis[:, 1] + 0.3 * basis[:, 3], 140.0: basis[:, 2]}
    jacobians = [
        jacobian_of("remnant_torque", {"t0": t0}, np.column_stack((c, np.zeros((ROWS, 2)))), np.ones(3))
        for t0, c in columns.items()
    ]
    result = screen(model_of(basis @ [1.0, 0.8, 0.5, 0.0]), [identity], jacobians)[0]["remnant_torque", None]
    assert result.instance.values["t0"] == 60.0
    assert [a.values["t0"] for a in result.alternatives] == [90.0, 140.0]


# --- places of an oscillation ---------------------------------------------------------------------------------------


def place(name, kind, low=-np.inf, high=np.inf, scan=10, default=0.0):
    return Parameter(name, "", "", 1.0, kind, low=low, high=high, scan=scan, default=default)


def remainder(frequency, t0=100.0, t1=200.0):
    return Remainder("moment_y", t0, t1, 5.0, 1.0, "N m", frequency, {}, (), "")


def oscillation(low=0.1, high=2.0, times=2, scan=10):
    """An effect with a frequency and times; the first place is none of them."""
    begin_and_end = [place(n, "time") for n in ("t0", "t1")][:times]
    return SimpleNamespace(
        places=[place("M0", "mach"), place("f", "frequency", low, high, scan, default=0.7), *begin_and_end]
    )


def test_a_frequency_is_scanned_about_the_spectral_line_to_the_resolution_of_the_flight():
    """Steps of an eighth of the inverse of the last time, 200 s; to the inverse of the duration, 100 s."""
    places = screening._places_of_line(oscillation(), remainder(0.5))
    assert places.keys() == {"f", "t0", "t1"}
    np.testing.assert_allclose(places["f"], 0.5 + np.arange(-16, 17) / 1600.0, rtol=1e-12)
    assert (places["t0"], places["t1"]) == ([100.0], [200.0])
    assert screening._places_of_line(oscillation(times=1), remainder(0.5)).keys() == {"f", "t0"}


def test_a_width_between_two_steps_is_covered():
    f = screening._places_of_line(oscillation(), remainder(0.5, 90.0, 200.0))["f"]
    np.testing.assert_allclose([min(f), max(f)], [0.5 - 15 / 1600.0, 0.5 + 15 / 1600.0])  # 1 / 110 s are 14.5 steps


def test_frequencies_are_within_their_bounds():
    f = screening._places_of_line(oscillation(0.498125, 0.501875), remainder(0.5))["f"]
    np.testing.assert_allclose(f, 0.5 + np.arange(-3, 4) / 1600.0, rtol=1e-12)
    assert screening._places_of_line(oscillation(1.0, 2.0), remainder(0.5))["f"] == [0.7]


@pytest.mark.parametrize(
    ("effect", "line"),
    [
        (oscillation(), None),
        (oscillation(), remainder(None)),
        (oscillation(scan=1), remainder(0.5)),
        (SimpleNamespace(places=[place("t0", "time")]), remainder(0.5)),
    ],
)
def test_without_a_line_or_a_frequency_to_scan_no_places_are_stated(effect, line):
    assert screening._places_of_line(effect, line) == {}


def test_a_time_that_is_not_scanned_is_not_moved_to_the_remainder():
    effect = oscillation(times=1)
    effect.places.insert(2, place("end", "time", scan=1))
    assert screening._places_of_line(effect, remainder(0.5)).keys() == {"f", "t0"}


def test_nothing_to_screen():
    assert screen(model_of(np.zeros(ROWS)), [identity, identity], []) == [{}, {}]


def test_an_effect_whose_hooks_fail_is_not_asked_for_again(monkeypatch):
    """Its message is kept, or the error is raised, by `effect_jacobians`."""
    asked = []

    def effect_jacobians(model, instances, failed):
        asked.extend(a.name for a, names in instances if names is None)
        failed |= {a.label: "no torque" for a, _ in instances if a.name == "remnant_torque"}
        return [a for a, _ in instances if a.label not in failed]

    monkeypatch.setattr(screening, "scan_range", lambda model: (60.0, 8e3))
    monkeypatch.setattr(screening, "abrupt_changes", lambda model: [])
    monkeypatch.setattr(screening, "effect_jacobians", effect_jacobians)
    monkeypatch.setattr(screening, "_BATCH_COLUMNS", 9)
    effects, failed = [EffectInstance(find_effect(n), {}) for n in ("remnant_torque", "mass")], {}
    jacobians = scan_jacobians(model_of(None), effects, 240.0, failed)
    assert [i.name for i in jacobians] == ["mass"] and failed == {"remnant_torque": "no torque"}
    assert asked == ["remnant_torque"] * 3 + ["mass"]  # three columns each: one batch of forty places


def test_an_effect_that_begins_at_a_time_is_screened_at_abrupt_changes(monkeypatch):
    """Besides its scan of 40 times; the changes of a model are computed for such effects alone."""
    monkeypatch.setattr(screening, "scan_range", lambda model: (60.0, 8e3))
    monkeypatch.setattr(screening, "effect_jacobians", lambda model, instances, failed: [a for a, _ in instances])
    monkeypatch.setattr(screening, "abrupt_changes", lambda model: [130.05, 77.0, 300.0])
    torque, mass = (EffectInstance(find_effect(n), {}) for n in ("remnant_torque", "mass"))
    times = [i.values["t0"] for i in scan_jacobians(model_of(None), [torque], 240.0)]
    assert times == pytest.approx(sorted([*np.linspace(60.0, 240.0, 40), 77.0, 130.05]))
    monkeypatch.setattr(screening, "abrupt_changes", None)
    assert len(list(scan_jacobians(model_of(None), [mass], 240.0))) == 1


@pytest.mark.parametrize("columns", [1, 4, 64])
def test_batches_of_any_size_have_the_same_result(monkeypatch, columns):
    """The places of an effect may be in several batches; each filter has its own result."""
    rng = np.random.default_rng(3)
    jacobians = [
        jacobian_of("remnant_torque", {"t0": 60.0 + t}, rng.normal(size=(ROWS, 3)), [0.1, 0.2, 0.3]) for t in range(9)
    ]
    jacobians.append(jacobian_of("mass", {}, rng.normal(size=(ROWS, 1)), [0.5]))
    model, filters = model_of(5.0 * rng.normal(size=ROWS)), [identity, lambda rows, mean: 0.5 * rows]
    at_once = screen(model, filters, jacobians)
    asked = []
    monkeypatch.setattr(screening, "_BATCH_COLUMNS", columns)
    in_batches = screen(model, filters, (asked.append(j) or j for j in jacobians))
    assert len(asked) == len(jacobians)
    for expected, results in zip(at_once, in_batches, strict=True):
        assert results.keys() == expected.keys()
        for key, result in results.items():
            assert result.instance.values == pytest.approx(expected[key].instance.values)
            assert result.gain == pytest.approx(expected[key].gain)
            places = [[a.values["t0"] for a in r.alternatives] for r in (result, expected[key])]
            assert places[0] == places[1]
            np.testing.assert_array_equal(result.rows, expected[key].rows)
            np.testing.assert_allclose(result.information, expected[key].information)
            assert result.rows.base is None


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


def test_several_effects_of_the_model_are_marginalised_together(monkeypatch):
    """Rows have the covariance of unit noise and of both effects, which the filter turns into that of unit noise."""
    rng = np.random.default_rng(5)
    columns = {"gyro_bias": rng.normal(size=(6, 3)), "mass": rng.normal(size=(6, 1))}
    sigma = {"gyro_bias": np.array([0.5, 1.0, 2.0]), "mass": np.array([3.0])}

    def effect_jacobian(model, instance, names):
        x = columns[instance.name]
        return SimpleNamespace(rows=x, initial_mean=np.zeros((2, x.shape[1])), sigma=sigma[instance.name])

    monkeypatch.setattr(screening, "effect_jacobian", effect_jacobian)
    effects = [EffectInstance(find_effect(name), {}) for name in columns]
    whiten = marginalize_model_effects(model_of(None, effects), identity)
    covariance = np.eye(6) + sum((columns[n] * sigma[n] ** 2) @ columns[n].T for n in columns)
    root = whiten(np.eye(6), np.zeros((2, 6)))
    np.testing.assert_allclose(root @ covariance @ root.T, np.eye(6), atol=1e-10)


def test_without_free_effects_it_is_the_filter_itself(monkeypatch):
    assert marginalized(monkeypatch, np.ones((5, 3)), np.ones(3), fixed=True) is identity
    assert marginalize_model_effects(model_of(None), identity) is identity


# --- places ---------------------------------------------------------------------------------------------------------


def refined(monkeypatch, effect, start, evidence, refinements=SETTINGS.place_refinements):
    """Places of an effect after refinement, where `evidence` is a function of its values."""
    model = SimpleNamespace(
        white_residuals=lambda whiten: np.zeros(3),
        bins=SimpleNamespace(edges=np.array([0.0, 250.0])),
        settings=SETTINGS.model_copy(update={"place_refinements": refinements}),
    )

    def effect_jacobian(model, instance):
        names = [q.name for q in instance.effect.sizes]
        return SimpleNamespace(names=names, sigma=None, rows=instance.values, initial_mean=None)

    def fit(y, values, sigma):
        sizes = find_effect(effect).sizes
        return SimpleNamespace(gain=evidence(values), estimate=np.full(len(sizes), 1e-3))

    monkeypatch.setattr(screening, "effect_jacobian", effect_jacobian)
    monkeypatch.setattr(screening, "regress", fit)
    return refine_places(model, EffectInstance(find_effect(effect), start), lambda rows, mean: rows).values


@pytest.mark.parametrize(("start", "peak", "expected"), [(18.0, 17.3, 17.3), (26.0, 28.0, 26.0), (10.0, 3.0, 10.0)])
def test_a_place_moves_to_the_largest_evidence_within_its_bounds(monkeypatch, start, peak, expected):
    values = refined(monkeypatch, "static_instability", {"M0": start}, lambda v: -((v["M0"] - peak) ** 2))
    assert values["M0"] == pytest.approx(expected, abs=0.2) and values["a"] == 1e-3


#: Change of a length of 12 km by a step of the wave number, of 27 between those of 25 and 8 km.
WAVE_STEP = 12e3**2 * (1.0 / 8e3 - 1.0 / 25e3) / 27.0


@pytest.mark.parametrize(
    ("effect", "start", "steps"),
    [
        ("static_instability", {"M0": 18.0}, {"M0": 4.0}),  # of four steps between the bounds 10 and 26
        ("density_wave", {"L": 12e3, "phase": 1.0}, {"L": WAVE_STEP, "phase": np.pi / 4.0}),  # a circle closes
        ("wind", {"h_lo": 5e3, "h_hi": 25e3}, {"h_lo": 4e3, "h_hi": 4e3}),
        ("remnant_torque", {"t0": 100.0}, {"t0": 250.0 / 39.0}),  # of the flight
    ],
)
def test_the_first_steps_are_half_the_spacing_of_the_scan_to_both_sides(monkeypatch, effect, start, steps):
    """Up, and where that does not help down; two refinements that find nothing halve the step."""
    tried = []

    def evidence(values):
        tried.append({name: round(values[name] - start[name], 9) for name in start})
        return -len(tried)

    assert {n: v for n, v in refined(monkeypatch, effect, start, evidence, 2).items() if n in start} == start
    zero = dict.fromkeys(start, 0.0)
    expected = [zero] + [
        zero | {name: round(sign * step * share, 9)} for share in (0.5, 0.25) for name, step in steps.items()
        for sign in (1.0, -1.0)
    ]  # fmt: skip
    assert tried == expected


def test_places_on_their_bounds_are_tried(monkeypatch):
    for start, bound in ((24.0, 26.0), (12.0, 10.0)):
        values = refined(monkeypatch, "static_instability", {"M0": start}, lambda v, b=bound: -abs(v["M0"] - b), 1)
        assert values["M0"] == bound


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
    assert correlation(1e-3 * a, 1e-3 * b) == pytest.approx(24.0 / 25.0)
    assert correlation(a, np.zeros(2)) == 0.0
    assert correlation(a, np.array([3.0, 4.0, 0.0])) == 0.0  # about another path
