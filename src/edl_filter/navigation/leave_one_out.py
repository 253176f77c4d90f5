"""What all other knowledge says of one constraint: the only agreement that proves anything.

Every constraint is left out once: the filter goes on without it from the epoch before its first use, the smoother
comes back to that epoch, and what it predicts there is set beside what was measured. The entry state is a
constraint too, with its prior covariance; it is taken out of the smoothed estimate in closed form, since no filter
can start without one.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky, solve_triangular

from edl_filter.navigation.constraints import Constraint
from edl_filter.navigation.filter import Forward, Fused, Problem, forward_without, quantile
from edl_filter.navigation.layout import State, sigma_states
from edl_filter.navigation.smoother import Smoothed, smooth
from edl_filter.navigation.ukf import MerwePoints

Array = NDArray[np.float64]
#: Least part of a direction's variance that the others must explain for the direction to count.
LEAST_KNOWN = 0.01


@dataclass(frozen=True)
class Statement:
    """One constraint, as innovation on the way forwards and against all others.

    Attributes
    ----------
    name, source : str
    components : tuple of str
    time : (K,) array
        Epochs at which it was used, s.
    innovation, innovation_sigma : (K, m) arrays
        Measured minus predicted on the way forwards, and one sigma of that.
    nis : (K,) array
        Normalised innovation squared, m degrees of freedom each.
    dof : int
        Of all epochs together.
    accepted : (K,) boolean array
    left_out : (m,) array
        Measured minus predicted from all other knowledge; over many epochs the mean, whose prediction error is
        taken as fully correlated.
    left_out_covariance : (m, m) array
        Of `left_out`: prediction and measurement together.
    left_out_nis : float
    left_out_dof : int
    """

    name: str
    source: str
    components: tuple[str, ...]
    time: Array
    innovation: Array
    innovation_sigma: Array
    nis: Array
    dof: int
    accepted: NDArray[np.bool_]
    left_out: Array
    left_out_covariance: Array
    left_out_nis: float
    left_out_dof: int

    def nis_interval(self, probability: float = 0.999) -> tuple[float, float]:
        """Interval that holds the sum of `nis` with `probability`."""
        tail = 0.5 * (1.0 - probability)
        return quantile(tail, self.dof), quantile(1.0 - tail, self.dof)

    @property
    def left_out_sigma(self) -> Array:
        """One sigma of `left_out`, ``(m,)``; infinite where the others say nothing."""
        return np.sqrt(np.diag(self.left_out_covariance))

    @property
    def consistent(self) -> bool:
        """Whether the sum of `nis` lies in its 99.9 % interval."""
        low, high = self.nis_interval()
        return low <= float(np.sum(self.nis)) <= high

    @property
    def left_out_sigmas(self) -> float:
        """Largest component of the left-out residual in sigmas."""
        if not np.all(self.left_out_sigma > 0.0):
            return float("nan")
        return float(np.max(np.abs(self.left_out / self.left_out_sigma)))


def statements(problem: Problem, way: Forward) -> list[Statement]:
    """All constraints of a reconstruction, by name, in the order of their first use."""
    uses: dict[str, list[Fused]] = defaultdict(list)
    for fused in way.fused:
        uses[fused.constraint.name].append(fused)
    return [_statement(problem, way, group) for group in uses.values()]


def _statement(problem: Problem, way: Forward, group: list[Fused]) -> Statement:
    first = group[0].constraint
    innovations = [f.innovation for f in group]
    sigma = [np.sqrt(np.diag(i.predicted_covariance + i.noise_covariance)) for i in innovations]
    left, left_covariance = _from_others(problem, way, group)
    return Statement(
        name=first.name,
        source=first.source,
        components=first.components,
        time=np.array([f.constraint.time for f in group]),
        innovation=np.array([i.residual for i in innovations]),
        innovation_sigma=np.array(sigma),
        nis=np.array([i.nis for i in innovations]),
        dof=sum(len(i.residual) for i in innovations),
        accepted=np.array([f.accepted for f in group]),
        left_out=left,
        left_out_covariance=left_covariance,
        left_out_nis=float(left @ np.linalg.solve(left_covariance, left)),
        left_out_dof=len(left),
    )


def _from_others(problem: Problem, way: Forward, group: list[Fused]) -> tuple[Array, Array]:
    """Residual against the estimate from everything else, and its covariance."""
    without = forward_without(problem, way, group[0].constraint.name)
    first = group[0].node
    smoothed = smooth(without, first)
    residuals, predictions, noises = [], [], []
    for fused in group:
        k = fused.node - first
        mean, covariance = _predicted(problem, fused.constraint, smoothed.states[k], smoothed.covariance[k])
        residuals.append(fused.constraint.measured - mean)
        predictions.append(covariance)
        noises.append(fused.constraint.noise)
    residual = np.mean(residuals, axis=0)
    if len(group) == 1:
        total = predictions[0] + noises[0]
    else:  # correlation in time and between components unknown: all of it, and none
        spread = np.mean([np.sqrt(np.diag(p)) for p in predictions], axis=0)
        total = np.diag(spread**2 + np.mean([np.diag(n) for n in noises], axis=0) / len(group))
    return residual, total


def _predicted(problem: Problem, constraint: Constraint, state: State, covariance: Array) -> tuple[Array, Array]:
    """What an estimate predicts for a constraint, and the covariance of that."""
    s, n = problem.settings, len(covariance)
    points = MerwePoints(n, s.alpha, s.beta, s.kappa)
    sigmas = points.sigma_points(np.zeros(n), covariance)
    nav, errors = sigma_states(state, sigmas, len(sigmas))
    values = constraint.predict(nav, errors, problem.layout)
    mean = points.Wm @ values
    spread = values - mean
    return mean, (spread * points.Wc[:, None]).T @ spread


def take_out(residual: Array, covariance: Array, noise: Array) -> tuple[Array, Array, float, int]:
    """Residual of a measurement against the prediction from everything else, from an estimate that used it.

    With r = measured - estimated, S the estimate's covariance and R the measurement's, everything else alone
    leaves the residual ``R (R - S)⁻¹ r`` with the innovation's covariance ``R (R - S)⁻¹ R``. Where the others say
    nothing, R - S vanishes; such directions are left out.

    Parameters
    ----------
    residual : (m,) array
        Measured minus estimated.
    covariance, noise : (m, m) arrays
        S and R.

    Returns
    -------
    left_out : (m,) array
        Residual against everything else, in the directions of which it knows anything.
    sigma : (m,) array
        One sigma of it; infinite for a component mostly in other directions.
    nis : float
    dof : int
        Number of directions that count.
    """
    root = cholesky(noise, lower=True)
    whitened = solve_triangular(root, solve_triangular(root, covariance, lower=True).T, lower=True)
    known, directions = np.linalg.eigh(np.eye(len(residual)) - 0.5 * (whitened + whitened.T))
    keep = known > LEAST_KNOWN
    inverse = np.where(keep, 1.0 / np.where(keep, known, 1.0), 0.0)
    along = directions.T @ solve_triangular(root, residual, lower=True)
    spread = root @ directions
    blind = (spread[:, ~keep] ** 2).sum(axis=1) > 0.5 * np.diag(noise)
    sigma = np.where(blind, np.inf, np.sqrt((spread**2) @ inverse))
    return spread @ (inverse * along), sigma, float(np.sum(inverse * along**2)), int(keep.sum())


def entry_statement(smoothed: Smoothed, prior: Array, start: Array) -> Statement:
    """The entry state as a constraint: what all other knowledge says of it.

    Parameters
    ----------
    smoothed : Smoothed
    prior : (9, 9) array
        Covariance of position, velocity and attitude before any constraint.
    start : (9,) array
        Stated minus smoothed entry state.
    """
    covariance = smoothed.covariance[0][:9, :9]
    left, sigma, nis, dof = take_out(start, covariance, prior)
    own = np.sqrt(np.diag(prior))
    axes = ("x", "y", "z")
    names = tuple(
        f"{what} {a} ({u})" for what, u in (("position", "m"), ("velocity", "m/s"), ("attitude", "rad")) for a in axes
    )
    return Statement(
        name="entry_state",
        source="entry state with its covariance",
        components=names,
        time=np.array([smoothed.time[0]]),
        innovation=start[None],
        innovation_sigma=own[None],
        nis=np.array([nis]),
        dof=dof,
        accepted=np.array([True]),
        left_out=left,
        left_out_covariance=np.diag(sigma**2),
        left_out_nis=nis,
        left_out_dof=dof,
    )
