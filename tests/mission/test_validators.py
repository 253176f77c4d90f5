"""Ranges of single values, with hints at wrong units."""

import pytest
from shipped_missions import error_of


@pytest.mark.parametrize(
    ("override", "actual", "expected"),
    [
        ("planet.gravity.mu=42828.37", "42828.37", "m^3/s^2 between 1e10 and 1e18 (is it in km^3/s^2?)"),
        ("planet.gravity.j2=0.2", "0.2", "a number between -0.1 and 0.1"),
        ("planet.gravity.radius=3396.19", "3396.19", "(is it in km?)"),
        ("planet.ellipsoid.equatorial_radius=3396.19", "3396.19", "m between 100000 and 1e8 (is it in km?)"),
        ("planet.ellipsoid.flattening=169.9", "169.9", "a number between 0 and 0.2"),
        ("planet.rotation_rate=0.00406", "0.00406", "(is it in deg/s?)"),
        ("planet.rotation_rate=350.89", "350.89", "(is it in deg/day?)"),
        ("planet.prime_meridian_deg=500", "500.0", "deg between -360 and 360"),
        ("atmosphere.density_sigma=15", "15.0", "(is it in %?)"),
        ("atmosphere.table_gas_constant=0.189", "0.189", "(is it in kJ/(kg K)?)"),
        ("atmosphere.gas=venus", "'venus'", "'thesis' or 'mars'"),
        ("vehicle.mass=0.827", "0.827", "kg between 1 and 100000 (is it in t?)"),
        ("vehicle.mass=827000", "827000.0", "(is it in g?)"),
        ("vehicle.diameter=2650", "2650.0", "(is it in cm?)"),
        ("telemetry.imus.rover.gyro_noise=0", "0.0", "rad/s above 0 and at most 0.01"),
        ("telemetry.imus.rover.gyro_bias_sigma=1", "1.0", "(is it in deg/h?)"),
        ("telemetry.imus.rover.accelerometer_scale_sigma=300", "300.0", "(is it in ppm?)"),
        ("telemetry.imus.rover.accelerometer_misalignment_sigma=0.5", "0.5", "(is it in deg?)"),
        ("telemetry.imus.rover.position=[-173, 240, 203]", "[-173.0, 240.0, 203.0]", "(is it in mm?)"),
        ("initial_state.position=[-2833.6, -1800.9, -1064.4]", "of length 3522", "(is it in km?)"),
        ("initial_state.position=[1e9, 0, 0]", "1e+09 m from the centre", "m, outside the planet"),
        ("initial_state.velocity=[3.522, -4.166, 1.383]", "of length 5.62", "(is it in km/s?)"),
        ("initial_state.position_sigma=0", "0.0", "m above 0"),
        ("constraints.parachute.dynamic_pressure=0.75", "0.75", "(is it in kPa?)"),
        ("constraints.landing.radius=3392.3", "3392.3", "(is it in km?)"),
        ("constraints.landing.radius=1e7", "10000000.0", "within 10 % of the equatorial radius"),
        ("constraints.landing.latitude_deg=-91", "-91.0", "deg between -90 and 90"),
        ("constraints.rest.velocity_sigma=-1", "-1.0", "m/s above 0"),
        ("filter.alpha=0.001", "0.001", "between 0.1 and 1"),
        ("filter.gate_probability=99.9", "99.9", "(is it in %?)"),
        ("filter.gate_probability=1", "1.0", "at least 0.5 and below 1"),
        ("planet.gravity.mu=.nan", "nan", "a finite number"),
        ("planet.gravity.mu=heavy", "'heavy' (text)", "a number (gravitational parameter, m^3/s^2)"),
        ("planet.gravity=3", "3", "a section of keys"),
        ("outputs.figures=yes", "'yes'", "true or false"),
        ("name=a b", "'a b'", "letters, digits, _ and - only"),
        ("telemetry.spacecraft=3", "3", "1 or 2"),
        ("telemetry.clock.utc=today", "'today'", "a UTC time in ISO 8601"),
        ("initial_state.position=[1, 2]", "[1, 2]", "more entries"),
    ],
)
def test_a_value_out_of_range_is_named_with_the_accepted_range(override, actual, expected):
    key = override.partition("=")[0]
    in_practice_mission = key.split(".")[0] in ("planet", "atmosphere", "filter", "outputs", "name")
    text = error_of(override, name="practice_mer" if in_practice_mission else "mer_a")  # the shorter file loads faster
    assert text.startswith(f"--set {key}: found ")
    assert actual in text.split("; expected ")[0]
    assert expected in text.split("; expected ")[1]
