"""The point about which everything is linear: where it goes, that it stays there, and what it leaves alone."""

from dataclasses import replace

import h5py
import numpy as np
import pytest

from edl_filter import Mission
from edl_filter.diagnosis import deviating
from edl_filter.diagnosis.case import case_of, load_case
from edl_filter.diagnosis.linear import about
from edl_filter.diagnosis.point import first_point, told
from edl_filter.diagnosis.rounds import linearise
from edl_filter.simulation import Scenario, simulate


@pytest.fixture(scope="module")
def case(practice_06):
    """The shipped flight."""
    return case_of(practice_06)


@pytest.fixture(scope="module")
def rounds(case):
    """The flight about where the reconstruction says, and about where everything says."""
    return linearise(case), linearise(case, rounds=4)


def going(linear, whiten=None, **options):
    whiten = whiten or linear.plain
    return told(linear, linear.ground.point, linear.start, whiten, linear.white(whiten), **options)


def spread(linear):
    return np.sqrt(np.diag(linear.plain.start_covariance(linear.unknowns.layout.size)))


def test_the_first_point_is_the_reconstruction(case):
    point = first_point(case.reconstruction)
    assert point.deviation is None
    np.testing.assert_array_equal(point.start.nav, case.reconstruction.smoothed.states[0].nav)
    np.testing.assert_array_equal(point.errors[0], point.start.errors)


def test_where_the_rounds_end_it_stays(rounds):
    """In sigmas of what is known at the beginning, and of what the mission states of the air."""
    first, last = (np.abs(going(x).start.minus(x.ground.point.start) / spread(x)).max() for x in rounds)
    assert last < 0.3 < first
    point = rounds[1].ground.point
    assert deviating.moved(point.deviation, going(rounds[1]).deviation, rounds[1].sigma) < 0.3
    assert deviating.moved(None, point.deviation, rounds[1].sigma) > 0.5  # this flight's air is not the table's


def test_what_the_flight_tells_of_the_air_is_true(tmp_path):
    """A simulated flight knows its own density: about its point the model's is nearer to it than the table's."""
    path = simulate(Scenario.load("builtin:mer"), (), 7).write(tmp_path / "flight.h5")
    linear = linearise(load_case(Mission.load("builtin:practice_mer", [f"telemetry.path={path}"]), ()), rounds=4)
    with h5py.File(path) as file:
        truth = {name: file["truth"][name][:] for name in ("time", "density")}
    flow = linear.ground.found.flow
    felt = flow.dynamic_pressure > 100.0
    true = np.interp(flow.time[felt], truth["time"], np.log(truth["density"]))
    table = np.log(linear.ground.setup.world.atmosphere.density(flow.altitude[felt]))
    assert np.std(np.log(flow.density[felt]) - true) < 0.5 * np.std(table - true)


def test_the_onboard_attitude_can_be_left_alone(spirit):
    linear = linearise(case_of(spirit))
    layout, point = linear.unknowns.layout, linear.ground.point
    left, whole = (going(linear, linear.soft, onboard=o).start.minus(point.start) for o in (False, True))
    own = np.zeros(layout.size, bool)
    for name in ("onboard_rate", "onboard_mounting", "onboard_attitude"):
        own[layout[name]] = True
    assert not left[own].any() and whole[own].any()
    np.testing.assert_allclose(left[~own], whole[~own])


def test_what_is_beyond_belief_is_no_point(spirit):
    """At the sensors' own noise alone Spirit's proxy database would put the start a hundred stated sigmas away."""
    linear = linearise(case_of(spirit))
    assert going(linear) is None
    assert going(linear, linear.soft) is not None


def test_an_offset_undoes_a_small_deviation(case, rounds):
    """The unknowns count from what the mission states: about another point the differences stay, to first order."""
    linear = rounds[0]
    point = linear.ground.point
    n = len(linear.bins.middle)
    shift = {"density": 1e-4, "wind": 1e-2, "ca": 1e-2, "cn": 1e-2, "cm": 1e-2, "mass": 1e-6, "inertia": 1e-6}
    ones = {k: np.full((n, 2) if k == "wind" else n, v) for k, v in shift.items() if k not in ("mass", "inertia")}
    air = deviating.Deviation(
        linear.bins.edges[1:], mass=shift["mass"], inertia=shift["inertia"], units=linear.units, **ones
    )
    there = about(case, replace(point, deviation=air))
    plain = there.ground.order.stack(there.ground.found)
    changed = np.linalg.norm(plain - linear.column)
    assert changed > 1e-2
    assert np.linalg.norm(there.column - linear.column) < 1e-2 * changed
