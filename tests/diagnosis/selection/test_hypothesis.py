"""One hypothesis: which of its fits counts, over which model, and whether it is fitted about its own reconstruction.

The fits themselves are those of `map_fit`; here they are constructed, with evidences that a person can follow.
"""

from dataclasses import dataclass, field, replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from edl_filter.diagnosis.noise.variance_components import ExcessVariance
from edl_filter.diagnosis.selection import hypothesis as module
from edl_filter.diagnosis.selection.hypothesis import (
    Hypothesis,
    fit_hypothesis,
    relinearize_with_effect,
    with_gain_where_model_holds,
)
from edl_filter.diagnosis.selection.map_fit import NullModelFit
from edl_filter.effects.base import EffectInstance
from edl_filter.effects.registry import find_effect
from edl_filter.estimation.regression import held_out_gain
from edl_filter.mission.decision_settings import DecisionSettings

SETTINGS = DecisionSettings()
ROWS = 40
#: Share of rows with excess variance: more than a model that holds has, less than a weak effect leaves.
LESS_EXCESS = 0.5 * (SETTINGS.holds_share + 0.5 * SETTINGS.alternative_progress)
#: Penalty of the noise of the model without the effect: of its variances, 3, and of their colour; that of the variances
#: that an effect leaves is 3. At the stated noise there is none.
PENALTY, OWN_PENALTY = 5.0, 3.0
TORQUE, MASS = find_effect("remnant_torque"), find_effect("mass")
KEY = ("mass", None)
#: The smoothed reconstruction: no nuisance parameter has absorbed anything.
FIRST_POINT = SimpleNamespace(bin_states=None)


class Identity:
    """A whitening filter whose innovations have unit variance."""

    innovation_sigma = np.ones(ROWS)

    def innovations(self, white):
        return white

    def log_likelihood(self, white):
        return -0.5 * float(white @ white)


@dataclass(frozen=True)
class Null:
    """The model without the effect, less the penalty of its noise."""

    evidence: float = -100.0 - PENALTY
    log_likelihood: float = -90.0 - PENALTY
    white_log_likelihood: float = -90.0
    holding_log_likelihood: float = 0.0
    excess_share: float = 0.5

    @property
    def misfit(self):
        return self.holding_log_likelihood - self.white_log_likelihood

    def explained_share(self, white_log_likelihood):
        return (white_log_likelihood + 90.0) / 90.0  # with white excess variance there is no penalty


@dataclass(frozen=True)
class Fit:
    """A fit of the effect."""

    evidence: float
    excess: float = 0.5  # share of rows with excess variance that it leaves, by moments
    effects: tuple = (EffectInstance(MASS, {"k": 0.1}),)
    point: object = field(default_factory=lambda: FIRST_POINT)
    names: tuple = ((KEY, "k"),)
    columns: np.ndarray = field(default_factory=lambda: np.ones((ROWS, 1)))
    white: np.ndarray = field(default_factory=lambda: np.zeros(ROWS))
    sigma: np.ndarray = field(default_factory=lambda: np.array([1.0]))

    @property
    def residual_vector(self):
        return self.excess

    initial_mean = np.zeros(1)


def excess_of(share):
    significant = np.arange(ROWS) < round(share * ROWS)
    return ExcessVariance(significant.astype(float), significant, penalty=OWN_PENALTY * bool(share))


@pytest.fixture
def flight(monkeypatch):
    return constructed_flight(monkeypatch)


def constructed_flight(monkeypatch):
    """A case and a failing model; `fits` are what `fit_map` returns in turn, `left` the excess that is left."""
    filters = {"stated": Identity(), "fitted": Identity(), "own": Identity()}
    model = SimpleNamespace(
        holds=False, excess_variance=excess_of(0.5), noise_penalty=PENALTY, failing_excess="excess",
        point=FIRST_POINT,
        stated_noise_filter=filters["stated"], fitted_noise_filter=filters["fitted"],
        index=SimpleNamespace(time=np.linspace(0.0, 200.0, ROWS)), settings=SETTINGS,
        white_residuals=lambda whiten: np.zeros(ROWS), release=lambda: None,
        normalised_innovations=lambda whiten, white: whiten.innovations(white) / 2.0,
    )  # fmt: skip
    case = SimpleNamespace(
        settings=SETTINGS, effects=(), mission="mission", log_abs_det_jacobian=lambda effects: 0.0
    )  # fmt: skip
    flight = SimpleNamespace(case=case, model=model, filters=filters, fits=[], fitted=[], left=0.0)

    def fit_map(of_model, effects, whiten, steps=None, moving=False):
        flight.fitted.append((effects, next(n for n, f in filters.items() if f is whiten), moving))
        return flight.fits.pop(0)

    monkeypatch.setattr(module, "fit_map", fit_map)
    monkeypatch.setattr(module, "moment_estimate", lambda whiten, index, share, mean, settings: excess_of(share))
    monkeypatch.setattr(
        module, "estimate_variance_components", lambda *_: (excess_of(flight.left), filters["own"])
    )  # fmt: skip
    monkeypatch.setattr(module, "refine_places", lambda model, instance, whiten: instance)
    return flight


def screened(instance, gain=50.0, alternatives=()):
    return SimpleNamespace(instance=instance, gain=gain, alternatives=alternatives), "screening filter"


def hypothesis_at(noise, flight, fit, null=None, key=KEY):
    """A hypothesis at the noise of the model without it, or at the stated noise."""
    penalty = {"fitted": flight.model.noise_penalty, "stated": 0.0}[noise]
    null = Null() if null is None else null
    return module._hypothesis(key, fit, flight.filters[noise], penalty, False, null, flight.case, flight.model)


def hypothesis_of(flight, fit, null, **changes):
    return replace(hypothesis_at("fitted", flight, fit, null), **changes)


MASS_START = EffectInstance(MASS, {"k": 0.0})


def test_gains_are_over_the_model_without_the_effect(flight):
    """The residuals before are those after, plus what the sizes explain; rows of 1 explain a constant of 0.1 sigmas."""
    h = hypothesis_of(flight, Fit(-80.0), Null())
    assert h.gain == 20.0 and h.explained_share == 0.0 and h.own_noise_evidence == -np.inf
    np.testing.assert_array_equal(h.explained, 0.1)
    np.testing.assert_array_equal(h.normalised, 0.0)
    without_information = hypothesis_of(flight, Fit(-80.0, columns=np.zeros((ROWS, 1))), Null())
    assert without_information.score_gain == pytest.approx(90.0)  # the likelihood of zeros, 0, over that of the null
    moved = h.with_reference(Null(evidence=-95.0 - PENALTY, log_likelihood=-82.0 - PENALTY))
    assert (moved.gain, moved.score_gain) == (15.0, pytest.approx(h.score_gain - 8.0))
    back = moved.with_reference(Null())
    assert (back.gain, back.score_gain) == (h.gain, pytest.approx(h.score_gain))


def test_only_the_sizes_of_the_effect_itself_explain(flight):
    """A place, and sizes of another effect in the model, are nuisance parameters of the comparison."""
    torque = EffectInstance(TORQUE, {"t0": 100.0, "t1": np.inf, "Cl": 0.0, "Cm": 0.3, "Cn": 0.0})
    key, columns = torque.key, np.random.default_rng(1).normal(size=(ROWS, 3))
    names = ((KEY, "k"), (key, "t0"), (key, "Cm"))
    fit = Fit(-80.0, effects=(*Fit(0.0).effects, torque), names=names, columns=columns, sigma=np.ones(3))
    h = hypothesis_at("fitted", flight, fit, key=key)
    np.testing.assert_allclose(h.explained, 0.3 * columns[:, 2])
    flight.case.log_abs_det_jacobian = lambda effects: 7.0  # of readings divided by a scale
    scaled = hypothesis_at("fitted", flight, fit, key=key)
    assert scaled.score_gain == pytest.approx(h.score_gain + 7.0)
    white = np.random.default_rng(2).normal(size=ROWS) + columns[:, 2]  # what is left is correlated with the column
    h = hypothesis_at("fitted", flight, replace(fit, white=white), key=key)
    before, x, time = white + 0.3 * columns[:, 2], columns[:, [2]], flight.model.index.time
    held_out = held_out_gain(before, x, np.ones(1), time, SETTINGS.held_out_block_s, SETTINGS.held_out_folds)
    assert h.score_gain == pytest.approx(held_out - 0.5 * before @ before + 7.0 + 90.0)


def test_innovations_are_normalised_as_those_of_the_model(flight):
    white = np.arange(float(ROWS))
    np.testing.assert_array_equal(hypothesis_of(flight, Fit(-80.0, white=white), Null()).normalised, white / 2.0)


@pytest.mark.parametrize(("share", "at_floor"), [(0.0, True), (0.05, False), (0.5, False)])
def test_where_the_model_holds_the_most_probable_place_of_the_first_start_counts(flight, monkeypatch, share, at_floor):
    flight.model.holds, flight.model.excess_variance = True, excess_of(share)
    times = [EffectInstance(TORQUE, {"t0": t, "t1": np.inf, "Cm": 0.2}) for t in (100.0, 150.0, 200.0)]
    evidence = {100.0: -60.0, 150.0: -40.0, 200.0: 0.0}
    columns = np.random.default_rng(4).normal(size=(ROWS, 2))  # of the size, then of the place, which explains nothing
    white, filters = columns[:, 0] + np.random.default_rng(5).normal(size=ROWS), []

    def fit_linear(model, instance, whiten, null):
        filters.append((whiten, null))
        names, sigma = ((times[0].key, "Cm"), (times[0].key, "t0")), np.ones(2)
        return Fit(evidence[instance.values["t0"]], 0.5, (instance,), "", names, columns, white, sigma)

    monkeypatch.setattr(module, "fit_linear", fit_linear)
    starts = [screened(times[0], 50.0, (times[1],)), (screened(times[2])[0], "another filter")]
    h = fit_hypothesis(flight.case, flight.model, starts, Null(evidence=-100.0))
    assert h.instance is times[1] and h.gain == 60.0 and h.at_floor == at_floor
    assert set(filters) == {("screening filter", -100.0)}
    np.testing.assert_allclose(h.explained, 0.2 * columns[:, 0])
    before, x, time = white + 0.2 * columns[:, 0], columns[:, [0]], flight.model.index.time
    held_out = held_out_gain(before, x, np.ones(1), time, SETTINGS.held_out_block_s, SETTINGS.held_out_folds)
    assert h.score_gain == pytest.approx(held_out)


def test_a_fit_that_leaves_much_excess_is_not_fitted_at_its_own_noise(flight):
    flight.fits = [Fit(-80.0, excess=0.5), Fit(-300.0)]
    h = fit_hypothesis(flight.case, flight.model, [screened(MASS_START)], Null())
    assert [noise for _, noise, _ in flight.fitted] == ["fitted", "stated"]
    assert h.gain == 20.0 and not h.at_floor
    assert h.own_noise_evidence == -80.0 - PENALTY  # at the noise of the model without it, whose penalty it pays
    assert h.stated_noise_fit.evidence == -300.0


@pytest.mark.parametrize(
    ("states", "evidence", "moves"),
    [(np.zeros(1), -400.0, True), (np.zeros(1), -190.0, False), (np.zeros(1), -190.5, True), (None, -400.0, False)],
)
def test_the_point_moves_with_an_effect_that_nuisance_parameters_have_absorbed_there(flight, states, evidence, moves):
    """With these held, the effect at its true size is less probable than none; the better of both fits counts."""
    flight.model.point = SimpleNamespace(bin_states=states)
    held, moved = Fit(evidence, point=flight.model.point), Fit(-20.0, point="moved")
    flight.fits = [held, *([moved] if moves else []), Fit(-500.0)]
    h = fit_hypothesis(flight.case, flight.model, [screened(MASS_START)], Null())
    expected = (
        [("fitted", False), ("fitted", True), ("stated", True)] if moves else [("fitted", False), ("stated", False)]
    )
    assert [(noise, moving) for _, noise, moving in flight.fitted] == expected
    assert h.fit is (moved if moves else held)
    flight.fits, flight.fitted = [replace(held, evidence=-300.0), replace(moved, evidence=-310.0), Fit(-500.0)], []
    if moves:  # the chord iteration of the point may lose
        assert fit_hypothesis(flight.case, flight.model, [screened(MASS_START)], Null()).fit.evidence == -300.0


def test_a_fit_that_solves_the_excess_counts_at_the_noise_that_it_leaves(flight):
    flight.fits, flight.left = [Fit(-80.0, excess=0.0), Fit(-20.0)], 0.0
    h = fit_hypothesis(flight.case, flight.model, [screened(MASS_START)], Null())
    assert [noise for _, noise, _ in flight.fitted] == ["fitted", "own"]
    assert h.at_floor and h.gain == 80.0 + PENALTY and h.own_noise_evidence == -20.0


def test_the_gain_stays_that_at_the_noise_without_it_if_excess_is_left(flight):
    """Promising by moments, but the likelihood needs excess variance again: its larger evidence does not count."""
    flight.fits, flight.left = [Fit(-80.0, excess=0.0), Fit(-20.0)], 0.4
    h = fit_hypothesis(flight.case, flight.model, [screened(MASS_START)], Null())
    assert not h.at_floor and h.gain == 20.0
    assert h.own_noise_evidence == -20.0 - OWN_PENALTY


def test_equal_places_and_unlikely_starts_are_fitted_once(flight):
    times = [EffectInstance(TORQUE, {"t0": t, "t1": np.inf, "Cm": 0.0}) for t in (100.0, 100.3, 100.7, 60.0)]
    starts = [screened(times[0], 50.0, (times[1],)), screened(times[2], 20.0), screened(times[3], -1.0)]
    fit = Fit(-80.0, effects=(replace(times[0], values=times[0].values | {"Cm": 1.0}),), names=())
    flight.fits = [replace(fit, evidence=e) for e in (-80.0, -85.0, -70.0, -75.0)]
    h = fit_hypothesis(flight.case, flight.model, starts, Null())
    assert [(effects[0].values["t0"], noise) for effects, noise, _ in flight.fitted] == [
        (100.0, "fitted"), (100.0, "stated"), (100.7, "fitted"), (100.0, "stated")
    ]  # fmt: skip
    assert h.gain == 30.0  # the best of the fits at the fitted noise


def test_a_place_that_solves_the_excess_ends_the_search(flight):
    """The fits before it are not compared; after it nothing is fitted from another start."""
    times = [EffectInstance(TORQUE, {"t0": t, "t1": np.inf, "Cm": 0.0}) for t in (100.0, 140.0, 180.0)]
    solved = Fit(-80.0, excess=0.0, effects=(times[1],), names=())
    flight.fits = [Fit(-20.0, effects=(times[0],), names=()), solved, replace(solved, evidence=-10.0)]
    starts = [screened(times[0], 50.0, (times[1],)), screened(times[2], 40.0)]
    h = fit_hypothesis(flight.case, flight.model, starts, Null())
    assert [(effects[0].values["t0"], noise) for effects, noise, _ in flight.fitted] == [
        (100.0, "fitted"), (140.0, "fitted"), (140.0, "own")
    ]  # fmt: skip
    assert h.at_floor and h.gain == 90.0 + PENALTY


def test_the_fit_at_the_stated_noise_starts_at_the_most_probable_place(flight):
    times = [EffectInstance(TORQUE, {"t0": t, "t1": np.inf, "Cm": 0.0}) for t in (100.0, 140.0)]
    fits = [Fit(e, effects=(a,), names=()) for e, a in zip((-80.0, -50.0), times, strict=True)]
    flight.fits = [*fits, Fit(-300.0)]
    fit_hypothesis(flight.case, flight.model, [screened(times[0], 50.0, (times[1],))], Null())
    assert flight.fitted[-1][0][0].values["t0"] == 140.0 and flight.fitted[-1][1] == "stated"


def test_without_excess_variance_there_is_one_fit(flight):
    """The stated noise is the fitted one, and nothing is left that another noise could explain."""
    flight.model.excess_variance, flight.model.noise_penalty = excess_of(0.0), 0.0
    flight.model.fitted_noise_filter = flight.model.stated_noise_filter
    flight.fits = [Fit(-80.0)]
    h = fit_hypothesis(flight.case, flight.model, [screened(MASS_START)], Null(evidence=-100.0))
    assert len(flight.fitted) == 1 and h.at_floor and h.gain == 20.0 and h.stated_noise_fit is None


def test_a_thorough_fit_is_repeated_at_the_stated_noise_while_some_excess_is_left(flight):
    """The little excess may be that of a fit that has not converged: then the stated noise is more likely."""
    flight.left = 1.0 / ROWS
    flight.fits = [Fit(-40.0), Fit(-10.0)]
    h = module._best(KEY, [Fit(-80.0)], [], Null(), flight.case, flight.model, thorough=True)
    assert [noise for _, noise, _ in flight.fitted] == ["own", "stated"]
    assert h.at_floor and h.gain == 90.0 + PENALTY and h.own_noise_evidence == -40.0 - OWN_PENALTY
    assert [moving for _, _, moving in flight.fitted] == [False, True]


@pytest.mark.parametrize(("stated", "gain"), [(-42.9, 57.1), (-43.1, 57.0)])
def test_each_noise_pays_its_own_penalty(flight, stated, gain):
    """Of two fits about one point that at the stated noise counts, unless the little excess gains its penalty.

    Both are credited with what the variances of the model without the effect cost, as is the held-out score.
    """
    flight.left = 1.0 / ROWS
    flight.fits = [Fit(-40.0), Fit(stated)]
    h = module._best(KEY, [Fit(-80.0)], [], Null(), flight.case, flight.model, thorough=True)
    assert h.at_floor and h.gain == pytest.approx(gain + PENALTY)
    own_penalty = 0.0 if h.fit.evidence == stated else OWN_PENALTY
    at_fitted_noise = hypothesis_of(flight, Fit(-80.0), Null())
    assert h.score_gain == pytest.approx(at_fitted_noise.score_gain + PENALTY - own_penalty)


@given(st.floats(0.0, 500.0))
def test_an_effect_is_credited_with_the_null_models_penalty_only_at_another_noise(penalty):
    """At the noise of the model without it both pay the same; at the stated noise the effect pays none."""
    with pytest.MonkeyPatch.context() as patch:
        flight = constructed_flight(patch)
        flight.model.noise_penalty = penalty
        null = Null(evidence=-100.0 - penalty, log_likelihood=-90.0 - penalty)
        free = Null(evidence=-100.0, log_likelihood=-90.0)
        expected = hypothesis_at("stated", flight, Fit(-80.0), free)
        for noise, credit in (("fitted", 0.0), ("stated", penalty)):
            h = hypothesis_at(noise, flight, Fit(-80.0), null)
            assert h.gain == pytest.approx(20.0 + credit)
            assert h.score_gain == pytest.approx(expected.score_gain + credit)


def test_the_noise_that_is_left_counts_where_the_model_without_it_has_little(flight):
    """Few rows have excess variance, of many about another point: the fit is at the floor, and still improved."""
    flight.model.excess_variance, flight.left = excess_of(1.0 / ROWS), 0.0
    flight.fits = [Fit(-70.0)]
    h = module._best(KEY, [Fit(-80.0, excess=0.0)], [], Null(excess_share=0.9), flight.case, flight.model)
    assert [noise for _, noise, _ in flight.fitted] == ["own"] and h.gain == 30.0 + PENALTY


def test_the_best_fit_at_the_stated_noise_is_continued_too(flight):
    flight.fits = [Fit(-60.0), Fit(-30.0)]
    at_stated = [Fit(-500.0, excess=0.5), Fit(-400.0, excess=0.0, point="another point")]
    h = module._best(KEY, [Fit(-80.0, excess=0.0)], at_stated, Null(), flight.case, flight.model)
    assert [moving for _, _, moving in flight.fitted] == [False, True] and h.gain == 70.0 + PENALTY


def test_only_the_first_start_of_an_effect_without_places(flight):
    flight.fits = [Fit(-80.0), Fit(-300.0)]
    fit_hypothesis(flight.case, flight.model, [screened(MASS_START), screened(MASS_START)], Null())
    assert len(flight.fitted) == 2


def test_where_the_model_holds_the_linear_problem_counts_if_it_gains_more(flight, monkeypatch):
    h = hypothesis_of(flight, Fit(-80.0), Null())
    for evidence, gain in ((-95.0, 20.0), (-60.0, 40.0)):
        monkeypatch.setattr(module, "fit_linear", lambda *_, e=evidence: Fit(e))
        holding = Null(evidence=-100.0)  # a model that holds has no excess noise to pay for
        best = with_gain_where_model_holds(h, flight.case, flight.model, flight.filters["fitted"], holding)
        assert best.gain == gain and best.fit is h.fit


@pytest.fixture
def reconstructed(flight, monkeypatch):
    """Reconstruction with the effect; `own` is the evidence of the fit about it, `iterated` whether there is one."""
    about_own = SimpleNamespace(**vars(flight.model) | {"excess_variance": excess_of(0.5)})
    about_own.white_excess_log_likelihood = -89.0
    flight.model.point = SimpleNamespace(bin_states=None)
    flight.own, flight.iterated, flight.first = -30.0, False, about_own
    case = SimpleNamespace(**vars(flight.case), reconstruction="with the effect")
    flight.case.reconstruct_with = lambda effects: case
    monkeypatch.setattr(module, "smoothed_point", lambda reconstruction: "smoothed point")
    monkeypatch.setattr(module, "linearize_at", lambda case, point, initial: about_own)

    def iterate(case, iterations, first):
        assert iterations == 2 and first is about_own
        flight.iterated = True
        return case, about_own, Fit(flight.own)

    monkeypatch.setattr(module, "iterate_to_convergence", iterate)
    return flight


def test_an_effect_that_explains_little_keeps_its_gain_without_an_iteration(reconstructed):
    reconstructed.fits, reconstructed.left = [Fit(-80.0)], 0.5
    h = hypothesis_of(reconstructed, Fit(-80.0), Null())
    result = relinearize_with_effect(h, Null())
    assert not reconstructed.iterated and result.gain == 20.0
    assert result.explained_share == pytest.approx(1.0 / 90.0)


@pytest.mark.parametrize("change", ["explains", "contends", "moved", "solved", "less excess"])
def test_an_effect_that_may_lead_is_fitted_about_its_own_reconstruction(reconstructed, change):
    """It explains much; or the null model is more probable about another point; or it was linearised about another."""
    reconstructed.fits, reconstructed.left = [Fit(-80.0), Fit(-30.0)], 0.5
    reference = Null(evidence=-70.0 if change == "contends" else Null().evidence)
    h = hypothesis_of(reconstructed, Fit(-80.0), Null())
    if change == "explains":
        reconstructed.first.white_excess_log_likelihood = 0.0
    elif change == "moved":
        reconstructed.model.point = SimpleNamespace(bin_states=np.zeros(1))
    elif change == "solved":
        h = replace(h, at_floor=True)
    elif change == "less excess":
        reconstructed.first.excess_variance = excess_of(LESS_EXCESS)
    result = relinearize_with_effect(h, reference)
    assert reconstructed.iterated and result.gain == -30.0 - PENALTY - reference.evidence
    assert result.null is reference
    # fitted at its own noise before, where it is not at the floor, and about its own reconstruction: both thoroughly
    assert len(reconstructed.fitted) == (1 if change == "solved" else 2)


def test_an_effect_with_the_sizes_of_a_leader_is_fitted_from_these(reconstructed):
    """Neither its fit about the failing model nor what it explains there counts."""
    reconstructed.fits, reconstructed.left = [Fit(-30.0)], 0.5
    h = hypothesis_of(reconstructed, Fit(-80.0), Null())
    result = relinearize_with_effect(h, Null(), converged=True)
    assert reconstructed.iterated and result.gain == -30.0 - PENALTY - Null().evidence
    assert len(reconstructed.fitted) == 1


@pytest.mark.parametrize(("cosine", "size"), [(1.0, 0.3), (0.6, 0.3), (1.0, 5.0)])
def test_sizes_by_which_an_effect_reproduces_another_one_about_its_point(flight, monkeypatch, cosine, size):
    """In closed form: a column at an angle to what the leader explains; the size is limited to its bounds."""
    along, across = np.eye(ROWS)[:2]
    columns = {"mass": cosine * along + np.sqrt(1.0 - cosine**2) * across, "axial_force_scale": along}
    monkeypatch.setattr(
        module,
        "effect_jacobian",
        lambda model, a: SimpleNamespace(
            rows=columns[a.name][:, None], initial_mean=np.zeros((1, 1)), names=("k",), sigma=np.array([1e3])
        ),
    )
    flight.model.fitted_noise_filter = lambda rows, initial_mean: rows
    h = hypothesis_of(flight, Fit(-80.0), Null())
    leader = SimpleNamespace(model=flight.model, instance=EffectInstance(find_effect("axial_force_scale"), {"k": size}))
    similarity, start = module.as_projection(h, leader)
    assert similarity == pytest.approx(cosine)
    assert start.instance.values["k"] == pytest.approx(min(size * cosine, 1.0), rel=1e-5)
    assert replace(start, fit=h.fit) == h


def test_an_effect_that_does_not_contend_is_not_iterated_for_a_better_null_model(reconstructed):
    reconstructed.fits, reconstructed.left = [Fit(-80.0)], 0.5
    h = hypothesis_of(reconstructed, Fit(-80.0), Null())
    assert relinearize_with_effect(h, Null(evidence=-90.0 - PENALTY), contends=False).gain == 10.0
    assert not reconstructed.iterated


@pytest.mark.parametrize(("progress", "iterated"), [(0.0, False), (17.0, False), (19.0, True)])
def test_a_contender_is_iterated_if_the_null_model_makes_progress_about_another_point(
    reconstructed, progress, iterated
):
    """A fifth of the misfit is 18 nats here; an effect with a smaller share is never named."""
    reconstructed.fits, reconstructed.left = [Fit(-80.0), Fit(-30.0)], 0.5
    h = hypothesis_of(reconstructed, Fit(-80.0), Null())
    result = relinearize_with_effect(h, Null(evidence=Null().evidence + progress))
    assert reconstructed.iterated == iterated
    assert iterated or result.gain == 20.0 - progress


@pytest.mark.parametrize(
    ("sigmas", "own", "gain"),
    [
        (1.0, -30.0, 20.0),  # credible: both are compared about the first point
        (9.0, -30.0, 70.0),  # holds only with a nuisance parameter far from its stated value
        (9.0, -95.0, 20.0),  # but about its own point the effect gains less
    ],
)
def test_gain_of_an_effect_beside_a_model_that_holds(reconstructed, sigmas, own, gain):
    reconstructed.model.holds, reconstructed.model.largest_nuisance_sigmas = True, sigmas
    reconstructed.own, reconstructed.fits = own, [Fit(own)]
    for model in (reconstructed.model, reconstructed.first):
        model.excess_variance, model.noise_penalty = excess_of(0.0), 0.0
    null = Null(evidence=-100.0, excess_share=0.0)
    h = hypothesis_of(reconstructed, Fit(-80.0), null)
    assert relinearize_with_effect(h, null).gain == gain


@pytest.mark.parametrize(
    ("gain", "over_zero", "better"),
    [
        (500.0, -20.0, True),
        (500.0, 249.0, True),
        (500.0, 251.0, False),
        (500.0, 490.0, False),
        (11.9, 5.8, True),
        (11.9, 6.1, False),
        (12.1, 6.2, False),
        (5.0, 0.0, False),
        (5.0, -20.0, True),
    ],
)
def test_evidence_that_is_not_that_of_the_effect_is_that_of_its_point(flight, monkeypatch, gain, over_zero, better):
    """The null model about that point, unless half of the gain and at least `named_gain_nats`, 6, are the effect's."""
    about = []

    def linearize_at(case, point, excess):
        about.append((case, point, excess))
        return "model about it"

    monkeypatch.setattr(module, "linearize_at", linearize_at)
    null = NullModelFit(395.0, 395.0, 0.5, 390.0, 400.0)
    monkeypatch.setattr(module, "fit_null_model", lambda model, effects, share: null if share == 0.5 else None)
    fit = SimpleNamespace(gain_over_zero=lambda key: over_zero, point="its point")
    reference = NullModelFit(-100.0, -90.0, 0.5, 391.0, 400.0)
    h = Hypothesis(KEY, fit, np.zeros(1), gain, 0.0, True, np.zeros(1), flight.case, flight.model, reference)
    result = module.null_model_about(h, flight.case)
    if not better:
        assert result is None and not about
        return
    assert about == [(flight.case, "its point", "excess")]
    assert result == ("model about it", replace(null, white_log_likelihood=391.0))


def test_a_hypothesis_is_known_by_its_effect_and_its_imu(flight):
    fit = Fit(-80.0, effects=(replace(MASS_START, imu="secondary"),))
    key = ("mass", "secondary")
    h = Hypothesis(
        key, fit, np.zeros(1), 0.0, 0.0, False, np.zeros(1), flight.case, flight.model, Null()
    )  # fmt: skip
    assert (h.name, h.label, h.instance.imu) == ("mass", "mass in secondary", "secondary")
