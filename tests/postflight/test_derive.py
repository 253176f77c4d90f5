"""Coefficients, combinations, windows and averages: closure on made flights, and bands."""

from dataclasses import replace
from functools import cache
from time import perf_counter

import numpy as np
import pytest

from edl_filter.aero.database import shipped_database, split
from edl_filter.errors import InputError
from edl_filter.postflight.averages import METHODS
from edl_filter.postflight.comparison import database_coefficients, from_forces, from_moments
from edl_filter.postflight.derive import DeriveInputs, at_middles, derive
from edl_filter.postflight.gas import Gas
from edl_filter.postflight.windows import Window, crossing, sensed, useful_from

GAS, D, MASS, X, G, T = Gas(), 2.65, 830.0, 0.27, 3.7, 180.0
H, AREA = GAS.constant * T / G, np.pi / 4 * D**2
INERTIA = np.array([[400.0, -1.0, 0.5], [-1.0, 303.0, 0.2], [0.5, 0.2, 300.0]])
DATABASE = shipped_database(family="MER")
NOISE, GYRO = 3e-3, 4e-5


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
    moment = (q * AREA * D)[:, None] * np.stack((1e-6 + 0 * cm, cm, yaw), axis=1)
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


def test_closure_within_bands_in_every_window():
    runs = [derive(flight(seed=s)) for s in range(3)]
    assert len(runs[0].windows) == 4
    for window in runs[0].windows:
        inside = window.mask(runs[0].time)
        for name in METHODS:
            seen = [r.database_measured.value[name] for r in runs]
            miss = np.abs([r.coefficients.value[name] - x for r, x in zip(runs, seen, strict=True)])[:, inside]
            sigma = runs[0].coefficients.sigma(name)[inside]
            assert np.mean(miss < 2 * sigma) > 0.94 and np.mean(miss < 3 * sigma) > 0.99, (window, name)
            if name in ("CN", "CY"):  # where noise alone is the larger part of the band
                assert np.mean(miss < 2 * runs[0].coefficients.noise[name][inside]) > 0.93, (window, name)
        for r in runs:
            rho = np.abs(r.flight.density - r.preflight.density)[inside]
            assert np.mean(rho < r.flight.density_sigma[inside]) > 0.95
    spin = np.mean([r.coefficients.value["Cl"][(r.time > 90) & (r.time < 130)].mean() for r in runs])
    assert spin == pytest.approx(1e-6, rel=0.1)
    assert np.all(runs[0].forces.status[runs[0].time > runs[0].domain.useful] >= 1)


def test_without_noise_it_closes_to_the_sampling():
    found = derive(flight(noisy=False))
    inside = (found.time > 55) & (found.time < 238)
    for name in METHODS:
        size = np.abs(found.database.value[name][inside]).max()
        miss = np.abs(found.coefficients.value[name] - found.database_measured.value[name])[inside].max()
        assert miss < 0.01 * size, name
    unique = inside & (found.forces.status == 1)
    assert np.abs(found.angles.alpha_forces[unique]).max() < 1e-3
    unique = inside & (found.from_moments.status == 1)
    assert np.median(np.abs(found.angles.alpha_between[unique])) < 2e-3
    np.testing.assert_allclose(found.flight.density[inside], found.preflight.density[inside], rtol=2e-3)
    np.testing.assert_allclose(found.flight.temperature[inside], T, rtol=3e-3)


def test_bands_are_those_of_sampled_noise():
    runs = [derive(flight(seed=s, end=120.0)) for s in range(24)]
    inside = (runs[0].time > 60) & (runs[0].time < 110)
    for name in (*METHODS, "Cl"):
        scatter = np.std([r.coefficients.value[name][inside] for r in runs], axis=0, ddof=1)
        stated = runs[0].coefficients.noise[name][inside]
        assert np.sqrt(np.mean((scatter / stated) ** 2)) == pytest.approx(1.0, abs=0.15), name


def test_combinations_return_the_angle_of_a_look_up():
    i = flight(noisy=False)
    found = derive(i)
    keep = (found.time > 60) & (found.time < 235)
    looked = database_coefficients(i.database, found.flight, *cut(i, found), X)
    made = replace(found.coefficients, value={**found.coefficients.value, **looked.value})
    a = from_forces(i.database, found.flight, made, *cut(i, found), X)
    b = from_moments(i.database, found.flight, made, *cut(i, found), X)
    alpha, beta = i.alpha[: len(found.time)], i.beta[: len(found.time)]
    for combined in (a, b):
        assert np.abs(combined.alpha - alpha)[keep].max() < 1e-6
        assert np.abs(combined.beta - beta)[keep].max() < 1e-6
    for combined in (a, b):
        for name, value in combined.value.items():
            np.testing.assert_allclose(value[keep], looked.value[name][keep], atol=1e-8)
    assert (b.status[keep] == 2).any()  # the bounded instability


def cut(i, found):
    n = len(found.time)
    return i.speed[:n], i.velocity_body[:n]


def test_a_force_beyond_the_table_has_no_angle():
    i = flight(noisy=False)
    found = derive(i)
    huge = replace(found.coefficients, value={**found.coefficients.value, "CN": np.full(len(found.time), 5.0)})
    combined = from_forces(i.database, found.flight, huge, *cut(i, found), X)
    ok = found.flight.valid
    assert (combined.status[ok] == 0).all() and np.isnan(combined.alpha).all() and np.isnan(combined.value["Cm"]).all()
    assert (combined.status[~ok] == -1).all()


def test_averages_and_verdicts():
    clean, spoilt = derive(flight()), derive(flight(spoil=0.05))
    assert len(clean.differences) == (3 * 4 + 1) * len(clean.windows)
    assert len(clean.differences_preflight) == (3 * 4 + 2) * len(clean.windows)
    for row in clean.differences:
        if row.pair == "IMU-gyros" or row.pair == "IMU-accels":
            assert abs(row.mean) < 5 * row.mean_sigma + 1e-5
            assert row.percent == pytest.approx(100 * row.mean / row.three_sigma)
    assert all(v.within for v in clean.verdicts if v.coefficient != "Cl")
    # four planes and Cl with the flight's density, CA with the preflight one; each sentence has its rms
    judged = {(v.coefficient, v.density) for v in clean.verdicts}
    assert judged == {*((c, "flight") for c in (*METHODS, "Cl")), ("CA", "preflight")}
    assert all(f"(rms {v.rms:.2g})" in v.sentence for v in clean.verdicts)
    # an extra normal force turns with the lateral flow, so window means tell little of it and rms all
    rows = [r for r in spoilt.differences if r.pair == "IMU-accels"]
    assert all(r.rms > 0.03 for r in rows)
    wide = [v for v in clean.verdicts if v.wide]
    assert wide and all(v.ratio >= 10 and "times what this flight supports" in v.sentence for v in wide)
    own = derive(replace(flight(), windows=(Window("mine", 100.0, 120.0),)))
    assert {r.window for r in own.differences} == {"mine"}


def test_domain_and_windows():
    found = derive(flight())
    assert 5 < found.domain.start < found.domain.useful < 80
    assert found.marks.found["second"] == "database"
    second = found.marks.second
    speed = np.interp([second.start, second.end], flight().time, flight().speed)
    assert 3200 < speed[1] < speed[0] < 4000
    starts = [w.start for w in found.windows]
    assert starts == sorted(starts) and found.windows[-1].end <= 240.0
    t = np.arange(10.0)
    assert crossing(t, 10 - t, 4.5) == pytest.approx(5.5) and np.isnan(crossing(t, 10 - t, 30.0))
    noise = np.array([9, 1, 9, 1, 1, 1, 0.5, 9.0, 9, 9])
    assert useful_from(t, noise, np.full(10, 6.0)) == 3.0 and np.isnan(useful_from(t, noise, np.full(10, 0.3)))
    with pytest.raises(InputError, match="never rises"):
        sensed(t, np.zeros(10), np.ones(10))


def test_bad_input():
    i = flight()
    with pytest.raises(InputError, match="not positive definite"):
        derive(replace(i, inertia=np.diag([400.0, 300.0, -300.0])))
    with pytest.raises(InputError, match="density must decrease"):
        derive(replace(i, preflight_density=i.preflight_density[::-1].copy()))
    with pytest.raises(InputError, match="before the parachute"):
        derive(replace(i, parachute=-1.0))


def test_middles():
    t = np.array([0.0, 1.0, 2.5, 3.0, 4.0])
    np.testing.assert_allclose(at_middles(t, t**3), (0.5 * (t[1:] + t[:-1])) ** 3)


def test_a_stride_loses_nothing():
    i = flight(noisy=False)
    found = derive(i)
    each = from_moments(i.database, found.flight, found.coefficients, *cut(i, found), X, 1)
    some = from_moments(i.database, found.flight, found.coefficients, *cut(i, found), X, 2)
    keep = (each.status == 1) & (found.time > 60) & (found.time < 95)
    assert (
        np.abs(each.alpha - some.alpha)[keep].max() < 0.02 * np.abs(each.alpha[keep]).max()
    )  # (1.3 rad/s * 0.25 s)^2 / 8
    assert (some.status[keep] == 1).all()


def test_time_grows_in_proportion_to_the_samples():
    """Five times the samples: five times the time or less if fixed costs count, 25 times if anything were quadratic."""

    def seconds(inputs):
        derive(inputs)
        begin = perf_counter()
        for _ in range(3):
            derive(inputs)
        return perf_counter() - begin

    assert seconds(flight(dt=0.025)) < 12.0 * seconds(flight(dt=0.125))
