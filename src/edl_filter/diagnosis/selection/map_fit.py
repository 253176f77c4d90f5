"""Refit: an effect's parameters by Gauss–Newton through the whole chain, places and times included.

Each step runs the chain with the effect at its values, takes the signatures there, whitens both, and solves with the
prior. Steps that make things worse are shortened. While effects are only compared, path and air stay where they are in
the model without the effect. A refit that is to stand (`moving`) takes both along to where they most probably are with
the effect at its new values: a gyro's bias and the roll at the start, say, make up for each other over many sigmas, and
along a bent valley one that moves alone comes to rest far from the bottom.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from edl_filter.diagnosis.chain import compared
from edl_filter.diagnosis.linear import Linear
from edl_filter.diagnosis.path import PER_BIN
from edl_filter.diagnosis.point import Point, told
from edl_filter.diagnosis.signatures import Ground, Signature, ordered, scale_of, signature
from edl_filter.diagnosis.whitening import Whitener
from edl_filter.effects.effect import Active, Parameter

Array = NDArray[np.float64]

_STEPS = 12
#: Part of a step below which none is tried.
_SHORTEST = 1e-3
#: Moves of everything else at most, at one step of the effects.
_MOVES = 4
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
    point : Point
        About which the differences are.
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
    point: Point

    def parameters(self, effect: str) -> dict[str, tuple[float, float]]:
        """Value and one sigma of every parameter of an effect; zero sigma where it was not fitted."""
        active = next(a for a in self.effects if a.name == effect)
        spread = dict(zip(self.names, np.sqrt(np.diag(self.covariance)), strict=True))
        return {q: (v, float(spread.get((effect, q), 0.0))) for q, v in active.values.items()}


def refit(
    linear: Linear, effects: Sequence[Active], whiten: Whitener, steps: int = _STEPS, moving: bool = False
) -> Refit:
    """Fit all parameters of `effects` that are not fixed, beginning at their values.

    Parameters
    ----------
    linear : Linear
        The ground.
    effects : sequence of Active
        The whole model.
    whiten : Whitener
        Of the ground, with a missing force and moment or without.
    steps : int
        At most.
    moving : bool
        Whether path, air, tables and vehicle move with the effects.
    """
    here = _at(linear.ground, tuple(effects))
    free = [(a.name, q) for a in here.effects for q in a.fitted]
    names = tuple((e, q.name) for e, q in free)
    sigma = np.array([scale_of(q) for _, q in free])
    centre = np.array([0.0 if q.kind == "size" else _parameter(here.effects, e, q.name) for e, q in free])
    if moving:
        here = _settled(linear, here, whiten, _white(here, whiten), here.effects) or here
    value, white = _value(here, whiten, centre, sigma, names)
    columns = np.zeros((len(white), 0))
    covariance = np.diag(sigma**2)
    for _ in range(steps if free else 0):
        columns = _columns(here, whiten, free)
        prior = np.diag(1.0 / sigma**2)
        theta = np.array([_parameter(here.effects, e, q.name) for e, q in free])
        information = columns.T @ columns + prior
        covariance = np.linalg.inv(information)
        move = covariance @ (columns.T @ white - prior @ (theta - centre))
        better: tuple[_Here, float, Array] | None = None
        for part, trial in _trials(here.effects, free, theta, move):
            left = white - part * (columns @ move)
            there = _settled(linear, here, whiten, left, trial) if moving else _at(here.ground, trial)
            if there is None:
                continue
            new, new_white = _value(there, whiten, centre, sigma, names)
            if new > value:
                better = there, new, new_white
            if new > value or (part == 1.0 and new > value - _ENOUGH):
                break
        if better is None:
            break
        gained = better[1] - value
        here, value, white = better
        if gained < _ENOUGH:
            break
    volume = 0.5 * np.linalg.slogdet(covariance)[1] - float(np.sum(np.log(sigma))) if free else 0.0
    between = float(np.median(linear.bins.interval)) / PER_BIN
    grain = np.array([between**2 / 12.0 if q.kind == "time" else 0.0 for _, q in free])
    told = tuple(a.in_one_turn() for a in here.effects)
    sign = np.array([_swapped(told, here.effects, e, q) for e, q in free])
    return Refit(
        effects=told,
        names=names,
        covariance=sign[:, None] * covariance * sign + np.diag(grain),
        evidence=value + volume,
        column=here.column,
        start=here.start,
        white=white,
        signature=columns * sign if columns.shape[1] else columns,
        sigma=sigma,
        point=here.ground.point,
    )


def _parameter(effects: Sequence[Active], effect: str, parameter: str) -> float:
    return next(a.values[parameter] for a in effects if a.name == effect)


def _swapped(told: Sequence[Active], found: Sequence[Active], effect: str, parameter: Parameter) -> float:
    """-1 for a size that is told with the other sign than it was found with, a phase half a turn on; else 1."""
    if parameter.kind != "size":
        return 1.0
    return -1.0 if _parameter(told, effect, parameter.name) * _parameter(found, effect, parameter.name) < 0.0 else 1.0


def _trials(
    effects: Sequence[Active], free: Sequence[tuple[str, Parameter]], theta: Array, move: Array
) -> Iterator[tuple[float, tuple[Active, ...]]]:
    """The whole step, then ever shorter parts of it; not those that put an upper edge below a lower one."""
    part = 1.0
    while part > _SHORTEST:
        trial = _moved(effects, free, theta + part * move)
        if all(ordered(a) for a in trial):
            yield part, trial
        part *= 0.3


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
    ground : Ground
    column, start : (R,), (n,) arrays
        The differences, and what is stated of the unknowns at the beginning.
    """

    ground: Ground
    column: Array
    start: Array

    @property
    def effects(self) -> tuple[Active, ...]:
        """With their values."""
        return self.ground.effects


def _at(ground: Ground, effects: tuple[Active, ...]) -> _Here:
    """About the same point."""
    setup, found = compared(ground.frame, ground.arrange, (ground.setup, ground.found), effects)
    return _there(replace(ground, effects=effects, setup=setup, found=found))


def _there(ground: Ground) -> _Here:
    return _Here(ground, ground.column(ground.found), ground.stated(ground.setup))


def _settled(linear: Linear, here: _Here, whiten: Whitener, white: Array, effects: tuple[Active, ...]) -> _Here | None:
    """Where everything else goes with effects at new values, beginning with the differences that are expected there.

    None where that is beyond belief.
    """
    last = np.inf
    for _ in range(_MOVES):
        point = told(linear, here.ground.point, here.start, whiten, white, onboard=False)
        if point is None:
            return None
        here = _there(here.ground.moved(point, effects))
        white = _white(here, whiten)
        size = 0.5 * float(white @ white)
        if abs(last - size) < _ENOUGH:
            break
        last = size
    return here


def _white(here: _Here, whiten: Whitener) -> Array:
    return whiten(here.column[:, None], here.start[:, None])[:, 0]


def _value(
    here: _Here, whiten: Whitener, centre: Array, sigma: Array, names: Sequence[tuple[str, str]]
) -> tuple[float, Array]:
    """Log posterior up to a constant, and the white differences."""
    white = _white(here, whiten)
    theta = np.array([_parameter(here.effects, e, n) for e, n in names])
    likely = whiten.log_likelihood(white) + here.ground.volume(here.effects)
    return likely - 0.5 * float(np.sum(((theta - centre) / sigma) ** 2)), white


def _columns(here: _Here, whiten: Whitener, free: Sequence[tuple[str, Parameter]]) -> Array:
    """White signatures of all free parameters, with the effects at their values."""
    by_effect: dict[str, list[str]] = {}
    for effect, q in free:
        by_effect.setdefault(effect, []).append(q.name)
    parts: list[Signature] = [
        signature(here.ground, next(a for a in here.effects if a.name == e), names) for e, names in by_effect.items()
    ]
    rows = np.concatenate([s.rows for s in parts], axis=1)
    return whiten(rows, np.concatenate([s.start for s in parts], axis=1))
