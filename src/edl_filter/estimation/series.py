"""Series of samples: stretches in which a condition holds."""

from __future__ import annotations

import numpy as np

from edl_filter.types import BoolArray


def runs(selected: BoolArray) -> list[tuple[int, int]]:
    """First index and end (exclusive) of every run of true values of `selected` (N,)."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], selected.astype(np.int8), [0]))))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]
