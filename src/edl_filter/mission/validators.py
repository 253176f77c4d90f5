"""Checks of single values of a mission file: magnitudes that betray a wrong unit, rotations, covariances.

Each check is put on a pydantic field with ``Annotated``; it returns the value or raises the error that
`problem` makes, from which `edl_filter.mission` forms the message "found ...; expected ...".
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, Field, GetCoreSchemaHandler
from pydantic_core import CoreSchema, PydanticCustomError, core_schema

Array = NDArray[np.float64]

#: A finite number; text that looks like one, and true or false, are refused.
Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Switch = Annotated[bool, Field(strict=True)]
Vector = tuple[Number, Number, Number]


def problem(found: str, expected: str, key: str = "") -> PydanticCustomError:
    """Error of a check: what was found, what is expected, and at which key below the checked value."""
    context = {"found": found, "expected": expected, "key": key}
    return PydanticCustomError("mission", "found {found}; expected {expected}", context)


def shown(value: Any) -> str:
    """Give a value as it stands in messages: lists in brackets, nothing longer than a line's rest."""
    text = repr(list(value)) if isinstance(value, tuple) else repr(value)
    return text if len(text) <= 80 else text[:77] + "..."


def short(number: float) -> str:
    """Give a limit as a person writes it: 1e10, not 1e+10."""
    return re.sub(r"e\+?(-?)0*", r"e\1", f"{number:g}")


@dataclass(frozen=True)
class Within:
    """The size of a number, or the length of a vector, lies in a range that only the right unit reaches.

    Attributes
    ----------
    unit : str
        Unit of the value, for the message.
    low, high : float
        Least and greatest value accepted.
    wrong : tuple of (str, float)
        Units that people take by mistake, with the factor that turns them into `unit`. One that brings the
        value into the range is named in the message.
    above, below : bool
        The least, the greatest value is itself not accepted.
    zero : bool
        0 is accepted as well, whatever the range.
    """

    unit: str
    low: float
    high: float
    wrong: tuple[tuple[str, float], ...] = ()
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
        """Return `value`, or raise the error that says what is expected and which unit it may be in."""
        size = math.hypot(*value) if isinstance(value, tuple) else value
        if self.contains(size):
            return value
        found = f"{shown(value)}, of length {size:g}" if isinstance(value, tuple) else shown(value)
        units = [unit for unit, factor in self.wrong if self.contains(size * factor)]
        raise problem(found, self.expected + (f" (is it in {units[0]}?)" if units else ""))

    @property
    def expected(self) -> str:
        """The range in words."""
        unit = f"{self.unit} " if self.unit else "a number "
        if not self.above and not self.below:
            text = f"{unit}between {short(self.low)} and {short(self.high)}"
        else:
            low = "above" if self.above else "at least"
            high = "below" if self.below else "at most"
            text = f"{unit}{low} {short(self.low)} and {high} {short(self.high)}"
        return text + (", or 0" if self.zero and self.low > 0.0 else "")


def _quaternion(value: tuple[float, ...]) -> tuple[float, ...]:
    norm = math.hypot(*value)
    if abs(norm - 1.0) > 1e-3:
        raise problem(f"{shown(value)}, of norm {norm:.6g}", "a unit quaternion (to 1e-3), scalar last")
    return value


def _direction(value: tuple[float, ...]) -> tuple[float, ...]:
    norm = math.hypot(*value)
    if abs(norm - 1.0) > 1e-3:
        raise problem(f"{shown(value)}, of length {norm:.6g}", "a unit vector (to 1e-3)")
    return value


def _rotation_matrix(value: tuple[tuple[float, ...], ...]) -> tuple[tuple[float, ...], ...]:
    m = np.array(value)
    error = float(np.abs(m @ m.T - np.eye(3)).max())
    if error > 1e-4:
        raise problem(f"rows that are {error:.2g} from orthonormal", "3 rows of a rotation matrix, orthonormal to 1e-4")
    if np.linalg.det(m) < 0.0:
        raise problem("a left-handed matrix (determinant -1)", "3 rows of a rotation matrix, right-handed")
    return value


def _covariance(value: tuple[tuple[float, ...], ...]) -> tuple[tuple[float, ...], ...]:
    if {len(row) for row in value} != {len(value)} or len(value) != 9:
        raise problem(f"{len(value)} rows of {sorted({len(r) for r in value})} numbers", "9 rows of 9 numbers")
    p = np.array(value)
    scale = np.sqrt(np.abs(np.diag(p)))
    if np.any(np.abs(p - p.T) > 1e-9 * np.outer(scale, scale)):
        raise problem("a matrix that is not symmetric", "a symmetric, positive definite covariance")
    # Scaled to correlations, so that metres and radians weigh alike in the eigenvalues
    if np.any(np.diag(p) <= 0.0) or np.linalg.eigvalsh(p / np.outer(scale, scale))[0] <= 1e-12:
        raise problem("a matrix that is not positive definite", "a symmetric, positive definite covariance")
    return value


Quaternion = Annotated[tuple[Number, Number, Number, Number], AfterValidator(_quaternion)]
Direction = Annotated[Vector, AfterValidator(_direction)]
RotationMatrix = Annotated[tuple[Vector, Vector, Vector], AfterValidator(_rotation_matrix)]
Covariance = Annotated[tuple[tuple[Number, ...], ...], AfterValidator(_covariance)]


def unit(value: Sequence[float]) -> Array:
    """`value` (n,) brought to length 1: the digits of a file are not enough for later products."""
    v = np.asarray(value, float)
    return v / np.linalg.norm(v)


def orthonormal(rows: Sequence[Sequence[float]]) -> Array:
    """Rotation matrix (3, 3) nearest to `rows` (polar decomposition)."""
    u, _, vt = np.linalg.svd(np.asarray(rows, float))
    return u @ vt


def check_inertia(tensor: Array) -> None:
    """Raise the error of a tensor (3, 3) that no body has.

    Moments about principal axes are positive and none exceeds the sum of the other two.
    """
    moments = np.linalg.eigvalsh(tensor)
    if moments[0] <= 0.0:
        found = f"a tensor that is not positive definite (least principal moment {moments[0]:.4g} kg m^2)"
        raise problem(found, "moments and products of inertia of a body, kg m^2")
    if moments[2] > (moments[0] + moments[1]) * (1.0 + 1e-9):
        found = "principal moments " + ", ".join(f"{m:.4g}" for m in moments)
        raise problem(found, "kg m^2, none above the sum of the other two, as in any body")
