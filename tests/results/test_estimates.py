"""Groups of estimates: which part of a vector is written under which name, with its sigma and unit."""

import numpy as np
import pytest

from edl_filter.navigation.layout import UNITS
from edl_filter.pipeline.entry_state import EntryCorrection
from edl_filter.results.estimates import add_entry, add_nodes, add_sensor_errors


def entry_group(rotation_j2000=None):
    groups = {}
    epoch, frame = (np.array([0.5]), np.array([0.1])), (np.array([1e-3, 2e-3, 3e-3]), np.full(3, 1e-4))
    correction = EntryCorrection(
        np.arange(9.0), 10.0 + np.arange(9.0), np.array([0.1, 0.2, 0.3]), 20.0 + np.arange(6.0),
        {"entry_epoch": epoch, "entry_frame": frame},
    )  # fmt: skip
    add_entry(groups, correction, rotation_j2000)
    return groups["/entry"].variables


@pytest.mark.parametrize(
    ("name", "begin", "unit"), [("position", 0, "m"), ("velocity", 3, "m/s"), ("attitude", 6, "rad")]
)
def test_the_change_of_the_entry_state_is_divided_into_its_parts(name, begin, unit):
    group = entry_group()
    change, sigma = group[f"{name}_change"], group[f"{name}_sigma"]
    np.testing.assert_array_equal(change.values, begin + np.arange(3.0))
    np.testing.assert_array_equal(sigma.values, 10.0 + begin + np.arange(3.0))
    assert change.attrs["units"] == sigma.attrs["units"] == unit
    assert ("body axes" in change.attrs["long_name"]) == (name == "attitude")


def test_what_a_rotation_leaves_of_the_change_and_the_states_of_epoch_and_frame():
    group = entry_group()
    np.testing.assert_array_equal(group["position_left"].values, [20.0, 21.0, 22.0])
    np.testing.assert_array_equal(group["velocity_left"].values, [23.0, 24.0, 25.0])
    assert (group["entry_epoch"].dims, group["entry_frame"].dims) == (("entry_epoch_part",), ("axis",))
    assert (group["entry_epoch"].attrs["units"], group["entry_frame"].attrs["units"]) == ("s", "rad")
    assert (group["entry_epoch"].values, group["entry_epoch_state_sigma"].values) == (0.5, 0.1)


def test_the_rotation_in_j2000_is_written_only_where_that_frame_is_stated():
    assert "rotation_j2000" not in entry_group()
    np.testing.assert_array_equal(entry_group(np.array([3.0, 2.0, 1.0]))["rotation_j2000"].values, [3.0, 2.0, 1.0])


def test_sensor_errors_are_the_smoothed_ones_where_the_unit_drives_last(spirit):
    groups, smoothed, driving = {}, spirit.smoothed, spirit.telemetry.driving
    add_sensor_errors(groups, spirit)
    layout = spirit.filter_pass.layout
    assert set(groups) == {f"/sensor_errors/{unit}" for unit in driving.units}
    for k, (unit, prior) in enumerate(zip(driving.units, driving.errors, strict=True)):
        last, group = np.flatnonzero(smoothed.unit == k)[-1], groups[f"/sensor_errors/{unit}"].variables
        estimated = [n for n in ("accelerometer_bias", "gyro_bias") if getattr(prior, n) > 0.0]
        assert set(estimated) <= set(group)
        for name in estimated:
            where, covariance = layout[name], smoothed.covariance[last]
            np.testing.assert_array_equal(group[name].values, smoothed.states[last].errors[where])
            np.testing.assert_array_equal(group[f"{name}_sigma"].values, np.sqrt(np.diag(covariance))[where])
            assert group[f"{name}_prior_sigma"].values == getattr(prior, name)
            assert group[name].attrs["units"] == UNITS[name]


def test_nodes_have_every_state_with_its_sigma(practice_06):
    groups, smoothed, layout = {}, practice_06.smoothed, practice_06.filter_pass.layout
    add_nodes(groups, layout, smoothed)
    group = groups["/nodes"].variables
    for name, where in layout.slices.items():
        sigma = np.sqrt(np.array([np.diag(p)[where] for p in smoothed.covariance]))
        np.testing.assert_array_equal(group[f"{name}_sigma"].values, sigma)
        assert group[f"{name}_sigma"].attrs["units"] == UNITS[name]
    nav = np.array([s.nav for s in smoothed.states])
    for name, part in (("position", slice(3)), ("velocity", slice(3, 6)), ("inertial_from_body", slice(6, 10))):
        np.testing.assert_array_equal(group[name].values, nav[:, part])
