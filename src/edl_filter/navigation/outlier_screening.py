"""Screening of the readings of instruments that are read many times, before the gate.

The gate compares one reading with the state. The next readings are examined together (`consensus`) where this is not
enough: where a reading would determine the state by itself, since its prediction is less certain than it is; where it
fails the gate; and where the sum of the NIS of the last `WINDOW` readings fails the gate's quantile.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import fsum

import numpy as np

from edl_filter.estimation.small_matrices import solve_few
from edl_filter.navigation.consensus import LEAST_READINGS, WINDOW, find_consensus, predict_jointly, quantile
from edl_filter.navigation.constraints import Constraint
from edl_filter.navigation.estimator import ErrorStateFilter, Innovation
from edl_filter.navigation.increments import Samples


@dataclass(frozen=True)
class Divergence:
    """Readings that agree with each other contradict the state: the state is the outlier.

    Attributes
    ----------
    time : float
        Of the first of these readings, s.
    names : tuple of str
        Of the constraints.
    readings : int
        That agree, of those that were examined together.
    nis, free_nis : float
        Normalised squares of their innovations: from the state, and with position and velocity unknown.
    directions : int
        Directions of the state that they determine: degrees of freedom of ``nis - free_nis``.
    """

    time: float
    names: tuple[str, ...]
    readings: int
    nis: float
    free_nis: float
    directions: int


class Screening:
    """Screening during one run of the filter.

    Parameters
    ----------
    samples : Samples
        Of the driving instrument, with edges at the constraints' times.
    constraints : sequence of Constraint
        Of the flight.
    gate : float
        Probability with which a good reading is within its gate; 1: nothing is screened.
    copy : callable
        Makes another filter with the state and covariance of the given one.
    outliers : sequence of Constraint
        Readings that are known to contradict the others.
    """

    def __init__(
        self,
        samples: Samples,
        constraints: Sequence[Constraint],
        gate: float,
        copy: Callable[[ErrorStateFilter], ErrorStateFilter],
        outliers: Sequence[Constraint] = (),
    ) -> None:
        self.divergence: Divergence | None = None
        self._samples, self._gate, self._copy = samples, gate, copy
        counts = Counter(c.name for c in constraints) if gate < 1.0 else Counter()
        self._last_nis = {name: deque[float](maxlen=WINDOW) for name, n in counts.items() if n >= LEAST_READINGS}
        self._examined: dict[str, float] = {}  # name → time of the last reading that was examined
        self._outliers = {(c.name, c.time) for c in outliers}

    def is_outlier(
        self,
        estimator: ErrorStateFilter,
        innovation: Innovation,
        reading: Constraint,
        following: Sequence[Constraint],
    ) -> bool:
        """Whether a reading contradicts the majority of its instrument's next readings.

        Parameters
        ----------
        estimator : ErrorStateFilter
            At the reading's time; it stays as it is.
        innovation : Innovation
            Of the reading.
        reading : Constraint
            The reading.
        following : sequence of Constraint
            All later ones, in the order of time.
        """
        name = reading.name
        if name not in self._last_nis:
            return False
        if reading.time > self._examined.get(name, -np.inf) and self._doubtful(innovation, name):
            self._examine(estimator, reading, following)
        if (name, reading.time) in self._outliers:
            return True
        self._last_nis[name].append(innovation.nis)
        return False

    def _doubtful(self, innovation: Innovation, name: str) -> bool:
        """Whether a reading must be examined together with those that follow."""
        dof, last = len(innovation.residual), self._last_nis[name]
        relative = np.trace(solve_few(innovation.noise_covariance, innovation.predicted_covariance))
        return bool(
            relative > dof
            or innovation.nis > quantile(self._gate, dof)
            or (len(last) == WINDOW and fsum(last) > quantile(self._gate, WINDOW * dof))
        )

    def _examine(self, estimator: ErrorStateFilter, reading: Constraint, following: Sequence[Constraint]) -> None:
        """Examine a reading and those that follow from the same driving instrument; arguments as of `is_outlier`."""
        first = self._samples.index(reading.time)
        samples = self._samples.part(first, len(self._samples.time))
        end = samples.unit_changes.min(initial=np.inf)
        readings = [reading, *(c for c in following if c.name == reading.name and c.time <= end)][:WINDOW]
        if len(readings) < LEAST_READINGS:
            return
        prediction = predict_jointly(self._copy(estimator), samples, readings)
        consensus = find_consensus(prediction, self._gate)
        self._examined[reading.name] = readings[-1].time
        self._last_nis[reading.name].clear()
        if not consensus.majority:
            return
        agree = consensus.agree
        self._outliers |= {(c.name, c.time) for c, member in zip(readings, agree, strict=True) if not member}
        if consensus.state_outlier and self.divergence is None:
            self.divergence = Divergence(
                time=reading.time,
                names=(reading.name,),
                readings=int(agree.sum()),
                nis=consensus.nis,
                free_nis=consensus.free_nis,
                directions=consensus.directions,
            )
