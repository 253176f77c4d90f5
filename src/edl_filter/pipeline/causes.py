"""Likeliest cause of a result that contradicts its measurements: every hypothesis repairs the record and is filtered.

A hypothesis states what is wrong with the input: units, axes, the sign of an axis, a clock, lost samples, the entry
state, one measurement. Its repair is applied to the telemetry, and a short run of the filter (EKF, every constraint,
but at most `ALTIMETER_READINGS` of the altimeter) gives the likelihood of the constraints, as in `navigation.recovery`.
This is a likelihood-ratio test between models of one record; a hypothesis that estimates a number from it loses
`PENALTY` for that (Schwarz 1978, Annals of Statistics 6, 461). A cause is named only if its repair leaves no constraint
rejected: otherwise the record has another fault, or more than one, and no cause of the list explains it.

Axes are tried in the axes of the body and in those of the IMU, since a log may be wrong before or after its mounting
was applied.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import permutations
from typing import cast

import h5py
import numpy as np

from edl_filter import rotations
from edl_filter.effects.base import EffectInstance
from edl_filter.errors import InputError
from edl_filter.mission import Mission
from edl_filter.mission.measurements import FlightFileConfig
from edl_filter.navigation.constraints import Altimeter, Constraint
from edl_filter.navigation.filter import Problem, merge, run_filter
from edl_filter.navigation.recovery import Cause as Addition
from edl_filter.navigation.recovery import Recovery, log_likelihood, used_once
from edl_filter.pipeline.reconstruct import assemble
from edl_filter.planet import Planet
from edl_filter.planet.atmosphere import Atmosphere
from edl_filter.telemetry.record import Telemetry
from edl_filter.types import AXES, Array

#: Altimeter readings and longest interval (s) of the short run.
ALTIMETER_READINGS, LONGEST_INTERVAL = 36, 30.0
#: Shifts of a clock (s) and relative errors of a scale that are tried; the best is refined.
SHIFTS = (-10.0, -5.0, -2.0, -1.0, -0.5, 0.5, 1.0, 2.0, 5.0, 10.0)
SCALE_ERRORS = (-0.1, -0.03, -0.01, -0.003, 0.003, 0.01, 0.03, 0.1)
#: Least size of an estimated error in its sigmas for which it is a cause.
SIGNIFICANT = 2.0
#: Cost of a value with which the record is no flight.
_NO_FLIGHT = 1e30
#: Penalty of a number that a hypothesis estimates, nats: ½ ln of about 30 components.
PENALTY = 1.7
FOOT, GRAVITY = 0.3048, 9.80665
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


@dataclass(frozen=True)
class _Hypothesis:
    kind: str
    sentence: str
    repair: Callable[[Telemetry], Telemetry]


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
        Consistent ones first, each group by its gain.
    """

    def problem_of(repaired: Telemetry) -> Problem:
        return assemble(mission, repaired, planet, atmosphere, effects)

    def evaluate(repaired: Telemetry) -> tuple[float, bool] | None:
        try:
            with np.errstate(over="raise", invalid="raise"):
                return _evaluate(problem_of(repaired))
        except (InputError, np.linalg.LinAlgError, FloatingPointError):  # the repaired record is no flight
            return None

    baseline, _ = _evaluate(problem_of(telemetry))
    causes = []
    for hypothesis in _hypotheses(mission, telemetry):
        evaluated = evaluate(hypothesis.repair(telemetry))
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
        likelihood, _ = _evaluate(recovered[0])
        sentence = text.format(start=recovery.start, end=recovery.end, size=recovery.size)
        causes.append(Cause(kind, sentence, likelihood - baseline - PENALTY, recovered[1]))
    return sorted(causes, key=lambda c: (not c.consistent, -c.gain))


def _evaluate(problem: Problem) -> tuple[float, bool]:
    """Log likelihood of the constraints in a short run, nats, and whether none of them is rejected."""
    altimeter = [c for c in problem.constraints if isinstance(c, Altimeter)]
    every = max(1, -(-len(altimeter) // ALTIMETER_READINGS))
    dropped = {c.time for k, c in enumerate(altimeter) if k % every}
    constraints = tuple(c for c in problem.constraints if not (isinstance(c, Altimeter) and c.time in dropped))
    start = problem.initial.time
    needed = {start, float(problem.epochs[-1]), *(c.time for c in constraints)}
    changes = problem.samples.time[np.flatnonzero(np.diff(problem.samples.unit))]
    regular = problem.epochs[np.searchsorted(problem.epochs, np.arange(start, problem.epochs[-1], LONGEST_INTERVAL))]
    epochs = merge(np.concatenate((sorted(needed), changes, regular)))
    settings = replace(problem.settings, method="ekf", robust="none")
    short = replace(problem, constraints=constraints, epochs=epochs, settings=settings)
    filter_pass = run_filter(short)
    rejected = [f for f in filter_pass.fused if not f.accepted]
    many = len(filter_pass.fused) - sum(used_once(filter_pass, f) for f in filter_pass.fused)
    once = [f for f in rejected if used_once(filter_pass, f)]
    consistent = not once and 2 * len(rejected) < max(many, 1) and filter_pass.divergence is None
    return log_likelihood(short, filter_pass), consistent


def _hypotheses(mission: Mission, telemetry: Telemetry) -> Iterator[_Hypothesis]:
    """All hypotheses that change the telemetry."""
    yield from _unit_hypotheses(telemetry)
    if telemetry.initial is not None:
        yield from (
            _Hypothesis("entry_state", f"the attitude at entry, its quaternion {text}", _changed_attitude(change))
            for text, change in _QUATERNIONS.items()
        )
    identity = np.eye(3)
    frames = {"": identity}
    mounting = imu_axes(mission, telemetry.driving.name)
    if mounting is not None and not np.allclose(np.abs(mounting).max(axis=0), 1.0, atol=1e-3):
        frames = {" of the IMU": mounting, " of the body": identity}
    for frame, axes in frames.items():
        yield from _axis_hypotheses(frame, axes)


def _unit_hypotheses(telemetry: Telemetry) -> Iterator[_Hypothesis]:
    for quantity, factors in (
        ("specific_force", {"g": GRAVITY, "ft/s^2": FOOT}),
        ("angular_rate", {"deg/s": np.pi / 180.0, "rpm": np.pi / 30.0}),
    ):
        words = quantity.replace("_", " ")
        for unit, factor in factors.items():
            yield _Hypothesis("units", f"units, the {words} is in {unit}", _scaled(quantity, factor))
            text = f"units, the {words} was multiplied by {factor:.4g} once too often ({unit})"
            yield _Hypothesis("units", text, _scaled(quantity, 1.0 / factor))
    if telemetry.altimeter is not None:
        for unit, factor in {"ft": FOOT, "km": 1e3}.items():
            yield _Hypothesis("units", f"units, the altimeter is in {unit}", _scaled_altimeter(factor))
            text = f"units, the altimeter was multiplied by {factor:.4g} once too often ({unit})"
            yield _Hypothesis("units", text, _scaled_altimeter(1.0 / factor))


def exchange_text(order: Sequence[int]) -> str:
    """Which axes are exchanged, in words; empty if none is. `order`: the axis that stands in place of each."""
    exchanged = [AXES[k] for k in range(3) if order[k] != k]
    if not exchanged:
        return ""
    return f"{' and '.join(exchanged)} exchanged" if len(exchanged) == 2 else "x, y and z in another order"


def sign_text(signs: Sequence[int]) -> str:
    """Which axes have the wrong sign, in words; empty if none has. `signs`: 1 or -1 by axis."""
    wrong = [axis for axis, sign in zip(AXES, signs, strict=True) if sign < 0]
    if not wrong:
        return ""
    return f"sign of {' and '.join(wrong) if len(wrong) < 3 else 'all axes'}"


def _axis_hypotheses(frame: str, axes: Array) -> Iterator[_Hypothesis]:
    """Exchanged axes and wrong signs; `axes`: matrix (3, 3) from the axes in which they are to those of the body."""
    sensors = {
        "accelerometers and gyros": ("specific_force", "angular_rate"),
        "accelerometers": ("specific_force",),
        "gyros": ("angular_rate",),
    }
    for name, quantities in sensors.items():
        for order in list(permutations(range(3)))[1:]:
            matrix = np.eye(3)[list(order)]
            text = exchange_text(order)
            repair = _turned(quantities, axes @ matrix @ axes.T)
            yield _Hypothesis("axes", f"axes, {text} in the {name}{frame and ', axes' + frame}", repair)
        for signs in ((-1, 1, 1), (1, -1, 1), (1, 1, -1), (-1, -1, 1), (-1, 1, -1), (1, -1, -1), (-1, -1, -1)):
            repair = _turned(quantities, axes @ np.diag(signs) @ axes.T)
            yield _Hypothesis("sign", f"{sign_text(signs)} in the {name}{frame and ', axes' + frame}", repair)


@dataclass(frozen=True)
class _ErrorOfOneNumber:
    """An error of one number that is estimated: from the best of `values`, to `resolution`.

    `sentence` contains the size, times `factor`, and one of two words: for a value above zero, and for one below.
    `repair` gives the repair of a value.
    """

    kind: str
    sentence: str
    words: tuple[str, str]
    values: tuple[float, ...]
    resolution: float
    repair: Callable[[float], Callable[[Telemetry], Telemetry]]
    factor: float = 1.0

    def text(self, value: float, sigma: float) -> str:
        """The sentence for an estimate with one sigma."""
        size = _with_sigma(self.factor * abs(value), self.factor * sigma)
        return self.sentence.format(size=size, sign=self.words[int(value < 0.0)])


def _errors_of_one_number(telemetry: Telemetry) -> Iterator[_ErrorOfOneNumber]:
    clock = "clock, the times of the {} are about {{size}} s {{sign}}"
    words = ("early", "late")
    yield _ErrorOfOneNumber("clock", clock.format("IMU"), words, SHIFTS, 0.01, _shifted_imu)
    if telemetry.altimeter is not None:
        yield _ErrorOfOneNumber("clock", clock.format("altimeter"), words, SHIFTS, 0.01, _shifted_altimeter)
        scale = "the altimeter, its heights are {size} % too {sign}"
        yield _ErrorOfOneNumber(
            "measurement",
            scale,
            ("large", "small"),
            SCALE_ERRORS,
            1e-4,
            lambda error: _scaled_altimeter(1.0 / (1.0 + error)),
            100.0,
        )


def _estimated_causes(
    telemetry: Telemetry, evaluate: Callable[[Telemetry], tuple[float, bool] | None]
) -> Iterator[tuple[str, str, float, bool]]:
    """Kind, sentence, log likelihood and consistency of hypotheses with one number, at its best value."""
    for error in _errors_of_one_number(telemetry):
        values: dict[float, tuple[float, bool]] = {}

        def cost(value: float, error=error, values=values) -> float:
            evaluated = evaluate(error.repair(value)(telemetry))
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
            yield error.kind, error.text(value, sigma), likelihood, consistent and significant
    if telemetry.altimeter is not None:
        yield from _altimeter_offset(telemetry, evaluate)


def _altimeter_offset(
    telemetry: Telemetry, evaluate: Callable[[Telemetry], tuple[float, bool] | None]
) -> Iterator[tuple[str, str, float, bool]]:
    """A constant error of the altimeter's heights: scanned, and refined about the best."""
    assert telemetry.altimeter is not None
    sigma, heights = telemetry.altimeter.sigma, telemetry.altimeter.height
    best, likelihood, consistent = 0.0, -np.inf, False
    step = max(50.0 * sigma, 0.25 * float(np.ptp(heights)))
    offsets = np.linspace(-4.0, 4.0, 9) * step

    def with_offset(offset: float) -> tuple[float, bool] | None:
        assert telemetry.altimeter is not None
        return evaluate(replace(telemetry, altimeter=replace(telemetry.altimeter, height=heights - offset)))

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


def _scaled(quantity: str, factor: float) -> Callable[[Telemetry], Telemetry]:
    def repair(t: Telemetry) -> Telemetry:
        return replace(t, driving=replace(t.driving, **{quantity: factor * getattr(t.driving, quantity)}))

    return repair


def _scaled_altimeter(factor: float) -> Callable[[Telemetry], Telemetry]:
    def repair(t: Telemetry) -> Telemetry:
        assert t.altimeter is not None
        return replace(t, altimeter=replace(t.altimeter, height=factor * t.altimeter.height))

    return repair


def _turned(quantities: tuple[str, ...], matrix: Array) -> Callable[[Telemetry], Telemetry]:
    def repair(t: Telemetry) -> Telemetry:
        return replace(t, driving=replace(t.driving, **{q: getattr(t.driving, q) @ matrix.T for q in quantities}))

    return repair


#: Conventions of a quaternion, and the change to that of the format: scalar last, inertial axes from those of the body.
_QUATERNIONS: dict[str, Callable[[Array], Array]] = {
    "has its scalar part first": lambda q: np.roll(q, -1),
    "turns from inertial axes to those of the body": rotations.conjugate,
    "has its scalar part first and turns from inertial axes to those of the body": lambda q: rotations.conjugate(
        np.roll(q, -1)
    ),
}


def _changed_attitude(change: Callable[[Array], Array]) -> Callable[[Telemetry], Telemetry]:
    def repair(t: Telemetry) -> Telemetry:
        assert t.initial is not None
        return replace(t, initial=replace(t.initial, inertial_from_body=change(t.initial.inertial_from_body)))

    return repair


def _shifted_imu(shift: float) -> Callable[[Telemetry], Telemetry]:
    return lambda t: replace(t, driving=replace(t.driving, time=t.driving.time + shift))


def _shifted_altimeter(shift: float) -> Callable[[Telemetry], Telemetry]:
    def repair(t: Telemetry) -> Telemetry:
        assert t.altimeter is not None
        return replace(t, altimeter=replace(t.altimeter, time=t.altimeter.time + shift))

    return repair


def _without_each(problem: Problem) -> Iterator[tuple[str, float, bool]]:
    """Name, log likelihood and consistency with each measurement that is used once taken as wrong."""
    names = [c.name for c in problem.constraints]
    for constraint in problem.constraints:
        if names.count(constraint.name) == 1:
            inflated = tuple(
                cast(Constraint, _WithLargeSigma(c)) if c is constraint else c for c in problem.constraints
            )
            yield constraint.name, *_evaluate(replace(problem, constraints=inflated))


class _WithLargeSigma:
    """A constraint whose sigmas are multiplied by `WRONG_SIGMA`."""

    def __init__(self, constraint: object) -> None:
        self._constraint = constraint

    def __getattr__(self, name: str) -> object:
        value = getattr(self._constraint, name)
        return WRONG_SIGMA**2 * value if name == "noise" else value


def imu_axes(mission: Mission, name: str) -> Array | None:
    """Mounting of an IMU in a flight file.

    Parameters
    ----------
    mission : Mission
        With the path of the telemetry.
    name : str
        Of the IMU.

    Returns
    -------
    (3, 3) array or None
        body_from_imu; None where there is no such file or IMU.
    """
    path = mission.telemetry_path()
    if not isinstance(mission.telemetry, FlightFileConfig) or path is None:
        return None
    try:
        with h5py.File(path, "r") as file:
            return rotations.to_matrix(np.array(file[f"imu/{name}"].attrs["body_from_imu"], float))
    except (OSError, KeyError):
        return None
