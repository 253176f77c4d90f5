"""Likeliest cause of a result that contradicts its measurements: every hypothesis repairs the record and is filtered.

A hypothesis states what is wrong with the input: units, axes, the sign of an axis, a clock (`fault_hypotheses`), lost
samples, the entry state, one measurement. Its repair is applied to the telemetry, and a short run of the filter (EKF,
every constraint, but at most `ALTIMETER_READINGS` of the altimeter) gives the likelihood of the constraints, as in
`navigation.recovery`. This is a likelihood-ratio test between models of one record; a hypothesis that estimates a
number from it loses `PENALTY` for that (Schwarz 1978, Annals of Statistics 6, 461). A cause is named only if its repair
leaves no constraint rejected: otherwise the record has another fault, or more than one, and no cause of the list
explains it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import cast

import numpy as np

from edl_filter.effects.base import EffectInstance
from edl_filter.errors import InputError
from edl_filter.mission import Mission
from edl_filter.navigation.constraints import Altimeter, Constraint
from edl_filter.navigation.filter import Problem, merge, run_filter
from edl_filter.navigation.recovery import Cause as Addition
from edl_filter.navigation.recovery import Recovery, log_likelihood, used_once
from edl_filter.pipeline.fault_hypotheses import Repair, errors_of_one_number, fault_hypotheses
from edl_filter.pipeline.reconstruct import assemble
from edl_filter.planet import Planet
from edl_filter.planet.atmosphere import Atmosphere
from edl_filter.telemetry.record import Telemetry

#: Altimeter readings and longest interval (s) of the short run.
ALTIMETER_READINGS, LONGEST_INTERVAL = 36, 30.0
#: Least size of an estimated error in its sigmas for which it is a cause.
SIGNIFICANT = 2.0
#: Cost of a value with which the record is no flight.
_NO_FLIGHT = 1e30
#: Penalty of a number that a hypothesis estimates, nats: ½ ln of about 30 components.
PENALTY = 1.7
#: Factor by which the sigmas of a measurement are multiplied that may be wrong.
WRONG_SIGMA = 1e3


@dataclass(frozen=True)
class Cause:
    """One hypothesis on what is wrong with the input.

    Attributes
    ----------
    kind : str
        ``units``, ``axes``, ``sign``, ``clock``, ``gap``, ``entry_state``, ``process_noise`` or ``measurement``.
    sentence : str
        What is wrong, without a full stop.
    gain : float
        In log likelihood of the constraints over the record as it is, nats.
    consistent : bool
        Whether no constraint is rejected with the repair.
    """

    kind: str
    sentence: str
    gain: float
    consistent: bool


_ADDITIONS: dict[Addition, tuple[str, str]] = {
    "gap": ("gap", "lost samples, between {start:.1f} and {end:.1f} s"),
    "entry_state": ("entry_state", "the entry state, its error is about {size:.0f} times its stated sigmas"),
    "process_noise": ("process_noise", "a motion that the IMU did not measure, before {end:.1f} s"),
}


def rank_causes(
    mission: Mission,
    telemetry: Telemetry,
    planet: Planet,
    atmosphere: Atmosphere,
    effects: Sequence[EffectInstance],
    recovery: Recovery | None = None,
    recovered: tuple[Problem, bool] | None = None,
) -> list[Cause]:
    """Rank the causes for which the constraints contradict the record, the likeliest first.

    Parameters
    ----------
    mission : Mission
        Checked mission.
    telemetry : Telemetry
        As it was read.
    planet, atmosphere : Planet, Atmosphere
        The mission's own.
    effects : sequence of EffectInstance
        Of the model.
    recovery : Recovery, optional
        What the filter added.
    recovered : (Problem, bool), optional
        The problem with that, and whether its run rejects no constraint.

    Returns
    -------
    list of Cause
        Consistent ones first, each group by its gain. Empty if the short run with the telemetry as read fails.
    """

    def problem_of(repaired: Telemetry) -> Problem:
        return assemble(mission, repaired, planet, atmosphere, effects)

    def evaluate(repair: Repair) -> tuple[float, bool] | None:
        try:
            return _evaluate(problem_of(repair(telemetry)))
        except InputError:  # the repaired record is no flight
            return None

    evaluated = _evaluate(problem_of(telemetry))
    if evaluated is None:
        return []
    baseline, causes = evaluated[0], []
    for hypothesis in fault_hypotheses(mission, telemetry):
        evaluated = evaluate(hypothesis.repair)
        if evaluated is not None:
            causes.append(Cause(hypothesis.kind, hypothesis.sentence, evaluated[0] - baseline, evaluated[1]))
    causes += [
        Cause(kind, sentence, likelihood - baseline - PENALTY, consistent)
        for kind, sentence, likelihood, consistent in _estimated_causes(telemetry, evaluate)
    ]
    causes += [
        Cause("measurement", f"the measurement '{name.replace('_', ' ')}'", likelihood - baseline, consistent)
        for name, likelihood, consistent in _without_each(problem_of(telemetry))
    ]
    if recovery is not None and recovery.cause is not None and recovered is not None:
        kind, text = _ADDITIONS[recovery.cause]
        evaluated = _evaluate(recovered[0])
        if evaluated is not None:
            sentence = text.format(start=recovery.start, end=recovery.end, size=recovery.size)
            causes.append(Cause(kind, sentence, evaluated[0] - baseline - PENALTY, recovered[1]))
    return sorted(causes, key=lambda c: (not c.consistent, -c.gain))


def _evaluate(problem: Problem) -> tuple[float, bool] | None:
    """Log likelihood of the constraints in a short run, nats, and whether none of them is rejected.

    None if the run fails: a covariance is not positive definite, or the position is less well known than the planet's
    size.
    """
    altimeter = [c for c in problem.constraints if isinstance(c, Altimeter)]
    every = max(1, -(-len(altimeter) // ALTIMETER_READINGS))
    dropped = {c.time for k, c in enumerate(altimeter) if k % every}
    constraints = tuple(c for c in problem.constraints if not (isinstance(c, Altimeter) and c.time in dropped))
    start = problem.initial.time
    needed = {start, float(problem.epochs[-1]), *(c.time for c in constraints)}
    regular = problem.epochs[np.searchsorted(problem.epochs, np.arange(start, problem.epochs[-1], LONGEST_INTERVAL))]
    epochs = merge(np.concatenate((sorted(needed), problem.samples.unit_changes, regular)))
    settings = replace(problem.settings, method="ekf", robust="none")
    short = replace(problem, constraints=constraints, epochs=epochs, settings=settings)
    try:
        with np.errstate(over="raise", invalid="raise"):
            filter_pass = run_filter(short)
    except (InputError, np.linalg.LinAlgError, FloatingPointError):
        return None
    rejected = [f for f in filter_pass.fused if not f.accepted]
    many = len(filter_pass.fused) - sum(used_once(filter_pass, f) for f in filter_pass.fused)
    once = [f for f in rejected if used_once(filter_pass, f)]
    consistent = not once and 2 * len(rejected) < max(many, 1) and filter_pass.divergence is None
    return log_likelihood(short, filter_pass), consistent


def _estimated_causes(
    telemetry: Telemetry, evaluate: Callable[[Repair], tuple[float, bool] | None]
) -> Iterator[tuple[str, str, float, bool]]:
    """Kind, sentence, log likelihood and consistency of hypotheses with one number, at its best value."""
    for error in errors_of_one_number(telemetry):
        values: dict[float, tuple[float, bool]] = {}

        def cost(value: float, error=error, values=values) -> float:
            evaluated = evaluate(error.repair(value))
            if evaluated is None:
                return _NO_FLIGHT
            values[value] = evaluated
            return -evaluated[0]

        grid = np.array(sorted((0.0, *error.values)))
        best = int(np.argmin([cost(float(value)) for value in grid]))
        bounds = (grid[max(best - 1, 0)], grid[min(best + 1, len(grid) - 1)])
        from scipy.optimize import minimize_scalar  # imported on use: few runs look for causes

        minimize_scalar(cost, bounds=bounds, method="bounded", options={"xatol": error.resolution, "maxiter": 12})
        if values:
            value = max(values, key=lambda v: values[v])
            likelihood, consistent = values[value]
            sigma = _curvature_sigma(cost, value, 10.0 * error.resolution) if consistent else np.nan
            significant = _is_significant(value, sigma, error.resolution)
            size = _with_sigma(error.factor * abs(value), error.factor * sigma)
            sentence = error.sentence.format(size=size, sign=error.words[int(value < 0.0)])
            yield error.kind, sentence, likelihood, consistent and significant
    if telemetry.altimeter is not None:
        yield from _altimeter_offset(telemetry, evaluate)


def _altimeter_offset(
    telemetry: Telemetry, evaluate: Callable[[Repair], tuple[float, bool] | None]
) -> Iterator[tuple[str, str, float, bool]]:
    """A constant error of the altimeter's heights: scanned, and refined about the best."""
    assert telemetry.altimeter is not None
    altimeter = telemetry.altimeter
    sigma, heights = altimeter.sigma, altimeter.height
    best, likelihood, consistent = 0.0, -np.inf, False
    step = max(50.0 * sigma, 0.25 * float(np.ptp(heights)))
    offsets = np.linspace(-4.0, 4.0, 9) * step

    def with_offset(offset: float) -> tuple[float, bool] | None:
        return evaluate(lambda t: replace(t, altimeter=replace(altimeter, height=heights - offset)))

    def cost(offset: float) -> float:
        evaluated = with_offset(offset)
        return _NO_FLIGHT if evaluated is None else -evaluated[0]

    while step > 0.5 * sigma:
        for offset in offsets:
            evaluated = with_offset(float(offset))
            if evaluated is not None and evaluated[0] > likelihood:
                best, (likelihood, consistent) = float(offset), evaluated
        step *= 0.4
        offsets = best + np.array([-2.0, -1.0, 1.0, 2.0]) * step
    deviation = _curvature_sigma(cost, best, sigma) if consistent else np.nan
    size, sign = _with_sigma(abs(best), deviation), "high" if best > 0.0 else "low"
    consistent = consistent and _is_significant(best, deviation, 0.5 * sigma)
    yield "measurement", f"the altimeter, its heights are {size} m too {sign}", likelihood, consistent


def _is_significant(value: float, sigma: float, resolution: float) -> bool:
    """Whether an estimate is beyond zero by `SIGNIFICANT` sigmas, and by as many times its resolution."""
    return abs(value) >= SIGNIFICANT * float(np.fmax(sigma, resolution))


def _curvature_sigma(cost: Callable[[float], float], best: float, step: float) -> float:
    """One sigma of an estimate from the curvature of the negative log likelihood at its minimum (observed information).

    The differences are taken once over `step` and once over the sigma that follows; NaN where there is no curvature.
    """
    sigma, least = step, cost(best)
    for _ in range(2):
        information = (cost(best + sigma) + cost(best - sigma) - 2.0 * least) / sigma**2
        if not 0.0 < information < np.inf:
            return float("nan")
        sigma = float(information**-0.5)
    return sigma


def _with_sigma(size: float, sigma: float) -> str:
    """A number with its sigma, of which two digits are written, to a thousandth at most."""
    if np.isnan(sigma):
        return f"{size:.1f}"
    sigma = max(sigma, 1e-3)
    places = min(3, max(0, 1 - int(np.floor(np.log10(sigma)))))
    return f"{size:.{places}f} ± {sigma:.{places}f}"


def _without_each(problem: Problem) -> Iterator[tuple[str, float, bool]]:
    """Name, log likelihood and consistency with each measurement that is used once taken as wrong."""
    names = [c.name for c in problem.constraints]
    for constraint in problem.constraints:
        if names.count(constraint.name) == 1:
            inflated = tuple(
                cast(Constraint, _WithLargeSigma(c)) if c is constraint else c for c in problem.constraints
            )
            evaluated = _evaluate(replace(problem, constraints=inflated))
            if evaluated is not None:
                yield constraint.name, *evaluated


class _WithLargeSigma:
    """A constraint whose sigmas are multiplied by `WRONG_SIGMA`."""

    def __init__(self, constraint: object) -> None:
        self._constraint = constraint

    def __getattr__(self, name: str) -> object:
        value = getattr(self._constraint, name)
        return WRONG_SIGMA**2 * value if name == "noise" else value
