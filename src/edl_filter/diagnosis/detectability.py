"""`edl-filter identifiability`: how large an effect must be to be found, before any difference is looked at.

A signature whitened by what is stated says how much information a flight has of a parameter. What the differences are
does not enter: only where the vehicle flew, and how well its sensors and its world are known.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from edl_filter.diagnosis.case import load_case
from edl_filter.diagnosis.linear import Linear
from edl_filter.diagnosis.of_result import needs_prediction
from edl_filter.diagnosis.ranking import Progress
from edl_filter.diagnosis.rounds import linearise
from edl_filter.diagnosis.signatures import Signature
from edl_filter.diagnosis.trying import signatures
from edl_filter.effects.effect import Effect
from edl_filter.mission import Mission

Array = NDArray[np.float64]

#: Gain from which an effect is found, nats, and correlation from which two are confused (design section 6).
FOUND, SAME = 6.0, 0.9


def identify(mission: Mission, candidates: Sequence[Effect], progress: Progress = lambda _: None) -> dict[str, Any]:
    """Say what a mission's flight can tell of each effect.

    Parameters
    ----------
    mission : Mission
    candidates : sequence of Effect
        Those in the mission are passed over.
    progress : callable
        Told what is being done.

    Returns
    -------
    dict
        ``effects``: for each its name, ``places`` (where it was asked: where it tells most), ``parameters`` (name →
        ``smallest``: size that gains `FOUND` nats, None if none does; ``unit``, ``plausible``, ``ratio`` of the two)
        and ``confused_with`` (name → correlation); ``failed``: effect → what went wrong in it.

    Raises
    ------
    InputError
        The mission cannot be predicted.
    """
    needs_prediction(mission, str(mission.source or mission.name))
    progress("reconstructing")
    case = load_case(mission)
    progress("comparing model and measurements")
    linear = linearise(case)
    present = {a.name for a in case.effects}
    failed: dict[str, str] = {}
    tried = []
    for effect in (e for e in candidates if e.name not in present):
        progress(f"asking for {effect.name}")
        tried += signatures(linear, [effect], case.parachute, failed)
    white = [_most_telling(linear, group) for group in tried]
    told = [_told(s, x) for s, x in white]
    bases = [_basis(x * s.sigma) for s, x in white]
    for i, one in enumerate(told):
        for j, other in enumerate(told):
            likeness = _likeness(bases[i], bases[j]) if i != j else 0.0
            if likeness > SAME:
                one["confused_with"][other["effect"]] = likeness
    return {"mission": mission.name, "in_model": sorted(present), "effects": told, "failed": failed}


def smallest_size(information: float, sigma: float, wanted: float = FOUND) -> float:
    """Size whose expected gain is `wanted` nats: ``0.5 s² A - 0.5 log(1 + A sigma²)``.

    Parameters
    ----------
    information : float
        A, squared norm of the white signature per unit of size squared.
    sigma : float
        Plausible size, which the prior has.

    Returns
    -------
    float
        Infinite where the flight has no information.
    """
    if not information > 0.0:
        return float("inf")
    penalty = 0.5 * np.log1p(information * sigma**2)
    high = 2.0 * np.sqrt(2.0 * (wanted + penalty) / information)
    return float(brentq(lambda s: 0.5 * s**2 * information - penalty - wanted, 0.0, high))


def _most_telling(linear: Linear, group: Sequence[Signature]) -> tuple[Signature, Array]:
    """The place of an effect where its plausible size would tell most, and its white signature there."""
    best = None
    for s in group:
        x = linear.plain(s.rows, s.start)
        told = float(np.sum((x * s.sigma) ** 2))
        if best is None or told > best[2]:
            best = s, x, told
    assert best is not None
    return best[0], best[1]


def _told(s: Signature, x: Array) -> dict[str, Any]:
    units = {q.name: q.unit for q in s.active.effect.parameters}
    parameters = {}
    for name, sigma, column in zip(s.names, s.sigma, x.T, strict=True):
        smallest = smallest_size(float(column @ column), float(sigma))
        parameters[name] = {
            "smallest": smallest if np.isfinite(smallest) else None,
            "unit": units[name],
            "plausible": float(sigma),
            "ratio": smallest / float(sigma) if np.isfinite(smallest) else None,
        }
    places = {q.name: s.active.values[q.name] for q in s.active.effect.places}
    return {"effect": s.active.name, "places": places, "parameters": parameters, "confused_with": {}}


def _basis(scaled: Array) -> Array:
    """Orthonormal directions of a white signature that the plausible size could show, ``(R, r)``."""
    u, size, _ = np.linalg.svd(scaled, full_matrices=False)
    return np.asarray(u[:, size > 1.0])


def _likeness(one: Array, other: Array) -> float:
    """Largest correlation of two spaces of signatures: cosine of the smallest angle between them."""
    if not one.shape[1] or not other.shape[1]:
        return 0.0
    return float(min(np.linalg.svd(one.T @ other, compute_uv=False)[0], 1.0))
