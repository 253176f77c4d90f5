"""Predicted readings of the driving IMU: force and moment of the forward model, sampled as the IMU samples.

Input: the flow at the nodes of every time bin. Method: specific force is averaged over the bin by Simpson's rule. Rates
are never differentiated: the step of the mean rate from one bin to the next is the integral of the angular acceleration
with a triangular weight,

    w[k+1] - w[k] = ∫ α(t) (t - t[k-1])/dt dt over bin k  +  ∫ α(t) (t[k+1] - t)/dt' dt over bin k + 1,

and Euler's equations (Thomas 2011, eqs. 6.6 to 6.8) give α at the nodes. Output: means of the specific force by bin,
steps of the mean rate between adjoining bins, and a bound of the quadrature's error.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import median_filter

from edl_filter.diagnosis.prediction.dead_reckoning import NODES_PER_BIN, PathNodes, node_times
from edl_filter.diagnosis.prediction.time_bins import TimeBins
from edl_filter.effects.forward_model import ForwardModel
from edl_filter.effects.types import AeroCoefficients, FlightCondition
from edl_filter.types import Array

#: Weights of Simpson's rule over a bin of unit length, with all nodes and with every second one.
_SIMPSON = np.where(np.arange(NODES_PER_BIN + 1) % 2, 4.0, 2.0) / (3.0 * NODES_PER_BIN)
_COARSE_SIMPSON = np.where(
    np.arange(NODES_PER_BIN + 1) % 4 == 2, 8.0, np.where(np.arange(NODES_PER_BIN + 1) % 4 == 0, 4.0, 0.0)
) / (3.0 * NODES_PER_BIN)
_SIMPSON[[0, -1]] /= 2.0
_COARSE_SIMPSON[[0, -1]] /= 2.0
#: Bins of the median below which no error bound is: ten before and ten after.
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
        At the nodes.
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
    """Specific force (m/s²) and angular acceleration (rad/s²) at the nodes ``(M, 3)``; arguments as of `predict`."""
    force, moment = model.loads(flow, tables)
    return model.specific_force(flow.time, force), model.angular_acceleration(flow.time, flow.rate, moment)


def predict_increment(model: ForwardModel, bins: TimeBins, force: Array, moment: Array) -> tuple[Array, Array]:
    """Change of `predict` by additional force (N) and moment (N m) at the nodes, ``(M, 3)`` each."""
    time = node_times(bins)
    acceleration = model.angular_acceleration(time, np.zeros_like(moment), moment)
    return bin_average(model.specific_force(time, force), bins), triangular_integral(acceleration, bins)


def bin_average(values: Array, bins: TimeBins) -> Array:
    """Means over the bins ``(B, ...)`` from values at the nodes ``(NODES_PER_BIN B + 1, ...)``, by Simpson's rule."""
    return _weighted_sum(values, _SIMPSON)


def rate_step_from_moment(model: ForwardModel, bins: TimeBins, flow: FlightCondition, moment: Array) -> Array:
    """Steps of the mean rate ``(B - 1, 3)``, rad/s, from the moment at the nodes ``(M, 3)``, N m."""
    return triangular_integral(model.angular_acceleration(flow.time, flow.rate, moment), bins)


def triangular_integral(values: Array, bins: TimeBins, weights: Array | None = None) -> Array:
    """Integrals over two adjoining bins with a triangular weight.

    Parameters
    ----------
    values : (NODES_PER_BIN B + 1, ...) array
        At the nodes.
    bins : TimeBins
        Time bins of the comparison.
    weights : (NODES_PER_BIN + 1,) array, optional
        Quadrature weights over a bin of unit length; Simpson's rule if not given.

    Returns
    -------
    (B - 1, ...) array
    """
    rule = _SIMPSON if weights is None else weights
    dt = bins.interval.reshape(-1, *(1,) * (values.ndim - 1))
    fraction = np.arange(NODES_PER_BIN + 1) / NODES_PER_BIN
    rising, falling = _weighted_sum(values, rule * fraction), _weighted_sum(values, rule * (1.0 - fraction))
    return dt[:-1] * rising[:-1] + dt[1:] * falling[1:]


def quadrature_error(
    model: ForwardModel, bins: TimeBins, flow: FlightCondition, force: Array, moment: Array
) -> tuple[Array, Array]:
    """Error bound of the sums over nodes: a third of their change when every second node is left out.

    Between the nodes of its tables the model is smooth and the error is negligible. A change of slope inside a bin
    reduces the rule to second order, whose error is a third of the last refinement (Richardson). Over all places of the
    change in a bin, the RMS of the bound is 1.5 times that of the error.

    A vehicle that oscillates fast passes several nodes of a table in each bin. Bound and error are then independent,
    and in one bin of a few the bound is much smaller than the error. So it is at least its median over the ten bins
    before and after: that of the modulus of a normal variable with 1.5 sigmas, about one sigma of the error.

    Parameters
    ----------
    model : ForwardModel
        The forward model.
    bins : TimeBins
        Time bins of the comparison.
    flow : FlightCondition
        Flow at the nodes.
    force, moment : (M, 3) arrays
        At the nodes, N and N m.

    Returns
    -------
    force, rate_step : (B, 3), (B - 1, 3) arrays
        m/s², rad/s.
    """
    acceleration = model.angular_acceleration(flow.time, flow.rate, moment)
    specific_force = model.specific_force(flow.time, force)
    force_bound = np.abs(_weighted_sum(specific_force, _SIMPSON - _COARSE_SIMPSON)) / 3.0
    rate_bound = np.abs(triangular_integral(acceleration, bins, _SIMPSON - _COARSE_SIMPSON)) / 3.0
    return _at_least_median(force_bound), _at_least_median(rate_bound)


def _at_least_median(bound: Array) -> Array:
    """Values ``(B, 3)``, each not below the median of those around it."""
    return np.maximum(bound, median_filter(bound, (_MEDIAN_BINS, 1)))


def _weighted_sum(values: Array, weights: Array) -> Array:
    """Weighted sums over the nodes of every bin."""
    last = len(values) - 1
    out = weights[0] * values[:last:NODES_PER_BIN]
    for i in range(1, NODES_PER_BIN):
        out = out + weights[i] * values[i:last:NODES_PER_BIN]
    return out + weights[NODES_PER_BIN] * values[NODES_PER_BIN::NODES_PER_BIN]
