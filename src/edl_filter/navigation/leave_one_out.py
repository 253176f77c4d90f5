"""What all other knowledge says of one constraint: the only agreement that proves anything.

A constraint that was fused at one epoch with covariance R is taken out of the smoothed estimate there in closed
form. With r_s = measured - smoothed and S_s the smoothed prediction's covariance, the prediction from everything
else has the residual ``R (R - S_s)⁻¹ r_s`` and its innovation the covariance ``R (R - S_s)⁻¹ R``. Where the others
say nothing, R - S_s vanishes; such directions are left out and the degrees of freedom counted without them. The
entry state is a constraint like any other, with its prior covariance for R.

A constraint that was fused at many epochs is left out by filtering without it.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky, solve_triangular
from scipy.stats import chi2

from edl_filter.navigation.filter import Forward, Fused, Problem, forward
from edl_filter.navigation.layout import Layout, sigma_states
from edl_filter.navigation.smoother import Smoothed, smooth
from edl_filter.navigation.ukf import MerwePoints

Array = NDArray[np.float64]
#: Least part of a direction's variance that the others must explain for the direction to count.
LEAST_KNOWN = 1e-3


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
    left_out, left_out_sigma : (m,) arrays
        Measured minus predicted from all other knowledge, and one sigma of that; over many epochs the mean,
        whose prediction error is taken as fully correlated.
    left_out_nis : float
    left_out_dof : int
        Directions in which the others say anything.
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
    left_out_sigma: Array
    left_out_nis: float
    left_out_dof: int

    def nis_interval(self, probability: float = 0.999) -> tuple[float, float]:
        """Interval that holds the sum of `nis` with `probability`."""
        tail = 0.5 * (1.0 - probability)
        low, high = chi2.ppf([tail, 1.0 - tail], self.dof)
        return float(low), float(high)

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


def statements(problem: Problem, way: Forward, smoothed: Smoothed) -> list[Statement]:
    """All constraints of a reconstruction, by name, in the order of their first use."""
    uses: dict[str, list[Fused]] = defaultdict(list)
    for fused in way.fused:
        uses[fused.constraint.name].append(fused)
    return [_statement(problem, way.layout, smoothed, group) for group in uses.values()]


def _statement(problem: Problem, layout: Layout, smoothed: Smoothed, group: list[Fused]) -> Statement:
    first = group[0].constraint
    innovations = [f.innovation for f in group]
    sigma = [np.sqrt(np.diag(i.predicted_covariance + i.noise_covariance)) for i in innovations]
    if len(group) == 1:
        left = _from_smoothed(problem, layout, smoothed, group[0])
    else:
        left = _from_rerun(problem, group)
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
        left_out=left[0],
        left_out_sigma=left[1],
        left_out_nis=left[2],
        left_out_dof=left[3],
    )


def predicted(problem: Problem, layout: Layout, smoothed: Smoothed, fused: Fused) -> tuple[Array, Array]:
    """What the smoothed estimate predicts for a constraint, and the covariance of that."""
    s = problem.settings
    points = MerwePoints(layout.size, s.alpha, s.beta, s.kappa)
    sigmas = points.sigma_points(np.zeros(layout.size), smoothed.covariance[fused.node])
    nav, errors = sigma_states(smoothed.states[fused.node], sigmas, len(sigmas))
    values = fused.constraint.predict(nav, errors, layout)
    mean = points.Wm @ values
    spread = values - mean
    return mean, (spread * points.Wc[:, None]).T @ spread


def _from_smoothed(
    problem: Problem, layout: Layout, smoothed: Smoothed, fused: Fused
) -> tuple[Array, Array, float, int]:
    mean, covariance = predicted(problem, layout, smoothed, fused)
    residual, noise = fused.constraint.measured - mean, fused.constraint.noise
    if fused.accepted:
        return take_out(residual, covariance, noise)
    total = covariance + noise
    nis = float(residual @ np.linalg.solve(total, residual))
    return residual, np.sqrt(np.diag(total)), nis, len(residual)


def take_out(residual: Array, covariance: Array, noise: Array) -> tuple[Array, Array, float, int]:
    """Residual against the prediction from everything else.

    Parameters
    ----------
    residual : (m,) array
        Measured minus smoothed.
    covariance : (m, m) array
        Of the smoothed prediction.
    noise : (m, m) array
        Of the measurement that went into it.

    Returns
    -------
    left_out : (m,) array
        Measured minus predicted without it, in the directions of which the others know anything.
    sigma : (m,) array
        One sigma of it; infinite for a component in the other directions.
    nis : float
    dof : int
    """
    root = cholesky(noise, lower=True)
    whitened = solve_triangular(root, solve_triangular(root, covariance, lower=True).T, lower=True)
    known, directions = np.linalg.eigh(np.eye(len(residual)) - 0.5 * (whitened + whitened.T))
    keep = known > LEAST_KNOWN
    along = directions.T @ solve_triangular(root, residual, lower=True)
    left = np.where(keep, along / np.where(keep, known, 1.0), 0.0)
    spread = root @ directions
    variance = np.where(keep, 1.0 / np.where(keep, known, 1.0), 0.0)
    sigma = np.sqrt((spread**2) @ variance)
    blind = (spread[:, ~keep] ** 2).sum(axis=1) > 0.5 * np.diag(noise)
    nis = float(np.sum(along[keep] ** 2 / known[keep]))
    return spread @ left, np.where(blind, np.inf, sigma), nis, int(keep.sum())


def _from_rerun(problem: Problem, group: list[Fused]) -> tuple[Array, Array, float, int]:
    name = group[0].constraint.name
    without = replace(problem, constraints=tuple(c for c in problem.constraints if c.name != name))
    way = forward(without)
    smoothed = smooth(way)
    node = {round(n.time, 5): i for i, n in enumerate(way.nodes)}
    residuals, covariances, noises = [], [], []
    for fused in group:
        here = replace(fused, node=node[round(fused.constraint.time, 5)])
        mean, covariance = predicted(problem, way.layout, smoothed, here)
        residuals.append(fused.constraint.measured - mean)
        covariances.append(np.diag(covariance))
        noises.append(np.diag(fused.constraint.noise))
    residual = np.mean(residuals, axis=0)
    sigma = np.sqrt(np.mean(np.sqrt(covariances), axis=0) ** 2 + np.mean(noises, axis=0) / len(group))
    return residual, sigma, float(np.sum((residual / sigma) ** 2)), len(residual)


def entry_statement(problem: Problem, way: Forward, smoothed: Smoothed, prior: Array, start: Array) -> Statement:
    """The entry state as a constraint: what all other knowledge says of it.

    Parameters
    ----------
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
        left_out_sigma=sigma,
        left_out_nis=nis,
        left_out_dof=dof,
    )
