"""Nuisance parameters: which are in the vector, and where."""

from itertools import pairwise
from types import SimpleNamespace

import numpy as np

from edl_filter.aero.discrepancy import AngleModes, DiscrepancyPrior
from edl_filter.diagnosis.jacobians.nuisance import FIELD_STATES, StatedUncertainty, nuisance_layout
from edl_filter.diagnosis.prediction.time_bins import TimeBins
from edl_filter.imu_model.sensor_errors import SensorErrors
from edl_filter.navigation.layout import Layout


def uncertainty(**changes):
    stated = {
        "density": 0.03, "density_correlation": 1e4, "wind": 10.0, "discrepancy": DiscrepancyPrior(),
        "numerical": 2e-4, "numerical_memory": 20.0, "mass": 0.01, "inertia": 0.02,
    }  # fmt: skip
    return StatedUncertainty(**(stated | changes))


#: Ten bins of one second; the first two are not compared.
BINS = TimeBins(np.arange(11.0), np.arange(10) >= 2)


def checking_record(errors, unit):
    """A record of one-second samples, each of one instrument."""
    unit = np.array(unit)
    return SimpleNamespace(errors=tuple(errors), unit=unit, index_at=lambda time: np.floor(time).astype(int))


def test_each_instrument_that_is_compared_has_errors_of_its_own():
    """The first instrument's samples lie in bins that are not compared."""
    errors = [SensorErrors(*(np.eye(5)[i] * 1e-3)) for i in (0, 3, 4)]
    layout = Layout.of((errors[0],), {})
    record = checking_record(errors, [0, 0, 1, 1, 1, 1, 1, 2, 2, 2])
    nuisance = nuisance_layout(layout, (record,), BINS, uncertainty(), {})
    assert [n for n in nuisance.slices if n.startswith("checking")] == [
        "checking0.1_gyro_bias",
        "checking0.2_gyro_scale",
    ]


def test_only_parameters_with_a_stated_sigma_are_in_the_vector():
    errors = SensorErrors(1e-2, 1e-3, 0.0, 1e-4, 0.0)
    layout = Layout.of((errors,), {})
    everything = nuisance_layout(layout, (checking_record([errors], [0] * 10),), BINS, uncertainty(), {})
    assert {"density", "wind_east", "wind_north", "mass", "inertia", "ca", "cn", "cm"} <= set(everything.slices)
    assert {"checking0.0_accelerometer_bias", "checking0.0_gyro_bias"} <= set(everything.slices)
    assert not {"checking0.0_accelerometer_misalignment", "checking0.0_gyro_scale"} & set(everything.slices)
    exact = nuisance_layout(layout, (), BINS, uncertainty(density=0.0, wind=0.0, mass=0.0, inertia=0.0), {})
    assert set(exact.slices) == {"gyro_noise_before", "gyro_noise_after", "ca", "cn", "cm"}
    for nuisance in (everything, exact):  # one after the other, behind the filter's vector
        places = sorted((s.start, s.stop) for s in nuisance.slices.values())
        assert places[0][0] == layout.size and places[-1][1] == nuisance.size
        assert all(a[1] == b[0] for a, b in pairwise(places))


def test_the_amplitudes_of_a_discrepancy_are_the_last_states():
    """Of each coefficient all values, then all derivatives; a field may have no modes."""
    layout = Layout.of((SensorErrors(1e-2, 1e-3, 0.0, 1e-4, 0.0),), {})
    counts = {"ca": 2, "cn": 0, "cm": 3}
    modes = {name: AngleModes(np.zeros((5, count)), np.zeros((5, count))) for name, count in counts.items()}
    exact, inexact = (nuisance_layout(layout, (), BINS, uncertainty(), m) for m in ({}, modes))
    assert exact.fields == {} and exact.slices == inexact.slices
    start = exact.size
    for name, count in counts.items():
        assert inexact.fields[name] == slice(start, start + count)
        start += FIELD_STATES * count
    assert inexact.size == start
