"""Unexplained force and moment: against time, and when the largest channel fails, its frequency and correlations.

Against time they are the smoothed Gauss–Markov process of `noise.unmodelled_acceleration`. The process is part of the
state vector. The fixed-interval smoother gives its value in every bin, given all earlier and later residuals, with the
nuisance parameters marginalised (`estimation.smoothing.smoothed_last_states`).

Residuals of specific force and of the rate's steps are, apart from noise and the small navigation error, the missing
force and moment themselves. The largest channel is described so that a person can name the cause and write the effect.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import lombscargle

from edl_filter.diagnosis.linear_model.linear_model import LinearizedModel
from edl_filter.diagnosis.noise.unmodelled_acceleration import UnmodelledAcceleration, accelerations
from edl_filter.diagnosis.prediction.dead_reckoning import NODES_PER_BIN
from edl_filter.diagnosis.residual_analysis.residual_map import LEAST_ROWS, normalised_innovations
from edl_filter.estimation.kalman import whitening_filter
from edl_filter.estimation.series import runs
from edl_filter.estimation.smoothing import smoothed_last_states
from edl_filter.mission.decision_settings import DecisionSettings
from edl_filter.results.verdicts import Form
from edl_filter.types import AXES, Array, BoolArray, IntArray

#: Number of frequencies of a spectrum that are computed together.
_FREQUENCIES = 64
#: Least number of bins of a spectrum: fewer have not five independent frequencies between the default of `line_cycles`
#: and the Nyquist frequency.
_LEAST_BINS = 16
#: Share of the interval of the largest channel in which another one that is listed with it fails.
_COMMON_SHARE = 0.5


@dataclass(frozen=True)
class LatentForce:
    """Unmodelled force and moment in body axes, and one sigma of them.

    Attributes
    ----------
    time : (B,) array
        Middles of the bins that are compared, s.
    force, force_sigma : (B, 3) arrays
        N.
    moment, moment_sigma : (B, 3) arrays
        About the centre of mass, N m.
    """

    time: Array
    force: Array
    force_sigma: Array
    moment: Array
    moment_sigma: Array


@dataclass(frozen=True)
class Remainder:
    """The largest unexplained channel.

    Attributes
    ----------
    channel : str
    t0, t1 : float
        Interval in which it fails, s.
    rms : float
        In sigmas.
    size : float
        RMS, N or N m.
    unit : str
    frequency : float or None
        Hz, if one spectral line contains a large share of its power.
    follows : dict
        Quantity → correlation with the channel, or with its absolute value.
    companions : tuple of str
        Other channels that fail in the same interval.
    description : str
    """

    channel: str
    t0: float
    t1: float
    rms: float
    size: float
    unit: str
    frequency: float | None
    follows: dict[str, float]
    companions: tuple[str, ...]
    description: str


def estimate_latent_force(model: LinearizedModel, unmodelled: UnmodelledAcceleration) -> LatentForce | None:
    """Smoothed unmodelled force and moment with the most likely process; None where that is no force and no moment."""
    if unmodelled.is_zero or unmodelled.form is Form.IMU:
        return None
    whiten = whitening_filter(model.state_space_with_unmodelled(unmodelled))
    shape = accelerations(model.residuals.flow, unmodelled)[NODES_PER_BIN // 2 :: NODES_PER_BIN]
    mean, covariance = smoothed_last_states(whiten, model.white_residuals(whiten), model.initial_mean, shape.shape[2])
    used, step = model.index.step_of_bins(whiten.model.row_start)
    time = model.bins.middle[used]
    to_loads = np.zeros((len(time), 6, 6))
    for part, body in model.inputs.forward_model.bodies(time):
        to_loads[part, :3, :3] = body.mass * np.eye(3)
        to_loads[part, 3:, 3:] = body.inertia
    to_loads = to_loads @ shape[used]
    loads = np.einsum("bij,bj->bi", to_loads, mean[step])
    sigma = np.sqrt(np.einsum("bij,bjk,bik->bi", to_loads, covariance[step], to_loads, optimize=True))
    return LatentForce(time, loads[:, :3], sigma[:, :3], loads[:, 3:], sigma[:, 3:])


def missing_loads(model: LinearizedModel) -> Array:
    """Missing force (N) and moment (N m) bin by bin, ``(B, 6)``; NaN where nothing is compared."""
    residuals, bins = model.residuals, model.bins
    out = np.full((len(bins.interval), 6), np.nan)
    acceleration = np.full((len(bins.interval), 3), np.nan)
    acceleration[:-1] = residuals.rate_step / bins.interval[:-1, None]
    for part, body in model.inputs.forward_model.bodies(bins.middle):
        out[part, :3] = residuals.force[part] * body.mass
        out[part, 3:] = acceleration[part] @ body.inertia.T
    out[model.index.bin_rows[:, :6] < 0] = np.nan
    return out


def describe_remainder(model: LinearizedModel) -> Remainder | None:
    """Describe the largest unexplained channel; None where no channel fails."""
    index, bins, settings = model.index, model.bins, model.settings
    normalised = normalised_innovations(model)
    names = [f"force_{a}" for a in AXES] + [f"moment_{a}" for a in AXES]
    spans = [_failing_span(index.bin_rows[:, c], normalised, bins.middle, bins.edges, settings) for c in range(6)]
    largest = int(np.argmax([0.0 if s is None else s[2] for s in spans]))
    if (span := spans[largest]) is None:
        return None
    t0, t1, rms = span
    values = missing_loads(model)[:, largest]
    inside = np.isfinite(values) & (bins.middle >= t0) & (bins.middle <= t1)
    time, series = bins.middle[inside], values[inside]
    frequency = _spectral_line(time, series, settings)
    follows = _correlations(model, inside, series)
    companions = tuple(
        names[c]
        for c, s in enumerate(spans)
        if s is not None and c != largest and min(t1, s[1]) - max(t0, s[0]) > _COMMON_SHARE * (t1 - t0)
    )
    unit = "N" if largest < 3 else "N m"
    size = float(np.sqrt(np.mean(series**2)))
    channel = names[largest]
    return Remainder(
        channel=channel,
        t0=t0,
        t1=t1,
        rms=rms,
        size=size,
        unit=unit,
        frequency=frequency,
        follows=follows,
        companions=companions,
        description=_description(channel, span, size, unit, frequency, follows, companions, settings),
    )


def _failing_span(
    rows: IntArray, normalised: Array, middle: Array, edges: Array, settings: DecisionSettings
) -> tuple[float, float, float] | None:
    """Interval over which a channel fails piece by piece with the largest sum of squares, and its RMS there."""
    length = settings.unexplained_piece_s
    used = np.flatnonzero(rows >= 0)
    if not len(used):
        return None
    values, time = normalised[rows[used]], middle[used]
    piece = np.floor((time - edges[0]) / length).astype(int)
    count = np.bincount(piece, minlength=piece[-1] + 1)
    square = np.bincount(piece, values**2, minlength=piece[-1] + 1) / np.maximum(count, 1)
    chance = settings.excess_variance_sigmas * np.sqrt(2.0 / np.maximum(count, 1))
    fails = (count >= LEAST_ROWS) & (square - 1.0 > chance)
    closed = fails.copy()
    closed[1:-1] |= fails[:-2] & fails[2:]  # a gap of one piece does not divide a span
    spans = [(a, b) for a, b in runs(closed) if b > a + 1]
    if not spans:
        return None
    a, b = max(spans, key=lambda span: np.sum(square[slice(*span)] * count[slice(*span)]))
    inside = (piece >= a) & (piece < b)
    return (
        float(edges[0] + a * length),
        float(edges[0] + b * length),
        float(np.sqrt(np.mean(values[inside] ** 2))),
    )


def _spectral_line(time: Array, series: Array, settings: DecisionSettings) -> float | None:
    """Frequency of a line that contains a large share of the power, Hz; fewer than a few cycles are a trend."""
    if len(time) < _LEAST_BINS:
        return None
    step, span = float(np.median(np.diff(time))), float(time[-1] - time[0])
    frequency = np.arange(settings.line_cycles / span, 0.5 / step, 0.2 / span)
    if not len(frequency):
        return None
    blocks = np.array_split(frequency, len(frequency) // _FREQUENCIES + 1)  # lombscargle has arrays of all times by all
    deviation = series - series.mean()
    power = np.concatenate([lombscargle(time, deviation, 2.0 * np.pi * f, normalize=True) for f in blocks if len(f)])
    k = int(np.argmax(power))
    return float(frequency[k]) if power[k] > settings.line_power_share else None


def _correlations(model: LinearizedModel, inside: BoolArray, series: Array) -> dict[str, float]:
    """Correlation with quantities of the flight; of the absolute value where the sign turns with the body."""
    flow = model.residuals.flow
    m = slice(NODES_PER_BIN // 2, None, NODES_PER_BIN)
    v, w = (flow.velocity_body[m, 1:] / flow.speed[m, None])[inside].T
    q = flow.dynamic_pressure[m][inside]
    signed = {"q": q, "q v/V (flow-fixed, sideways)": q * v, "q w/V (flow-fixed, up and down)": q * w}
    absolute = {"q": q, "alpha_total": flow.alpha_total[m][inside], "Mach": flow.mach[m][inside]}
    correlations = {n: _correlation(series, x) for n, x in signed.items()}
    correlations |= {f"size with {n}": _correlation(np.abs(series), x) for n, x in absolute.items()}
    return {n: round(r, 3) for n, r in correlations.items() if np.isfinite(r)}


def _correlation(a: Array, b: Array) -> float:
    a, b = a - a.mean(), b - b.mean()
    scale = float(np.sqrt((a @ a) * (b @ b)))
    return float(a @ b) / scale if scale > 0.0 else float("nan")


def _description(
    channel: str,
    span: tuple[float, float, float],
    size: float,
    unit: str,
    frequency: float | None,
    follows: dict[str, float],
    companions: tuple[str, ...],
    settings: DecisionSettings,
) -> str:
    t0, t1, rms = span
    text = f"{_in_words(channel)} from {t0:.0f} to {t1:.0f} s: {float(f'{size:.3g}'):g} {unit} RMS"
    text += f", {rms:.3g} times its sigma"
    if frequency is not None:
        text += f"; it oscillates at {frequency:.3f} Hz"
    strong = {n: r for n, r in follows.items() if abs(r) > settings.follows_correlation}
    if strong:
        best = max(strong, key=lambda n: abs(strong[n]))
        text += f"; it follows {best} (correlation {strong[best]:+.2f})"
    else:
        text += "; it follows none of q, angle of attack and Mach number"
    if companions:
        text += (
            f"; {', '.join(map(_in_words, companions))} {'acts' if len(companions) == 1 else 'act'} at the same time"
        )
    return text + "."


def _in_words(channel: str) -> str:
    return channel.replace("_", " ")
