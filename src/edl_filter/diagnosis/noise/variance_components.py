"""Roughness: noise that a channel has beyond what is stated, found from the flight itself.

A vehicle shakes, a table has bends, and a model that lacks an effect fails by hundreds of sigmas for a while. Where a
channel's differences are larger than stated over ten seconds, the variance that makes them most likely is added to its
noise there, so that one failure does not decide about everything else, and evidence compares models at the noise that
each of them leaves. On a flight that is understood there is none.

All pieces share one path, so their variances are sought together. With C the covariance of all differences y, the
likelihood is level in a piece's variance where the sums over its rows of ``(C⁻¹ y)²`` and of the diagonal of ``C⁻¹``
are equal (`hindsight`); a variance is multiplied by their ratio until they are (MacKay, Neural Computation 4 (1992)
415), and, but for the first time, by a power of it: its steps are always a little short. By which power, the last two
rounds say, piece by piece: the secant of the ratio's logarithm over that of the variance.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from edl_filter.diagnosis.hindsight import in_hindsight
from edl_filter.diagnosis.timeline import Order
from edl_filter.diagnosis.whitening import Steps, Whitener, whitener

Array = NDArray[np.float64]

#: Length of the pieces in which noise is estimated, s.
PIECE = 10.0
#: Excess of a piece's mean square that is more than chance, in sigmas of chance.
_CHANCE = 4.0
#: Rounds at most, and a gain (nats) that is not worth another.
_ROUNDS, _ENOUGH = 10, 2.0
#: Power of the ratio where no secant is known, and the largest: with two for all, flights were seen to go to and fro.
_LONGER, _LONGEST = 1.5, 3.0
#: Part of a difference's variance, all others known, that is as good as none.
_NOTHING = 1e-6


@dataclass(frozen=True)
class Rough:
    """Variance that is added to each row of the bins.

    Attributes
    ----------
    variance : (R,) array
        In the rows' own units, squared.
    sure : (R,) array of bool
        Where it is more than chance.
    price : float
        What the variances cost in evidence, nats: each was chosen among all pieces, and its size found from the piece's
        own rows (Schwarz, Annals of Statistics 6 (1978) 461).
    """

    variance: Array
    sure: NDArray[np.bool_]
    price: float = 0.0

    @property
    def none(self) -> bool:
        """Whether nothing was added anywhere."""
        return not np.any(self.variance)

    @property
    def share(self) -> float:
        """Part of the rows that are surely rough."""
        return float(np.mean(self.sure))

    def along(self, pieces: list[NDArray[np.int64]], count: int) -> Array:
        """Its variance ``(R,)`` in other pieces, of `count` rows, which may be a few more or less."""
        out = np.zeros(count)
        for rows in pieces:
            out[rows] = self.variance[min(int(rows[0]), len(self.variance) - 1)]
        return out


def smooth_noise(steps: Steps) -> Rough:
    """No roughness."""
    return Rough(np.zeros(len(steps.design)), np.zeros(len(steps.design), bool))


def roughened(steps: Steps, order: Order, rough: Rough) -> Steps:
    """The linear problem with that noise."""
    if rough.none:
        return steps
    noise = steps.row_noise.copy()
    noise[np.arange(len(noise)), order.place] += rough.variance
    return replace(steps, row_noise=noise)


def first_look(plain: Whitener, order: Order, column: Array, start: Array) -> Rough:
    """Roughness of a column of differences if all else is as stated: more than is left when all is weighed anew."""
    white = plain(column[:, None], start[:, None])[:, 0]
    innovation, sigma = plain.innovations(white), plain.innovation_sigma
    out = np.zeros_like(white)
    for rows in _pieces(order):
        square, stated = innovation[rows] ** 2, sigma[rows] ** 2
        excess = np.mean(square) - np.mean(stated)
        if min(np.mean(square / stated) - 1.0, excess / np.mean(stated)) > _chance(len(rows)):
            out[rows] = excess
    return Rough(out, out > 0.0)


def find_rough(
    plain: Whitener, order: Order, column: Array, start: Array, begin: Rough | None = None
) -> tuple[Rough, Whitener]:
    """Roughness of a column of differences, and the whitener that allows for it.

    Parameters
    ----------
    plain : Whitener
        Of the problem as it is stated.
    order : Order
    column : (R,) array
    start : (n,) array
    begin : Rough, optional
        What was found about another path, or without an effect: it saves rounds where it is likelier than a first look.

    Returns
    -------
    The most likely variances, or only those that are more than chance, or none, if that is as likely for the price;
    none where a first look sees none.
    """

    def tried(rough: Rough) -> tuple[float, Whitener, Array]:
        whiten = plain if rough.none else whitener(roughened(plain.steps, order, rough))
        white = whiten(column[:, None], start[:, None])[:, 0]
        return whiten.log_likelihood(white), whiten, white

    pieces, best = _pieces(order), -np.inf
    found, at_it = first_look(plain, order, column, start), plain
    if found.none:
        return found, plain
    trial = found.variance
    if begin is not None:
        starts = (trial, begin.along(pieces, len(column)))
        trial = max(starts, key=lambda variance: tried(replace(found, variance=variance))[0])
    rounds: list[_Round] = []
    for _ in range(_ROUNDS):
        likelihood, whiten, white = tried(replace(found, variance=trial))
        if likelihood < best + _ENOUGH:
            break
        weighed, diagonal = in_hindsight(whiten, white)
        best, at_it = likelihood, whiten
        found = Rough(trial, _sure(trial, pieces, diagonal), _price(trial, pieces))
        rounds.append(_round(trial, pieces, weighed, diagonal))
        trial = _likelier(rounds, pieces, len(trial))
    kept = np.where(found.sure, found.variance, 0.0)
    fewer = [np.zeros_like(kept)]
    if np.any(kept) and np.any(kept != found.variance):
        fewer.insert(0, kept)
    for rough in (Rough(v, v > 0.0, _price(v, pieces)) for v in fewer):
        likelihood, whiten, _ = tried(rough)
        if likelihood - rough.price > best - found.price:
            best, at_it, found = likelihood, whiten, rough
    return found, at_it


def _pieces(order: Order) -> list[NDArray[np.int64]]:
    """Rows of one channel in one piece of time."""
    found = []
    for channel in order.bin_rows.T:
        rows = channel[channel >= 0]
        if not len(rows):
            continue
        piece = np.floor((order.time[rows] - order.time[rows[0]]) / PIECE).astype(int)
        found += [rows[piece == p] for p in np.unique(piece)]
    return found


@dataclass(frozen=True)
class _Round:
    """What one round found, by piece.

    Attributes
    ----------
    variance : (p,) array
    square, expected : (p,) arrays
        Sums over a piece's rows of ``(C⁻¹ y)²`` and of the diagonal of ``C⁻¹``.
    """

    variance: Array
    square: Array
    expected: Array

    @property
    def ratio(self) -> Array:
        """By what a variance is too small, roughly."""
        return self.square / self.expected


def _round(variance: Array, pieces: list[NDArray[np.int64]], weighed: Array, diagonal: Array) -> _Round:
    return _Round(
        variance=np.array([variance[rows[0]] for rows in pieces]),
        square=np.array([np.sum(weighed[rows] ** 2) for rows in pieces]),
        expected=np.array([np.sum(diagonal[rows]) for rows in pieces]),
    )


def _power(rounds: list[_Round]) -> Array:
    """Power of each piece's ratio by which its variance is multiplied."""
    once = np.ones(len(rounds[-1].variance))
    if len(rounds) < 3:
        return once if len(rounds) == 1 else _LONGER * once
    before, last = rounds[-2:]
    fitted = (before.variance > 0.0) & (last.variance > 0.0) & (before.ratio > 0.0) & (last.ratio > 0.0)
    went, fell = once.copy(), np.zeros_like(once)
    went[fitted] = np.log(last.variance[fitted] / before.variance[fitted])
    fell[fitted] = np.log(before.ratio[fitted] / last.ratio[fitted])
    nearer = went * fell > 0.0  # or the other pieces moved it more than its own variance did
    return np.where(nearer, np.clip(went / np.where(nearer, fell, 1.0), 1.0, _LONGEST), _LONGER)


def _likelier(rounds: list[_Round], pieces: list[NDArray[np.int64]], count: int) -> Array:
    """The next variances ``(R,)``."""
    last, power, out = rounds[-1], _power(rounds), np.zeros(count)
    for i, rows in enumerate(pieces):
        n = len(rows)
        if last.variance[i] * last.expected[i] > _NOTHING * n:
            out[rows] = last.variance[i] * last.ratio[i] ** power[i]
        elif last.ratio[i] - 1.0 > _chance(n):
            out[rows] = (last.square[i] - last.expected[i]) * n / last.expected[i] ** 2
    return out


def _sure(variance: Array, pieces: list[NDArray[np.int64]], diagonal: Array) -> NDArray[np.bool_]:
    """Where variance is more than may be chance, of what a difference would have without it, all others known."""
    out = np.zeros(len(variance), bool)
    for rows in pieces:
        part = variance[rows[0]] * np.mean(diagonal[rows])
        out[rows] = part > _chance(len(rows)) * (1.0 - part)
    return out


def _price(variance: Array, pieces: list[NDArray[np.int64]]) -> float:
    """Evidence that choosing the rough pieces and fitting their variances costs, nats."""
    fitted = [len(rows) for rows in pieces if variance[rows[0]] > 0.0]
    return len(fitted) * float(np.log(len(pieces))) + 0.5 * float(np.sum(np.log(fitted)))


def _chance(count: int) -> float:
    """Excess of the mean square of `count` differences that may be chance, of the square that is stated."""
    return float(_CHANCE * np.sqrt(2.0 / count))
