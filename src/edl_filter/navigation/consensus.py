"""Consensus of several readings of one instrument: which of them, or the state, is the outlier.

A gate compares each reading with the state alone. It is wrong in two cases: where the state is uncertain, a reading
that is far off is within the gate and moves the state, after which all good readings are rejected; and where the state
has diverged, all readings are rejected though they agree with each other. The next readings are therefore predicted
together, without an update, with the covariance of all predictions (S). Two hypotheses on the state are compared:

- **S**: the state is as the filter estimates it;
- **S'**: position and velocity are unknown (`FREE_POSITION`, `FREE_VELOCITY`); only the filter's dynamics between the
  readings are believed.

Under S' the largest set of readings that agree is searched: every pair predicts the others, the pair whose predictions
have the greatest truncated likelihood begins the set (consensus of minimal subsets: Fischler & Bolles 1981, Comm. ACM
24, 381; exhaustive, so without random numbers), and readings are removed or added until all members, and none of the
others, agree with the remaining members. Under S the set begins with the readings that are within the gate. A reading
outside of a set costs the gate's quantile (truncated likelihood). Under S the cheaper of both sets counts, and readings
outside of it are outliers if it holds the majority. The state is the outlier if the set of S' holds the majority and
S costs more than S' by more than the gate's quantile, with as many degrees of freedom as there are directions that the
readings determine (generalised likelihood ratio: Willsky & Jones 1976, IEEE Trans. Autom. Control 21, 108). Where the
set is the best one of all pairs, the gate's error probability is shared by them (Bonferroni). Of fifteen readings,
eight may be off by the same error: they agree with each other, but so do the state and the other seven.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations

import numpy as np
from scipy.special import chdtri

from edl_filter.estimation.small_matrices import regression_rows
from edl_filter.navigation.constraints import Constraint
from edl_filter.navigation.estimator import ErrorStateFilter
from edl_filter.navigation.increments import Samples
from edl_filter.types import Array, BoolArray, IntArray

#: Readings that are examined together, and the least number of them.
WINDOW, LEAST_READINGS = 15, 5
#: Sigmas of an unknown position (m) and velocity (m/s), per axis.
FREE_POSITION, FREE_VELOCITY = 1e5, 1e3


@lru_cache
def quantile(probability: float, dof: int) -> float:
    """Quantile of the chi-square distribution with `dof` degrees of freedom."""
    return float(chdtri(dof, 1.0 - probability))


@dataclass(frozen=True)
class JointPrediction:
    """Several readings, predicted together without an update.

    Attributes
    ----------
    residual : (K, m) array
        Measured minus predicted.
    covariance : (K m, K m) array
        S: of the residuals, prediction and noise together.
    noise : (K m, K m) array
        Of the readings alone.
    sensitivity : (K m, 6) array
        Of the predictions to position (m) and velocity (m/s) at the beginning.
    """

    residual: Array
    covariance: Array
    noise: Array
    sensitivity: Array

    @property
    def free_covariance(self) -> Array:
        """S': covariance of the residuals where position and velocity are unknown, ``(K m, K m)``."""
        scaled = self.sensitivity * np.repeat([FREE_POSITION, FREE_VELOCITY], 3)
        return self.covariance + scaled @ scaled.T


@dataclass(frozen=True)
class Consensus:
    """Which of several readings, or the state, is the outlier.

    Attributes
    ----------
    agree : (K,) boolean array
        The readings that agree with each other, and with the state unless it is the outlier.
    nis, free_nis : float
        Normalised squares of this set's residuals under S and S'.
    directions : int
        Directions of the state that the set determines.
    state_outlier : bool
        Whether the set contradicts the state.
    """

    agree: BoolArray
    nis: float
    free_nis: float
    directions: int
    state_outlier: bool

    @property
    def majority(self) -> bool:
        """Whether more than half of the readings agree."""
        return bool(2 * np.sum(self.agree) > len(self.agree))


def predict_jointly(estimator: ErrorStateFilter, samples: Samples, readings: Sequence[Constraint]) -> JointPrediction:
    """Predict several readings of one instrument without an update between them.

    Parameters
    ----------
    estimator : ErrorStateFilter
        At the beginning; it is propagated by this function.
    samples : Samples
        From the beginning on, with edges at the readings' times.
    readings : sequence of Constraint
        K readings of m components each, in the order of time.

    Returns
    -------
    JointPrediction
    """
    size, done, row = estimator.layout.size, 0, 0
    ends = np.cumsum([len(reading.measured) for reading in readings])
    residuals, sensitivities = [], []
    covariance, crossed = np.zeros((ends[-1], ends[-1])), np.zeros((ends[-1], size))
    change = np.eye(size)[:, :6]  # of the error with respect to position and velocity at the beginning
    for reading, end in zip(readings, ends.tolist(), strict=True):
        stop = samples.index(reading.time)
        if stop > done:
            before = estimator.covariance.copy()
            transition = estimator.predict(samples.part(done, stop))
            transition_rows, moving = _transition_rows(before, transition.cross_covariance)
            crossed[:row, moving], change[moving] = crossed[:row] @ transition_rows.T, transition_rows @ change
            done = stop
        innovation = estimator.innovation(reading)
        jacobian = estimator.jacobian(innovation)
        np.matmul(jacobian, estimator.covariance, out=crossed[row:end])
        covariance[:end, row:end] = crossed[:end] @ jacobian.T
        covariance[row:end, :row] = covariance[:row, row:end].T
        residuals.append(innovation.residual)
        sensitivities.append(jacobian @ change)
        row = end
    noise = np.zeros_like(covariance)
    for reading, end in zip(readings, ends.tolist(), strict=True):
        rows = slice(end - len(reading.measured), end)
        noise[rows, rows] = reading.noise
    return JointPrediction(np.array(residuals), covariance + noise, noise, np.concatenate(sensitivities))


def _transition_rows(covariance: Array, cross_covariance: Array) -> tuple[Array, IntArray]:
    """Transition matrix of a step, without the states that it leaves as they are: its rows (k, n) and their indices.

    The regression of the error after the step on the error before it, from their covariances ``(n, n)``.
    """
    cross = np.ascontiguousarray(cross_covariance.T)
    rows, index, valid = regression_rows(cross, covariance)
    if not valid:
        rows = np.linalg.solve(covariance, cross[index].T).T
    return rows, index


def find_consensus(prediction: JointPrediction, gate: float) -> Consensus:
    """Find the largest set of readings that agree, and compare it with the state.

    Parameters
    ----------
    prediction : JointPrediction
        Of K readings.
    gate : float
        Probability with which a good reading is within its gate.

    Returns
    -------
    Consensus
    """
    count, components = prediction.residual.shape
    free = prediction.free_covariance
    limit = quantile(gate, components)
    members = list(range(count))
    if np.max(_left_out(prediction.residual, free, members)) > limit:  # not all of them agree
        members = _refine(prediction.residual, free, _first_pair(prediction.residual, free, limit), limit)
    state = prediction.covariance
    single = np.einsum("km,kmn,kn->k", prediction.residual, np.linalg.inv(_blocks(state, count)), prediction.residual)
    within = _refine(prediction.residual, state, np.flatnonzero(single <= limit).tolist(), limit)

    def squares(selected: Sequence[int], covariance: Array) -> float:
        rows = _rows(selected, components)
        residual = prediction.residual.ravel()[rows]
        return float(residual @ np.linalg.solve(covariance[np.ix_(rows, rows)], residual))

    def cost(selected: Sequence[int], nis: float) -> float:
        return nis + limit * (count - len(selected))

    candidates = (members,) if within == members else (members, within)
    best, best_nis = min(((c, squares(c, state)) for c in candidates), key=lambda candidate: cost(*candidate))
    members_nis = squares(members, free)
    scaled = prediction.sensitivity[_rows(members, components)] * np.repeat([FREE_POSITION, FREE_VELOCITY], 3)
    scaled /= np.sqrt(np.diag(prediction.noise)[_rows(members, components)])[:, None]
    directions = int(np.sum(np.linalg.svd(scaled, compute_uv=False) > 1.0))
    ratio = cost(best, best_nis) - cost(members, members_nis)
    searched = 1 if len(members) == count else count * (count - 1) // 2
    threshold = quantile(1.0 - (1.0 - gate) / searched, directions) if directions else np.inf
    outlier = bool(2 * len(members) > count and ratio > threshold)
    agreeing = members if outlier else best
    agree = np.zeros(count, bool)
    agree[agreeing] = True
    nis = best_nis if agreeing == best else squares(agreeing, state)
    free_nis = members_nis if agreeing == members else squares(agreeing, free)
    return Consensus(agree, nis, free_nis, directions, outlier)


def _rows(members: Sequence[int], components: int) -> list[int]:
    """Rows of the components of some readings."""
    return [components * k + c for k in members for c in range(components)]


def _blocks(matrix: Array, count: int) -> Array:
    """Diagonal blocks ``(count, m, m)`` of a matrix ``(count m, count m)``."""
    components = len(matrix) // count
    blocks = matrix.reshape(count, components, count, components)
    return np.ascontiguousarray(blocks[np.arange(count), :, np.arange(count)])


def _predicted(residual: Array, covariance: Array, members: Sequence[int]) -> tuple[Array, Array]:
    """NIS of all readings given the `members`, and log determinant of their covariances; meaningless for members.

    Parameters
    ----------
    residual : (K, m) array
        Of all readings.
    covariance : (K m, K m) array
        Of all residuals.
    members : sequence of int
        Readings that are given.

    Returns
    -------
    nis, log_spread : (K,) arrays
    """
    count, components = residual.shape
    given = _rows(members, components)
    gain = np.linalg.solve(covariance[np.ix_(given, given)], covariance[given]).T
    remaining = residual - (gain @ residual.ravel()[given]).reshape(count, components)
    spread = _blocks(covariance - gain @ covariance[given], count)
    spread[list(members)] = np.eye(components)
    nis = np.einsum("km,km->k", remaining, np.linalg.solve(spread, remaining[..., None])[..., 0])
    return nis, np.linalg.slogdet(spread)[1]


def _left_out(residual: Array, covariance: Array, members: Sequence[int]) -> Array:
    """NIS of each of the `members` given the other members, ``(len(members),)``; arguments as of `_predicted`."""
    rows = _rows(members, residual.shape[1])
    precision = np.asarray(np.linalg.inv(covariance[np.ix_(rows, rows)]), np.float64)
    weighted = (precision @ residual.ravel()[rows]).reshape(len(members), residual.shape[1])
    blocks = _blocks(precision, len(members))
    return np.einsum("km,km->k", weighted, np.linalg.solve(blocks, weighted[..., None])[..., 0])


def _first_pair(residual: Array, covariance: Array, limit: float) -> list[int]:
    """The pair of readings from which the others follow with the greatest likelihood, each truncated at the gate."""
    pairs = [list(pair) for pair in combinations(range(len(residual)), 2)]
    costs = []
    for pair in pairs:
        nis, log_spread = _predicted(residual, covariance, pair)
        costs.append(np.sum(np.delete(np.minimum(nis, limit) + log_spread, pair)))
    return pairs[int(np.argmin(costs))]


def _refine(residual: Array, covariance: Array, members: list[int], limit: float) -> list[int]:
    """Add readings that agree with the members and remove members that do not, one at a time, until none is left."""
    for _ in range(4 * len(residual)):
        # of two readings, neither is the outlier
        inside = _left_out(residual, covariance, members) if len(members) > 2 else np.zeros(0)
        outside = np.full(len(residual), np.inf)
        if len(members) < len(residual):
            outside, _ = _predicted(residual, covariance, members)
            outside[members] = np.inf
        if np.max(inside, initial=0.0) > limit:
            members = [k for k in members if k != members[int(np.argmax(inside))]]
        elif np.min(outside) <= limit:
            members = sorted([*members, int(np.argmin(outside))])
        else:
            break
    return members
