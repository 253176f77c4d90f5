"""Nuisance parameters: all errors that the mission states as possible, as states of one vector.

First comes the filter's own vector (`navigation.layout`): navigation errors and those of the driving IMU. Then follow,
in units of one sigma unless a unit is given:

gyro_noise_before, gyro_noise_after
    Mean gyro noise over the bin that ends and over the next one (rad/s): the same noise rotates the attitude and
    appears in the step of the rate.
checking
    Errors of the checking IMUs, in their own units.
density, wind_east, wind_north
    Relative error of the preflight density and errors of the winds, against altitude. Each is a pair, value and slope:
    a Matérn process of order 3/2, which is continuously differentiable, as air is; a first-order Gauss–Markov process
    of the same correlation length could change by a tenth of its sigma in a hundred metres.
ca, cn, cm
    Numerical errors of the prediction (sampling, interpolation, small angles), pairs of the same kind against time.
mass, inertia
    Relative errors.
fields of ca, cn, cm, and of the asymmetry
    Amplitudes of the modes of the database's discrepancy (`aero.discrepancy`), Matérn processes of order 3/2 against
    the distance along the flow: all values, then all derivatives. None with an exact database; one mode for each
    coefficient of an asymmetry.

An unmodelled acceleration (`noise.unmodelled_acceleration`) is appended to all of them where it is allowed for.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from edl_filter.aero.discrepancy import FIELD_COEFFICIENTS, AngleModes, DiscrepancyPrior
from edl_filter.diagnosis.prediction.time_bins import TimeBins
from edl_filter.imu_model.sensor_errors import SENSOR_STATES
from edl_filter.navigation.layout import Layout, consecutive_slices
from edl_filter.telemetry.record import ImuRecord
from edl_filter.types import Array

#: Nuisance parameters of the air.
AIR = ("density", "wind_east", "wind_north")
#: Nuisance parameters that belong to the linearisation point, with the amplitudes of the discrepancy.
PERTURBED = (*AIR, *FIELD_COEFFICIENTS, "mass", "inertia")
#: Beginning of the names of the checking IMUs' errors.
CHECKING = "checking"
#: States of an amplitude of the database's discrepancy: value and derivative.
FIELD_STATES = 2


@dataclass(frozen=True)
class StatedUncertainty:
    """Uncertainties of the model that the mission states, one sigma.

    Attributes
    ----------
    density : float
        Relative, of the preflight density.
    density_correlation : float
        Correlation length of density and winds, m of altitude.
    wind : float
        Of the wind towards east and towards north, m/s.
    discrepancy : DiscrepancyPrior
        Of the database.
    numerical : float
        Relative error of a prediction from exact tables: sampling, interpolation, small angles.
    numerical_memory : float
        Its correlation time, s.
    mass, inertia : float
        Relative.
    """

    density: float
    density_correlation: float
    wind: float
    discrepancy: DiscrepancyPrior
    numerical: float
    numerical_memory: float
    mass: float
    inertia: float

    @property
    def sigma(self) -> dict[str, float]:
        """One sigma by nuisance parameter: relative or m/s; 1 for numerical errors, which are in their own sigmas."""
        return {
            "density": self.density, "wind_east": self.wind, "wind_north": self.wind,
            "mass": self.mass, "inertia": self.inertia, "ca": 1.0, "cn": 1.0, "cm": 1.0,
        }  # fmt: skip

    def correlation_steps(self, time: Array, altitude: Array) -> dict[str, Array]:
        """Steps in correlation lengths of each process.

        Parameters
        ----------
        time, altitude : (K,) arrays
            Steps of time (s) and altitude (m).

        Returns
        -------
        dict
            Name of the process → ``(K,)`` array, 1.
        """
        air = dict.fromkeys(AIR, np.abs(altitude) / self.density_correlation)
        return air | dict.fromkeys(FIELD_COEFFICIENTS, time / self.numerical_memory)


@dataclass(frozen=True)
class NuisanceLayout:
    """Position of each nuisance parameter in the vector.

    Attributes
    ----------
    layout : Layout
        Of the filter's vector, which comes first.
    slices : dict
        Name → slice, for the others.
    size : int
    fields : dict
        Coefficient or asymmetry → slice of the amplitudes of its discrepancy; the derivatives of all of them follow.
    """

    layout: Layout
    slices: dict[str, slice]
    size: int
    fields: dict[str, slice]

    def __contains__(self, name: str) -> bool:
        return name in self.slices

    def __getitem__(self, name: str) -> slice:
        return self.slices[name]


def nuisance_layout(
    layout: Layout,
    checking: tuple[ImuRecord, ...],
    bins: TimeBins,
    uncertainty: StatedUncertainty,
    modes: dict[str, AngleModes],
) -> NuisanceLayout:
    """Nuisance parameters of a flight: those with a stated sigma above zero.

    Parameters
    ----------
    layout : Layout
        Positions in the filter's vector.
    checking : tuple of ImuRecord
        Readings of the checking IMUs, body axes. Each instrument that is compared in a bin has errors of its own.
    bins : TimeBins
        Time bins of the comparison.
    uncertainty : StatedUncertainty
        Uncertainties that the mission states.
    modes : dict
        Coefficient or asymmetry → modes of its discrepancy; empty with an exact database.
    """
    sizes = {"gyro_noise_before": 3, "gyro_noise_after": 3}
    for i, record in enumerate(checking):
        middle = 0.5 * (bins.edges[1:] + bins.edges[:-1])[bins.valid]
        for unit in np.unique(record.unit[record.index_at(middle)]):
            errors = record.errors[unit]
            sizes |= {checking_state(i, unit, n): 3 for n in SENSOR_STATES if getattr(errors, n) > 0.0}
    processes = ["density"] if uncertainty.density > 0.0 else []
    processes += ["wind_east", "wind_north"] if uncertainty.wind > 0.0 else []
    processes += FIELD_COEFFICIENTS
    sizes |= dict.fromkeys(processes, 2)
    if uncertainty.mass > 0.0:
        sizes["mass"] = 1
    if uncertainty.inertia > 0.0:
        sizes["inertia"] = 1
    slices = consecutive_slices(sizes, layout.size)
    start = layout.size + sum(sizes.values())
    fields = {}
    for name, mode in modes.items():
        fields[name] = slice(start, start + mode.count)
        start += FIELD_STATES * mode.count
    return NuisanceLayout(layout, slices, start, fields)


def checking_state(imu: int, unit: int, error: str) -> str:
    """Name of an error state of one instrument of the i-th checking record."""
    return f"{CHECKING}{imu}.{unit}_{error}"
