"""Air data against closed forms, its sigmas against sampling."""

from dataclasses import fields, replace

import numpy as np
import pytest
from geodetic import fixed_position

from edl_filter import rotations
from edl_filter.navigation.trajectory import Trajectory
from edl_filter.planet import Planet
from edl_filter.planet.atmosphere import Atmosphere
from edl_filter.planet.gas import Gas
from edl_filter.postflight.airdata import air_data, wind_shear

MARS = Planet("mars", 4.282837e13, 1.96e-3, 3396190.0, 3396190.0, 5.886e-3, 7.088218e-5, 0.6)


def atmosphere(east=(0.0, 0.0), north=(0.0, 0.0)):
    return Atmosphere(
        altitude=np.array([-5e3, 200e3]),
        log_density=np.log([0.02, 1e-10]),
        temperature=np.array([210.0, 150.0]),
        wind=np.column_stack((east, north)),
        gas=Gas(),
    )


def flight(latitude, longitude, altitude, local, alpha=0.0, beta=0.0, covariance=None, time=100.0):
    """One state with a ground-relative velocity east, north, up, flown at alpha and beta in still air."""
    fixed = fixed_position(MARS, latitude, longitude, altitude)
    position = MARS.rotation.to_inertial(time, fixed)[None]
    enu = MARS.enu_from_inertial(np.array([time]), position)[0]
    relative = enu.T @ np.asarray(local, float)
    velocity = relative[None] + np.cross([0.0, 0.0, MARS.rotation_rate], position)
    # body axes with the velocity's components V (cos a cos b, sin b, sin a cos b)
    air = np.array([np.cos(alpha) * np.cos(beta), np.sin(beta), np.sin(alpha) * np.cos(beta)])
    body_from_inertial = triad(air, [0.3, 1.0, 0.2]) @ triad(relative, enu[2] + 0.4 * enu[0]).T
    attitude = rotations.conjugate(rotations.from_matrix(body_from_inertial))[None]
    zero = np.zeros((1, 3))
    covariance = np.zeros((9, 9)) if covariance is None else covariance
    epochs, covariances = np.array([time, time + 1.0]), np.array([covariance, covariance])
    return Trajectory(np.array([time]), position, velocity, attitude, epochs, covariances, zero, zero)


def triad(first, second):
    x = np.asarray(first, float) / np.linalg.norm(first)
    y = np.cross(second, x)
    y /= np.linalg.norm(y)
    return np.column_stack((x, y, np.cross(x, y)))


def test_closed_forms():
    air = air_data(flight(0.3, -1.2, 31e3, [300.0, 400.0, -120.0], 0.05, -0.02), MARS, atmosphere())
    assert air.latitude[0] == pytest.approx(0.3, abs=1e-14)
    assert air.longitude[0] == pytest.approx(-1.2, abs=1e-14)
    assert air.altitude[0] == pytest.approx(31e3, abs=1e-8)
    speed = np.sqrt(300.0**2 + 400.0**2 + 120.0**2)
    assert air.speed[0] == pytest.approx(speed, rel=1e-12)
    assert air.flight_path_angle[0] == pytest.approx(np.arctan2(-120.0, 500.0), abs=1e-12)
    assert air.azimuth[0] == pytest.approx(np.arctan2(300.0, 400.0), abs=1e-12)
    assert air.alpha[0] == pytest.approx(0.05, abs=1e-12)
    assert air.beta[0] == pytest.approx(-0.02, abs=1e-12)
    assert air.alpha_total[0] == pytest.approx(np.arccos(np.cos(0.05) * np.cos(0.02)), abs=1e-12)
    density = 0.02 * np.exp(np.log(1e-10 / 0.02) * 36e3 / 205e3)
    assert air.density[0] == pytest.approx(density, rel=1e-12)
    assert air.dynamic_pressure[0] == pytest.approx(0.5 * density * speed**2, rel=1e-12)
    temperature = 210.0 - 60.0 * 36.0 / 205.0
    assert air.mach[0] == pytest.approx(speed / np.sqrt(1.3 * 188.92 * temperature), rel=1e-12)


def test_the_wind_is_subtracted():
    windy = atmosphere(east=(20.0, 20.0), north=(-5.0, -5.0))
    air = air_data(flight(-0.2, 2.0, 10e3, [20.0, -5.0, -80.0]), MARS, windy)
    assert air.speed[0] == pytest.approx(80.0, rel=1e-12)
    assert air.flight_path_angle[0] == pytest.approx(-np.pi / 2, abs=1e-9)


def test_shear_is_the_tables_slope_and_nothing_outside():
    windy = atmosphere(east=(0.0, 20.5), north=(0.0, -41.0))
    shear = wind_shear(windy, np.array([-6e3, 0.0, 150e3, 201e3]))
    np.testing.assert_allclose(shear, [[0, 0], [1e-4, -2e-4], [1e-4, -2e-4], [0, 0]], atol=1e-18)


@pytest.mark.parametrize("local", [[4000.0, 900.0, -900.0], [30.0, -20.0, -60.0]])
def test_sigmas_are_those_of_sampled_errors(local):
    rng = np.random.default_rng(5)
    root = rng.normal(size=(9, 9)) * np.repeat([30.0, 0.05, 3e-5], 3)[:, None]
    covariance = root @ root.T
    windy = atmosphere(east=(0.0, 60.0), north=(0.0, -30.0))
    centre = flight(-0.25, 3.0, 12e3, local, 0.08, -0.05, covariance)
    stated = air_data(centre, MARS, windy)
    errors = rng.multivariate_normal(np.zeros(9), covariance, 20000)
    count = len(errors)
    samples = Trajectory(
        np.repeat(centre.time, count),
        centre.position + errors[:, :3],
        centre.velocity + errors[:, 3:6],
        rotations.multiply(rotations.from_rotation_vector(errors[:, 6:]), centre.inertial_from_body),
        centre.epochs,
        np.zeros((2, 9, 9)),
        np.zeros((count, 3)),
        np.zeros((count, 3)),
    )
    sampled = air_data(samples, MARS, windy)
    for name in ("altitude", "speed", "flight_path_angle", "alpha", "beta", "alpha_total"):
        spread = np.std(getattr(sampled, name))
        # 20000 draws give a standard deviation to 0.5 %
        assert getattr(stated, f"{name}_sigma")[0] == pytest.approx(spread, rel=0.02), name


def test_gradients_by_finite_differences():
    """Rank-one covariances: each sigma is the size of one derivative."""
    windy = atmosphere(east=(0.0, 60.0), north=(0.0, -30.0))
    base = flight(0.4, -2.0, 40e3, [-3000.0, 2500.0, -600.0], 0.1, 0.03)
    step = np.repeat([1.0, 1e-3, 1e-7], 3)
    for k in range(9):
        error = np.zeros(9)
        error[k] = step[k]
        stated = air_data(replace(base, epoch_covariance=np.array(2 * [np.outer(error, error)])), MARS, windy)
        sides = [
            air_data(
                replace(
                    base,
                    position=base.position + s * error[:3],
                    velocity=base.velocity + s * error[3:6],
                    inertial_from_body=rotations.multiply(
                        rotations.from_rotation_vector(s * error[6:]), base.inertial_from_body
                    ),
                ),
                MARS,
                windy,
            )
            for s in (1.0, -1.0)
        ]
        for name in ("altitude", "speed", "flight_path_angle", "alpha", "beta", "alpha_total"):
            change = abs(getattr(sides[0], name)[0] - getattr(sides[1], name)[0]) / 2.0
            # neglected: the rotation of the wind's axes by a position error, and the ellipsoid's curvature
            allowed = {"altitude": 1e-8, "speed": 2e-5}.get(name, 2e-8)
            assert getattr(stated, f"{name}_sigma")[0] == pytest.approx(change, rel=2e-3, abs=allowed), (k, name)


def test_at_rest_no_sigma_exceeds_that_of_a_uniform_angle():
    covariance = np.diag(np.repeat([1e4, 1.0, 1e-2], 3))
    air = air_data(flight(0.1, 0.2, 0.0, [1e-7, 0.0, 0.0], covariance=covariance), MARS, atmosphere())
    for entry in fields(air):
        assert np.all(np.isfinite(getattr(air, entry.name))), entry.name
    assert air.alpha_sigma[0] == pytest.approx(2 * np.pi / np.sqrt(12))
    assert air.alpha_total_sigma[0] == pytest.approx(np.pi / np.sqrt(12))


def test_the_shipped_flight_falls_nose_first(practice_06):
    air = air_data(practice_06.trajectory, practice_06.planet, practice_06.atmosphere)
    before = air.time < practice_06.event_times["parachute_deploy"]
    assert np.all(air.alpha_total[before] < np.deg2rad(15.0))
    assert np.all(np.diff(air.altitude[before]) < 0.0)
    np.testing.assert_allclose(np.linalg.norm(air.velocity_body, axis=1), air.speed, rtol=1e-12)
