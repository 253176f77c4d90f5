"""Mission files: every shipped one loads, every kind of fault has its one clear message."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from edl_filter import rotations
from edl_filter.errors import InputError
from edl_filter.mission import Mission, shipped_mission
from edl_filter.mission.messages import keys
from edl_filter.mission.text import parse, set_key

SHIPPED = ("mer_a", "mer_b", "phoenix", "practice_mer", "practice_phoenix")


def load(name="mer_a", *overrides):
    if name == "practice_phoenix":
        overrides = ("telemetry.path=builtin:practice_06", *overrides)
    return Mission.load(f"builtin:{name}", overrides)


def message(*overrides, name="mer_a"):
    with pytest.raises(InputError) as caught:
        load(name, *overrides)
    return str(caught.value)


def data(name="mer_a"):
    return parse(load(name).text, name)


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_missions_load(name):
    mission = load(name)
    assert mission.name == name
    assert mission.source == shipped_mission(name)
    assert mission.atmosphere_path().name == "mars_reference.csv"


def test_an_unknown_shipped_mission_lists_the_known():
    with pytest.raises(InputError, match="builtin:mer_c: found no such mission; expected one of mer_a, mer_b"):
        Mission.load("builtin:mer_c")


def test_numbers_and_derived_values_of_spirit():
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


def test_attitude_error_is_larger_about_the_sun_line():
    m = load("mer_a")
    attitude = rotations.from_rotation_vector([0.3, -1.1, 0.7])
    p = m.initial_state.covariance_matrix(attitude, m.planet.j2000_from_inertial_matrix)
    assert np.array_equal(p[:6, :6], np.diag([1e6] * 3 + [1.0] * 3))
    inertial = m.planet.j2000_from_inertial_matrix.T @ m.initial_state.sun_direction
    sun = rotations.rotate(rotations.conjugate(attitude), inertial)
    across = np.cross(sun, [1.0, 0.0, 0.0]) / np.linalg.norm(np.cross(sun, [1.0, 0.0, 0.0]))
    assert math.sqrt(sun @ p[6:, 6:] @ sun) == pytest.approx(math.radians(0.5))
    assert math.sqrt(across @ p[6:, 6:] @ across) == pytest.approx(math.radians(0.1))


def test_every_key_is_described():
    described = keys(Mission)
    assert not [key for key, text in described.items() if not text]
    assert described["planet.gravity.mu"] == "gravitational parameter, m^3/s^2"
    assert "telemetry.imus.*.gyro_noise" in described


@pytest.mark.parametrize(
    ("override", "found", "expected"),
    [
        ("planet.gravity.mu=42828.37", "42828.37", "m^3/s^2 between 1e10 and 1e18 (is it in km^3/s^2?)"),
        ("planet.gravity.j2=0.2", "0.2", "a number between -0.1 and 0.1"),
        ("planet.gravity.radius=3396.19", "3396.19", "(is it in km?)"),
        ("planet.ellipsoid.equatorial_radius=3396.19", "3396.19", "m between 100000 and 1e8 (is it in km?)"),
        ("planet.ellipsoid.flattening=169.9", "169.9", "a number between 0 and 0.2"),
        ("planet.rotation_rate=0.00406", "0.00406", "(is it in deg/s?)"),
        ("planet.rotation_rate=350.89", "350.89", "(is it in deg/day?)"),
        ("planet.prime_meridian_deg=500", "500.0", "deg between -360 and 360"),
        ("atmosphere.density_sigma=15", "15.0", "(is it in %?)"),
        ("atmosphere.gas_constant=0.189", "0.189", "(is it in kJ/(kg K)?)"),
        ("vehicle.mass=0.827", "0.827", "kg between 1 and 100000 (is it in t?)"),
        ("vehicle.mass=827000", "827000.0", "(is it in g?)"),
        ("vehicle.diameter=2650", "2650.0", "(is it in cm?)"),
        ("telemetry.imus.rover.gyro_noise=0", "0.0", "rad/s above 0 and at most 0.01"),
        ("telemetry.imus.rover.gyro_bias_sigma=1", "1.0", "(is it in deg/h?)"),
        ("telemetry.imus.rover.accelerometer_scale_sigma=300", "300.0", "(is it in ppm?)"),
        ("telemetry.imus.rover.accelerometer_misalignment_sigma=0.5", "0.5", "(is it in deg?)"),
        ("telemetry.imus.rover.position=[-173, 240, 203]", "[-173.0, 240.0, 203.0]", "(is it in mm?)"),
        ("initial_state.position=[-2833.6, -1800.9, -1064.4]", "of length 3522", "(is it in km?)"),
        ("initial_state.position=[1e9, 0, 0]", "1e+09 m from the centre", "m, outside the planet"),
        ("initial_state.velocity=[3.522, -4.166, 1.383]", "of length 5.62", "(is it in km/s?)"),
        ("initial_state.position_sigma=0", "0.0", "m above 0"),
        ("constraints.parachute.dynamic_pressure=0.75", "0.75", "(is it in kPa?)"),
        ("constraints.landing.radius=3392.3", "3392.3", "(is it in km?)"),
        ("constraints.landing.radius=1e7", "10000000.0", "within 10 % of the equatorial radius"),
        ("constraints.landing.latitude_deg=-91", "-91.0", "deg between -90 and 90"),
        ("constraints.rest.velocity_sigma=-1", "-1.0", "m/s above 0"),
        ("filter.alpha=0.001", "0.001", "between 0.1 and 1"),
        ("filter.gate_probability=99.9", "99.9", "(is it in %?)"),
        ("filter.gate_probability=1", "1.0", "at least 0.5 and below 1"),
        ("planet.gravity.mu=.nan", "nan", "a finite number"),
        ("planet.gravity.mu=heavy", "'heavy' (text)", "a number (gravitational parameter, m^3/s^2)"),
        ("planet.gravity=3", "3", "a section of keys"),
        ("outputs.figures=yes", "'yes'", "true or false"),
        ("name=a b", "'a b'", "letters, digits, _ and - only"),
        ("telemetry.spacecraft=3", "3", "1 or 2"),
        ("telemetry.clock.utc=today", "'today'", "a UTC time in ISO 8601"),
        ("initial_state.position=[1, 2]", "[1, 2]", "more entries"),
    ],
)
def test_a_wrong_value_is_named_with_what_is_accepted(override, found, expected):
    key = override.partition("=")[0]
    in_all = key.split(".")[0] in ("planet", "atmosphere", "filter", "outputs", "name")
    text = message(override, name="practice_mer" if in_all else "mer_a")  # the shorter file is the quicker
    assert text.startswith(f"--set {key}: found ")
    assert found in text.split("; expected ")[0]
    assert expected in text.split("; expected ")[1]


@pytest.mark.parametrize(
    ("override", "key", "expected"),
    [
        ("telemetry.imus.rover.spacecraft_from_imu=[0, 0.7, 0.7, 0.5]", "", "a unit quaternion (to 1e-3)"),
        ("initial_state.sun_direction_j2000=[0.6, 0.6, 0.6]", "", "a unit vector"),
        ("planet.j2000_from_inertial=[[1, 0, 0], [0, 1, 0.01], [0, 0, 1]]", "", "orthonormal to 1e-4"),
        ("planet.j2000_from_inertial=[[1, 0, 0], [0, 1, 0], [0, 0, -1]]", "", "right-handed"),
        ("vehicle.inertia={xx: 1, yy: 1, zz: 1, xy: 2}", "", "moments and products of inertia of a body"),
        ("vehicle.inertia={xx: 1, yy: 1, zz: 5}", "", "none above the sum of the other two"),
        ("constraints.rest.end_s=400", ".end_s", "s, after start_s = 470.0"),
        ("constraints.rest.end_s=600", ".end_s", "s within the telemetry used, -300 to 560"),
        ("telemetry.end_s=-301", ".end_s", "s, after start_s = -300.0"),
        ("telemetry.epoch_sclk=126462085400.0", "", "s above 0 and at most 1e10"),
        ("vehicle.events.parachute_deploy.sclk=126462085.0", "", "a time after the epoch at 0 s"),
        ("vehicle.events.landing.sclk=126462400.0", "", "a time after bridle_cut at 342.2 s"),
        ("vehicle.events.landing.time_s=343.75", "", "one of sclk and time_s"),
        ("initial_state.attitude=guess", "", "'onboard'"),
    ],
)
def test_contradictions(override, key, expected):
    text = message(override)
    section = override.partition("=")[0].rpartition(".")[0]
    assert section in text
    assert f"{key}: found " in text
    assert expected in text


@pytest.mark.parametrize(
    ("override", "key", "name"),
    [
        ("planet.prime_meridian_deg=null", "planet.prime_meridian_deg", "mer_a"),
        ("planet.j2000_from_inertial=null", "planet.j2000_from_inertial", "mer_a"),
        ("initial_state.attitude=null", "initial_state.attitude", "mer_a"),
        ("initial_state.velocity_sigma=null", "initial_state.velocity_sigma", "mer_a"),
        ("initial_state.sun_direction_j2000=null", "initial_state.sun_direction_j2000", "mer_a"),
        ("vehicle.parachute=null", "vehicle.parachute.drag_coefficient", "mer_a"),
        ("constraints.altimeter.from=telemetry", "constraints.altimeter", "mer_a"),
        ("initial_state={from: telemetry}", "initial_state", "mer_a"),
        (
            "constraints.onboard_attitude={interval_s: 5, sigma_deg: 1}",
            "constraints.onboard_attitude",
            "practice_mer",
        ),
        ("vehicle.events.landing={sclk: 5, sigma_s: 1}", "vehicle.events.landing.sclk", "practice_mer"),
    ],
)
def test_what_one_section_needs_another_states(override, key, name):
    assert f"{key}: found " in message(override, name=name)


def test_a_stated_covariance_takes_the_place_of_the_sigmas():
    p = np.diag([1e6] * 3 + [1.0] * 3 + [1e-6] * 3)
    stated = data()
    state = stated["initial_state"]
    for key in ("position_sigma", "velocity_sigma", "attitude_sigma_deg"):
        del state[key]
    mission = Mission.from_dict(stated | {"initial_state": state | {"covariance": p}})
    assert np.array_equal(mission.initial_state.covariance_matrix([0, 0, 0, 1]), p)
    p[0, 1] = p[1, 0] = 2e6
    for wrong, expected in (
        (p, "not positive definite"),
        (np.diag([0.0] + [1.0] * 8), "not positive definite"),
        (np.eye(9) + np.eye(9, k=1) / 2, "not symmetric"),
        (np.eye(6), "expected 9 rows of 9 numbers"),
    ):
        with pytest.raises(InputError, match=expected):
            Mission.from_dict(stated | {"initial_state": state | {"covariance": wrong}})
    assert "both this and covariance" in message("initial_state.covariance=" + json.dumps(np.eye(9).tolist()))


@pytest.mark.parametrize(
    ("override", "nearest"),
    [
        ("planet.gravity.j3=0", "--set planet.gravity.j3: found an unknown key; nearest accepted: "),
        ("planet.gravity.j3=0", "nearest accepted: planet.gravity.j2"),
        ("planet.gravty.j2=0", "--set planet.gravty.j2: planet.gravty: found an unknown key; "),
        ("planet.gravty.j2=0", "nearest accepted: planet.gravity"),
        ("telemetry.imus.rover.gyro_nois=1", "nearest accepted: telemetry.imus.rover.gyro_noise"),
        ("j2=0", "nearest accepted: planet.gravity.j2"),
        ("constraints.rest.qqq=0", "accepted here: end_s"),
    ],
)  # fmt: skip
def test_unknown_keys_name_the_nearest(override, nearest):
    assert nearest in message(override)


def test_an_unknown_key_comes_before_the_missing_one_that_it_explains():
    stated = data()
    stated["vehicle"]["masss"] = stated["vehicle"].pop("mass")
    with pytest.raises(InputError) as caught:
        Mission.from_dict(stated, "my.yaml")
    assert str(caught.value) == (
        "my.yaml: vehicle.masss: found an unknown key; nearest accepted: vehicle.mass (and 1 more problem)"
    )


def test_a_missing_key_is_named():
    with pytest.raises(InputError, match=r"telemetry\.path: found nothing; expected a required key \(flight"):
        Mission.load("builtin:practice_phoenix")
    stated = data()
    del stated["planet"]["gravity"]["mu"], stated["vehicle"]["mass"], stated["name"]
    with pytest.raises(InputError, match=r"m: name: found nothing; .*\(and 2 more problems\)$"):
        Mission.from_dict(stated, "m")


def test_formats():
    assert "telemetry: found format: 'x'; expected one of flight-file, mer-imu, phoenix-pds" in message(
        "telemetry.format=x"
    )
    assert "telemetry: found no key format" in message("telemetry={path: x}")


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
def test_text_that_is_no_mission(tmp_path, text, expected):
    file = tmp_path / "m.yaml"
    file.write_text(text)
    with pytest.raises(InputError, match=expected):
        Mission.load(file)


def test_files_that_cannot_be_read(tmp_path):
    with pytest.raises(InputError, match=r"none\.yaml: No such file.*; the path of a mission file is expected"):
        Mission.load(tmp_path / "none.yaml")
    with pytest.raises(InputError, match="the path of a mission file is expected"):
        Mission.load(tmp_path)
    (tmp_path / "m.yaml").write_bytes(b"name: \xff\xfe")
    with pytest.raises(InputError, match="byte 6 is no UTF-8 text"):
        Mission.load(tmp_path / "m.yaml")


def test_scalars_are_those_of_yaml_1_2():
    text = "[1e13, 1.5e-3, 010, 0x1F, 2004-01-04T04:21:21.532, yes, 12:30, ~, true, -.inf, '1e3', 1_0]"
    assert parse(text, "m") == [
        1e13, 1.5e-3, 10, 31, "2004-01-04T04:21:21.532", "yes", "12:30", None, True, -math.inf, "1e3", "1_0",
    ]  # fmt: skip


def test_paths_start_from_the_file_and_in_overrides_from_the_current_folder(tmp_path, monkeypatch):
    there, here = tmp_path / "there", tmp_path / "here"
    for folder in (there, here):
        folder.mkdir()
        (folder / "f.h5").touch()
    file = there / "m.yaml"
    file.write_text(load("practice_mer", "telemetry.path=builtin:x").text.replace("builtin:x", "f.h5"))
    monkeypatch.chdir(here)
    assert Mission.load(file).telemetry_path() == there / "f.h5"
    assert Mission.load(file, ["telemetry.path=f.h5"]).telemetry_path() == here / "f.h5"
    with pytest.raises(InputError, match=r"m\.yaml: telemetry\.path: found .*none\.h5', but there is no file"):
        Mission.load(file, ["telemetry.path=none.h5"]).telemetry_path()
    with pytest.raises(InputError, match=r"table: found 'builtin:venus'; the package ships .*mars"):
        Mission.load(file, ["atmosphere.table=builtin:venus"]).atmosphere_path()
    assert Mission.load(file).output_directory() == Path("results/practice_mer")


def test_telemetry_paths_of_the_formats(tmp_path):
    assert load("practice_mer").telemetry_path().name == "practice_06.h5"
    assert load("mer_a").telemetry_path() is None
    assert load("mer_a", f"telemetry.path={tmp_path}").telemetry_path() == tmp_path
    with pytest.raises(InputError, match=r"this mission needs the raw \(EDR\) IMU product .*edl-filter convert"):
        load("phoenix").telemetry_path()


@pytest.mark.parametrize("override", ["planet", "=1", "planet..j2=1", ".=1"])
def test_overrides_have_a_key_and_a_value(override):
    assert "found no KEY=VALUE; expected for example planet.gravity.j2=0" in message(override)


def test_overrides_below_a_value():
    assert message("name.x=1") == "--set name.x: name is no section, no key can be below it."
    assert "--set planet.name: line 1" in message("planet.name=[")


def test_the_text_after_overrides_keeps_its_comments_and_gives_the_same_mission():
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
    again = Mission.from_dict(parse(mission.text, "again"))
    assert again.model_dump() == mission.model_dump()


NUMBERS = st.integers() | st.floats(allow_nan=False, allow_infinity=False)
TEXT = st.text(st.characters(codec="utf-8", categories=("L", "N", "P", "Zs")), max_size=8)
SCALARS = st.none() | st.booleans() | NUMBERS | TEXT
NAMES = st.sampled_from(["a", "b", "c", "d_1"])
TREES = st.recursive(
    SCALARS,
    lambda below: st.lists(below, max_size=2) | st.dictionaries(NAMES, below, max_size=3),
    max_leaves=8,
)


@settings(max_examples=60, deadline=None)
@given(st.dictionaries(NAMES, TREES, min_size=1), st.lists(NAMES, min_size=1, max_size=3), TREES, st.booleans())
def test_set_key_changes_one_key_and_nothing_else(tree, path, value, flow):
    text = (
        json.dumps(tree, ensure_ascii=False)
        if flow
        else yaml.safe_dump(tree, default_flow_style=False, allow_unicode=True)
    )
    tree = parse(text, "m")
    section = expected = json.loads(json.dumps(tree))
    for part in path[:-1]:
        if section.get(part) is None:
            section[part] = {}
        section = section[part]
        if not isinstance(section, dict):
            with pytest.raises(InputError, match="is no section"):
                set_key(text, ".".join(path), value)
            return
    section[path[-1]] = value
    assert parse(set_key(text, ".".join(path), value), "m") == expected


@pytest.mark.parametrize(
    ("entry", "expected"),
    [
        (
            "{name: gyro_bais}",
            "effects.0.name: found 'gyro_bais'; expected the name of an effect; nearest accepted: gyro_bias",
        ),
        (
            "{name: wind, parameters: {est: 1}}",
            "effects.0.parameters.est: found an unknown key; expected a parameter of wind; nearest accepted: east",
        ),
        ("{name: mass, parameters: {k: 3}}", "effects.0.parameters.k: found 3; expected between -0.5 and 1"),
        ("{name: mass, parameters: {k: .nan}}", "effects.0.parameters.k: found nan; expected a number, or .inf"),
        ("{name: mass, parameters: {k: '1'}}", "effects.0.parameters.k: found '1' (text); expected a number"),
        ("{name: mass, imu: primary}", "effects.0.imu: found 'primary'; expected none: mass sits in no IMU"),
        ("{name: mass, fixed: 1}", "effects.0.fixed: found 1; expected true or false"),
        ("{name: mass, fixd: true}", "effects.0.fixd: found an unknown key; nearest accepted: effects.0.fixed"),
        ("{parameters: {}}", "effects.0.name: found nothing; expected a required key (name in the catalogue"),
    ],
)
def test_effects_that_cannot_be(entry, expected):
    assert f"--set {expected}" in message(f"effects=[{entry}]", name="practice_mer")


def test_effects_are_completed_and_in_order():
    torque = "{name: remnant_torque, parameters: {Cm: 1e-3, t0: 120, t1: .inf}, fixed: true}"
    mission = load("practice_mer", f"effects=[{torque}, {{name: gyro_bias, imu: secondary}}]")
    assert Mission.from_dict(parse(mission.text, "again")).effects == mission.effects
    torque, bias = mission.active_effects()
    assert (torque.name, torque.fixed, torque.imu) == ("remnant_torque", True, None)
    assert torque.values == {"Cl": 0.0, "Cm": 1e-3, "Cn": 0.0, "t0": 120.0, "t1": math.inf}
    assert (bias.name, bias.fixed, bias.imu) == ("gyro_bias", False, "secondary")
    assert bias.values == {"bx": 0.0, "by": 0.0, "bz": 0.0}
    assert load("practice_mer").active_effects() == ()


def test_a_users_effect_starts_from_the_missions_folder(tmp_path):
    (tmp_path / "mine.py").write_text(
        "from edl_filter.effects import Effect, Parameter\n"
        "class Mine(Effect):\n"
        "    name = 'mine'\n"
        "    parameters = (Parameter('a', '', 'how much', 0.1, low=-1.0, high=1.0),)\n"
    )
    path = tmp_path / "m.yaml"
    text = load("practice_mer").text + "effects: [{name: mine, file: mine.py, parameters: {a: 0.2}}]\n"
    path.write_text(text)
    (mine,) = Mission.load(path).active_effects()
    assert mine.name == "mine" and mine.values == {"a": 0.2}
    for old, new, expected in (
        ("a: 0.2", "a: 2", "m.yaml: effects.0.parameters.a: found 2; expected between -1 and 1."),
        ("name: mine", "name: mime", "mine.py: found no effect 'mime'; nearest accepted: mine."),
        ("mine.py", "other.py", "effects.0.file: found 'other.py', but there is no file"),
    ):
        path.write_text(text.replace(old, new))
        with pytest.raises(InputError) as caught:
            Mission.load(path).active_effects()
        assert expected in str(caught.value)
