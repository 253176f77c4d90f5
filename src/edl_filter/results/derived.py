"""What a result adds to a reconstruction: the refit of its effects, and quantities derived from its trajectory."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from edl_filter.pipeline.reconstruct import Reconstruction
from edl_filter.postflight.airdata import AirData, air_data
from edl_filter.postflight.derive import PostflightResult
from edl_filter.postflight.events import Event, events
from edl_filter.postflight.flight import derive_flight


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


@dataclass(frozen=True)
class Derived:
    """Quantities derived from a reconstruction that are used more than once.

    Attributes
    ----------
    air : AirData
        Along the trajectory.
    events : dict
        Name → `Event`.
    postflight : PostflightResult or None
        Atmosphere and coefficients, where the mission names an aerodynamic database.
    """

    air: AirData
    events: dict[str, Event]
    postflight: PostflightResult | None


def derive(reconstruction: Reconstruction) -> Derived:
    """Air data along the trajectory, events, atmosphere and coefficients."""
    r = reconstruction
    air = air_data(r.trajectory, r.planet, r.atmosphere, r.effects)
    return Derived(air, events(r, air), derive_flight(r, air))
