"""One reader of a result, whether it is a folder, a data tree or plain groups.

`ResultReader` returns variables, attributes and units by group and name, the flight's events, phases and validation
domain, and the contents of ``summary.json``, ``diagnosis.json``, ``ledger.jsonl``, ``residuals.nc`` and
``database_update.nc``. Reports, figures, the workbench and commands read results through it only. What a result does
not contain is None or empty.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeVar, cast

import numpy as np

from edl_filter.aero.increments import DatabaseUpdate
from edl_filter.aero.increments_file import read_increments
from edl_filter.errors import InputError
from edl_filter.results.files import (
    DATABASE_UPDATE,
    DIAGNOSIS,
    LEDGER,
    RESIDUALS,
    RESULT,
    SUMMARY,
    read_diagnosis,
    read_ledger,
    read_summary,
    result_file,
)
from edl_filter.results.groups import Group, Variable
from edl_filter.results.hdf5 import FileGroups
from edl_filter.results.netcdf import check_result
from edl_filter.results.residual_series import ResidualSeries
from edl_filter.types import Array, BoolArray

if TYPE_CHECKING:
    from xarray import DataTree

    from edl_filter.results.schema import DiagnosisContent, LedgerLine, Summary

__all__ = ["AFTER_LANDING", "Phase", "ResidualSeries", "ResultReader", "ValidationDomain"]

T = TypeVar("T")
Phase = Literal["flight", "entry", "descent"]

#: End of the flight phase after the landing, s: later samples contain only the bounces on the ground.
AFTER_LANDING = 2.0


@dataclass(frozen=True, eq=False)
class ValidationDomain:
    """Part of the flight in which aerodynamic coefficients are defined.

    Attributes
    ----------
    time : (N,) array
        Times of all post-flight variables, s since the epoch.
    start, useful, end : float
        Times from which the deceleration is measurable and from which the force coefficients are significant, and the
        last time before the parachute, s since the epoch.
    instabilities : tuple of (float, float)
        Start and end of the static instabilities, s since the epoch.
    mach_times : dict
        Mach number as text → time at which the flight falls below it, s since the epoch.
    continuum : (float, float), optional
        Time from which the flow is a continuum, s since the epoch, and the limit of the Knudsen number.
    threshold : float
        Smallest measurable deceleration, m/s²; NaN if it is not stated.
    """

    time: Array
    start: float
    useful: float
    end: float
    instabilities: tuple[tuple[float, float], ...]
    mach_times: dict[str, float]
    continuum: tuple[float, float] | None
    threshold: float

    @property
    def significant(self) -> BoolArray:
        """Samples ``(N,)`` at which the force coefficients are significant."""
        return (self.time >= self.useful) & (self.time <= self.end)


class ResultReader:
    """Contents of one result.

    Parameters
    ----------
    groups : mapping
        Path of each group (``"/trajectory"``) → `Group`.
    folder : Path, optional
        Folder of the result, in which its JSON files are.

    Attributes
    ----------
    problems : dict
        File of the folder that could not be read → message.
    """

    def __init__(self, groups: Mapping[str, Group], folder: Path | None = None) -> None:
        self.groups, self.folder = groups, folder
        self.problems: dict[str, str] = {}

    @classmethod
    def of(cls, source: ResultReader | DataTree | Mapping[str, Group]) -> ResultReader:
        """Reader of a data tree or of plain groups; a reader is returned as it is."""
        if isinstance(source, ResultReader):
            return source
        subtree = getattr(source, "subtree", None)  # a DataTree is a Mapping too
        if subtree is None:
            return cls(cast(Mapping[str, Group], source))
        groups = {}
        for node in subtree:
            data = node.dataset
            variables = {
                str(n): Variable(tuple(map(str, v.dims)), v.values, v.attrs) for n, v in data.variables.items()
            }
            groups[node.path] = Group(variables, dict(data.attrs))
        return cls(groups)

    @classmethod
    def open(cls, path: str | Path, *, required: bool = True) -> ResultReader:
        """Open a result; `close` it afterwards, or use it in a ``with`` statement.

        Parameters
        ----------
        path : path
            Its folder, or, where it is required, its file.
        required : bool
            Raise an error if there is no valid ``result.nc``; otherwise the reader has no groups then, and `problems`
            has the message.

        Raises
        ------
        InputError
            ``result.nc`` is required, and does not exist or is no result of this version.
        """
        file = result_file(path) if required else Path(path) / RESULT
        folder = file.parent
        try:
            check_result(file)
        except InputError as error:
            if required:
                raise
            reader = cls({}, folder)
            reader.problems[RESULT] = str(error)
            return reader
        return cls(FileGroups(file), folder)

    def close(self) -> None:
        """Close the file of the result."""
        if isinstance(self.groups, FileGroups):
            self.groups.file.close()

    def __enter__(self) -> ResultReader:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # groups and variables

    @property
    def has_result(self) -> bool:
        """Whether there are any groups."""
        return bool(self.groups)

    def group(self, path: str) -> Group | None:
        """Group at a path such as ``"imu/driving"``."""
        return self.groups.get(f"/{path}")

    def children(self, path: str) -> list[str]:
        """Names of the groups directly below a path."""
        start = f"/{path}/"
        names = (name.removeprefix(start) for name in self.groups if name.startswith(start))
        return [name for name in names if "/" not in name]

    def variable(self, path: str, name: str) -> Array | None:
        """Numbers ``(...)`` of a variable, in its unit; None if it does not exist, is empty or is text."""
        group = self.group(path)
        variable = None if group is None else group.variables.get(name)
        if variable is None or variable.values.dtype.kind not in "fiub" or not variable.values.size:
            return None
        return np.asarray(variable.values, float)

    def required(self, path: str, name: str) -> Array:
        """Numbers ``(...)`` of a variable that the result contains, in its unit.

        Raises
        ------
        InputError
            The variable does not exist, is empty or is text.
        """
        values = self.variable(path, name)
        if values is None:
            raise InputError(f"{self.title}: found no numbers in variable {name!r} of group /{path} of the result.")
        return values

    def text(self, path: str, name: str) -> tuple[str, ...]:
        """Texts of a variable."""
        group = self.group(path)
        variable = None if group is None else group.variables.get(name)
        if variable is None or variable.values.dtype.kind not in "OUST":
            return ()
        return tuple(str(value) for value in np.atleast_1d(variable.values))

    def units(self, path: str, name: str) -> str:
        """Unit of a variable; empty if it has none."""
        group = self.group(path)
        return "" if group is None or name not in group.variables else str(group.variables[name].attrs.get("units", ""))

    def attribute(self, path: str, name: str, default: Any = None) -> Any:
        """Attribute of a group; the empty path is the root."""
        group = self.groups.get(f"/{path}")
        return default if group is None else group.attrs.get(name, default)

    def number(self, path: str, name: str, default: float) -> float:
        """Attribute of a group as a number; `default` if it does not exist or is not finite."""
        value = self.attribute(path, name)
        return default if value is None or not np.isfinite(value) else float(value)

    def mapping(self, path: str, name: str) -> dict[str, Any]:
        """Attribute of a group that contains a JSON object; empty if it does not exist or is none."""
        try:
            content = json.loads(str(self.attribute(path, name, "{}")))
        except ValueError:
            return {}
        return content if isinstance(content, dict) else {}

    def has(self, *needs: str) -> bool:
        """Whether the result has all variables ``"group:variable"`` with numbers."""
        return all(self.variable(*need.split(":")) is not None for need in needs)

    # the flight

    @property
    def mission(self) -> str:
        """Name of the mission; empty if it is not stated."""
        return str(self.attribute("", "mission") or (self.summary.mission if self.summary else ""))

    @property
    def title(self) -> str:
        """Title of the flight."""
        return str(
            self.attribute("", "title") or (self.summary.title if self.summary else "") or self.mission or "Entry"
        )

    @property
    def epoch_utc(self) -> str:
        """UTC of the epoch, ``"2004-01-04 04:19:52"``; empty if it is not stated."""
        epoch = self.attribute("", "epoch_utc") or (self.summary.epoch_utc if self.summary else "")
        return str(epoch).replace("T", " ")

    @cached_property
    def time(self) -> Array:
        """Times of the trajectory, s since the epoch, ``(N,)``."""
        return self.required("trajectory", "time")

    def trajectory(self, name: str) -> Array | None:
        """Variable of the trajectory, ``(N, ...)``."""
        return self.variable("trajectory", name)

    def imu(self, name: Literal["specific_force", "angular_rate"]) -> tuple[Array, Array] | None:
        """Times ``(N,)``, s, and corrected specific force, m/s², or angular rate, rad/s, ``(N, 3)``, body axes."""
        for path in ("imu/driving", "trajectory"):
            time, values = self.variable(path, "time"), self.variable(path, name)
            if time is not None and values is not None:
                return time, values
        return None

    @property
    def longitude(self) -> Array | None:
        """East longitude along the trajectory, rad, ``(N,)``."""
        values = self.trajectory("longitude")
        degrees = self.units("trajectory", "longitude").startswith("deg")
        return np.radians(values) if values is not None and degrees else values

    @cached_property
    def events(self) -> dict[str, float]:
        """Events in order of time: name → time, s since the epoch."""
        times, names = self.variable("events", "time_s"), self.text("events", "event")
        if times is not None:
            pairs = [(name, float(t)) for name, t in zip(names, times, strict=True) if np.isfinite(t)]
        else:
            pairs = [(name, e.time_s) for name, e in self.summary.events.items()] if self.summary else []
        return dict(sorted(pairs, key=lambda event: event[1]))

    def span(self, phase: Phase = "flight") -> tuple[float, float]:
        """First and last time of a phase of the flight, s since the epoch.

        Parameters
        ----------
        phase : {"flight", "entry", "descent"}
            Until `AFTER_LANDING`; until the parachute; from the parachute on. Without a parachute the entry is the
            whole flight and the descent is empty.
        """
        first, last = float(self.time[0]), float(self.time[-1])
        end = min(last, self.events["landing"] + AFTER_LANDING) if "landing" in self.events else last
        split = self.events.get("parachute_deploy", end)
        return {"flight": (first, end), "entry": (first, split), "descent": (split, end)}[phase]

    @property
    def phases(self) -> tuple[Phase, ...]:
        """Phases of the flight."""
        low, high = self.span("descent")
        return ("entry", "descent") if high > low else ("entry",)

    @property
    def constraints(self) -> dict[str, Group]:
        """Constraints by name."""
        return {name: self.groups[f"/constraints/{name}"] for name in self.children("constraints")}

    @cached_property
    def domain(self) -> ValidationDomain | None:
        """Validation domain of the post-flight groups; all times if it is not stated, None without these groups."""
        if self.group("postflight") is None:
            return None
        paths = (path for path in self.groups if path.startswith("/postflight/"))
        times = [t for path in paths if (t := self.variable(path[1:], "time")) is not None]
        time = max(times, key=len) if times else np.zeros(1)  # the samples, not the windows of the oscillation
        start = self.number("postflight", "domain_start", float(time[0]))
        begin = self.number("postflight", "continuum_from", np.nan)
        return ValidationDomain(
            time=time,
            start=start,
            useful=self.number("postflight", "domain_useful", start),
            end=self.number("postflight", "domain_end", float(time[-1])),
            instabilities=tuple(
                (float(w[0]), float(w[1])) for w in self.mapping("postflight", "instabilities").values() if w
            ),
            mach_times={
                mach: float(t)
                for mach, t in self.mapping("postflight", "mach_times").items()
                if t is not None and np.isfinite(t)
            },
            continuum=None if np.isnan(begin) else (begin, self.number("postflight", "continuum_limit", np.nan)),
            threshold=self.number("postflight", "threshold", np.nan),
        )

    # files of the folder

    @cached_property
    def summary(self) -> Summary | None:
        """Content of ``summary.json``."""
        return self._content(SUMMARY, read_summary)

    @cached_property
    def diagnosis(self) -> DiagnosisContent | None:
        """Content of ``diagnosis.json``."""
        return self._content(DIAGNOSIS, read_diagnosis)

    @cached_property
    def ledger(self) -> tuple[LedgerLine, ...]:
        """Lines of ``ledger.jsonl``; none if it is of another mission or model than the result."""
        lines = self._content(LEDGER, read_ledger)
        if not lines or lines[-1].mission != (self.mission or lines[-1].mission):
            return ()
        names = {name.split(" in ")[0] for name in self.summary.effects} if self.summary else None
        model = {name.split(" in ")[0] for name in lines[-1].model}
        return tuple(lines) if names is None or names == model else ()

    @cached_property
    def residuals(self) -> ResidualSeries | None:
        """Residuals of the diagnosis against time; None without a diagnosis."""
        if self.diagnosis is None:
            return None
        return self._content(RESIDUALS, lambda folder: ResidualSeries.from_file(folder / RESIDUALS))

    @cached_property
    def database_update(self) -> DatabaseUpdate | None:
        """Increments of the database that the diagnosis estimated; None without a diagnosis or with an exact one."""
        if self.diagnosis is None or self.diagnosis.database_update is None:
            return None
        return self._content(DATABASE_UPDATE, lambda folder: read_increments(folder / DATABASE_UPDATE))

    def _content(self, name: str, read: Callable[[Path], T]) -> T | None:
        """Content of a file of the folder; None if it does not exist or, with an entry in `problems`, is invalid."""
        if self.folder is None or not (self.folder / name).is_file():
            return None
        try:
            return read(self.folder)
        except InputError as error:
            self.problems[name] = str(error)
            return None
