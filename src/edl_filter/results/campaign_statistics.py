"""Statistics of a campaign, by flight and dispersion: percentiles of events, landing ellipses, coverage, reliability.

In: the Dataset of `campaign_store.open_store`. Out: plain data, as in ``statistics.json``. Quantities that no case has
are absent.
"""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from edl_filter.estimation.series import finite_rows
from edl_filter.planet import ellipsoid
from edl_filter.results.campaign_variables import EVENT_VALUES, OUTCOMES, PARTS, VARIABLES
from edl_filter.types import Array, IntArray

if TYPE_CHECKING:
    from xarray import Dataset

PERCENTILES = (1.0, 5.0, 50.0, 95.0, 99.0)
#: Multiples of sigma at which coverage is stated, and the shares of a normal distribution within them.
SIGMAS = (1.0, 2.0, 3.0)
NORMAL_SHARES = (0.6827, 0.9545, 0.9973)
#: Edges of the bins of probability of the reliability.
BINS = (0.0, 0.5, 0.8, 0.95, 0.99, 1.0)
#: Landing positions: variable → name.
LANDINGS = {
    "landing_position": "estimate",
    "predicted_landing_position": "without landing constraint",
    "true_landing_position": "truth",
}
#: Square root of the 95 % quantile of chi-square with two degrees of freedom: scale of an ellipse of 95 %.
ELLIPSE_95 = 2.4477


def statistics(data: Dataset) -> dict[str, Any]:
    """Statistics of all groups.

    Parameters
    ----------
    data : Dataset
        Of a campaign (`campaign_store.open_store`).

    Returns
    -------
    dict
        ``groups``: list with one entry for each flight and dispersion; ``outcomes``: counts of all cases.
    """
    flights, dispersions = np.asarray(data["flight"].values, str), np.asarray(data["dispersion"].values, str)
    outcome = np.asarray(data["outcome"].values)
    pairs = list(dict.fromkeys(zip(flights[: 10**5].tolist(), dispersions[: 10**5].tolist(), strict=True)))
    groups = []
    for flight, dispersion in pairs:
        inside = (flights == flight) & (dispersions == dispersion)
        counts = {name: int(np.sum(outcome[inside] == k)) for k, name in enumerate(OUTCOMES)}
        selected = np.flatnonzero(inside & (outcome == 0))
        groups.append({"flight": flight, "dispersion": dispersion, "cases": counts} | _group(data, selected))
    return {"outcomes": {name: int(np.sum(outcome == k)) for k, name in enumerate(OUTCOMES)}, "groups": groups}


def _group(data: Dataset, selected: IntArray) -> dict[str, Any]:
    """Statistics of the cases `selected` (indices)."""
    if not len(selected):
        return {}
    content: dict[str, Any] = {"events": _events(data, selected)}
    if "trustworthy" in data:
        content["trustworthy"] = float(np.nanmean(values_of(data, "trustworthy", selected)))
    landing = landing_offsets(data, selected)
    if landing:
        content["landing"] = {name: ellipse(points) for name, points in landing.items()}
    if "state_error" in data and np.isfinite(values_of(data, "state_error", selected)).any():
        content["coverage"] = _coverage(data, selected)
    content["constraints"] = _constraints(data, selected)
    if "leader_probability" in data:
        content["reliability"] = _reliability(data, selected)
    return content


def values_of(data: Dataset, name: str, selected: IntArray) -> Array:
    """Values of a variable for some cases, read from the store.

    Parameters
    ----------
    data : Dataset
        Of `open_store`.
    name : str
        Of the variable.
    selected : (K,) array of int
        Indices of the cases.

    Returns
    -------
    (K, ...) array
        In the unit of the variable; NaN where a case has no value.
    """
    return np.asarray(data[name].isel(case=selected).values, float)


def _events(data: Dataset, selected: IntArray) -> list[dict[str, Any]]:
    """Percentiles, mean and standard deviation of each quantity at each event."""
    rows = []
    for name in EVENT_VALUES.values():
        if name not in data:
            continue
        values = values_of(data, name, selected)
        for k, event in enumerate(data["event"].values):
            column = values[:, k][np.isfinite(values[:, k])]
            if not len(column):
                continue
            rows.append(
                {
                    "event": str(event),
                    "quantity": name.removeprefix("event_"),
                    "unit": VARIABLES[name].unit,
                    "count": len(column),
                    "mean": float(column.mean()),
                    "standard_deviation": float(column.std(ddof=1)) if len(column) > 1 else 0.0,
                    "percentiles": dict(
                        zip(map(str, PERCENTILES), np.percentile(column, PERCENTILES).tolist(), strict=True)
                    ),
                }
            )
    return rows


def landing_offsets(data: Dataset, selected: IntArray) -> dict[str, Array]:
    """East and north ``(N, 2)``, m, of landing positions from the mean of the estimates, by name.

    Parameters
    ----------
    data : Dataset
        Of a campaign.
    selected : (N,) integer array
        Indices of the cases.
    """
    positions = {label: values_of(data, name, selected) for name, label in LANDINGS.items() if name in data}
    positions = {label: p for label, p in positions.items() if finite_rows(p).any()}
    if not positions:
        return {}
    origin = np.nanmean(positions.get("truth", positions[next(iter(positions))]), axis=0)
    latitude, longitude, _ = ellipsoid.areocentric_from_fixed(origin)
    axes = ellipsoid.enu_from_fixed(latitude, longitude)[:2]
    return {label: (p - origin) @ axes.T for label, p in positions.items()}


def ellipse(points: Array) -> dict[str, float]:
    """Mean and ellipse of 95 % of horizontal positions ``(N, 2)``, m, under a normal distribution."""
    valid = points[finite_rows(points)]
    mean = valid.mean(axis=0)
    covariance = np.cov(valid.T) if len(valid) > 1 else np.zeros((2, 2))
    variances, directions = np.linalg.eigh(covariance)
    major = directions[:, 1]
    return {
        "count": len(valid),
        "mean_east_m": float(mean[0]),
        "mean_north_m": float(mean[1]),
        "semi_major_95_m": float(ELLIPSE_95 * np.sqrt(max(variances[1], 0.0))),
        "semi_minor_95_m": float(ELLIPSE_95 * np.sqrt(max(variances[0], 0.0))),
        "azimuth_deg": float(np.degrees(np.arctan2(major[0], major[1])) % 180.0),
    }


def _coverage(data: Dataset, selected: IntArray) -> list[dict[str, Any]]:
    """Share of the errors within 1, 2 and 3 sigma, and the mean NEES per degree of freedom, by phase and part."""
    ratio = np.abs(values_of(data, "state_error", selected)) / values_of(data, "state_sigma", selected)
    nees = values_of(data, "nees", selected)
    rows = []
    for i, phase in enumerate(data["phase"].values):
        for j, (part, components) in enumerate(PARTS.items()):
            inside = ratio[:, i, components]
            valid = inside[np.isfinite(inside)]
            if len(valid):
                shares = [float(np.mean(valid < k)) for k in SIGMAS]
                dof = components.stop - components.start
                rows.append(
                    {
                        "phase": str(phase), "part": part, "count": len(selected), "within_sigmas": shares,
                        "nees_per_dof": float(np.nanmean(nees[:, i, j]) / dof),
                    }
                )  # fmt: skip
    return rows


def _constraints(data: Dataset, selected: IntArray) -> list[dict[str, Any]]:
    """Sums of NIS over degrees of freedom, with and without the constraint itself, and rejected uses."""
    rows = []
    for k, name in enumerate(data["constraint"].values if "constraint" in data else ()):
        row: dict[str, Any] = {"constraint": str(name)}
        for key in ("", "left_out_"):
            if f"{key}nis" not in data:
                continue
            nis = values_of(data, f"{key}nis", selected)[:, k]
            dof = values_of(data, f"{key}dof", selected)[:, k]
            valid = np.isfinite(nis) & np.isfinite(dof)
            if dof[valid].sum() > 0.0:
                row[f"{key}nis_per_dof"] = float(nis[valid].sum() / dof[valid].sum())
        rejected = values_of(data, "rejected", selected)[:, k]
        if np.isfinite(rejected).any():
            row["rejected_per_case"] = float(np.nanmean(rejected))
        if len(row) > 1:
            rows.append(row)
    return rows


def _reliability(data: Dataset, selected: IntArray) -> list[dict[str, Any]]:
    """Share of right names of the leading hypothesis by its stated probability, where the verdict names it."""
    probability = values_of(data, "leader_probability", selected)
    right, named = values_of(data, "leader_right", selected), values_of(data, "named", selected) == 1.0
    rows = []
    for low, high in pairwise(BINS):
        inside = named & (probability >= low) & ((probability < high) | (high == BINS[-1]))
        if inside.any():
            count, hits = int(inside.sum()), int(right[inside].sum())
            rows.append(
                {
                    "low": low, "high": high, "count": count, "right": hits,
                    "mean_probability": float(probability[inside].mean()), "share_right": hits / count,
                }
            )  # fmt: skip
    return rows
