"""Users' effects: from files and packages, with validation of their declarations and hooks."""

import numpy as np
import pytest
from standins import BODY, PLANET, STATE, H, N, T, flow, totals

from edl_filter.effects import registry
from edl_filter.effects.registry import find_effect
from edl_filter.errors import InputError

START = """
import numpy as np
from dataclasses import replace
from edl_filter.effects import Effect, Parameter

class Mine(Effect):
    name = "mine"
    summary = "one of mine"
    parameters = (Parameter("a", "", "how much", 0.1, low=-1.0, high=1.0),)
"""


def write(tmp_path, body, start=START):
    path = tmp_path / "my_effect.py"
    path.write_text(start + "".join(f"    {line}\n" for line in body.splitlines()))
    return path


def test_a_file_brings_its_effects(tmp_path):
    path = write(tmp_path, "def density(self, p, altitude):\n    return 1.0 + p['a'] * altitude / 1e4")
    effect = find_effect("mine", path)
    assert (effect.name, effect.family, effect.acts("density"), effect.acts("wind")) == ("mine", "user", True, False)
    np.testing.assert_allclose(effect.density({"a": 0.1}, H), 1 + 0.1 * H / 1e4)


def test_a_changed_file_is_read_again(tmp_path):
    path = write(tmp_path, "def atmosphere_rate(self, p):\n    return 1.0 + p['a']")
    assert find_effect("mine", path).atmosphere_rate({"a": 0.5}) == 1.5
    path.write_text(path.read_text().replace("1.0 + p", "1.0 - p") + "\n# changed\n")
    import os

    os.utime(path, ns=(1, 1))
    assert find_effect("mine", path).atmosphere_rate({"a": 0.5}) == 0.5


ARGUMENTS = {
    "imu": (T, np.ones((N, 3)), np.ones((N, 3))), "corrected": (T, np.ones((N, 3)), np.ones((N, 3))),
    "imu_position": (), "gravity": (PLANET,), "atmosphere_rate": (), "wind": (H,), "density": (H,),
    "coefficients": (flow(), totals()), "force_moment": (flow(),), "vehicle": (BODY,), "entry_state": (STATE,),
}  # fmt: skip
GIVEN = {"imu": "time, force, rate", "corrected": "time, force, rate", "gravity": "planet", "wind": "altitude",
         "density": "altitude", "coefficients": "flow, totals", "force_moment": "flow", "vehicle": "body",
         "entry_state": "initial"}  # fmt: skip


def call(tmp_path, hook, body):
    arguments = f", {GIVEN[hook]}" if hook in GIVEN else ""
    path = write(tmp_path, f"def {hook}(self, p{arguments}):\n    {body}")
    return getattr(find_effect("mine", path), hook)({"a": 0.1}, *ARGUMENTS[hook])


@pytest.mark.parametrize("hook", ARGUMENTS)
def test_a_hook_that_raises_is_named_with_the_tracebacks_last_line(tmp_path, hook):
    with pytest.raises(InputError) as caught:
        call(tmp_path, hook, "return np.zeros(3) + p['b']")
    assert str(caught.value) == f"effect 'mine': its hook {hook} raised KeyError: 'b' (my_effect.py, line 11)."


@pytest.mark.parametrize(
    ("hook", "body", "message"),
    [
        ("imu", "return force", "gave ndarray; expected a tuple of force and rate"),
        ("imu", "return force[:2], rate", r"an array of shape \(2, 3\) for force; expected \(7, 3\)"),
        ("corrected", "return force * np.nan, rate", "21 values that are not finite for force"),
        ("imu_position", "return [0.0, 1.0, 2.0]", r"gave list; expected an array of shape \(3,\)"),
        ("gravity", "return 3.0", "gave float; expected a Planet"),
        ("gravity", "return replace(planet, j2=None)", "gave NoneType for j2; expected one number"),
        ("atmosphere_rate", "return np.ones(2)", "gave ndarray; expected one number"),
        ("wind", "return np.zeros(len(altitude))", r"an array of shape \(7,\); expected \(7, 2\)"),
        ("density", "return 1.0", r"gave float; expected an array of shape \(7,\)"),
        ("density", "return np.log(altitude - altitude)", "7 values that are not finite; expected finite numbers"),
        ("coefficients", "return totals.ca", "gave ndarray; expected AeroCoefficients"),
        ("coefficients", "return replace(totals, cl=0.0)", r"gave float for cl; expected an array of shape \(7,\)"),
        ("force_moment", "return np.zeros((7, 3)), None", "gave NoneType for moment"),
        ("vehicle", "return replace(body, mass=-1.0)", "gave a mass of -1 kg; expected a positive one"),
        ("vehicle", "return replace(body, offset=np.zeros(2))", r"shape \(2,\) for offset; expected \(3,\)"),
        ("entry_state", "return initial.position", "gave ndarray; expected an InitialState"),
    ],
)
@pytest.mark.filterwarnings("ignore:divide by zero")
def test_what_a_hook_must_give(tmp_path, hook, body, message):
    with pytest.raises(InputError, match=rf"effect 'mine': its hook {hook} .*{message}"):
        call(tmp_path, hook, body)


def test_an_error_keeps_its_place_through_the_default_inverse(tmp_path):
    path = write(tmp_path, "def imu(self, p, time, force, rate):\n    return 1 / 0")
    with pytest.raises(InputError, match=r"its hook imu raised ZeroDivisionError: division by zero \(my_effect.py"):
        find_effect("mine", path).corrected({"a": 0.1}, *ARGUMENTS["imu"])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x = 1 / 0", r"my_effect.py: raised ZeroDivisionError: division by zero \(my_effect.py, line 1\) when it was"),
        ("def f(:", "my_effect.py: raised SyntaxError"),
        ("x = 1", "found no effect; a subclass of edl_filter.effects.Effect is expected"),
        (START.replace('"mine"', '"my effect"'), "name: found 'my effect'; letters, digits and _"),
        (START.replace('"mine"', '"mime"'), "my_effect.py: found no effect 'mine'; nearest accepted: mime"),
        (START + "    parameters = ('a',)\n", "a tuple of Parameter is expected"),
        (START + "    interpolates_rates = True\n", "interpolates_rates: the hook imu is expected"),
        (START.replace("low=", "kind='big', low="), "parameter a: found the kind 'big'; expected one of size, time"),
        (START.replace("0.1, low", "0.0, low"), "parameter a: a size needs a positive sigma"),
        (START.replace("0.1, low=-1.0", "kind='mach', low=0.5"), "found the default 0; expected between 0.5 and 1"),
        (START + "    def __init__(self):\n        raise OSError('no')\n", "Mine: raised OSError: no"),
    ],
)
def test_a_file_that_cannot_be_used(tmp_path, text, message):
    (tmp_path / "my_effect.py").write_text(text)
    with pytest.raises(InputError, match=message):
        find_effect("mine", tmp_path / "my_effect.py")


def test_a_file_that_is_not_there(tmp_path):
    with pytest.raises(InputError, match="there is no such file; a Python file with an effect is expected"):
        find_effect("mine", tmp_path / "my_effect.py")


class EntryPoint:
    """An entry point with the interface of importlib.metadata."""

    def __init__(self, value, loaded):
        self.name, self.value, self._loaded = "mine", value, loaded

    def load(self):
        if isinstance(self._loaded, Exception):
            raise self._loaded
        return self._loaded


def packages(monkeypatch, *points):
    registry.installed.cache_clear()
    monkeypatch.setattr(registry, "entry_points", lambda group: points if group == "edl_filter.effects" else ())


def test_a_package_brings_effects(tmp_path, monkeypatch):
    effect_class = type(find_effect("mine", write(tmp_path, "")))
    packages(monkeypatch, EntryPoint("package:Mine", effect_class))
    assert find_effect("mine").name == "mine"
    assert find_effect("wind") is registry.catalogue()["wind"]
    with pytest.raises(InputError, match="found no effect 'mime'; nearest accepted: mine"):
        find_effect("mime")
    registry.installed.cache_clear()


@pytest.mark.parametrize(
    ("loaded", "message"),
    [
        (ImportError("no module x"), "raised ImportError: no module x .* when it was loaded"),
        (3, "found 3; a subclass of edl_filter.effects.Effect is expected"),
        (type(find_effect("wind")), "the name 'wind' is taken by the catalogue"),
    ],
)
def test_a_package_that_cannot_be_used(monkeypatch, loaded, message):
    packages(monkeypatch, EntryPoint("package:Mine", loaded))
    with pytest.raises(InputError, match=f"entry point mine = package:Mine: {message}"):
        find_effect("mine")
    registry.installed.cache_clear()
