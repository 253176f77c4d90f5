"""What is left when no name explains it: a missing force and moment against time, and what they follow.

The differences of specific force and of the rate's steps are, up to noise and the little that navigation is wrong, the
missing force and moment themselves. Their largest channel is described: when it acts, at which frequency, and which
quantity of the flight goes with it, so that a person can name it and write the effect.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lombscargle

from edl_filter.diagnosis.linear import Linear
from edl_filter.diagnosis.path import PER_BIN
from edl_filter.diagnosis.where import AXES, normalised

Array = NDArray[np.float64]

#: Length of the pieces in which it is asked whether something acts, s.
_PIECE = 2.5
#: A line stands out if it holds this part of the power.
_LINE = 0.3
#: Turns within the span from which it is one.
_CYCLES = 3.0
#: Correlation from which something is said to follow a quantity.
_FOLLOWS = 0.5


@dataclass(frozen=True)
class Remainder:
    """The largest unexplained channel.

    Attributes
    ----------
    channel : str
    t0, t1 : float
        When it acts, s.
    rms : float
        In sigmas.
    size : float
        RMS, N or N m.
    unit : str
    frequency : float or None
        Hz, if one line holds its power.
    follows : dict
        Quantity → correlation with the channel, or with its size.
    companions : tuple of str
        Other channels that act at the same time.
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


def missing_loads(linear: Linear) -> Array:
    """Missing force (N) and moment (N m) bin by bin, ``(B, 6)``; NaN where nothing is compared."""
    found, world, bins = linear.ground.found, linear.ground.setup.world, linear.bins
    out = np.full((len(bins.interval), 6), np.nan)
    out[:, :3] = found.force * world.rigid_body.mass
    out[:-1, 3:] = (found.turn / bins.interval[:-1, None]) @ world.rigid_body.inertia.T
    out[linear.ground.order.bin_rows[:, :6] < 0] = np.nan
    return out


def describe(linear: Linear) -> Remainder | None:
    """Describe what is left; None where every channel is at its noise."""
    order, bins = linear.ground.order, linear.bins
    scaled = normalised(linear)
    names = [f"force_{a}" for a in AXES] + [f"moment_{a}" for a in AXES]
    spans = [_span(order.bin_rows[:, c], scaled, bins.middle, bins.edges) for c in range(6)]
    sizes = [0.0 if s is None else s[2] for s in spans]
    best = int(np.argmax(sizes))
    if (span := spans[best]) is None:
        return None
    t0, t1, rms = span
    values = missing_loads(linear)[:, best]
    inside = np.isfinite(values) & (bins.middle >= t0) & (bins.middle <= t1)
    time, series = bins.middle[inside], values[inside]
    frequency = _line(time, series)
    follows = _follows(linear, inside, series)
    companions = tuple(
        names[c]
        for c, s in enumerate(spans)
        if s is not None and c != best and min(t1, s[1]) - max(t0, s[0]) > 0.5 * (t1 - t0)
    )
    unit = "N" if best < 3 else "N m"
    size = float(np.sqrt(np.mean(series**2)))
    return Remainder(
        channel=names[best],
        t0=t0,
        t1=t1,
        rms=rms,
        size=size,
        unit=unit,
        frequency=frequency,
        follows=follows,
        companions=companions,
        description=_words(names[best], t0, t1, rms, size, unit, frequency, follows, companions),
    )


def _span(rows: NDArray[np.int64], scaled: Array, middle: Array, edges: Array) -> tuple[float, float, float] | None:
    """Longest time over which a channel fails piece by piece, and its RMS there in sigmas."""
    used = np.flatnonzero(rows >= 0)
    if not len(used):
        return None
    values, time = scaled[rows[used]], middle[used]
    piece = np.floor((time - edges[0]) / _PIECE).astype(int)
    count = np.bincount(piece, minlength=piece[-1] + 1)
    square = np.bincount(piece, values**2, minlength=piece[-1] + 1) / np.maximum(count, 1)
    fails = (count > 4) & (square - 1.0 > 4.0 * np.sqrt(2.0 / np.maximum(count, 1)))
    if not fails.any():
        return None
    # gaps of one piece do not part a span
    closed = fails | (np.roll(fails, 1) & np.roll(fails, -1))
    starts = np.flatnonzero(closed & ~np.concatenate(([False], closed[:-1])))
    stops = np.flatnonzero(closed & ~np.concatenate((closed[1:], [False])))
    longest = int(np.argmax([np.sum(square[a : b + 1] * count[a : b + 1]) for a, b in zip(starts, stops, strict=True)]))
    a, b = starts[longest], stops[longest]
    if b == a:
        return None
    inside = (piece >= a) & (piece <= b)
    return (
        float(edges[0] + a * _PIECE),
        float(edges[0] + (b + 1) * _PIECE),
        float(np.sqrt(np.mean(values[inside] ** 2))),
    )


def _line(time: Array, series: Array) -> float | None:
    """Frequency of a line that holds a good part of the power, Hz; a trend of one or two turns is none."""
    if len(time) < 16:
        return None
    step, span = float(np.median(np.diff(time))), float(time[-1] - time[0])
    frequency = np.arange(_CYCLES / span, 0.5 / step, 0.2 / span)
    centred = series - series.mean()
    power = lombscargle(time, centred, 2.0 * np.pi * frequency, normalize=True)
    k = int(np.argmax(power))
    return float(frequency[k]) if power[k] > _LINE else None


def _follows(linear: Linear, inside: NDArray[np.bool_], series: Array) -> dict[str, float]:
    """Correlation with quantities of the flight; of the size where the sign turns with the body."""
    flow = linear.ground.found.flow
    m = slice(PER_BIN // 2, None, PER_BIN)
    u, v, w = flow.velocity_body[m][inside].T
    q = flow.dynamic_pressure[m][inside]
    signed = {"q": q, "q v/V (flow-fixed, sideways)": q * v / u, "q w/V (flow-fixed, up and down)": q * w / u}
    sized = {"q": q, "alpha_total": flow.alpha_total[m][inside], "Mach": flow.mach[m][inside]}
    found = {f"{n}": _correlation(series, x) for n, x in signed.items()}
    found |= {f"size with {n}": _correlation(np.abs(series), x) for n, x in sized.items()}
    return {n: round(r, 3) for n, r in found.items() if np.isfinite(r)}


def _correlation(a: Array, b: Array) -> float:
    a, b = a - a.mean(), b - b.mean()
    scale = float(np.sqrt((a @ a) * (b @ b)))
    return float(a @ b) / scale if scale > 0.0 else float("nan")


def _words(
    channel: str, t0: float, t1: float, rms: float, size: float, unit: str, frequency: float | None,
    follows: dict[str, float], companions: tuple[str, ...],
) -> str:  # fmt: skip
    text = f"{channel} from {t0:.0f} to {t1:.0f} s: {float(f'{size:.3g}'):g} {unit} RMS, {rms:.3g} times its sigma"
    if frequency is not None:
        text += f"; it oscillates at {frequency:.3f} Hz"
    strong = {n: r for n, r in follows.items() if abs(r) > _FOLLOWS}
    if strong:
        best = max(strong, key=lambda n: abs(strong[n]))
        text += f"; it follows {best} (correlation {strong[best]:+.2f})"
    else:
        text += "; it follows none of q, angle of attack and Mach number"
    if companions:
        text += f"; {', '.join(companions)} {'acts' if len(companions) == 1 else 'act'} at the same time"
    return text + "."
