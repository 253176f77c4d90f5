"""Detectability: how large an effect must be to be named, before any residual is looked at.

The columns of an effect, whitened by what is stated, are the information that a flight has of its parameters. The
residuals do not enter: only where the vehicle flew, and how well its sensors and its models are known.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from edl_filter.diagnosis.linear_model.effect_jacobian import EffectJacobian
from edl_filter.diagnosis.linear_model.flight_case import load_case
from edl_filter.diagnosis.linear_model.linear_model import LinearizedModel
from edl_filter.diagnosis.linear_model.linearization import linearize
from edl_filter.diagnosis.selection.ranking import Progress, candidate_instances
from edl_filter.diagnosis.selection.screening import scan_jacobians
from edl_filter.effects.base import Effect
from edl_filter.estimation.regression import smallest_size
from edl_filter.mission import Mission
from edl_filter.mission.mission import require_prediction_inputs
from edl_filter.types import Array


def detectability(
    mission: Mission, candidates: Sequence[Effect], progress: Progress = lambda _: None
) -> dict[str, Any]:
    """Smallest detectable size of each effect on a mission's flight, and which effects are confused with which.

    Parameters
    ----------
    mission : Mission
        The mission, checked.
    candidates : sequence of Effect
        Those in the mission are passed over.
    progress : callable
        Called with what is being done.

    Returns
    -------
    dict
        ``required_gain`` (nats); ``effects``: for each its name, ``imu`` (of a checking IMU's error), ``places`` (the
        place of its scan grid with the most information), ``parameters`` (name → ``smallest``: size whose expected
        gain is `named_gain_nats`, None if none has it; ``unit``, ``plausible``, ``ratio`` of the two) and
        ``confused_with`` (label → correlation); ``failed``: label of an effect whose hooks fail → message.

    Raises
    ------
    InputError
        The mission cannot be predicted.
    """
    require_prediction_inputs(mission)
    progress("reconstructing")
    case = load_case(mission)
    progress("comparing model and measurements")
    model = linearize(case)
    failed: dict[str, str] = {}
    informative: list[tuple[EffectJacobian, Array]] = []
    for instance in candidate_instances(case, candidates):
        progress(f"{instance.label}: computing its Jacobian")
        best = _most_informative(model, scan_jacobians(model, [instance], case.end, failed))
        if best is not None and instance.label not in failed:
            informative.append(best)
    settings = case.settings
    entries = [_entry(j, x, settings.named_gain_nats) for j, x in informative]
    bases = [_basis(x * j.sigma) for j, x in informative]
    for i, entry in enumerate(entries):
        for k in range(len(entries)):
            similarity = _largest_correlation(bases[i], bases[k]) if i != k else 0.0
            if similarity > settings.same_correlation:
                entry["confused_with"][informative[k][0].instance.label] = similarity
    return {
        "mission": mission.name,
        "required_gain": settings.named_gain_nats,
        "in_model": sorted(a.label for a in case.effects),
        "effects": entries,
        "failed": failed,
    }


def _most_informative(model: LinearizedModel, places: Iterable[EffectJacobian]) -> tuple[EffectJacobian, Array] | None:
    """The place of an effect where its plausible size has the most information, and its white columns there."""
    best = None
    for jacobian in places:
        x = model.stated_noise_filter(jacobian.rows, jacobian.initial_mean)
        information = float(np.sum((x * jacobian.sigma) ** 2))
        if best is None or information > best[2]:
            best = jacobian, x, information
    return None if best is None else best[:2]


def _entry(jacobian: EffectJacobian, x: Array, gain: float) -> dict[str, Any]:
    instance = jacobian.instance
    units = {q.name: q.unit for q in instance.effect.parameters}
    parameters = {}
    for name, sigma, column in zip(jacobian.names, jacobian.sigma, x.T, strict=True):
        smallest = smallest_size(float(column @ column), float(sigma), gain)
        parameters[name] = {
            "smallest": smallest if np.isfinite(smallest) else None,
            "unit": units[name],
            "plausible": float(sigma),
            "ratio": smallest / float(sigma) if np.isfinite(smallest) else None,
        }
    places = {q.name: instance.values[q.name] for q in instance.effect.places}
    return {
        "effect": instance.name,
        "imu": instance.imu,
        "places": places,
        "parameters": parameters,
        "confused_with": {},
    }


def _basis(scaled: Array) -> Array:
    """Orthonormal directions of white columns times plausible sizes that exceed the noise, ``(R, r)``."""
    u, size, _ = np.linalg.svd(scaled, full_matrices=False)
    return np.asarray(u[:, size > 1.0])


def _largest_correlation(a: Array, b: Array) -> float:
    """Largest correlation of two column spaces: cosine of the smallest principal angle."""
    if not a.shape[1] or not b.shape[1]:
        return 0.0
    return float(min(np.linalg.svd(a.T @ b, compute_uv=False)[0], 1.0))
