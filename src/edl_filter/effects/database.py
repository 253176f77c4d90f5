"""The aerodynamic database with the catalogue's effects in CA, CN and Cm, for look-up and inverse look-up.

Built-in effects in the coefficients depend on Mach number and total angle, as the database does. A user's effect may
depend on anything along the flight, which a database does not know: it acts in predictions only, as do rolling moment,
damping and further torques.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike, NDArray

from edl_filter.aero.database import Database
from edl_filter.aero.grid import Array, Weights
from edl_filter.aero.transition import Sum
from edl_filter.effects.again import among
from edl_filter.effects.catalogue import catalogue
from edl_filter.effects.effect import Active, Flow, Totals

#: Weights that leave one coefficient of CA, CN and Cm.
_SINGLE: tuple[Weights, ...] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


@dataclass(frozen=True, eq=False)
class ChangedSum(Sum):
    """Curves over the angle of N samples with effects in them.

    Attributes
    ----------
    mach : (N,) array
        The flight's own.
    effects : tuple of Active
    """

    mach: Array
    effects: tuple[Active, ...]

    def evaluate(self, alpha: Array) -> Array:
        """(3, N) CA, CN, Cm_nose, each curve at its own angle."""
        return self._changed(super().evaluate(alpha), self.mach, alpha)

    def rows(self, alpha: Array, weights: Weights) -> Array:
        """(N, G) weighted sum of the coefficients at common angles (G,)."""
        single = [super(ChangedSum, self).rows(alpha, one) for one in _SINGLE]
        shape = single[0].shape
        mach, angle = np.broadcast_to(self.mach[:, None], shape), np.broadcast_to(alpha, shape)
        changed = self._changed(np.stack([s.ravel() for s in single]), mach.ravel(), angle.ravel())
        return np.tensordot(np.asarray(weights, float), changed, 1).reshape(shape)

    def take(self, index: NDArray[np.intp]) -> ChangedSum:
        """The curves of some of the samples."""
        return ChangedSum(super().take(index).terms, self.mach[index], self.effects)

    def _changed(self, coefficients: Array, mach: Array, alpha: Array) -> Array:
        unknown, none = np.full(len(mach), np.nan), np.zeros(len(mach))
        vectors = np.full((len(mach), 3), np.nan)
        flow = Flow(
            unknown, unknown, vectors, vectors, unknown, unknown, mach, unknown, unknown, alpha_total=np.abs(alpha)
        )
        ca, cn, cm = coefficients
        totals = Totals(ca, cn, cm, none, none)
        for a in self.effects:
            totals = a.effect.coefficients(a.values, flow, totals)
        return np.stack((totals.ca, totals.cn, totals.cm_nose))


@dataclass(frozen=True, eq=False)
class ChangedDatabase(Database):
    """A database with effects in its coefficients.

    Attributes
    ----------
    effects : tuple of Active
    """

    effects: tuple[Active, ...] = ()

    def at(self, mach: ArrayLike, knudsen: ArrayLike, speed: ArrayLike | None = None) -> Sum:
        """The curves over the angle of N samples; arguments (N,)."""
        flight_mach = np.broadcast_arrays(np.asarray(mach, float), np.asarray(knudsen, float))[0]
        return ChangedSum(super().at(mach, knudsen, speed).terms, flight_mach, self.effects)


def changed_database(database: Database, effects: Sequence[Active]) -> Database:
    """`database` with the effects that act on CA, CN or Cm; itself where none does."""
    known = catalogue()
    acting = tuple(a for a in effects if a.effect.acts("coefficients") and a.effect is among(known, a.name))
    if not acting:
        return database
    return ChangedDatabase(**{f.name: getattr(database, f.name) for f in fields(Database)}, effects=acting)
