"""Flights whose only unknown is a Gauss–Markov force and moment: their linear model, and simulated residuals."""

from types import SimpleNamespace

import numpy as np

from edl_filter.diagnosis.prediction.dead_reckoning import NODES_PER_BIN
from edl_filter.diagnosis.prediction.predicted_readings import bin_average, triangular_integral
from edl_filter.diagnosis.prediction.residuals import RowIndex
from edl_filter.diagnosis.prediction.time_bins import TimeBins
from edl_filter.estimation.block_sparse import from_blocks
from edl_filter.estimation.linear_state_space import LinearStateSpace

DT = 0.125
FORCE_SIGMA, STEP_SIGMA, RATE_SIGMA = 5e-3, 2e-4, 1e-4


def flight(count, checking=0):
    """State-space model without states, row index, bins, and a flow: a pulse of dynamic pressure, a rolling vehicle.

    Its angle of attack oscillates, with 0.7 Hz in pitch and 0.9 Hz in yaw, and so do its rates. Each of `checking` IMUs
    has three rows of specific force and three of rate in every bin.
    """
    edges = 20.0 + DT * np.arange(count + 1)
    bins = TimeBins(edges, np.ones(count, bool))
    width = 6 + 6 * checking
    in_last_bin = np.delete(np.arange(width), range(3, 6))  # no step of the rate follows the last bin
    rows = np.full((count, width), -1)
    rows[:-1] = np.arange(width * (count - 1)).reshape(-1, width)
    rows[-1, in_last_bin] = width * (count - 1) + np.arange(width - 3)
    total = width * count - 3
    sigma = np.repeat([FORCE_SIGMA, STEP_SIGMA, *[FORCE_SIGMA, RATE_SIGMA] * checking], 3)
    row_noise = np.tile(np.diag(sigma**2), (count, 1))[:total]
    row_noise[rows[-1, in_last_bin], :] = np.eye(width - 3, width) * sigma[in_last_bin, None] ** 2
    empty = from_blocks(0, [(slice(0, 0), slice(0, 0), np.zeros((count, 0, 0)))])
    model = LinearStateSpace(
        increment=empty,
        process_noise=empty,
        row_start=np.append(np.arange(count) * width, total),
        design=np.zeros((total, 0)),
        row_noise=row_noise,
        initial_covariance=np.zeros((0, 0)),
    )
    column = np.arange(total) % width
    index = RowIndex(rows, (), total, np.full(count, DT), np.repeat(edges[1:], width)[:total], column)
    fraction = np.linspace(0.0, 1.0, NODES_PER_BIN * count + 1)
    phase = 2.0 * np.pi * np.outer(DT * count * fraction, [0.7, 0.9])
    speed = 4e3 - 3e3 * fraction
    angle = [0.05, 0.04] * np.cos(phase)  # w/V and v/V
    lateral_rate = [-0.22, 0.23] * np.sin(phase)  # q and r
    flow = SimpleNamespace(
        dynamic_pressure=8e3 * np.exp(-0.5 * ((fraction - 0.6) / 0.2) ** 2),
        speed=speed,
        velocity_body=speed[:, None] * np.column_stack((np.ones_like(speed), angle[:, 1], angle[:, 0])),
        rate=np.column_stack((np.full_like(speed, 0.2), lateral_rate)),
    )
    return model, index, bins, flow


def simulated_process(case, rng, force=0.0, moment=0.0, memory=10.0, scale=1.0):
    """Specific force (m/s²) and angular acceleration (rad/s²) at the nodes, ``(M, 6)``."""
    nodes = NODES_PER_BIN * len(case[2].interval) + 1
    decay = np.exp(-DT / NODES_PER_BIN / memory)
    process = np.empty((nodes, 6))
    process[0] = rng.normal(size=6)
    for k in range(1, nodes):
        process[k] = decay * process[k - 1] + np.sqrt(1.0 - decay**2) * rng.normal(size=6)
    return process * np.repeat([force, moment], 3) * np.broadcast_to(np.reshape(scale, (-1, 1)), (nodes, 1))


def residuals_of(case, rng, process):
    """Residuals ``(R,)`` under a process at the nodes ``(M, 6)``, with the stated noise."""
    _, index, bins, _ = case
    by_bin = np.full((len(bins.interval), 6), np.nan)
    by_bin[:, :3], by_bin[:-1, 3:] = bin_average(process[:, :3], bins), triangular_integral(process[:, 3:], bins)
    by_bin += np.repeat([FORCE_SIGMA, STEP_SIGMA], 3) * rng.normal(size=by_bin.shape)
    out, used = np.zeros(index.count), index.bin_rows >= 0
    out[index.bin_rows[used]] = by_bin[used]
    return out
