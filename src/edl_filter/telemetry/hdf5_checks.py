"""Read groups, datasets and attributes of an HDF5 file so that every complaint names file, place and row."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from edl_filter import rotations
from edl_filter.errors import InputError
from edl_filter.telemetry.clock import parse_utc

Array = NDArray[np.float64]
#: Units that people take by mistake, with the factor to the right one.
DEGREES = {"deg": np.pi / 180.0}
DEGREE_RATES = {"deg/s": np.pi / 180.0}
PARTS = {"ppm": 1e-6, "%": 1e-2}


@dataclass(frozen=True)
class Within:
    """Range of a number, or of the length of a vector, that only the right unit reaches.

    Attributes
    ----------
    unit : str
    low, high : float
    wrong : dict
        Unit taken by mistake → factor to `unit`.
    """

    unit: str
    low: float
    high: float
    wrong: Mapping[str, float] = field(default_factory=dict)

    def problem(self, size: float) -> str:
        """What is wrong with `size`, which is not in the range."""
        units = [unit for unit, factor in self.wrong.items() if self.low <= size * factor <= self.high]
        hint = f" (is it in {units[0]}?)" if units else ""
        return f"{size:g}; {self.unit or 'a number'} between {self.low:g} and {self.high:g} is needed{hint}."


@dataclass(frozen=True)
class Node:
    """A group of an HDF5 file, shown as `shown` in complaints. Rows are counted from 0."""

    shown: str
    group: Any

    def complain(self, key: str, problem: str) -> InputError:
        """Error that names file and place."""
        return InputError(f"{self.shown}: {self.group.name.rstrip('/')}/{key} {problem}")

    def child(self, key: str) -> Node:
        """Group `key`, which must be there."""
        if not isinstance(self.group.get(key), h5py.Group):
            raise self.complain(key, "is missing; the flight file needs this group.")
        return Node(self.shown, self.group[key])

    def optional(self, key: str) -> Node | None:
        """Group `key`, or None."""
        return self.child(key) if key in self.group else None

    def utc(self, key: str) -> str:
        """Read string attribute `key`, an ISO 8601 time."""
        text = self.text(key)
        try:
            parse_utc(text)
        except InputError as error:
            raise self.complain(f"@{key}", f"(attribute): {error}") from None
        return text

    def text(self, key: str) -> str:
        """Read string attribute `key`, which must be there."""
        if not isinstance(value := self.group.attrs.get(key), str):
            raise self.complain(f"@{key}", "(attribute) is missing or no string.")
        return value

    def _numbers(self, key: str, raw: Any, shape: tuple[int | None, ...]) -> Array:
        """`raw` as finite float64 of `shape` (None: any length), or a complaint that names the row."""
        try:
            values = np.asarray(raw, np.float64)
        except (TypeError, ValueError):
            raise self.complain(key, "holds no numbers.") from None
        wanted = str(shape).replace("None", "N")
        if values.ndim != len(shape) or any(n not in (None, m) for n, m in zip(shape, values.shape, strict=True)):
            raise self.complain(key, f"has shape {values.shape}; {wanted} is needed.")
        bad = ~np.isfinite(values)
        if bad.any():
            row = f"row {int(np.argwhere(bad)[0][0])} " if values.ndim else ""
            raise self.complain(key, f"{row}holds {values[bad][0]}; finite numbers are needed.")
        return values

    def numbers(self, key: str, *shape: int | None) -> Array:
        """Dataset `key` as float64."""
        if not isinstance(self.group.get(key), h5py.Dataset):
            raise self.complain(key, "is missing; the flight file needs this dataset.")
        return self._numbers(key, self.group[key][()], shape)

    def attribute(self, key: str, *shape: int, positive: bool = False, range: Within | None = None) -> Any:
        """Numeric attribute: a float, or an array if a shape is given."""
        if key not in self.group.attrs:
            raise self.complain(f"@{key}", "(attribute) is missing.")
        value = self._numbers(f"@{key}", self.group.attrs[key], shape)
        if positive:
            self.positive(f"@{key}", value)
        if range is not None:
            self.within(f"@{key}", value, range)
        return value if shape else float(value)

    def positive(self, key: str, value: Array) -> Array:
        """`value`, or a complaint if any of it is not above 0."""
        if not np.all(value > 0.0):
            raise self.complain(key, f"is {value}; it must be positive.")
        return value

    def within(self, key: str, value: Array, allowed: Within, what: str = "") -> Array:
        """`value`, or a complaint if a number, or the length of a vector (last axis), is outside the range."""
        sizes = np.linalg.norm(value, axis=-1) if value.ndim and value.shape[-1] == 3 else value
        bad = np.argwhere(~((sizes >= allowed.low) & (sizes <= allowed.high)))
        if len(bad):
            where = f"row {bad[0][0]} " if sizes.ndim else ""
            raise self.complain(key, f"{where}{what}is {allowed.problem(float(sizes[tuple(bad[0])]))}")
        return value

    def unit(self, key: str, value: Array) -> Array:
        """`value` normalised; a complaint if its norm is off by more than 1e-3."""
        norm = float(np.linalg.norm(value))
        if abs(norm - 1.0) > 1e-3:
            raise self.complain(key, f"has norm {norm:.6g}; a unit quaternion [x, y, z, w] is needed.")
        return rotations.normalise(value)

    def increasing(self, key: str, time: Array) -> Array:
        """`time`, or a complaint that names the row at which it does not increase."""
        step = np.diff(time)
        if np.any(step <= 0.0):
            row = int((step <= 0.0).argmax()) + 1
            raise self.complain(key, f"row {row} is {time[row]:.6f} s after {time[row - 1]:.6f} s; time must increase.")
        return time

    def covariance(self, key: str) -> Array:
        """9 x 9 dataset, or a complaint if it is not symmetric and positive definite."""
        value = self.numbers(key, 9, 9)
        diagonal = np.diag(value)
        if np.any(diagonal <= 0.0):
            i = int((diagonal <= 0.0).argmax())
            raise self.complain(key, f"has {diagonal[i]:g} on its diagonal, row {i}; it must be positive definite.")
        # units differ by ten orders of magnitude: judge the correlations
        correlation = value / np.sqrt(np.outer(diagonal, diagonal))
        if np.max(np.abs(correlation - correlation.T)) > 1e-6:
            raise self.complain(key, "is not symmetric.")
        if (least := float(np.linalg.eigvalsh(correlation)[0])) <= 0.0:
            raise self.complain(key, f"is not positive definite (least eigenvalue of its correlations {least:.3g}).")
        return 0.5 * (value + value.T)
