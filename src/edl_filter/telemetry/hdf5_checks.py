"""Checked reading of an HDF5 file: every error names the file, the group, dataset or attribute, and the row.

Input: an open HDF5 group (`Node`). Output: numbers and strings that have the right shape, are finite and lie within the
limits (`Limits`) that only the right unit meets.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import h5py
import numpy as np

from edl_filter import rotations
from edl_filter.errors import InputError
from edl_filter.telemetry.clock import parse_utc
from edl_filter.types import Array

#: Units that are used by mistake, with the factor to the right one.
DEGREES = {"deg": np.pi / 180.0}
DEGREE_RATES = {"deg/s": np.pi / 180.0}
PARTS = {"ppm": 1e-6, "%": 1e-2}


@dataclass(frozen=True)
class Limits:
    """Limits of a number, or of the length of a vector, which values in a wrong unit exceed.

    Attributes
    ----------
    unit : str
        The right unit, empty for a pure number.
    low, high : float
        In `unit`.
    mistaken_units : dict
        Unit used by mistake → factor to `unit`.
    """

    unit: str
    low: float
    high: float
    mistaken_units: Mapping[str, float] = field(default_factory=dict)

    def describe(self, size: float) -> str:
        """Describe a value that is outside the limits, for an error message."""
        units = [unit for unit, factor in self.mistaken_units.items() if self.low <= size * factor <= self.high]
        hint = f" (is it in {units[0]}?)" if units else ""
        return f"{size:g}; {self.unit or 'a number'} between {self.low:g} and {self.high:g} is needed{hint}."


#: Limits of a time since the epoch.
TIME = Limits("s", -1e5, 1e5, {"ms": 1e-3, "us": 1e-6})


@dataclass(frozen=True)
class Node:
    """A group of an HDF5 file, whose error messages name the file. Rows are counted from 0."""

    file_name: str
    group: Any

    def error(self, key: str, problem: str) -> InputError:
        """Error that names the file and the member `key` of the group."""
        return InputError(f"{self.file_name}: {self.group.name.rstrip('/')}/{key} {problem}")

    def child(self, key: str) -> Node:
        """Group `key`, which must exist."""
        if not isinstance(self.group.get(key), h5py.Group):
            raise self.error(key, "is missing; the flight file needs this group.")
        return Node(self.file_name, self.group[key])

    def optional(self, key: str) -> Node | None:
        """Group `key`, or None if it does not exist."""
        return self.child(key) if key in self.group else None

    def utc(self, key: str) -> str:
        """Read the string attribute `key`, which must be an ISO 8601 time."""
        text = self.text(key)
        try:
            parse_utc(text)
        except InputError as error:
            raise self.error(f"@{key}", f"(attribute): {error}") from None
        return text

    def text(self, key: str) -> str:
        """Read the string attribute `key`, which must exist."""
        if not isinstance(value := self.group.attrs.get(key), str):
            raise self.error(f"@{key}", "(attribute) is missing or no string.")
        return value

    def _numbers(self, key: str, raw: Any, shape: tuple[int | None, ...], finite: bool = True) -> Array:
        """`raw` as float64 of `shape` (None: any length); an error names the row that is not finite."""
        try:
            values = np.asarray(raw, np.float64)
        except (TypeError, ValueError):
            raise self.error(key, "holds no numbers.") from None
        if values.ndim != len(shape) or any(n not in (None, m) for n, m in zip(shape, values.shape, strict=True)):
            expected_shape = str(shape).replace("None", "N")
            raise self.error(key, f"has shape {values.shape}; {expected_shape} is needed.")
        not_finite = ~np.isfinite(values)
        if finite and not_finite.any():
            row = f"row {int(np.argwhere(not_finite)[0][0])} " if values.ndim else ""
            raise self.error(key, f"{row}holds {values[not_finite][0]}; finite numbers are needed.")
        return values

    def numbers(self, key: str, *shape: int | None, finite: bool = True) -> Array:
        """Dataset `key` as float64.

        Parameters
        ----------
        key : str
            Name of the dataset.
        *shape : int or None
            Lengths of its axes; None accepts any length.
        finite : bool
            All numbers must be finite.

        Returns
        -------
        (*shape,) array
            In the unit of the dataset.
        """
        if not isinstance(self.group.get(key), h5py.Dataset):
            raise self.error(key, "is missing; the flight file needs this dataset.")
        return self._numbers(key, self.group[key][()], shape, finite)

    def attribute(self, key: str, *shape: int, positive: bool = False, limits: Limits | None = None) -> Any:
        """Numeric attribute `key`.

        Parameters
        ----------
        key : str
            Name of the attribute.
        *shape : int
            Lengths of its axes; none for a number.
        positive : bool
            All of it must be above 0.
        limits : Limits, optional
            Of the number, or of the length of the vector.

        Returns
        -------
        float or array of `shape`
        """
        if key not in self.group.attrs:
            raise self.error(f"@{key}", "(attribute) is missing.")
        value = self._numbers(f"@{key}", self.group.attrs[key], shape)
        if positive:
            self.positive(f"@{key}", value)
        if limits is not None:
            self.within(f"@{key}", value, limits)
        return value if shape else float(value)

    def positive(self, key: str, value: Array) -> Array:
        """`value` (...); an error if an element is not above 0."""
        if not np.all(value > 0.0):
            raise self.error(key, f"is {value}; it must be positive.")
        return value

    def within(self, key: str, value: Array, limits: Limits, qualifier: str = "") -> Array:
        """`value` (...); an error if a number, or the length of a vector (last axis of length 3), exceeds the limits.

        `qualifier` is put before "is" in the error message.
        """
        sizes = np.linalg.norm(value, axis=-1) if value.ndim and value.shape[-1] == 3 else value
        outside = np.argwhere(~((sizes >= limits.low) & (sizes <= limits.high)))
        if len(outside):
            row = f"row {outside[0][0]} " if sizes.ndim else ""
            raise self.error(key, f"{row}{qualifier}is {limits.describe(float(sizes[tuple(outside[0])]))}")
        return value

    def unit(self, key: str, value: Array) -> Array:
        """Quaternion `value` (4,), normalised; an error if its norm differs from 1 by more than 1e-3."""
        norm = float(np.linalg.norm(value))
        if abs(norm - 1.0) > 1e-3:
            raise self.error(key, f"has norm {norm:.6g}; a unit quaternion [x, y, z, w] is needed.")
        return rotations.normalise(value)

    def increasing(self, key: str, time: Array) -> Array:
        """`time` (N,), s; an error names the first row at which it does not increase."""
        step = np.diff(time)
        if np.any(step <= 0.0):
            row = int((step <= 0.0).argmax()) + 1
            raise self.error(key, f"row {row} is {time[row]:.6f} s after {time[row - 1]:.6f} s; time must increase.")
        return time

    def covariance(self, key: str) -> Array:
        """Dataset (9, 9), made exactly symmetric; an error if it is not symmetric and positive definite."""
        value = self.numbers(key, 9, 9)
        diagonal = np.diag(value)
        if np.any(diagonal <= 0.0):
            i = int((diagonal <= 0.0).argmax())
            raise self.error(key, f"has {diagonal[i]:g} on its diagonal, row {i}; it must be positive definite.")
        # The elements differ by ten orders of magnitude in their units: the checks use the correlations
        correlation = value / np.sqrt(np.outer(diagonal, diagonal))
        if np.max(np.abs(correlation - correlation.T)) > 1e-6:
            raise self.error(key, "is not symmetric.")
        if (smallest := float(np.linalg.eigvalsh(correlation)[0])) <= 0.0:
            raise self.error(key, f"is not positive definite (least eigenvalue of its correlations {smallest:.3g}).")
        return 0.5 * (value + value.T)
