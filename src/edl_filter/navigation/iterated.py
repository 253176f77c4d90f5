"""Iterated smoothing: a flight with a large uncertainty is linearised again about its smoothed path.

A filter linearises motion and measurements about its own prediction. After a gap the attitude is uncertain by up to
tenths of a radian, and at the landing the position by tens of kilometres: the readings of an altimeter are then no
linear function of the position (``d²/2R`` is 85 m at 24 km), and their common second-order error is taken for
independent noise. The same holds if the entry state is poorly known: with a sigma of the attitude of 0.5 degrees the
altitude has one of 4 km at the parachute. The smoothed path is far better known. Method: the Kalman filter and smoother
of the affine model about the smoothed path, whose smoothed path is the next one to be linearised about. This is the
Gauss-Newton method for the most probable path (Bell 1994, SIAM J. Optim. 4, 626; Särkkä & Svensson 2023, *Bayesian
Filtering and Smoothing*, section 14.4), and its covariance is that of the linear model at this path.

Errors are vectors about the reference of each node. With F and H the Jacobians there, d the mean error and
``f(x) ⊖ x⁺`` the difference of the propagated reference from that of the next node::

    d⁻ = F d + (f(x) ⊖ x⁺)        y = z - h(x) - H d⁻        d = d⁻ + K y

In every pass the gate is applied to all constraints, accepted or rejected, except those that `outlier_screening`
rejected: a measurement may contradict a prediction only because this was linearised far from it.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import replace
from math import fsum

import numpy as np

from edl_filter.estimation.kalman import measurement_update
from edl_filter.estimation.small_matrices import symmetric_part
from edl_filter.navigation.consensus import quantile
from edl_filter.navigation.ekf import linearized_measurement, propagate_with_transition
from edl_filter.navigation.estimator import Innovation, Transition
from edl_filter.navigation.filter import FilterPass, Fused, Node, Problem, unit_change
from edl_filter.navigation.initial import initial_estimate
from edl_filter.navigation.layout import State
from edl_filter.navigation.noise import process_noise
from edl_filter.navigation.robust import measurement_weight, weighted
from edl_filter.navigation.smoother import smooth
from edl_filter.types import Array

#: Largest number of passes, and the largest move of a state, in its sigmas, that ends the iteration.
PASSES, TOLERANCE = 15, 0.01
#: Move (`_largest_distance`) below which the first pass is kept: its NEES is off by less than a 25th.
LINEAR = 0.2
#: Sigmas of the entry state from which on a flight may not be linear: of its attitude (rad) and its position (m).
UNCERTAIN_ATTITUDE, UNCERTAIN_POSITION = 1e-3, 3e3
#: Added to the correlations of navigation states, which may be singular to rounding.
ROUNDING = 1e-12


def may_be_nonlinear(first: FilterPass) -> bool:
    """Whether the entry state is so uncertain that a filter pass may not be linear.

    At a milliradian the second-order error of the velocity is 3 mm/s, at three kilometres that of an altimeter 1.3 m.
    """
    covariance = first.nodes[0].covariance
    attitude, position = (float(np.sqrt(np.linalg.eigvalsh(covariance[b, b])[-1])) for b in (slice(6, 9), slice(3)))
    return attitude > UNCERTAIN_ATTITUDE or position > UNCERTAIN_POSITION


def iterate(problem: Problem, first: FilterPass) -> FilterPass:
    """Linearise a filter pass again about its smoothed path until this does not move.

    Parameters
    ----------
    problem : Problem
        Samples, initial state, constraints, settings.
    first : FilterPass
        Of this problem; linearised about its own estimates, or about references, from which the iteration starts then.

    Returns
    -------
    FilterPass
        With its references; `first` where it was linear enough. `FilterPass.converged` is false if the path still
        moves after the last pass.
    """
    references = smooth(first).states
    latest = first
    for k in range(PASSES):
        latest = linearized_pass(problem, latest, references)
        smoothed = smooth(latest)
        moves = [new.minus(old) for new, old in zip(smoothed.states, references, strict=True)]
        sigmas = np.sqrt(np.diagonal(smoothed.covariance, axis1=1, axis2=2))
        references = smoothed.states
        linear = k == 0 and first.references is None and _same_decisions(first, latest)
        if linear and _largest_distance(moves, smoothed.covariance) < LINEAR:
            return first
        if np.max(np.abs(moves) / sigmas) < TOLERANCE:
            return latest
    return replace(latest, converged=False)


def _largest_distance(moves: Sequence[Array], covariance: Array) -> float:
    """Largest move of the navigation states of a node: root mean square in sigmas along the principal axes.

    Its square is the change of the NEES over its degrees of freedom. A move that is small in every state may be large
    in a combination of them that an altimeter or the rest on the surface determines well.
    """
    squares = []
    for move, block in zip(moves, covariance, strict=True):
        sigma = np.sqrt(np.diag(block)[:9])
        correlation = block[:9, :9] / np.outer(sigma, sigma) + ROUNDING * np.eye(9)
        squares.append(float((move[:9] / sigma) @ np.linalg.solve(correlation, move[:9] / sigma)))
    return float(np.sqrt(max(0.0, *squares) / 9.0))


def run_without(problem: Problem, filter_pass: FilterPass, name: str) -> FilterPass:
    """`filter.run_filter_without` of a pass that has references: iterated from these.

    Parameters
    ----------
    problem : Problem
        Samples, initial state, constraints, settings.
    filter_pass : FilterPass
        With all constraints, and with references.
    name : str
        Of the constraints to leave out.

    Returns
    -------
    FilterPass
    """
    remaining = [f for f in filter_pass.fused if f.constraint.name != name]
    return iterate(problem, replace(filter_pass, fused=remaining))


def linearized_pass(problem: Problem, before: FilterPass, references: list[State]) -> FilterPass:
    """One run of the filter on the model that is linearised about a path.

    Parameters
    ----------
    problem : Problem
        Samples, initial state, constraints, settings.
    before : FilterPass
        Whose nodes and constraints are used, and whose decisions about readings that are one of many.
    references : list of State
        The path, one state per node.

    Returns
    -------
    FilterPass
    """
    uses: dict[int, list[Fused]] = defaultdict(list)
    for f in before.fused:
        uses[f.node].append(f)
    start, covariance = initial_estimate(
        problem.layout, problem.initial, problem.entry, problem.instruments[before.nodes[0].unit], problem.planet
    )
    error = start.minus(references[0])
    nodes: list[Node] = []
    fused: list[Fused] = []
    for k, node in enumerate(before.nodes):
        transition: Transition | None = None
        if k > 0:
            error, transition = _predict(problem, nodes[-1], node, error, covariance, references[k - 1], references[k])
            covariance = transition.covariance
        for use in uses[k]:
            use, error, covariance = _update(problem, use, references[k], error, covariance)
            fused.append(use)
        nodes.append(Node(node.time, node.unit, transition, references[k].plus(error), covariance))
    divergence = before.divergence
    if divergence is not None:
        readings = [f.innovation for f in fused if f.constraint.name in divergence.names]
        dof = sum(len(i.residual) for i in readings)
        if fsum(i.nis for i in readings) <= quantile(problem.settings.gate_probability, dof):
            divergence = None
    return replace(before, nodes=nodes, fused=fused, divergence=divergence, references=references, converged=True)


def _predict(
    problem: Problem, last: Node, node: Node, error: Array, covariance: Array, reference: State, following: State
) -> tuple[Array, Transition]:
    """Mean error about the reference `following` of the next node, and the transition to it."""
    begin, end = problem.samples.index(last.time), problem.samples.index(node.time)
    if node.unit != last.unit:
        matrix, noise, errors = unit_change(problem, node.unit, reference.errors)
        reached = State(reference.nav, errors)
    else:
        part = problem.samples.part(begin, end)
        noise = process_noise(problem.layout, part, reference.nav[6:10])
        reached, matrix = propagate_with_transition(problem.layout, problem.planet, part, reference)
    cross = covariance @ matrix.T
    predicted = matrix @ error + reached.minus(following)
    return predicted, Transition(cross, following.plus(predicted), symmetric_part(matrix @ cross + noise))


def _update(
    problem: Problem, use: Fused, reference: State, error: Array, covariance: Array
) -> tuple[Fused, Array, Array]:
    """A constraint as it is used here, and mean error and covariance after it."""
    constraint, gate = use.constraint, problem.settings.gate_probability
    predicted, jacobian = linearized_measurement(constraint, reference, problem.layout)
    residual = constraint.measured - predicted - jacobian @ error
    spread = symmetric_part(jacobian @ covariance @ jacobian.T)
    innovation = Innovation.of(residual, spread, constraint.noise, jacobian)
    accepted = not use.screened and innovation.nis <= quantile(gate, len(residual))
    weight = measurement_weight(innovation, problem.settings.robust) if accepted else 1.0
    if accepted:
        noise = weighted(innovation, weight).noise_covariance
        gain, covariance = measurement_update(covariance, jacobian, noise)
        error = error + gain @ residual
    return Fused(constraint, use.node, innovation, bool(accepted), weight, use.screened), error, covariance


def _same_decisions(first: FilterPass, second: FilterPass) -> bool:
    """Whether two passes with the same constraints accept the same of them."""
    return all(a.accepted == b.accepted for a, b in zip(first.fused, second.fused, strict=True))
