"""Trying the catalogue: every effect regressed linearly, at every place that it may have.

An effect's signature at each of its places is whitened and regressed on the differences (`regression`). What comes out
is its evidence averaged over the places, and the places from which a refit may begin.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from edl_filter.diagnosis.linear import Linear
from edl_filter.diagnosis.regression import Fit, regress
from edl_filter.diagnosis.signatures import Signature, places, signature
from edl_filter.diagnosis.whitening import Whitens
from edl_filter.effects.effect import Active, Effect
from edl_filter.errors import InputError

Array = NDArray[np.float64]

#: Leaders of each linear ranking that are refitted, and places at which one begins.
LEADERS, STARTS = 4, 3
#: Likeness from which an effect may be a rival of one that explains everything, and two places of one are alike.
RIVAL = 0.7
#: Linear gain (nats) below which an effect is no leader.
HOPELESS = 0.0
#: Dynamic pressure from which air can be felt, Pa: places in time begin there.
_FELT = 1.0


@dataclass(frozen=True)
class Trial:
    """An effect tried linearly at its best place.

    Attributes
    ----------
    active : Active
        With its sizes as they came out.
    signature : Signature
    fit : Fit
    gain : float
        Evidence over none, averaged over the places, nats.
    rows : (R, k) array
        White signature.
    elsewhere : tuple of Active
        The effect at other places that look unlike the best, best first.
    """

    active: Active
    signature: Signature
    fit: Fit
    gain: float
    rows: Array
    elsewhere: tuple[Active, ...] = ()


def signatures(
    linear: Linear, effects: Sequence[Effect], end: float, failed: dict[str, str] | None = None
) -> list[list[Signature]]:
    """Signatures of every effect at all its places; an effect that fails goes into `failed`, if that is given.

    Parameters
    ----------
    linear : Linear
    effects : sequence of Effect
    end : float
        Of the comparison, s: the last place in time.
    failed : dict, optional
        Effect → message.

    Returns
    -------
    list of list of Signature
        One list for each effect that did not fail, one entry a place.
    """
    nodes, q = linear.ground.found.nodes.time, linear.ground.found.flow.dynamic_pressure
    begin = float(nodes[np.argmax(q > _FELT)])
    lowest = float(np.min(linear.ground.found.flow.altitude))
    found = []
    for e in effects:
        try:
            found.append([signature(linear.ground, Active(e, place)) for place in places(e, begin, end, lowest)])
        except InputError as error:
            if failed is None:
                raise
            failed[e.name] = str(error)
    return found


def try_all(linear: Linear, whiten: Whitens, tried: list[list[Signature]]) -> dict[str, Trial]:
    """Regress the differences on every effect, at every place.

    Parameters
    ----------
    linear : Linear
    whiten : callable
        How white rows are made, such as by `beside_own`.
    tried : list of list of Signature
        Of `signatures`.

    Returns
    -------
    dict
        Effect → `Trial` at its best place.
    """
    flat = [s for group in tried for s in group]
    if not flat:
        return {}
    rows = np.concatenate([linear.column[:, None], *(s.rows for s in flat)], axis=1)
    starts = np.concatenate([linear.start[:, None], *(s.start for s in flat)], axis=1)
    white = whiten(rows, starts)
    y, at, found = white[:, 0], 1, {}
    for group in tried:
        fits = []
        for s in group:
            x = white[:, at : at + len(s.names)]
            at += len(s.names)
            fits.append((regress(y, x, s.sigma), s, x))
        gains = np.array([f[0].gain for f in fits])
        mean = float(gains.max() + np.log(np.mean(np.exp(gains - gains.max()))))
        chosen = _unlike(fits)
        best, s, x = chosen[0]
        found[s.active.name] = Trial(
            _sized(s, best), s, best, mean, x, tuple(_sized(other, fit) for fit, other, _ in chosen[1:])
        )
    return found


def _sized(s: Signature, fit: Fit) -> Active:
    """The effect of a signature with the sizes of a fit."""
    return replace(s.active, values=s.active.values | dict(zip(s.names, fit.size.tolist(), strict=True)))


def _unlike(fits: list[tuple[Fit, Signature, Array]]) -> list[tuple[Fit, Signature, Array]]:
    """The best fit and up to `STARTS` - 1 others, each unlike those before."""
    ranked = sorted(fits, key=lambda f: -f[0].gain)
    chosen = ranked[:1]
    made = [ranked[0][2] @ ranked[0][0].size]
    for fit, s, x in ranked[1:]:
        if len(chosen) == STARTS or fit.gain <= HOPELESS:
            break
        y = x @ fit.size
        if all(likeness(y, m) < RIVAL for m in made):
            chosen.append((fit, s, x))
            made.append(y)
    return chosen


def likeness(a: Array, b: Array) -> float:
    """Correlation of two signatures without its sign; 0 where they stand on different ground."""
    if len(a) != len(b):
        return 0.0
    scale = float(np.linalg.norm(a) * np.linalg.norm(b))
    return abs(float(a @ b)) / scale if scale > 0.0 else 0.0


def leaders(rankings: list[dict[str, Trial]]) -> list[str]:
    """Names that lead any of the linear rankings, each once."""
    names: list[str] = []
    for trials in rankings:
        ranked = sorted(trials, key=lambda n: -trials[n].gain)
        names += [n for n in ranked[:LEADERS] if trials[n].gain > HOPELESS and n not in names]
    return names


def alike(trials: dict[str, Trial], one: str, other: str) -> float:
    """Correlation of two effects' fitted signatures, white."""
    a, b = (trials[n].rows @ trials[n].fit.size for n in (one, other))
    return likeness(a, b)
