"""Whether a hypothesis mends a failing channel."""

from types import SimpleNamespace

import numpy as np
import pytest

from edl_filter.diagnosis import channel_errors
from edl_filter.diagnosis.channel_errors import lessens_its_channel, mends_its_channel, most_lessened


@pytest.mark.parametrize(
    ("before", "after", "mended"),
    [
        ({"force_x": 10.0, "moment_y": 50.0}, {"force_x": 1.0, "moment_y": 50.0}, True),
        ({"force_x": 3.0, "moment_y": 80.0}, {"force_x": 1.0, "moment_y": 20.0}, False),  # not that which it is about
        ({"force_x": 10.0, "moment_y": 50.0}, {"force_x": 12.0, "moment_y": 15.0}, False),  # nine tenths, and fails yet
        ({"force_x": 1.6}, {"force_x": 1.4}, False),  # fails no more, but by next to nothing
        ({"force_x": 1.2}, {"force_x": 1.0}, False),  # nothing failed
        ({"force_x": 9.0}, {}, False),  # not compared any more
    ],
)
def test_a_failing_channel_comes_to_its_noise(monkeypatch, before, after, mended):
    monkeypatch.setattr(channel_errors, "normalised", lambda _: np.zeros(0))
    monkeypatch.setattr(channel_errors, "_scaled", lambda _: np.zeros(0))
    monkeypatch.setattr(channel_errors, "_by_channel", lambda linear, _: {"model": before, "with": after}[linear])
    assert mends_its_channel("model", SimpleNamespace(linear="with")) == mended


def test_what_is_left_of_the_channel_that_it_takes_most_from(monkeypatch):
    monkeypatch.setattr(channel_errors, "normalised", lambda _: np.zeros(0))
    monkeypatch.setattr(channel_errors, "_scaled", lambda _: np.zeros(0))
    for after, lessened in ((15.0, True), (17.0, False)):  # force y comes to its noise in both
        found = {"model": {"moment_x": 80.0, "force_y": 9.0}, "with": {"moment_x": after, "force_y": 1.0}}
        monkeypatch.setattr(channel_errors, "_by_channel", lambda linear, _, f=found: f[linear])
        assert lessens_its_channel("model", SimpleNamespace(linear="with")) == lessened
        assert mends_its_channel("model", SimpleNamespace(linear="with"))


def test_the_channel_that_falls_most(monkeypatch):
    nan = float("nan")
    names = ["moment_x", "force_x", "force_y", "force_z"]
    monkeypatch.setattr(channel_errors, "channels", lambda _: [(name, "") for name in names])
    before = {"moment_x": 11.1, "force_x": 9.0, "force_y": 8.0, "force_z": nan, "altimeter": 20.0, "landing": nan}
    found = [
        most_lessened(SimpleNamespace(linear=None), before, dict(zip(before, after, strict=True)))
        for after in (
            (11.1, 1.0, 0.9, 1.0, 1.0, 1.0),
            (12.0, 9.1, 7.9, nan, 1.0, 1.0),
            (12.0, 9.1, 8.1, nan, 1.0, 1.0),  # no channel's falls
            (12.0, 9.1, 8.1, nan, 20.1, nan),
        )
    ]
    assert found == ["force_x", "force_y", "altimeter", "force_y"]
