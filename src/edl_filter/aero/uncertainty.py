"""Three-sigma uncertainties of the mission databases (thesis tables 11.3 to 11.5).

The tables give one number above Mach 10 (hypersonic) and one below Mach 5 (supersonic) and nothing between:
here the two are joined **linearly in Mach between 5 and 10**. From the continuum limit in Knudsen number
upwards the transitional and free-molecular numbers hold. CA's is a fraction of CA, the rest are additive.

The thesis's text lost several numbers; ``mevad_uncertainties.csv`` says for each what it rests on. Cl is known
for Phoenix's continuum only, to a low confidence, and stands for MER and for rarefied flow as well.
"""

from __future__ import annotations

import csv
from dataclasses import dataclass
from functools import lru_cache
from importlib.resources import files
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from edl_filter.aero.grid import Array
from edl_filter.errors import InputError

Family = Literal["MER", "Phoenix"]
#: Mach numbers between which the supersonic numbers go over into the hypersonic ones.
SUPERSONIC_MACH, HYPERSONIC_MACH = 5.0, 10.0
#: Knudsen number from which the rarefied numbers hold.
CONTINUUM_LIMIT = 1e-3

_REGIMES = ("hypersonic", "supersonic", "transitional")
_COEFFICIENTS = {"CA": "CA", "CN CY": "CN", "Cm Cn": "Cm"}


@dataclass(frozen=True, eq=False)
class ThreeSigma:
    """Three-sigma uncertainties, additive, shaped like the samples.

    Attributes
    ----------
    ca, cn, cm, cl : arrays
        Of CA; of CN and CY; of Cm and Cn; of Cl.
    """

    ca: Array
    cn: Array
    cm: Array
    cl: Array


def three_sigma(
    family: str, mach: ArrayLike, knudsen: ArrayLike, ca: ArrayLike, continuum_limit: float = CONTINUUM_LIMIT
) -> ThreeSigma:
    """Uncertainties of a vehicle family's database along a flight.

    Parameters
    ----------
    family : "MER" or "Phoenix"
    mach, knudsen, ca : array_like
        Of one shape.
    continuum_limit : float
        Knudsen number from which the rarefied numbers hold.

    Raises
    ------
    InputError
        No such family.
    """
    if family not in get_args(Family):
        raise InputError(f"uncertainties: there is no family '{family}'; accepted are {', '.join(get_args(Family))}.")
    mach, knudsen, ca = np.broadcast_arrays(*(np.asarray(x, float) for x in (mach, knudsen, ca)))
    hypersonic = np.clip((mach - SUPERSONIC_MACH) / (HYPERSONIC_MACH - SUPERSONIC_MACH), 0.0, 1.0)
    rarefied = knudsen > continuum_limit
    known = _table()

    def along(coefficient: str) -> Array:
        high, low, thin = (known[family, regime, coefficient] for regime in _REGIMES)
        return np.where(rarefied, thin, low + hypersonic * (high - low))

    cl = np.full(ca.shape, known["Phoenix", "hypersonic", "Cl"])
    return ThreeSigma(along("CA") * np.abs(ca), along("CN"), along("Cm"), cl)


@lru_cache(maxsize=1)
def _table() -> dict[tuple[str, str, str], float]:
    """(family, regime, coefficient) → three sigma; percents as fractions."""
    text = (files("edl_filter") / "data" / "mevad_uncertainties.csv").read_text(encoding="utf-8")
    known: dict[tuple[str, str, str], float] = {}
    for row in csv.DictReader(line for line in text.splitlines() if not line.startswith("#")):
        value, percent = row["three_sigma"].removesuffix(" %"), row["three_sigma"].endswith("%")
        for family in row["vehicle"].split(" and "):
            regime = next(r for r in _REGIMES if row["regime"].startswith(r))
            coefficient = _COEFFICIENTS.get(row["coefficient"], row["coefficient"])
            known[family, regime, coefficient] = float(value) / (100.0 if percent else 1.0)
    return known
