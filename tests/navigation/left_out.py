"""Residuals of constraints that are left out, in sigmas."""

import numpy as np


def left_out_sigmas(check):
    """Largest component of the left-out residual of a `ConstraintCheck` in sigmas; NaN where one has no sigma."""
    if not np.all(check.left_out_sigma > 0.0):
        return np.nan
    return np.max(np.abs(check.left_out / check.left_out_sigma))
