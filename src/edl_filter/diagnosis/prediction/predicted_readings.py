"""Predicted readings of the driving IMU: force and moment of the forward model, sampled as the IMU samples.

Input: the flow at the nodes of every time bin. Method: specific force is averaged over the bin by Simpson's rule. Rates
are never differentiated: the step of the mean rate from one bin to the next is the integral of the angular acceleration
with a triangular weight,

    w[k+1] - w[k] = ∫ α(t) (t - t[k-1])/dt dt over bin k  +  ∫ α(t) (t[k+1] - t)/dt' dt over bin k + 1,

and Euler's equations (Thomas 2011, eqs. 6.6 to 6.8) give α at the nodes. Output: means of the specific force by bin,
and steps of the mean rate between adjoining bins.

Between the nodes of its tables the model is smooth and the error of the rule is negligible. A change of slope inside a
bin reduces the rule to second order: the error of a step of the rate is then up to twice the gyros' noise with
`NODES_PER_BIN` nodes. The predictions about a linearisation point are corrected by those with `FINE_NODES_PER_BIN`.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import median_filter

from edl_filter.diagnosis.prediction.dead_reckoning import NODES_PER_BIN, PathNodes, node_times
from edl_filter.diagnosis.prediction.time_bins import TimeBins
from edl_filter.effects.forward_model import ForwardModel
from edl_filter.effects.types import AeroCoefficients, FlightCondition
from edl_filter.types import Array

#: Nodes in a bin of the fine rule, a multiple of `NODES_PER_BIN`.
FINE_NODES_PER_BIN = 16
#: Bins of the median below which no sigma of the fine rule is: ten before and ten after.
_MEDIAN_BINS = 21


def flow_at(model: ForwardModel, nodes: PathNodes) -> FlightCondition:
    """Flow about the vehicle at the nodes."""
    return model.flow(nodes.time, nodes.nav[:, :3], nodes.nav[:, 3:6], nodes.nav[:, 6:], nodes.rate)


def predict(
    model: ForwardModel, bins: TimeBins, flow: FlightCondition, tables: AeroCoefficients | None = None
) -> tuple[Array, Array]:
    """Predicted readings.

    Parameters
    ----------
    model : ForwardModel
        The forward model.
    bins : TimeBins
        Time bins of the comparison.
    flow : FlightCondition
        At the nodes, of which each bin has the same even number.
    tables : AeroCoefficients, optional
        Coefficients of the database there, if they are computed already.

    Returns
    -------
    force : (B, 3) array
        Mean specific force in the bins, m/s².
    rate_step : (B - 1, 3) array
        Steps of the mean rate between adjoining bins, rad/s.
    """
    specific_force, acceleration = accelerations_at_nodes(model, flow, tables)
    return bin_average(specific_force, bins), triangular_integral(acceleration, bins)


def accelerations_at_nodes(
    model: ForwardModel, flow: FlightCondition, tables: AeroCoefficients | None = None
) -> tuple[Array, Array]:
    """Specific force and angular acceleration at the nodes.

    Parameters
    ----------
    model, flow, tables
        As of `predict`.

    Returns
    -------
    specific_force, angular_acceleration : (M, 3) arrays
        m/s² and rad/s², body axes.
    """
    force, moment = model.loads(flow, tables)
    return model.specific_force(flow.time, force), model.angular_acceleration(flow.time, flow.rate, moment)


def predict_increment(model: ForwardModel, bins: TimeBins, force: Array, moment: Array) -> tuple[Array, Array]:
    """Change of `predict` by additional force (N) and moment (N m) at the nodes, ``(M, 3)`` each."""
    time = node_times(bins)
    acceleration = model.angular_acceleration(time, np.zeros_like(moment), moment)
    return bin_average(model.specific_force(time, force), bins), triangular_integral(acceleration, bins)


def bin_average(values: Array, bins: TimeBins) -> Array:
    """Means over the bins ``(B, ...)`` by Simpson's rule, from values at the nodes ``(n B + 1, ...)`` with n even."""
    return _weighted_sum(values, _simpson_weights(values, bins))


def rate_step_from_moment(model: ForwardModel, bins: TimeBins, flow: FlightCondition, moment: Array) -> Array:
    """Steps of the mean rate ``(B - 1, 3)``, rad/s, from the moment at the nodes ``(M, 3)``, N m."""
    return triangular_integral(model.angular_acceleration(flow.time, flow.rate, moment), bins)


def triangular_integral(values: Array, bins: TimeBins) -> Array:
    """Integrals over two adjoining bins with a triangular weight, by Simpson's rule.

    Parameters
    ----------
    values : (n B + 1, ...) array
        At the nodes, with an even number n of them in a bin.
    bins : TimeBins
        Time bins of the comparison.

    Returns
    -------
    (B - 1, ...) array
    """
    rule = _simpson_weights(values, bins)
    dt = bins.interval.reshape(-1, *(1,) * (values.ndim - 1))
    fraction = np.linspace(0.0, 1.0, len(rule))
    rising, falling = _weighted_sum(values, rule * fraction), _weighted_sum(values, rule * (1.0 - fraction))
    return dt[:-1] * rising[:-1] + dt[1:] * falling[1:]


def fine_rule_sigma(correction: Array) -> Array:
    """Sigma of the fine rule's error, from the difference of the fine rule and the one with `NODES_PER_BIN` nodes.

    At a change of slope the RMS error over all its places in a bin is proportional to the square of the nodes' distance
    (Richardson 1911). In a single bin the two errors are independent, and the difference may be small by chance: no
    sigma is below the median of those of the ten bins before and after.

    Parameters
    ----------
    correction : (B, 3) array
        Predictions by the fine rule less those by the other.

    Returns
    -------
    (B, 3) array
        In the unit of the correction.
    """
    sigma = np.abs(correction) / ((FINE_NODES_PER_BIN / NODES_PER_BIN) ** 2 - 1.0)
    return np.maximum(sigma, median_filter(sigma, (_MEDIAN_BINS, 1)))


def _simpson_weights(values: Array, bins: TimeBins) -> Array:
    """Weights ``(n + 1,)`` over a bin of unit length, for values at n nodes in each bin and at the end of the last."""
    count = (len(values) - 1) // len(bins.interval)
    weights = np.where(np.arange(count + 1) % 2, 4.0, 2.0) / (3.0 * count)
    weights[[0, -1]] /= 2.0
    return weights


def _weighted_sum(values: Array, weights: Array) -> Array:
    """Weighted sums over the nodes of every bin, and the first of the next."""
    count, last = len(weights) - 1, len(values) - 1
    out = weights[0] * values[:last:count]
    for i in range(1, count):
        out = out + weights[i] * values[i:last:count]
    return out + weights[count] * values[count::count]
