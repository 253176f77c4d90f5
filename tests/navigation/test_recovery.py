"""What contradicts the state, and the change that removes it, with constructed runs; flights are in test_iterated."""

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest
import twins

from edl_filter.navigation import recovery
from edl_filter.navigation.consensus import quantile
from edl_filter.navigation.estimator import Innovation
from edl_filter.navigation.outlier_screening import Divergence
from edl_filter.navigation.recovery import contradiction, log_likelihood, used_once

DIVERGENCE = Divergence(3.0, ("altimeter",), 8, 90.0, 30.0, 2)


def use(name, time=1.0, accepted=True, residual=(1.0,), spread=1.0):
    """A constraint that was fused: noise 1, so that a component contributes residual² / (1 + spread) to the NIS."""
    eye = np.eye(len(residual))
    innovation = Innovation.of(np.array(residual), spread * eye, eye, np.zeros(0))
    return SimpleNamespace(
        constraint=SimpleNamespace(name=name, time=time), accepted=accepted, innovation=innovation
    )  # fmt: skip


def run_of(*uses, divergence=None):
    return SimpleNamespace(fused=list(uses), divergence=divergence)


# --- contradictions -------------------------------------------------------------------------------------------------


def test_readings_that_contradict_the_state_are_a_contradiction():
    assert contradiction(run_of(use("landing"), divergence=DIVERGENCE)) is DIVERGENCE


def test_two_rejected_constraints_of_different_sources_contradict_the_state():
    """Their normalised squares, of 8 and 2 + 18, and their components add up."""
    rejected = use("landing", 4.0, False, (2.0, 6.0)), use("rest_velocity", 9.0, False, (4.0,))
    result = contradiction(run_of(use("beacon"), *rejected))
    assert result == Divergence(4.0, ("landing", "rest_velocity"), 2, 28.0, 0.0, 3)


@pytest.mark.parametrize(
    ("uses", "sources"),
    [
        ([], 0),
        ([use("landing"), use("rest_velocity")], 0),
        ([use("landing", accepted=False), use("rest_velocity")], 1),
        ([use("rest_position", accepted=False), use("rest_velocity", accepted=False)], 1),  # the surface, twice
        ([use("landing", accepted=False), use("rest_rate", accepted=False)], 1),  # attitude alone
        ([use("landing", accepted=False), use("onboard_attitude", accepted=False)], 1),
        ([use("landing", accepted=False), use("pre_entry_zero_force", accepted=False)], 1),
        ([use("landing", accepted=False), *(use("altimeter", t, False) for t in (1.0, 2.0))], 1),  # one of many
        ([use("landing", accepted=False), use("altimeter", accepted=False)], 2),
    ],
)
def test_a_contradiction_has_a_number_of_sources(uses, sources):
    for least in (1, 2, 3):
        assert (contradiction(run_of(*uses), least) is not None) == (sources >= least)
    assert (contradiction(run_of(*uses)) is not None) == (sources >= 2)


def test_a_constraint_is_used_once_if_no_other_has_its_name():
    uses = [use("landing"), use("altimeter", 1.0), use("altimeter", 2.0)]
    assert [used_once(run_of(*uses), u) for u in uses] == [True, False, False]


def test_the_likelihood_truncates_readings_that_are_one_of_many():
    """Gaussian densities of variance 2, without their constant; the gate of 0.99 for one component is 6.63."""
    problem = SimpleNamespace(settings=SimpleNamespace(gate_probability=0.99))
    once = run_of(use("landing", residual=(10.0, 2.0)))
    assert log_likelihood(problem, once) == pytest.approx(-0.5 * (52.0 + 2.0 * np.log(2.0)))
    many = run_of(use("altimeter", 1.0, residual=(2.0,)), use("altimeter", 2.0, residual=(10.0,)))
    assert log_likelihood(problem, many) == pytest.approx(-0.5 * (2.0 + quantile(0.99, 1) + 2.0 * np.log(2.0)))
    larger = run_of(use("altimeter", 1.0, residual=(9.0, 9.0)), use("altimeter", 2.0, residual=(9.0, 9.0)))
    assert log_likelihood(problem, larger) == pytest.approx(-(quantile(0.99, 2) + 2.0 * np.log(2.0)))


# --- the size of a change -------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Trial:
    """The run of a problem that is its size: whether it diverges, whether its constraints are accepted, likelihood."""

    likelihood: float
    accepted: bool = True
    diverges: bool = False


@pytest.fixture
def best_size(monkeypatch):
    """The best size of several, where the run of each is a function of it; the sizes that were tried."""

    def search(sizes, trial):
        tried = []

        def run(size):
            tried.append(size)
            result = trial(size)
            if result is None:
                raise np.linalg.LinAlgError
            uses = [use("landing", accepted=result.accepted), *(use("altimeter", t, False) for t in (1.0, 2.0))]
            return SimpleNamespace(fused=uses, divergence=DIVERGENCE if result.diverges else None, trial=result)

        monkeypatch.setattr(recovery, "log_likelihood", lambda problem, run: run.trial.likelihood)
        return recovery._best_size("gap", sizes, lambda size: size, run), tried

    return search


def test_the_size_has_the_largest_likelihood_between_the_sizes_too(best_size):
    """Steps about the best one are halved twice, in logarithms."""
    attempt, tried = best_size((2.0, 32.0, 512.0), lambda s: Trial(-abs(np.log2(s) - 6.2)))
    np.testing.assert_allclose(np.log2(tried), [1.0, 5.0, 9.0, 3.0, 7.0, 6.0, 8.0])
    assert attempt.cause == "gap" and np.log2(attempt.size) == pytest.approx(6.0)
    assert attempt.likelihood == pytest.approx(-0.2) and attempt.problem == attempt.size


def test_a_run_that_accepts_all_constraints_is_better_than_a_likelier_one(best_size):
    """Of those that are one of many, some may be rejected."""
    attempt, _ = best_size((1.0, 4.0, 16.0), lambda s: Trial(-s, accepted=s >= 16.0))
    assert attempt.size == 16.0 and attempt.accepted


def test_runs_that_fail_or_diverge_are_no_attempts(best_size):
    attempt, _ = best_size((1.0, 4.0, 16.0), lambda s: None if s > 8.0 else Trial(s, diverges=s > 3.0))
    assert 1.0 < attempt.size < 3.0
    attempt, tried = best_size((1.0, 4.0), lambda s: Trial(0.0, diverges=True))
    assert attempt is None and tried == [1.0, 4.0]


def test_another_attempt_is_better_by_more_than_a_margin():
    def attempt(likelihood, accepted=True):
        return recovery._Attempt("gap", 1.0, None, run_of(use("landing", accepted=accepted)), likelihood)

    assert attempt(5.1).better_than(attempt(5.0)) and not attempt(5.0).better_than(attempt(5.0))
    assert attempt(8.1).better_than(attempt(5.0), 3.0) and not attempt(7.9).better_than(attempt(5.0), 3.0)
    assert attempt(0.0).better_than(attempt(9.0, accepted=False), 3.0)
    assert not attempt(9.0, accepted=False).better_than(attempt(0.0))
    assert attempt(9.0, accepted=False).better_than(attempt(0.0, accepted=False))
    partly_accepted = run_of(use("beacon", accepted=True), use("landing", accepted=False))
    assert not recovery._Attempt("gap", 1.0, None, partly_accepted, 0.0).accepted


# --- changes of the problem -----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Initial:
    """A stated entry state."""

    covariance: np.ndarray
    time: float = 0.0


@dataclass(frozen=True)
class FlightProblem:
    """What a change is made of."""

    samples: object
    initial: Initial


def changes(lost=(), stop=6):
    """Causes → sizes and change, of ten samples; force and rate vary by 2 and by 0.5 before the sixth.

    The samples end at full seconds, but for the fourth, which ends at 3.5 s. It and the fifth, eighth and ninth are
    filled, with sigmas of 1 and 0.25, and of 0.5 and 0 along the third axis.
    """
    sign = (-1.0) ** np.arange(10)[:, None] * np.ones(3)
    size = np.where(np.arange(10) < 6, 1.0, 7.0)[:, None]
    interval = np.array([1.0, 1.0, 1.0, 0.5, 1.5, 1.0, 1.0, 1.0, 1.0, 1.0])
    samples = twins.samples(interval, 2.0 * size * sign + 5.0, 0.5 * size * sign, force_noise=3.0, rate_noise=1.0)
    filled = np.isin(np.arange(10), [3, 4, 7, 8])[:, None]
    samples = replace(
        samples, force_fill_sigma=filled * np.array([1.0, 1.0, 0.5]), rate_fill_sigma=filled * np.array([0.25, 0.25, 0])
    )
    problem = FlightProblem(samples, Initial(np.diag([4.0, 9.0])))
    return samples, {cause: (sizes, change) for cause, sizes, change in recovery._changes(problem, stop, lost)}


def test_a_wrong_entry_state_has_larger_sigmas():
    samples, by_cause = changes()
    assert list(by_cause) == ["entry_state", "process_noise"]  # nothing was lost
    sizes, change = by_cause["entry_state"]
    assert sizes == recovery.FACTORS
    np.testing.assert_allclose(change(10.0).initial.covariance, np.diag([400.0, 900.0]))
    assert change(10.0).samples is samples


def test_samples_before_the_contradiction_have_a_share_of_the_variation_as_noise():
    samples, by_cause = changes()
    sizes, change = by_cause["process_noise"]
    changed = change(2.0).samples
    assert sizes == recovery.SHARES
    before = (np.arange(10) < 6)[:, None] * np.ones(3, bool)
    np.testing.assert_allclose(changed.force_noise, np.where(before, 5.0, 3.0))
    np.testing.assert_allclose(changed.rate_noise, np.where(before, np.sqrt(2.0), 1.0))
    assert replace(changed, force_noise=samples.force_noise, rate_noise=samples.rate_noise).time is samples.time


def test_filled_samples_have_a_multiple_of_their_sigma():
    """Lost are those that end after 3 s and by 5 s, and those after the contradiction at 6 s."""
    samples, by_cause = changes(lost=[(3.0, 5.0), (7.0, 9.0)])
    assert list(by_cause) == ["gap", "entry_state", "process_noise"]
    sizes, change = by_cause["gap"]
    changed = change(2.0).samples
    assert sizes == recovery.FILL_FACTORS and max(sizes) <= 10.0
    factor = np.where(np.isin(np.arange(10), [3, 4]), 2.0, 1.0)[:, None]
    np.testing.assert_allclose(changed.force_fill_sigma, factor * samples.force_fill_sigma)
    np.testing.assert_allclose(changed.rate_fill_sigma, factor * samples.rate_fill_sigma)
    assert changed.force_noise is samples.force_noise and changed.rate_noise is samples.rate_noise


def test_lost_samples_without_a_sigma_of_their_own_have_a_share_of_the_variation_as_noise():
    samples, by_cause = changes(lost=[(0.0, 2.0)])
    assert list(by_cause) == ["gap", "entry_state", "process_noise"]
    sizes, change = by_cause["gap"]
    changed = change(2.0).samples
    assert sizes == recovery.SHARES
    np.testing.assert_allclose(changed.force_noise, np.where(np.arange(10) < 2, 5.0, 3.0)[:, None] * np.ones(3))
    np.testing.assert_array_equal(changed.force_fill_sigma, samples.force_fill_sigma)


def test_what_was_lost_after_the_contradiction_is_no_cause():
    assert list(changes(lost=[(6.0, 9.0)])[1]) == ["entry_state", "process_noise"]


@pytest.mark.parametrize(
    ("filled", "attitude", "position", "converged", "result"),
    [
        ([False, True], 1e-4, 10.0, True, "iterated"),
        ([False, True], 1e-4, 10.0, False, "iterated"),
        ([False, False], 0.9e-3, 2.9e3, True, "once"),
        ([False, False], 1.1e-3, 10.0, True, "iterated"),
        ([False, False], 1.1e-3, 10.0, False, "once"),
        ([False, False], 1e-4, 3.1e3, True, "iterated"),
    ],
)
def test_a_run_that_may_not_be_linear_is_linearised_again(monkeypatch, filled, attitude, position, converged, result):
    """Without filled samples one that does not converge is not used: its contradictions could not be tested."""
    problem = SimpleNamespace(samples=SimpleNamespace(filled=np.array(filled)))
    covariance = np.diag([1.0, position**2, 1.0, 9e9, 9e9, 9e9, 1e-12, 1e-12, attitude**2, 9e9])
    once = SimpleNamespace(nodes=[SimpleNamespace(covariance=covariance)])
    iterated = SimpleNamespace(converged=converged)
    monkeypatch.setattr(recovery, "run_filter", lambda given_problem: once)
    monkeypatch.setattr(recovery, "iterate", lambda given_problem, run: iterated if run is once else None)
    assert recovery.first_pass(problem) is {"once": once, "iterated": iterated}[result]


# --- causes ---------------------------------------------------------------------------------------------------------


@pytest.fixture
def recovered(monkeypatch):
    """Recover from a contradiction of some sources at 6 s, with the accepted attempts' likelihoods by cause."""

    def run(sources, likelihoods, lost=((3.0, 5.0),), rejecting=(), converged=True, **options):
        samples, _ = changes()
        problem = FlightProblem(samples, Initial(np.eye(2), time=-1.0))
        first = SimpleNamespace(fused=[], divergence=None, converged=converged)
        tried = []

        def best_size(cause, sizes, change, run):
            tried.append(cause)
            assert run is recovery.first_pass
            if cause not in likelihoods:
                return None
            filter_pass = run_of(use("landing", accepted=cause not in rejecting))
            size = 2.0 if cause == "gap" else 0.5
            return recovery._Attempt(cause, size, change(size), filter_pass, likelihoods[cause])

        def contradicts(filter_pass, least=2):
            return replace(DIVERGENCE, time=6.0) if sources >= least else None

        monkeypatch.setattr(recovery, "_best_size", best_size)
        monkeypatch.setattr(recovery, "contradiction", contradicts)
        monkeypatch.setattr(recovery, "log_likelihood", lambda problem, filter_pass: -50.0)
        changed, filter_pass, result = recovery.run_with_recovery(problem, lost, first, **options)
        if result is None:
            assert changed is problem and filter_pass is first
        return changed, result, tried

    return run


def test_without_a_contradiction_the_run_stays(recovered):
    assert recovered(0, {"gap": 0.0})[1:] == (None, [])
    assert recovered(1, {"entry_state": 0.0}, lost=())[1:] == (None, [])
    assert recovered(2, {"gap": 0.0}, converged=False)[1:] == (None, [])


@pytest.mark.parametrize("sources", [1, 2])
def test_lost_samples_that_explain_the_contradiction_are_its_cause(recovered, sources):
    """The sigmas of the samples from 3 to 5 s are doubled: their variances have become larger by three times them."""
    changed, result, tried = recovered(sources, {"gap": -20.0, "entry_state": 500.0})
    assert tried == ["gap"]
    noise = np.sqrt(3.0 * np.array([2.25, 0.125]) / 3.0)  # mean square of the axes
    assert result.divergence == replace(DIVERGENCE, time=6.0)
    assert (result.cause, result.size, result.start, result.end, result.gain) == ("gap", 2.0, 3.0, 5.0, 30.0)
    assert (result.force_noise, result.rate_noise) == pytest.approx(tuple(noise))
    assert result.recovered and np.count_nonzero(changed.samples.force_fill_sigma > 1.0) == 2 * 2


def test_without_lost_samples_two_sources_show_that_the_state_is_wrong(recovered):
    _, result, tried = recovered(2, {"entry_state": -10.0}, lost=())
    assert (result.cause, tried) == ("entry_state", ["entry_state", "process_noise"])


def test_one_source_tests_lost_samples_only(recovered):
    """If they do not explain the contradiction, the measurement is the outlier."""
    for likelihoods in ({"entry_state": 0.0}, {"gap": 0.0, "entry_state": 0.0}):
        assert recovered(1, likelihoods, rejecting=("gap",))[1:] == (None, ["gap"])


@pytest.mark.parametrize(
    ("likelihoods", "rejecting", "cause"),
    [
        ({"entry_state": -10.0, "process_noise": -7.5}, (), "entry_state"),  # not preferred for two nats
        ({"entry_state": -10.0, "process_noise": -6.5}, (), "process_noise"),
        ({"entry_state": -10.0, "process_noise": -90.0}, ("entry_state",), "process_noise"),
        ({"gap": 0.0, "entry_state": -90.0}, ("gap",), "entry_state"),
        ({"gap": 0.0, "entry_state": 1.0}, ("gap", "entry_state"), "gap"),
        ({"process_noise": -90.0}, (), "process_noise"),
    ],
)
def test_the_cause_rejects_least_and_is_clearly_the_likeliest(recovered, likelihoods, rejecting, cause):
    _, result, tried = recovered(2, likelihoods, rejecting=rejecting)
    assert tried == ["gap", "entry_state", "process_noise"]
    assert (result.cause, result.gain) == (cause, likelihoods[cause] + 50.0)
    noise, interval = {
        "gap": ((1.5, np.sqrt(0.125)), (3.0, 5.0)), "entry_state": ((0.0, 0.0), (-1.0, -1.0)),
        "process_noise": ((1.0, 0.25), (0.0, 6.0)),
    }[cause]  # fmt: skip
    assert (result.force_noise, result.rate_noise) == pytest.approx(noise)
    assert (result.start, result.end) == interval


def test_a_contradiction_that_no_change_removes_is_reported(recovered):
    changed, result, _ = recovered(2, {})
    assert result.cause is None and not result.recovered
    assert (result.size, result.force_noise, result.rate_noise, result.gain) == (0.0, 0.0, 0.0, 0.0)
    assert np.isnan([result.start, result.end]).all() and changed.initial.time == -1.0


@pytest.mark.parametrize(("rejecting", "cause"), [((), "gap"), (("gap",), None)])
def test_lost_samples_are_the_only_cause_if_no_other_is_asked_for(recovered, rejecting, cause):
    """For a diagnosis: noise of another cause would hide a missing effect."""
    likelihoods = {"gap": -20.0, "entry_state": 500.0, "process_noise": 500.0}
    _, result, tried = recovered(2, likelihoods, rejecting=rejecting, gap_only=True)
    assert tried == ["gap"] and (None if result is None else result.cause) == cause
    assert recovered(2, likelihoods, lost=(), gap_only=True)[1] is None
