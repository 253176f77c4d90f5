"""Plain data for JSON."""

from __future__ import annotations

import math
from typing import Any

import numpy as np


def finite(data: Any) -> Any:
    """`data` with None for every number that is not finite, and arrays as lists."""
    if isinstance(data, dict):
        return {key: finite(value) for key, value in data.items()}
    if isinstance(data, list | tuple):
        return [finite(value) for value in data]
    if isinstance(data, np.floating):
        return finite(float(data))
    if isinstance(data, np.ndarray | np.generic):
        return finite(data.tolist())
    return None if isinstance(data, float) and not math.isfinite(data) else data
