"""Effect of the choice of the atmosphere, in percent of the database's uncertainty (thesis figures 4.1 to 6.3)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from edl_filter.postflight.atmosphere_case import AtmosphereCase
from edl_filter.postflight.windows import Window
from edl_filter.types import Array

_DATABASE = ("CA", "CN", "CY", "Cm", "Cn")


@dataclass(frozen=True)
class AtmosphereDifferences:
    """Values with the flight's atmosphere minus those with the preflight one, ``(N,)`` each, in percent.

    Attributes
    ----------
    atmosphere : dict
        ``mach`` and ``knudsen``, in percent of the preflight value.
    database : dict
        CA, CN, CY, Cm, Cn of the database at the reconstructed angles, in percent of its 3 sigma.
    flight : dict
        CA, CN, CY, Cl, Cm, Cn of the flight, in percent of the database's 3 sigma. CA with the flight's density is the
        database's, from which that density is computed.
    """

    atmosphere: dict[str, Array]
    database: dict[str, Array]
    flight: dict[str, Array]

    def items(self) -> list[tuple[str, str, Array]]:
        """Rows of kind (``atmosphere``, ``database`` or ``flight``), quantity, and values ``(N,)`` in percent."""
        kinds = (("atmosphere", self.atmosphere), ("database", self.database), ("flight", self.flight))
        return [(of, name, values) for of, quantities in kinds for name, values in quantities.items()]


@dataclass(frozen=True)
class Change:
    """Average of one quantity of `AtmosphereDifferences` over one window.

    Attributes
    ----------
    window, of, quantity : str
        Name of the window; kind and quantity as in `AtmosphereDifferences.items`.
    mean, rms, largest : float
        Percent; ``largest`` is the value of largest magnitude, with its sign.
    samples : int
        Number of samples in the mean.
    """

    window: str
    of: str
    quantity: str
    mean: float
    rms: float
    largest: float
    samples: int


def atmosphere_differences(flight: AtmosphereCase, preflight: AtmosphereCase) -> AtmosphereDifferences:
    """Differences at each sample; the 3 sigma is that with the flight's atmosphere."""
    three = flight.database.three_sigma

    def percent(first: dict[str, Array], second: dict[str, Array], name: str) -> Array:
        return 100.0 * (first[name] - second[name]) / three[name]

    database = flight.database.value, preflight.database.value
    coefficients = flight.coefficients.value, preflight.coefficients.value
    return AtmosphereDifferences(
        atmosphere={
            "mach": 100.0 * (flight.atmosphere.mach / preflight.atmosphere.mach - 1.0),
            "knudsen": 100.0 * (flight.atmosphere.knudsen / preflight.atmosphere.knudsen - 1.0),
        },
        database={name: percent(*database, name) for name in _DATABASE},
        flight={name: percent(*coefficients, name) for name in coefficients[0]},
    )


def changes(time: Array, differences: AtmosphereDifferences, windows: Sequence[Window]) -> list[Change]:
    """Mean, rms and largest value of every difference over every window; NaN where a window has no sample.

    Parameters
    ----------
    time : (N,) array
        s.
    differences : AtmosphereDifferences
        At the same samples.
    windows : sequence of Window
        Windows of the averages.

    Returns
    -------
    list of Change
    """
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
