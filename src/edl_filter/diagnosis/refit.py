"""Refit: an effect's parameters by Gauss–Newton through the whole chain, places and times included.

Each step runs the chain with the effect at its values, takes the signatures there, whitens both, and solves with the
prior. Steps that make things worse are shortened. The ground (allowed errors, path start) is that of the model without
the effect: what an effect changes there is of second order, and the next run takes it up.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from edl_filter.diagnosis.case import Case, Linear
from edl_filter.diagnosis.chain import compared
from edl_filter.diagnosis.comparison import Differences, Setup
from edl_filter.diagnosis.path import PER_BIN
from edl_filter.diagnosis.signatures import Signature, ordered, scale_of, signature
from edl_filter.diagnosis.timeline import stated_start
from edl_filter.diagnosis.whitening import Whitener
from edl_filter.effects.effect import Active, Parameter

Array = NDArray[np.float64]

_STEPS = 12
#: A step that gains less than this (nats) is the last.
_ENOUGH = 0.05


@dataclass(frozen=True)
class Refit:
    """Effects at their most probable values.

    Attributes
    ----------
    effects : tuple of Active
    names : tuple of (str, str)
        Effect and parameter of each column.
    covariance : (k, k) array
        Of the parameters; times with the grain of the nodes at which the model is asked.
    evidence : float
        Log-likelihood at the values, with prior and Laplace's volume, nats.
    column, start : (R,), (n,) arrays
        Differences at the values, and what is stated of the unknowns at the beginning.
    white : (R,) array
        The same, white.
    signature : (R, k) array
        White signatures there.
    sigma : (k,) array
        Prior one sigma.
    """

    effects: tuple[Active, ...]
    names: tuple[tuple[str, str], ...]
    covariance: Array
    evidence: float
    column: Array
    start: Array
    white: Array
    signature: Array
    sigma: Array

    def parameters(self, effect: str) -> dict[str, tuple[float, float]]:
        """Value and one sigma of every parameter of an effect; zero sigma where it was not fitted."""
        active = next(a for a in self.effects if a.name == effect)
        spread = dict(zip(self.names, np.sqrt(np.diag(self.covariance)), strict=True))
        return {q: (v, float(spread.get((effect, q), 0.0))) for q, v in active.values.items()}


def refit(case: Case, linear: Linear, effects: Sequence[Active], whiten: Whitener, steps: int = _STEPS) -> Refit:
    """Fit all parameters of `effects` that are not fixed, beginning at their values.

    Parameters
    ----------
    case, linear : Case, Linear
        The ground.
    effects : sequence of Active
        The whole model.
    whiten : Whitener
        Of the ground, with a missing force and moment or without.
    """
    at = tuple(effects)
    free = [(a.name, q) for a in at if not a.fixed for q in a.effect.parameters if _fitted(a, q)]
    names = tuple((e, q.name) for e, q in free)
    sigma = np.array([scale_of(q) for _, q in free])
    centre = np.array([0.0 if q.kind == "size" else _parameter(at, e, q.name) for e, q in free])
    here = _at(case, linear, (linear.ground.setup, linear.ground.found), at)
    value, white = _value(here, whiten, centre, sigma, names)
    columns = np.zeros((len(white), 0))
    covariance = np.diag(sigma**2)
    for _ in range(steps if free else 0):
        columns = _columns(linear, here, whiten, free)
        prior = np.diag(1.0 / sigma**2)
        theta = np.array([_parameter(at, e, q.name) for e, q in free])
        information = columns.T @ columns + prior
        covariance = np.linalg.inv(information)
        move = covariance @ (columns.T @ white - prior @ (theta - centre))
        gained, part = -np.inf, 1.0
        while part > 1e-3:
            trial = _moved(at, free, theta + part * move)
            if not all(ordered(a) for a in trial):
                part *= 0.3
                continue
            there = _at(case, linear, here.known, trial)
            new, new_white = _value(there, whiten, centre, sigma, names)
            gained = new - value
            if gained > 0.0:
                break
            part *= 0.3
        if gained <= 0.0:
            break
        at, here, value, white = trial, there, new, new_white
        if gained < _ENOUGH:
            break
    volume = 0.5 * np.linalg.slogdet(covariance)[1] - float(np.sum(np.log(sigma))) if free else 0.0
    between = float(np.median(linear.bins.interval)) / PER_BIN
    grain = np.array([between**2 / 12.0 if q.kind == "time" else 0.0 for _, q in free])
    return Refit(
        effects=at,
        names=names,
        covariance=covariance + np.diag(grain),
        evidence=value + volume,
        column=here.column,
        start=here.start,
        white=white,
        signature=columns,
        sigma=sigma,
    )


def _fitted(active: Active, parameter: Parameter) -> bool:
    """Whether a parameter is to be found: sizes always, places where they are finite."""
    return parameter.kind == "size" or bool(np.isfinite(active.values[parameter.name]))


def _parameter(effects: Sequence[Active], effect: str, parameter: str) -> float:
    return next(a.values[parameter] for a in effects if a.name == effect)


def _moved(effects: Sequence[Active], free: Sequence[tuple[str, Parameter]], theta: Array) -> tuple[Active, ...]:
    new: dict[str, dict[str, float]] = {}
    for (effect, q), v in zip(free, theta, strict=True):
        new.setdefault(effect, {})[q.name] = float(np.clip(v, q.low, q.high)) if q.kind != "phase" else float(v)
    return tuple(replace(a, values=a.values | new.get(a.name, {})) for a in effects)


@dataclass(frozen=True)
class _Here:
    """The chain with effects at their values.

    Attributes
    ----------
    effects : tuple of Active
    known : (Setup, Differences)
    column, start : (R,), (n,) arrays
        The differences, and what is stated of the unknowns at the beginning.
    """

    effects: tuple[Active, ...]
    known: tuple[Setup, Differences]
    column: Array
    start: Array


def _at(case: Case, linear: Linear, known: tuple[Setup, Differences], effects: tuple[Active, ...]) -> _Here:
    ground = linear.ground
    setup, found = compared(ground.frame, case.arrange, known, effects)
    start = linear.start.copy()
    start[: setup.problem.layout.size] = stated_start(setup, ground.start)
    return _Here(effects, (setup, found), ground.order.stack(found), start)


def _value(
    here: _Here, whiten: Whitener, centre: Array, sigma: Array, names: Sequence[tuple[str, str]]
) -> tuple[float, Array]:
    """Log posterior up to a constant, and the white differences."""
    white = whiten(here.column[:, None], here.start[:, None])[:, 0]
    theta = np.array([_parameter(here.effects, e, n) for e, n in names])
    return whiten.log_likelihood(white) - 0.5 * float(np.sum(((theta - centre) / sigma) ** 2)), white


def _columns(linear: Linear, here: _Here, whiten: Whitener, free: Sequence[tuple[str, Parameter]]) -> Array:
    """White signatures of all free parameters, with the effects at their values."""
    setup, found = here.known
    ground = replace(linear.ground, effects=here.effects, setup=setup, found=found)
    by_effect: dict[str, list[str]] = {}
    for effect, q in free:
        by_effect.setdefault(effect, []).append(q.name)
    parts: list[Signature] = [
        signature(ground, next(a for a in here.effects if a.name == e), names) for e, names in by_effect.items()
    ]
    rows = np.concatenate([s.rows for s in parts], axis=1)
    return whiten(rows, np.concatenate([s.start for s in parts], axis=1))
