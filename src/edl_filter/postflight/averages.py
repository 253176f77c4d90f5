"""Average differences between the three kinds of coefficients, and what they say (thesis tables 7.1 to 7.6)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from edl_filter.postflight.coefficients import FlightCoefficients
from edl_filter.postflight.comparison import Combination, DatabaseCoefficients
from edl_filter.postflight.windows import Window

Array = NDArray[np.float64]

#: Coefficient → name of the flight's method, and the coefficient that the combination went through.
METHODS = {"CN": ("accels", "Cm"), "CY": ("accels", "Cn"), "Cm": ("gyros", "CN"), "Cn": ("gyros", "CY")}
#: Coefficients that no combination gives: the flight's method.
ALONE = {"CA": "accels", "Cl": "gyros"}
#: The database's uncertainty is too wide when it is this many times what the flight supports (thesis section 7.1).
_WIDE = 10.0


@dataclass(frozen=True)
class Difference:
    """Mean of one difference over one window.

    Attributes
    ----------
    window, coefficient : str
    pair : str
        ``IMU-accels`` (database less flight), ``IMU-Cm`` (database less combination), ``accels-Cm``, and so on as in
        the thesis: IMU is the database at the reconstructed angles.
    mean : float
    mean_sigma : float
        One sigma of the mean: noise averaged over batches, and errors common to the window.
    rms : float
        Of the difference.
    three_sigma : float
        The database's, mean over the window.
    percent : float
        ``mean`` in percent of it.
    samples : int
        That went into the mean.
    """

    window: str
    coefficient: str
    pair: str
    mean: float
    mean_sigma: float
    rms: float
    three_sigma: float
    percent: float
    samples: int


@dataclass(frozen=True)
class Verdict:
    """What a window says of one coefficient's uncertainty.

    Attributes
    ----------
    window, coefficient : str
    density : str
        ``flight`` or ``preflight``: with which the flight's coefficient was made.
    mean, mean_sigma, rms, three_sigma : float
        As in `Difference`, database less flight.
    within : bool
        They differ on average by less than the database's 3 sigma.
    wide : bool
        That is ten times what the flight supports, or more.
    ratio : float
        The database's 3 sigma over what the flight supports: the larger of the mean difference and three sigma of the
        mean.
    sentence : str
    """

    window: str
    coefficient: str
    density: str
    mean: float
    mean_sigma: float
    rms: float
    three_sigma: float
    within: bool
    wide: bool
    ratio: float
    sentence: str


def average_differences(
    time: Array,
    database: DatabaseCoefficients,
    flight: FlightCoefficients,
    forces: Combination,
    moments: Combination,
    windows: Sequence[Window],
    batch: NDArray[np.int64],
    *,
    axial: bool = False,
) -> list[Difference]:
    """Tables 7.1 to 7.6, and rows of database less flight for Cl and CA, which have no combination coefficient.

    Parameters
    ----------
    time : (N,) array
        s.
    database, flight, forces, moments
        The three kinds; `forces` gives Cm and Cn, `moments` CN and CY.
    windows : sequence of Window
    batch : (N,) array
        Samples in a smoothing batch: noise is independent from one batch to the next.
    axial : bool
        With CA, which says nothing where the density was made with the database's.
    """
    rows = []
    for window in windows:
        inside = window.mask(time)
        for name, method in ALONE.items():
            if name == "CA" and not axial:
                continue
            rows.append(
                _row(
                    window.name,
                    name,
                    f"IMU-{method}",
                    inside,
                    database.value[name] - flight.value[name],
                    flight.noise[name],
                    np.hypot(flight.systematic[name], database.angle_sigma[name]),
                    database.three_sigma[name],
                    batch,
                )
            )
        for name, (method, through) in METHODS.items():
            imu, measured = database.value[name], flight.value[name]
            through_it = moments if name in ("CN", "CY") else forces
            combined = through_it.value[name]
            angle = database.angle_sigma[name]
            flown, combine = (flight.noise[name], flight.systematic[name]), (through_it.noise, through_it.systematic)
            nothing = np.zeros(len(time))
            for pair, difference, one, other in (
                (f"IMU-{method}", imu - measured, flown, (nothing, angle)),
                (f"IMU-{through}", imu - combined, combine, (nothing, angle)),
                (f"{method}-{through}", measured - combined, flown, combine),
            ):
                noise, common = np.hypot(one[0], other[0]), np.hypot(one[1], other[1])
                rows.append(
                    _row(window.name, name, pair, inside, difference, noise, common, database.three_sigma[name], batch)
                )
    return rows


def verdicts(differences: Sequence[Difference], preflight: Sequence[Difference] = ()) -> list[Verdict]:
    """One sentence per coefficient and window, from database less flight.

    Parameters
    ----------
    differences : sequence of Difference
        With the flight's atmosphere.
    preflight : sequence of Difference
        With the preflight atmosphere: its CA is judged.
    """
    rows = [("flight", r) for r in differences]
    rows += [("preflight", r) for r in preflight if r.coefficient == "CA"]
    return [_verdict(density, r) for density, r in rows if r.samples and r.pair in ("IMU-accels", "IMU-gyros")]


def _verdict(density: str, row: Difference) -> Verdict:
    supported = max(abs(row.mean), 3.0 * row.mean_sigma)
    ratio = row.three_sigma / supported if supported > 0.0 else float("inf")
    within, wide = abs(row.mean) < row.three_sigma, ratio >= _WIDE
    which = f"{row.coefficient} of the database and of the flight"
    if density == "preflight":
        which += ", with the preflight density,"
    side = "less" if within else "more"
    text = (
        f"{row.window}: {which} differ by {row.mean:+.2g} ± {row.mean_sigma:.1g} on average (rms {row.rms:.2g}), "
        f"{side} than the database's 3 sigma of {row.three_sigma:.2g} ({abs(row.percent):.0f} %)."
    )
    if not within and abs(row.mean) < 3.0 * row.mean_sigma:
        text += " The flight's own uncertainty is as large."
    if wide:
        text += f" That uncertainty is {ratio:.0f} times what this flight supports."
    numbers = (row.mean, row.mean_sigma, row.rms, row.three_sigma)
    return Verdict(row.window, row.coefficient, density, *numbers, within, wide, ratio, text)


def _row(
    window: str,
    name: str,
    pair: str,
    inside: NDArray[np.bool_],
    difference: Array,
    noise: Array,
    common: Array,
    limit: Array,
    batch: NDArray[np.int64],
) -> Difference:
    use = inside & np.isfinite(difference) & np.isfinite(noise)
    n = int(use.sum())
    if not n:
        nan = float("nan")
        return Difference(window, name, pair, nan, nan, nan, nan, nan, 0)
    d = difference[use]
    batches = max(1.0, float(np.sum(1.0 / batch[use])))
    random = np.sqrt(np.mean(noise[use] ** 2) / batches)
    three = float(np.mean(limit[use]))
    mean = float(np.mean(d))
    return Difference(
        window=window,
        coefficient=name,
        pair=pair,
        mean=mean,
        mean_sigma=float(np.hypot(random, np.mean(common[use]))),
        rms=float(np.sqrt(np.mean(d**2))),
        three_sigma=three,
        percent=100.0 * mean / three,
        samples=n,
    )
