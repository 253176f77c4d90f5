"""Bad samples found by comparison of neighbours and of two IMUs, and the repair of all that is lost.

Input: `Telemetry` with NaN where samples are lost. Method: spikes and disagreements of single samples between the IMUs
are found (`bad_triads`) and treated as lost; disagreements that last and that no constant error explains are named
(`disagreements`), and repaired where the IMU at fault is known (`without_samples`); an IMU that ends before the other
one is extended. A lost stretch of the driving record is filled with the readings of another IMU where it has samples
(`transfer`), elsewhere by an autoregression of each axis that is fitted to both sides (`estimation.autoregression`).
Output: `Telemetry` without NaN, its findings, and in each filled sample the sigma by which it may be wrong
(`ImuRecord.force_fill_sigma`).

The errors of a filled stretch are correlated in time. Each of its n samples has the sigma of independent errors whose
sum over the stretch has the right variance: with a common error c and independent errors s, ``√(s² + n c²)``. That of
rates includes the coning of an oscillation whose phase is not known.
Telemetry without findings is returned as it is.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from edl_filter.errors import InputError
from edl_filter.estimation.autoregression import Interpolation, interpolate
from edl_filter.telemetry.clock_drift import without_drift, without_relative_drift
from edl_filter.telemetry.disagreement import TRIADS, disagreements
from edl_filter.telemetry.record import (
    SAME_TIME,
    ImuRecord,
    InitialState,
    SampleFinding,
    Telemetry,
    finite_rows,
    within_window,
)
from edl_filter.telemetry.sample_checks import CheckSettings, findings_of, runs, with_repair
from edl_filter.telemetry.spikes import bad_triads
from edl_filter.telemetry.transfer import TransferredReadings, transferred
from edl_filter.types import Array, BoolArray

#: An IMU is dead where it ends by more than this before another one, s.
_DEAD = 1.0
#: Samples on each side of a stretch to which an autoregression is fitted: at least, and relative to its length.
_LEAST_SIDE, _SIDE_RATIO = 80, 1.5
#: Time before the parachute from which samples are not compared: the mortar's recoil, s.
_PARACHUTE_MARGIN = 1.0
#: Time after the parachute's deployment by which the canopy is full and its shock is over, s. The deceleration of both
#: rovers jumps to its peak at 1.1 to 1.3 s and falls smoothly from 2.5 s on.
INFLATION = 3.0
_TRIADS = ("force", "rate")
#: Repair of a stretch that no other IMU covers.
BY_DYNAMICS = "filled by a fitted oscillation"
#: Repair of a disagreement of which no other measurement has shown the IMU at fault (`pipeline.redundancy`).
UNDECIDED = "not repaired: no other measurement shows which of the two is at fault"
#: Time after a gap in which the rates of two IMUs are compared (s), least number of samples, and the ratio of mean
#: squares below which the clock jumped.
_JUMP_WINDOW, _JUMP_SAMPLES, _JUMP_RATIO = 20.0, 24, 0.05


def repaired(telemetry: Telemetry, settings: CheckSettings | None = None, parachute: float = np.inf) -> Telemetry:
    """Telemetry with bad samples found and all lost samples filled.

    Parameters
    ----------
    telemetry : Telemetry
        As a reader returns it.
    settings : CheckSettings, optional
        Thresholds of the checks.
    parachute : float
        Time of the parachute's deployment, s: from there on single samples may jump in one IMU.

    Returns
    -------
    Telemetry
        The same object where nothing is lost.

    Raises
    ------
    InputError
        A stretch is lost that is too long to be filled without another IMU.
    """
    settings = CheckSettings() if settings is None else settings
    records = [telemetry.driving, *telemetry.checking]
    findings = list(telemetry.findings)
    if settings.enabled and len(records) > 1:
        for i, second in ((0, records[1]), (1, records[0])):
            records[i], findings = _without_clock_jumps(records[i], second, findings)
    if settings.enabled:
        records, drifts = without_drift(records, parachute - _PARACHUTE_MARGIN)
        findings += drifts
        records, findings = _driven_by_the_finer(records, findings)
    begun = [_begun(record, telemetry.initial, len(records) > 1) for record in records]
    records, findings = [record for record, _ in begun], [*findings, *(f for _, late in begun for f in late)]
    if len(records) > 1:
        records[0], dead = _extended(records[0], records[1])
        findings += dead
        for record in records[1:]:
            if records[0].time[-1] - record.time[-1] > _DEAD and not record.sculling_corrected.any():
                ended = findings_of(record.name, "all", "dead", np.array([True]), record.time[-1:], 0.0)
                findings += (
                    [replace(f, end=float(records[0].time[-1]), samples=0) for f in ended]
                    if _is_flight(telemetry)
                    else []
                )
    smooth_until = parachute - _PARACHUTE_MARGIN
    if settings.enabled:
        records, bad = bad_triads(records, settings, smooth_until)
        findings += bad
        findings += _disagreements(records, drifts, settings, smooth_until)
    if not findings and all(_finite(record) for record in records):
        return telemetry
    sources = [next((r for k, r in enumerate(records) if k != i), None) for i in range(len(records))]
    phrases: dict[str, list[tuple[float, float, str]]] = {}
    outcome = []
    for record, source in zip(records, sources, strict=True):
        complete, how = _filled(record, source, settings, parachute)
        phrases[record.name] = how
        outcome.append(complete)
    findings = [f if f.repair else _explained(f, phrases.get(f.imu, [])) for f in findings]
    findings.sort(key=lambda f: (f.start, f.imu))
    return replace(
        telemetry,
        driving=outcome[0],
        checking=tuple(outcome[1:]),
        findings=tuple(findings),
        as_read=_as_read(telemetry),
    )


def alone(
    telemetry: Telemetry, name: str, settings: CheckSettings | None = None, parachute: float = np.inf
) -> Telemetry:
    """Telemetry with the samples of one IMU, repaired without any other.

    Parameters
    ----------
    telemetry : Telemetry
        As read, or repaired.
    name : str
        Name of the IMU.
    settings : CheckSettings, optional
        Thresholds of the checks.
    parachute : float
        Time of the parachute's deployment, s.

    Returns
    -------
    Telemetry
        Its `as_read` has all IMUs.

    Raises
    ------
    InputError
        A stretch is lost that is too long to be filled without another IMU.
    """
    original = _as_read(telemetry)
    record = next(r for r in (original.driving, *original.checking) if r.name == name)
    names = {r.name for r in (original.driving, *original.checking)}
    findings = tuple(f for f in original.findings if f.imu == name or f.imu not in names)
    single = repaired(replace(original, driving=record, checking=(), findings=findings), settings, parachute)
    return replace(single, as_read=original)


def without_samples(
    telemetry: Telemetry,
    name: str,
    lost: Mapping[str, Sequence[tuple[float, float]]],
    settings: CheckSettings | None = None,
    parachute: float = np.inf,
) -> Telemetry:
    """Telemetry repaired from its records as read, with stretches of one IMU taken for lost.

    Parameters
    ----------
    telemetry : Telemetry
        As read, or repaired.
    name : str
        Name of the IMU.
    lost : dict
        Triad (``force``, ``rate``) → begin and end of its stretches, s.
    settings : CheckSettings, optional
        Thresholds of the checks.
    parachute : float
        Time of the parachute's deployment, s.

    Returns
    -------
    Telemetry
        Its findings of these stretches are of the kind ``disagreement``, with the repair.

    Raises
    ------
    InputError
        A stretch is lost that is too long to be filled without another IMU.
    """
    original = _as_read(telemetry)
    records, findings = [], list(original.findings)
    for record in (original.driving, *original.checking):
        if record.name == name:
            changed: dict[str, Any] = {}
            interval = float(np.median(record.interval))
            for triad, stretches in lost.items():
                inside = np.any([(record.time > a) & (record.time <= b + SAME_TIME) for a, b in stretches], axis=0)
                values = getattr(record, TRIADS[triad])
                changed[TRIADS[triad]] = np.where(inside[:, None], np.nan, values)
                findings += findings_of(name, triad, "disagreement", inside, record.time, interval)
            record = replace(record, **changed)
        records.append(record)
    single = replace(original, driving=records[0], checking=tuple(records[1:]), findings=tuple(findings))
    return replace(repaired(single, settings, parachute), as_read=original)


def _as_read(telemetry: Telemetry) -> Telemetry:
    return telemetry if telemetry.as_read is None else telemetry.as_read


def filled_by_dynamics(telemetry: Telemetry) -> list[tuple[float, float]]:
    """Begin and end of the driving IMU's stretches that no other IMU has and their neighbours fill, s."""
    name = telemetry.driving.name
    return sorted({stretch for f in telemetry.findings if f.imu == name for stretch in f.interpolated})


def _disagreements(
    records: list[ImuRecord], drifts: list[SampleFinding], settings: CheckSettings, end: float
) -> list[SampleFinding]:
    """Disagreements of the first two IMUs; a drift of their clocks that was named and not corrected is none."""
    if len(records) < 2:
        return []
    remaining = disagreements(records[0], records[1], end, settings.false_alarm_probability)
    if remaining and any(f.kind == "clock_drift" and "not corrected" in f.repair for f in drifts):
        steady = without_relative_drift(records[0], records[1], end)
        corrected = disagreements(steady, records[1], end, settings.false_alarm_probability)
        remaining = min(remaining, corrected, key=lambda option: sum(f.samples for f in option))
    return [with_repair(f, UNDECIDED) for f in remaining]


def _driven_by_the_finer(
    records: list[ImuRecord], findings: list[SampleFinding]
) -> tuple[list[ImuRecord], list[SampleFinding]]:
    """Records with the first one that has no coarse steps in front, if the driving one has; it must cover its time."""
    coarse = {f.imu for f in findings if f.kind == "coarse"}
    if records[0].name not in coarse:
        return records, findings
    end, interval = records[0].time[-1], float(np.median(records[0].interval))
    for i, record in enumerate(records):
        if record.name not in coarse and record.start <= records[0].start + interval and record.time[-1] > end - _DEAD:
            findings = [
                with_repair(f, f"{f.repair}; {record.name} drives the reconstruction")
                if f.kind == "coarse" and f.imu == records[0].name
                else f
                for f in findings
            ]
            return [record, *records[:i], *records[i + 1 :]], findings
    return records, findings


def _without_clock_jumps(
    record: ImuRecord, second: ImuRecord, findings: list[SampleFinding]
) -> tuple[ImuRecord, list[SampleFinding]]:
    """The record without gaps at which its clock jumped ahead and no sample was lost.

    After such a gap the rates agree with those of the other IMU as much earlier as the gap is long, and not at their
    own times. Biases are no part of the comparison: means over the window are subtracted.
    """
    for gap in [f for f in findings if f.imu == record.name and f.kind == "missing"]:
        length = gap.end - gap.start
        window = within_window(record.time, record.interval, gap.end, gap.end + _JUMP_WINDOW)
        middle = record.time[window] - 0.5 * record.interval[window]
        own, read = record.angular_rate[window], finite_rows(second.angular_rate)
        reach = second.time[read] - 0.5 * second.interval[read]
        usable = finite_rows(own)
        if usable.sum() < _JUMP_SAMPLES or len(reach) < _JUMP_SAMPLES or not reach[0] < gap.start < gap.end < reach[-1]:
            continue
        mean_square = []
        for shift in (length, 0.0):
            rates = [np.interp(middle[usable] - shift, reach, c) for c in second.angular_rate[read].T]
            difference = own[usable] - np.stack(rates, axis=1)
            mean_square.append(float(np.mean((difference - np.mean(difference, axis=0)) ** 2)))
        if mean_square[0] > _JUMP_RATIO * mean_square[1]:
            continue
        inserted = within_window(record.time, record.interval, gap.start, gap.end)
        record = record.select(~inserted)
        record = replace(record, time=record.time - np.where(record.time > 0.5 * (gap.start + gap.end), length, 0.0))
        moved = replace(gap, kind="clock_jump", samples=0, repair=f"{length:+.3f} s, removed from there on")
        findings = [moved if f is gap else f for f in findings]
    return record, findings


def _is_flight(telemetry: Telemetry) -> bool:
    """Whether all IMUs are meant to read up to the end: in a flight file, not on MER, whose backshell separates."""
    return not any(record.sculling_corrected.any() for record in (telemetry.driving, *telemetry.checking))


def _finite(record: ImuRecord) -> bool:
    return bool(np.isfinite(record.specific_force).all() and np.isfinite(record.angular_rate).all())


def _explained(finding: SampleFinding, repairs: list[tuple[float, float, str]]) -> SampleFinding:
    """A finding with what was done about it: the repairs of the stretches that it overlaps."""
    over = [(a, b, p) for a, b, p in repairs if a < finding.end - 1e-6 and b > finding.start + 1e-6]
    interpolated = tuple((a, b) for a, b, p in over if p == BY_DYNAMICS)
    phrase = ", ".join(dict.fromkeys(p for _, _, p in over)) or "not used"
    return replace(finding, repair=phrase, interpolated=interpolated)


def _begun(record: ImuRecord, initial: InitialState | None, covered: bool) -> tuple[ImuRecord, list[SampleFinding]]:
    """The record with lost samples from the time of the entry state on, if it begins after it.

    Without another IMU not more than `_DEAD` is added, since the record bounds the stretch on one side only.
    """
    late = 0.0 if initial is None else record.start - initial.time
    interval = float(np.median(record.interval))
    if late <= SAME_TIME or (late > _DEAD and not covered):
        return record, []
    count = round(late / interval)
    first = record.interval.copy()
    if not count:  # a part of a sample: the first one is as much longer
        first[0] += late
        return replace(record, interval=first), []
    time: Array = record.start - late + late / count * np.arange(1, count + 1, dtype=np.float64)
    added = _lengthened(record, time, np.full(count, late / count, np.float64), before=True)
    return added, [SampleFinding(record.name, "all", float(time[0] - interval), float(time[-1]), count, "missing")]


def _lengthened(record: ImuRecord, time: Array, interval: Array, before: bool) -> ImuRecord:
    """The record with lost samples at these times (n,), s, before or after its own."""
    count = len(time)

    def longer(values: NDArray[Any], rows: Array | None = None) -> NDArray[Any]:
        nearest = values[:1] if before else values[-1:]
        added = np.repeat(nearest, count, axis=0) if rows is None else rows
        return np.concatenate((added, values) if before else (values, added))

    nothing = np.full((count, 3), np.nan)
    return replace(
        record,
        time=longer(record.time, time),
        interval=longer(record.interval, interval),
        specific_force=longer(record.specific_force, nothing),
        angular_rate=longer(record.angular_rate, nothing),
        position=longer(record.position),
        force_noise=longer(record.force_noise),
        rate_noise=longer(record.rate_noise),
        shared_rate_noise=longer(record.shared_rate_noise),
        coning_corrected=longer(record.coning_corrected),
        sculling_corrected=longer(record.sculling_corrected),
        unit=longer(record.unit),
        source=longer(record.source),
        force_fill_sigma=longer(record.force_fill_sigma),
        rate_fill_sigma=longer(record.rate_fill_sigma),
    )


def _extended(record: ImuRecord, second: ImuRecord) -> tuple[ImuRecord, list[SampleFinding]]:
    """The record with lost samples up to the end of the other one, if it ends by more than `_DEAD` before."""
    interval = float(np.median(record.interval))
    count = int((second.time[-1] - record.time[-1]) / interval + 1e-6)
    if count * interval <= _DEAD:
        return record, []
    time: Array = record.time[-1] + interval * np.arange(1, count + 1, dtype=np.float64)
    extended = _lengthened(record, time, np.full(count, interval), before=False)
    finding = SampleFinding(record.name, "all", float(record.time[-1]), float(time[-1]), count, "dead")
    return extended, [finding]


def _filled(
    record: ImuRecord, second: ImuRecord | None, settings: CheckSettings, parachute: float
) -> tuple[ImuRecord, list[tuple[float, float, str]]]:
    """A record with all lost values filled, and where and how: (start, end, phrase)."""
    if _finite(record):
        return record, []
    repairs: list[tuple[float, float, str]] = []
    source = None if second is None else transferred(record, second, parachute - _PARACHUTE_MARGIN)
    values = {"force": record.specific_force.copy(), "rate": record.angular_rate.copy()}
    sigmas = {"force": record.force_fill_sigma.copy(), "rate": record.rate_fill_sigma.copy()}
    noise = {"force": record.force_noise, "rate": record.rate_noise}
    lost = {triad: ~finite_rows(values[triad]) for triad in _TRIADS}
    for triad in _TRIADS:
        if source is not None:
            available = lost[triad] & source.valid
            for a, b in runs(available):
                rows = slice(a, b)
                values[triad][rows] = getattr(source, triad)[rows]
                sigmas[triad][rows] = _transfer_sigma(source, triad, rows, noise[triad][rows])
                repairs.append(_repair(record, a, b, f"filled from {second.name}" if second else ""))
            lost[triad] = lost[triad] & ~source.valid
        read = values[triad].copy()  # an autoregression is fitted to readings alone
        for a, b in runs(lost[triad]):
            _refuse_long_gap(record, a, b, settings)
            fills = _by_dynamics(record, read, a, b, parachute)
            values[triad][a:b] = np.stack([fill.values for fill in fills], axis=1)
            variance = np.array([fill.covariance.sum() / (b - a) for fill in fills])  # of readings, with their noise
            variance = np.maximum(variance - noise[triad][a:b, None] ** 2, 0.25 * variance)
            if triad == "rate":
                variance = variance + _coning_variance(fills, record.interval[a]) / (b - a) / record.interval[a] ** 2
            sigmas[triad][a:b] = np.maximum(np.sqrt(variance), 1e-12)
            repairs.append(_repair(record, a, b, BY_DYNAMICS))
    filled = np.any(sigmas["rate"] > 0.0, axis=1)
    complete = replace(
        record,
        specific_force=values["force"],
        angular_rate=values["rate"],
        force_fill_sigma=sigmas["force"],
        rate_fill_sigma=sigmas["rate"],
        shared_rate_noise=np.where(filled, 0.0, record.shared_rate_noise),
    )
    return complete, repairs


def _repair(record: ImuRecord, a: int, b: int, phrase: str) -> tuple[float, float, str]:
    return float(record.time[a] - record.interval[a]), float(record.time[b - 1]), phrase


def _refuse_long_gap(record: ImuRecord, a: int, b: int, settings: CheckSettings) -> None:
    start, end = record.time[a] - record.interval[a], record.time[b - 1]
    if end - start > settings.longest_gap_s or b - a >= len(record) - 2:
        raise InputError(
            f"IMU '{record.name}': no usable samples from {start:.3f} to {end:.3f} s, and no other IMU has them; "
            f"at most {settings.longest_gap_s:g} s are filled without one (sample_checks.longest_gap_s)."
        )


def _transfer_sigma(source: TransferredReadings, triad: str, rows: slice, noise: Array) -> Array:
    """Sigma (n, 3) of independent errors that are equivalent to those of n transferred samples, beyond their noise."""
    scatter, common = getattr(source, f"{triad}_scatter")[rows], getattr(source, f"{triad}_error")[rows]
    independent = np.maximum(scatter**2 - noise[:, None] ** 2, 0.25 * scatter**2)
    return np.sqrt(independent + len(scatter) * common**2)


def _by_dynamics(record: ImuRecord, values: Array, a: int, b: int, parachute: float) -> list[Interpolation]:
    """Values of the stretch ``[a, b)`` by an autoregression of each axis, with their covariances.

    A stretch is fitted to samples of the same part of the flight, before or after the parachute's shock, if that part
    is as long on each side of the stretch as the stretch itself, so that the cross-validation has both sides: another
    process acts in the other part, and the shock between them is no oscillation of either. Nearer to the shock, the
    samples of both parts are used, which bound the stretch.
    """
    side = max(_LEAST_SIDE, int(_SIDE_RATIO * (b - a)) + _LEAST_SIDE // 2)
    first, last = max(0, a - side), min(len(record), b + side)
    interval = record.interval[a]
    regular = np.abs(record.interval[first:last] - interval) < 0.2 * interval
    regular &= _same_kind(record, a)[first:last]
    same_part = _same_part(record, a, parachute)
    if same_part[a:b].all() and all(np.count_nonzero(s) >= b - a for s in (same_part[:a], same_part[b:])):
        regular &= same_part[first:last]
    fills = []
    for series in values[first:last].T:
        known = np.isfinite(series) & regular
        fills.append(interpolate(np.nan_to_num(series), known, a - first, b - first))
    return fills


def _coning_variance(fills: list[Interpolation], interval: float) -> Array:
    """Variance (3,) of the rotation by coning about each axis that filled rates do not have, rad².

    To second order, rates p and q about two axes turn the vehicle by ``½ ∫∫ sgn(t' - t) p(t) q(t') dt dt'`` about the
    third one (Goodman & Robinson 1958, ASME J. Appl. Mech. 25, 210). The most probable rates decay to their mean in a
    long stretch, where the vehicle goes on to oscillate about both axes with phases that are not known. The covariance
    of the values has the oscillation, and independent errors with the variance of their sum do not. A mean rate is no
    oscillation, and it is left out: its rotation is the strapdown integration's.
    """

    def weighted(values: Array) -> Array:
        """Sum over all later samples minus that over all earlier ones, along the first axis."""
        total = np.cumsum(values, axis=0)
        return total[-1] - 2.0 * total + values

    variance = np.empty(3)
    for axis in range(3):
        first, second = fills[(axis + 1) % 3], fills[(axis + 2) % 3]
        spread = weighted(weighted(second.covariance).T).T
        square = float(np.sum(spread * first.covariance))
        p, q = first.values - first.values.mean(), second.values - second.values.mean()
        square += float(p @ spread @ p) + float(weighted(q) @ first.covariance @ weighted(q))
        variance[axis] = 0.25 * interval**4 * square
    return variance


def _same_part(record: ImuRecord, row: int, parachute: float) -> BoolArray:
    """Samples (N,) on the same side of the parachute's shock as the row; those in the shock are on neither."""
    before = record.time <= parachute - _PARACHUTE_MARGIN
    after = record.time - record.interval >= parachute + INFLATION
    return before if before[row] else after


def _same_kind(record: ImuRecord, row: int) -> BoolArray:
    """Samples (N,) of the same instrument and kind as the row."""
    return (
        (record.unit == record.unit[row])
        & (record.coning_corrected == record.coning_corrected[row])
        & (record.sculling_corrected == record.sculling_corrected[row])
    )
