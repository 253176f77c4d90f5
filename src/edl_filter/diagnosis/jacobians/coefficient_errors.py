"""Errors of the aerodynamic coefficients along a path: their size, their loads, and the modes that a flight resolves.

Three kinds: the numerical error of a prediction, the discrepancy of the database, and the asymmetry of the vehicle
(`aero.discrepancy`).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from edl_filter.aero.database import Database
from edl_filter.aero.discrepancy import ASYMMETRIES, FIELD_COEFFICIENTS, AngleModes, DiscrepancyPrior
from edl_filter.aero.grid import GridTable
from edl_filter.diagnosis.jacobians.nuisance import StatedUncertainty
from edl_filter.diagnosis.prediction.dead_reckoning import NODES_PER_BIN
from edl_filter.diagnosis.prediction.predicted_readings import predict_increment
from edl_filter.diagnosis.prediction.residuals import ModelInputs, Residuals
from edl_filter.diagnosis.prediction.time_bins import TimeBins, bin_sigma
from edl_filter.effects.perturbation import CoefficientUnits, FieldPerturbation, Perturbation
from edl_filter.types import Array


def numerical_error_units(residuals: Residuals, uncertainty: StatedUncertainty) -> CoefficientUnits:
    """One sigma of the numerical error of the coefficients at the nodes."""
    flow, tables, relative = residuals.flow, residuals.tables, uncertainty.numerical
    return CoefficientUnits(
        flow.time, ca=relative * tables.ca, cn=relative * tables.cn, cm=relative * np.abs(tables.cm_nose)
    )


def database_units(inputs: ModelInputs, residuals: Residuals, prior: DiscrepancyPrior) -> CoefficientUnits:
    """One sigma of the database's discrepancy at the nodes."""
    flow = residuals.flow
    places = flow.mach, flow.knudsen, flow.alpha_total, flow.speed
    return CoefficientUnits(flow.time, **discrepancy_sigma(inputs.forward_model.database, prior, *places))


def asymmetry_units(inputs: ModelInputs, residuals: Residuals, prior: DiscrepancyPrior) -> CoefficientUnits | None:
    """One sigma of the coefficients that are fixed to the body at the nodes; None where there are none."""
    if prior.asymmetry == 0.0:
        return None
    flow = residuals.flow
    limits = inputs.forward_model.database.lookup(flow.mach, flow.knudsen, flow.alpha_total, flow.speed).three_sigma
    sigma = {name: prior.asymmetry / 3.0 * getattr(limits, name) for name in FIELD_COEFFICIENTS}
    return CoefficientUnits(flow.time, **sigma)


def discrepancy_sigma(
    database: Database, prior: DiscrepancyPrior, mach: Array, knudsen: Array, alpha: Array, speed: Array
) -> dict[str, Array]:
    """One sigma of the database's discrepancy: a third of its three sigma, less what increments of a flight say.

    Parameters
    ----------
    database : Database
        With or without increments, whose own covariance holds where they apply.
    prior : DiscrepancyPrior
        Scale of the sigmas.
    mach, knudsen, alpha, speed : (N,) arrays
        Points of the flow; rad, m/s.

    Returns
    -------
    dict of str to (N,) array
        By coefficient: ``ca``, ``cn``, ``cm``.
    """
    limits = database.lookup(mach, knudsen, alpha, speed).three_sigma
    third = np.full(len(mach), prior.scale / 3.0)
    if database.increments is not None:
        third = third * np.sqrt(database.increments.remainder(mach, knudsen, alpha, database.continuum_limit))
    return {name: third * getattr(limits, name) for name in FIELD_COEFFICIENTS}


def interpolated_angles(table: object) -> Array:
    """Angles between which a table is linear ``(A,)``, rad; empty for smooth tables."""
    return table.alpha if isinstance(table, GridTable) and table.interpolation == "linear" else np.zeros(0)


def coefficient_loads(
    inputs: ModelInputs, residuals: Residuals, name: str, units: CoefficientUnits
) -> tuple[Array, Array]:
    """Change of force (N) and moment (N m) at the nodes ``(M, 3)`` by one unit of a coefficient.

    Parameters
    ----------
    inputs : ModelInputs
        The model, and the readings corrected by its sensor effects.
    residuals : Residuals
        With the flow along the path.
    name : str
        ``ca``, ``cn`` or ``cm``.
    units : CoefficientUnits
        The units.
    """
    zero = Perturbation.zero(units)
    return _load_change(inputs, residuals, zero, zero.with_unit(name))


def _load_change(
    inputs: ModelInputs, residuals: Residuals, before: Perturbation, after: Perturbation
) -> tuple[Array, Array]:
    """Change of force (N) and moment (N m) at the nodes ``(M, 3)`` from one perturbation to another one.

    Effects act on the tables before a perturbation is added; the loads are linear in the sum.
    """
    model, flow, tables = inputs.forward_model, residuals.flow, residuals.tables
    nominal, changed = (replace(model, perturbation=p).loads(flow, tables) for p in (before, after))
    return changed[0] - nominal[0], changed[1] - nominal[1]


def field_loads(inputs: ModelInputs, residuals: Residuals, name: str, field: FieldPerturbation) -> tuple[Array, Array]:
    """Change of force (N) and moment (N m) at the nodes ``(M, 3)`` by one sigma of a coefficient or of an asymmetry.

    Parameters
    ----------
    inputs : ModelInputs
        The model, and the readings corrected by its sensor effects.
    residuals : Residuals
        With the flow along the path.
    name : str
        Of a coefficient or an asymmetry that the field has.
    field : FieldPerturbation
        Modes and one sigma of the database's discrepancy.
    """
    if name not in ASYMMETRIES:
        return coefficient_loads(inputs, residuals, name, field.units)
    nothing = FieldPerturbation.zero(field.modes, field.units, field.asymmetry, field.continuum_limit)
    unit = replace(nothing, amplitudes=nothing.amplitudes | {name: np.ones((1, 1))})
    zero = Perturbation.zero(field.units)
    return _load_change(inputs, residuals, zero, replace(zero, field=unit))


def field_modes(
    inputs: ModelInputs, bins: TimeBins, residuals: Residuals, prior: DiscrepancyPrior, units: CoefficientUnits
) -> dict[str, AngleModes]:
    """Modes of the database's discrepancy that a flight resolves.

    Parameters
    ----------
    inputs : ModelInputs
        The model, and the readings corrected by its sensor effects.
    bins : TimeBins
        Time bins of the comparison.
    residuals : Residuals
        With the flow along the path.
    prior : DiscrepancyPrior
        Of the discrepancy.
    units : CoefficientUnits
        One sigma of the database.
    """
    driving = inputs.driving
    sigma_f = bin_sigma(bins, driving.time, driving.interval, driving.force_noise)
    sigma_w = np.sqrt(2.0) * bin_sigma(bins, driving.time, driving.interval, driving.rate_noise)[:-1]
    angle, modes, database = residuals.flow.alpha_total, {}, inputs.forward_model.database
    table_angles = interpolated_angles(database.continuum), interpolated_angles(database.rarefied)
    for name in FIELD_COEFFICIENTS:
        force, rate_step = predict_increment(
            inputs.forward_model, bins, *coefficient_loads(inputs, residuals, name, units)
        )
        information = np.sum(force**2, axis=1) / sigma_f**2
        # a step is compared where both of its bins are (`bin_rows`)
        information[:-1] += np.where(bins.valid[1:], np.sum(rate_step**2, axis=1) / sigma_w**2, 0.0)
        information = np.where(bins.valid & np.isfinite(information), information, 0.0) / NODES_PER_BIN
        modes[name] = prior.angle_modes(name, angle[:-1], np.repeat(information, NODES_PER_BIN), table_angles)
    return modes
