"""Smallest sizes that would be found: the equation, and the shipped flight."""

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from typer.testing import CliRunner

from edl_filter.cli import app
from edl_filter.diagnosis.identifiability import _basis, _likeness, smallest_size


@given(st.floats(-6.0, 12.0), st.floats(-4.0, 4.0))
def test_the_smallest_size_gains_six_nats(log_information, log_sigma):
    information, sigma = 10.0**log_information, 10.0**log_sigma
    s = smallest_size(information, sigma)
    gain = 0.5 * s**2 * information - 0.5 * np.log1p(information * sigma**2)
    assert gain == pytest.approx(6.0, abs=1e-4)


def test_no_information_finds_nothing():
    assert smallest_size(0.0, 1.0) == np.inf


def test_spaces_that_share_a_direction_are_alike():
    random = np.random.default_rng(1)
    a = random.normal(size=(200, 2)) * 10.0
    b = np.stack((random.normal(size=200) * 10.0, a @ (1.0, -2.0)), axis=1)
    assert _likeness(_basis(a), _basis(b)) == pytest.approx(1.0, abs=1e-9)
    assert _likeness(_basis(a), _basis(random.normal(size=(200, 2)) * 10.0)) < 0.4
    assert _likeness(_basis(a), _basis(1e-3 * a)) == 0.0  # too small to be seen is like nothing


def test_a_flight_says_what_it_could_find():
    names = ("mass", "axial_force_scale", "gyro_bias", "wind")
    options = [part for name in names for part in ("--effect", name)]
    result = CliRunner().invoke(app, ["identifiability", "builtin:practice_mer", *options, "--json"])
    assert result.exit_code == 0, result.output
    told = {e["effect"]: e for e in json.loads(result.stdout)["effects"]}
    assert list(told) == list(names)
    for name in ("mass", "axial_force_scale"):
        assert told[name]["parameters"]["k"]["ratio"] < 0.1
    assert told["mass"]["confused_with"]["axial_force_scale"] > 0.9
    assert told["gyro_bias"]["confused_with"] == {}
    assert list(told["wind"]["places"]) == ["h_lo", "h_hi"]
    told = CliRunner().invoke(app, ["identifiability", "builtin:practice_mer", "--effect", "mass"]).stdout
    assert "Smallest size that would be found" in told and "A ratio above 1" in told
