"""The missing force and moment against time: a Gauss–Markov process estimated from all differences, with its band.

What nobody named is a state of the linear problem (`missing.allow`). The fixed-interval smoother says what it was at
every bin, given all that came before and after, with the errors that the model allows taken out: the modified
Bryson–Frazier form (Bierman, Factorization Methods, 1977, ch. 10), which needs the filter's gains and no inverse.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from edl_filter.diagnosis.linear import Linear
from edl_filter.diagnosis.missing import Missing, strength
from edl_filter.diagnosis.path import PER_BIN
from edl_filter.diagnosis.whitening import Whitener

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Latent:
    """Missing force and moment in body axes, and one sigma of them.

    Attributes
    ----------
    time : (B,) array
        Middles of the bins that are compared, s.
    force, force_sigma : (B, 3) arrays
        N.
    moment, moment_sigma : (B, 3) arrays
        About the centre of mass, N m.
    """

    time: Array
    force: Array
    force_sigma: Array
    moment: Array
    moment_sigma: Array


def estimate(linear: Linear, missing: Missing) -> Latent | None:
    """What was missing, under the size and memory that make the flight likeliest; None where that is nothing."""
    if missing.force == missing.moment == 0.0:
        return None
    order, bins, found = linear.ground.order, linear.bins, linear.ground.found
    whiten = linear.with_missing(missing)
    mean, covariance = smoothed(whiten, linear.white(whiten), linear.start, 6)
    used = np.flatnonzero(order.bin_rows[:, 0] >= 0)
    step = np.searchsorted(whiten.steps.rows, order.bin_rows[used, 0], side="right") - 1
    push = strength(found.flow, missing)[PER_BIN // 2 :: PER_BIN][used, None]
    body = linear.ground.setup.world.rigid_body
    to_force, to_moment = missing.force * body.mass * push, missing.moment * push
    inertia = body.inertia
    turned = np.einsum("ij,bjk,lk->bil", inertia, covariance[step][:, 3:, 3:], inertia)
    return Latent(
        time=bins.middle[used],
        force=to_force * mean[step, :3],
        force_sigma=to_force * np.sqrt(np.einsum("bii->bi", covariance[step][:, :3, :3])),
        moment=to_moment * (mean[step, 3:] @ inertia.T),
        moment_sigma=to_moment * np.sqrt(np.einsum("bii->bi", turned)),
    )


def smoothed(whiten: Whitener, white: Array, start: Array, count: int) -> tuple[Array, Array]:
    """Mean ``(K, count)`` and covariance ``(K, count, count)`` of the last unknowns at every step, given all rows.

    Parameters
    ----------
    whiten : Whitener
    white : (R,) array
        The differences.
    start : (n,) array
        What is stated of the unknowns at the beginning.
    count : int
    """
    s = whiten.steps
    n, steps = len(s.start), len(s.change)
    p, x = s.start.copy(), np.zeros(n)
    x[: len(start)] = start
    before, across = np.empty((steps, count)), np.empty((steps, count, n))
    for k in range(steps):
        move = np.eye(n) + s.change[k]
        p, x = move @ p @ move.T + s.noise[k], move @ x
        before[k], across[k] = x[-count:], p[-count:]  # before this step's rows
        gain = whiten.gain[s.rows[k] : s.rows[k + 1]]
        x = x + gain.T @ white[s.rows[k] : s.rows[k + 1]]
        p = p - gain.T @ gain
    mean, covariance = np.empty((steps, count)), np.empty((steps, count, count))
    adjoint, information = np.zeros(n), np.zeros((n, n))
    for k in range(steps - 1, -1, -1):
        rows = slice(s.rows[k], s.rows[k + 1])
        m = s.rows[k + 1] - s.rows[k]
        if m:
            seen = np.linalg.solve(whiten.factor[rows, :m], s.design[rows])  # L⁻¹ H
            left = np.eye(n) - whiten.gain[rows].T @ seen
            adjoint = left.T @ adjoint - seen.T @ white[rows]
            information = left.T @ information @ left + seen.T @ seen
        mean[k] = before[k] - across[k] @ adjoint
        covariance[k] = across[k][:, -count:] - across[k] @ information @ across[k].T
        move = np.eye(n) + s.change[k]
        adjoint, information = move.T @ adjoint, move.T @ information @ move
    return mean, covariance
