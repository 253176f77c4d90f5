"""What a flight says of its aerodynamic database: increments of CA, CN and Cm over the flow, and their covariance.

The posterior of the database's discrepancy (`field_posterior`) at knots over Mach number and total angle in continuum
flow, Knudsen number and total angle in rarefied flow, with everything else that the mission states as uncertain
marginalised. A knot's *share* is the part of its prior variance that the data removed: 1 where the flight decides, 0
where the increment is what the prior says, none.
"""

from __future__ import annotations

import numpy as np

from edl_filter.aero.discrepancy import FIELD_COEFFICIENTS, AngleModes, DiscrepancyPrior
from edl_filter.aero.increments import REGIMES, DatabaseUpdate, RegimeUpdate
from edl_filter.diagnosis.jacobians.coefficient_errors import discrepancy_sigma, interpolated_angles
from edl_filter.diagnosis.linear_model.linear_model import LinearizedModel
from edl_filter.diagnosis.prediction.dead_reckoning import NODES_PER_BIN
from edl_filter.diagnosis.residual_analysis.field_posterior import (
    FlownPath,
    amplitude_covariance,
    knot_coordinates,
)
from edl_filter.estimation.kalman import WhiteningFilter
from edl_filter.estimation.matern import matern32_correlation
from edl_filter.types import Array, IntArray

#: Largest spacing of the knots along the flow and over the angle, in correlation lengths: linear interpolation between
#: them errs by a few hundredths of a sigma.
FLOW_SPACING, ANGLE_SPACING = 0.25, 1.0 / 3.0


def estimate_database_update(model: LinearizedModel) -> DatabaseUpdate | None:
    """Increments of the database, given all residuals of a linearised model; None with an exact database.

    Parameters
    ----------
    model : LinearizedModel
        Of the flight, with the effects that are in its model: what another effect causes is taken for an error of the
        database as far as that can be.
    """
    if model.field is None or model.case.uncertainty.discrepancy.scale == 0.0:
        return None
    path, prior = FlownPath.of(model), model.case.uncertainty.discrepancy
    database = model.inputs.forward_model.database
    tables = {"mach": database.continuum, "knudsen": database.rarefied}
    nodes: dict[str, Array] = {}
    distances: dict[str, Array] = {}
    angles: dict[str, Array] = {}
    for regime in REGIMES:
        flown = path.flown_range(regime)
        if flown is not None:
            length = prior.log_mach_length if regime == "mach" else prior.log_knudsen_length
            coordinate = knot_coordinates(*flown, length, FLOW_SPACING)
            angles[regime] = knot_angles(path, prior, interpolated_angles(tables[regime]))
            distances[regime] = path.distance_at(regime, coordinate)
            nodes[regime] = np.exp(coordinate) if regime == "mach" else 10.0**coordinate
    if not nodes:
        return None
    whiten = model.fitted_noise_filter
    mean, covariance, prior_covariance = posterior_at_knots(
        whiten,
        model.white_residuals(whiten),
        model.nuisance.fields,
        path.row_distance,
        prior,
        model.field.modes,
        distances,
        angles,
    )
    unit_sigma = [_sigma_at_knots(model, path, d, angles[regime]) for regime, d in distances.items()]
    scale = np.concatenate([s.ravel() for s in unit_sigma])
    mean, covariance = mean * scale, covariance * np.outer(scale, scale)
    sigma = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    prior_sigma = np.sqrt(np.diag(prior_covariance)) * scale
    regimes, start = [], 0
    for regime, knots in nodes.items():
        alpha = angles[regime]
        shape = (len(FIELD_COEFFICIENTS), len(knots), len(alpha))
        part = slice(start, start + int(np.prod(shape)))
        start = part.stop
        regimes.append(
            RegimeUpdate(
                regime=regime,
                nodes=knots,
                alpha=alpha,
                increment=mean[part].reshape(shape),
                sigma=sigma[part].reshape(shape),
                prior_sigma=prior_sigma[part].reshape(shape),
                bins=_bins_by_knot(path, regime, knots, alpha),
            )
        )
    return DatabaseUpdate(database.family, prior, tuple(regimes), 0.5 * (covariance + covariance.T))


def knot_angles(path: FlownPath, prior: DiscrepancyPrior, table_angles: Array) -> Array:
    """Angles from zero to the largest that is compared, or a little beyond ``(A,)``, rad.

    Those of the database's own table if it is linear between them: its error is so as well.
    """
    largest = float(np.max(path.alpha_total[path.compared], initial=0.0))
    if len(table_angles) and table_angles[0] == 0.0:
        return table_angles[: max(int(np.searchsorted(table_angles, largest)), 1) + 1]
    step = ANGLE_SPACING * prior.angle_length
    return np.asarray(step * np.arange(max(int(np.ceil(largest / step)), 1) + 1), float)


def posterior_at_knots(
    whiten: WhiteningFilter,
    white: Array,
    fields: dict[str, slice],
    row_distance: Array,
    prior: DiscrepancyPrior,
    modes: dict[str, AngleModes],
    distances: dict[str, Array],
    angles: dict[str, Array],
) -> tuple[Array, Array, Array]:
    """Posterior of the fields at knots; in the database's sigmas.

    Parameters
    ----------
    whiten : WhiteningFilter
        Of a model with the fields' amplitudes among its states.
    white : (R,) array
        White residuals.
    fields : dict
        Coefficient → places of its amplitudes.
    row_distance : (R,) array
        Places of the rows along the flow, in correlation lengths.
    prior : DiscrepancyPrior
        Of the fields.
    modes : dict
        Coefficient → modes over the angle.
    distances : dict
        Regime → places of the knots along the flow ``(K,)``.
    angles : dict
        Regime → angles of the knots ``(A,)``, rad.

    Returns
    -------
    mean : (N,) array
        In the order of regime, coefficient, place, angle.
    covariance, prior_covariance : (N, N) arrays
    """
    blocks = [(fields[name], d) for d in distances.values() for name in FIELD_COEFFICIENTS]
    widths = [(values.stop - values.start) * len(d) for values, d in blocks]

    def columns(rows: slice) -> Array:
        design, distance = whiten.model.design[rows], row_distance[rows]
        parts = (amplitude_covariance(design, values, distance, d) for values, d in blocks)
        return np.concatenate([p.reshape(len(p), w) for p, w in zip(parts, widths, strict=True)], axis=1)

    reduction, mean = whiten.normal_equations(columns, sum(widths), white)
    return field_at_knots(prior, modes, distances, angles, mean, reduction)


def field_at_knots(
    prior: DiscrepancyPrior,
    modes: dict[str, AngleModes],
    distances: dict[str, Array],
    angles: dict[str, Array],
    mean: Array,
    reduction: Array,
) -> tuple[Array, Array, Array]:
    """Field at knots from the posterior of the amplitudes of its modes; in the database's sigmas.

    The covariance of the modes is that of the field less what the flight says nothing of, which keeps its prior.

    Parameters
    ----------
    prior : DiscrepancyPrior
        Of the field.
    modes : dict
        Coefficient → modes over the angle.
    distances : dict
        Regime → places along the flow ``(K,)``, in correlation lengths.
    angles : dict
        Regime → angles ``(A,)``, rad; those of the table where it is linear between them.
    mean, reduction : (C,), (C, C) arrays
        Posterior mean of the amplitudes, and prior less posterior covariance: by regime, coefficient, place, mode.

    Returns
    -------
    mean : (N,) array
        In the order of regime, coefficient, place, angle.
    covariance, prior_covariance : (N, N) arrays
    """
    blocks = [(name, regime) for regime in distances for name in FIELD_COEFFICIENTS]
    sizes = [len(distances[regime]) * len(angles[regime]) for _, regime in blocks]
    maps = []
    for name, regime in blocks:
        alpha = angles[regime]
        shapes = modes[name].at(alpha, np.full(len(alpha), regime == "knudsen"))
        maps.append(np.kron(np.eye(len(distances[regime])), shapes))
    widths = [m.shape[1] for m in maps]
    to_field = np.zeros((sum(sizes), sum(widths)))
    prior_covariance = np.zeros((sum(sizes), sum(sizes)))
    rows, columns = (np.concatenate(([0], np.cumsum(n))) for n in (sizes, widths))
    for i, (name, regime) in enumerate(blocks):
        to_field[rows[i] : rows[i + 1], columns[i] : columns[i + 1]] = maps[i]
        for j, (column_name, column_regime) in enumerate(blocks):
            if column_name == name:
                along = matern32_correlation(np.subtract.outer(distances[regime], distances[column_regime]))[..., 0]
                over_angle = prior.angle_kernel(name, angles[regime], angles[column_regime])
                prior_covariance[rows[i] : rows[i + 1], rows[j] : rows[j + 1]] = np.kron(along, over_angle)
    return to_field @ mean, prior_covariance - to_field @ reduction @ to_field.T, prior_covariance


def _sigma_at_knots(model: LinearizedModel, path: FlownPath, distance: Array, alpha: Array) -> Array:
    """One sigma of the database at knots ``(3, K, A)``, in units of the coefficients."""
    shape = (len(distance), len(alpha))
    mach, knudsen, speed = (np.repeat(v, len(alpha)) for v in path.at_distance(distance))
    database, prior = model.inputs.forward_model.database, model.case.uncertainty.discrepancy
    sigma = discrepancy_sigma(database, prior, mach, knudsen, np.tile(alpha, len(distance)), speed)
    return np.stack([sigma[name].reshape(shape) for name in FIELD_COEFFICIENTS])


def _bins_by_knot(path: FlownPath, regime: str, nodes: Array, alpha: Array) -> IntArray:
    """Number of bins nearest to each knot ``(K, A)``."""
    middle = np.zeros(len(path.mach), bool)
    middle[NODES_PER_BIN // 2 :: NODES_PER_BIN] = True
    inside = path.inside(regime) & middle
    coordinate = path.coordinate(regime)[inside]
    knots = np.log(nodes) if regime == "mach" else np.log10(nodes)
    nearest = [
        np.argmin(np.abs(np.subtract.outer(v, k)), axis=1)
        for v, k in ((coordinate, knots), (path.alpha_total[inside], alpha))
    ]
    out = np.zeros((len(nodes), len(alpha)), np.int64)
    np.add.at(out, tuple(nearest), 1)
    return out
