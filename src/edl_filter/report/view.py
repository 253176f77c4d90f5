"""What the figures read of a run's results: the only place that knows the tree's names.

Every part but ``/trajectory`` may be missing; what is missing comes back as None or empty.
"""

from __future__ import annotations

import numpy as np
from xarray import Dataset, DataTree

from edl_filter.types import Array

#: s after landing that are still shown: the bounces belong to another picture.
AFTER_LANDING = 2.0


def group(tree: DataTree, path: str) -> Dataset | None:
    """Return the data of one group, where there is one."""
    node = tree
    for part in path.split("/"):  # `in` looks only at children
        if part not in node.children:
            return None
        node = node.children[part]
    return node.dataset


def trajectory(tree: DataTree, name: str) -> Array | None:
    """Return variable `name` along the trajectory."""
    data = group(tree, "trajectory")
    return None if data is None or name not in data else np.asarray(data[name].values, float)


def time(tree: DataTree) -> Array:
    """Return the times along the trajectory, s since the epoch."""
    return np.asarray(tree["trajectory"].dataset["time"].values, float)


def imu(tree: DataTree, name: str) -> tuple[Array, Array] | None:
    """Return times ``(N,)`` and corrected ``specific_force`` or ``angular_rate`` ``(N, 3)``, body axes."""
    for path in ("imu/driving", "trajectory"):
        data = group(tree, path)
        if data is not None and name in data:
            return np.asarray(data["time"].values, float), np.asarray(data[name].values, float)
    return None


def events(tree: DataTree) -> list[tuple[str, float]]:
    """Names and times (s since the epoch), in order of time."""
    data = group(tree, "events")
    if data is None or "time_s" not in data:
        return []
    times = np.asarray(data["time_s"].values, float)
    names = data[data["time_s"].dims[0]].values
    return sorted(((str(n), float(t)) for n, t in zip(names, times, strict=True) if np.isfinite(t)), key=_when)


def _when(event: tuple[str, float]) -> float:
    return event[1]


def longitude(tree: DataTree) -> Array | None:
    """East longitude along the trajectory, rad, whichever unit the tree has it in."""
    data = group(tree, "trajectory")
    if data is None or "longitude" not in data:
        return None
    values = np.asarray(data["longitude"].values, float)
    return np.radians(values) if str(data["longitude"].attrs.get("units", "rad")).startswith("deg") else values


def event(tree: DataTree, name: str) -> float | None:
    """Time of one event, s since the epoch."""
    return dict(events(tree)).get(name)


def span(tree: DataTree, phase: str = "flight") -> tuple[float, float]:
    """First and last time of a phase of the flight, s.

    Parameters
    ----------
    phase : {"flight", "entry", "descent"}
        To just after landing; to the parachute; from the parachute on. Without a parachute the entry is the
        whole flight and the descent empty.
    """
    whole = time(tree)
    landing, parachute = event(tree, "landing"), event(tree, "parachute_deploy")
    end = whole[-1] if landing is None else min(whole[-1], landing + AFTER_LANDING)
    split = end if parachute is None else parachute
    low, high = {"flight": (whole[0], end), "entry": (whole[0], split), "descent": (split, end)}[phase]
    return float(low), float(high)


def phases(tree: DataTree) -> tuple[str, ...]:
    """Phases that the flight has."""
    low, high = span(tree, "descent")
    return ("entry", "descent") if high > low else ("entry",)


def title(tree: DataTree) -> str:
    """Name of the flight."""
    return str(tree.attrs.get("title") or tree.attrs.get("mission") or "Entry")


def time_label(tree: DataTree) -> str:
    """Label of the time axis, with the epoch where it is known."""
    epoch = str(tree.attrs.get("epoch_utc", "")).replace("T", " ")
    return f"time since {epoch} UTC (s)" if epoch else "time since the epoch (s)"


def constraints(tree: DataTree) -> dict[str, Dataset]:
    """Constraints by name, in the tree's order."""
    if "constraints" not in tree:
        return {}
    return {name: node.dataset for name, node in tree["constraints"].children.items()}
