"""The loop in Python, on the flight that the package ships with no oblateness in the mission."""

import re

import matplotlib as mpl
import numpy as np
import pytest
import xarray as xr

import edl_filter
from edl_filter import (
    Effect,
    InputError,
    Mission,
    Parameter,
    diagnose,
    effect,
    reconstruct,
    refit,
    with_effect,
    with_effects,
)  # fmt: skip

mpl.use("agg")

J2 = 1.960454e-3
CANDIDATES = ["gravity_oblateness", "gyro_bias"]


class Push(Effect):
    """An effect that is defined in a Python session."""

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
def steps(mission):
    """Steps of the loop that `improve` goes through."""
    return list(edl_filter.improve(mission, CANDIDATES))


@pytest.fixture(scope="module")
def diagnosis(mission):
    """The first one of the loop, without the fit and the second one."""
    return diagnose(mission, CANDIDATES)


@pytest.fixture(scope="module")
def improved(mission, diagnosis):
    return refit(with_effect(mission, diagnosis.leader))


def test_all_public_names_can_be_imported():
    for name in edl_filter.__all__:
        assert getattr(edl_filter, name) is not None
        assert name in dir(edl_filter)


def test_only_public_names_are_listed():
    assert dir(edl_filter) == sorted(edl_filter.__all__)


def test_a_leader_prints_its_parameters_with_units(diagnosis):
    text = repr(diagnosis.leader)
    match = re.fullmatch(r"<gravity_oblateness: J2 (0\.00\d+)>", text)
    assert match and abs(float(match[1]) - 1.960454e-3) < 3.0 * 5.6e-5, text  # three of the diagnosis's sigmas
    wind = effect("wind").at(east=-30.0, h_lo=7e3)
    assert repr(wind) == "<wind: east -30 m/s, north 0 m/s, h_lo 7000 m, h_hi 25000 m>"
    bias = with_effect(Mission.load("builtin:practice_mer"), "gyro_bias", imu="secondary", fixed=True, bx=1e-5)
    assert repr(bias.active_effects()[0]) == "<gyro_bias in secondary: bx 1e-05 rad/s, by 0 rad/s, bz 0 rad/s; fixed>"


def test_all_variables_have_units_and_those_of_the_cf_table_their_name(flight):
    assert ".to_xarray()" in repr(flight)
    tree = flight.to_xarray()
    for path, node in tree.subtree_with_keys:
        for name, variable in node.variables.items():
            assert "long_name" in variable.attrs, (path, name)
            assert variable.dtype.kind in "OTU" or {"units"} <= {*variable.attrs, *variable.encoding}, (path, name)
    names = {n: v.attrs.get("standard_name") for n, v in tree["trajectory"].variables.items()}
    assert (names["latitude"], names["density"], names["mach"]) == ("latitude", "air_density", None)
    assert tree["postflight/atmosphere/flight"]["temperature"].attrs["standard_name"] == "air_temperature"


@pytest.mark.slow
def test_the_loop_identifies_the_missing_effect_and_the_error_falls(steps, diagnosis, improved):
    assert diagnosis.leader.name == steps[0].diagnosis.leader.name == "gravity_oblateness"
    (oblateness,) = improved.effects
    sigma = improved.refit.sigma["gravity_oblateness"]["J2"]
    assert 0.0 < sigma < 1e-4 and abs(oblateness.values["J2"] - J2) < 3.0 * sigma
    second = steps[1].diagnosis
    assert second.verdict.verdict == "clean" and second.leader is None
    assert max(second.errors.values()) < 0.5 * max(diagnosis.errors.values())
    assert "gravity_oblateness" in repr(improved) and "clean" in repr(second)


def test_a_mission_is_reconstructed_and_diagnosed(mission):
    messages = []
    diagnosis = diagnose(mission, "gyro_bias", progress=messages.append)
    assert messages[:2] == ["reconstructing", "comparing model and measurements"]
    assert list(diagnosis.ranking.screening) == [("gyro_bias", None), ("gyro_bias", "secondary")]


@pytest.mark.slow
def test_improve_repeats_diagnosis_and_fit(mission, steps, improved):
    step, last = steps
    assert step.added.name == "gravity_oblateness" and last.added is None
    by_improve = with_effects(mission, step.improved)
    (estimate,) = (a.values["J2"] for a in by_improve.active_effects())
    assert estimate == pytest.approx(step.improved[0].values["J2"], rel=1e-9)
    assert estimate == pytest.approx(improved.effects[0].values["J2"], rel=1e-3)  # that of `refit`, from another start
    assert "gravity_oblateness" in by_improve.text


def test_results_are_xarray(flight, diagnosis, tmp_path):
    tree = flight.to_xarray()
    assert isinstance(tree, xr.DataTree) and tree["trajectory"]["altitude"].attrs["units"] == "m"
    flight.save(tmp_path / "out", figures=False)
    written = edl_filter.read_result(tmp_path / "out")
    np.testing.assert_array_equal(written["trajectory"]["altitude"], tree["trajectory"]["altitude"])
    assert flight.summary()["mission"] == "practice_mer"
    residuals = diagnosis.residuals
    assert isinstance(residuals, xr.Dataset) and residuals["residual"].dims == ("channel", "time")
    moment = residuals["normalised"].sel(channel="moment_y")
    assert float(np.sqrt((moment**2).mean())) == pytest.approx(diagnosis.errors["moment_y"], rel=0.05)


def test_a_changed_tree_does_not_change_the_result(flight):
    flight.to_xarray()["trajectory"]["altitude"] = 0.0
    assert float(flight.to_xarray()["trajectory"]["altitude"].max()) > 1e5


def test_scan_gives_the_evidence_of_onsets(diagnosis):
    gains = diagnosis.scan("remnant_torque", "t0")
    assert gains.dims == ("t0",) and len(gains) == 40 and gains.attrs["units"] == "nats"
    assert float(gains.max()) < 6.0  # no torque acts on this flight
    two = diagnosis.scan("remnant_torque", values=[100.0, 130.0])
    assert two["t0"].values.tolist() == [100.0, 130.0] and two["t0"].attrs["units"] == "s"
    with pytest.raises(InputError, match=r"scan: found no place of mass; accepted: none"):
        diagnosis.scan("mass")
    with pytest.raises(InputError, match=r"scan: found Cm of remnant_torque; accepted: t0"):
        diagnosis.scan("remnant_torque", "Cm")


class TestMission:
    def test_an_effect_by_name_object_and_class(self, mission):
        by_name = with_effect(mission, "com_offset", dy=0.001)
        by_object = with_effect(mission, effect("com_offset").at(dy=0.001))
        assert by_name.text == by_object.text and "dy: 0.001" in by_name.text
        assert mission.active_effects() == ()  # the mission itself is not changed
        both = with_effect(by_name, Push, F=2.0)
        assert [(a.name, a.values.get("F")) for a in both.active_effects()] == [("com_offset", None), ("push", 2.0)]
        assert "push" not in both.text and both.session_effects[0].name == "push"
        three = with_effect(both, "gyro_bias", imu="secondary", fixed=True, bx=1e-6)
        effects = {a.name: a for a in three.active_effects()}
        assert set(effects) == {"com_offset", "push", "gyro_bias"}
        assert effects["gyro_bias"].imu == "secondary" and effects["gyro_bias"].fixed

    def test_of_a_file_the_file_is_named(self, mission, tmp_path):
        file = tmp_path / "mine.py"
        file.write_text(
            "from edl_filter.effects import Effect, Parameter\n"
            "class Mine(Effect):\n"
            "    name = 'mine'\n"
            "    parameters = (Parameter('a', 'N', 'how much', 1.0, low=-9.0, high=9.0),)\n"
        )
        extended = with_effect(mission, effect("mine", file).at(a=2.0))
        assert extended.session_effects == () and "mine.py" in extended.text
        assert extended.active_effects()[0].values == {"a": 2.0}

    def test_a_result_with_an_effect_of_the_session_is_not_written(self, mission, tmp_path):
        result = reconstruct(with_effect(mission, Push), leave_one_out=False)
        with pytest.raises(InputError, match=r"found the effect push, which exists in this Python session only"):
            result.save(tmp_path / "out")
        assert not (tmp_path / "out").exists()

    @pytest.mark.parametrize(
        ("call", "message"),
        [
            (lambda m: with_effect(m, None), "found no effect; a diagnosis has a leader only where"),
            (lambda m: with_effect(m, "com_ofset"), "com_offset"),
            (
                lambda m: with_effect(m, "com_offset", dq=1.0),
                "dq: found an unknown key; expected a parameter of com_off",
            ),
            (lambda m: with_effect(m, "com_offset", dy=1e9), "dy: found 1e"),
            (lambda m: with_effect(with_effect(m, "mass"), "mass"), "found mass in the mission already"),
            (lambda m: with_effects(with_effect(m, "mass"), ()), "found the effects none; expected first mass"),
            (lambda m: with_effect(m, "mass", imu="primary"), "none: mass sits in no IMU"),
            (lambda m: with_effect(m, 3), "found 3; expected an effect, its class, or its name"),
            (lambda m: diagnose(m, ["windd"]), "wind"),
            (lambda m: diagnose("builtin:practice_mer"), "found str; expected a Mission, or a Result of one"),
            (lambda m: effect("mass").at(kk=1.0), "kk: found an unknown key"),
            (
                lambda m: diagnose(Mission.load("builtin:practice_mer", ["aerodynamics=null"])),
                "aerodynamics: found noth",
            ),
        ],
    )
    def test_a_mistake_raises_one_sentence(self, mission, call, message):
        with pytest.raises(InputError, match=message):
            call(mission)

    def test_a_name_of_the_catalogue_is_refused(self, mission):
        renamed = type("Mass", (Push,), {"name": "mass"})
        with pytest.raises(InputError, match="the name 'mass' is taken"):
            with_effect(mission, renamed)


class TestEffectsOfTheSession:
    @pytest.mark.slow
    def test_a_hook_that_raises_is_reported_by_name(self, flight):
        broken = type("Broken", (Push,), {"name": "broken", "force_moment": lambda self, p, flow: 1 / 0})
        diagnosis = diagnose(flight, [broken])
        assert "its hook force_moment raised ZeroDivisionError" in diagnosis.ranking.failed["broken"]

    def test_an_effect_is_guarded_once(self):
        from edl_filter.effects.registry import validated_effect

        guarded = validated_effect(Push)
        assert validated_effect(guarded) is guarded and guarded.acts("force_moment")
        assert validated_effect(effect("mass")) is effect("mass")


class TestTables:
    def test_text_is_escaped(self):
        html = Push()._repr_html_()
        assert "&lt;b&gt;a push&lt;/b&gt;" in html and "force &amp; more" in html and "<b>" not in html
        assert "± 3 N" in html

    def test_cards_have_units_and_sigmas_and_inherit_colours(self, mission, flight, diagnosis, improved):
        cards = [
            x._repr_html_() for x in (mission, flight, diagnosis, improved, effect("mass"), edl_filter.catalogue())
        ]
        for card in cards:
            assert "color:inherit" in card and "color:#" not in card and "white" not in card and "black" not in card
            assert card.count("<table") == card.count("</table>") >= 1
        assert "832 kg" in cards[0] and "altitude (km)" in cards[1] and "±" in cards[1]
        assert "gravity_oblateness" in cards[2] and "nats" in cards[2] and "J2" in cards[2]
        estimate = re.search(r"J2 (0\.00\d+) ± (0\.0000\d+)<", cards[3])
        assert "effect in the model" in cards[3] and estimate, cards[3]
        assert abs(float(estimate[1]) - J2) < 3.0 * float(estimate[2]) < 3.0e-4
        assert "remnant_torque" in cards[5]

    def test_a_representation_is_short(self, flight, diagnosis):
        assert max(len(repr(x)) for x in (flight, diagnosis, diagnosis.leader, flight.plot, diagnosis.plot)) < 400


def test_public_names_do_not_depend_on_the_order_of_imports():
    import edl_filter.errors
    import edl_filter.results.result

    assert edl_filter.reconstruct is edl_filter.results.result.reconstruct
    assert edl_filter.InputError is edl_filter.errors.InputError
    assert set(edl_filter.__all__) <= set(dir(edl_filter))
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = edl_filter.nothing
