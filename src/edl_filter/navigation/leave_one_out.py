"""Checks of every constraint against all the others: agreement with data that were used proves nothing.

Every constraint is left out once: the filter runs again without it from the epoch before its first use, the smoother
returns to that epoch, and the prediction there is compared with the measurement. With the residual goes the information
gain, which says what the estimate would lose without the constraint (`information`).

The entry state is a constraint too, with its prior covariance. Since no filter can start without one, its contribution
is removed from the smoothed estimate in closed form, ``R (R - S)⁻¹ r``. That form needs no second run, but it is not
used for the other constraints: it has the linearisation of an estimate that used the constraint, and ``R - S`` vanishes
in directions that the constraint alone determines. On the rovers' flights it differs from filtering again by up to
0.004 sigma for the parachute and the steady descent, 0.2 for the gravity at rest and 0.7 for the landing, and it has no
value for the velocity at rest.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cholesky, solve_triangular

from edl_filter.navigation.filter import FilterPass, Fused, Problem, new_filter, quantile, run_filter_without
from edl_filter.navigation.information import added_information, information_in_order
from edl_filter.navigation.iterated import run_without
from edl_filter.navigation.smoother import Smoothed, smooth
from edl_filter.types import AXES, Array, BoolArray

#: Least part of a direction's variance that the other constraints must explain for the direction to count.
LEAST_EXPLAINED = 0.01


@dataclass(frozen=True)
class ConstraintCheck:
    """All uses of one constraint: innovations of the filter, and the residual against all other constraints.

    Attributes
    ----------
    name, source : str
    components : tuple of str
    time : (K,) array
        Epochs at which it was used, s.
    innovation, innovation_sigma : (K, m) arrays
        Measured minus predicted by the filter, and one sigma of that, in the units that `components` names.
    nis : (K,) array
        Normalised innovation squared, m degrees of freedom each.
    dof : int
        Of all epochs together.
    accepted : (K,) boolean array
    left_out : (m,) array
        Measured minus predicted from everything else; over many epochs the mean, whose prediction error is
        taken as fully correlated. NaN, with an infinite sigma, where the covariance without it is singular to working
        precision; `left_out_nis` and `left_out_information` are NaN then.
    left_out_covariance : (m, m) array
        Of `left_out`: prediction and measurement together.
    left_out_nis : float
    left_out_dof : int
    information : (K,) array
        Information gain of each use over all measurements before it, nats; NaN for the entry state, with which the
        filter starts.
    left_out_information : float
        Information gain of all uses together over all other constraints, nats. For the entry state a lower bound:
        a direction that it alone determines counts with ``-½ ln(LEAST_EXPLAINED)``, 2.3 nats.
    """

    name: str
    source: str
    components: tuple[str, ...]
    time: Array
    innovation: Array
    innovation_sigma: Array
    nis: Array
    dof: int
    accepted: BoolArray
    left_out: Array
    left_out_covariance: Array
    left_out_nis: float
    left_out_dof: int
    information: Array
    left_out_information: float

    def nis_interval(self, probability: float = 0.999) -> tuple[float, float]:
        """Interval that holds the sum of `nis` with `probability`."""
        return _interval(probability, self.dof)

    def left_out_nis_interval(self, probability: float = 0.999) -> tuple[float, float]:
        """Interval that holds `left_out_nis` with `probability`."""
        return _interval(probability, self.left_out_dof)

    @property
    def left_out_sigma(self) -> Array:
        """One sigma of `left_out`, ``(m,)``; infinite where the other constraints do not determine the component."""
        return np.sqrt(np.diag(self.left_out_covariance))

    @property
    def consistent(self) -> bool:
        """Whether the sum of `nis` lies in its 99.9 % interval."""
        low, high = self.nis_interval()
        return low <= float(np.sum(self.nis)) <= high


def _interval(probability: float, dof: int) -> tuple[float, float]:
    """Interval that holds a sum of `dof` squares with `probability`, with equal tails."""
    tail = 0.5 * (1.0 - probability)
    return quantile(tail, dof), quantile(1.0 - tail, dof)


def check_constraints(problem: Problem, filter_pass: FilterPass) -> list[ConstraintCheck]:
    """Check all constraints of a filter pass, by name, in the order of their first use."""
    uses: dict[str, list[Fused]] = defaultdict(list)
    for fused in filter_pass.fused:
        uses[fused.constraint.name].append(fused)
    return [_check(problem, filter_pass, group) for group in uses.values()]


def _check(problem: Problem, filter_pass: FilterPass, group: list[Fused]) -> ConstraintCheck:
    """Check the constraints of one name, `group`."""
    first = group[0].constraint
    innovations = [f.innovation for f in group]
    sigma = [np.sqrt(np.diag(i.predicted_covariance + i.noise_covariance)) for i in innovations]
    run = run_filter_without if filter_pass.references is None else run_without
    try:
        without = run(problem, filter_pass, first.name)
        smoothed = smooth(without, group[0].node)
        residual, covariance = _left_out_residual(problem, smoothed, group)
        left_out_nis = float(residual @ np.linalg.solve(covariance, residual))
        left_out_information = added_information(group, without, smoothed)
    except np.linalg.LinAlgError:  # without it the covariance is singular to working precision
        residual = np.full(len(innovations[0].residual), np.nan)
        covariance = np.diag(np.full(len(residual), np.inf))
        left_out_nis = left_out_information = np.nan
    return ConstraintCheck(
        name=first.name,
        source=first.source,
        components=first.components,
        time=np.array([f.constraint.time for f in group]),
        innovation=np.array([i.residual for i in innovations]),
        innovation_sigma=np.array(sigma),
        nis=np.array([i.nis for i in innovations]),
        dof=sum(len(i.residual) for i in innovations),
        accepted=np.array([f.accepted for f in group]),
        left_out=residual,
        left_out_covariance=covariance,
        left_out_nis=left_out_nis,
        left_out_dof=len(residual),
        information=information_in_order(group),
        left_out_information=left_out_information,
    )


def _left_out_residual(problem: Problem, smoothed: Smoothed, group: list[Fused]) -> tuple[Array, Array]:
    """Residual against the estimate from everything else, `smoothed` from the first use on, and its covariance.

    Of the readings that were accepted, if there are any: a rejected one is no part of the estimate that is checked.
    """
    first = group[0].node
    residuals, predictions, noises = [], [], []
    used = [f for f in group if f.accepted] or group
    for fused in used:
        k = fused.node - first
        innovation = new_filter(problem, smoothed.states[k], smoothed.covariance[k]).innovation(fused.constraint)
        residuals.append(innovation.residual)
        predictions.append(innovation.predicted_covariance)
        noises.append(innovation.noise_covariance)
    residual = np.mean(residuals, axis=0)
    if len(used) == 1:
        total = predictions[0] + noises[0]
    else:  # correlations in time and between components are not computed: taken as full, and as none
        sigma = np.mean([np.sqrt(np.diag(p)) for p in predictions], axis=0)
        total = np.diag(sigma**2 + np.mean([np.diag(n) for n in noises], axis=0) / len(used))
    return residual, total


def remove_measurement(residual: Array, covariance: Array, noise: Array) -> tuple[Array, Array, float, int]:
    """Residual of a measurement against the prediction from everything else, from an estimate that used it.

    With r = measured - estimated, S the estimate's covariance and R the measurement's, everything else alone
    has the residual ``R (R - S)⁻¹ r`` with the innovation's covariance ``R (R - S)⁻¹ R``. In directions that the
    measurement alone determines, R - S vanishes; they are omitted.

    Parameters
    ----------
    residual : (m,) array
        Measured minus estimated.
    covariance, noise : (m, m) arrays
        S and R, in the squared units of `residual`.

    Returns
    -------
    left_out : (m,) array
        Residual against everything else, in the directions that this determines.
    sigma : (m,) array
        One sigma of it; infinite for a component mostly in other directions.
    nis : float
    dof : int
        Number of directions that count.
    """
    root, explained, directions = _explained_variance(covariance, noise)
    keep = explained > LEAST_EXPLAINED
    inverse = np.where(keep, 1.0 / np.where(keep, explained, 1.0), 0.0)
    along = directions.T @ solve_triangular(root, residual, lower=True)
    axes = root @ directions
    undetermined = (axes[:, ~keep] ** 2).sum(axis=1) > 0.5 * np.diag(noise)
    sigma = np.where(undetermined, np.inf, np.sqrt((axes**2) @ inverse))
    return axes @ (inverse * along), sigma, float(np.sum(inverse * along**2)), int(keep.sum())


def _explained_variance(covariance: Array, noise: Array) -> tuple[Array, Array, Array]:
    """Cholesky factor of R, and eigenvalues and eigenvectors of ``1 - S/R``: what all others explain of each direction.

    Arguments as in `remove_measurement`.
    """
    root = cholesky(noise, lower=True)
    whitened = solve_triangular(root, solve_triangular(root, covariance, lower=True).T, lower=True)
    explained, directions = np.linalg.eigh(np.eye(len(noise)) - 0.5 * (whitened + whitened.T))
    return root, explained, directions


def information_of_prior(covariance: Array, prior: Array) -> float:
    """Information gain of a prior over all measurements, ``½ ln det(P + R) / det R`` with P from these alone, nats.

    With S the covariance given both, ``1 - R⁻¹ S = (P + R)⁻¹ R``, so that P is not needed.

    Parameters
    ----------
    covariance, prior : (m, m) arrays
        S, and R of the prior, in the same units.

    Returns
    -------
    float
        Lower bound: a direction that the measurements explain by less than `LEAST_EXPLAINED` counts with that.
    """
    _, explained, _ = _explained_variance(covariance, prior)
    return float(-0.5 * np.sum(np.log(np.clip(explained, LEAST_EXPLAINED, 1.0))))


def check_entry_state(smoothed: Smoothed, prior: Array, start: Array) -> ConstraintCheck:
    """Check the entry state as a constraint against everything else.

    Parameters
    ----------
    smoothed : Smoothed
        Smoothed states.
    prior : (9, 9) array
        Covariance of position (m), velocity (m/s) and attitude (rad) before any constraint.
    start : (9,) array
        Stated minus smoothed entry state.

    Returns
    -------
    ConstraintCheck
    """
    covariance = smoothed.covariance[0][:9, :9]
    residual, sigma, nis, dof = remove_measurement(start, covariance, prior)
    prior_sigma = np.sqrt(np.diag(prior))
    names = tuple(
        f"{quantity} {a} ({u})"
        for quantity, u in (("position", "m"), ("velocity", "m/s"), ("attitude", "rad"))
        for a in AXES
    )
    return ConstraintCheck(
        name="entry_state",
        source="entry state with its covariance",
        components=names,
        time=np.array([smoothed.time[0]]),
        innovation=start[None],
        innovation_sigma=prior_sigma[None],
        nis=np.array([nis]),
        dof=dof,
        accepted=np.array([True]),
        left_out=residual,
        left_out_covariance=np.diag(sigma**2),
        left_out_nis=nis,
        left_out_dof=dof,
        information=np.array([np.nan]),
        left_out_information=information_of_prior(covariance, prior),
    )
