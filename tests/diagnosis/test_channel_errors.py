"""How much of a failing channel a hypothesis explains."""

from types import SimpleNamespace

import numpy as np
import pytest

from edl_filter.diagnosis import channel_errors
from edl_filter.diagnosis.channel_errors import most_explained


@pytest.mark.parametrize(
    ("before", "after", "expected"),
    [
        ({"force_x": 10.0, "moment_y": 50.0}, {"force_x": 1.0, "moment_y": 50.0}, 1.0),
        ({"force_x": 10.0, "moment_y": 50.0}, {"force_x": 12.0, "moment_y": 25.0}, 1.0 - 624.0 / 2499.0),
        ({"force_x": 1.4, "moment_y": 50.0}, {"force_x": 0.9, "moment_y": 60.0}, 1.0 - 3599.0 / 2499.0),
        ({"force_x": 1.2}, {"force_x": 1.0}, 0.0),  # nothing fails
    ],
)
def test_the_best_explained_of_the_channels_that_fail(monkeypatch, before, after, expected):
    monkeypatch.setattr(channel_errors, "normalised", lambda _: np.zeros(0))
    monkeypatch.setattr(channel_errors, "_scaled", lambda _: np.zeros(0))
    monkeypatch.setattr(channel_errors, "_by_channel", lambda linear, _: {"model": before, "with": after}[linear])
    assert most_explained("model", SimpleNamespace(linear="with")) == pytest.approx(expected)
