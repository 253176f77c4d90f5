"""Segments of telemetry: fill the gaps within a segment, and join segments in time into one record.

Input: segments, each with the samples of one product and one instrument. Method: a gap is filled with samples that are
linearly interpolated between the two samples around it (`fill_gaps`); segments must adjoin (`join`). Output: an
`ImuRecord`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from edl_filter.errors import InputError
from edl_filter.imu_model.sensor_errors import SensorErrors
from edl_filter.telemetry.record import SAME_TIME, ImuRecord, within_window
from edl_filter.types import Array, IntArray

#: Source of the samples that fill a gap.
GAP = "gap"


@dataclass(frozen=True)
class Segment:
    """Samples from one product and one instrument, in body axes; see `ImuRecord` for arrays and units.

    Attributes
    ----------
    source, unit : str
        Product and instrument.
    time, interval : (N,) arrays
        s.
    force, rate : (N, 3) arrays
        Specific force and angular rate, m/s² and rad/s.
    position : (N, 3) array
        m.
    force_noise, rate_noise, shared_rate_noise : (N,) arrays
        m/s², rad/s, rad/s.
    coning_corrected, sculling_corrected : bool
        Valid for all samples of the segment.
    partial_force, partial_rate : (N, 2, 3) arrays, optional
        What a triad reads of which one axis is lost.
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
    coning_corrected: bool = False
    sculling_corrected: bool = False
    partial_force: Array = field(default_factory=lambda: np.zeros((0, 2, 3)))
    partial_rate: Array = field(default_factory=lambda: np.zeros((0, 2, 3)))

    def __post_init__(self) -> None:
        for key in ("partial_force", "partial_rate"):
            if not len(getattr(self, key)):
                object.__setattr__(self, key, np.zeros((len(self.time), 2, 3)))

    @property
    def start(self) -> float:
        """Start of the first interval, s."""
        return float(self.time[0] - self.interval[0])

    def between(self, start: float, end: float) -> Segment:
        """Samples whose interval lies within `start` to `end`, s (`within_window`)."""
        return self._take(np.flatnonzero(within_window(self.time, self.interval, start, end)))

    def _take(self, index: IntArray) -> Segment:
        """Samples at the indices."""
        attributes = {field.name: getattr(self, field.name) for field in fields(self)}
        arrays: dict[str, Any] = {n: v[index] for n, v in attributes.items() if isinstance(v, np.ndarray)}
        return replace(self, **arrays)


def fill_gaps(segment: Segment) -> list[Segment]:
    """Split a segment at its gaps and fill each gap with linearly interpolated samples.

    One sigma of the mean over a gap is the RMS change of force and rate over half the gap's length, taken from the
    samples around it. Each of its n samples has √n times that, so that their mean has it.

    Returns
    -------
    list of Segment
        In order of time; those that fill a gap have the source `GAP`.
    """
    missing = segment.time[1:] - segment.interval[1:] - segment.time[:-1]
    last_before_gap = np.flatnonzero(missing > SAME_TIME)
    edges = [0, *(last_before_gap + 1), len(segment.time)]
    segments: list[Segment] = []
    for first, end in pairwise(edges):
        if first:
            segments.append(_filled_gap(segment, first - 1))
        segments.append(segment._take(np.arange(first, end)))
    return segments


def _filled_gap(segment: Segment, before: int) -> Segment:
    """Samples of the gap between the sample `before` and the next one."""
    start, end = segment.time[before], segment.time[before + 1] - segment.interval[before + 1]
    count = max(1, round((end - start) / segment.interval[before]))
    step = (end - start) / count
    time = start + step * np.arange(1, count + 1)
    fraction = ((time - 0.5 * step - start) / (end - start))[:, None]

    def interpolated(values: Array) -> Array:
        return (1.0 - fraction) * values[before] + fraction * values[before + 1]

    def noise(values: Array) -> Array:
        lag = max(1, count // 2)
        nearby = values[max(0, before - 80) : before + 80]
        change = np.sqrt(np.nanmean((nearby[lag:] - nearby[:-lag]) ** 2))
        return np.full(count, change * np.sqrt(count))

    return Segment(
        source=GAP,
        unit=segment.unit,
        time=time,
        interval=np.full(count, step),
        force=interpolated(segment.force),
        rate=interpolated(segment.rate),
        position=np.repeat(segment.position[before : before + 1], count, axis=0),
        force_noise=noise(segment.force),
        rate_noise=noise(segment.rate),
        shared_rate_noise=np.zeros(count),
    )


def interpolated_between(before: Segment, after: Segment) -> list[Segment]:
    """Segment of one sample between two segments that do not adjoin, by linear interpolation; none if they do.

    One sigma of its force and rate is the largest difference of the samples on both sides. Unit and position are those
    of the later segment.
    """
    start, end = float(before.time[-1]), after.start
    if end - start <= SAME_TIME:
        return []
    weight = 0.5 * np.array([before.interval[-1] + end - start, after.interval[0] + end - start])
    weight = weight[::-1] / weight.sum()
    sides = [(before.force[-1], after.force[0]), (before.rate[-1], after.rate[0])]
    force, rate = (weight[0] * first + weight[1] * second for first, second in sides)
    noise = [np.array([np.max(np.abs(second - first))]) for first, second in sides]
    sample = replace(
        after._take(np.arange(1)),
        source=GAP,
        time=np.array([end]),
        interval=np.array([end - start]),
        force=force[None],
        rate=rate[None],
        force_noise=noise[0],
        rate_noise=noise[1],
        shared_rate_noise=np.zeros(1),
        coning_corrected=True,
        partial_force=np.zeros((1, 2, 3)),
        partial_rate=np.zeros((1, 2, 3)),
    )
    return [sample]


def join(name: str, segments: Sequence[Segment], units: tuple[str, ...], errors: tuple[SensorErrors, ...]) -> ImuRecord:
    """Join segments that adjoin in time into one record.

    Parameters
    ----------
    name : str
        Name of the record.
    segments : sequence of Segment
        In order of time.
    units : tuple of str
        Instruments; every segment's is one of them.
    errors : tuple of SensorErrors
        One entry for each of `units`.

    Returns
    -------
    ImuRecord

    Raises
    ------
    InputError
        Two segments overlap or leave time between them.
    """
    for first, second in pairwise(segments):
        if abs(second.start - first.time[-1]) > SAME_TIME:
            raise InputError(
                f"telemetry: {first.source} of the {first.unit} ends at {first.time[-1]:.4f} s and {second.source} of "
                f"the {second.unit} begins at {second.start:.4f} s; they must adjoin."
            )
    sources = tuple(dict.fromkeys(segment.source for segment in segments))

    def stack(key: str) -> Array:
        return np.concatenate([getattr(segment, key) for segment in segments])

    def repeated(values: list[Any], kind: type) -> NDArray[Any]:
        return np.concatenate([np.full(len(s.time), value, kind) for s, value in zip(segments, values, strict=True)])

    time = stack("time")
    return ImuRecord(
        name=name,
        time=time,
        interval=np.diff(time, prepend=segments[0].start),
        specific_force=stack("force"),
        angular_rate=stack("rate"),
        position=stack("position"),
        force_noise=stack("force_noise"),
        rate_noise=stack("rate_noise"),
        shared_rate_noise=stack("shared_rate_noise"),
        coning_corrected=repeated([segment.coning_corrected for segment in segments], np.bool_),
        sculling_corrected=repeated([segment.sculling_corrected for segment in segments], np.bool_),
        unit=repeated([units.index(segment.unit) for segment in segments], np.int64),
        units=units,
        source=repeated([sources.index(segment.source) for segment in segments], np.int64),
        sources=sources,
        errors=errors,
        partial_force=stack("partial_force"),
        partial_rate=stack("partial_rate"),
    )
