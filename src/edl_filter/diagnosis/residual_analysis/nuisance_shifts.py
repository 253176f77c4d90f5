"""Nuisance parameters that the flight moves away from what the mission states.

A model may hold because a parameter that the mission states as uncertain has moved: the air is denser, the vehicle
lighter, the database's normal force larger. Such a shift is no missing effect, but the reader has to see it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from edl_filter.aero.discrepancy import ASYMMETRIES
from edl_filter.aero.increments import SYMBOLS, DatabaseUpdate
from edl_filter.diagnosis.linear_model.linear_model import LinearizedModel
from edl_filter.estimation.smoothing import smoothed_states

#: Sigmas of what the mission states from which a shift is reported.
REPORTED_SIGMAS = 2.0
#: Nuisance parameters with a stated sigma and their units.
_UNITS = {"density": "", "wind_east": "m/s", "wind_north": "m/s", "mass": "", "inertia": ""}
#: What each coefficient of the asymmetry is called.
_ASYMMETRY_SYMBOLS = dict(zip(ASYMMETRIES, ("CY", "CN", "Cm", "Cn"), strict=True))


@dataclass(frozen=True)
class NuisanceShift:
    """Posterior mean of a nuisance parameter, as a difference from what the mission states.

    Attributes
    ----------
    name : str
        ``density``, ``wind_east``, ``mass`` and so on; label and parameter of a constant one, such as ``com_offset
        dy``; ``database CA`` and so on for the database; ``asymmetry Cm`` and so on for what is fixed to the body.
    sigmas : float
        Over the stated sigma; where it varies during the flight, the largest.
    value : float
        In the unit; relative where that is empty.
    unit : str
    """

    name: str
    sigmas: float
    value: float
    unit: str


def nuisance_shifts(model: LinearizedModel, update: DatabaseUpdate | None) -> tuple[NuisanceShift, ...]:
    """Nuisance parameters farther than `REPORTED_SIGMAS` from what the mission states, farthest first.

    Parameters
    ----------
    model : LinearizedModel
        The linearised model.
    update : DatabaseUpdate or None
        Estimated increments of the database.
    """
    whiten, nuisance = model.fitted_noise_filter, model.nuisance
    initial, states = smoothed_states(whiten, model.white_residuals(whiten), model.initial_mean)
    used, steps = model.index.step_of_bins(whiten.model.row_start)
    shifts = []
    for name, unit in _UNITS.items():
        if name in nuisance and len(steps):
            values = states[steps, nuisance[name].start]
            sigmas = float(values[np.argmax(np.abs(values))])
            value = sigmas * model.case.uncertainty.sigma[name]
            # without a unit: perturbations of a logarithm
            shifts.append(NuisanceShift(name, sigmas, value if unit else float(np.expm1(value)), unit))
    place = nuisance.size
    for stated in model.case.constants:
        units = {p.name: p.unit for p in stated.instance.effect.parameters}
        for name, sigma in stated.sigma.items():
            value = float(initial[place])
            shifts.append(NuisanceShift(f"{stated.instance.label} {name}", value / sigma, value, units[name]))
            place += 1
    for name, symbol in _ASYMMETRY_SYMBOLS.items():
        if name in nuisance.fields and len(steps):
            assert model.field is not None and model.field.asymmetry is not None
            values = states[steps, nuisance.fields[name].start]
            k = int(np.argmax(np.abs(values)))
            sigma = model.field.asymmetry.at(ASYMMETRIES[name], model.bins.edges[1:][used[[k]]])[0]
            shifts.append(NuisanceShift(f"asymmetry {symbol}", float(values[k]), float(values[k] * sigma), ""))
    for largest in () if update is None else update.largest():
        shifts.append(NuisanceShift(f"database {SYMBOLS[largest.coefficient]}", largest.sigmas, largest.increment, ""))
    moved = [s for s in shifts if abs(s.sigmas) > REPORTED_SIGMAS]
    return tuple(sorted(moved, key=lambda s: -abs(s.sigmas)))
