"""Nuisance parameters: which are in the vector, and where."""

from itertools import pairwise
from types import SimpleNamespace

from edl_filter.diagnosis.jacobians.nuisance import StatedUncertainty, nuisance_layout
from edl_filter.imu_model.sensor_errors import SensorErrors
from edl_filter.navigation.layout import Layout


def uncertainty(**changes):
    stated = {
        "density": 0.03, "density_correlation": 1e4, "wind": 10.0, "coefficients": 1.0, "coefficient_memory": 20.0,
        "numerical": 2e-4, "mass": 0.01, "inertia": 0.02,
    }  # fmt: skip
    return StatedUncertainty(**(stated | changes))


def test_only_parameters_with_a_stated_sigma_are_in_the_vector():
    errors = SensorErrors(1e-2, 1e-3, 0.0, 1e-4, 0.0)
    layout = Layout.of((errors,), {})
    checking = (SimpleNamespace(errors=(errors,)),)
    everything = nuisance_layout(layout, checking, uncertainty())
    assert {"density", "wind_east", "wind_north", "mass", "inertia", "ca", "cn", "cm"} <= set(everything.slices)
    assert {"checking0_accelerometer_bias", "checking0_gyro_bias"} <= set(everything.slices)
    assert not {"checking0_accelerometer_misalignment", "checking0_gyro_scale"} & set(everything.slices)
    exact = nuisance_layout(layout, (), uncertainty(density=0.0, wind=0.0, mass=0.0, inertia=0.0))
    assert set(exact.slices) == {"gyro_noise_before", "gyro_noise_after", "ca", "cn", "cm"}
    for nuisance in (everything, exact):  # one after the other, behind the filter's vector
        places = sorted((s.start, s.stop) for s in nuisance.slices.values())
        assert places[0][0] == layout.size and places[-1][1] == nuisance.size
        assert all(a[1] == b[0] for a, b in pairwise(places))
