"""Coefficients of whole flights: closure on simulated flights, and bands."""

from dataclasses import replace
from time import perf_counter

import numpy as np
import pytest
from model_flights import ROLLING, T, flight, shares

from edl_filter.errors import InputError
from edl_filter.postflight.averages import METHODS
from edl_filter.postflight.derive import derive
from edl_filter.postflight.inputs import at_middles


def test_closure_within_bands_in_every_window():
    results = [derive(flight(seed=s)) for s in range(3)]
    first, cases = results[0], [r.flight for r in results]
    assert len(first.windows) == 4
    for window in first.windows:
        inside = window.mask(first.time)
        for name in METHODS:
            errors = [c.coefficients.value[name] - c.database_measured.value[name] for c in cases]
            miss = np.abs(errors)[:, inside]
            sigma = first.flight.coefficients.sigma(name)[inside]
            assert np.mean(miss < 2 * sigma) > 0.94 and np.mean(miss < 3 * sigma) > 0.99, (window, name)
            if name in ("CN", "CY"):  # where noise alone is the larger part of the band
                noise = first.flight.coefficients.noise[name][inside]
                assert np.mean(miss < 2 * noise) > 0.93, (window, name)
        for r in results:
            rho = np.abs(r.flight.atmosphere.density - r.preflight.atmosphere.density)[inside]
            assert np.mean(rho < r.flight.atmosphere.density_sigma[inside]) > 0.95
    middle = (first.time > 90) & (first.time < 130)
    assert np.mean([c.coefficients.value["Cl"][middle].mean() for c in cases]) == pytest.approx(ROLLING, rel=0.1)
    assert np.all(first.flight.forces.status[first.time > first.domain.useful] >= 1)


@pytest.mark.slow
def test_closure_over_an_ensemble_with_errors_common_to_a_flight():
    """Mass, inertia, bias, alignment, angle, speed, densities: each drawn once per flight from its sigma.

    Gaussian bands hold 95.4 %. An error that is one number per flight and window changes the share in steps of one
    flight; two are allowed. `make study-closure` has 1024.
    """
    count = 64
    by_window = shares(count)
    assert len(by_window) == 4
    for window, by_name in by_window.items():
        for name, share in by_name.items():
            assert share >= 0.95 - 2.0 / count, (window, name, share)


def test_without_noise_it_closes_to_the_sampling():
    result = derive(flight(noisy=False))
    case, preflight = result.flight, result.preflight
    inside = (result.time > 55) & (result.time < 238)
    for name in METHODS:
        size = np.abs(case.database.value[name][inside]).max()
        miss = np.abs(case.coefficients.value[name] - case.database_measured.value[name])[inside].max()
        assert miss < 0.01 * size, name
    unique = inside & (case.forces.status == 1)
    assert np.abs(case.angles.alpha_forces[unique]).max() < 1e-3
    unique = inside & (case.moments.status == 1)
    assert np.median(np.abs(case.angles.alpha_between[unique])) < 2e-3
    np.testing.assert_allclose(case.atmosphere.density[inside], preflight.atmosphere.density[inside], rtol=2e-3)
    np.testing.assert_allclose(case.atmosphere.temperature[inside], T, rtol=3e-3)


@pytest.mark.slow
def test_bands_are_those_of_sampled_noise():
    results = [derive(flight(seed=s, end=120.0)) for s in range(24)]
    inside = (results[0].time > 60) & (results[0].time < 110)
    for name in (*METHODS, "Cl"):
        scatter = np.std([r.flight.coefficients.value[name][inside] for r in results], axis=0, ddof=1)
        stated = results[0].flight.coefficients.noise[name][inside]
        assert np.sqrt(np.mean((scatter / stated) ** 2)) == pytest.approx(1.0, abs=0.15), name


def test_coefficients_of_forces_or_moments_that_no_imu_has_read_are_not_measured():
    """The others, and those of all other samples, are the same to the bit; averages and angles leave them out."""
    inputs = flight()
    read = np.ones((len(inputs.time), 3), bool)
    read[800:900] = False
    whole = derive(inputs)
    for key, names in (("force_read", ("CA", "CN", "CY")), ("rate_read", ("Cl", "Cm", "Cn"))):
        part = derive(replace(inputs, **{key: read}))
        for case, other in ((part.flight, whole.flight), (part.preflight, whole.preflight)):
            used = read[: len(part.time), 0]
            for name in METHODS:
                expected = np.where(used, other.coefficients.value[name], np.nan)
                unread = expected if name in names else other.coefficients.value[name]
                np.testing.assert_array_equal(case.coefficients.value[name], unread)
                assert np.array_equal(np.isnan(case.coefficients.sigma(name)), np.isnan(unread))
            from_lost = case.forces if key == "force_read" else case.moments
            assert np.isnan(from_lost.alpha_total[~used]).all()
            np.testing.assert_array_equal(case.atmosphere.density, other.atmosphere.density)
        assert all(np.isfinite(change.mean) for change in part.changes)


def test_only_the_coefficients_of_an_axis_that_is_not_read_are_not_measured():
    inputs, read = flight(), np.ones((len(flight().time), 3), bool)
    read[800:900, 2] = False
    values = derive(replace(inputs, force_read=read, rate_read=read)).flight.coefficients.value
    assert [name for name in METHODS if np.isnan(values[name][800:900]).all()] == ["CN", "Cn"]
    assert all(np.isfinite(values[name][800:900]).all() for name in METHODS if name not in ("CN", "Cn"))


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


def test_time_grows_in_proportion_to_the_samples():
    """Five times the samples: five times the time or less if fixed costs count, 25 times if anything were quadratic."""

    def seconds(inputs):
        derive(inputs)
        begin = perf_counter()
        for _ in range(3):
            derive(inputs)
        return perf_counter() - begin

    assert seconds(flight(dt=0.025)) < 12.0 * seconds(flight(dt=0.125))
