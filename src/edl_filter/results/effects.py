"""Effects of a run: what their refit adds to a reconstruction, and estimates and stated values as plain data."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from edl_filter.effects.base import EffectInstance
from edl_filter.mission import Mission
from edl_filter.pipeline.reconstruct import Reconstruction


@dataclass(frozen=True)
class RefitSummary:
    """Result of the refit of a mission's effects, and of the comparison of model and measurement.

    Attributes
    ----------
    sigma : dict
        Effect → parameter → one sigma of its estimate; empty where nothing was refitted.
    residuals : dict
        Channel → ``overall`` and every regime → normalised RMS; empty where nothing was compared.
    """

    sigma: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    residuals: Mapping[str, Mapping[str, float]] = field(default_factory=dict)


def effects_content(reconstruction: Reconstruction, sigma: Mapping[str, Mapping[str, float]]) -> dict[str, Any]:
    """Effects of a reconstruction by label.

    Parameters
    ----------
    reconstruction : Reconstruction
        With the effects at their estimates.
    sigma : mapping
        Label of the effect → parameter → one sigma, of parameters that were refitted.

    Returns
    -------
    dict
        Label → ``imu``, ``fixed``, and ``parameters``: name → ``estimate``, ``sigma`` (None where it was not refitted),
        ``unit``, ``start`` (the value that the mission states). From the second effect of
        a label on, the label has a number.
    """
    stated = {a.key: a.values for a in reconstruction.mission.active_effects()}
    content: dict[str, Any] = {}
    for label, a in _by_label(reconstruction.effects):
        start, sigmas = stated.get(a.key, {}), sigma.get(a.label, {})
        parameters = {
            q.name: {
                "estimate": a.values[q.name], "sigma": sigmas.get(q.name), "unit": q.unit, "start": start.get(q.name),
            }
            for q in a.effect.parameters
        }  # fmt: skip
        content[label] = {"imu": a.imu, "fixed": a.fixed, "parameters": parameters}
    return content


def effects_at_estimates(mission: Mission, content: Mapping[str, Any]) -> tuple[EffectInstance, ...]:
    """A mission's effects at the estimates of `effects_content`."""
    instances: list[EffectInstance] = []
    for label, a in _by_label(mission.active_effects()):
        parameters = content.get(label, {}).get("parameters", {})
        estimates = {q: v["estimate"] for q, v in parameters.items() if v["estimate"] is not None}
        instances.append(replace(a, values=a.values | estimates))
    return tuple(instances)


def _by_label(instances: Iterable[EffectInstance]) -> list[tuple[str, EffectInstance]]:
    """Each instance with its label in a file."""
    counts: Counter[str] = Counter()
    labelled: list[tuple[str, EffectInstance]] = []
    for a in instances:
        counts[a.label] += 1
        labelled.append((a.label if counts[a.label] == 1 else f"{a.label} ({counts[a.label]})", a))
    return labelled
