"""Learn a database's increments on one flight and predict another: the proof that what was learned is aerodynamics.

Two flights of one vehicle meet the same error of the database, and nothing else is common to them: air, path, IMU and
its errors differ. Increments that are learned from one flight must therefore raise the probability of the other one's
forces and moments over that under the prior database (held-out predictive density: Gelman et al., Bayesian Data
Analysis, 3rd ed. 2013, ch. 7).

The field passes from flight to flight by variables z at knots that both flights have flown over: principal modes over
the angle by the Cholesky factor along the flow, so that z ~ N(0, 1) a priori in either flight. With V the whitened
covariance of a flight's rows with z and e its white residuals, the first flight gives z ~ N(Vᵀe, 1 - VᵀV); the white
residuals of the second are N(V μ, 1 - V (1 - C) Vᵀ) then, with μ and C from the first. Their density is the product of
those of each row given all earlier rows, so that the gain over the prior divides into rows exactly.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular

from edl_filter.aero.discrepancy import FIELD_COEFFICIENTS, AngleModes, DiscrepancyPrior
from edl_filter.aero.increments import REGIMES
from edl_filter.diagnosis.jacobians.coefficient_errors import interpolated_angles
from edl_filter.diagnosis.linear_model.linear_model import LinearizedModel
from edl_filter.diagnosis.residual_analysis.database_update import FLOW_SPACING, knot_angles
from edl_filter.diagnosis.residual_analysis.field_posterior import (
    FlownPath,
    amplitude_covariance,
    knot_coordinates,
    white_columns,
)
from edl_filter.diagnosis.residual_analysis.residual_map import channels, flow_regimes
from edl_filter.errors import InputError
from edl_filter.estimation.kalman import WhiteningFilter
from edl_filter.estimation.matern import matern32_correlation
from edl_filter.types import Array

#: Eigenvalue of the covariance over the angle, relative to the largest, below which a principal mode is left out.
_NEGLIGIBLE_MODE = 1e-8
#: Information about a combination of z below which it is left out.
_NEGLIGIBLE_INFORMATION = 1e-12


@dataclass(frozen=True)
class CellGain:
    """Gain of one channel in one regime of the flow, nats, with the number of its rows."""

    channel: str
    regime: str
    gain: float
    count: int


@dataclass(frozen=True)
class CrossPrediction:
    """How much better one flight is predicted with the increments that another one gives.

    Attributes
    ----------
    row_gains : (R,) array
        Log predictive density of each row, given all earlier rows, over that under the prior, nats.
    cells : tuple of CellGain
        Channels by regime.
    """

    row_gains: Array
    cells: tuple[CellGain, ...]

    @property
    def total(self) -> float:
        """Gain of all rows, nats."""
        return float(np.sum(self.row_gains))


def predictive_log_likelihood(learned: LinearizedModel, predicted: LinearizedModel) -> CrossPrediction:
    """Log likelihood of a flight with the increments that another flight gives, over that with the prior database.

    Parameters
    ----------
    learned, predicted : LinearizedModel
        Of the flight that gives the increments, and of the one that is predicted: with one prior of one database.

    Raises
    ------
    InputError
        A database that is exact or not the same in both, or flights that have no flow in common.
    """
    prior = learned.case.uncertainty.discrepancy
    families = [m.inputs.forward_model.database.family for m in (learned, predicted)]
    if learned.field is None or predicted.field is None:
        raise InputError(
            "aerodynamics.coefficient_sigma: found 0, an exact database; expected one with errors to learn."
        )
    if predicted.case.uncertainty.discrepancy != prior or families[0] != families[1]:
        raise InputError(
            "aerodynamics: found two databases or two priors of their error; expected one in both missions."
        )
    paths = [FlownPath.of(m) for m in (learned, predicted)]
    coordinates = common_knots(paths[0], paths[1], prior)
    alpha = knot_angles(paths[0], prior, interpolated_angles(learned.inputs.forward_model.database.continuum))
    evidence = []
    for model, path in zip((learned, predicted), paths, strict=True):
        distance = np.concatenate([path.distance_at(regime, c) for regime, c in coordinates.items()])
        whiten, modes = model.fitted_noise_filter, _modes(model)
        columns = knot_columns(whiten, model.nuisance.fields, path.row_distance, prior, modes, distance, alpha)
        evidence.append((columns, model.white_residuals(whiten)))
    gains = row_gains(*evidence[0], *evidence[1])
    return CrossPrediction(gains, cell_gains(predicted, gains))


def _modes(model: LinearizedModel) -> dict[str, AngleModes]:
    assert model.field is not None
    return model.field.modes


def common_knots(first: FlownPath, second: FlownPath, prior: DiscrepancyPrior) -> dict[str, Array]:
    """Regime → coordinates of knots ``(K,)`` in the range over which both flights have flown.

    Raises
    ------
    InputError
        There is no such range.
    """
    out = {}
    for regime in REGIMES:
        ranges = [path.flown_range(regime) for path in (first, second)]
        if ranges[0] is None or ranges[1] is None:
            continue
        low, high = max(r[0] for r in ranges if r), min(r[1] for r in ranges if r)
        if low < high:
            length = prior.log_mach_length if regime == "mach" else prior.log_knudsen_length
            out[regime] = knot_coordinates(low, high, length, FLOW_SPACING)
    if not out:
        raise InputError(
            "cross prediction: found flights without a common Mach or Knudsen number; expected an overlap."
        )
    return out


def knot_columns(
    whiten: WhiteningFilter,
    fields: dict[str, slice],
    row_distance: Array,
    prior: DiscrepancyPrior,
    modes: dict[str, AngleModes],
    distance: Array,
    alpha: Array,
) -> Array:
    """Whitened covariance V of a flight's rows with the variables z at knots.

    Parameters
    ----------
    whiten : WhiteningFilter
        Of a model with the fields' amplitudes among its states.
    fields : dict
        Coefficient → places of its amplitudes.
    row_distance : (R,) array
        Places of the rows along the flow, in correlation lengths.
    prior : DiscrepancyPrior
        Of the fields.
    modes : dict
        Coefficient → modes over the angle.
    distance : (K,) array
        Places of the knots along the flow.
    alpha : (A,) array
        Angles that determine the principal modes, rad; those of the continuum table where it is linear between them.

    Returns
    -------
    (R, Z) array
    """
    factor = np.linalg.cholesky(matern32_correlation(np.subtract.outer(distance, distance))[..., 0])
    blocks = []
    for name in FIELD_COEFFICIENTS:
        covariance = amplitude_covariance(whiten.model.design, fields[name], row_distance, distance)
        size, vectors = np.linalg.eigh(prior.angle_kernel(name, alpha, alpha))
        significant = size > _NEGLIGIBLE_MODE * size[-1]
        principal = (
            modes[name].at(alpha, np.zeros(len(alpha), bool)).T @ vectors[:, significant] / np.sqrt(size[significant])
        )
        at_knots = np.moveaxis(covariance @ principal, 1, 0)
        independent = solve_triangular(factor, at_knots.reshape(len(distance), -1), lower=True)
        blocks.append(np.moveaxis(independent.reshape(at_knots.shape), 0, 1).reshape(len(row_distance), -1))
    return white_columns(whiten, blocks)


def row_gains(learned: Array, learned_white: Array, predicted: Array, predicted_white: Array) -> Array:
    """Gain of each row of the second flight, given its earlier rows, by what the first one says of z.

    Parameters
    ----------
    learned, predicted : (Q, Z), (R, Z) arrays
        V of both flights.
    learned_white, predicted_white : (Q,), (R,) arrays
        White residuals of both.

    Returns
    -------
    (R,) array
        nats.
    """
    information, vectors = np.linalg.eigh(learned.T @ learned)
    informative = information > _NEGLIGIBLE_INFORMATION
    design = predicted @ (vectors[:, informative] * np.sqrt(information[informative]))
    expected = predicted @ (learned.T @ learned_white)
    # the covariance 1 - G Gᵀ is that of noise and a state of covariance -1: the Kalman filter's algebra holds as well
    covariance, state = -np.eye(design.shape[1]), np.zeros(design.shape[1])
    out = np.empty(len(predicted_white))
    for i, row in enumerate(design):
        gain = covariance @ row
        variance = 1.0 + row @ gain
        innovation = predicted_white[i] - expected[i] - row @ state
        out[i] = 0.5 * (predicted_white[i] ** 2 - innovation**2 / variance - np.log(variance))
        state = state + gain * (innovation / variance)
        covariance -= np.outer(gain, gain / variance)
    return out


def cell_gains(model: LinearizedModel, gains: Array) -> tuple[CellGain, ...]:
    """Gains of rows ``(R,)``, nats, by channel and regime of a flight."""
    cells, regimes = [], flow_regimes(model)
    for c, (channel, _) in enumerate(channels(model)):
        for regime, inside in regimes:
            rows = model.index.bin_rows[inside, c]
            rows = rows[rows >= 0]
            if len(rows):
                cells.append(CellGain(channel, regime, float(np.sum(gains[rows])), len(rows)))
    return tuple(cells)
