"""Figure and sentences about what a flight says of its aerodynamic database."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from edl_filter.aero.discrepancy import FIELD_COEFFICIENTS
from edl_filter.aero.increments import SYMBOLS, DatabaseUpdate, RegimeUpdate
from edl_filter.report.colours import AXES
from edl_filter.report.description import Axis, Band, Curve, Element, Figure, Legend, Line, Panel
from edl_filter.report.text import number
from edl_filter.results.schema.diagnosis import DatabaseUpdateContent, DiscrepancyContent, NuisanceContent
from edl_filter.types import Array, IntArray

#: Share of the prior variance that the data removed from which a curve is not grey.
DECIDED = 0.5
_AXES = {"mach": "Mach number", "knudsen": "Knudsen number"}
#: Names of nuisance parameters that are not plain words.
_NAMES = {"wind_east": "wind towards east", "wind_north": "wind towards north"}


def database_figure(update: DatabaseUpdate, title: str) -> Figure:
    """Increments of CA, CN and Cm with bands of two sigmas, at several angles; one column for each regime.

    Curves are grey where the prior decides more than the data; symbols are where the flight has been.
    """
    rows = [
        tuple(_panel(r, c, c == 0 and k == len(update.regimes) - 1) for k, r in enumerate(update.regimes))
        for c in range(len(FIELD_COEFFICIENTS))
    ]
    columns = len(update.regimes)
    return Figure(
        f"{title}: increments of the database", tuple(rows), (2.3,) * len(rows), (1.0,) * columns,
        9.0 if columns == 1 else 12.5, (1.1, 1.9, 0.7), (0.28, 0.12), shared_x=True,
    )  # fmt: skip


def _panel(regime: RegimeUpdate, coefficient: int, legend: bool) -> Panel:
    symbol = SYMBOLS[FIELD_COEFFICIENTS[coefficient]]
    increment, sigma = regime.increment[coefficient], regime.sigma[coefficient]
    share, elements = regime.share[coefficient], list[Element]()
    for a, colour in zip(figure_angles(regime), AXES, strict=False):
        label = f"{np.degrees(regime.alpha[a]):.3g} deg"
        elements += _angle(regime, increment[:, a], sigma[:, a], share[:, a], regime.bins[:, a], colour, label)
    elements.append(Line(0.0))
    x = Axis(_AXES[regime.regime], scale="log", range=(float(regime.nodes[0]), float(regime.nodes[-1])))
    place = Legend("outside", 1, "bands: 2 sigma;\ngrey: prior decides;\ncircles: flown") if legend else None
    return Panel(x, Axis(f"Δ{symbol}", "–"), tuple(elements), legend=place)


def figure_angles(regime: RegimeUpdate) -> IntArray:
    """Angles of a figure: as many as there are colours, of those that were flown; not zero.

    Parameters
    ----------
    regime : RegimeUpdate
        With A angles.

    Returns
    -------
    (K,) array of int
        Indices of the angles.
    """
    flown = np.flatnonzero(np.any(regime.bins > 0, axis=0))
    flown = flown[flown > 0] if np.any(flown > 0) else np.array([1])
    places = np.round(np.linspace(0, len(flown) - 1, len(AXES))).astype(np.int64)
    return np.asarray(flown[np.unique(places)], np.int64)


def _angle(
    regime: RegimeUpdate, increment: Array, sigma: Array, share: Array, bins: IntArray, colour: str, label: str
) -> Sequence[Element]:
    """Band, curve, its grey parts and marks at one angle."""
    nodes, decided = regime.nodes, share >= DECIDED
    # a segment has its colour if both of its ends are decided, and is grey otherwise
    grey = ~decided
    grey[:-1] |= ~decided[1:]
    grey[1:] |= ~decided[:-1]
    flown = np.where(bins > 0, increment, np.nan)
    return (
        Band(nodes, increment - 2.0 * sigma, increment + 2.0 * sigma, "", f"{colour}-band", curve=label),
        Curve(nodes, np.where(decided, increment, np.nan), label, colour, "", 1.5),
        Curve(nodes, np.where(grey, increment, np.nan), "", "muted", "", 1.5),
        Curve(nodes, flown, "", colour, "", 0.0, symbol="circle", size=4.0),
    )


def nuisance_text(nuisance: NuisanceContent) -> str:
    """A shift in words."""
    name = _NAMES.get(nuisance.name, nuisance.name.replace("_", " "))
    if nuisance.value is None:
        value = number(None)
    elif nuisance.unit == "" and not nuisance.name.startswith("database"):
        value = f"{100.0 * nuisance.value:+.2g} %"
    else:
        value = f"{number(nuisance.value)} {nuisance.unit}".strip()
    return f"{name} by {number(nuisance.sigmas)} sigma ({value})"


def nuisance_sentence(nuisances: Sequence[NuisanceContent]) -> str:
    """All shifts as one sentence; empty if there is none."""
    if not nuisances:
        return ""
    return f"Nuisance parameters beyond two sigmas of their stated values: {', '.join(map(nuisance_text, nuisances))}."


def discrepancy_sentence(discrepancy: DiscrepancyContent | None) -> str:
    """Scale and lengths of the database's error that were estimated; empty if none were."""
    if discrepancy is None:
        return ""
    estimates = ", ".join(
        f"{name} {number(q.estimate)} (stated {number(q.stated)}{', at its bound' if q.at_bound else ''})"
        for name, q in discrepancy.quantities.items()
    )
    return (
        f"Error of the database, by marginal likelihood: {estimates}; {number(discrepancy.gain)} nats above the stated "
        "values. An effect that is missing makes it larger, too."
    )


def update_sentence(update: DatabaseUpdateContent | None) -> str:
    """The largest increments as one sentence; empty with an exact database."""
    if update is None:
        return ""
    parts = []
    for name, largest in update.largest.items():
        place = f"Mach {number(largest.mach)}" if largest.mach is not None else f"Kn {number(largest.knudsen)}"
        parts.append(
            f"Δ{name} {number(largest.increment)} ± {number(largest.sigma)} at {place} and "
            f"{largest.alpha_deg:.3g} deg ({number(largest.sigmas)} of its sigma)"
        )
    return f"Estimated increments of the database: largest {'; '.join(parts)}."
