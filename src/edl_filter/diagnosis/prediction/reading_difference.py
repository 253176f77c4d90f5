"""Difference of the residuals of two sets of readings along one path: the derivative with respect to a sensor error.

Residuals are linear in the readings but for the loads, so that the difference of two of them is formed from the
difference of the readings. It has less rounding error than the difference of whole residuals, and what is the same on
both sides is not computed.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from edl_filter.diagnosis.prediction.dead_reckoning import node_rates
from edl_filter.diagnosis.prediction.predicted_readings import predict
from edl_filter.diagnosis.prediction.residuals import ModelInputs, Residuals, bin_readings, lever_arm_readings
from edl_filter.diagnosis.prediction.time_bins import TimeBins, bin_means, bin_means_of_readings
from edl_filter.types import Array


@dataclass(frozen=True)
class BinResiduals:
    """Residuals of the bins, or differences of them.

    Attributes
    ----------
    force : (B, 3) array
        Specific force, m/s².
    rate_step : (B - 1, 3) array
        Step of the mean rate between adjoining bins, rad/s.
    checking_force, checking_rate : tuples of (B, 3) arrays
        Of each checking IMU, m/s² and rad/s.
    """

    force: Array
    rate_step: Array
    checking_force: tuple[Array, ...]
    checking_rate: tuple[Array, ...]


def difference_on_fixed_path(
    bins: TimeBins,
    plus: tuple[ModelInputs, Array, Array],
    minus: tuple[ModelInputs, Array, Array],
    fixed: Residuals,
    same_loads: bool,
) -> BinResiduals:
    """Difference of two residuals, plus less minus, with other readings and another vehicle along a fixed path.

    Parameters
    ----------
    bins : TimeBins
        Time bins of the comparison.
    plus, minus : (inputs, force, rate)
        The model, and the readings corrected by its sensor effects: of `corrected_readings`, ``(N, 3)`` each.
    fixed : Residuals
        Whose path, air and table coefficients are used.
    same_loads : bool
        Whether the loads are the same on both sides if the rates are.
    """
    samples = plus[0].problem.samples
    force, rate = bin_readings(bins, samples, (plus[1] - minus[1], plus[2] - minus[2]))
    checking_force, checking_rate = [], []
    for record_plus, record_minus in zip(plus[0].checking, minus[0].checking, strict=True):
        implied = lever_arm_readings(record_plus, samples, plus[2]) - lever_arm_readings(
            record_minus, samples, minus[2]
        )
        checking_force.append(-force - bin_means(bins.edges, samples.time, samples.interval, implied))
        checking_rate.append(-rate)
        if record_plus is not record_minus:
            changes = (
                record_plus.specific_force - record_minus.specific_force,
                record_plus.angular_rate - record_minus.angular_rate,
            )
            for out, change in zip((checking_force, checking_rate), changes, strict=True):
                out[-1] = out[-1] + bin_means_of_readings(bins, record_plus, change)
    rate_step = np.diff(rate, axis=0)
    if not (same_loads and np.array_equal(plus[2], minus[2])):
        predicted = []
        for inputs, _, sample_rate in (plus, minus):
            mean_rate = bin_means(bins.edges, samples.time, samples.interval, sample_rate)
            flow = replace(fixed.flow, rate=node_rates(bins, mean_rate))
            predicted.append(predict(inputs.forward_model, bins, flow, fixed.tables))
        force = force - (predicted[0][0] - predicted[1][0])
        rate_step = rate_step - (predicted[0][1] - predicted[1][1])
    return BinResiduals(force, rate_step, tuple(checking_force), tuple(checking_rate))
