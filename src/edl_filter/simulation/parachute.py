"""The parachute as the simulator knows it: drag along the wind at its attachment."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: Drag coefficient of a disk-gap-band parachute against Mach number, on its nominal area.
DRAG_MACH = (0.0, 0.6, 0.9, 1.1, 1.4, 1.8, 2.4)
DRAG_COEFFICIENT = (0.41, 0.42, 0.44, 0.40, 0.45, 0.50, 0.47)


@dataclass(frozen=True)
class Parachute:
    """A canopy that drags along the wind at its attachment.

    Attributes
    ----------
    diameter : float
        Nominal, m; drag coefficients refer to pi D0²/4.
    arm : float
        Distance of the attachment behind the nominal centre of mass, m.
    inflation : float
        Time in which the drag grows evenly from nothing to all of it, s.
    mach, drag_coefficient : (N,) arrays
        Linear between nodes, held at the edges.
    """

    diameter: float
    arm: float = 1.6
    inflation: float = 0.6
    mach: tuple[float, ...] = DRAG_MACH
    drag_coefficient: tuple[float, ...] = DRAG_COEFFICIENT

    @property
    def area(self) -> float:
        """Nominal area, m²."""
        return np.pi / 4.0 * self.diameter**2
