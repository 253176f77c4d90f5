"""Signatures on the shipped flight: derivatives against differences of differences, and the places that are tried."""

import math
from dataclasses import replace

import numpy as np
import pytest

from edl_filter.diagnosis.case import case_of
from edl_filter.diagnosis.comparison import compare, predicted
from edl_filter.diagnosis.rounds import linearise
from edl_filter.diagnosis.signatures import ordered, places, scale_of, signature
from edl_filter.effects import Active, Effect, Parameter
from edl_filter.effects.catalogue import effect_named


@pytest.fixture(scope="module")
def case(practice_06):
    """The shipped flight."""
    return case_of(practice_06)


@pytest.fixture(scope="module")
def linear(case):
    """The flight, compared with its model."""
    return linearise(case)


def differences(linear, arrange, *effects):
    """All differences with effects in the model, from the same start: the whole chain again."""
    return linear.ground.order.stack(compare(linear.ground.frame, arrange(effects)))


def rows_of(linear, *channels):
    rows = linear.ground.order.bin_rows[:, list(channels)]
    return rows[rows >= 0]


FORCE, MOMENT, OTHER_FORCE, OTHER_RATE = (0, 1, 2), (3, 4, 5), (6, 7, 8), (9, 10, 11)


def test_a_signature_is_minus_the_derivative_of_the_differences(case, linear):
    """Of an effect that leaves the path alone, taken on the path that is there."""
    effect = effect_named("pitching_moment_scale")
    s = signature(linear.ground, Active(effect, {}))
    assert s.names == ("k",) and s.sigma == [0.2] and not s.start.any()
    at = [differences(linear, case.arrange, Active(effect, {"k": k})) for k in (0.0, 1e-3)]
    moved = (at[0] - at[1]) / 1e-3
    assert np.linalg.norm(moved - s.rows[:, 0]) < 1e-3 * np.linalg.norm(moved)
    moments = s.rows[rows_of(linear, *MOMENT), 0]
    assert np.abs(moments).max() > 1e-3  # rad/s a bin for the whole coefficient
    assert np.delete(s.rows[:, 0], rows_of(linear, *MOMENT)) == pytest.approx(0.0, abs=1e-12)


def test_of_an_effect_on_the_path_it_is_taken_on_readings_without_their_own_noise(case, linear):
    effect = effect_named("gyro_scale")
    column = signature(linear.ground, Active(effect, {}), ["sx"]).rows[:, 0]
    at = [differences(linear, case.arrange_quiet, Active(effect, {"sx": s})) for s in (1e-5, -1e-5)]
    np.testing.assert_allclose(column, (at[1] - at[0]) / 2e-5, rtol=1e-3, atol=1e-3 * np.abs(column).max())


@pytest.mark.parametrize(
    "values",
    [{}, {"gyro_scale": {"sx": 0.01}}, {"imu_lever_arm": {"x": 0.1}}, {"imu_time_offset": {"tau": 2e-3}}],
    ids=lambda v: next(iter(v), "none"),
)
def test_quiet_readings_are_cut_and_corrected_as_the_others_are(case, values):
    """They are put together in fewer steps; the samples' edges, and what effects do to them, must be the same."""
    effects = tuple(Active(effect_named(name), v) for name, v in values.items())
    plain, calm = case.arrange(effects), case.arrange_quiet(effects)
    one, other = plain.problem.samples, calm.problem.samples
    np.testing.assert_array_equal(np.isin(one.time, other.time), True)
    assert other.time[0] - other.interval[0] == pytest.approx(plain.problem.initial.time, abs=1e-9)
    same = np.searchsorted(other.time, one.time)
    gap = np.abs(other.mean_force[same] - one.mean_force)
    assert np.median(gap) < 0.01 < np.max(gap)  # they differ by a sample's noise, and by that they do
    assert [r.name for r in plain.checking] == [r.name for r in calm.checking]


@pytest.mark.parametrize("name", ["gyro_bias", "accelerometer_bias"])
def test_an_effect_that_is_an_unknown_as_well_leaves_the_same_mark(linear, name):
    """The biases are states of the filter: white, signature and state must be one, or a small rest looks like evidence.

    Taken through the whole chain by differences they were a thousandth apart, and that was 300 sigmas of a mark of 24.
    """
    effect, at = effect_named(name), linear.unknowns.layout[name]
    s = signature(linear.ground, Active(effect, {}))
    marks = linear.plain(s.rows, s.start) * s.sigma
    unit = np.zeros((linear.unknowns.size, 3))
    unit[at] = np.eye(3)
    states = -linear.plain(np.zeros((len(marks), 3)), unit) * s.sigma
    assert np.linalg.norm(states, axis=0).min() > 5.0
    assert np.linalg.norm(marks - states, axis=0).max() < 0.5


def test_about_another_value_the_derivative_is_taken_there(linear):
    """Force over mass falls with the square of the mass: the slope at ``k`` is that at zero over ``(1 + k)²``."""
    effect = effect_named("mass")
    zero, heavy = (signature(linear.ground, Active(effect, {"k": k})).rows[:, 0] for k in (0.0, 0.25))
    np.testing.assert_allclose(heavy, zero / 1.25**2, rtol=1e-3, atol=1e-9 + 1e-3 * np.abs(zero).max() * 1e-2)
    assert np.abs(zero[rows_of(linear, 0)]).max() > 1.0  # m/s²: the deceleration itself


def test_an_effect_that_is_in_the_model_is_asked_about_its_value(linear):
    """It does not stand beside itself."""
    heavy = Active(effect_named("mass"), {"k": 0.25})
    inside = replace(linear.ground, effects=(heavy,), setup=linear.ground.arrange((heavy,)))
    np.testing.assert_allclose(signature(inside, heavy).rows, signature(linear.ground, heavy).rows, atol=1e-12)


@pytest.mark.parametrize("name", ["density_scale", "atmosphere_rotation", "wind"])
def test_air_acts_by_the_slopes_of_the_unknown_air(linear, name):
    """In the model or not: a density scale is the unknown density everywhere, and must be known no better than that."""
    active = Active(effect_named(name), {"h_lo": 5e3, "h_hi": 60e3} if name == "wind" else {})
    inside = replace(linear.ground, effects=(active,), setup=linear.ground.arrange((active,)))
    rows = signature(linear.ground, active).rows
    np.testing.assert_allclose(signature(inside, active).rows, rows, atol=1e-9 * np.abs(rows).max())
    slopes, order = linear.ground.slopes, linear.ground.order
    if name == "density_scale":
        used = order.bin_rows[:, 0] >= 0
        own = slopes.force[used, 0, slopes.names["density"].start]
        np.testing.assert_allclose(rows[order.bin_rows[used, 0], 0], own, rtol=1e-6)


def test_a_bias_shows_in_its_own_sensor_and_else_by_the_path_alone(linear):
    """What the accelerometers read too much is in the force itself; what it makes of the velocity turns the air."""
    s = signature(linear.ground, Active(effect_named("accelerometer_bias"), {}))
    assert s.names == ("bx", "by", "bz")
    quiet = linear.ground.order.time < 30.0  # before there is air
    assert quiet[linear.ground.order.bin_rows[:, 0]].sum() > 50
    for axis in range(3):
        column = s.rows[:, axis]
        for channel in range(3):
            rows = rows_of(linear, channel)
            expected = float(channel == axis)  # scale and misalignment as they were estimated: some 1e-4
            np.testing.assert_allclose(column[rows[quiet[rows]]], expected, atol=3e-3)
        moments = rows_of(linear, *MOMENT)
        np.testing.assert_allclose(column[moments[quiet[moments]]], 0.0, atol=1e-5)
        np.testing.assert_allclose(column[rows_of(linear, *OTHER_RATE)], 0.0, atol=1e-12)
        for channel in range(3):  # the other instrument is right where the driving one is wrong
            rows = rows_of(linear, OTHER_FORCE[channel])
            np.testing.assert_allclose(column[rows], -float(channel == axis), atol=3e-3)


def test_a_bias_of_the_accelerometers_leaves_what_the_gyros_measured(linear):
    """The moments' rows move because another path is predicted otherwise, and for nothing else."""
    ground, effect = linear.ground, effect_named("accelerometer_bias")
    measured, predictions = [], []
    for bx in (-0.01, 0.01):
        setup = ground.arrange([Active(effect, {"bx": bx})])
        found = compare(ground.frame, setup)
        predictions.append(predicted(setup.world, ground.frame.bins, found.flow, found.tables)[1])
        measured.append(found.turn + predictions[-1])
    np.testing.assert_allclose(measured[0], measured[1], rtol=0.0, atol=1e-14, equal_nan=True)
    assert np.nanmax(np.abs(predictions[0] - predictions[1])) > 1e-6


def test_signatures_of_several_parameters_are_those_of_each(linear):
    effect = effect_named("com_offset")
    whole = signature(linear.ground, Active(effect, {}))
    one = signature(linear.ground, Active(effect, {}), ["dz"])
    assert one.names == ("dz",)
    np.testing.assert_array_equal(one.rows[:, 0], whole.rows[:, whole.names.index("dz")])


def test_a_turned_frame_is_expected_at_the_beginning(linear):
    """The only effect on the start: position and velocity are turned with the frame, and nothing else is."""
    s = signature(linear.ground, Active(effect_named("attitude_frame"), {}), ["rz"])
    nav, layout = linear.ground.point.start.nav, linear.ground.setup.problem.layout
    x, y = nav[:2]
    start = s.start[:, 0]
    assert np.abs(start[layout["position"]]) == pytest.approx(np.abs([y, x, 0.0]), rel=1e-4, abs=1.0)
    assert np.abs(start[layout["velocity"]]) == pytest.approx(np.abs([nav[4], nav[3], 0.0]), rel=1e-4, abs=1e-3)
    assert not start[layout.size :].any()


class Placed(Effect):
    name = "placed"
    parameters = (
        Parameter("a", "N", "how much", 1.0),
        Parameter("h_lo", "m", "from", kind="altitude", low=0.0, high=60e3, scan=4),
        Parameter("h_hi", "m", "to", kind="altitude", low=0.0, high=60e3, scan=4),
        Parameter("t0", "s", "from", kind="time", scan=3),
        Parameter("p", "rad", "where in a wave", kind="phase", low=0.0, high=2.0 * np.pi, scan=6),
        Parameter("m", "", "not scanned", kind="mach", low=1.0, high=25.0, default=7.0),
    )


def test_places_are_a_grid_in_order():
    found = places(Placed(), 60.0, 240.0)
    assert len(found) == math.comb(4, 2) * 3 * 6
    assert all(p["h_lo"] < p["h_hi"] for p in found)
    assert {p["t0"] for p in found} == {60.0, 150.0, 240.0}  # bounds are the flight's
    assert {p["h_lo"] for p in found} == {0.0, 20e3, 40e3} and {p["h_hi"] for p in found} == {20e3, 40e3, 60e3}
    assert {p["m"] for p in found} == {7.0}
    assert sorted({p["p"] for p in found}) == pytest.approx(np.arange(6) * np.pi / 3.0)  # the circle is not closed
    assert all("a" not in p for p in found)


def test_an_effect_without_places_has_one():
    assert places(effect_named("gyro_bias"), 0.0, 1.0) == [{}]


@pytest.mark.parametrize("name", ["wind", "remnant_torque", "density_wave", "static_instability"])
def test_places_of_the_catalogue(name):
    effect = effect_named(name)
    found = places(effect, 60.0, 240.0)
    assert 1 <= len(found) <= math.prod(max(q.scan, 1) for q in effect.places)
    assert len({tuple(p.items()) for p in found}) == len(found)
    assert all(ordered(Active(effect, p)) for p in found)


def test_the_order_of_places():
    effect = Placed()
    assert ordered(Active(effect, {"h_lo": 1.0, "h_hi": 2.0}))
    assert not ordered(Active(effect, {"h_lo": 2.0, "h_hi": 2.0}))
    assert not ordered(Active(effect, {"h_lo": 3.0, "h_hi": 2.0}))


def test_the_scale_of_a_place_is_that_of_a_uniform_one():
    by_name = {q.name: q for q in Placed.parameters}
    draws = np.random.default_rng(0).uniform(0.0, 60e3, 100_000)
    assert scale_of(by_name["h_lo"]) == pytest.approx(draws.std(), rel=0.01)
    assert scale_of(by_name["a"]) == 1.0
    assert np.isfinite(scale_of(by_name["t0"]))
