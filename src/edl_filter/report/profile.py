"""What of the flight's atmosphere is known well enough to be drawn."""

from __future__ import annotations

import numpy as np

from edl_filter.types import Array

#: Before the parachute, s: its first pull reaches the smoothed deceleration that far back.
EDGE = 0.5
#: Relative sigma up to which a temperature or a ratio is worth a line.
KNOWN = 0.1


def known(values: Array, sigma: Array | None) -> Array:
    """`values` with gaps where their sigma is too large; all of them where none is stated."""
    return values if sigma is None else np.where(sigma < KNOWN * np.abs(values), values, np.nan)
