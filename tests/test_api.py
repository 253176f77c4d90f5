"""The loop in Python, on the flight that the package ships with its oblateness forgotten."""

import matplotlib as mpl
import numpy as np
import pytest
import xarray as xr

import edl_filter
from edl_filter import Effect, InputError, Mission, Parameter, diagnose, effect, reconstruct, refit

mpl.use("agg")

J2 = 1.960454e-3
FEW = ["gravity_oblateness", "gyro_bias"]


class Push(Effect):
    """An effect as a notebook defines it."""

    name = "push"
    summary = "<b>a push</b> along y"
    parameters = (Parameter("F", "N", "force & more", 3.0, low=-50.0, high=50.0),)

    def force_moment(self, p, flow):
        force = np.zeros((len(flow.time), 3))
        force[:, 1] = p["F"]
        return force, np.zeros_like(force)


@pytest.fixture(scope="module")
def mission():
    return Mission.load("builtin:practice_mer", ["planet.gravity.j2=0"])


@pytest.fixture(scope="module")
def flight(mission):
    return reconstruct(mission)


@pytest.fixture(scope="module")
def first(flight):
    return diagnose(flight, FEW)


@pytest.fixture(scope="module")
def better(mission, first):
    return refit(mission.with_effect(first.leader))


def test_all_public_names_are_there():
    for name in edl_filter.__all__:
        assert getattr(edl_filter, name) is not None
        assert name in dir(edl_filter)


def test_the_loop_finds_what_is_missing_and_the_error_falls(first, better):
    assert first.leader.name == "gravity_oblateness"
    (found,) = better.effects
    sigma = better.effect_sigma["gravity_oblateness"]["J2"]
    assert 0.0 < sigma < 1e-4 and abs(found.values["J2"] - J2) < 3.0 * sigma
    second = diagnose(better, [])
    assert second.verdict.verdict == "clean" and second.leader is None
    assert max(second.errors.values()) < 0.5 * max(first.errors.values())
    assert "gravity_oblateness" in repr(better) and "clean" in repr(second)


def test_a_mission_may_be_diagnosed_itself(mission):
    said = []
    found = diagnose(mission, "gyro_bias", progress=said.append)
    assert said[:2] == ["reconstructing", "comparing model and measurements"]
    assert list(found.ranking.trials) == ["gyro_bias"]


def test_improve_goes_round_by_itself(mission):
    one, last = edl_filter.improve(mission, FEW)
    assert one.added.name == "gravity_oblateness" and last.added is None
    after = mission.with_effects(one.improved)
    assert after.active_effects()[0].values["J2"] == pytest.approx(one.improved[0].values["J2"], rel=1e-9)
    assert "gravity_oblateness" in after.text


def test_results_are_xarray(flight, first, tmp_path):
    tree = flight.to_xarray()
    assert isinstance(tree, xr.DataTree) and tree["trajectory"]["altitude"].attrs["units"] == "m"
    flight.save(tmp_path / "out", figures=False)
    again = edl_filter.read_result(tmp_path / "out")
    np.testing.assert_array_equal(again["trajectory"]["altitude"], tree["trajectory"]["altitude"])
    assert flight.summary()["mission"] == "practice_mer"
    residuals = first.residuals
    assert isinstance(residuals, xr.Dataset) and residuals["residual"].dims == ("channel", "time")
    one = residuals["normalised"].sel(channel="moment_y")
    assert float(np.sqrt((one**2).mean())) == pytest.approx(first.errors["moment_y"], rel=0.05)


def test_a_tree_is_ones_own(flight):
    flight.to_xarray()["trajectory"]["altitude"] = 0.0
    assert float(flight.to_xarray()["trajectory"]["altitude"].max()) > 1e5


def test_scan_finds_an_onset(first):
    gains = first.scan("remnant_torque", "t0")
    assert gains.dims == ("t0",) and len(gains) == 40 and gains.attrs["units"] == "nats"
    assert float(gains.max()) < 6.0  # there is no torque on this flight
    few = first.scan("remnant_torque", values=[100.0, 130.0])
    assert few["t0"].values.tolist() == [100.0, 130.0] and few["t0"].attrs["units"] == "s"
    with pytest.raises(InputError, match=r"scan: found no place of mass; accepted: none"):
        first.scan("mass")
    with pytest.raises(InputError, match=r"scan: found Cm of remnant_torque; accepted: t0"):
        first.scan("remnant_torque", "Cm")


class TestMission:
    def test_an_effect_by_name_object_and_class(self, mission):
        by_name = mission.with_effect("com_offset", dy=0.001)
        by_object = mission.with_effect(effect("com_offset").at(dy=0.001))
        assert by_name.text == by_object.text and "dy: 0.001" in by_name.text
        assert mission.active_effects() == ()  # the mission itself stays
        both = by_name.with_effect(Push, F=2.0)
        assert [(a.name, a.values.get("F")) for a in both.active_effects()] == [("com_offset", None), ("push", 2.0)]
        assert "push" not in both.text and both.session_effects[0].name == "push"
        further = both.with_effect("gyro_bias", imu="secondary", fixed=True, bx=1e-6)
        names = {a.name: a for a in further.active_effects()}
        assert set(names) == {"com_offset", "push", "gyro_bias"}
        assert names["gyro_bias"].imu == "secondary" and names["gyro_bias"].fixed

    def test_of_a_file_the_file_is_named(self, mission, tmp_path):
        file = tmp_path / "mine.py"
        file.write_text(
            "from edl_filter.effects import Effect, Parameter\n"
            "class Mine(Effect):\n"
            "    name = 'mine'\n"
            "    parameters = (Parameter('a', 'N', 'how much', 1.0, low=-9.0, high=9.0),)\n"
        )
        there = mission.with_effect(effect("mine", file).at(a=2.0))
        assert there.session_effects == () and "mine.py" in there.text
        assert there.active_effects()[0].values == {"a": 2.0}

    def test_a_result_with_an_effect_of_the_session_is_not_written(self, mission, tmp_path):
        there = reconstruct(mission.with_effect(Push), leave_one_out=False)
        with pytest.raises(InputError, match=r"found the effect push, which lives in this Python session only"):
            there.save(tmp_path / "out")
        assert not (tmp_path / "out").exists()

    @pytest.mark.parametrize(
        ("call", "message"),
        [
            (lambda m: m.with_effect(None), "found no effect; a diagnosis has a leader only where"),
            (lambda m: m.with_effect("com_ofset"), "com_offset"),
            (
                lambda m: m.with_effect("com_offset", dq=1.0),
                "dq: found an unknown key; expected a parameter of com_off",
            ),
            (lambda m: m.with_effect("com_offset", dy=1e9), "dy: found 1e"),
            (lambda m: m.with_effect("mass").with_effect("mass"), "found mass in the mission already"),
            (lambda m: m.with_effect("mass").with_effects(()), "found the effects none; expected first mass"),
            (lambda m: m.with_effect("mass", imu="primary"), "none: mass sits in no IMU"),
            (lambda m: m.with_effect(3), "found 3; expected an effect, its class, or its name"),
            (lambda m: diagnose(m, ["windd"]), "wind"),
            (lambda m: diagnose("builtin:practice_mer"), "found str; expected a Mission, or a Reconstruction of one"),
            (lambda m: effect("mass").at(kk=1.0), "kk: found an unknown key"),
            (
                lambda m: diagnose(Mission.load("builtin:practice_mer", ["aerodynamics=null"])),
                "aerodynamics: found noth",
            ),
        ],
    )
    def test_mistakes_are_one_sentence(self, mission, call, message):
        with pytest.raises(InputError, match=message):
            call(mission)

    def test_a_name_of_the_catalogue_is_taken(self, mission):
        mine = type("Mass", (Push,), {"name": "mass"})
        with pytest.raises(InputError, match="the name 'mass' is taken"):
            mission.with_effect(mine)


class TestEffectsOfTheSession:
    def test_a_hook_that_raises_is_told_by_name(self, flight):
        broken = type("Broken", (Push,), {"name": "broken", "force_moment": lambda self, p, flow: 1 / 0})
        found = diagnose(flight, [broken])
        assert "its hook force_moment raised ZeroDivisionError" in found.ranking.failed["broken"]

    def test_one_is_guarded_once(self):
        from edl_filter.effects.loading import of_session

        once = of_session(Push)
        assert of_session(once) is once and once.acts("force_moment")
        assert of_session(effect("mass")) is effect("mass")


class TestTables:
    def test_text_is_escaped(self):
        shown = Push()._repr_html_()
        assert "&lt;b&gt;a push&lt;/b&gt;" in shown and "force &amp; more" in shown and "<b>" not in shown
        assert "± 3 N" in shown

    def test_they_have_units_and_sigmas_and_no_colours_of_their_own(self, mission, flight, first, better):
        cards = [x._repr_html_() for x in (mission, flight, first, better, effect("mass"), edl_filter.catalogue())]
        for card in cards:
            assert "color:inherit" in card and "color:#" not in card and "white" not in card and "black" not in card
            assert card.count("<table") == card.count("</table>") >= 1
        assert "832 kg" in cards[0] and "altitude (km)" in cards[1] and "±" in cards[1]
        assert "gravity_oblateness" in cards[2] and "nats" in cards[2] and "J2" in cards[2]
        assert "effect in the model" in cards[3] and "J2 0.0019" in cards[3]
        assert "remnant_torque" in cards[5]

    def test_a_representation_is_short(self, flight, first):
        assert max(len(repr(x)) for x in (flight, first, first.leader, flight.plot, first.plot)) < 400
