"""Checks of single values of a mission file: ranges that reveal a wrong unit, rotations, covariances, inertia.

Each check is attached to a pydantic field with ``Annotated``. It returns the value or raises the error that
`field_error` creates, which `edl_filter.mission.error_messages` turns into "found ...; expected ...".
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from pydantic import AfterValidator, Field, GetCoreSchemaHandler
from pydantic_core import CoreSchema, PydanticCustomError, core_schema

from edl_filter.types import Array

#: A finite number; text that looks like a number, and true or false, are refused.
Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Switch = Annotated[bool, Field(strict=True)]
Vector = tuple[Number, Number, Number]


def field_error(actual: str, expected: str, key: str = "") -> PydanticCustomError:
    """Create the error of a check.

    Parameters
    ----------
    actual : str
        Value in the file, as the message shows it.
    expected : str
        What is accepted.
    key : str, optional
        Dotted key of the wrong value below the value that is checked; empty if it is that value.
    """
    context = {"actual": actual, "expected": expected, "key": key}
    return PydanticCustomError("mission", "found {actual}; expected {expected}", context)


def value_text(value: Any) -> str:
    """Return a value as messages show it: tuples as lists, at most 80 characters."""
    text = repr(list(value)) if isinstance(value, tuple) else repr(value)
    return text if len(text) <= 80 else text[:77] + "..."


def limit_text(number: float) -> str:
    """Return a limit with a short exponent: 1e10, not 1e+10."""
    return re.sub(r"e\+?(-?)0*", r"e\1", f"{number:g}")


@dataclass(frozen=True)
class Within:
    """Range of a number, or of the length of a vector, chosen so that a value in another unit lies outside of it.

    Attributes
    ----------
    unit : str
        Unit of the value, for the message.
    low, high : float
        Least and greatest accepted value.
    mistaken_units : tuple of (str, float)
        Units that are often used by mistake, each with the factor that converts it to `unit`. The message names the
        one whose factor brings the value into the range.
    above, below : bool
        Whether the least value (`above`) or the greatest value (`below`) is itself refused.
    zero : bool
        Whether 0 is accepted in addition to the range.
    """

    unit: str
    low: float
    high: float
    mistaken_units: tuple[tuple[str, float], ...] = ()
    above: bool = False
    below: bool = False
    zero: bool = False

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.no_info_after_validator_function(self.check, handler(source))

    def contains(self, size: float) -> bool:
        """Whether `size` is in the range."""
        if self.zero and size == 0.0:
            return True
        over = size > self.low if self.above else size >= self.low
        return over and (size < self.high if self.below else size <= self.high)

    def check(self, value: Any) -> Any:
        """Return `value`, or raise the error with the accepted range and the unit that the value may be in."""
        size = math.hypot(*value) if isinstance(value, tuple) else value
        if self.contains(size):
            return value
        actual = f"{value_text(value)}, of length {size:g}" if isinstance(value, tuple) else value_text(value)
        units = [unit for unit, factor in self.mistaken_units if self.contains(size * factor)]
        raise field_error(actual, self.expected + (f" (is it in {units[0]}?)" if units else ""))

    @property
    def expected(self) -> str:
        """The range in words."""
        unit = f"{self.unit} " if self.unit else "a number "
        if not self.above and not self.below:
            text = f"{unit}between {limit_text(self.low)} and {limit_text(self.high)}"
        else:
            low = "above" if self.above else "at least"
            high = "below" if self.below else "at most"
            text = f"{unit}{low} {limit_text(self.low)} and {high} {limit_text(self.high)}"
        return text + (", or 0" if self.zero and self.low > 0.0 else "")


def _check_norm(value: tuple[float, ...], norm_name: str, expected: str) -> tuple[float, ...]:
    norm = math.hypot(*value)
    if abs(norm - 1.0) > 1e-3:
        raise field_error(f"{value_text(value)}, of {norm_name} {norm:.6g}", expected)
    return value


def _quaternion(value: tuple[float, ...]) -> tuple[float, ...]:
    return _check_norm(value, "norm", "a unit quaternion (to 1e-3), scalar last")


def _direction(value: tuple[float, ...]) -> tuple[float, ...]:
    return _check_norm(value, "length", "a unit vector (to 1e-3)")


def _rotation_matrix(value: tuple[tuple[float, ...], ...]) -> tuple[tuple[float, ...], ...]:
    m = np.array(value)
    error = float(np.abs(m @ m.T - np.eye(3)).max())
    if error > 1e-4:
        raise field_error(
            f"rows that are {error:.2g} from orthonormal", "3 rows of a rotation matrix, orthonormal to 1e-4"
        )
    if np.linalg.det(m) < 0.0:
        raise field_error("a left-handed matrix (determinant -1)", "3 rows of a rotation matrix, right-handed")
    return value


def _covariance(value: tuple[tuple[float, ...], ...]) -> tuple[tuple[float, ...], ...]:
    if {len(row) for row in value} != {len(value)} or len(value) != 9:
        raise field_error(f"{len(value)} rows of {sorted({len(r) for r in value})} numbers", "9 rows of 9 numbers")
    p = np.array(value)
    scale = np.sqrt(np.abs(np.diag(p)))
    if np.any(np.abs(p - p.T) > 1e-9 * np.outer(scale, scale)):
        raise field_error("a matrix that is not symmetric", "a symmetric, positive definite covariance")
    # Scaled to correlations, so that metres and radians have equal weight in the eigenvalues
    if np.any(np.diag(p) <= 0.0) or np.linalg.eigvalsh(p / np.outer(scale, scale))[0] <= 1e-12:
        raise field_error("a matrix that is not positive definite", "a symmetric, positive definite covariance")
    return value


Quaternion = Annotated[tuple[Number, Number, Number, Number], AfterValidator(_quaternion)]
Direction = Annotated[Vector, AfterValidator(_direction)]
RotationMatrix = Annotated[tuple[Vector, Vector, Vector], AfterValidator(_rotation_matrix)]
Covariance = Annotated[tuple[tuple[Number, ...], ...], AfterValidator(_covariance)]


def normalised(value: Sequence[float]) -> Array:
    """`value` (n,) divided by its length: the digits of a file are too few for products of rotations."""
    v = np.asarray(value, float)
    return v / np.linalg.norm(v)


def nearest_rotation_matrix(rows: Sequence[Sequence[float]]) -> Array:
    """Rotation matrix (3, 3) nearest to `rows` (polar decomposition)."""
    u, _, vt = np.linalg.svd(np.asarray(rows, float))
    return u @ vt


def check_inertia(tensor: Array) -> None:
    """Raise the error of an inertia tensor (3, 3), kg m², that is not that of a rigid body.

    The principal moments of a rigid body are positive, and none exceeds the sum of the other two.
    """
    moments = np.linalg.eigvalsh(tensor)
    if moments[0] <= 0.0:
        actual = f"a tensor that is not positive definite (least principal moment {moments[0]:.4g} kg m^2)"
        raise field_error(actual, "moments and products of inertia of a body, kg m^2")
    if moments[2] > (moments[0] + moments[1]) * (1.0 + 1e-9):
        actual = "principal moments " + ", ".join(f"{m:.4g}" for m in moments)
        raise field_error(actual, "kg m^2, none above the sum of the other two, as in any body")
