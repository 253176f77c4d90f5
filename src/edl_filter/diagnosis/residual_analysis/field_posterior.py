"""Posterior of a database's discrepancy at knots over the flow, by the whitening filter of a flight.

The amplitudes of the field's modes are states of the linear model, Matérn processes of order 3/2 along the flow. The
covariance of every measurement with an amplitude at any place along the flow is therefore known: with Δ the distance
between the two, in correlation lengths,

    cov(y_r, a_j(k)) = H_r (ρ(Δ), ρ'(Δ), ρ''(Δ)),

H_r the row's derivatives with respect to the amplitude and its derivatives. Whitened, W = L⁻¹ cov(y, a), they give the
posterior of Gaussian process regression (Rasmussen and Williams, Gaussian Processes for Machine Learning, 2006, eq.
2.25) without forming the covariance of all measurements: mean Wᵀe with the white residuals e, and covariance of the
prior less WᵀW. Rows of a regime whose table errs independently are so far away that they do not count.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from edl_filter.diagnosis.jacobians.nuisance import FIELD_STATES
from edl_filter.diagnosis.linear_model.linear_model import LinearizedModel
from edl_filter.diagnosis.prediction.dead_reckoning import NODES_PER_BIN
from edl_filter.estimation.matern import matern32_correlation
from edl_filter.types import Array, BoolArray


def amplitude_covariance(design: Array, values: slice, row_distance: Array, knot_distance: Array) -> Array:
    """Prior covariance of all rows with the amplitudes of a field's modes at knots.

    Parameters
    ----------
    design : (R, n) array
        Of the state-space model.
    values : slice
        Places of the J amplitudes; those of their derivatives follow (`jacobians.nuisance.NuisanceLayout.fields`).
    row_distance, knot_distance : (R,), (K,) arrays
        Distances along the flow, in correlation lengths.

    Returns
    -------
    (R, K, J) array
    """
    count = values.stop - values.start
    columns = design[:, values.start : values.start + FIELD_STATES * count].reshape(len(design), FIELD_STATES, count)
    correlation = matern32_correlation(np.subtract.outer(row_distance, knot_distance))
    return np.asarray(np.einsum("rkd,rdj->rkj", correlation, columns))


@dataclass(frozen=True)
class FlownPath:
    """Where a flight has been in the flow, at the nodes of its bins.

    Attributes
    ----------
    distance : (M,) array
        Along the flow, in correlation lengths, as the state-space model has it.
    row_distance : (R,) array
        Of each row.
    mach, knudsen, speed, alpha_total : (M,) arrays
        Speed in m/s, angle in rad.
    rarefied : (M,) array of bool
        Whether the rarefied table applies.
    compared : (M,) array of bool
        Whether prediction and measurement are compared there.
    """

    distance: Array
    row_distance: Array
    mach: Array
    knudsen: Array
    speed: Array
    alpha_total: Array
    rarefied: BoolArray
    compared: BoolArray

    @classmethod
    def of(cls, model: LinearizedModel) -> FlownPath:
        """The path of a flight."""
        flow, database = model.residuals.flow, model.inputs.forward_model.database
        steps = model.case.uncertainty.discrepancy.flow_distance(
            flow.mach, flow.knudsen, database.continuum_limit, database.join == "switch"
        )
        distance = np.concatenate(([0.0], np.cumsum(steps)))
        used = np.repeat(np.any(model.index.bin_rows[:, :6] >= 0, axis=1), NODES_PER_BIN)
        return cls(
            distance=distance,
            row_distance=np.interp(model.index.time, model.residuals.nodes.time, distance),
            mach=flow.mach,
            knudsen=flow.knudsen,
            speed=flow.speed,
            alpha_total=flow.alpha_total,
            rarefied=flow.knudsen > database.continuum_limit,
            compared=np.append(used, False),
        )

    def inside(self, regime: str) -> BoolArray:
        """Nodes ``(M,)`` that are compared in a regime."""
        return self.compared & (self.rarefied == (regime == "knudsen"))

    def coordinate(self, regime: str) -> Array:
        """Logarithm of the Mach number, or decimal logarithm of the Knudsen number, at the nodes ``(M,)``."""
        return np.log(self.mach) if regime == "mach" else np.log10(self.knudsen)

    def flown_range(self, regime: str) -> tuple[float, float] | None:
        """Smallest and largest coordinate in a regime; None where the flight does not pass through it."""
        inside = self.inside(regime)
        if np.count_nonzero(inside) < 2:
            return None
        coordinate = self.coordinate(regime)[inside]
        return float(np.min(coordinate)), float(np.max(coordinate))

    def distance_at(self, regime: str, coordinate: Array) -> Array:
        """Distance along the flow at coordinates of a regime within the flown range.

        Where the flight passes the same number several times, as it does while the sound speed changes more than the
        speed, it is the last passage, in the densest air.

        Parameters
        ----------
        regime : str
            ``mach`` or ``knudsen``.
        coordinate : (K,) array
            As of `coordinate`.

        Returns
        -------
        (K,) array
        """
        inside = self.inside(regime)
        flown, distance = self.coordinate(regime)[inside], self.distance[inside]
        value = np.clip(coordinate, flown.min(), flown.max())[:, None]
        begin, end = flown[:-1], flown[1:]
        passes = (np.minimum(begin, end) <= value) & (value <= np.maximum(begin, end))
        last = len(begin) - 1 - np.argmax(passes[:, ::-1], axis=1)
        change = end[last] - begin[last]
        share = np.where(change == 0.0, 1.0, (value[:, 0] - begin[last]) / np.where(change == 0.0, 1.0, change))
        return np.asarray(distance[last] + share * (distance[last + 1] - distance[last]), float)

    def at_distance(self, distance: Array) -> tuple[Array, Array, Array]:
        """Mach number, Knudsen number and speed (m/s) at distances along the flow ``(K,)``, ``(K,)`` each."""
        mach, knudsen = (np.exp(np.interp(distance, self.distance, np.log(v))) for v in (self.mach, self.knudsen))
        return mach, knudsen, np.interp(distance, self.distance, self.speed)


def knot_coordinates(low: float, high: float, length: float, spacing: float) -> Array:
    """Equidistant coordinates of knots, two or more.

    Parameters
    ----------
    low, high : float
        First and last coordinate.
    length : float
        Correlation length, in the unit of the coordinate.
    spacing : float
        Largest distance of two knots, in correlation lengths.

    Returns
    -------
    (K,) array
        In the unit of the coordinate.
    """
    return np.linspace(low, high, max(int(np.ceil((high - low) / (spacing * length))), 1) + 1)
