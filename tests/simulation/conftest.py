"""The scenario, flight and world that the tests of the simulation share."""

import pytest


@pytest.fixture(scope="session")
def mer_scenario():
    """The shipped scenario of a MER-like vehicle."""
    from edl_filter.simulation import Scenario

    return Scenario.load("builtin:mer")


@pytest.fixture(scope="session")
def mer_flight(mer_scenario):
    """A clean flight of it."""
    from edl_filter.simulation import simulate

    return simulate(mer_scenario)


@pytest.fixture(scope="session")
def nominal(mer_flight):
    """The nominal world of that vehicle."""
    return mer_flight.forward_model.with_effects(())
