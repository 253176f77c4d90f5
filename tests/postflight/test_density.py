"""Hydrostatic equilibrium in the rotating frame: an atmosphere that is in it comes back with its temperature."""

from types import SimpleNamespace

import numpy as np
import pytest
from geodetic import fixed_position

from edl_filter.aero.discrepancy import DiscrepancyPrior
from edl_filter.aero.uncertainty import ThreeSigma
from edl_filter.planet import Planet
from edl_filter.planet.gas import Gas
from edl_filter.postflight.density import AxialForce, extract_atmosphere
from edl_filter.postflight.rates import batch_smoother

MARS = Planet("mars", 4.282837e13, 1.96e-3, 3396190.0, 3396190.0, 5.886e-3, 7.088218e-5, 0.0)
GAS, T, D, MASS = Gas(), 180.0, 2.65, 830.0
AREA = np.pi / 4.0 * D**2


class ConstantDrag:
    """Substitute for a database: CA 1.7 without error."""

    continuum_limit, join = 1e-3, "continuous"

    def lookup(self, mach, knudsen, alpha, speed=None):
        zero = 0.0 * mach
        return SimpleNamespace(ca=1.7 + zero, three_sigma=ThreeSigma(zero, zero, zero, zero))


def path(latitude_deg, azimuth_deg, n=2000):
    """Descent from 125 to 5 km over 600 km of ground; planet-fixed positions (n, 3) and altitudes."""
    altitude, ground_angle = np.linspace(125e3, 5e3, n), np.linspace(0.0, 600e3 / 3.4e6, n)
    azimuth, latitude = np.radians(azimuth_deg), np.radians(latitude_deg)
    north = latitude + ground_angle * np.cos(azimuth)
    return fixed_position(MARS, north, ground_angle * np.sin(azimuth) / np.cos(latitude), altitude), altitude


@pytest.mark.parametrize(("latitude", "azimuth"), [(0.0, 90.0), (-17.0, 80.0), (45.0, 20.0), (-85.0, 0.0)])
def test_an_isothermal_atmosphere_in_equilibrium_comes_back_with_its_temperature(latitude, azimuth):
    """Density exp(-W/(R T)) of the potential W of gravitation and of the centrifugal acceleration, along any path."""
    position, altitude = path(latitude, azimuth)
    x, y, z = position.T
    r2 = x * x + y * y + z * z
    attraction = 4.282837e13 / np.sqrt(r2) * (1 - 1.96e-3 * 3396190.0**2 / r2 * (3 * z * z / r2 - 1) / 2)
    total = attraction + 0.5 * 7.088218e-5**2 * (x * x + y * y)
    density = 3e-7 * np.exp((total - total[0]) / (GAS.constant * T))
    time = np.linspace(0.0, 200.0, len(density))
    speed = 5000.0 - 20.0 * time
    force = -0.5 * density * speed**2 * AREA * 1.7 / MASS
    noise, zero = np.full(len(time), 1e-12), np.zeros(len(time))
    gravity = np.linalg.norm(MARS.apparent_gravity(position), axis=1)
    profile = extract_atmosphere(
        time, altitude, speed, zero, gravity, MARS.geopotential(position), AxialForce(force, noise, noise, 0.0, MASS),
        np.ones(len(time), bool), ConstantDrag(), GAS, D, discrepancy=DiscrepancyPrior(), top_temperature=T,
    )  # fmt: skip
    np.testing.assert_allclose(profile.temperature, T, rtol=1e-4)
    np.testing.assert_allclose(profile.pressure, density * GAS.constant * T, rtol=1e-4)


class AngularDrag(ConstantDrag):
    """CA 1.7 (1 - α²): 4 % less at 0.2 rad."""

    def lookup(self, mach, knudsen, alpha, speed=None):
        entry = super().lookup(mach, knudsen, alpha, speed)
        return SimpleNamespace(ca=entry.ca * (1.0 - alpha**2), three_sigma=entry.three_sigma)


def test_an_oscillation_of_the_angle_is_not_in_the_density():
    """The means of the samples and the batches attenuate the force at 2 x 0.9 Hz by half; the density stays smooth."""
    position, altitude = path(0.0, 90.0)
    time = 0.1 * np.arange(len(altitude))
    density, speed = 1e-3 * np.exp(-altitude / 8000.0), np.full(len(time), 4000.0)
    alpha = 0.2 * np.sin(2.0 * np.pi * 0.9 * time)
    smoother = batch_smoother(time)
    force = smoother.as_smoothed(-0.5 * (density * speed**2 * AREA * 1.7 * (1.0 - alpha**2) / MASS)[:, None])[:, 0]
    noise = np.full(len(time), 1e-12)
    valid = altitude < 100e3
    error = {}
    for name, used in (("smoothed", smoother), ("as it is", None)):
        profile = extract_atmosphere(
            time, altitude, speed, alpha, np.linalg.norm(MARS.apparent_gravity(position), axis=1),
            MARS.geopotential(position), AxialForce(force, noise, noise, 0.0, MASS, smoother=used), valid,
            AngularDrag(), GAS, D, discrepancy=DiscrepancyPrior(), top_temperature=T,
        )  # fmt: skip
        inner = np.flatnonzero(profile.valid)[20:-20]
        smooth = smoother.as_smoothed(density[:, None])[inner, 0]
        error[name] = np.max(np.abs(profile.density[inner] / smooth - 1.0))
    assert error["smoothed"] < 2e-4 and error["as it is"] > 8e-3
