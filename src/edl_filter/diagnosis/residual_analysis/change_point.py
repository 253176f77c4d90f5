"""Change points: the times at which channels begin to fail, and at which the model changes abruptly.

Input: a linearised model. Method: for the beginnings, a likelihood-ratio scan of the normalised innovations of each
channel for a larger variance; for an abrupt change, the largest innovations of all forces and moments together: the
nuisance parameters that vary with time or with the flow follow what is missing from some bins after its beginning on,
so that the innovations are largest at the change itself (Willsky and Jones, IEEE Trans. Automatic Control 21 (1976)
108). Output: onsets, each with its channel, time and log-likelihood ratio; times.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from edl_filter.diagnosis.linear_model.linear_model import LinearizedModel
from edl_filter.diagnosis.residual_analysis.residual_map import channels, normalised_innovations
from edl_filter.types import Array, IntArray

#: Rows of a bin that are predicted: forces and steps of the rate; those of the checking IMUs follow.
_PREDICTED = 6


@dataclass(frozen=True)
class Onset:
    """The time at which a channel begins to fail.

    Attributes
    ----------
    channel : str
    time : float
        s.
    gain : float
        Log-likelihood over one variance throughout, nats.
    """

    channel: str
    time: float
    gain: float


def onsets(model: LinearizedModel) -> list[Onset]:
    """Change points of the channels' variances, most likely first; channels without one are left out."""
    normalised, index, settings = normalised_innovations(model), model.index, model.settings
    by_channel = []
    for c, (channel, _) in enumerate(channels(model)):
        used = np.flatnonzero(index.bin_rows[:, c] >= 0)
        if len(used) < 2 * settings.onset_samples:
            continue
        first, gain = variance_change_point(normalised[index.bin_rows[used, c]], settings.onset_samples)
        if gain > settings.onset_nats:
            by_channel.append(Onset(channel, float(model.bins.edges[used[first]]), gain))
    return sorted(by_channel, key=lambda o: -o.gain)


def abrupt_changes(model: LinearizedModel) -> list[float]:
    """Beginnings of the bins with the largest innovations at the stated noise (s), largest first.

    At most `abrupt_changes` of the settings, which lie `abrupt_change_spacing_s` apart; none where no residual has
    excess variance.

    Parameters
    ----------
    model : LinearizedModel
        The linearised model.
    """
    if model.excess_variance.is_zero:
        return []
    settings, bins = model.settings, model.bins
    white = model.white_residuals(model.stated_noise_filter)
    rows = model.index.bin_rows[:, :_PREDICTED]
    size = np.sum(np.where(rows >= 0, white[rows], 0.0) ** 2, axis=1)
    times: list[float] = []
    for k in np.argsort(-size, kind="stable"):
        if len(times) == settings.abrupt_changes or size[k] == 0.0:
            break
        begin = float(bins.edges[k])
        if all(abs(begin - t) >= settings.abrupt_change_spacing_s for t in times):
            times.append(begin)
    return times


def variance_change_point(normalised: Array, shortest: int) -> tuple[int, float]:
    """Index from which normalised innovations have a larger variance, by a likelihood-ratio scan.

    Two variances, the second the larger and neither below the stated 1, are compared with one (Basseville and
    Nikiforov, Detection of Abrupt Changes, 1993, section 2.4).

    Parameters
    ----------
    normalised : (N,) array
        Innovations over their sigma.
    shortest : int
        Least number of samples on either side.

    Returns
    -------
    first : int
    gain : float
        Log-likelihood ratio, nats; 0 without a change.
    """
    n, square = len(normalised), np.concatenate(([0.0], np.cumsum(normalised**2)))
    k = np.arange(shortest, n - shortest + 1)
    before = np.maximum(square[k] / k, 1.0)
    after = np.maximum((square[-1] - square[k]) / (n - k), 1.0)
    constant = max(square[-1] / n, 1.0)

    gain = (
        _negative_log_likelihood(np.array(n), constant, square[-1])
        - _negative_log_likelihood(k, before, square[k])
        - _negative_log_likelihood(n - k, after, square[-1] - square[k])
    )
    gain = np.where(after > before, gain, 0.0)
    best = int(np.argmax(gain))
    return int(k[best]), float(max(gain[best], 0.0))


def _negative_log_likelihood(count: IntArray, variance: Array, total: Array) -> Array:
    """Of normal numbers with a given sum of squares, without a constant."""
    return np.asarray(0.5 * (count * np.log(variance) + total / variance), float)
