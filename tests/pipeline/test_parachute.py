"""The constraint at parachute deployment on a simulated flight, with the pressure and Mach number of the truth."""

from dataclasses import replace

import numpy as np
import pytest
from left_out import left_out_sigmas

from edl_filter.errors import InputError
from edl_filter.mission import Mission, shipped_mission
from edl_filter.navigation.parachute import AXIAL_FORCE, DYNAMIC_PRESSURE, MACH
from edl_filter.pipeline.load import read_atmosphere
from edl_filter.pipeline.reconstruct import assemble, reconstruct


def mission(parachute, *overrides):
    return Mission.load(shipped_mission("practice_mer"), [f"constraints.parachute={parachute}", *overrides])


def constraint(practice_06, parachute, *overrides):
    m = mission(parachute, *overrides)
    problem = assemble(m, practice_06.telemetry, practice_06.planet, read_atmosphere(m))
    return next(c for c in problem.constraints if c.name == "parachute")


def test_the_axial_force_gives_the_dynamic_pressure_of_the_flight(practice_06):
    """Exact tables and mass: the accelerometers give q to 0.3 %, so that the flight's density deviates by the rest."""
    c = constraint(practice_06, "{axial_force_window_s: 1.0}")
    assert c.components == (AXIAL_FORCE,)
    trajectory = practice_06.trajectory
    k = np.searchsorted(trajectory.time, c.time - 1e-6)
    nav = np.concatenate((trajectory.position[k], trajectory.velocity[k], trajectory.inertial_from_body[k]))
    flow = c.model.at(c.time, nav[:, None])
    pressure = np.exp(c.measured[0]) / c.model.axial_coefficient(flow)[0]
    assert pressure[0] == pytest.approx(flow.dynamic_pressure[0], rel=0.03)  # the flight's density: 1 % about the table
    assert float(c.source.split("pressure of ")[1].split()[0]) == pytest.approx(pressure[0], abs=5.0)


def test_relative_errors_add_up_and_the_wind_is_common(practice_06):
    c = constraint(
        practice_06,
        "{dynamic_pressure: 700, dynamic_pressure_sigma: 35, mach: 1.7, mach_sigma: 0.034, temperature_sigma: 11}",
        "atmosphere.density_sigma=0.15", "atmosphere.wind_sigma=20",
    )  # fmt: skip
    assert c.components == (DYNAMIC_PRESSURE, MACH)
    np.testing.assert_allclose(c.measured, np.log([700.0, 1.7]))
    k = np.searchsorted(practice_06.trajectory.time, c.time - 1e-6)
    t = practice_06.trajectory
    flow = c.model.at(c.time, np.concatenate((t.position[k], t.velocity[k], t.inertial_from_body[k]))[:, None])
    wind = 20.0 * np.cos(flow.flight_path[0]) / flow.speed[0]
    temperature = float(c.model.atmosphere.temperature_at(flow.altitude)[0])
    expected = [
        [0.05**2 + 0.15**2 + 4.0 * wind**2, 2.0 * wind**2],
        [2.0 * wind**2, 0.02**2 + (0.5 * 11.0 / temperature) ** 2 + wind**2],
    ]
    np.testing.assert_allclose(c.noise, expected, rtol=0.02)  # the dead-reckoned speed differs by 0.6 %


def test_the_uncertainty_of_the_coefficient_and_the_mass_counts(practice_06):
    parachute = "{axial_force_window_s: 1.0}"
    exact = constraint(practice_06, parachute).noise[0, 0]
    uncertain = constraint(practice_06, parachute, "aerodynamics.coefficient_sigma=1", "vehicle.mass_sigma=8.32").noise
    # MER's database: 10 % of CA at 3 sigma in a continuum below Mach 5
    assert uncertain[0, 0] - exact == pytest.approx((0.1 / 3.0) ** 2 + 0.01**2, rel=0.02)


def test_the_force_is_that_before_the_event(practice_06):
    """The parachute opens within the samples after it, with many times the force."""
    short = constraint(practice_06, "{axial_force_window_s: 0.5}").measured[0]
    long = constraint(practice_06, "{axial_force_window_s: 2.0}").measured[0]
    assert short == pytest.approx(long, abs=0.01)


def test_the_flight_agrees_with_every_form():
    truth = {"axial": "{axial_force_window_s: 1.0}", "mach": "{mach: 1.71, mach_sigma: 0.02, temperature_sigma: 2}"}
    for parachute in truth.values():
        flight = reconstruct(mission(parachute))
        s = next(s for s in flight.constraint_checks if s.name == "parachute")
        assert s.consistent and s.accepted.all() and left_out_sigmas(s) < 3.0


def test_a_window_without_samples_is_named(practice_06):
    with pytest.raises(InputError, match=r"axial_force_window_s: found 0.1 s, in which there are [01] samples"):
        constraint(practice_06, "{axial_force_window_s: 0.1}")


def test_an_axial_force_with_another_sign_is_refused_with_advice(practice_06):
    m = mission("{axial_force_window_s: 1.0}")
    driving = practice_06.telemetry.driving
    turned = replace(driving, specific_force=driving.specific_force * [-1.0, 1.0, 1.0])
    telemetry = replace(practice_06.telemetry, driving=turned)
    with pytest.raises(InputError, match=r"a deceleration is negative\. Check the sign of the x axis of the IMU 'prim"):
        assemble(m, telemetry, practice_06.planet, read_atmosphere(m))


def test_the_force_is_that_of_the_mass_at_the_deployment(practice_06):
    """An event before it that states a mass, as of ballast that is released, changes the force over the area."""
    parachute = "{axial_force_window_s: 1.0}"
    plain = constraint(practice_06, parachute).measured[0]
    deployed = practice_06.event_times["parachute_deploy"]
    ballast = "{time_s: 150.0, sigma_s: 0.01, mass: 416.0}"
    events = f"{{ballast: {ballast}, parachute_deploy: {{time_s: {deployed!r}, sigma_s: 0.01, mass: 100.0}}}}"
    lighter = constraint(practice_06, parachute, f"vehicle.events={events}").measured[0]
    assert lighter - plain == pytest.approx(np.log(416.0 / practice_06.mission.vehicle.mass), abs=1e-9)


def test_the_line_ends_before_the_sigma_of_the_events_time(practice_06):
    """Also if the flight file states that sigma, and not the mission."""
    telemetry = replace(practice_06.telemetry, event_sigmas={"parachute_deploy": 10.0})
    m = mission("{axial_force_window_s: 1.0}")
    with pytest.raises(InputError, match="0 samples before"):
        assemble(m, telemetry, practice_06.planet, read_atmosphere(m))
