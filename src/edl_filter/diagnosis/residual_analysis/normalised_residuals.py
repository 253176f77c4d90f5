"""Normalised residuals of the channels: against time, the content of ``residuals.nc``, and their RMS over the flight.

A residual is measured minus predicted, after the nuisance parameters have been estimated from all earlier residuals: an
innovation of the Kalman filter at the noise that the residuals show (`noise.variance_components`), so that one failure
does not spread over other channels. It is normalised by its one sigma at the stated noise, so that the failure remains
visible. If the model holds, the normalised RMS is one. All normalised RMS of a model are of these residuals; those of
the navigation filter's innovations (`results.summary`) are about the reconstruction, which does not use the model.
"""

from __future__ import annotations

import numpy as np

from edl_filter.diagnosis.linear_model.linear_model import LinearizedModel
from edl_filter.results.groups import Group, Groups
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
    """Innovations ``(R,)`` at the fitted noise, over their sigma at the stated noise."""
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


def residual_series(model: LinearizedModel) -> Groups:
    """Groups of ``residuals.nc``.

    Returns
    -------
    dict of Group
        Root: ``time`` (bins' middles, s), ``channel``, ``unit`` (text by channel), ``residual`` and ``sigma``
        ``(channel, time)`` in the channel's unit, and ``normalised``, their ratio; NaN where nothing is compared.
    """
    index, bins = model.index, model.bins
    normalised, stated = normalised_innovations(model), model.stated_noise_filter.innovation_sigma
    named = channels(model)
    ratio, sigma = (np.full((len(named), len(bins.interval)), np.nan) for _ in range(2))
    for c in range(len(named)):
        used = np.flatnonzero(index.bin_rows[:, c] >= 0)
        rows = index.bin_rows[used, c]
        scale = 1.0 / bins.interval[used] if 3 <= c < 6 else 1.0  # steps of the rate, as accelerations
        ratio[c, used], sigma[c, used] = normalised[rows], stated[rows] * scale
    group = Group()
    group.add("time", ("time",), bins.middle, "s", "time since the epoch, middle of the bin")
    group.label("channel", [name for name, _ in named], "what is compared")
    group.text("unit", "channel", [unit for _, unit in named], "unit of residual and sigma")
    dims = ("channel", "time")
    group.add(
        "residual", dims, ratio * sigma, "1", "measured less predicted, nuisance parameters estimated, in its unit"
    )
    group.add("sigma", dims, sigma, "1", "one sigma of the residual as stated, in its unit")
    group.add("normalised", dims, ratio, "1", "residual over sigma")
    return {"/": group}


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values)))) if len(values) else float("nan")
