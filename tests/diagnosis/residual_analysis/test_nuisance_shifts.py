"""Nuisance parameters that a flight moves: which are listed, with which value, unit and order."""

from types import MappingProxyType, SimpleNamespace

import numpy as np
import pytest

from edl_filter.diagnosis.residual_analysis import nuisance_shifts as module
from edl_filter.diagnosis.residual_analysis.nuisance_shifts import nuisance_shifts
from edl_filter.effects.base import EffectInstance
from edl_filter.effects.perturbation import CoefficientUnits
from edl_filter.effects.registry import find_effect

#: Vector of the constructed model: three states of the filter, density, wind to the east, then two constants.
DENSITY, EAST, SIZE = 3, 4, 5
STEPS = np.array([1, 3, 4])


class Nuisance(dict):
    """Slices by name, and the size without constants."""

    size, fields = SIZE, MappingProxyType({})


@pytest.fixture
def model(monkeypatch):
    """Posterior means in sigmas; `states` by step, `initial` of the constants."""
    states, initial = np.zeros((6, SIZE + 2)), np.zeros(SIZE + 2)
    offset = EffectInstance(find_effect("com_offset"), {"dy": 0.0, "dz": 0.0})
    monkeypatch.setattr(module, "smoothed_states", lambda *_: (initial, states))
    return SimpleNamespace(
        states=states,
        initial=initial,
        fitted_noise_filter=SimpleNamespace(model=SimpleNamespace(row_start=None)),
        white_residuals=lambda whiten: None,
        initial_mean=None,
        nuisance=Nuisance(density=slice(DENSITY, DENSITY + 1), wind_east=slice(EAST, EAST + 1)),
        index=SimpleNamespace(step_of_bins=lambda row_start: (np.arange(3), STEPS)),
        case=SimpleNamespace(
            uncertainty=SimpleNamespace(sigma={"density": 0.05, "wind_east": 15.0}),
            constants=(SimpleNamespace(instance=offset, sigma={"dy": 0.001, "dz": 0.002}),),
        ),
    )


def test_a_flight_that_moves_nothing_has_no_shifts(model):
    model.states[:] = 1.9
    model.initial[SIZE:] = 0.0015, -0.003  # 1.5 sigmas
    assert nuisance_shifts(model, None) == ()


def test_an_asymmetry_is_reported_in_units_of_its_coefficient_at_the_time(model):
    """Steps 1, 3 and 4 are the ends of bins 0, 1 and 2, at 10, 20 and 30 s."""
    names = ("side_asymmetry", "normal_asymmetry", "pitch_asymmetry", "yaw_asymmetry")
    model.nuisance.fields = {name: slice(k, k + 1) for k, name in enumerate(names[1:])}
    model.bins = SimpleNamespace(edges=np.array([0.0, 10.0, 20.0, 30.0]))
    units = CoefficientUnits(np.array([0.0, 40.0]), np.ones(2), np.array([0.0, 0.04]), np.array([0.001, 0.005]))
    model.field = SimpleNamespace(asymmetry=units)
    model.states[STEPS, 0] = 1.0, 3.0, -2.0
    model.states[STEPS, 1] = 0.0, 0.0, -4.0
    model.states[STEPS, 2] = 1.9
    shifts = nuisance_shifts(model, None)
    assert [(s.name, s.sigmas) for s in shifts] == [("asymmetry Cm", -4.0), ("asymmetry CN", 3.0)]
    assert [s.value for s in shifts] == pytest.approx([-4.0 * 0.004, 3.0 * 0.02])


def test_shifts_are_the_largest_of_the_flight_in_their_unit_the_farthest_first(model):
    model.states[STEPS, DENSITY] = 1.0, -2.5, 2.0
    model.states[2, DENSITY] = 9.0  # a step at which no force is compared
    model.states[STEPS, EAST] = 0.0, 4.0, -3.0
    model.initial[SIZE:] = -0.003, 0.003
    shifts = nuisance_shifts(model, None)
    assert [(s.name, s.unit) for s in shifts] == [("wind_east", "m/s"), ("com_offset dy", "m"), ("density", "")]
    assert [s.sigmas for s in shifts] == pytest.approx([4.0, -3.0, -2.5])
    assert [s.value for s in shifts] == pytest.approx([60.0, -0.003, np.expm1(-0.125)])


def test_the_largest_increments_of_the_database_are_listed_too(model):
    largest = [
        SimpleNamespace(coefficient="ca", sigmas=-3.2, increment=-0.04),
        SimpleNamespace(coefficient="cn", sigmas=1.0, increment=0.01),
    ]
    (shift,) = nuisance_shifts(model, SimpleNamespace(largest=lambda: largest))
    assert (shift.name, shift.sigmas, shift.value, shift.unit) == ("database CA", -3.2, -0.04, "")
