"""Scenario files: the shipped ones load, and errors name file and key."""

import numpy as np
import pytest

from edl_filter.errors import InputError
from edl_filter.simulation import Scenario, simulate

EFFECT = """
import numpy as np
from edl_filter.effects import Effect, Parameter

class Push(Effect):
    name = "push"
    summary = "a constant force"
    parameters = (Parameter("F", "N", "force", 10.0),)

    def force_moment(self, p, flow):
        n = len(flow.time)
        return np.full((n, 3), [0.0, 0.0, p["F"]]), np.zeros((n, 3))
"""


@pytest.mark.parametrize(("name", "interval"), [("mer", 0.125), ("phoenix", 0.05)])
def test_shipped_scenarios_load(name, interval):
    scenario = Scenario.load(f"builtin:{name}")
    assert scenario.name == name and scenario.sampling.interval_s == interval
    assert scenario.model.name == f"practice_{name}"
    assert set(scenario.imus) == {"primary", "secondary"}


@pytest.mark.parametrize(
    ("change", "parts"),
    [
        ("entry.speed=5.6", ("--set entry.speed", "5.6", "km/s")),
        ("entry.sped=1", ("entry.sped", "nearest accepted: entry.speed")),
        ("sampling.substeps=0", ("sampling.substeps", "0")),
        ("landing.stop_s=0.3", ("landing.stop_s", "multiple of sampling.interval_s")),
        ("imus={}", ("imus", "an IMU called primary")),
        ("mission=builtin:nowhere", ("builtin:nowhere", "expected one of")),
        ("effects=[{name: pitch_dampin}]", ("effects.0.name", "pitch_damping")),
        ("effects=[{name: mass, parameters: {q: 1}}]", ("effects.0.parameters.q",)),
        ("effects=[{name: gyro_bias, imu: third}]", ("effects.0.imu", "third", "primary, secondary")),
        ("effects=[{name: push, file: nowhere.py}]", ("effects.0.file", "nowhere.py")),
    ],
)
def test_wrong_keys_are_refused(change, parts):
    with pytest.raises(InputError) as error:
        Scenario.load("builtin:mer", [change]).active_effects()
    for part in parts:
        assert part in str(error.value)


def test_no_such_scenario():
    with pytest.raises(InputError, match="no such scenario; expected one of mer, phoenix"):
        Scenario.load("builtin:beagle")


def test_a_mission_without_aerodynamics_is_refused(tmp_path):
    (tmp_path / "bare.yaml").write_text("aerodynamics: null")
    with pytest.raises(InputError, match=r"bare\.yaml"):
        Scenario.load("builtin:mer", [f"mission={tmp_path / 'bare.yaml'}"])


def test_a_users_effect_is_read_from_the_folder_of_the_scenario(tmp_path):
    (tmp_path / "push.py").write_text(EFFECT)
    shipped = Scenario.load("builtin:mer")
    text = shipped.source.read_text() + "\neffects: [{name: push, file: push.py, parameters: {F: 30.0}}]\n"
    (tmp_path / "mine.yaml").write_text(text)
    scenario = Scenario.load(tmp_path / "mine.yaml")
    flight = simulate(scenario)
    pushed = flight.contents.imus["primary"].specific_force[60:80].mean(axis=0)
    clean = simulate(scenario, ()).contents.imus["primary"].specific_force[60:80].mean(axis=0)
    assert np.linalg.norm(pushed - clean) == pytest.approx(30.0 / 832.0, rel=1e-3)
