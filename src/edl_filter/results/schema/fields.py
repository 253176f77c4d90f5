"""What all schemas share: the base of their models, types of numbers, and the declaration of a key."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Self

from pydantic import BaseModel, ConfigDict, Field

#: A number, or null where it is not finite.
Number = float | None
Vector = tuple[float, float, float]
NumberVector = tuple[Number, Number, Number]


class Content(BaseModel):
    """A part of a file: frozen, and without any other key."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)

    @classmethod
    def of(cls, content: Self | Mapping[str, Any]) -> Self:
        """Model of plain data, in which tuples may be lists; a model is returned as it is."""
        return content if isinstance(content, cls) else cls.model_validate(content, strict=False)


def key(description: str, **more: Any) -> Any:
    """A key that is always in the file."""
    return Field(description=description, **more)


def optional(description: str) -> Any:
    """A key that may be absent."""
    return Field(default=None, description=description)
