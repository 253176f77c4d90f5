"""Channels of the residuals: names, units, normalised innovations, and their RMS over the flight.

Innovations are those of a Kalman filter at the noise that the residuals show (`noise.variance_components`), so that one
failure does not spread over other channels. They are normalised by the stated noise, so that the failure remains
visible.
"""

from __future__ import annotations

import numpy as np

from edl_filter.diagnosis.linear_model.linear_model import LinearizedModel
from edl_filter.types import Array

AXES = ("x", "y", "z")


def channels(model: LinearizedModel) -> list[tuple[str, str]]:
    """Names and units of the bins' channels, in the order of their rows."""
    names = [(f"force_{a}", "m/s^2") for a in AXES] + [(f"moment_{a}", "rad/s^2") for a in AXES]
    for record in model.inputs.checking:
        names += [(f"{record.name}_force_{a}", "m/s^2") for a in AXES]
        names += [(f"{record.name}_rate_{a}", "rad/s") for a in AXES]
    return names


def normalised_innovations(model: LinearizedModel) -> Array:
    """Innovations ``(R,)`` at the fitted noise, in sigmas of the stated noise."""
    whiten = model.fitted_noise_filter
    return whiten.innovations(model.white_residuals(whiten)) / model.stated_noise_filter.innovation_sigma


def rms_by_channel(model: LinearizedModel, normalised: Array) -> dict[str, float]:
    """Channel → RMS over the flight of normalised innovations ``(R,)``."""
    by_channel = {}
    for c, (name, _) in enumerate(channels(model)):
        rows = model.index.bin_rows[:, c]
        by_channel[name] = _rms(normalised[rows[rows >= 0]])
    return by_channel


def rms_by_constraint(model: LinearizedModel, normalised: Array) -> dict[str, float]:
    """Constraint → RMS over all its uses of normalised innovations ``(R,)``."""
    values: dict[str, list[float]] = {}
    for constraint, rows in zip(model.inputs.problem.constraints, model.index.constraint_rows, strict=True):
        values.setdefault(constraint.name, []).extend(normalised[rows])
    return {name: _rms(np.array(v)) for name, v in values.items()}


def model_rms(model: LinearizedModel) -> dict[str, float]:
    """Channel or constraint → normalised RMS of a model."""
    normalised = normalised_innovations(model)
    return rms_by_channel(model, normalised) | rms_by_constraint(model, normalised)


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values)))) if len(values) else float("nan")
