"""An effect once more: under its number, the same in all else, and only where it acts at a place."""

import numpy as np
import pytest
from standins import flow

from edl_filter.effects.base import Effect
from edl_filter.effects.instances import MOST, candidates
from edl_filter.effects.parameters import Parameter
from edl_filter.effects.registry import catalogue, find_effect, nameable_in_mission
from edl_filter.errors import InputError


def names(instances):
    return [a.name for a in instances]


def keys(*names):
    """Keys of effects that name no IMU."""
    return {(name, None) for name in names}


def test_what_is_in_the_model_is_candidates_once_more_if_it_acts_at_a_place():
    effects = [find_effect(n) for n in ("mass", "remnant_torque", "wind")]
    assert names(candidates(effects, ())) == ["mass", "remnant_torque", "wind"]
    assert names(candidates(effects, keys("mass", "remnant_torque"))) == ["remnant_torque_2", "wind"]
    assert names(candidates(effects, keys("remnant_torque", "remnant_torque_2"))) == [
        "mass",
        "remnant_torque_3",
        "wind",
    ]
    assert names(candidates(effects, keys("wind", *(f"wind_{n}" for n in range(2, MOST + 1))))) == [
        "mass",
        "remnant_torque",
    ]
    second = find_effect("wind_2")
    assert names(candidates([second], ())) == ["wind_2"] and candidates([second], keys("wind_2")) == []


def test_no_two_of_one_name_are_candidates():
    class Gust(Effect):
        name = "gust"
        parameters = (Parameter("t0", "s", "from", kind="time", scan=5),)

    class SecondGust(Effect):
        name = "gust_2"

    gust, different = Gust(), SecondGust()
    assert candidates([gust, different], keys("gust"))[1].effect is different
    assert names(candidates([gust, different], keys("gust"))) == ["gust_3", "gust_2"]
    wind, second = (find_effect(n) for n in ("wind", "wind_2"))
    assert candidates([wind, second], keys("wind"))[0].effect is second


def test_a_sensor_effect_is_a_candidate_in_every_imu():
    effects = [find_effect(n) for n in ("gyro_bias", "mass", "imu_lever_arm")]
    assert [a.key for a in candidates(effects, keys("gyro_bias"), ["second", "third"])] == [
        ("mass", None), ("imu_lever_arm", None), ("gyro_bias", "second"), ("imu_lever_arm", "second"),
        ("gyro_bias", "third"), ("imu_lever_arm", "third"),
    ]  # fmt: skip
    assert [a.key for a in candidates(effects[:1], {("gyro_bias", "second")}, ["second"])] == [("gyro_bias", None)]


def test_a_further_instance_has_the_name_and_parameters_of_its_effect():
    second = find_effect("remnant_torque_2")
    assert second is find_effect("remnant_torque_2") and second.name == "remnant_torque_2" and second.number == 2
    assert nameable_in_mission(second)
    assert second.parameters == find_effect("remnant_torque").parameters
    assert find_effect("remnant_torque").name == "remnant_torque" and "remnant_torque_2" not in catalogue()


def test_it_acts_as_the_first_does():
    values = {"Cl": 1e-6, "Cm": 1e-3, "Cn": -2e-3, "t0": 0.0, "t1": np.inf}
    first, third = (find_effect(n).force_moment(values, flow()) for n in ("remnant_torque", "remnant_torque_3"))
    assert np.any(first[1])
    np.testing.assert_array_equal(first, third)


@pytest.mark.parametrize("name", ["mass_2", "wind_1", "wind_02", f"wind_{MOST + 1}", "wind_2_2", "wind_"])
def test_what_is_there_only_once_has_no_number(name):
    with pytest.raises(InputError, match=f"found no effect '{name}'"):
        find_effect(name)


def test_a_users_effect_is_there_once_more_as_well(tmp_path):
    path = tmp_path / "gusts.py"
    path.write_text(
        "import numpy as np\nfrom edl_filter.effects import Effect, Parameter\n"
        "class Gust(Effect):\n    name = 'gust'\n"
        "    parameters = (Parameter('v', 'm/s', 'speed', 10.0, low=-99.0, high=99.0),\n"
        "                  Parameter('h', 'm', 'above', kind='altitude', low=0.0, high=1e5, scan=9))\n"
        "    def wind(self, p, altitude):\n"
        "        return np.column_stack([p['v'] * (altitude > p['h']), 0 * altitude])\n"
    )
    second = find_effect("gust_2", path)
    assert second.file == path and nameable_in_mission(second)
    np.testing.assert_allclose(second.wind({"v": 3.0, "h": 1e4}, np.array([0.0, 2e4])), [[0.0, 0.0], [3.0, 0.0]])
    with pytest.raises(InputError, match="gust_9"):
        find_effect("gust_9", path)


def test_an_effect_of_this_session_is_candidates_once_more():
    class SessionEffect(Effect):
        name = "mine"
        parameters = (
            Parameter("a", "", "how much", 0.1, low=-1.0, high=1.0),
            Parameter("t0", "s", "from", kind="time", scan=5),
        )

    effect = SessionEffect()
    assert names(candidates([effect], keys("mine"))) == ["mine_2"] and isinstance(
        candidates([effect], keys("mine"))[0].effect, SessionEffect
    )
