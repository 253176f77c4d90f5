"""Colour of the excess variance: its correlation in time, for forces and for moments.

A structure that vibrates and a wake that buffets are neither white nor constant: what a model lacks lasts for longer
than a time bin. The excess variance of each axis of force and moment against the prediction is a first-order
Gauss–Markov process, times its standard deviation, which `variance_components` has estimated as that of white noise and
which may change from interval to interval. Both IMUs measure such a force, so that it is in the rows of the driving IMU
against the prediction and not in those of a checking IMU, whose excess stays white.

The correlation time, and a factor on the white variance, are those of the largest marginal likelihood on a grid
(`diagnosis.excess_memories_s`, `excess_colour_factors`), one pair for the three forces and one for the three moments: a
structure shakes the accelerometers within a time bin, whereas the moment follows the flow over the aftbody and the
oscillation of the vehicle. The choice has a penalty, the logarithm of the number of pairs for each of the two.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from edl_filter.diagnosis.noise.variance_components import ColourPlaces, ExcessVariance, add_variance
from edl_filter.diagnosis.prediction.residuals import RowIndex
from edl_filter.estimation.kalman import WhiteningFilter, log_likelihood, whitening_filter
from edl_filter.estimation.linear_state_space import LinearStateSpace, append_constant_states, with_gauss_markov_states
from edl_filter.estimation.parallel import map_threads
from edl_filter.mission.decision_settings import DecisionSettings
from edl_filter.types import Array, IntArray

#: Axes of force, then of moment, and of each of the two.
_AXES, _AXES_EACH = 6, 3
#: Steps on the grid: of the correlation time, and along the ridge of the likelihood. The data determine the ratio of
#: variance and time best, so that both increase together there.
_STEPS = ((1, 0), (-1, 0), (1, 1), (-1, -1))
#: With a single correlation time.
_STEPS_OF_FACTOR = ((0, 1), (0, -1))


@dataclass(frozen=True)
class ExcessColour:
    """Most likely correlation in time of excess variance.

    Attributes
    ----------
    places : ColourPlaces
        Of the most likely correlation time and factor in the settings, of forces and of moments, also where white
        excess variance is more likely.
    is_correlated : bool
        Whether correlated excess variance is more likely than white.
    """

    places: ColourPlaces
    is_correlated: bool


def colour_excess(
    model: LinearStateSpace, index: RowIndex, excess: ExcessVariance, memory: Array, factor: Array
) -> LinearStateSpace:
    """The state-space model whose excess variance of forces and moments is correlated in time.

    Parameters
    ----------
    model : LinearStateSpace
        At the stated noise.
    index : RowIndex
        Positions of the rows.
    excess : ExcessVariance
        Its size, which may change from interval to interval.
    memory : (2,) array
        Correlation time of forces and of moments, s.
    factor : (2,) array
        By which the excess variance of forces and of moments is multiplied.

    Returns
    -------
    LinearStateSpace
        The processes are its last six states.
    """
    return _coloured(_with_constant_excess(model, index, excess), index, excess, memory, factor)


def _with_constant_excess(model: LinearStateSpace, index: RowIndex, excess: ExcessVariance) -> LinearStateSpace:
    """The model whose last six states are constant: the excess of each axis over its standard deviation."""
    columns = np.zeros((index.count, _AXES))
    for axis in range(_AXES):
        rows = _rows_of_axis(index, axis)
        columns[rows, axis] = np.sqrt(excess.variance[rows])
    return append_constant_states(model, columns, np.ones(_AXES))


def _coloured(
    constant: LinearStateSpace, index: RowIndex, excess: ExcessVariance, memory: Array, factor: Array
) -> LinearStateSpace:
    """`colour_excess` of a model of `_with_constant_excess`, whose design matrix it shares."""
    white = excess.variance.copy()
    for axis in range(_AXES):
        white[_rows_of_axis(index, axis)] = 0.0
    by_axis = (np.repeat(values, _AXES_EACH) for values in (memory, factor))
    coloured = with_gauss_markov_states(constant, index.step_interval, *by_axis)
    return add_variance(coloured, index, replace(excess, variance=white))


def _rows_of_axis(index: RowIndex, axis: int) -> IntArray:
    """Rows of one axis of force or moment against the prediction."""
    rows = index.bin_rows[:, axis]
    return np.asarray(rows[rows >= 0], np.int64)


def filter_at_excess(
    model: LinearStateSpace,
    index: RowIndex,
    excess: ExcessVariance,
    colour: ExcessColour | None,
    settings: DecisionSettings,
) -> WhiteningFilter:
    """The whitening filter with excess variance of a colour.

    Parameters
    ----------
    model, index, excess
        As in `colour_excess`.
    colour : ExcessColour or None
        Of `most_likely_colour`; None for white excess variance.
    settings : DecisionSettings
        Thresholds of the diagnosis.
    """
    if colour is None or not colour.is_correlated:
        return whitening_filter(add_variance(model, index, excess))
    return whitening_filter(colour_excess(model, index, excess, *_values(colour.places, settings)))


def most_likely_colour(
    at_white: float,
    model: LinearStateSpace,
    index: RowIndex,
    excess: ExcessVariance,
    residuals: Array,
    initial_mean: Array,
    settings: DecisionSettings,
    initial: ColourPlaces | None = None,
) -> ExcessColour | None:
    """Most likely correlation of the excess variance in time; None without excess variance.

    Parameters
    ----------
    at_white : float
        Log-likelihood with white excess variance, nats.
    model : LinearStateSpace
        At the stated noise.
    index : RowIndex
        Positions of the rows.
    excess : ExcessVariance
        Its size.
    residuals : (R,) array
        Residuals about the linearisation point.
    initial_mean : (n,) array
        Prior mean of the states at the beginning.
    settings : DecisionSettings
        Thresholds of the diagnosis: the correlation times and factors that are tried (`colour_penalty`).
    initial : ColourPlaces, optional
        Where the search begins: the most likely places of a similar model.
    """
    if excess.is_zero:
        return None
    constant = _with_constant_excess(model, index, excess)  # large: one for all places
    shape = len(settings.excess_memories_s), len(settings.excess_colour_factors)
    steps = _STEPS if shape[0] > 1 else _STEPS_OF_FACTOR

    def evaluate(places: ColourPlaces) -> float:
        coloured = _coloured(constant, index, excess, *_values(places, settings))
        return log_likelihood(coloured, residuals, initial_mean)

    middle = shape[0] // 2, shape[1] // 2
    places = (middle, middle) if initial is None else initial
    likelihoods = {places: evaluate(places)}
    # uphill on the grid, forces and moments in turn, until neither has a more likely place
    fixed, kind = 0, 0
    while fixed < len(places):
        neighbours = [_replaced(places, kind, (places[kind][0] + a, places[kind][1] + b)) for a, b in steps]
        new = [p for p in neighbours if p not in likelihoods and _is_on_grid(p[kind], shape)]
        likelihoods |= zip(new, map_threads(evaluate, new), strict=True)
        best = max((places, *(p for p in neighbours if p in likelihoods)), key=lambda p: likelihoods[p])
        if best == places:
            fixed, kind = fixed + 1, 1 - kind
        else:
            fixed, places = 0, best
    return ExcessColour(places, likelihoods[places] - colour_penalty(settings) > at_white)


def colour_penalty(settings: DecisionSettings) -> float:
    """Cost in evidence of choosing a correlation time and a factor of the excess, of forces and of moments, nats."""
    return 2.0 * float(np.log(len(settings.excess_memories_s) * len(settings.excess_colour_factors)))


def _replaced(places: ColourPlaces, kind: int, place: tuple[int, int]) -> ColourPlaces:
    """Places of which that of forces (0) or of moments (1) is another."""
    return (place, places[1]) if kind == 0 else (places[0], place)


def _is_on_grid(place: tuple[int, int], shape: tuple[int, int]) -> bool:
    return 0 <= place[0] < shape[0] and 0 <= place[1] < shape[1]


def _values(places: ColourPlaces, settings: DecisionSettings) -> tuple[Array, Array]:
    """Correlation times (s) and factors at places, ``(2,)`` each."""
    memory = np.array([settings.excess_memories_s[i] for i, _ in places])
    factor = np.array([settings.excess_colour_factors[j] for _, j in places])
    return memory, factor
