"""Repair of telemetry: samples that neighbours or another IMU show to be bad are lost, and all lost ones are filled.

Input: `Telemetry` with NaN where samples are lost. Method: spikes and disagreements of single samples between the IMUs
are found (`bad_triads`) and treated as lost; disagreements that last and that no constant error explains are named
(`disagreements`), and repaired where the IMU at fault is known (`without_samples`); noise that is higher than stated
for some time, where no other IMU reads, is added to the sigma (`noisy_stretches`); an IMU that begins after or ends
before the other one is extended; jumps and drifts of clocks are removed. Then lost samples are filled
(`sample_filling`). The noise of an IMU that samples much less often than the driving one contains the error of the
interpolation between its samples.
Output: `Telemetry` without NaN, and its findings. Telemetry without findings is returned as it is.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from edl_filter.errors import InputError
from edl_filter.estimation.series import finite_rows, interpolate_columns
from edl_filter.telemetry.clock_drift import without_drift, without_relative_drift
from edl_filter.telemetry.disagreement import TRIADS, disagreements
from edl_filter.telemetry.noisy_stretches import with_noise_of_stretches
from edl_filter.telemetry.record import (
    KINDS,
    SAME_TIME,
    ImuRecord,
    InitialState,
    SampleFinding,
    Telemetry,
    within_window,
)
from edl_filter.telemetry.resampling import with_interpolation_noise
from edl_filter.telemetry.rest_drift import KIND as REST_DRIFT
from edl_filter.telemetry.sample_checks import CheckSettings, findings_of, with_repair
from edl_filter.telemetry.sample_filling import (
    ACROSS_OPENING,
    BY_AUTOREGRESSION,
    PARACHUTE_MARGIN,
    filled,
    with_limits,
)
from edl_filter.telemetry.spikes import bad_triads
from edl_filter.types import Array

#: Share of the samples before the parachute without which an IMU does not drive.
LEAST_READ = 0.5
#: An IMU is dead where it ends by more than this before another one, s.
_DEAD = 1.0
#: Repair of a disagreement of which no other measurement has shown the IMU at fault (`pipeline.redundancy`).
UNDECIDED = "not repaired: no other measurement shows which of the two is at fault"
#: Findings of readings that are kept.
_KEPT = (REST_DRIFT, "delay")
#: Time after a gap in which the rates of two IMUs are compared (s), least number of samples, and the ratio of mean
#: squares below which the clock jumped.
_JUMP_WINDOW, _JUMP_SAMPLES, _JUMP_RATIO = 20.0, 24, 0.05


def repaired(
    telemetry: Telemetry,
    settings: CheckSettings | None = None,
    parachute: float = np.inf,
    widen_noisy: bool = True,
) -> Telemetry:
    """Telemetry with bad samples found and all lost samples filled.

    Parameters
    ----------
    telemetry : Telemetry
        As a reader returns it.
    settings : CheckSettings, optional
        Thresholds of the checks.
    parachute : float
        Time of the parachute's deployment, s: from there on single samples may jump in one IMU.
    widen_noisy : bool
        Whether noise beyond the stated is added to the sigma where no other IMU reads (`noisy_stretches`).

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
    findings = [f for f in telemetry.findings if f.kind != "delay"]  # found again, if the IMUs are compared
    if settings.enabled and len(records) > 1:
        for i, second in ((0, records[1]), (1, records[0])):
            records[i], findings = _without_clock_jumps(records[i], second, findings)
    if settings.enabled:
        records, drifts = without_drift(records, parachute - PARACHUTE_MARGIN)
        findings += drifts
        records, findings = _driven_by_the_better(records, findings, parachute)
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
    smooth_until = parachute - PARACHUTE_MARGIN
    if settings.enabled:
        records, bad = bad_triads(records, settings, smooth_until)
        findings += bad
        findings += _disagreements(records, drifts, settings, smooth_until)
        as_checked, coarse = list(records), {f.imu for f in findings if f.kind == "coarse"}
        for i, record in enumerate(as_checked if widen_noisy and np.isfinite(smooth_until) else []):
            if record.name not in coarse:
                others = [r for k, r in enumerate(as_checked) if k != i]
                records[i], noisy = with_noise_of_stretches(record, smooth_until, others)
                findings += noisy
    unchanged = all(r is given for r, given in zip(records, (telemetry.driving, *telemetry.checking), strict=True))
    nothing_bad = all(f.kind in _KEPT for f in findings)
    if nothing_bad and unchanged and all(record.complete.all() for record in records):
        checking = tuple(with_interpolation_noise(record, records[0]) for record in records[1:])
        same = all(a is b for a, b in zip(checking, telemetry.checking, strict=True))
        if findings != list(telemetry.findings):
            telemetry = replace(telemetry, findings=tuple(findings))
        return telemetry if same else replace(telemetry, checking=checking, as_read=_as_read(telemetry))
    sources = [next((r for k, r in enumerate(records) if k != i), None) for i in range(len(records))]
    phrases: dict[str, list[tuple[float, float, str]]] = {}
    outcome = []
    for record, source in zip(records, sources, strict=True):
        try:
            complete, how = filled(record, source, settings, parachute)
        except InputError as error:
            raise InputError(f"{error}{_long_losses(record.name, findings, settings)}") from None
        phrases[record.name] = how
        outcome.append(complete)
    findings = [f if f.repair else _explained(f, phrases.get(f.imu, [])) for f in findings]
    outcome = [with_limits(record, findings) for record in outcome]
    findings.sort(key=lambda f: (f.start, f.imu))
    return replace(
        telemetry,
        driving=outcome[0],
        checking=tuple(with_interpolation_noise(record, outcome[0]) for record in outcome[1:]),
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
        Triad (``force``, ``rate``) → start and end of its stretches, s. Samples of an instrument that has none before
        the parachute's deployment stay: it drives after another one.
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
            instrument = np.isin(record.unit, record.unit[record.time <= parachute])
            for triad, stretches in lost.items():
                inside = np.any([(record.time > a) & (record.time <= b + SAME_TIME) for a, b in stretches], axis=0)
                inside &= instrument
                values = getattr(record, TRIADS[triad])
                changed[TRIADS[triad]] = np.where(inside[:, None], np.nan, values)
                partial = f"partial_{triad}"
                changed[partial] = np.where(inside[:, None, None], 0.0, getattr(record, partial))
                findings += findings_of(name, triad, "disagreement", inside, record.time, interval)
            record = replace(record, **changed)
        records.append(record)
    single = replace(original, driving=records[0], checking=tuple(records[1:]), findings=tuple(findings))
    # noise of the IMU that remains is evidence against the hypothesis that the other one is at fault
    return replace(repaired(single, settings, parachute, widen_noisy=False), as_read=original)


def _as_read(telemetry: Telemetry) -> Telemetry:
    return telemetry if telemetry.as_read is None else telemetry.as_read


def interpolated_stretches(telemetry: Telemetry) -> list[tuple[float, float]]:
    """Start and end of the driving IMU's stretches that no other IMU has and their neighbours fill, s."""
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
    return [f if f.repair else with_repair(f, UNDECIDED) for f in remaining]


def _long_losses(imu: str, findings: list[SampleFinding], settings: CheckSettings) -> str:
    """What was found in an IMU for longer than can be filled, as a sentence after another one; empty for nothing."""
    losses = [f for f in findings if f.imu == imu and f.end - f.start > settings.longest_gap_s and f.kind not in _KEPT]
    words = "; ".join(f"{f.channel}: {KINDS[f.kind]} from {f.start:.1f} to {f.end:.1f} s" for f in losses)
    return f" Found in {imu}: {words}." if words else ""


def _driven_by_the_better(
    records: list[ImuRecord], findings: list[SampleFinding], parachute: float
) -> tuple[list[ImuRecord], list[SampleFinding]]:
    """Records with the first sound one in front, if the driving one is not; it must cover its time.

    One with coarse steps is not sound, nor one of which a triad has lost most samples before the parachute, since an
    axis is dead or saturated: so few do not determine the errors of the other IMU against it.
    """
    lost = {
        r.name
        for r in records
        if any(np.mean(finite_rows(getattr(r, key))[r.time <= parachute]) < LEAST_READ for key in TRIADS.values())
    }
    worse = {f.imu for f in findings if f.kind == "coarse"} | lost
    if records[0].name not in worse:
        return records, findings
    end, interval = records[0].time[-1], float(np.median(records[0].interval))
    for i, record in enumerate(records):
        if record.name not in worse and record.start <= records[0].start + interval and record.time[-1] > end - _DEAD:
            drives = f"{record.name} drives the reconstruction"
            findings = [
                with_repair(f, f"{f.repair}; {drives}" if f.repair else drives)
                if f.imu == records[0].name
                and (f.kind in ("coarse", "saturated") or f.end - f.start > end - records[0].start - _DEAD)
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
        middle = record.middle[window]
        own, read = record.angular_rate[window], finite_rows(second.angular_rate)
        reach = second.middle[read]
        usable = finite_rows(own)
        if usable.sum() < _JUMP_SAMPLES or len(reach) < _JUMP_SAMPLES or not reach[0] < gap.start < gap.end < reach[-1]:
            continue
        mean_square = []
        for shift in (length, 0.0):
            difference = own[usable] - interpolate_columns(middle[usable] - shift, reach, second.angular_rate[read])
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


def _explained(finding: SampleFinding, repairs: list[tuple[float, float, str]]) -> SampleFinding:
    """A finding with what was done about it: the repairs of the stretches that it overlaps."""
    over = [(a, b, p) for a, b, p in repairs if a < finding.end - SAME_TIME and b > finding.start + SAME_TIME]
    interpolated = tuple((a, b) for a, b, p in over if p in (BY_AUTOREGRESSION, ACROSS_OPENING))
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
        partial_force=longer(record.partial_force, np.zeros((count, 2, 3))),
        partial_rate=longer(record.partial_rate, np.zeros((count, 2, 3))),
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
