"""Inputs of the post-flight layer from a flight, and the keys of a mission that it uses."""

from dataclasses import replace

import numpy as np
import pytest

from edl_filter.mission import Mission
from edl_filter.pipeline.load import prepare_telemetry
from edl_filter.pipeline.reconstruct import FlightInputs, reconstruct
from edl_filter.postflight.airdata import air_data
from edl_filter.postflight.flight import derive_flight, postflight_inputs
from edl_filter.results.postflight import summary
from edl_filter.telemetry.flight_file import read_flight_file
from edl_filter.telemetry.sample_checks import findings_of


def derived(flight, *overrides):
    """Post-flight layer of a flight whose mission has other keys."""
    flight = replace(flight, mission=Mission.load("builtin:practice_mer", overrides))
    return derive_flight(flight, air_data(flight.trajectory, flight.planet, flight.atmosphere, flight.effects))


def test_batch_and_low_pass_of_the_mission_are_used_and_reported(practice_06):
    runs = {
        name: derived(practice_06, *overrides)
        for name, overrides in (
            ("plain", ()),
            ("short", ("postflight.batch_s=0.625",)),
            ("low_pass", ("postflight.batch_s=0.625", "postflight.low_pass_hz=1.0")),
        )
    }
    smoothing = {name: summary(run)["smoothing"] for name, run in runs.items()}
    assert [s["batch_points"] for s in smoothing.values()] == [7, 5, 5]
    assert [s["low_pass_hz"] for s in smoothing.values()] == [None, None, 1.0]
    assert (
        smoothing["low_pass"]["bandwidth_hz"] < smoothing["plain"]["bandwidth_hz"] < smoothing["short"]["bandwidth_hz"]
    )
    noise = {name: np.median(run.motion.moments.sigma[:, 1]) for name, run in runs.items()}
    assert noise["low_pass"] < 0.5 * noise["short"]
    # neither a batch nor the low-pass reaches the mortar's recoil
    end = {name: run.time[-1] for name, run in runs.items()}
    assert end["short"] - end["low_pass"] == pytest.approx(1.0, abs=0.13)


def test_sigmas_of_products_of_inertia_widen_the_bands_of_the_moments(practice_06):
    plain, wide = derived(practice_06), derived(practice_06, "vehicle.inertia.yz_sigma=2.0")
    before, after = (np.nanmedian(run.flight.coefficients.systematic["Cl"][200:]) for run in (plain, wide))
    assert after > 1.5 * before
    np.testing.assert_array_equal(plain.flight.coefficients.value["Cl"], wide.flight.coefficients.value["Cl"])


@pytest.mark.parametrize(
    ("length", "lost", "triads"),
    [(0.375, False, "both"), (3.0, True, "both"), pytest.param(3.0, True, "rate", marks=pytest.mark.slow)],
)
def test_no_coefficient_is_that_of_a_stretch_that_no_imu_has_read(length, lost, triads, builtin_flight):
    """The database's dynamics have filled it, and would be compared with the database; a short one is interpolated."""
    mission = Mission.load("builtin:practice_mer", [f"telemetry.path={builtin_flight}"])
    telemetry = read_flight_file(builtin_flight)
    inside = (telemetry.driving.time > 120.0) & (telemetry.driving.time <= 120.0 + length)
    record = replace(telemetry.driving, angular_rate=np.where(inside[:, None], np.nan, telemetry.driving.angular_rate))
    if triads == "both":
        record = replace(record, specific_force=np.where(inside[:, None], np.nan, record.specific_force))
    findings = findings_of("primary", "all" if triads == "both" else "rate", "missing", inside, record.time, 0.125)
    single = replace(telemetry, driving=record, checking=(), findings=tuple(findings))
    run = reconstruct(mission, inputs=FlightInputs(prepare_telemetry(mission, single, "flight")))
    layer = derive_flight(run, air_data(run.trajectory, run.planet, run.atmosphere, run.effects))
    within = (layer.time > 120.0) & (layer.time < 120.0 + length)
    for name in ("CN", "Cm"):
        value = layer.flight.coefficients.value[name]
        assert np.isnan(value[within]).all() if lost else np.isfinite(value[within]).all()
        assert np.isfinite(value[~within & (layer.time > 60.0)]).all()


def test_the_inputs_of_a_flight_have_the_apparent_gravity(practice_06):
    """Weight of air that rotates with the planet: near the equator 0.4 % below the attraction."""
    air = air_data(practice_06.trajectory, practice_06.planet, practice_06.atmosphere, practice_06.effects)
    inputs, planet = postflight_inputs(practice_06, air), practice_06.planet
    trajectory = practice_06.trajectory
    middle = 0.5 * (trajectory.position[1:] + trajectory.position[:-1])
    attraction = np.linalg.norm(planet.gravity(middle), axis=1)
    radius = np.hypot(middle[:, 0], middle[:, 1])
    latitude = np.arctan2(middle[:, 2], radius)
    np.testing.assert_allclose(
        inputs.gravity, attraction - planet.rotation_rate**2 * radius * np.cos(latitude), rtol=3e-5
    )
    # and the potential is that gravity's, along the vertical and along the path
    np.testing.assert_allclose(np.diff(inputs.geopotential), np.diff(planet.geopotential(middle)), rtol=1e-3, atol=1.0)
