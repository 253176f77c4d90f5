"""Whole flights: iteration of the effects' increments, and times of the events."""

import dataclasses
from dataclasses import replace

import numpy as np
import pytest
import slow_flight as slow

from edl_filter.effects.base import Effect, EffectInstance
from edl_filter.effects.parameters import Parameter
from edl_filter.effects.registry import find_effect
from edl_filter.errors import InputError
from edl_filter.simulation import motion
from edl_filter.simulation.motion import Course, fly
from edl_filter.simulation.parachute import Parachute

CHUTE = Parachute(15.0)


class Jet(Effect):
    """A force and a moment that oscillate."""

    name = "jet"
    parameters = (Parameter("A", "N m", "amplitude"),)

    def force_moment(self, p, flow):
        wave = p["A"] * np.sin(2.0 * np.pi * 0.7 * flow.time)[:, None]
        return 2.0 * wave * [0.0, 0.0, 1.0], wave * [0.0, 1.0, 0.0]


class Steer(Effect):
    """A moment that depends on the motion: the hardest case for the iteration."""

    name = "steer"
    parameters = (Parameter("k", "", "gain"),)

    def force_moment(self, p, flow):
        push = flow.dynamic_pressure * flow.area * flow.diameter * p["k"]
        lateral = flow.velocity_body / flow.speed[:, None]
        zero = np.zeros_like(push)
        return np.zeros((len(push), 3)), np.column_stack((zero, push * lateral[:, 2], -push * lateral[:, 1]))


HOOKED = {
    "pitching_moment_scale": EffectInstance(find_effect("pitching_moment_scale"), {"k": 0.4}),
    "pitch_damping": EffectInstance(find_effect("pitch_damping"), {"a": -0.6}),
    "rolling_moment": EffectInstance(find_effect("rolling_moment"), {"k": 5e-4, "c": 5e-6}),
    "jet": EffectInstance(Jet(), {"A": 8.0}),
    "steer": EffectInstance(Steer(), {"k": -0.02}),
}


def short_course(seconds):
    """Course of a flight that never deploys its parachute, with a limit of its time."""
    return Course(interval=0.125, substeps=20, deploy_pressure=1e9, surface_radius=1.0, longest=seconds)


def state_after(forward_model, start, seconds, window=1.0):
    """State after some seconds of entry, by the simulator."""
    course = short_course(seconds)
    flight = motion._Flight(motion.tabulate(forward_model, CHUTE), motion.Increments.of(forward_model), course, start)
    while flight.time < seconds - 1e-9:
        flight._window(motion.ENTRY, 1e12, flight._steps(min(window, seconds - flight.time)))
    return flight


@pytest.mark.parametrize("name", HOOKED)
def test_increments_are_those_of_the_loads(name):
    """Against an integration of ForwardModel.loads, effects included, by another method."""
    forward_model = slow.smooth_world().with_effects((HOOKED[name],))
    start = slow.entering(forward_model)
    flight = state_after(forward_model, start, 8.0)
    twin = slow.integrate(forward_model, start, 8.0)
    clean = slow.integrate(forward_model.with_effects(()), start, 8.0)
    off, effect = flight.state[:13] - twin, twin - clean
    for part in (slice(0, 3), slice(3, 6), slice(6, 10), slice(10, 13)):
        assert np.linalg.norm(off[part]) < 1e-4 * np.linalg.norm(effect[part]) + 1e-7, part
    assert 8 <= flight.iterations < 120


def test_windows_leave_no_trace():
    forward_model = slow.smooth_world().with_effects(tuple(HOOKED.values()))
    start = slow.entering(forward_model)
    short, long = (state_after(forward_model, start, 4.0, window).state for window in (0.25, 2.0))
    np.testing.assert_allclose(short[3:13], long[3:13], rtol=0.0, atol=1e-8)
    np.testing.assert_allclose(short[:3], long[:3], rtol=0.0, atol=1e-6)


def test_nothing_is_iterated_without_hooks(mer_flight):
    assert mer_flight.motion.iterations == 0


def test_events_of_a_flight(mer_flight, mer_scenario):
    """Deployment at the pressure, landing at the radius, rest at the end; all on samples."""
    m, forward_model = mer_flight.motion, mer_flight.forward_model
    for event in (m.deployed, m.landed, m.stopped):
        assert event / 0.125 == pytest.approx(round(event / 0.125), abs=1e-9)
    around = np.array([m.deployed - 0.125, m.deployed])
    s = m.at(around)
    q = forward_model.flow(around, s[:, :3], s[:, 3:6], s[:, 6:10], s[:, 10:13]).dynamic_pressure
    assert q[0] > 700.0 >= q[1]
    radius = np.linalg.norm(m.at(np.array([m.landed - 0.125, m.landed]))[:, :3], axis=1)
    assert radius[0] > mer_scenario.landing.surface_radius >= radius[1]
    assert m.time[-1] == pytest.approx(m.stopped + 19.5)
    assert 200.0 < m.deployed < 300.0 < m.landed < 400.0
    last = m.state[-1]
    assert np.linalg.norm(forward_model.planet.velocity_relative(last[:3], last[3:6])) < 1e-5


def test_states_between_steps_are_of_order_four(mer_flight):
    """The states at every second step are interpolated from the others."""
    m = mer_flight.motion
    i = slice(0, 2 * ((len(m.time) - 1) // 2) + 1, 2)
    before, after = m.before[::2], m.after[1::2]
    n = min(len(before), len(after))
    coarse = replace(m, time=m.time[i], state=m.state[i], before=before[:n], after=after[:n])
    middle = m.time[1 : 2 * n : 2]
    calm = middle < m.deployed - 1.0
    states = coarse.at(middle[calm])
    np.testing.assert_allclose(states[:, :3], m.state[1 : 2 * n : 2, :3][calm], rtol=0.0, atol=1e-5)
    np.testing.assert_allclose(states[:, 10:13], m.state[1 : 2 * n : 2, 10:13][calm], rtol=0.0, atol=3e-5)


def test_a_vehicle_that_does_not_come_down_is_refused():
    forward_model = slow.empty(slow.smooth_world())
    with pytest.raises(InputError, match="has not reached the parachute's dynamic pressure"):
        fly(forward_model, CHUTE, slow.entering(forward_model), Course(0.125, 1, 700.0, 3.39e6, longest=100.0))


def test_a_vehicle_that_tumbles_is_refused():
    forward_model = slow.smooth_world(cm=0.0)
    start = slow.entering(forward_model)
    with pytest.raises(InputError, match="the vehicle tumbles"):
        fly(forward_model, CHUTE, start, Course(0.125, 10, 700.0, 3.39e6, longest=500.0))


def test_a_users_hook_is_evaluated_along_the_true_flight():
    """The hook is evaluated in the flow of the flight with the effect, not in that of the nominal one."""
    seen = []

    class Watch(Effect):
        name = "watch"
        parameters = (Parameter("k", "", "any"),)

        def coefficients(self, p, flow, totals):
            seen.append(flow.alpha_total.copy())
            return dataclasses.replace(totals, cm_nose=totals.cm_nose * (1.0 + p["k"]))

    forward_model = slow.smooth_world().with_effects((EffectInstance(Watch(), {"k": 0.5}),))
    flight = state_after(forward_model, slow.entering(forward_model), 1.0)
    state, slope = flight.parts[-1]
    middles = motion.with_middles(flight.step, state, slope)
    flow = forward_model.flow(np.arange(len(middles)) * 0.5 * flight.step, *np.split(middles, [3, 6, 10], axis=1))
    np.testing.assert_allclose(seen[-1][: len(middles)], flow.alpha_total, atol=1e-9)
