"""Disambiguation: the measurement that would distinguish two names, or a name from none, which this flight does not.

Each candidate is evaluated on the linear model of the flight: a nuisance parameter is taken as known, or a constraint
as ten times more accurate. The part of one effect's columns that no size of the other reproduces is then counted in
nats: the evidence by which the two would be distinguished. For one effect alone it is the evidence that its estimate
would have over the model without it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from edl_filter.aero.discrepancy import ASYMMETRIES
from edl_filter.diagnosis.jacobians.nuisance import CHECKING, FIELD_STATES
from edl_filter.diagnosis.linear_model.effect_jacobian import effect_jacobian, stacked
from edl_filter.diagnosis.linear_model.linear_model import LinearizedModel, rows_by_constraint
from edl_filter.effects.base import EffectInstance
from edl_filter.estimation.kalman import Whitening, whitening_filter
from edl_filter.estimation.linear_state_space import LinearStateSpace, with_known_states, with_less_noise
from edl_filter.types import Array, IntArray

#: What could be known, and the states that would then have no error: nuisance parameters by name. For a coefficient
#: these are its numerical errors; the amplitudes of its discrepancy belong to it.
KNOWLEDGE = {
    "the air's density": ("density",),
    "the winds": ("wind_east", "wind_north"),
    "the mass": ("mass",),
    "the inertia": ("inertia",),
    "the coefficients, by a database without error": ("ca", "cn", "cm", *ASYMMETRIES),
    "the attitude at entry": ("attitude", "entry_frame", "onboard_attitude", "onboard_mounting"),
    "the entry state's position and velocity": ("position", "velocity", "entry_epoch"),
    "the accelerometers' errors": ("accelerometer_bias", "accelerometer_scale", "accelerometer_misalignment"),
    "the gyros' errors": ("gyro_bias", "gyro_scale", "onboard_rate"),
}
#: The same for constant nuisance parameters: effects that a mission states with a sigma.
CONSTANT_KNOWLEDGE = {
    "the coefficients, by a database without error": (
        "rolling_moment",
        "pitch_damping",
        "database_increments",
    ),
    "the centre of mass": ("com_offset",),
    "the products of inertia": ("products_of_inertia",),
    "the places of the IMUs": ("imu_lever_arm",),
    "the alignment of the IMUs": ("imu_alignment",),
    "the clocks of the IMUs": ("imu_clock",),
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


def best_discriminator(
    model: LinearizedModel, first: EffectInstance, second: EffectInstance | None = None
) -> Discriminator | None:
    """The measurement that distinguishes two effects best, about their values; None where none adds enough evidence.

    Parameters
    ----------
    model : LinearizedModel
        The flight.
    first, second : EffectInstance
        At their estimates; without the second, the first is distinguished from no effect.
    """
    pair = (first,) if second is None else (first, second)
    jacobians = [effect_jacobian(model, a.at_zero()) for a in pair]
    sizes = [np.array([a.values[n] for n in j.names]) for a, j in zip(pair, jacobians, strict=True)]
    columns = stacked(jacobians)
    width = len(sizes[0])

    def evidence(whiten: Whitening) -> float:
        white = whiten(*columns)
        a, b = white[:, :width], white[:, width:]
        of_first = _distinct_evidence(a @ sizes[0], b)
        return of_first if second is None else min(of_first, _distinct_evidence(b @ sizes[1], a))

    present = model.fitted_noise_filter
    discriminators = [
        Discriminator(measurement, evidence(whitening_filter(apply(present.model))))
        for measurement, apply in candidate_measurements(model)
    ]
    best = max(discriminators, key=lambda d: d.evidence)
    return best if best.evidence - evidence(present) > model.settings.separable_gain_nats else None


def candidate_measurements(
    model: LinearizedModel,
) -> list[tuple[str, Callable[[LinearStateSpace], LinearStateSpace]]]:
    """All measurements that could improve this flight's knowledge, and what each makes of the state-space model."""
    known = _states_by_knowledge(model)
    candidates: list[tuple[str, Callable[[LinearStateSpace], LinearStateSpace]]] = [
        (f"knowing {what}", partial(with_known_states, states=states)) for what, states in known.items()
    ]
    factor = model.settings.constraint_improvement
    for name, rows in rows_by_constraint(model).items():
        improved = partial(with_less_noise, rows=rows, factor=factor)
        candidates.append((f"a constraint {name} {factor:.0f} times better", improved))
    return candidates


def _states_by_knowledge(model: LinearizedModel) -> dict[str, IntArray]:
    """What could be known → the states of the model that would then have no error; only what the model contains."""
    nuisance = model.nuisance
    parts: dict[str, list[range]] = {}
    slices = nuisance.layout.slices | nuisance.slices
    for what, names in KNOWLEDGE.items():
        parts[what] = [range(slices[n].start, slices[n].stop) for n in names if n in slices]
        for field in (nuisance.fields[n] for n in names if n in nuisance.fields):
            width = FIELD_STATES * (field.stop - field.start)  # all values, then all derivatives
            parts[what].append(range(field.start, field.start + width))
    checking = [s for name, s in slices.items() if name.startswith(CHECKING)]
    parts["the errors of the checking IMUs"] = [range(s.start, s.stop) for s in checking]
    first = nuisance.size
    for stated in model.case.constants:
        states = range(first, first + len(stated.sigma))
        first = states.stop
        for what, names in CONSTANT_KNOWLEDGE.items():
            if stated.instance.name in names:
                parts.setdefault(what, []).append(states)
    return {what: np.concatenate([np.array(r, int) for r in ranges]) for what, ranges in parts.items() if ranges}


def _distinct_evidence(explained: Array, columns: Array) -> float:
    """Half the sum of squares that no combination of the columns ``(R, k)`` reproduces, nats."""
    if not columns.shape[1]:
        return 0.5 * float(explained @ explained)
    coefficients = np.linalg.lstsq(columns, explained, rcond=None)[0]
    return 0.5 * float(np.sum((explained - columns @ coefficients) ** 2))
