"""Join pieces of telemetry end to end into one record, and bridge what is missing between samples."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from edl_filter.errors import InputError
from edl_filter.telemetry.record import ImuRecord, SensorErrors

Array = NDArray[np.float64]
GAP = "gap"  # the source of samples that bridge a gap


@dataclass(frozen=True)
class Piece:
    """Samples from one product and one instrument, body axes; arrays as in `ImuRecord`.

    `net_turn` and `net_gain` hold for the whole piece.
    """

    source: str
    unit: str
    time: Array
    interval: Array
    force: Array
    rate: Array
    position: Array
    force_noise: Array
    rate_noise: Array
    shared_rate_noise: Array
    net_turn: bool = False
    net_gain: bool = False

    @property
    def start(self) -> float:
        """Beginning of the first interval, s."""
        return float(self.time[0] - self.interval[0])

    def between(self, start: float, end: float) -> Piece:
        """Samples within ``[start, end]``."""
        keep = (self.time - self.interval >= start - 1e-6) & (self.time <= end + 1e-6)
        return self._take(np.flatnonzero(keep))

    def _take(self, index: NDArray[np.int64]) -> Piece:
        arrays = {f.name: getattr(self, f.name) for f in fields(self)}
        taken: dict[str, Any] = {n: v[index] for n, v in arrays.items() if isinstance(v, np.ndarray)}
        return replace(self, **taken)


def fill_gaps(piece: Piece) -> list[Piece]:
    """Cut a piece at its gaps and bridge each with samples interpolated between its two sides.

    How much force and rate change over half a gap's length around it is one sigma of the bridge as a whole; a
    single one of its n samples has √n times that, so that their sum comes to it.
    """
    missing = piece.time[1:] - piece.interval[1:] - piece.time[:-1]
    cuts = np.flatnonzero(missing > 1e-6)
    edges = [0, *(cuts + 1), len(piece.time)]
    pieces: list[Piece] = []
    for first, last in pairwise(edges):
        if first:
            pieces.append(_bridge(piece, first - 1))
        pieces.append(piece._take(np.arange(first, last)))
    return pieces


def _bridge(piece: Piece, before: int) -> Piece:
    """Samples between `before` and the one after it."""
    start, stop = piece.time[before], piece.time[before + 1] - piece.interval[before + 1]
    count = max(1, round((stop - start) / piece.interval[before]))
    step = (stop - start) / count
    time = start + step * np.arange(1, count + 1)
    share = ((time - 0.5 * step - start) / (stop - start))[:, None]

    def between(values: Array) -> Array:
        return (1.0 - share) * values[before] + share * values[before + 1]

    def unknown(values: Array) -> Array:
        lag = max(1, count // 2)
        near = values[max(0, before - 80) : before + 80]
        change = np.sqrt(np.mean((near[lag:] - near[:-lag]) ** 2))
        return np.full(count, change * np.sqrt(count))

    return Piece(
        source=GAP,
        unit=piece.unit,
        time=time,
        interval=np.full(count, step),
        force=between(piece.force),
        rate=between(piece.rate),
        position=np.repeat(piece.position[before : before + 1], count, axis=0),
        force_noise=unknown(piece.force),
        rate_noise=unknown(piece.rate),
        shared_rate_noise=np.zeros(count),
    )


def join(name: str, pieces: Sequence[Piece], units: tuple[str, ...], errors: tuple[SensorErrors, ...]) -> ImuRecord:
    """One record from pieces that adjoin in time.

    Raises
    ------
    InputError
        Two pieces overlap or leave time between them.
    """
    for a, b in pairwise(pieces):
        if abs(b.start - a.time[-1]) > 1e-6:
            raise InputError(
                f"telemetry: {a.source} of the {a.unit} ends at {a.time[-1]:.4f} s and {b.source} of the {b.unit} "
                f"begins at {b.start:.4f} s; they must adjoin."
            )
    sources = tuple(dict.fromkeys(p.source for p in pieces))

    def stack(key: str) -> Array:
        return np.concatenate([getattr(p, key) for p in pieces])

    def repeated(values: list[Any], kind: type) -> NDArray[Any]:
        return np.concatenate([np.full(len(p.time), v, kind) for p, v in zip(pieces, values, strict=True)])

    time = stack("time")
    return ImuRecord(
        name=name,
        time=time,
        interval=np.diff(time, prepend=pieces[0].start),
        specific_force=stack("force"),
        angular_rate=stack("rate"),
        position=stack("position"),
        force_noise=stack("force_noise"),
        rate_noise=stack("rate_noise"),
        shared_rate_noise=stack("shared_rate_noise"),
        net_turn=repeated([p.net_turn for p in pieces], np.bool_),
        net_gain=repeated([p.net_gain for p in pieces], np.bool_),
        unit=repeated([units.index(p.unit) for p in pieces], np.int64),
        units=units,
        source=repeated([sources.index(p.source) for p in pieces], np.int64),
        sources=sources,
        errors=errors,
    )
