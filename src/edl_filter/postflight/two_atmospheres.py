"""What the choice of the atmosphere changes, in percent of the database's uncertainty (thesis figures 4.1 to 6.3)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from edl_filter.postflight.atmosphere import FlightAtmosphere
from edl_filter.postflight.coefficients import FlightCoefficients
from edl_filter.postflight.comparison import DatabaseCoefficients
from edl_filter.postflight.windows import Window

Array = NDArray[np.float64]

_DATABASE = ("CA", "CN", "CY", "Cm", "Cn")


@dataclass(frozen=True)
class AtmosphereDifferences:
    """With the flight's atmosphere less with the preflight one, ``(N,)`` each, in percent.

    Attributes
    ----------
    atmosphere : dict
        ``mach`` and ``knudsen``, of the preflight value.
    database : dict
        CA, CN, CY, Cm, Cn of the database at the reconstructed angles, of its 3 sigma.
    flight : dict
        CA, CN, CY, Cl, Cm, Cn of the flight, of the database's 3 sigma. CA with the flight's density is the database's,
        for that density was made with it.
    """

    atmosphere: dict[str, Array]
    database: dict[str, Array]
    flight: dict[str, Array]

    def items(self) -> list[tuple[str, str, Array]]:
        """What it is of, which quantity, and values."""
        parts = (("atmosphere", self.atmosphere), ("database", self.database), ("flight", self.flight))
        return [(of, name, values) for of, part in parts for name, values in part.items()]


@dataclass(frozen=True)
class Change:
    """One quantity of `AtmosphereDifferences` over one window: percent, and samples that went in.

    ``largest`` keeps its sign.
    """

    window: str
    of: str
    quantity: str
    mean: float
    rms: float
    largest: float
    samples: int


def atmosphere_differences(
    atmospheres: tuple[FlightAtmosphere, FlightAtmosphere],
    databases: tuple[DatabaseCoefficients, DatabaseCoefficients],
    flights: tuple[FlightCoefficients, FlightCoefficients],
) -> AtmosphereDifferences:
    """Differences sample by sample; each pair is the flight's atmosphere, then the preflight one.

    The 3 sigma is that with the flight's atmosphere.
    """
    three = databases[0].three_sigma

    def percent(values: tuple[dict[str, Array], dict[str, Array]], name: str) -> Array:
        return 100.0 * (values[0][name] - values[1][name]) / three[name]

    flown, expected = atmospheres
    looked_up = databases[0].value, databases[1].value
    measured = flights[0].value, flights[1].value
    return AtmosphereDifferences(
        atmosphere={
            "mach": 100.0 * (flown.mach / expected.mach - 1.0),
            "knudsen": 100.0 * (flown.knudsen / expected.knudsen - 1.0),
        },
        database={name: percent(looked_up, name) for name in _DATABASE},
        flight={name: percent(measured, name) for name in measured[0]},
    )


def changes(time: Array, differences: AtmosphereDifferences, windows: Sequence[Window]) -> list[Change]:
    """Mean, rms and largest of every difference over every window; NaN where it has no sample."""
    rows = []
    for window in windows:
        inside = window.mask(time)
        for of, name, values in differences.items():
            v = values[inside & np.isfinite(values)]
            if not len(v):
                rows.append(Change(window.name, of, name, np.nan, np.nan, np.nan, 0))
                continue
            largest = float(v[np.argmax(np.abs(v))])
            rows.append(Change(window.name, of, name, float(v.mean()), float(np.sqrt(np.mean(v**2))), largest, len(v)))
    return rows
