"""Coefficients, combinations, windows and averages: closure on made flights, and bands."""

from dataclasses import replace
from time import perf_counter

import numpy as np
import pytest
from made_flights import DATABASE, ROLLING, T, X, flight, shares

from edl_filter.errors import InputError
from edl_filter.postflight.averages import METHODS
from edl_filter.postflight.comparison import database_coefficients, from_forces, from_moments
from edl_filter.postflight.derive import at_middles, derive
from edl_filter.postflight.windows import Window, crossing, sensed, useful_from


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
    assert spin == pytest.approx(ROLLING, rel=0.1)
    assert np.all(runs[0].forces.status[runs[0].time > runs[0].domain.useful] >= 1)


def test_closure_over_an_ensemble_with_errors_common_to_a_flight():
    """Mass, inertia, bias, alignment, angle, speed, densities: each drawn once per flight from its sigma.

    Gaussian bands hold 95.4 %. What errs by one number per flight and window shows in steps of one flight; two are
    allowed. `make study-closure` has 1024.
    """
    count = 64
    found = shares(count)
    assert len(found) == 4
    for window, by_name in found.items():
        for name, share in by_name.items():
            assert share >= 0.95 - 2.0 / count, (window, name, share)


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


def test_a_centre_of_mass_beside_the_axis():
    """The moment about the moved point is ``M - d × F``, and from it the angle comes back."""
    i, (y, z) = flight(noisy=False), (0.004, -0.003)
    found = derive(i)
    on_axis = found.database.value
    looked = database_coefficients(i.database, found.flight, *cut(i, found), X, 0.0, (y, z))
    force = np.stack((-on_axis["CA"], on_axis["CY"], -on_axis["CN"]), axis=1)
    moved = np.stack([on_axis[k] for k in ("Cl", "Cm", "Cn")], axis=1) - np.cross([0.0, y, z], force)
    for k, name in enumerate(("Cl", "Cm", "Cn")):
        np.testing.assert_allclose(looked.value[name], moved[:, k], atol=1e-15)
    made = replace(found.coefficients, value={**found.coefficients.value, **looked.value})
    keep = (found.time > 60) & (found.time < 235)
    alpha = i.alpha[: len(found.time)]
    through = from_moments(i.database, found.flight, made, *cut(i, found), X, 1, (y, z))
    assert np.abs(through.alpha - alpha)[keep].max() < 1e-5
    for name in ("CN", "CY"):
        np.testing.assert_allclose(through.value[name][keep], looked.value[name][keep], atol=1e-6)
    forces = from_forces(i.database, found.flight, made, *cut(i, found), X, 1, (y, z))
    one = keep & (forces.status == 1)
    np.testing.assert_allclose(forces.value["Cm"][one], looked.value["Cm"][one], atol=1e-8)
    # as if on the axis, the moments would ask for an angle that is degrees off
    plain = from_moments(i.database, found.flight, made, *cut(i, found), X)
    assert np.nanmax(np.abs(plain.alpha - alpha)[keep]) > np.deg2rad(1.0)


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
    at = np.interp(found.marks.continuum, found.time, np.nan_to_num(found.flight.knudsen))
    assert at == pytest.approx(found.marks.continuum_limit, rel=1e-3) and found.marks.continuum_limit == 1e-3
    thin = replace(DATABASE, continuum_limit=1e-9)
    assert derive(replace(flight(), database=thin)).marks.continuum is None
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


def test_with_a_stride_only_nan_tells_whether_there_is_a_value():
    """The status of a sample between two is the earlier one's; its values are NaN if either has no solution."""
    i = flight(noisy=False)
    found = derive(i)
    value = {name: v.copy() for name, v in found.coefficients.value.items()}
    asked = np.flatnonzero(found.flight.valid)[::4]
    hole = asked[200]
    value["CN"][hole] = 5.0  # beyond the table
    some = from_forces(i.database, found.flight, replace(found.coefficients, value=value), *cut(i, found), X, 4)
    assert np.isnan(some.alpha[hole]) and some.status[hole] == 0
    before, after = slice(hole - 3, hole), slice(hole + 1, hole + 4)
    assert (some.status[before] >= 1).all() and np.isnan(some.alpha[before]).all()
    assert (some.status[after] == 0).all() and np.isnan(some.alpha[after]).all()
    assert np.isfinite(some.alpha[hole - 4]) and np.isfinite(some.alpha[hole + 4])


def test_time_grows_in_proportion_to_the_samples():
    """Five times the samples: five times the time or less if fixed costs count, 25 times if anything were quadratic."""

    def seconds(inputs):
        derive(inputs)
        begin = perf_counter()
        for _ in range(3):
            derive(inputs)
        return perf_counter() - begin

    assert seconds(flight(dt=0.025)) < 12.0 * seconds(flight(dt=0.125))
