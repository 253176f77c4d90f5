"""Roughness: noise that a channel has beyond what is stated, found from the flight itself.

A vehicle shakes, a table has bends, and a model that lacks an effect fails by hundreds of sigmas for a while. Where a
channel's innovations are larger than stated over ten seconds, their excess is added to its noise there, so that one
failure does not decide about everything else, and evidence compares models at the noise that each of them leaves. On a
flight that is understood there is none.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from edl_filter.diagnosis.timeline import Order
from edl_filter.diagnosis.whitening import Steps, Whitener, whitener

Array = NDArray[np.float64]

#: Length of the pieces in which noise is estimated, s.
PIECE = 10.0
#: Excess of a piece's mean square that is more than chance, in sigmas of chance.
_CHANCE = 4.0
_ROUNDS = 6


@dataclass(frozen=True)
class Rough:
    """Variance that is added to each row of the bins.

    Attributes
    ----------
    variance : (R,) array
        In the rows' own units, squared.
    """

    variance: Array

    @property
    def none(self) -> bool:
        """Whether nothing was added anywhere."""
        return not np.any(self.variance)

    @property
    def share(self) -> float:
        """Part of the rows that are rough."""
        return float(np.mean(self.variance > 0.0))


def smooth_noise(steps: Steps) -> Rough:
    """No roughness."""
    return Rough(np.zeros(len(steps.design)))


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
    return Rough(_excess(plain, white, smooth_noise(plain.steps), _groups(order)))


def find_rough(plain: Whitener, order: Order, column: Array, start: Array) -> tuple[Rough, Whitener]:
    """Roughness of a column of differences, and the whitener that allows for it.

    Parameters
    ----------
    plain : Whitener
        Of the problem as it is stated.
    order : Order
    column : (R,) array
    start : (n,) array

    Returns
    -------
    The most likely of the rounds: noise that is added to one channel changes what the others are asked for.
    """
    rough, whiten, groups = smooth_noise(plain.steps), plain, _groups(order)
    best: tuple[float, Rough, Whitener] | None = None
    for i in range(_ROUNDS):
        white = whiten(column[:, None], start[:, None])[:, 0]
        likelihood = whiten.log_likelihood(white)
        if best is None or likelihood > best[0]:
            best = likelihood, rough, whiten
        excess = _excess(whiten, white, rough, groups)
        if i == _ROUNDS - 1 or np.allclose(np.sqrt(excess), np.sqrt(rough.variance), rtol=0.1, atol=0.0):
            break
        rough = Rough(excess)
        whiten = whitener(roughened(plain.steps, order, rough))
    assert best is not None
    return best[1], best[2]


def _groups(order: Order) -> list[NDArray[np.int64]]:
    """Rows of one channel in one piece of time."""
    found = []
    for channel in order.bin_rows.T:
        rows = channel[channel >= 0]
        if not len(rows):
            continue
        piece = np.floor((order.time[rows] - order.time[rows[0]]) / PIECE).astype(int)
        found += [rows[piece == p] for p in np.unique(piece)]
    return found


def _excess(whiten: Whitener, white: Array, rough: Rough, groups: list[NDArray[np.int64]]) -> Array:
    """Variance that the innovations ask for beyond what is stated."""
    innovation, sigma = whiten.innovations(white), whiten.innovation_sigma
    out = np.zeros_like(rough.variance)
    for rows in groups:
        had = rough.variance[rows]
        square = innovation[rows] ** 2
        ratio = np.mean(square / sigma[rows] ** 2)
        surprising = ratio - 1.0 > _CHANCE * np.sqrt(2.0 / len(rows))
        if had.any() or surprising:
            wanted = np.mean(square) - np.mean(sigma[rows] ** 2 - had)
            stated = np.mean(sigma[rows] ** 2 - had)
            out[rows] = wanted if wanted > _CHANCE * np.sqrt(2.0 / len(rows)) * stated else 0.0
    return out
