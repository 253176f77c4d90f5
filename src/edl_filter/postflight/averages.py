"""Average differences between the three kinds of coefficients, and the verdicts on them (thesis tables 7.1 to 7.6)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from edl_filter.postflight.coefficients import FlightCoefficients
from edl_filter.postflight.comparison import Combination, DatabaseCoefficients
from edl_filter.postflight.windows import Window
from edl_filter.types import Array, BoolArray, IntArray

#: Coefficient → name of the flight's method, and the coefficient from which the combination is computed.
METHODS = {"CN": ("accels", "Cm"), "CY": ("accels", "Cn"), "Cm": ("gyros", "CN"), "Cn": ("gyros", "CY")}
#: Coefficients that have no combination: the flight's method.
ALONE = {"CA": "accels", "Cl": "gyros"}
#: The database's uncertainty is too wide if it is this many times that which the flight supports (thesis section 7.1).
_WIDE = 10.0


@dataclass(frozen=True)
class Difference:
    """Mean of one difference over one window.

    Attributes
    ----------
    window, coefficient : str
    pair : str
        ``IMU-accels`` (database minus flight), ``IMU-Cm`` (database minus combination), ``accels-Cm``, and so on as in
        the thesis: IMU is the database at the reconstructed angles.
    mean : float
    mean_sigma : float
        One sigma of the mean: noise averaged over batches, and errors common to the window.
    rms : float
        Root mean square of the difference.
    three_sigma : float
        The database's 3 sigma, mean over the window.
    percent : float
        ``mean`` in percent of ``three_sigma``.
    samples : int
        Number of samples in the mean.
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
    """Judgement of one coefficient's uncertainty in one window.

    Attributes
    ----------
    window, coefficient : str
    density : str
        ``flight`` or ``preflight``: density from which the flight's coefficient is computed.
    mean, mean_sigma, rms, three_sigma : float
        As in `Difference`, database minus flight.
    within : bool
        The mean difference is smaller than the database's 3 sigma.
    wide : bool
        The database's 3 sigma is ten times the uncertainty that the flight supports, or more.
    ratio : float
        The database's 3 sigma over the uncertainty that the flight supports, which is the larger of the mean difference
        and three sigma of the mean.
    sentence : str
        The judgement as text.
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
    batch: IntArray,
    *,
    axial: bool = False,
) -> list[Difference]:
    """Tables 7.1 to 7.6, and rows of database minus flight for Cl and CA, which have no combination coefficient.

    Parameters
    ----------
    time : (N,) array
        s.
    database : DatabaseCoefficients
        At the reconstructed angles.
    flight : FlightCoefficients
        From forces and moments.
    forces, moments : Combination
        Combination coefficients: `forces` has Cm and Cn, `moments` CN and CY.
    windows : sequence of Window
        Windows of the averages.
    batch : (N,) integer array
        Samples in a smoothing batch: noise is independent from one batch to the next.
    axial : bool
        With rows for CA, which carries no information where the density is computed from the database's CA.

    Returns
    -------
    list of Difference
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
            combination = moments if name in ("CN", "CY") else forces
            combined = combination.value[name]
            # each as its noise and its common part
            flight_sigmas = flight.noise[name], flight.systematic[name]
            combination_sigmas = combination.noise, combination.systematic
            database_sigmas = np.zeros(len(time)), database.angle_sigma[name]
            for pair, difference, first, second in (
                (f"IMU-{method}", imu - measured, flight_sigmas, database_sigmas),
                (f"IMU-{through}", imu - combined, combination_sigmas, database_sigmas),
                (f"{method}-{through}", measured - combined, flight_sigmas, combination_sigmas),
            ):
                noise, common = np.hypot(first[0], second[0]), np.hypot(first[1], second[1])
                rows.append(
                    _row(window.name, name, pair, inside, difference, noise, common, database.three_sigma[name], batch)
                )
    return rows


def verdicts(differences: Sequence[Difference], preflight: Sequence[Difference] = ()) -> list[Verdict]:
    """One verdict per coefficient and window, from database minus flight.

    Parameters
    ----------
    differences : sequence of Difference
        With the flight's atmosphere.
    preflight : sequence of Difference
        With the preflight atmosphere, of which CA is judged.
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
    inside: BoolArray,
    difference: Array,
    noise: Array,
    common: Array,
    limit: Array,
    batch: IntArray,
) -> Difference:
    """Mean of a difference ``(N,)`` over the samples of a window, with its sigma; NaN where the window has none."""
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
