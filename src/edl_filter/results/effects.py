"""Effects of a run as plain data: estimates beside what the mission stated."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from edl_filter.effects.effect import Active
    from edl_filter.mission import Mission
    from edl_filter.reconstruction import Reconstruction


@dataclass(frozen=True)
class Judged:
    """What the comparison of model and measurement adds to a reconstruction.

    Attributes
    ----------
    sigma : dict
        Effect → parameter → one sigma of its estimate; empty where nothing was refitted.
    residuals : dict
        Channel → ``overall`` and every regime → normalised RMS; empty where nothing was compared.
    """

    sigma: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    residuals: Mapping[str, Mapping[str, float]] = field(default_factory=dict)


def effects(reconstruction: Reconstruction, sigma: Mapping[str, Mapping[str, float]]) -> dict[str, Any]:
    """Effects of a reconstruction by name.

    Returns
    -------
    dict
        Name → ``imu``, ``fixed``, and ``parameters``: name → ``estimate``, ``sigma`` (None where it was not fitted),
        ``unit``, ``start`` (what the mission states). An effect that stands twice has its IMU behind its name.
    """
    stated = {_key(a): a.values for a in reconstruction.mission.active_effects()}
    told: dict[str, Any] = {}
    for a in reconstruction.effects:
        start, known = stated.get(_key(a), {}), sigma.get(a.name, {})
        parameters = {
            q.name: {
                "estimate": a.values[q.name], "sigma": known.get(q.name), "unit": q.unit, "start": start.get(q.name),
            }
            for q in a.effect.parameters
        }  # fmt: skip
        name = f"{a.name} in {a.imu}" if a.name in told else a.name
        told[name] = {"imu": a.imu, "fixed": a.fixed, "parameters": parameters}
    return told


def restored(mission: Mission, told: Mapping[str, Any]) -> tuple[Active, ...]:
    """A mission's effects at the estimates of `effects`."""
    found: list[Active] = []
    seen: set[str] = set()
    for a in mission.active_effects():
        name = f"{a.name} in {a.imu}" if a.name in seen else a.name
        seen.add(name)
        parameters = told.get(name, {}).get("parameters", {})
        estimates = {q: v["estimate"] for q, v in parameters.items() if v["estimate"] is not None}
        found.append(replace(a, values=a.values | estimates))
    return tuple(found)


def _key(active: Active) -> tuple[str, str | None]:
    return active.name, active.imu
