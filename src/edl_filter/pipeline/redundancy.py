"""Which of the redundant IMUs drives the reconstruction, where they disagree or the driving one is contradicted.

Two IMUs that disagree show that one of them is at fault, and not which. Landing, rest, altimeter and entry state are
independent of both. Method: the filter runs once with each IMU (multiple-model test: Magill 1965, IEEE Trans. Autom.
Control 10, 434; Willsky 1976, Automatica 12, 601). An IMU is *consistent* where no such measurement is rejected and the
state does not diverge, with the gate of the mission. The driving IMU stays unless it is contradicted and another one is
consistent, or both are consistent and the other one is more likely by more than `DECISIVE`. Where the IMUs disagree,
the one that does not drive is at fault, and it is not compared, calibrated or diagnosed. Each run uses samples that
were repaired without the other IMU (`telemetry.sample_repair.alone`).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from edl_filter.errors import InputError
from edl_filter.navigation.filter import FilterPass, Problem
from edl_filter.navigation.recovery import contradiction, log_likelihood
from edl_filter.telemetry.record import ImuRecord, SampleFinding, Telemetry

#: An IMU covers the flight where it ends by no more than this before the driving one, s.
_COVER = 1.0
#: Log likelihood of the measurements by which one of two consistent IMUs must be better, nats. What each of two sound
#: ones reads at rest has a NIS of its own with six degrees of freedom: the difference has a standard deviation of √6.
DECISIVE = 12.0
#: Repair of a disagreement of which the other measurements do not show the IMU at fault.
UNDECIDED = "not repaired: the other measurements agree with each of the two IMUs"


@dataclass(frozen=True)
class Run:
    """The filter's run with one IMU driving.

    Attributes
    ----------
    telemetry : Telemetry
    problem : Problem
    filter_pass : FilterPass
        Without recovery.
    """

    telemetry: Telemetry
    problem: Problem
    filter_pass: FilterPass

    @property
    def contradicting(self) -> tuple[str, ...]:
        """Names of the measurements that contradict it; empty if it is consistent."""
        names = tuple(contradicting(self.filter_pass))
        divergence = contradiction(self.filter_pass)
        return names or (() if divergence is None else divergence.names)

    @property
    def consistent(self) -> bool:
        """Whether no measurement contradicts it and its path settled."""
        return not self.contradicting and self.filter_pass.converged


def contradicting(filter_pass: FilterPass) -> dict[str, tuple[int, int]]:
    """Landing, rest and altimeter as far as they contradict the state: name → rejected uses, all uses."""
    uses = Counter(f.constraint.name for f in filter_pass.fused)
    rejected = Counter(f.constraint.name for f in filter_pass.fused if not f.accepted)
    return {
        name: (count, uses[name])
        for name, count in rejected.items()
        if name == "landing" or name.startswith("rest_") or (name == "altimeter" and 2 * count > uses[name])
    }


def arbitrated(first: Run, alone: Callable[[str], Telemetry], run: Callable[[Telemetry], Run]) -> Run:
    """The run with that IMU driving which the other measurements support.

    Parameters
    ----------
    first : Run
        With the telemetry's driving IMU.
    alone : callable
        Telemetry of the IMU of a name, repaired without any other.
    run : callable
        Runs the filter with a telemetry.

    Returns
    -------
    Run
        `first` where its IMU is consistent and does not disagree with another one, or where no other one is better.
        Otherwise the findings of its telemetry name the IMU at fault and what was done.
    """
    telemetry = first.telemetry
    parted = [f for f in telemetry.findings if f.kind == "disagreement"]
    if not telemetry.checking or not (first.contradicting or parted):
        return first
    driving = telemetry.driving.name
    others = [name for name in _names(telemetry) if name != driving]
    runs = [r for name in others if (r := _run_of(name, alone, run, telemetry.driving)) is not None]
    better = [r for r in runs if r.consistent and (not first.consistent or _gain(r, first) > DECISIVE)]
    if better:
        best = max(better, key=lambda r: log_likelihood(r.problem, r.filter_pass))
        name = best.telemetry.driving.name
        reason = _reason(first, f"{name} is more likely by {_gain(best, first):.0f} nats")
        return _with_findings(best, telemetry, driving, f"{reason}; {name} drives the reconstruction alone")
    if parted and first.consistent and any(r.consistent and _gain(first, r) <= DECISIVE for r in runs):
        findings = tuple(replace(f, repair=UNDECIDED) if f in parted else f for f in telemetry.findings)
        return replace(first, telemetry=replace(telemetry, findings=findings))
    if parted and first.consistent:
        at_fault = others[0]
        contrary = next((r for r in runs if r.telemetry.driving.name == at_fault), None)
        reason = (
            f"{at_fault} does not cover the flight"
            if contrary is None
            else _reason(contrary, f"{driving} is more likely by {_gain(first, contrary):.0f} nats")
        )
        single = run(alone(driving))
        return _with_findings(single, telemetry, at_fault, f"{reason}; {driving} drives the reconstruction alone")
    return first


def _names(telemetry: Telemetry) -> list[str]:
    return [record.name for record in (telemetry.driving, *telemetry.checking)]


def _run_of(
    name: str, alone: Callable[[str], Telemetry], run: Callable[[Telemetry], Run], driving: ImuRecord
) -> Run | None:
    """The run with another IMU; None where it cannot be repaired alone, or does not cover the flight."""
    try:
        telemetry = alone(name)
        if telemetry.driving.time[-1] < driving.time[-1] - _COVER:
            return None
        return run(telemetry)
    except (InputError, np.linalg.LinAlgError):
        return None


def _gain(run: Run, other: Run) -> float:
    """Log likelihood of the measurements in one run over that in another one, nats."""
    return log_likelihood(run.problem, run.filter_pass) - log_likelihood(other.problem, other.filter_pass)


def _reason(run: Run, alternative: str) -> str:
    names = [name.replace("_", " ") for name in run.contradicting]
    if not names:
        return alternative
    listed = names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
    return f"{listed} contradict{'s' * (len(names) == 1)} {run.telemetry.driving.name}"


def _with_findings(run: Run, joint: Telemetry, at_fault: str, repair: str) -> Run:
    """A run whose telemetry names the IMU at fault: where the two disagree, or in the whole flight."""
    parted = [replace(f, imu=at_fault, repair=repair) for f in joint.findings if f.kind == "disagreement"]
    if not parted:
        record = next(r for r in (joint.driving, *joint.checking) if r.name == at_fault)
        whole = SampleFinding(
            at_fault, "all", record.start, float(record.time[-1]), len(record), "contradiction", repair
        )
        parted = [whole]
    findings = sorted([*run.telemetry.findings, *parted], key=lambda f: (f.start, f.imu))
    return replace(run, telemetry=replace(run.telemetry, findings=tuple(findings)))
