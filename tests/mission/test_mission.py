"""Missions: every shipped mission loads; values, paths and overrides."""

import math
from pathlib import Path

import numpy as np
import pytest
from shipped_missions import load

from edl_filter.errors import InputError
from edl_filter.mission import Mission, shipped_mission
from edl_filter.mission.yaml_text import parse

SHIPPED = ("mer_a", "mer_b", "phoenix", "practice_mer", "practice_phoenix")


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_missions_load(name):
    mission = load(name)
    assert mission.name == name
    assert mission.source == shipped_mission(name)
    assert mission.atmosphere_path().name == "mars_reference.csv"


def test_stated_and_derived_values_of_spirit():
    m = load("mer_a")
    assert m.telemetry.epoch_utc == "2004-01-04T04:19:51.932"
    assert list(m.telemetry.imus) == ["backshell", "rover"]
    assert m.event_times()["parachute_deploy"] == pytest.approx(251.1, abs=1e-6)
    assert m.planet.prime_meridian == math.radians(50.6294)
    landing = m.constraints.landing
    assert np.linalg.norm(landing.position) == pytest.approx(3392300.0)
    assert landing.latitude == pytest.approx(math.radians(-14.5692))
    for matrix in (m.planet.j2000_from_inertial_matrix, m.telemetry.velocity_register.frame_matrix):
        np.testing.assert_allclose(matrix @ matrix.T, np.eye(3), atol=1e-14)
    for imu in m.telemetry.imus.values():
        assert np.linalg.norm(imu.spacecraft_from_imu_quaternion) == pytest.approx(1.0, abs=1e-15)
    assert m.telemetry.imus["rover"].errors.gyro_bias == 4.8e-5
    assert np.linalg.norm(m.initial_state.position) == pytest.approx(3522.2e3, abs=1.0)


def test_opportunity_has_the_published_entry_state():
    m = load("mer_b")
    assert np.linalg.norm(m.initial_state.position) == pytest.approx(3522200.0, abs=1.0)
    assert np.linalg.norm(m.initial_state.velocity) == pytest.approx(5700.03, abs=0.05)
    assert m.telemetry.epoch_utc == "2004-01-25T04:48:41.789"
    assert m.event_times()["landing"] == pytest.approx(340.925, abs=1e-6)


def test_planet_model():
    planet = load("mer_a").planet_model()
    assert planet.prime_meridian_at_epoch == math.radians(50.6294)
    practice = load("practice_mer", "planet.gravity.j2=0")
    assert practice.planet_model(0.5).prime_meridian_at_epoch == 0.5
    assert practice.planet_model(0.5).j2 == 0.0
    with pytest.raises(InputError, match=r"planet\.prime_meridian_deg: found nothing"):
        practice.planet_model()


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("name: x\nplanet: [1, 2\n", r"m\.yaml: line \d: .*YAML is expected"),
        ("name: x\n\tplanet: 1\n", r"m\.yaml: line 2: "),
        ("name: x\ntitle: a\nname: y\n", r"m\.yaml: line 3: key 'name' stands twice"),
        ("a: &x 1\nb: *x\n", r"m\.yaml: line 1: anchors and aliases"),
        ("a: !!python/object:os.system 1\n", r"m\.yaml: line 1: could not determine a constructor"),
        ("1: 2\n", r"m\.yaml: line 1: key '1' is no text"),
        ("- 1\n", r"m\.yaml: found a list; expected a mapping of keys"),
        ("", r"m\.yaml: found nothing; expected a mapping of keys"),
        ("a: \x01\n", r"m\.yaml: .*YAML is expected"),
    ],
)
def test_invalid_text_is_refused(tmp_path, text, expected):
    file = tmp_path / "m.yaml"
    file.write_text(text)
    with pytest.raises(InputError, match=expected):
        Mission.load(file)


def test_relative_paths_start_from_the_missions_folder_or_in_overrides_from_the_current_one(tmp_path, monkeypatch):
    mission_folder, current_folder = tmp_path / "mission", tmp_path / "current"
    for folder in (mission_folder, current_folder):
        folder.mkdir()
        (folder / "f.h5").touch()
    file = mission_folder / "m.yaml"
    file.write_text(load("practice_mer", "telemetry.path=builtin:x").text.replace("builtin:x", "f.h5"))
    monkeypatch.chdir(current_folder)
    assert Mission.load(file).telemetry_path() == mission_folder / "f.h5"
    assert Mission.load(file, ["telemetry.path=f.h5"]).telemetry_path() == current_folder / "f.h5"
    with pytest.raises(InputError, match=r"m\.yaml: telemetry\.path: found .*none\.h5', but there is no file"):
        Mission.load(file, ["telemetry.path=none.h5"]).telemetry_path()
    with pytest.raises(InputError, match=r"table: found 'builtin:venus'; the package ships .*mars"):
        Mission.load(file, ["atmosphere.table=builtin:venus"]).atmosphere_path()
    assert Mission.load(file).output_directory() == Path("results/practice_mer")


def test_telemetry_path_of_each_format(tmp_path):
    assert load("practice_mer").telemetry_path().name == "practice_06.h5"
    assert load("mer_a").telemetry_path() is None
    assert load("mer_a", f"telemetry.path={tmp_path}").telemetry_path() == tmp_path
    with pytest.raises(InputError, match=r"this mission needs the raw \(EDR\) IMU product .*edl-filter convert"):
        load("phoenix").telemetry_path()


def test_text_after_overrides_keeps_comments_and_describes_the_same_mission():
    mission = load(
        "mer_a",
        "planet.gravity.j2=0",
        "constraints.landing=null",
        "outputs={}",
        "vehicle.inertia.xx=1",
        "vehicle.inertia={xx: 2, yy: 2, zz: 2}",
    )
    assert mission.planet.gravity.j2 == 0.0
    assert mission.constraints.landing is None
    assert "# m^3/s^2, body of Mars" in mission.text
    reparsed = Mission.from_dict(parse(mission.text, "reparsed"))
    assert reparsed.model_dump() == mission.model_dump()
