"""Effects in the planet's gravity field."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from edl_filter.effects.base import Effect
from edl_filter.effects.parameters import Parameter, Values

if TYPE_CHECKING:
    from edl_filter.planet import Planet


class GravityOblateness(Effect):
    """Added second zonal coefficient."""

    name = "gravity_oblateness"
    family = "planet"
    summary = "oblateness of the gravity field: J2 added to the mission's"
    shows = (
        "No residual in the accelerometers, which do not measure gravity: errors of velocity and position grow "
        "smoothly to some hundred metres, in altimeter, landing site and the gravity at rest."
    )
    source = "Thomas (2011), eq. 3.5; size: J2 of Mars is 1.96e-3 (general knowledge)"
    parameters = (Parameter("J2", "", "second zonal coefficient, added", 2e-3, low=-0.05, high=0.05),)

    def gravity(self, p: Values, planet: Planet) -> Planet:
        """The planet with J2 added."""
        return replace(planet, j2=planet.j2 + p["J2"])


EFFECTS = (GravityOblateness,)
