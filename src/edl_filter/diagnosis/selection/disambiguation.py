"""Disambiguation: the measurement that would distinguish two names which this flight does not.

Each candidate is evaluated on the linear model of the flight: a nuisance parameter is taken as known, or a constraint
as ten times more accurate. The part of one effect's columns that no size of the other reproduces is then counted in
nats: the evidence by which the two would be distinguished.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from edl_filter.diagnosis.linear_model.effect_jacobian import effect_jacobian
from edl_filter.diagnosis.linear_model.linear_model import LinearizedModel
from edl_filter.effects.base import EffectInstance
from edl_filter.estimation.block_sparse import BlockSparse
from edl_filter.estimation.kalman import LinearStateSpace, whitening_filter
from edl_filter.types import Array, IntArray

#: What could be known, and the states that would then have no error.
KNOWLEDGE = {
    "the air's density": ("density",),
    "the winds": ("wind_east", "wind_north"),
    "the mass": ("mass",),
    "the inertia": ("inertia",),
    "the coefficients, by a database without error": ("ca", "cn", "cm"),
    "the attitude at entry": ("attitude", "entry_frame", "onboard_attitude", "onboard_mounting"),
    "the entry state's position and velocity": ("position", "velocity", "entry_epoch"),
    "the accelerometers' errors": ("accelerometer_bias", "accelerometer_scale", "accelerometer_misalignment"),
    "the gyros' errors": ("gyro_bias", "gyro_scale", "onboard_rate"),
}


@dataclass(frozen=True)
class Discriminator:
    """A measurement that distinguishes two effects.

    Attributes
    ----------
    measurement : str
    evidence : float
        By which the two would be distinguished, nats.
    """

    measurement: str
    evidence: float


def best_discriminator(model: LinearizedModel, first: EffectInstance, second: EffectInstance) -> Discriminator | None:
    """The measurement that distinguishes two effects best, about their values; None where none is sufficient."""
    pair = (first, second)
    jacobians = [effect_jacobian(model, a.at_zero()) for a in pair]
    sizes = [np.array([a.values[n] for n in j.names]) for a, j in zip(pair, jacobians, strict=True)]
    rows = np.concatenate([j.rows for j in jacobians], axis=1)
    initial_mean = np.concatenate([j.initial_mean for j in jacobians], axis=1)
    width = len(sizes[0])
    discriminators = []
    for measurement, apply in candidate_measurements(model):
        white = whitening_filter(apply(model.fitted_noise_filter.model))(rows, initial_mean)
        a, b = white[:, :width], white[:, width:]
        evidence = min(_distinct_evidence(a @ sizes[0], b), _distinct_evidence(b @ sizes[1], a))
        discriminators.append(Discriminator(measurement, evidence))
    best = max(discriminators, key=lambda d: d.evidence)
    return best if best.evidence > model.settings.separable_gain_nats else None


def candidate_measurements(
    model: LinearizedModel,
) -> list[tuple[str, Callable[[LinearStateSpace], LinearStateSpace]]]:
    """All measurements that could improve this flight's knowledge, and what each makes of the state-space model."""
    slices = model.nuisance.layout.slices | model.nuisance.slices
    candidates: list[tuple[str, Callable[[LinearStateSpace], LinearStateSpace]]] = []
    for what, names in KNOWLEDGE.items():
        parts = [slices[n] for n in names if n in slices]
        if parts:
            states = np.concatenate([np.arange(s.start, s.stop) for s in parts])
            candidates.append((f"knowing {what}", partial(with_known_states, states=states)))
    by_name: dict[str, list[IntArray]] = {}
    for constraint, rows in zip(model.inputs.problem.constraints, model.index.constraint_rows, strict=True):
        by_name.setdefault(constraint.name, []).append(np.arange(rows.start, rows.stop))
    factor = model.settings.constraint_improvement
    for name, rows_of_uses in by_name.items():
        improved = partial(with_less_noise, rows=np.concatenate(rows_of_uses), factor=factor)
        candidates.append((f"a constraint {name} {factor:.0f} times better", improved))
    return candidates


def with_known_states(model: LinearStateSpace, states: Sequence[int] | IntArray) -> LinearStateSpace:
    """The state-space model with some states known: no initial variance, no process noise.

    Parameters
    ----------
    model : LinearStateSpace
        With n states.
    states : (K,) array or sequence of int
        Indices of the known states.

    Returns
    -------
    LinearStateSpace
    """
    covariance = model.initial_covariance.copy()
    covariance[states], covariance[:, states] = 0.0, 0.0
    q = model.process_noise
    keep = ~(np.isin(q.row, states) | np.isin(q.column, states))
    noise = BlockSparse(q.size, q.row[keep], q.column[keep], q.values[:, keep])
    return replace(model, initial_covariance=covariance, process_noise=noise)


def with_less_noise(model: LinearStateSpace, rows: IntArray, factor: float) -> LinearStateSpace:
    """The state-space model with the noise of some rows divided by a factor.

    Parameters
    ----------
    model : LinearStateSpace
        With R rows.
    rows : (K,) array of int
        Indices of the rows.
    factor : float
        By which their sigma is divided.

    Returns
    -------
    LinearStateSpace
    """
    noise = model.row_noise.copy()
    noise[rows] /= factor**2
    return replace(model, row_noise=noise)


def _distinct_evidence(explained: Array, columns: Array) -> float:
    """Half the sum of squares that no combination of the columns ``(R, k)`` reproduces, nats."""
    coefficients = np.linalg.lstsq(columns, explained, rcond=None)[0]
    return 0.5 * float(np.sum((explained - columns @ coefficients) ** 2))
