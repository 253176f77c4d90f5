"""Smallest detectable sizes: the equation, correlated effects, and the shipped flight."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from edl_filter.cli import app
from edl_filter.diagnosis.detectability import _basis, _largest_correlation


def test_the_largest_correlation_of_two_column_spaces():
    random = np.random.default_rng(1)
    a = random.normal(size=(200, 2)) * 10.0
    b = np.stack((random.normal(size=200) * 10.0, a @ (1.0, -2.0)), axis=1)
    assert _largest_correlation(_basis(a), _basis(b)) == pytest.approx(1.0, abs=1e-9)  # a common direction
    assert _largest_correlation(_basis(a), _basis(random.normal(size=(200, 2)) * 10.0)) < 0.4
    assert _largest_correlation(_basis(a), _basis(1e-3 * a)) == 0.0  # below the noise there is no direction


@pytest.mark.slow
def test_the_shipped_flight():
    names = ("mass", "axial_force_scale", "gyro_bias", "wind")
    options = [part for name in names for part in ("--effect", name)]
    result = CliRunner().invoke(app, ["identifiability", "builtin:practice_mer", *options, "--json"])
    assert result.exit_code == 0, result.output
    effects = {e["effect"]: e for e in json.loads(result.stdout)["effects"] if e["imu"] is None}
    assert list(effects) == list(names)
    for name in ("mass", "axial_force_scale"):
        assert effects[name]["parameters"]["k"]["ratio"] < 0.1
    assert effects["mass"]["confused_with"]["axial_force_scale"] > 0.9
    assert effects["gyro_bias"]["confused_with"] == {}
    assert list(effects["wind"]["places"]) == ["h_lo", "h_hi"]
    text = CliRunner().invoke(app, ["identifiability", "builtin:practice_mer", "--effect", "mass"]).stdout
    assert "Smallest size that would be named" in text and "A ratio above 1" in text


def test_the_required_gain_is_a_setting():
    """Sizes increase with it."""
    sizes = []
    for gain in (6.0, 24.0):
        options = ["--effect", "mass", "--set", f"diagnosis.named_gain_nats={gain}", "--json"]
        result = CliRunner().invoke(app, ["identifiability", "builtin:practice_mer", *options])
        assert result.exit_code == 0, result.output
        sizes.append(json.loads(result.stdout)["effects"][0]["parameters"]["k"]["smallest"])
    assert 1.2 < sizes[1] / sizes[0] < 2.0
