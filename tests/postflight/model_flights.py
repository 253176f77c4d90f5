"""A made flight with the model's own physics, and the errors that a reconstruction of it may have."""

from dataclasses import replace
from functools import cache

import numpy as np
from scipy.stats import norm, qmc

from edl_filter.aero.database import shipped_database, split
from edl_filter.postflight.derive import DeriveInputs, derive
from edl_filter.postflight.gas import Gas

GAS, D, MASS, X, G, T = Gas(), 2.65, 830.0, 0.27, 3.7, 180.0
H, AREA = GAS.constant * T / G, np.pi / 4 * D**2
INERTIA = np.array([[400.0, -1.0, 0.5], [-1.0, 303.0, 0.2], [0.5, 0.2, 300.0]])
DATABASE = shipped_database(family="MER")
NOISE, GYRO = 3e-3, 4e-5
#: True rolling-moment coefficient.
ROLLING = 1e-6


@cache
def flight(dt=0.125, seed=1, noisy=True, spoil=0.0, end=245.0):
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
    found = DATABASE.lookup(GAS.mach(speed, T), GAS.knudsen(rho, D), total, speed)
    cn, cy, cm, yaw = split(found.cn + spoil, found.cm_at(X), *lateral.T)
    q = 0.5 * rho * speed**2
    force = (q * AREA / MASS)[:, None] * np.stack((-found.ca, cy, -cn), axis=1)
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
        one = slope(w, moment[k])
        two = slope(w + step * one, after)
        w = w + 0.5 * step * (one + two)

    def mean(x):
        return x.reshape(n, sub, *x.shape[1:]).mean(axis=1)

    force, rate = mean(force), mean(rate)
    if noisy:
        force += NOISE * rng.normal(size=force.shape)
        rate += GYRO * rng.normal(size=rate.shape)
    time, velocity = mean(fine), mean(direction * speed[:, None])
    v = np.linalg.norm(velocity, axis=1)
    rows = np.ones(n)
    return DeriveInputs(
        time=time, altitude=mean(altitude), speed=v, gravity=G * rows, velocity_body=velocity,
        alpha=np.arctan2(velocity[:, 2], velocity[:, 0]), beta=np.arcsin(velocity[:, 1] / v),
        alpha_total=np.arctan2(np.hypot(velocity[:, 1], velocity[:, 2]), velocity[:, 0]),
        speed_sigma=0.0 * rows, angle_sigma=0.0 * rows, specific_force=force, angular_rate=rate,
        force_noise=NOISE * rows, rate_noise=GYRO * rows, bias_sigma=np.zeros(3), mass=MASS, diameter=D, x_over_d=X,
        inertia=INERTIA, gas=GAS, database=DATABASE, preflight_density=mean(rho), preflight_temperature=T * rows,
        parachute=240.0, preflight_sigma=0.1, top_temperature=T,
    )  # fmt: skip


#: One sigma of the errors that a reconstruction leaves: kg, relative, m/s², rad, rad, m/s, relative, K.
ERRORS = {
    "mass": 5.0, "inertia": 0.05, "bias": 2e-3, "alignment": 1e-3, "angle": 4e-3, "speed": 3.0, "preflight": 0.1,
    "top_temperature": 10.0,
}  # fmt: skip


def reconstructed(seed, common=None, axial=None):
    """The flight as one reconstruction has it.

    Parameters
    ----------
    common : (14,) array, optional
        The errors common to the flight, in sigmas; drawn if not given.
    axial : (N,) array, optional
        One sigma of the axial force against the database's, relative; none is the database's own physics.
    """
    rng, i, e = np.random.default_rng(seed), flight(noisy=False), ERRORS
    n, given = len(i.time), iter(rng.normal(size=COMMON) if common is None else common)

    def draw(size):
        return np.array([next(given) for _ in range(size)])

    turn, bias, across = e["alignment"] * draw(3), e["bias"] * draw(3), e["angle"] * draw(2)
    force = i.specific_force + np.cross(np.broadcast_to(turn, (n, 3)), i.specific_force) + bias
    (faster, heavier, stiffer, denser, warmer, blunter), rows = draw(6), np.ones(n)
    if axial is not None:
        force[:, 0] *= 1.0 + axial * blunter
    # the air's direction is off by a rotation that is fixed in space, so it turns in the body as the body rolls
    roll = np.cumsum(np.gradient(i.time) * i.angular_rate[:, 0])
    y = across[0] * np.cos(roll) + across[1] * np.sin(roll)
    z = across[1] * np.cos(roll) - across[0] * np.sin(roll)
    speed = i.speed + e["speed"] * faster
    direction = i.velocity_body / i.speed[:, None] + np.stack((0.0 * y, y, z), axis=1)
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    u, v, w = direction.T
    return replace(
        i, speed=speed, velocity_body=direction * speed[:, None], alpha=np.arctan2(w, u), beta=np.arcsin(v),
        alpha_total=np.arctan2(np.hypot(v, w), u), speed_sigma=e["speed"] * rows, angle_sigma=e["angle"] * rows,
        specific_force=force + NOISE * rng.normal(size=(n, 3)),
        angular_rate=i.angular_rate + GYRO * rng.normal(size=(n, 3)), bias_sigma=e["bias"] * np.ones(3),
        alignment_sigma=e["alignment"], mass=i.mass + e["mass"] * heavier, mass_sigma=e["mass"],
        inertia=i.inertia * (1.0 + e["inertia"] * stiffer), inertia_relative=e["inertia"],
        preflight_density=i.preflight_density * (1.0 + e["preflight"] * denser), preflight_sigma=e["preflight"],
        top_temperature=T + e["top_temperature"] * warmer, top_temperature_sigma=e["top_temperature"],
    )  # fmt: skip


#: Numbers drawn once for a flight.
COMMON = 14
#: What is compared with the truth: coefficients, density, temperature, CA with the preflight density, angles.
QUANTITIES = (
    "CN", "CY", "Cm", "Cn", "Cl", "density", "temperature", "CA", "alpha_forces", "beta_forces", "alpha_moments",
    "beta_moments", "alpha_between", "beta_between",
)  # fmt: skip


def misses(run, truth, axial=None):
    """Misses of one derived flight in its own sigmas, by name, (N,); NaN where it says nothing.

    A coefficient is compared with the database's at the reconstructed angle as measured, an angle where there is one
    solution. Where CA is not the database's own, the database has its own sigma in it too.
    """
    n, known = len(run.time), run.database_measured.value
    out = {}
    for name in ("CN", "CY", "Cm", "Cn", "Cl"):
        sigma = np.hypot(run.coefficients.sigma(name), run.database.angle_sigma[name])
        out[name] = (run.coefficients.value[name] - (ROLLING if name == "Cl" else known[name])) / sigma
    out["density"] = (run.flight.density - truth.preflight_density[:n]) / run.flight.density_sigma
    out["temperature"] = (run.flight.temperature - T) / run.flight.temperature_sigma
    other = run.coefficients_preflight
    sigma = other.sigma("CA") if axial is None else np.hypot(other.sigma("CA"), run.preflight.ca_sigma)
    out["CA"] = (other.value["CA"] - run.database_preflight.value["CA"]) / sigma
    one = {"forces": run.forces.status == 1, "moments": run.from_moments.status == 1}
    one["between"] = one["forces"] & one["moments"]
    for name in QUANTITIES[-6:]:
        way = name.split("_")[1]
        out[name] = np.where(one[way], getattr(run.angles, name) / getattr(run.angles, f"{way}_sigma"), np.nan)
    return out


def spread(count):
    """Common errors of `count` flights (a power of two) in sigmas: a Sobol sequence, so that few do for many."""
    return norm.ppf(qmc.Sobol(COMMON, seed=1).random(count))


def shares(count, axial=None):
    """Share of the samples of `count` flights that lie within two sigma: window → quantity → share."""
    truth = flight(noisy=False)
    clean = derive(truth)
    seen = [misses(derive(reconstructed(k, common, axial)), truth, axial) for k, common in enumerate(spread(count))]
    found = {}
    for window in clean.windows:
        inside = window.mask(clean.time)
        by_name = {name: np.concatenate([m[name][inside] for m in seen]) for name in QUANTITIES}
        found[window.name] = {name: np.mean(np.abs(z[np.isfinite(z)]) < 2.0) for name, z in by_name.items()}
    return found


def axial_sigma():
    """Relative one sigma of the database's CA along the whole flight."""
    truth = flight(noisy=False)
    known = derive(truth).flight
    relative = known.ca_sigma / known.ca
    relative = np.where(np.isfinite(relative), relative, relative[np.isfinite(relative)][0])
    return np.interp(truth.time, known.time, relative)
