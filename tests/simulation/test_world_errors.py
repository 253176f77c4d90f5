"""Differences of the flown world: they are in the flight, and no difference changes no number."""

from dataclasses import replace

import numpy as np

from edl_filter import rotations
from edl_filter.simulation import Scenario, simulate
from edl_filter.simulation.world_errors import WorldErrors


def test_no_difference_is_the_same_flight():
    scenario = Scenario.load("builtin:mer")
    flights = [simulate(scenario, seed=3), simulate(scenario, seed=3, errors=WorldErrors())]
    assert np.array_equal(flights[0].motion.state, flights[1].motion.state)
    force = [f.contents.imus["primary"].specific_force for f in flights]
    assert np.array_equal(*force)


def test_mass_entry_state_and_sensor_errors_differ_as_stated():
    scenario = Scenario.load("builtin:mer")
    start = np.array([100.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.01])
    nominal = simulate(scenario, seed=3)
    flight = simulate(scenario, seed=3, errors=WorldErrors(None, 1.02, 1.1, start, 3.0))
    np.testing.assert_allclose(flight.motion.state[0, :6] - nominal.motion.state[0, :6], start[:6], atol=1e-8)
    turn = rotations.multiply(rotations.conjugate(nominal.motion.state[0, 6:10]), flight.motion.state[0, 6:10])
    np.testing.assert_allclose(rotations.to_rotation_vector(turn), start[6:], atol=1e-12)
    assert flight.forward_model.body.mass == 1.02 * nominal.forward_model.body.mass
    np.testing.assert_allclose(flight.forward_model.body.inertia, 1.1 * nominal.forward_model.body.inertia)
    errors = [f.contents.truth["sensor_errors"]["primary"]["accelerometer_bias"] for f in (nominal, flight)]
    np.testing.assert_allclose(errors[1], 3.0 * errors[0])
    stated = [f.contents.imus["primary"].errors for f in (nominal, flight)]
    assert stated[0] == stated[1]


def test_another_database_is_flown():
    scenario = Scenario.load("builtin:mer")
    nominal = simulate(scenario, seed=3)
    table = nominal.forward_model.database.continuum
    changed = replace(nominal.forward_model.database, continuum=replace(table, CA=1.1 * table.CA))
    flight = simulate(scenario, seed=3, errors=WorldErrors(changed))
    peaks = [np.linalg.norm(f.contents.imus["primary"].specific_force, axis=1)[:1200].max() for f in (nominal, flight)]
    assert peaks[1] != peaks[0] and flight.forward_model.database is changed
