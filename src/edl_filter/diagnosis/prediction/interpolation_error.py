"""Error of lever-arm accelerations that are computed from mean rates, predicted by the forward model.

The acceleration of an IMU's place needs the rates at the edges of the samples and the products of the rates inside
them. From means over the samples they follow by interpolation only (`imu_model.lever_arm.edge_values`), which has the
order of its stencil where the motion is smooth. It has not where the moment changes its slope inside a sample: at the
nodes of an aerodynamic table that is linear between them. On a vehicle that swings through 30° at 8 Hz the
interpolation is wrong by up to 60 sigmas of an accelerometer.

The forward model predicts the angular acceleration at several nodes in each bin. The same interpolation of the means
of the predicted rates, compared with the predicted rates themselves, shows its error. Only differences of rates over a
few samples enter, so that the error of the prediction does not accumulate.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.interpolate import CubicSpline

from edl_filter.imu_model.lever_arm import (
    EDGE_REACH,
    lever_arm_acceleration,
    lever_arm_acceleration_of_products,
)
from edl_filter.navigation.increments import Samples
from edl_filter.navigation.rotation_corrections import nodes
from edl_filter.types import Array

#: Gauss-Legendre nodes in a sample: exact for products of rates that are polynomials of fourth degree.
QUADRATURE_NODES = 5


def interpolation_error(
    samples: Samples, time: Array, angular_acceleration: Array, positions: Sequence[Array]
) -> list[Array]:
    """Mean lever-arm acceleration of a predicted rotation, less that interpolated from its mean rates.

    Parameters
    ----------
    samples : Samples
        The driving IMU's; the rates of N samples are means over them.
    time : (M,) array
        s, increasing, from the first edge of the samples on.
    angular_acceleration : (M, 3) array
        Predicted at `time`, rad/s², body axes.
    positions : sequence of (N, 3) arrays
        Places of instruments from the centre of mass at the samples, m, body axes.

    Returns
    -------
    list of (N, 3) arrays
        By instrument, m/s². Zero after the last `time`, and at both ends, where the interpolation has not all its
        neighbours.
    """
    count = samples.index(float(time[-1]))
    interval = samples.interval[:count]
    edges = samples.edges[: count + 1]
    rate = CubicSpline(time, angular_acceleration, axis=0).antiderivative()
    mean_rate = np.diff(rate.antiderivative()(edges), axis=0) / interval[:, None]
    mean_acceleration = np.diff(rate(edges), axis=0) / interval[:, None]
    abscissae, weights = nodes(QUADRATURE_NODES)
    inside = rate((edges[:-1, None] + interval[:, None] * abscissae).ravel()).reshape(count, QUADRATURE_NODES, 3)
    pairs = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
    products = np.stack([(inside[:, :, i] * inside[:, :, j]) @ weights for i, j in pairs], axis=1)
    complete = slice(EDGE_REACH, count - EDGE_REACH)
    errors = []
    for position in positions:
        exact = lever_arm_acceleration_of_products(mean_acceleration, products, position[:count])
        interpolated = lever_arm_acceleration(interval, mean_rate, position[:count], samples.unit[:count])
        error = np.zeros((len(samples.time), 3))
        error[complete] = (exact - interpolated)[complete]
        errors.append(error)
    return errors
