"""A results folder as the report reads it: whatever is missing comes back as None or empty."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from edl_filter.results.files import AS_RUN, DIAGNOSIS, LEDGER, RESIDUALS
from edl_filter.types import Array

#: s after landing that are still shown: the bounces belong to another picture.
_AFTER_LANDING = 2.0


class Source:
    """Files of one results folder.

    Parameters
    ----------
    folder : Path
        ``result.nc``, ``summary.json``, ``diagnosis.json``, ``residuals.nc``, ``ledger.jsonl``, as far as they are
        there. ``residuals.nc`` counts only with its diagnosis.

    Attributes
    ----------
    summary, diagnosis : dict
        Empty where there is none.
    ledger : list of dict
    residuals : dict
        Variable → values; empty where there are none.
    about : dict
        Attributes of the result's root.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.summary = _json(folder / "summary.json")
        self.diagnosis = _json(folder / DIAGNOSIS)
        self.residuals = _residuals(folder / RESIDUALS) if self.diagnosis else {}
        self._file = _hdf5(folder / "result.nc")
        self.about: dict[str, Any] = {} if self._file is None else dict(self._file.attrs)
        self.ledger = self._own(_lines(folder / LEDGER))

    def _own(self, lines: list[dict[str, Any]]) -> list[dict[str, Any]]:
        """The ledger, unless another mission or another model has been run into its folder since."""
        if not lines or lines[-1].get("mission", self.mission) != self.mission:
            return []
        names = {name.split(" in ")[0] for name in self.summary.get("effects") or {}}
        model = {str(name).split(" in ")[0] for name in lines[-1].get("model", ())}
        return lines if not self.summary or names == model else []

    def close(self) -> None:
        """Let the result go."""
        if self._file is not None:
            self._file.close()

    @property
    def has_result(self) -> bool:
        """Whether there is a ``result.nc`` that can be read."""
        return self._file is not None

    @property
    def mission(self) -> str:
        """Name of the mission."""
        return str(self.about.get("mission") or self.summary.get("mission") or "")

    @property
    def title(self) -> str:
        """Name of the flight."""
        return str(self.about.get("title") or self.summary.get("title") or self.mission or "Entry")

    def get(self, group: str, name: str) -> Array | None:
        """Variable `name` of group `group`, numbers; None where there is none or nothing in it."""
        node = self._node(f"{group}/{name}")
        if node is None or node.dtype.kind not in "fiub" or not node.size:
            return None
        return np.asarray(node[()], float)

    def text(self, group: str, name: str) -> list[str]:
        """Variable `name` of group `group`, texts."""
        node = self._node(f"{group}/{name}")
        if node is None or h5py.check_string_dtype(node.dtype) is None:
            return []
        return [str(value) for value in np.atleast_1d(node.asstr()[()])]

    def attribute(self, group: str, name: str) -> Any:
        """One attribute of a group, or None."""
        node = None if self._file is None else self._file.get(group)
        return None if node is None else node.attrs.get(name)

    def _node(self, path: str) -> Any:
        node = None if self._file is None else self._file.get(path)
        return node if isinstance(node, h5py.Dataset) else None

    @property
    def events(self) -> dict[str, float]:
        """Events in order of time, s."""
        found = {name: e.get("time_s") for name, e in self.summary.get("events", {}).items()}
        return dict(sorted(((n, float(t)) for n, t in found.items() if t is not None), key=lambda event: event[1]))

    def end(self, last: float) -> float:
        """Time up to which the flight is shown, s: a little after landing, or `last`."""
        landing = self.events.get("landing")
        return last if landing is None else min(last, landing + _AFTER_LANDING)

    @property
    def time_label(self) -> str:
        """Label of the time axis, with the epoch where it is known."""
        epoch = str(self.about.get("epoch_utc") or self.summary.get("epoch_utc") or "").replace("T", " ")
        return f"time since {epoch} UTC (s)" if epoch else "time since the epoch (s)"

    @property
    def as_run(self) -> Path:
        """Where a mission that ``--set`` changed is kept."""
        return self.folder / AS_RUN


def _json(path: Path) -> dict[str, Any]:
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return found if isinstance(found, dict) else {}


def _lines(path: Path) -> list[dict[str, Any]]:
    try:
        found = [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines() if line.strip()]
    except (OSError, ValueError):
        return []
    return [line for line in found if isinstance(line, dict)]


def _hdf5(path: Path) -> Any:
    try:
        return h5py.File(path, "r")
    except OSError:
        return None


def _residuals(path: Path) -> dict[str, Any]:
    from edl_filter.results.hdf5 import read_groups

    try:
        root = read_groups(path)["/"].variables
    except (OSError, KeyError):
        return {}
    found = {name: variable.values for name, variable in root.items()}
    return found if {"time", "channel", "unit", "residual", "sigma", "normalised"} <= found.keys() else {}
