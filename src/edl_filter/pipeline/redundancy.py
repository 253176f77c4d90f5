"""Which of two IMUs is at fault where they disagree beyond what constant errors explain.

A disagreement (`telemetry.disagreement`) shows that samples of one IMU are wrong, and not of which, and of a change in
mid-flight not whether the samples before it or after it are. The hypotheses are that one IMU or the other has lost its
samples in the stretch, from its start to the end of the record, or outside it. Each is repaired from the other IMU,
whose calibration against the first keeps a constant error of the first as it is, and the filter runs once
(multiple-model test: Magill 1965, IEEE Trans. Autom. Control 10, 434; Willsky 1976, Automatica 12, 601).

Evidence is the likelihood of landing, rest and altimeter, which are independent of both IMUs, and the error of one IMU
that the other one does not have (`independent_error`). An IMU is at fault where one of the two shows it and the
other one does not contradict. Measurements that contradict the flight with either IMU show an error outside the IMUs,
a missing effect for instance: they do not contradict an error that one IMU alone has. Else the disagreement stays, and
the result is not trusted (`trust.judge`). Without a disagreement nothing is arbitrated: an IMU that landing, rest or
altimeter contradict may have a constant error, of which the diagnosis judges.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from edl_filter.errors import InputError
from edl_filter.navigation.filter import FilterPass, Problem
from edl_filter.navigation.recovery import LEAST_GAIN, contradiction, log_likelihood
from edl_filter.telemetry.disagreement import TRIADS, WINDOW, independent_error
from edl_filter.telemetry.record import SampleFinding, Telemetry
from edl_filter.telemetry.relative_calibration import FEWEST_SAMPLES
from edl_filter.telemetry.sample_checks import CheckSettings
from edl_filter.telemetry.sample_repair import LEAST_READ, UNDECIDED, without_samples
from edl_filter.telemetry.transfer import log_prior_of_rate_errors

#: Log likelihood of the measurements by which the hypotheses of one IMU must be better, nats. What an IMU reads at rest
#: has a NIS with six degrees of freedom, and the half of it a standard deviation of √3: that of two IMUs differs by √6,
#: and this is five times as much.
DECISIVE = 12.0
#: What an IMU that drives in place of another may lack at the end of the flight, s.
_COVER = 1.0
#: Time before the parachute up to which IMUs are compared, s: the mortar's recoil. A disagreement lasts to the end of
#: the comparison where it ends by less than this before the parachute, s.
_MARGIN = 1.0
_COMPARED = _MARGIN + WINDOW
#: Kinds of findings that are single samples or a few of them.
_SINGLE_SAMPLES = ("spike", "burst", "saturated")
#: Start and end of the stretches of each triad, s.
Stretches = Mapping[str, Sequence[tuple[float, float]]]


@dataclass(frozen=True)
class Checks:
    """How the samples of IMUs are checked and repaired.

    Attributes
    ----------
    settings : CheckSettings
        Thresholds.
    parachute : float
        Time of the parachute's deployment, s.
    exchange : bool
        Whether the other IMU may drive: no effect of the model is in the driving IMU without its name.
    """

    settings: CheckSettings
    parachute: float
    exchange: bool


@dataclass(frozen=True)
class Run:
    """The filter's run with one telemetry, before any recovery.

    Attributes
    ----------
    telemetry : Telemetry
    problem : Problem
    filter_pass : FilterPass
    """

    telemetry: Telemetry
    problem: Problem
    filter_pass: FilterPass

    @property
    def log_likelihood(self) -> float:
        """Of the measurements, nats."""
        return log_likelihood(self.problem, self.filter_pass)

    @property
    def consistent(self) -> bool:
        """Whether no measurement contradicts it and its path converged."""
        diverged = contradiction(self.filter_pass) is not None
        return not contradicting(self.filter_pass) and not diverged and self.filter_pass.converged


def contradicting(filter_pass: FilterPass) -> dict[str, tuple[int, int]]:
    """Landing, rest and altimeter as far as they contradict the state: name → rejected uses, all uses."""
    uses = Counter(f.constraint.name for f in filter_pass.fused)
    rejected = Counter(f.constraint.name for f in filter_pass.fused if not f.accepted)
    return {
        name: (count, uses[name])
        for name, count in rejected.items()
        if name == "landing" or name.startswith("rest_") or (name == "altimeter" and 2 * count > uses[name])
    }


def undecided(telemetry: Telemetry) -> list[SampleFinding]:
    """Disagreements of two IMUs of which it is not known which one is at fault."""
    return [f for f in telemetry.findings if f.kind == "disagreement" and f.repair == UNDECIDED]


def arbitrated(first: Run, run: Callable[[Telemetry], Run], checks: Checks) -> Run:
    """The run in which the samples of the IMU at fault are replaced from the other one.

    Parameters
    ----------
    first : Run
        With the telemetry as it was read and repaired.
    run : callable
        Runs the filter with a telemetry.
    checks : Checks
        How samples are checked and repaired.

    Returns
    -------
    Run
        `first` where the IMUs do not disagree, or where it is not known which one is at fault.
    """
    telemetry = first.telemetry
    findings = undecided(telemetry)
    if not findings or not telemetry.checking:
        return first
    records = telemetry.driving, telemetry.checking[0]
    names = [record.name for record in records]
    hypotheses = _hypotheses(findings, max(record.start for record in records), checks.parachute)
    best = [_best(first, name, hypotheses, run, checks) for name in names]
    gain = _gain(*best)
    errors = independent_error(*records, findings, checks.parachute)
    error = errors[names[0]] - errors[names[1]]
    at_fault = _decision(gain, error)
    if at_fault is None and not any(h is not None and h.run.consistent for h in best):
        at_fault, gain = _decision(error), 0.0
    chosen = None if at_fault is None else best[at_fault]
    if at_fault is None or chosen is None:
        return first
    reasons = []
    if abs(gain) > DECISIVE:
        reasons.append("the other measurements" + (f" ({abs(gain):.0f} nats)" if np.isfinite(gain) else ""))
    if max(errors.values()) > DECISIVE:
        reasons.append("an error that the other IMU does not have")
    return _with_reason(chosen.run, names[at_fault], " and ".join(reasons))


def _gain(first: _Hypothesis | None, second: _Hypothesis | None) -> float:
    """Log likelihood ratio of two hypotheses, nats.

    Infinite if the samples of one IMU cannot be replaced: it is sound if the flight without the other one's is
    consistent; else nothing is known of it.
    """
    if first is not None and second is not None:
        return first.likelihood - second.likelihood
    possible = first or second
    if possible is None or not possible.run.consistent:
        return 0.0
    return np.inf if second is None else -np.inf


@dataclass(frozen=True)
class _Hypothesis:
    """The run with samples of an IMU lost, and its log likelihood, nats.

    In the stretches that are kept, the rates of one IMU have constant errors against the other: their prior is a part
    of the likelihood.
    """

    run: Run
    likelihood: float


def _best(
    first: Run, name: str, hypotheses: list[Stretches], run: Callable[[Telemetry], Run], checks: Checks
) -> _Hypothesis | None:
    """The likeliest run with samples of an IMU lost after which the IMUs agree; None if there is none.

    A few remaining samples cannot be compared and are not shown to agree.
    """
    attempts = []
    for lost in hypotheses:
        try:
            with np.errstate(over="raise", invalid="raise"):
                attempt = run(_with_samples_lost(first, name, lost, checks))
        except (InputError, np.linalg.LinAlgError, FloatingPointError):  # no flight, or too much of it is lost
            continue
        records = attempt.telemetry.driving, attempt.telemetry.checking[0]
        remaining = next(r for r in records if r.name == name)
        count = np.count_nonzero(~remaining.filled & (remaining.time <= checks.parachute))
        if not undecided(attempt.telemetry) and not 0 < count < FEWEST_SAMPLES:
            prior = log_prior_of_rate_errors(*records, checks.parachute - _MARGIN)
            attempts.append(_Hypothesis(attempt, attempt.log_likelihood + prior))
    return _likeliest(attempts) if attempts else None


def _hypotheses(findings: list[SampleFinding], begin: float, parachute: float) -> list[Stretches]:
    """Stretches of each triad that may be wrong: the disagreement, all but it, all from its start on.

    IMUs are compared from the start of both records (s) to the parachute. One that is at fault until then is taken to
    be so to the end of the record. Stretches of both triads that begin within one window are one fault of the packets,
    which ends with the later of the two: where force or rate changes slowly, late readings show in the other triad
    only. A fault begins or ends somewhere in the last window of a disagreement: both hypotheses take it for lost.
    """
    inside: dict[str, list[tuple[float, float]]] = {}
    for finding in findings:
        end = np.inf if finding.end > parachute - _COMPARED else finding.end
        start = -np.inf if finding.start < begin + WINDOW else finding.start
        inside.setdefault(finding.channel, []).append((start, end))
    inside = _with_common_ends(inside)
    onwards = {triad: [(min(a for a, _ in stretches), np.inf)] for triad, stretches in inside.items()}
    outside = {}
    for triad, stretches in inside.items():
        edges = [-np.inf, *(time for stretch in sorted(stretches) for time in stretch), np.inf]
        pairs = zip(edges[::2], edges[1::2], strict=True)
        outside[triad] = [(a - WINDOW, b + WINDOW) for a, b in pairs if a < b]
    complete = all(outside.values())  # else nothing is kept, as with the stretches themselves
    return [inside, *([outside] if complete else []), *([onwards] if onwards != inside else [])]


def _with_common_ends(stretches: Stretches) -> dict[str, list[tuple[float, float]]]:
    """Stretches of each triad; those that begin within one window of one of another triad end with the later one."""
    all_stretches = [stretch for triad in stretches.values() for stretch in triad]
    common: dict[str, list[tuple[float, float]]] = {}
    for triad, own in stretches.items():
        disjoint: list[tuple[float, float]] = []
        for start, end in sorted(own):
            last = max([end, *(b for a, b in all_stretches if a == start or abs(a - start) <= WINDOW)])
            if disjoint and start <= disjoint[-1][1]:
                start, last = disjoint[-1][0], max(last, disjoint[-1][1])
                disjoint.pop()
            disjoint.append((start, last))
        common[triad] = disjoint
    return common


def _with_adjacent_spikes(stretches: Stretches, findings: Sequence[SampleFinding]) -> Stretches:
    """Stretches of an IMU with spikes, bursts and saturated samples (`findings`) less than a window apart from them.

    A fault that is no constant error ends somewhere in the last window, in which it is found sample by sample. Samples
    between those are too few for a window, and a neighbour that is lost leaves no parity: they are not known to agree.
    Nor are those of the other triad, if it has spikes within the stretch.
    """
    out: dict[str, list[tuple[float, float]]] = {}
    for triad in TRIADS:
        spikes = [(f.start, f.end) for f in findings if f.channel.split()[0] == triad and f.kind in _SINGLE_SAMPLES]
        own = list(stretches.get(triad, ()))
        others = [stretch for name, of_triad in stretches.items() if name != triad for stretch in of_triad]
        own += [(a, b) for a, b in others if any(a < end and start < b for start, end in spikes)]
        merged: list[tuple[float, float]] = []
        for start, end in sorted([*own, *spikes]):
            if merged and start < merged[-1][1] + WINDOW:
                before = merged.pop()
                start, end = before[0], max(end, before[1])
            merged.append((start, end))
        lost = [(a, b) for a, b in merged if any(a <= start and end <= b for start, end in own)]
        if lost:
            out[triad] = lost
    return out


def _with_samples_lost(first: Run, name: str, lost: Stretches, checks: Checks) -> Telemetry:
    """Repaired telemetry, driven by the other IMU where the driving one has lost most of its samples."""
    lost = _with_adjacent_spikes(lost, [f for f in first.telemetry.findings if f.imu == name])
    repaired = without_samples(first.telemetry, name, lost, checks.settings, checks.parachute)
    driving = repaired.driving
    before = driving.time <= checks.parachute
    filled = np.any([np.any(s > 0.0, axis=1) for s in (driving.force_fill_sigma, driving.rate_fill_sigma)], axis=0)
    covers = repaired.checking[0].time[-1] > driving.time[-1] - _COVER
    if name != driving.name or not checks.exchange or not covers or np.mean(~filled[before]) > LEAST_READ:
        return repaired
    return replace(repaired, driving=repaired.checking[0], checking=(driving, *repaired.checking[1:]))


def _likeliest(attempts: list[_Hypothesis]) -> _Hypothesis:
    """The first hypothesis than which no later one is more likely by more than `LEAST_GAIN`."""
    best = attempts[0]
    for attempt in attempts[1:]:
        if attempt.likelihood > best.likelihood + LEAST_GAIN:
            best = attempt
    return best


def _decision(*evidence: float) -> int | None:
    """Index of the IMU at fault by independent evidence, each in nats, positive for the first one."""
    decisions = {int(value < 0.0) for value in evidence if abs(value) > DECISIVE}
    return decisions.pop() if len(decisions) == 1 else None


def _with_reason(run: Run, name: str, reason: str) -> Run:
    """A run whose findings of the disagreement have the reason for which the IMU is at fault."""
    findings = tuple(
        replace(f, repair=f"{f.repair}; the fault of {name} is shown by {reason}") if f.kind == "disagreement" else f
        for f in run.telemetry.findings
    )
    return replace(run, telemetry=replace(run.telemetry, findings=findings))
