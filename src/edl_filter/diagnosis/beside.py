"""Beside the model's own effects: what a further effect explains that they could not.

A model's effects were refitted before they were added, at the noise of that time and beside fewer others; some leave
the same mark as what is tried next. So while effects are tried linearly, the parameters of the model's own are unknowns
with their priors, as every refit has them. With X their white signatures times their prior sigmas, white rows then have
the covariance ``1 + X Xᵀ``; its inverse root, from the singular values s and left vectors U of X, is
``1 - U (1 - 1/√(1 + s²)) Uᵀ``.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from edl_filter.diagnosis.linear import Linear
from edl_filter.diagnosis.signatures import signature
from edl_filter.diagnosis.whitening import Whitener, Whitens

Array = NDArray[np.float64]


def beside_own(linear: Linear, whiten: Whitener) -> Whitens:
    """A whitener to which the parameters of the model's own effects are unknown too.

    Parameters
    ----------
    linear : Linear
    whiten : Whitener
        Of its problem.

    Returns
    -------
    callable
        The whitener itself where the model has no effect that is not fixed.
    """
    own = [signature(linear.ground, a, [q.name for q in a.fitted]) for a in linear.ground.effects if a.fitted]
    if not own:
        return whiten
    marks = whiten(np.concatenate([s.rows for s in own], axis=1), np.concatenate([s.start for s in own], axis=1))
    left, size, _ = np.linalg.svd(marks * np.concatenate([s.sigma for s in own]), full_matrices=False)
    taken = 1.0 - 1.0 / np.sqrt(1.0 + size**2)

    def white(columns: Array, start: Array) -> Array:
        rows = whiten(columns, start)
        return rows - left @ (taken[:, None] * (left.T @ rows))

    return white
