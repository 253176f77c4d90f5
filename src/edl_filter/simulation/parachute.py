"""The parachute of the simulator: drag along the air-relative velocity at its attachment."""

from __future__ import annotations

from dataclasses import dataclass

from edl_filter.aero.conventions import reference_area

#: Drag coefficient of a disk-gap-band parachute against Mach number, on its nominal area.
DRAG_MACH = (0.0, 0.6, 0.9, 1.1, 1.4, 1.8, 2.4)
DRAG_COEFFICIENT = (0.41, 0.42, 0.44, 0.40, 0.45, 0.50, 0.47)


@dataclass(frozen=True)
class Parachute:
    """A canopy whose drag acts along the air-relative velocity at its attachment.

    Attributes
    ----------
    diameter : float
        Nominal, m; drag coefficients refer to pi D0²/4.
    arm : float
        Distance of the attachment behind the nominal centre of mass, m.
    inflation : float
        Time in which the drag grows linearly from zero to its full value, s.
    mach, drag_coefficient : tuples of float
        Drag coefficient against Mach number; linear between nodes, held at the edges.
    """

    diameter: float
    arm: float = 1.6
    inflation: float = 0.6
    mach: tuple[float, ...] = DRAG_MACH
    drag_coefficient: tuple[float, ...] = DRAG_COEFFICIENT

    @property
    def area(self) -> float:
        """Nominal area, m²."""
        return reference_area(self.diameter)
