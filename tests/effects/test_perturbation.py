"""Perturbations of the forward model change the stated quantities, and only these."""

from dataclasses import replace

import numpy as np
import pytest

from edl_filter.effects.perturbation import CoefficientUnits, Perturbation
from edl_filter.pipeline.forward_model import forward_model_of


@pytest.fixture(scope="module")
def world(practice_06):
    """The shipped mission's world."""
    r = practice_06
    return forward_model_of(r.mission, r.planet, r.atmosphere, ())


def perturbation(**changes):
    nothing = {name: np.zeros(2) for name in ("density", "ca", "cn", "cm")}
    time, ones = np.array([0.0, 200.0]), np.ones(2)
    units = CoefficientUnits(time, ca=ones, cn=ones, cm=ones)
    return replace(Perturbation(time=time, wind=np.zeros((2, 2)), units=units, **nothing), **changes)


def met(world, r):
    """The flow where the shipped flight is fast and the air is thick."""
    nodes = zip(r.filter_pass.nodes, r.smoothed.states, strict=True)
    states = [(node.time, state.nav) for node, state in nodes if 100.0 < node.time < 150.0]
    time, nav = (np.array(x) for x in zip(*states, strict=True))
    return world.flow(time, nav[:, :3], nav[:, 3:6], nav[:, 6:10], np.zeros((len(nav), 3)))


def test_none_changes_nothing(world, practice_06):
    flow, perturbed = met(world, practice_06), met(replace(world, perturbation=perturbation()), practice_06)
    for expected, actual in zip(vars(flow).values(), vars(perturbed).values(), strict=True):
        np.testing.assert_array_equal(expected, actual)
    assert np.all(np.array(world.loads(flow)) == np.array(replace(world, perturbation=perturbation()).loads(flow)))


def test_density_and_wind_are_added_against_time(world, practice_06):
    flow = met(world, practice_06)
    denser = met(replace(world, perturbation=perturbation(density=np.array([0.0, 0.2]))), practice_06)
    np.testing.assert_allclose(denser.density / flow.density, np.exp(1e-3 * flow.time), rtol=1e-12)
    windy = met(replace(world, perturbation=perturbation(wind=np.full((2, 2), 10.0))), practice_06)
    change = np.linalg.norm(windy.velocity_body - flow.velocity_body, axis=1)
    np.testing.assert_allclose(change, np.hypot(10.0, 10.0), rtol=1e-9)


def test_coefficients_and_vehicle(world, practice_06):
    flow = met(world, practice_06)
    changes = perturbation(ca=np.full(2, 0.1), cn=np.full(2, 0.02), cm=np.full(2, 0.003), mass=0.01, inertia=-0.02)
    perturbed = replace(world, perturbation=changes)
    expected, actual = world.coefficients(flow), perturbed.coefficients(flow)
    for name, by in (("ca", 0.1), ("cn", 0.02), ("cm_nose", 0.003), ("cl", 0.0)):
        np.testing.assert_allclose(getattr(actual, name) - getattr(expected, name), by, atol=1e-12)
    units = CoefficientUnits(np.array([0.0, 200.0]), ca=np.array([0.0, 2.0]), cn=np.ones(2), cm=np.full(2, 0.5))
    actual = replace(world, perturbation=replace(changes, units=units)).coefficients(flow)
    for name, by in (("ca", 1e-3 * flow.time), ("cn", 0.02), ("cm_nose", 0.0015)):
        np.testing.assert_allclose(getattr(actual, name) - getattr(expected, name), by, atol=1e-12)
    assert perturbed.rigid_body.mass == pytest.approx(1.01 * world.rigid_body.mass)
    np.testing.assert_allclose(perturbed.rigid_body.inertia, 0.98 * world.rigid_body.inertia)
