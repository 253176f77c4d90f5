"""Roughness: noise that a channel has beyond what is stated, found from the flight itself.

A vehicle shakes, a table has bends, and a model that lacks an effect fails by hundreds of sigmas for a while. Where a
channel's differences are larger than stated over ten seconds, the variance that makes them most likely is added to its
noise there, so that one failure does not decide about everything else, and evidence compares models at the noise that
each of them leaves. On a flight that is understood there is none.

All pieces share one path, so their variances are sought together. With C the covariance of all differences y, the
likelihood is level in a piece's variance where the sums over its rows of ``(C⁻¹ y)²`` and of the diagonal of ``C⁻¹``
are equal (`hindsight`); a variance is multiplied by their ratio until they are (MacKay, Neural Computation 4 (1992)
415), and, but for the first time, by a power of it: its steps are always a little short.
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
#: Power of the ratio after the first round: with two, flights were seen to go to and fro.
_LONGER = 1.5
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
        What another column was found to have, such as that of the model without an effect: it saves rounds.

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
    trial = found.variance if begin is None or begin.none else np.where(begin.sure, begin.variance, found.variance)
    for i in range(_ROUNDS):
        likelihood, whiten, white = tried(replace(found, variance=trial))
        if likelihood < best + _ENOUGH:
            break
        weighed, diagonal = in_hindsight(whiten, white)
        best, at_it = likelihood, whiten
        found = Rough(trial, _sure(trial, pieces, diagonal), _price(trial, pieces))
        trial = _likelier(trial, pieces, weighed, diagonal, _LONGER if i else 1.0)
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


def _likelier(variance: Array, pieces: list[NDArray[np.int64]], weighed: Array, diagonal: Array, power: float) -> Array:
    """The next variances from ``C⁻¹ y`` and the diagonal of ``C⁻¹``."""
    out = np.zeros_like(variance)
    for rows in pieces:
        had, n = variance[rows[0]], len(rows)
        square, expected = np.sum(weighed[rows] ** 2), np.sum(diagonal[rows])
        if had * expected > _NOTHING * n:
            out[rows] = had * (square / expected) ** power
        elif square / expected - 1.0 > _chance(n):
            out[rows] = (square - expected) * n / expected**2
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
