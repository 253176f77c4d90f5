"""Effects of a run as plain data: their estimates, and the values that the mission states."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any

from edl_filter.effects.base import EffectInstance
from edl_filter.mission import Mission
from edl_filter.pipeline.reconstruct import Reconstruction


def effects_content(reconstruction: Reconstruction, sigma: Mapping[str, Mapping[str, float]]) -> dict[str, Any]:
    """Effects of a reconstruction by name.

    Parameters
    ----------
    reconstruction : Reconstruction
        With the effects at their estimates.
    sigma : mapping
        Effect → parameter → one sigma, of parameters that were refitted.

    Returns
    -------
    dict
        Name → ``imu``, ``fixed``, and ``parameters``: name → ``estimate``, ``sigma`` (None where it was not refitted),
        ``unit``, ``start`` (the value that the mission states). An effect that is in the model more than once has its
        IMU in the name from the second time on.
    """
    stated = {a.key: a.values for a in reconstruction.mission.active_effects()}
    content: dict[str, Any] = {}
    for name, a in _by_name(reconstruction.effects):
        start, sigmas = stated.get(a.key, {}), sigma.get(a.name, {})
        parameters = {
            q.name: {
                "estimate": a.values[q.name], "sigma": sigmas.get(q.name), "unit": q.unit, "start": start.get(q.name),
            }
            for q in a.effect.parameters
        }  # fmt: skip
        content[name] = {"imu": a.imu, "fixed": a.fixed, "parameters": parameters}
    return content


def effects_at_estimates(mission: Mission, content: Mapping[str, Any]) -> tuple[EffectInstance, ...]:
    """A mission's effects at the estimates of `effects_content`."""
    instances: list[EffectInstance] = []
    for name, a in _by_name(mission.active_effects()):
        parameters = content.get(name, {}).get("parameters", {})
        estimates = {q: v["estimate"] for q, v in parameters.items() if v["estimate"] is not None}
        instances.append(replace(a, values=a.values | estimates))
    return tuple(instances)


def _by_name(instances: Iterable[EffectInstance]) -> list[tuple[str, EffectInstance]]:
    """Each instance with its name in a file: that of the effect, from the second of a name on with the IMU."""
    named: list[tuple[str, EffectInstance]] = []
    for a in instances:
        repeated = any(a.name == name for name, _ in named)
        # not `a.label`, which is the name alone for an instance in the driving IMU
        named.append((f"{a.name} in {a.imu}" if repeated else a.name, a))
    return named
