"""Simulated flights with the physics of the post-flight layer's own model, and the errors of their reconstructions."""

from dataclasses import replace
from functools import cache

import numpy as np
from scipy.stats import norm, qmc

from edl_filter.aero.database import load_database, split
from edl_filter.aero.discrepancy import DiscrepancyPrior
from edl_filter.planet.gas import Gas
from edl_filter.postflight.derive import derive
from edl_filter.postflight.inputs import PostflightInputs

GAS, D, MASS, X, G, T = Gas(), 2.65, 830.0, 0.27, 3.7, 180.0
H, AREA = GAS.constant * T / G, np.pi / 4 * D**2
INERTIA = np.array([[400.0, -1.0, 0.5], [-1.0, 303.0, 0.2], [0.5, 0.2, 300.0]])
DATABASE = load_database(family="MER", speed_per_mach=205.8)
NOISE, GYRO = 3e-3, 4e-5
#: True rolling-moment coefficient.
ROLLING = 1e-6


@cache
def flight(dt=0.125, seed=1, noisy=True, added_cn=0.0, end=245.0):
    """Prescribed path and angles; forces and moments from the database; rates by integrating Euler's equations."""
    rng, sub = np.random.default_rng(seed), max(1, round(dt / 0.0125))
    fine = np.arange(0.0, end, dt / sub)
    n = len(fine) // sub
    fine = fine[: n * sub]
    step = dt / sub
    speed, altitude = np.empty(len(fine)), np.empty(len(fine))
    v, h = 5420.0, 1.32e5
    for k in range(len(fine)):
        speed[k], altitude[k] = v, h
        gamma = np.deg2rad(11.5 + 12 * (fine[k] / 245.0) ** 4)
        v += step * (-0.5 * 2.1e-2 * np.exp(-h / H) * v**2 * AREA * 1.68 / MASS + G * np.sin(gamma))
        h -= step * v * np.sin(gamma)
    rho = 2.1e-2 * np.exp(-altitude / H)
    total = np.deg2rad(2.0 + 1.2 * np.sin(0.05 * fine))
    turn = 1.3 * fine
    lateral = np.stack((np.sin(total) * np.sin(turn), np.sin(total) * np.cos(turn)), axis=1)
    direction = np.column_stack((np.cos(total), lateral))
    entry = DATABASE.lookup(GAS.mach(speed, T), GAS.knudsen(rho, D), total, speed)
    cn, cy, cm, yaw = split(entry.cn + added_cn, entry.cm_at(X), *lateral.T)
    q = 0.5 * rho * speed**2
    force = (q * AREA / MASS)[:, None] * np.stack((-entry.ca, cy, -cn), axis=1)
    moment = (q * AREA * D)[:, None] * np.stack((ROLLING + 0 * cm, cm, yaw), axis=1)
    inverse, rate = np.linalg.inv(INERTIA), np.empty((len(fine), 3))
    w = np.array([0.21, 0.0, 0.0])

    def slope(w, m):
        a, b, c = w
        x, y, z = INERTIA @ w
        return inverse @ (m - np.array([b * z - c * y, c * x - a * z, a * y - b * x]))

    for k in range(len(fine)):
        rate[k] = w
        after = moment[min(k + 1, len(fine) - 1)]
        first = slope(w, moment[k])
        second = slope(w + step * first, after)
        w = w + 0.5 * step * (first + second)

    def mean(x):
        return x.reshape(n, sub, *x.shape[1:]).mean(axis=1)

    force, rate = mean(force), mean(rate)
    if noisy:
        force += NOISE * rng.normal(size=force.shape)
        rate += GYRO * rng.normal(size=rate.shape)
    time, velocity = mean(fine), mean(direction * speed[:, None])
    v = np.linalg.norm(velocity, axis=1)
    ones = np.ones(n)
    return PostflightInputs(
        time=time, altitude=mean(altitude), speed=v, gravity=G * ones,
        geopotential=G * mean(altitude), velocity_body=velocity,
        alpha=np.arctan2(velocity[:, 2], velocity[:, 0]), beta=np.arcsin(velocity[:, 1] / v),
        alpha_total=np.arctan2(np.hypot(velocity[:, 1], velocity[:, 2]), velocity[:, 0]),
        speed_sigma=0.0 * ones, angle_sigma=0.0 * ones, specific_force=force, angular_rate=rate,
        force_noise=NOISE * ones, rate_noise=GYRO * ones, bias_sigma=np.zeros(3), mass=MASS, diameter=D, x_over_d=X,
        inertia=INERTIA, gas=GAS, database=DATABASE,
        discrepancy=DiscrepancyPrior(1.0, 1e4, 1e4, 1e4), preflight_density=mean(rho), preflight_temperature=T * ones,
        parachute=240.0, preflight_sigma=0.1, top_temperature=T,
    )  # fmt: skip


#: One sigma of the errors of a reconstruction: kg, relative, m/s², rad, rad, m/s, relative, K.
ERRORS = {
    "mass": 5.0, "inertia": 0.05, "bias": 2e-3, "alignment": 1e-3, "angle": 4e-3, "speed": 3.0, "preflight": 0.1,
    "top_temperature": 10.0,
}  # fmt: skip


def reconstructed(seed, common=None, axial=None):
    """The flight with the errors of one reconstruction.

    Parameters
    ----------
    common : (14,) array, optional
        The errors common to the flight, in sigmas; drawn if absent.
    axial : (N,) array, optional
        One sigma of the axial force relative to the database's; absent: the force is that of the database.
    """
    rng, i, e = np.random.default_rng(seed), flight(noisy=False), ERRORS
    n, numbers = len(i.time), iter(rng.normal(size=COMMON) if common is None else common)

    def draw(size):
        return np.array([next(numbers) for _ in range(size)])

    turn, bias, across = e["alignment"] * draw(3), e["bias"] * draw(3), e["angle"] * draw(2)
    force = i.specific_force + np.cross(np.broadcast_to(turn, (n, 3)), i.specific_force) + bias
    (speed_error, mass_error, inertia_error, density_error, temperature_error, axial_error), ones = draw(6), np.ones(n)
    if axial is not None:
        force[:, 0] *= 1.0 + axial * axial_error
    # the error of the air's direction is a rotation that is fixed in space, so in body axes it rotates with the roll
    roll = np.cumsum(np.gradient(i.time) * i.angular_rate[:, 0])
    y = across[0] * np.cos(roll) + across[1] * np.sin(roll)
    z = across[1] * np.cos(roll) - across[0] * np.sin(roll)
    speed = i.speed + e["speed"] * speed_error
    direction = i.velocity_body / i.speed[:, None] + np.stack((0.0 * y, y, z), axis=1)
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    u, v, w = direction.T
    return replace(
        i, speed=speed, velocity_body=direction * speed[:, None], alpha=np.arctan2(w, u), beta=np.arcsin(v),
        alpha_total=np.arctan2(np.hypot(v, w), u), speed_sigma=e["speed"] * ones, angle_sigma=e["angle"] * ones,
        specific_force=force + NOISE * rng.normal(size=(n, 3)),
        angular_rate=i.angular_rate + GYRO * rng.normal(size=(n, 3)), bias_sigma=e["bias"] * np.ones(3),
        alignment_sigma=e["alignment"], mass=i.mass + e["mass"] * mass_error, mass_sigma=e["mass"],
        inertia=i.inertia * (1.0 + e["inertia"] * inertia_error), inertia_relative=e["inertia"],
        preflight_density=i.preflight_density * (1.0 + e["preflight"] * density_error), preflight_sigma=e["preflight"],
        top_temperature=T + e["top_temperature"] * temperature_error, top_temperature_sigma=e["top_temperature"],
    )  # fmt: skip


#: Number of errors that are drawn once per flight.
COMMON = 14
#: What is compared with the truth: coefficients, density, temperature, CA with the preflight density, angles.
QUANTITIES = (
    "CN", "CY", "Cm", "Cn", "Cl", "density", "temperature", "CA", "alpha_forces", "beta_forces", "alpha_moments",
    "beta_moments", "alpha_between", "beta_between",
)  # fmt: skip


def normalised_errors(result, truth, axial=None):
    """Errors of one derived flight in units of their sigmas, by name, (N,); NaN where nothing is derived.

    A coefficient is compared with the database's at the reconstructed angle as measured, an angle where there is one
    solution. With `axial` the database's CA has its own sigma too.
    """
    case, preflight, n = result.flight, result.preflight, len(result.time)
    coefficients, expected, angles = case.coefficients, case.database_measured.value, case.angles
    out = {}
    for name in ("CN", "CY", "Cm", "Cn", "Cl"):
        sigma = np.hypot(coefficients.sigma(name), case.database.angle_sigma[name])
        out[name] = (coefficients.value[name] - (ROLLING if name == "Cl" else expected[name])) / sigma
    out["density"] = (case.atmosphere.density - truth.preflight_density[:n]) / case.atmosphere.density_sigma
    out["temperature"] = (case.atmosphere.temperature - T) / case.atmosphere.temperature_sigma
    sigma = preflight.coefficients.sigma("CA")
    sigma = sigma if axial is None else np.hypot(sigma, preflight.atmosphere.ca_sigma)
    out["CA"] = (preflight.coefficients.value["CA"] - preflight.database.value["CA"]) / sigma
    unique = {"forces": case.forces.status == 1, "moments": case.moments.status == 1}
    unique["between"] = unique["forces"] & unique["moments"]
    for name in QUANTITIES[-6:]:
        kind = name.split("_")[1]
        out[name] = np.where(unique[kind], getattr(angles, name) / getattr(angles, f"{kind}_sigma"), np.nan)
    return out


def common_errors(count):
    """Common errors of `count` flights (a power of two) in sigmas: a Sobol sequence, so that few flights suffice."""
    return norm.ppf(qmc.Sobol(COMMON, seed=1).random(count))


def shares(count, axial=None):
    """Share of the samples of `count` flights that lie within two sigma: window → quantity → share."""
    truth = flight(noisy=False)
    clean = derive(truth)
    errors = [
        normalised_errors(derive(reconstructed(k, common, axial)), truth, axial)
        for k, common in enumerate(common_errors(count))
    ]
    by_window = {}
    for window in clean.windows:
        inside = window.mask(clean.time)
        by_name = {name: np.concatenate([e[name][inside] for e in errors]) for name in QUANTITIES}
        by_window[window.name] = {name: np.mean(np.abs(z[np.isfinite(z)]) < 2.0) for name, z in by_name.items()}
    return by_window


def axial_sigma():
    """Relative one sigma of the database's CA along the whole flight."""
    truth = flight(noisy=False)
    profile = derive(truth).flight.atmosphere
    relative = profile.ca_sigma / profile.ca
    relative = np.where(np.isfinite(relative), relative, relative[np.isfinite(relative)][0])
    return np.interp(truth.time, profile.time, relative)
