"""Three-sigma uncertainties of the mission databases (thesis tables 11.3 to 11.5).

Input: vehicle family, Mach numbers, Knudsen numbers and CA. Method: the tables have one number above Mach 10
(hypersonic) and one below Mach 5 (supersonic), and none in between; this module interpolates **linearly in Mach number
between 5 and 10**. Above the continuum limit in Knudsen number the transitional and free-molecular numbers apply. The
uncertainty of CA is a fraction of CA, the others are additive. Output: `ThreeSigma`.

Several numbers are missing in the thesis's text; ``mevad_uncertainties.csv`` states the source of each. The
uncertainty of Cl is printed for Phoenix only (section 7.3, and its exponent in table 11.4); it is used for MER and for
rarefied flow too. How far an error is common to different flows says `aero.discrepancy`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from edl_filter.aero.regimes import CONTINUUM_KNUDSEN
from edl_filter.errors import InputError
from edl_filter.io.csv_table import package_data, read_records
from edl_filter.types import Array

Family = Literal["MER", "Phoenix"]
#: Mach numbers between which the supersonic and the hypersonic numbers are interpolated.
SUPERSONIC_MACH, HYPERSONIC_MACH = 5.0, 10.0

_REGIMES = ("hypersonic", "supersonic", "transitional")
_COLUMNS = ("vehicle", "regime", "coefficient", "three_sigma")
_COEFFICIENTS = {"CA": "CA", "CN CY": "CN", "Cm Cn": "Cm"}


@dataclass(frozen=True, eq=False)
class ThreeSigma:
    """Additive three-sigma uncertainties of coefficients.

    Attributes
    ----------
    ca, cn, cm, cl : (...) arrays
        Of CA; of CN and CY; of Cm and Cn; of Cl.
    """

    ca: Array
    cn: Array
    cm: Array
    cl: Array


def three_sigma(
    family: str, mach: ArrayLike, knudsen: ArrayLike, ca: ArrayLike, continuum_limit: float = CONTINUUM_KNUDSEN
) -> ThreeSigma:
    """Uncertainties of the database of a vehicle family.

    Parameters
    ----------
    family : "MER" or "Phoenix"
        Vehicle family.
    mach, knudsen, ca : (...) arrays
        Mach number, Knudsen number based on the diameter, and CA; they broadcast.
    continuum_limit : float
        Knudsen number above which the rarefied numbers apply.

    Returns
    -------
    ThreeSigma

    Raises
    ------
    InputError
        No such family.
    """
    if family not in get_args(Family):
        raise InputError(f"uncertainties: there is no family '{family}'; accepted are {', '.join(get_args(Family))}.")
    mach, knudsen, ca = np.broadcast_arrays(*(np.asarray(x, float) for x in (mach, knudsen, ca)))
    hypersonic_weight = np.clip((mach - SUPERSONIC_MACH) / (HYPERSONIC_MACH - SUPERSONIC_MACH), 0.0, 1.0)
    rarefied = knudsen > continuum_limit
    table = _table()

    def interpolated(coefficient: str) -> Array:
        hypersonic, supersonic, transitional = (table[family, regime, coefficient] for regime in _REGIMES)
        return np.where(rarefied, transitional, supersonic + hypersonic_weight * (hypersonic - supersonic))

    cl = np.full(ca.shape, table["Phoenix", "hypersonic", "Cl"])
    return ThreeSigma(interpolated("CA") * np.abs(ca), interpolated("CN"), interpolated("Cm"), cl)


@lru_cache(maxsize=1)
def _table() -> dict[tuple[str, str, str], float]:
    """(family, regime, coefficient) → three sigma; percentages are converted to fractions."""
    table: dict[tuple[str, str, str], float] = {}
    for row in read_records(package_data("mevad_uncertainties.csv"), _COLUMNS):
        value, percent = row["three_sigma"].removesuffix(" %"), row["three_sigma"].endswith("%")
        for family in row["vehicle"].split(" and "):
            regime = next(name for name in _REGIMES if row["regime"].startswith(name))
            coefficient = _COEFFICIENTS.get(row["coefficient"], row["coefficient"])
            table[family, regime, coefficient] = float(value) / (100.0 if percent else 1.0)
    return table
