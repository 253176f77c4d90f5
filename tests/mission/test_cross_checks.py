"""Values and sections that are inconsistent with each other."""

import pytest
from shipped_missions import error_of


@pytest.mark.parametrize(
    ("override", "key", "expected"),
    [
        ("telemetry.imus.rover.spacecraft_from_imu=[0, 0.7, 0.7, 0.5]", "", "a unit quaternion (to 1e-3)"),
        ("initial_state.sun_direction_j2000=[0.6, 0.6, 0.6]", "", "a unit vector"),
        ("planet.j2000_from_inertial=[[1, 0, 0], [0, 1, 0.01], [0, 0, 1]]", "", "orthonormal to 1e-4"),
        ("planet.j2000_from_inertial=[[1, 0, 0], [0, 1, 0], [0, 0, -1]]", "", "right-handed"),
        ("vehicle.inertia={xx: 1, yy: 1, zz: 1, xy: 2}", "", "moments and products of inertia of a body"),
        ("vehicle.inertia={xx: 1, yy: 1, zz: 5}", "", "none above the sum of the other two"),
        ("constraints.rest.end_s=400", ".end_s", "s, after start_s = 470.0"),
        ("constraints.rest.end_s=600", ".end_s", "s within the telemetry used, -300 to 560"),
        ("telemetry.end_s=-301", ".end_s", "s, after start_s = -300.0"),
        ("telemetry.epoch_sclk=126462085400.0", "", "s above 0 and at most 1e10"),
        ("vehicle.events.parachute_deploy.sclk=126462085.0", "", "a time after the epoch at 0 s"),
        ("vehicle.events.landing.sclk=126462400.0", "", "a time after bridle_cut at 342.2 s"),
        ("vehicle.events.landing.time_s=343.75", "", "one of sclk and time_s"),
        ("initial_state.attitude=guess", "", "'onboard'"),
    ],
)
def test_inconsistent_values_are_refused(override, key, expected):
    text = error_of(override)
    section = override.partition("=")[0].rpartition(".")[0]
    assert section in text
    assert f"{key}: found " in text
    assert expected in text


@pytest.mark.parametrize(
    ("override", "key", "name"),
    [
        ("planet.prime_meridian_deg=null", "planet.prime_meridian_deg", "mer_a"),
        ("planet.j2000_from_inertial=null", "planet.j2000_from_inertial", "mer_a"),
        ("initial_state.attitude=null", "initial_state.attitude", "mer_a"),
        ("initial_state.velocity_sigma=null", "initial_state.velocity_sigma", "mer_a"),
        ("initial_state.sun_direction_j2000=null", "initial_state.sun_direction_j2000", "mer_a"),
        ("vehicle.parachute=null", "vehicle.parachute.drag_coefficient", "mer_a"),
        ("constraints.altimeter.from=telemetry", "constraints.altimeter", "mer_a"),
        ("initial_state={from: telemetry}", "initial_state", "mer_a"),
        (
            "constraints.onboard_attitude={interval_s: 5, sigma_deg: 1}",
            "constraints.onboard_attitude",
            "practice_mer",
        ),
        ("constraints.parachute={mach: 1.8}", "constraints.parachute.mach_sigma", "mer_a"),
        ("constraints.parachute={mach: 1.8, mach_sigma: 0.1}", "constraints.parachute.temperature_sigma", "mer_a"),
        ("constraints.parachute={mach_sigma: 0.1}", "constraints.parachute.mach", "mer_a"),
        ("constraints.parachute={dynamic_pressure: 750}", "constraints.parachute.dynamic_pressure_sigma", "mer_a"),
        ("constraints.parachute={}", "constraints.parachute", "mer_a"),
        (
            "constraints.parachute={axial_force_window_s: 1, dynamic_pressure: 750, dynamic_pressure_sigma: 60}",
            "constraints.parachute.dynamic_pressure",
            "mer_a",
        ),
        ("aerodynamics=null", "aerodynamics", "mer_a"),
        ("vehicle.events.landing={sclk: 5, sigma_s: 1}", "vehicle.events.landing.sclk", "practice_mer"),
        (
            "vehicle.events.landing={time_s: 5, sigma_s: 1, position: [1, 0, 0]}",
            "vehicle.events.landing.position",
            "practice_mer",
        ),
        (
            "vehicle.events.landing.centre_of_mass_shift=[0.1, 0, 0]",
            "vehicle.events.landing.centre_of_mass_shift",
            "mer_a",
        ),
        ("vehicle.events.landing.imu_positions={rover: [1, 0, 0]}", "vehicle.events.landing.imu_positions", "mer_a"),
    ],
)
def test_a_section_that_lacks_what_another_requires_is_named(override, key, name):
    assert f"{key}: found " in error_of(override, name=name)
