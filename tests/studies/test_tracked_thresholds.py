"""Tracked thresholds: which variations of a setting change what a function computes."""

import json
import math
import os

import numpy as np
import pytest
from pydantic import BaseModel
from tracked_thresholds import TrackedSettings, TrackedThreshold, Variations, fork, names_in, tracked_range

HALF, DOUBLE = ("limit", 0.5), ("limit", 2.0)
ARRAY = np.array([0.0, 3.0])


def divergent(function, default=2.0, branch=lambda key: False):
    """Factors at which a function of a setting diverges, and its plain result."""
    tracked = Variations({HALF: type(default)(0.5 * default), DOUBLE: 2 * default}, branch)
    result = function(tracked.setting("limit", default))
    return {0.5, 2.0} - {factor for _, factor in tracked.pending}, result


@pytest.mark.parametrize(
    ("function", "factors"),
    [
        (lambda t: t > 0.9, set()),
        (lambda t: t > 1.5, {0.5}),
        (lambda t: t <= 2.0, {2.0}),
        (lambda t: t == 1.0, {0.5}),
        (lambda t: t != 5.0, set()),
        (lambda t: t < 3, {2.0}),
        (lambda t: np.float64(1.5) < t, {0.5}),
        (lambda t: np.float64(9.0) >= t, set()),
        (lambda t: t >= np.float64(3.0), {2.0}),
        (lambda t: np.int64(3) > t, {2.0}),
        (lambda t: (t > ARRAY).all(), {2.0}),
        (lambda t: (np.array([5.0, 9.0]) > t).all(), set()),
        (lambda t: np.all(t > ARRAY), {2.0}),
        (lambda t: np.any(t > ARRAY), set()),
        (lambda t: np.all((t > ARRAY) & (ARRAY > 1.0)), set()),
        (lambda t: np.argmax(t < ARRAY) == 1, {2.0}),
        (lambda t: ARRAY[t > ARRAY], {2.0}),
    ],
)
def test_comparison_diverges_where_its_outcome_changes(function, factors):
    diverged, result = divergent(function)
    assert diverged == factors
    assert np.array_equal(result, function(2.0))


@pytest.mark.parametrize(
    ("function", "factors"),
    [
        (lambda t: max(t, 9.0) > 1.0, set()),  # 9 at all factors
        (lambda t: max(t, 3.0) > 3.5, {2.0}),
        (lambda t: min(t, 1.5) < 1.2, {0.5}),
        (lambda t: float(max(t, 9.0)), set()),
        (lambda t: float(max(3.0, t)), {2.0}),
        (lambda t: 3.0 * t - 1.0 > 0.0, set()),
        (lambda t: 1.0 - t / 2.0 < 0.2, {0.5}),
        (lambda t: np.float64(3.0) * t > 5.0, {0.5}),
        (lambda t: np.any(ARRAY * t > 7.0), {2.0}),
        (lambda t: np.sqrt(t) < 3.0, set()),
        (lambda t: np.all(np.clip(ARRAY, 1.0, t) < 3.5), set()),
        (lambda t: 1 + round(0.1 * t), set()),
        (lambda t: round(t) == 4, {2.0}),
        (lambda t: -t < 0.0, set()),
        (lambda t: abs(t - 3.0) > 1.5, {0.5}),
    ],
)
def test_arithmetic_diverges_where_a_later_outcome_changes(function, factors):
    assert divergent(function)[0] == factors


@pytest.mark.parametrize(
    "function",
    [
        float,
        int,
        bool,
        hash,
        math.sqrt,
        lambda t: f"{t:.1f}",
        lambda t: np.array([t, 1.0]),
        lambda t: np.arange(t, 9.0),
        lambda t: np.concatenate(([t], ARRAY)),
        lambda t: ARRAY.copy().__itruediv__(t),
        lambda t: ARRAY.copy().__setitem__(0, t),
        lambda t: t.real,
        lambda t: {t: 1},
    ],
)
def test_any_other_use_of_the_value_diverges(function):
    # bool(1.0) is bool(4.0), but a truth value is a use as well
    assert divergent(function)[0] == {0.5, 2.0}


def test_whole_number_as_index_and_as_limit_of_iterations():
    assert divergent(lambda t: [1, 2, 3, 4, 5, 6][:t], 2)[0] == {0.5, 2.0}

    def iterations(limit, needed):
        for i in tracked_range(limit):
            if i == needed:
                break
        return i

    assert divergent(lambda t: iterations(t, 0), 4)[0] == set()
    assert divergent(lambda t: iterations(t, 3), 4) == ({0.5}, 3)
    assert divergent(lambda t: iterations(t, 99), 4) == ({0.5, 2.0}, 3)
    assert list(tracked_range(1, 4)) == [1, 2, 3]


def test_two_settings_are_varied_one_at_a_time():
    tracked = Variations({("a", 2.0): 4.0, ("b", 2.0): 6.0})
    assert tracked.setting("a", 2.0) < tracked.setting("b", 3.0)
    assert tracked.pending == {("b", 2.0)}  # 4 < 3 is false, 2 < 6 is true


def test_exception_in_one_variation_diverges():
    tracked = Variations({("a", 2.0): 0.0})
    assert 1.0 / tracked.setting("a", 2.0) == 0.5 and not tracked.pending


def test_branch_continues_with_its_own_value():
    def function(t):
        return (t > 1.5, float(10 * t), t)

    assert function(Variations({}).setting("limit", 2.0)) == (True, 20.0, 2.0)
    tracked = Variations({HALF: 1.0, DOUBLE: 4.0}, lambda key: key == HALF)
    first, second, setting = function(tracked.setting("limit", 2.0))
    assert (first, second, float(setting)) == function(1.0)
    assert tracked.current == HALF and tracked.setting("limit", 2.0) == 1.0 and tracked.setting("other", 7.0) == 7.0
    assert not isinstance(tracked.setting("limit", 2.0), TrackedThreshold)


def test_copy_of_the_process_computes_the_variation(tmp_path):
    tracked = Variations({HALF: 1.0, DOUBLE: 4.0}, fork)
    limit = tracked.setting("limit", 2.0)
    small = limit > 1.5
    value = float(limit)
    name = "run" if tracked.current is None else str(tracked.current[1])
    (tmp_path / name).write_text(json.dumps([bool(small), value]))
    if tracked.current is not None:
        os._exit(0)
    assert {p.name: json.loads(p.read_text()) for p in tmp_path.iterdir()} == {
        "run": [True, 2.0], "0.5": [False, 1.0], "2.0": [True, 4.0],
    }  # fmt: skip


class Settings(BaseModel):
    limit: float = 2.0
    count: int = 3


def test_settings_are_tracked_or_plain():
    tracked = Variations({HALF: 1.0, ("count", 2.0): 6})
    settings = TrackedSettings(tracked, Settings(), {"count"})
    assert isinstance(settings.limit, TrackedThreshold) and HALF in tracked.pending
    assert settings.count == 3 and tracked.pending == {HALF}
    assert settings.model_dump()["limit"] > 0.5 and HALF in tracked.pending
    with pytest.raises(AttributeError, match="unknown"):
        _ = settings.unknown


def test_refused_settings_are_named():
    tracked = Variations({HALF: 1.0})

    def refuse(value):
        raise TypeError

    with pytest.raises(TypeError) as caught:
        refuse(tracked.setting("limit", 2.0))
    assert names_in(caught.value) == {"limit"}
