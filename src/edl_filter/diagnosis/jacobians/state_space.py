"""The linear state-space model of all residuals, in the order of time.

States: the error of the filter's vector, which propagates along the path (`transitions`), and the nuisance parameters
with their own stochastic models (`nuisance`). Measurements: the rows of every bin and of every constraint.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain

import numpy as np

from edl_filter.diagnosis.jacobians.bin_rows import BinRows
from edl_filter.diagnosis.jacobians.nuisance import FIELD_STATES, NuisanceLayout, StatedUncertainty
from edl_filter.diagnosis.jacobians.transitions import PathTransitions
from edl_filter.diagnosis.prediction.residuals import ModelInputs, Residuals, RowIndex
from edl_filter.diagnosis.prediction.time_bins import TimeBins, bin_sigma
from edl_filter.estimation.block_sparse import BlockSparse, from_blocks
from edl_filter.estimation.linear_state_space import LinearStateSpace
from edl_filter.estimation.matern import MATERN32_COVARIANCE, matern32_transition
from edl_filter.navigation.ekf import linearized_measurement
from edl_filter.navigation.initial import initial_estimate
from edl_filter.navigation.layout import State
from edl_filter.types import Array


def assemble_state_space(
    inputs: ModelInputs,
    bins: TimeBins,
    transitions: PathTransitions,
    rows: BinRows,
    nuisance: NuisanceLayout,
    uncertainty: StatedUncertainty,
    residuals: Residuals,
    flow_distance: Array,
) -> tuple[LinearStateSpace, RowIndex]:
    """Assemble the state-space model.

    Parameters
    ----------
    inputs : ModelInputs
        The model, and the readings corrected by its sensor effects.
    bins : TimeBins
        Time bins of the comparison.
    transitions : PathTransitions
        State transitions between the bins.
    rows : BinRows
        Jacobian and noise of the rows of every bin.
    nuisance : NuisanceLayout
        Positions of the nuisance parameters.
    uncertainty : StatedUncertainty
        Uncertainties that the mission states.
    residuals : Residuals
        For the altitude along the path.
    flow_distance : (M - 1,) array
        Distances between adjoining nodes, in correlation lengths of the database's discrepancy.
    """
    problem, n = inputs.problem, nuisance.layout.size
    widest = max(rows.used.shape[1], max((len(c.measured) for c in problem.constraints), default=1))
    starts, count = [], 0
    rows_in_all = int(np.count_nonzero(rows.used))
    rows_in_all += sum(len(problem.constraints[c].measured) for at_epoch in transitions.constraints for c in at_epoch)
    design, noise = np.zeros((rows_in_all, nuisance.size)), np.zeros((rows_in_all, widest))
    bin_index = np.full(rows.used.shape, -1, np.int64)
    constraint_rows: dict[int, slice] = {}
    steps = _StepIndex(transitions)
    bin_mean = _bin_mean_maps(transitions, len(bins.interval))
    for k in range(len(steps)):
        starts.append(count)
        bin_, constraint = steps.bin[k], steps.constraint[k]
        if bin_ >= 0:
            used = np.flatnonzero(rows.used[bin_])
            part = slice(count, count + len(used))
            bin_index[bin_, used] = np.arange(part.start, part.stop)
            h = rows.design[bin_].copy()
            h[:3, :n] = h[:3, :n] @ bin_mean[bin_]
            design[part] = h[used]
            noise[part, : len(used)] = rows.noise[bin_][np.ix_(used, used)]
            count = part.stop
        elif constraint >= 0:
            c = problem.constraints[constraint]
            part = slice(count, count + len(c.measured))
            design[part, :n] = linearized_measurement(c, transitions.states[steps.epoch[k]], nuisance.layout)[1]
            noise[part, : len(c.measured)] = c.noise
            constraint_rows[constraint] = part
            count = part.stop
    starts.append(count)
    del bin_mean  # large
    sigma = bin_sigma(bins, inputs.driving.time, inputs.driving.interval, inputs.driving.rate_noise)
    sigma = np.where(np.isfinite(sigma), sigma, np.nanmedian(sigma))
    interval = _step_intervals(steps, transitions, residuals)
    increment, process_noise = _stochastic_model(
        steps, transitions, nuisance, uncertainty, residuals, flow_distance, sigma, interval
    )
    return (
        LinearStateSpace(
            increment=increment,
            process_noise=process_noise,
            row_start=np.array(starts, np.int64),
            design=design[:count],
            row_noise=noise[:count],
            initial_covariance=_initial_covariance(inputs, nuisance, sigma[0]),
        ),
        RowIndex(
            bin_rows=bin_index,
            constraint_rows=tuple(constraint_rows[i] for i in range(len(problem.constraints))),
            count=count,
            step_interval=interval,
            time=np.repeat(transitions.time[np.array(steps.epoch)], np.diff(starts)),
            column=np.arange(count) - np.repeat(starts[:-1], np.diff(starts)),
        ),
    )


def stated_initial_error(inputs: ModelInputs, start: State) -> Array:
    """What the mission states of the filter's vector at the beginning, as an error about `start`, ``(n,)``."""
    return entry_prior(inputs)[0].minus(start)


def entry_prior(inputs: ModelInputs) -> tuple[State, Array]:
    """Stated state and covariance of the filter's vector at the beginning.

    Parameters
    ----------
    inputs : ModelInputs
        The model and its filter problem.

    Returns
    -------
    state : State
    covariance : (n, n) array
        In the units of `layout.UNITS`.
    """
    p = inputs.problem
    return initial_estimate(p.layout, p.initial, p.entry, p.instruments[int(p.samples.unit[0])], p.planet)


def _bin_mean_maps(transitions: PathTransitions, count: int) -> Array:
    """Maps from the filter's vector at every bin's end to its mean over the bin, ``(B, n, n)``.

    The mean is half the vector at the end and half the one at the beginning. A force is a mean over the bin, and the
    rotation of the body during half a bin is a thousandth of the derivative with respect to the attitude error.
    """
    eye = np.eye(transitions.transition.shape[1])
    over_bin, product = np.tile(eye, (count, 1, 1)), eye
    for transition, bin_ in zip(transitions.transition, transitions.bin, strict=True):
        product = transition @ product
        if bin_ >= 0:
            over_bin[bin_], product = product, eye
    over_bin[np.abs(np.linalg.det(over_bin)) < 0.5] = eye  # the driving instrument changed in between
    mean = np.linalg.inv(over_bin)
    mean += eye
    mean *= 0.5
    return np.asarray(mean, np.float64)


#: Rows and columns of a block of K matrices, and its values ``(K, r, c)``.
_Block = tuple[slice, slice, Array]


class _StepIndex:
    """Epoch, bin and constraint of each step of the model.

    Each epoch is one transition, followed by one step for each bin and constraint that is measured there.
    """

    def __init__(self, transitions: PathTransitions) -> None:
        self.epoch: list[int] = []
        self.moves: list[bool] = []
        self.bin: list[int] = []
        self.constraint: list[int] = []
        for e in range(len(transitions.time)):
            measured = [(int(transitions.bin[e]), -1)] if transitions.bin[e] >= 0 else []
            measured += [(-1, c) for c in transitions.constraints[e]]
            for i, (b, c) in enumerate(measured or [(-1, -1)]):
                self.epoch.append(e)
                self.moves.append(i == 0)
                self.bin.append(b)
                self.constraint.append(c)

    def __len__(self) -> int:
        return len(self.epoch)


def _stochastic_model(
    steps: _StepIndex,
    transitions: PathTransitions,
    nuisance: NuisanceLayout,
    uncertainty: StatedUncertainty,
    residuals: Residuals,
    flow_distance: Array,
    rate_sigma: Array,
    interval: Array,
) -> tuple[BlockSparse, BlockSparse]:
    """Transition less identity, and process noise, of all states.

    `rate_sigma` is the gyros' noise in the bins ``(B,)``, rad/s; `interval` the time of each step ``(K,)``, s.
    """
    n = nuisance.layout.size
    moves, epoch = np.array(steps.moves), np.array(steps.epoch)
    increment: list[_Block] = []
    noise: list[_Block] = []

    def of_path(matrices: Array, subtracted: Array | float) -> Iterator[_Block]:
        """The block of the filter's vector, which is as large as the design matrix: computed when it is asked for."""
        values = matrices[epoch]
        values -= subtracted
        values[~moves] = 0.0
        yield slice(0, n), slice(0, n), values

    before, after = nuisance["gyro_noise_before"], nuisance["gyro_noise_after"]
    gyro_noise_time = np.where(moves, transitions.gyro_noise_time[epoch], 0.0)
    increment.append((nuisance.layout["attitude"], after, -gyro_noise_time[:, None, None] * np.eye(3)))
    ends = np.array(steps.bin)
    # at a bin's end its noise becomes that of the bin before, and that of the next bin is drawn
    bin_ends = (ends >= 0)[:, None, None] * np.eye(3)
    increment += [(before, before, -bin_ends), (before, after, bin_ends), (after, after, -bin_ends)]
    next_sigma = rate_sigma[np.minimum(ends + 1, len(rate_sigma) - 1)]
    noise.append((after, after, (next_sigma**2)[:, None, None] * bin_ends))
    time = np.concatenate((residuals.path.time[:1], transitions.time))
    altitude = np.interp(time, residuals.nodes.time, residuals.flow.altitude)
    altitude_step = np.diff(altitude)[epoch] * moves
    for name, distance in uncertainty.correlation_steps(interval, altitude_step).items():
        if name in nuisance:
            part = nuisance[name]
            transition, process_noise = matern32_transition(distance)
            increment.append((part, part, transition - np.eye(2)))
            noise.append((part, part, process_noise))
    if nuisance.fields:
        along_flow = np.concatenate(([0.0], np.cumsum(flow_distance)))
        step = np.diff(np.interp(time, residuals.nodes.time, along_flow))[epoch] * moves
        transition, process_noise = matern32_transition(step)
        for values in nuisance.fields.values():
            for i in range(values.start, values.stop):
                states = field_states(values, i)
                for a in range(FIELD_STATES):
                    for b in range(FIELD_STATES):
                        place = states[a], states[b]
                        identity = 1.0 if a == b else 0.0
                        increment.append((*place, transition[:, a, b, None, None] - identity))
                        noise.append((*place, process_noise[:, a, b, None, None]))
    return (
        from_blocks(nuisance.size, chain(of_path(transitions.transition, np.eye(n)), increment)),
        from_blocks(nuisance.size, chain(of_path(transitions.process_noise, 0.0), noise)),
    )


def field_states(values: slice, state: int) -> list[slice]:
    """Places of one amplitude of a discrepancy and of its derivatives, given those of all amplitudes."""
    count = values.stop - values.start
    return [slice(state + k * count, state + k * count + 1) for k in range(FIELD_STATES)]


def _step_intervals(steps: _StepIndex, transitions: PathTransitions, residuals: Residuals) -> Array:
    """Time between each step and the one before ``(K,)``, s."""
    edges = np.concatenate((residuals.path.time[:1], transitions.time))
    return np.diff(edges)[np.array(steps.epoch)] * np.array(steps.moves)


def _initial_covariance(inputs: ModelInputs, nuisance: NuisanceLayout, rate_sigma: float) -> Array:
    layout = nuisance.layout
    p = np.zeros((nuisance.size, nuisance.size))
    p[: layout.size, : layout.size] = entry_prior(inputs)[1]
    for name, part in nuisance.slices.items():
        width = part.stop - part.start
        if name.startswith("checking"):
            instrument, error = name.removeprefix("checking").split("_", 1)
            imu, unit = map(int, instrument.split("."))
            sigma = getattr(inputs.checking[imu].errors[unit], error)
        else:
            sigma = {"gyro_noise_before": 0.0, "gyro_noise_after": rate_sigma}.get(name, 1.0)
        p[part, part] = sigma**2 * np.eye(width)
        if width == 2:
            p[part, part] = MATERN32_COVARIANCE
    for values in nuisance.fields.values():
        count = values.stop - values.start
        part = slice(values.start, values.start + FIELD_STATES * count)
        p[part, part] = np.kron(MATERN32_COVARIANCE, np.eye(count))
    return p
