"""Screening of the readings of one instrument."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import twins

from edl_filter import rotations
from edl_filter.mission import Mission
from edl_filter.navigation import outlier_screening as module
from edl_filter.navigation.consensus import LEAST_READINGS, WINDOW, Consensus, quantile
from edl_filter.navigation.estimator import Innovation
from edl_filter.navigation.filter import run_filter
from edl_filter.pipeline.reconstruct import reconstruct


@pytest.fixture(scope="module")
def spirit():
    return reconstruct(Mission.load("builtin:mer_a"), leave_one_out=False).problem


@pytest.mark.parametrize("method", ["ukf", "ekf"])
@pytest.mark.parametrize("degrees", [0.05, 1.0])
def test_a_wrong_first_attitude_does_not_reject_the_others(spirit, method, degrees):
    """The first reading determines the error of the on-board attitude; neither position nor velocity is measured."""
    first = next(c for c in spirit.constraints if c.name == "onboard_attitude")
    turn = rotations.from_rotation_vector(np.radians([degrees, 0.0, 0.0]))
    wrong = replace(first, inertial_from_body=rotations.multiply(first.inertial_from_body, turn))
    constraints = tuple(wrong if c is first else c for c in spirit.constraints)
    settings = replace(spirit.settings, method=method)
    uses = run_filter(replace(spirit, constraints=constraints, settings=settings)).fused
    assert [u.constraint for u in uses if not u.accepted] == [wrong]


# --- which readings are examined, with a constructed consensus ------------------------------------------------------

GATE = 0.999


@pytest.fixture
def screened(monkeypatch):
    """Screen readings one after the other; the readings that were rejected, those examined together, the divergence."""

    def run(readings, innovations, consensus=None, gate=GATE, unit=None):
        """Readings and innovations in the order of time; consensus of each examination: agreement, and the state's."""
        results, examined = list(consensus or []), []

        def predict_jointly(estimator, samples, together):
            assert estimator == "copy of estimator" and samples.time[0] > together[0].time
            examined.append([r.time for r in together])
            return len(together)

        def find_consensus(count, probability):
            assert probability == gate
            outliers, state_outlier = results.pop(0) if results else ((), False)
            agree = ~np.isin(np.arange(count), outliers)
            return Consensus(agree, 90.0, 30.0, 2, state_outlier)

        monkeypatch.setattr(module, "predict_jointly", predict_jointly)
        monkeypatch.setattr(module, "find_consensus", find_consensus)
        count = 40
        samples = twins.samples(np.ones(count), np.zeros((count, 3)), np.zeros((count, 3)), unit=unit)
        screening = module.Screening(samples, readings, gate, lambda estimator: f"copy of {estimator}")
        rejected = [
            reading.time
            for k, (reading, innovation) in enumerate(zip(readings, innovations, strict=True))
            if screening.is_outlier("estimator", innovation, reading, readings[k + 1 :])
        ]
        return rejected, examined, screening.divergence

    return run


def heights(count, name="altimeter"):
    return [SimpleNamespace(name=name, time=float(k)) for k in range(1, count + 1)]


def innovation(nis=0.5, spread=0.5, components=1):
    """Of noise 1, with the normalised square of each component."""
    total = 1.0 + spread
    residual = np.full(components, np.sqrt(nis * total / components))
    return Innovation.of(residual, spread * np.eye(components), np.eye(components), np.zeros(0))


def test_readings_as_predicted_are_not_examined(screened):
    assert screened(heights(30), [innovation(1.0)] * 30) == ([], [], None)


@pytest.mark.parametrize(
    ("first", "doubtful"),
    [
        (innovation(0.1, spread=0.99), False),  # of a prediction that is as certain as the reading
        (innovation(0.1, spread=1.01), True),
        (innovation(0.1, spread=0.99, components=3), False),
        (innovation(0.1, spread=1.01, components=3), True),
        (innovation(0.99 * quantile(GATE, 1)), False),
        (innovation(1.01 * quantile(GATE, 1)), True),
        (innovation(0.99 * quantile(GATE, 3), components=3), False),
    ],
)
def test_a_reading_that_is_doubtful_is_examined_with_those_that_follow(screened, first, doubtful):
    readings = heights(20)
    _, examined, _ = screened(readings, [first] + [innovation()] * 19)
    assert examined == ([[float(k) for k in range(1, WINDOW + 1)]] if doubtful else [])


@pytest.mark.parametrize("components", [1, 3])
def test_readings_that_are_large_together_are_examined(screened, components):
    """Each is within its gate; the sum of the last ones, before the reading itself, is not."""
    each = quantile(GATE, WINDOW * components) / WINDOW
    assert each < 0.9 * quantile(GATE, components)
    _, examined, _ = screened(heights(40), [innovation(1.01 * each, components=components)] * 40)
    assert [e[0] for e in examined] == [WINDOW + 1.0, 2.0 * WINDOW + 1.0]
    # the sum begins anew after an examination, and outliers are no part of it
    _, examined, _ = screened(heights(40), [innovation(1.01 * each, components=components)] * 40, [(range(5), False)])
    assert [e[0] for e in examined] == [WINDOW + 1.0, 2.0 * WINDOW + 6.0]
    assert screened(heights(40), [innovation(0.99 * each, components=components)] * 40)[1] == []


def test_every_reading_is_examined_once(screened):
    """A second doubtful reading within the window is not examined again, one behind it is."""
    doubtful = innovation(50.0)
    _, examined, _ = screened(heights(40), [doubtful] * 40)
    assert [e[0] for e in examined] == [1.0, 16.0, 31.0]
    assert [len(e) for e in examined] == [15, 15, 10]


def test_too_few_readings_are_neither_counted_nor_examined(screened):
    doubtful = innovation(50.0)
    assert screened(heights(LEAST_READINGS - 1), [doubtful] * 4, [((0,), True)]) == ([], [], None)
    rejected, examined, _ = screened(heights(LEAST_READINGS), [doubtful] * 5, [((0,), False)])
    assert (rejected, [len(e) for e in examined]) == ([1.0], [5])  # the four that remain are too few


def test_without_a_gate_nothing_is_screened(screened):
    uncertain = innovation(50.0, spread=1e4)
    assert screened(heights(20), [uncertain] * 20, [((0,), True)], gate=1.0) == ([], [], None)


def test_outliers_of_a_consensus_are_rejected_when_they_are_read(screened):
    rejected, _, divergence = screened(heights(20), [innovation(50.0)] + [innovation()] * 19, [((0, 4, 14), False)])
    assert rejected == [1.0, 5.0, 15.0] and divergence is None


def test_without_a_majority_nothing_is_rejected(screened):
    first = [innovation(50.0)] + [innovation()] * 19
    assert screened(heights(20), first, [(range(8), True)])[::2] == ([], None)
    assert len(screened(heights(20), first, [(range(7), False)])[0]) == 7


def test_a_state_that_contradicts_its_readings_is_a_divergence(screened):
    """The first one is reported."""
    results = [((2,), True), ((0, 1), True)]
    _, _, divergence = screened(heights(32), [innovation(50.0)] * 32, results)
    assert divergence == module.Divergence(1.0, ("altimeter",), 14, 90.0, 30.0, 2)
    rejected, _, divergence = screened(heights(32), [innovation(50.0)] * 32, [((), False), ((0, 1), True)])
    assert rejected == [16.0, 17.0]
    assert divergence == module.Divergence(16.0, ("altimeter",), 13, 90.0, 30.0, 2)


def test_only_readings_of_one_instrument_and_one_driving_unit_are_examined_together(screened):
    """The unit changes after the twelfth sample: a reading at the change itself is still of the first unit."""
    readings = [r for pair in zip(heights(18), heights(18, "radar"), strict=True) for r in pair]
    innovations = [innovation(50.0 if k == 0 else 0.5) for k in range(36)]
    unit = (np.arange(40) >= 12).astype(int)
    _, examined, _ = screened(readings, innovations, unit=unit)
    assert examined == [[float(k) for k in range(1, 13)]]


def test_outliers_of_another_pass_are_rejected_and_not_counted():
    readings = heights(30)
    samples = twins.samples(np.ones(40), np.zeros((40, 3)), np.zeros((40, 3)))
    screening = module.Screening(samples, readings, GATE, lambda estimator: estimator, readings[4:6])
    rejected = [r.time for r in readings if screening.is_outlier("estimator", innovation(1.0), r, [])]
    assert rejected == [5.0, 6.0]
