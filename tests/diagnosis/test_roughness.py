"""Noise beyond what is stated: the right amount where it is, and none where it is not."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from edl_filter.diagnosis.roughness import (
    PIECE,
    Rough,
    _likelier,
    _Round,
    find_rough,
    first_look,
    roughened,
    smooth_noise,
)
from edl_filter.diagnosis.sparse import dense
from edl_filter.diagnosis.timeline import Order
from edl_filter.diagnosis.whitening import Steps, whitener

RATE, LENGTH = 8, 60
COUNT = RATE * LENGTH
SIGMA = np.array([0.1, 2.0])


def problem(walk=0.0):
    """Two channels at 8 Hz for a minute; both also see one common unknown that walks by `walk` a step."""
    rows = 2 * COUNT
    steps = Steps(
        change=dense(np.zeros((COUNT, 1, 1))),
        noise=dense(np.full((COUNT, 1, 1), walk**2)),
        rows=np.arange(0, rows + 1, 2),
        design=np.tile(SIGMA if walk else np.zeros(2), COUNT)[:, None],
        row_noise=np.tile(np.diag(SIGMA**2), (COUNT, 1)),
        start=np.eye(1),
    )
    order = Order(
        bin_rows=np.arange(rows).reshape(COUNT, 2),
        constraint_rows=(),
        count=rows,
        dt=np.full(COUNT, 1.0 / RATE),
        time=100.0 + np.repeat(np.arange(COUNT), 2) / RATE,
        place=np.tile([0, 1], COUNT),
    )
    return steps, order


def drawn(seed, walk=0.0, factor=None):
    """Differences as stated; the noise times `factor` ``(COUNT, 2)``."""
    rng = np.random.default_rng(seed)
    noise = rng.normal(size=(COUNT, 2)) * (1.0 if factor is None else factor)
    common = rng.normal() + np.cumsum(walk * rng.normal(size=COUNT)) if walk else np.zeros(COUNT)
    return (SIGMA * (noise + common[:, None])).ravel()


def loud(piece, channel, by=5.0):
    factor = np.ones((COUNT, 2))
    first = round(piece * PIECE * RATE)
    factor[first : first + round(PIECE * RATE), channel] = by
    return factor


@pytest.mark.parametrize("channel", [0, 1])
def test_of_independent_rows_the_excess_is_what_the_mean_square_has_too_much(channel):
    steps, order = problem()
    factor = loud(2, channel)
    column = drawn(1, factor=factor)
    rough, whiten = find_rough(whitener(steps), order, column, np.zeros(1))
    rows = order.bin_rows[:, channel][factor[:, channel] > 1.0]
    expected = np.zeros(len(column))
    expected[rows] = np.mean(column[rows] ** 2) - SIGMA[channel] ** 2
    np.testing.assert_allclose(rough.variance, expected, rtol=1e-9)
    assert not rough.none and rough.share == pytest.approx(len(rows) / len(column))
    # and the whitener that comes back has it
    np.testing.assert_allclose(whiten.innovation_sigma**2, np.tile(SIGMA**2, COUNT) + expected)


@pytest.mark.parametrize("channel", [0, 1])
def test_five_times_the_noise_is_found_where_it_is(channel):
    """Beside an unknown that both channels see: innovations are more than noise, and the piece is not alone."""
    steps, order = problem(walk=0.1)
    factor = loud(3, channel)
    alone = []
    for seed in range(20):
        rough, _ = find_rough(whitener(steps), order, drawn(seed, 0.1, factor), np.zeros(1))
        table = rough.variance[order.bin_rows] / SIGMA**2
        inside = factor[:, channel] > 1.0
        assert np.ptp(table[inside, channel]) == 0.0
        assert np.sqrt(1.0 + table[inside, channel][0]) == pytest.approx(5.0, rel=0.25)  # chance: one sigma is 8 %
        assert not table[~inside].any()
        assert np.all(table[:, 1 - channel] < 1.0)
        alone.append(not rough.sure[order.bin_rows][:, 1 - channel].any())
    assert np.mean(alone) >= 0.9  # the unknown that both see may make the other a little louder at the same time


@pytest.mark.parametrize("rate", [0.5, 1.0, 4.0, 8.0])
def test_what_a_first_look_sees_is_sure_however_few_rows_a_piece_has(rate):
    """Of rows that are independent both ask the same: is the excess more than chance has in so many rows?"""
    steps, order = problem()
    order = replace(order, dt=np.full(COUNT, 1.0 / rate), time=100.0 + np.repeat(np.arange(COUNT), 2) / rate)
    column = drawn(1, factor=loud(2, 0))
    look = first_look(whitener(steps), order, column, np.zeros(1))
    rough, _ = find_rough(whitener(steps), order, column, np.zeros(1))
    assert not look.none
    np.testing.assert_array_equal(rough.sure, look.sure)


@pytest.mark.parametrize(("excess", "worth"), [(3.0, False), (6.0, True)])
def test_noise_must_be_worth_its_price(excess, worth):
    """Five rows a piece: three times the variance is more than chance in one piece, but there are 192 of them."""
    steps, order = problem()
    order = replace(order, dt=np.full(COUNT, 2.0), time=100.0 + 2.0 * np.repeat(np.arange(COUNT), 2))
    column = np.tile(SIGMA, COUNT)  # one sigma in each row
    piece = order.bin_rows[20:25, 0]
    column[piece] *= np.sqrt(1.0 + excess)
    assert not first_look(whitener(steps), order, column, np.zeros(1)).none
    rough, _ = find_rough(whitener(steps), order, column, np.zeros(1))
    gain = 0.5 * len(piece) * (excess - np.log1p(excess))
    price = np.log(192.0) + 0.5 * np.log(5.0)
    assert (gain > price) == worth == (not rough.none)
    assert rough.price == pytest.approx(price if worth else 0.0)
    np.testing.assert_array_equal(np.flatnonzero(rough.sure), piece if worth else [])


def test_a_clean_flight_has_none():
    steps, order = problem(walk=0.1)
    none = [find_rough(whitener(steps), order, drawn(seed, 0.1), np.zeros(1))[0].none for seed in range(100)]
    assert np.mean(none) >= 0.95


def test_a_first_look_sees_at_least_the_loud_piece():
    steps, order = problem()
    column = drawn(1, factor=loud(2, 0))
    whole, _ = find_rough(whitener(steps), order, column, np.zeros(1))
    look = first_look(whitener(steps), order, column, np.zeros(1))
    np.testing.assert_allclose(look.variance, whole.variance, rtol=1e-9)


@given(st.integers(0, 1000), st.lists(st.floats(0.2, 30.0), min_size=12, max_size=12))
def test_it_is_never_less_likely_than_without(seed, sizes):
    """Noise as loud as you like in any of the twelve pieces, and begun from any roughness."""
    steps, order = problem(walk=0.1)
    factor = np.repeat(np.reshape(sizes, (6, 2)), round(PIECE * RATE), axis=0)
    column = drawn(seed, 0.1, factor)[:, None]

    def likelihood(whiten):
        return whiten.log_likelihood(whiten(column, np.zeros((1, 1)))[:, 0])

    _, whiten = find_rough(whitener(steps), order, column[:, 0], np.zeros(1))
    assert likelihood(whiten) >= likelihood(whitener(steps))


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 1000), st.integers(0, 5), st.integers(0, 1), st.floats(3.0, 30.0))
def test_no_piece_would_be_likelier_with_another_variance(seed, piece, channel, by):
    """Beside an unknown that both channels see, where the excess of innovations would not be the answer."""
    steps, order = problem(walk=0.5)
    column = drawn(seed, 0.5, loud(piece, channel, by) * loud((piece + 1) % 6, 1 - channel, by))[:, None]
    rough, whiten = find_rough(whitener(steps), order, column[:, 0], np.zeros(1))
    best = whiten.log_likelihood(whiten(column, np.zeros((1, 1)))[:, 0])
    for variance in np.unique(rough.variance[rough.sure]):
        for factor in (0.7, 1.4):
            moved = replace(rough, variance=np.where(rough.variance == variance, factor, 1.0) * rough.variance)
            other = whitener(roughened(steps, order, moved))
            assert other.log_likelihood(other(column, np.zeros((1, 1)))[:, 0]) < best + 2.0


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 1000), st.floats(2.0, 30.0), st.floats(2.0, 30.0))
def test_it_does_not_matter_where_it_begins(seed, one, other):
    """From what another column has, louder and elsewhere, it comes to the same."""
    steps, order = problem(walk=0.2)
    plain, start = whitener(steps), np.zeros(1)
    begin, _ = find_rough(plain, order, drawn(seed + 1, 0.2, loud(1, 0, other) * loud(4, 1, other)), start)
    column = drawn(seed, 0.2, loud(1, 0, one) * loud(2, 1, one))
    likelihoods = [
        w.log_likelihood(w(column[:, None], np.zeros((1, 1)))[:, 0])
        for _, w in (find_rough(plain, order, column, start), find_rough(plain, order, column, start, begin))
    ]
    assert likelihoods[0] == pytest.approx(likelihoods[1], abs=4.0)


@given(st.floats(1.1, 2.9), st.floats(0.01, 100.0), st.floats(1.5, 20.0), st.booleans())
def test_the_secant_finds_the_power_of_each_piece(power, best, off, above):
    """Where a ratio is a power of the variance, the third step arrives; a piece beside it has a power of its own."""
    begin = np.array([best * (off if above else 1.0 / off), 2.0])

    def round_at(variance):
        return _Round(variance, (np.array([best, 5.0]) / variance) ** (1.0 / np.array([power, 1.5])), np.ones(2))

    pieces, rounds = [np.arange(4), np.arange(4, 9)], [round_at(begin)]
    for _ in range(3):
        along = _likelier(rounds, pieces, 9)
        assert np.ptp(along[:4]) == np.ptp(along[4:]) == 0.0
        rounds.append(round_at(along[[0, 4]]))
    np.testing.assert_allclose(rounds[-1].variance, [best, 5.0], rtol=1e-6)


@pytest.mark.parametrize("count", [0, 3, -3])
def test_what_was_found_with_other_rows_is_a_beginning_too(count):
    """A model may use a few rows more or less than the one whose noise is begun with."""
    steps, order = problem()
    column, start = drawn(5, factor=loud(2, 1)), np.zeros(1)
    found, whiten = find_rough(whitener(steps), order, column, start)
    variance = np.resize(found.variance, len(column) + count)
    _, again = find_rough(whitener(steps), order, column, start, Rough(variance, variance > 0.0))
    likelihoods = [w.log_likelihood(w(column[:, None], start[:, None])[:, 0]) for w in (whiten, again)]
    assert likelihoods[0] == pytest.approx(likelihoods[1], abs=2.0)


def test_the_excess_stands_on_the_diagonal_and_nowhere_else():
    steps, order = problem()
    assert roughened(steps, order, smooth_noise(steps)) is steps
    more = np.arange(2.0 * COUNT)
    found = roughened(steps, order, Rough(more, more > 0.0)).row_noise - steps.row_noise
    expected = np.zeros((2 * COUNT, 2))
    expected[0::2, 0], expected[1::2, 1] = more[0::2], more[1::2]
    np.testing.assert_allclose(found, expected, atol=1e-12)
    assert steps.row_noise[0, 0] == SIGMA[0] ** 2  # the problem that was given is left as it was


def test_rows_that_are_not_used_are_passed_over():
    """A channel that is nowhere compared, and constraints' rows, which are no channel's."""
    steps, order = problem()
    rows = np.stack((order.bin_rows[:, 0], np.full(COUNT, -1)), axis=1)
    order = Order(rows, (), order.count, order.dt, order.time, order.place)
    rough, _ = find_rough(whitener(steps), order, drawn(1, factor=np.full((COUNT, 2), 7.0)), np.zeros(1))
    table = rough.variance.reshape(COUNT, 2)
    assert table[:, 0].all() and not table[:, 1].any()
