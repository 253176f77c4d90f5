"""Gas, density, pressure and temperature: closed forms, and bands against Monte Carlo."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from edl_filter.aero.discrepancy import DiscrepancyPrior
from edl_filter.aero.transition import bridge
from edl_filter.aero.uncertainty import ThreeSigma
from edl_filter.errors import InputError
from edl_filter.planet.gas import Gas
from edl_filter.postflight.atmosphere import check_decreasing, preflight_atmosphere
from edl_filter.postflight.density import AxialForce, extract_atmosphere

GAS, D, MASS, G, T = Gas(), 2.65, 830.0, 3.7, 180.0
H = GAS.constant * T / G
AREA = np.pi / 4 * D**2
#: One error of CA in all flow, and the default lengths.
COMMON, FIELD = DiscrepancyPrior(1.0, 1e4, 1e4, 1e4), DiscrepancyPrior()


class Drag:
    """Substitute for a database: CA from Knudsen number, Mach number and angle; CN and Cm linear in the angle.

    All flow is a continuum, unless a limit is stated.
    """

    join = "continuous"

    def __init__(self, ca=lambda mach, knudsen, alpha: 1.7 + 0 * mach, sigma=0.05, continuum_limit=1e3):
        self.ca, self.sigma, self.continuum_limit = ca, sigma, continuum_limit

    def lookup(self, mach, knudsen, alpha, speed=None):
        ca = self.ca(mach, knudsen, alpha)
        ones = np.ones_like(ca)
        return SimpleNamespace(
            ca=ca,
            cn=0.2 * alpha,
            cm_nose=-0.15 * alpha,
            outside=ones < 0,
            rarefied=knudsen > 1e-3,
            three_sigma=ThreeSigma(self.sigma * ca, 0.01 * ones, 0.003 * ones, 1e-6 * ones),
            cm_at=lambda x: (-0.15 + 0.2 * x) * alpha,
        )


def entry(n=2000, database=None):
    """Descent through an isothermal exponential atmosphere; the true axial force."""
    database = database or Drag()
    t = np.linspace(0.0, 200.0, n)
    h = 1e5 - 450.0 * t
    rho = 5e-7 * np.exp((1e5 - h) / H)
    v = 5400.0 / (1.0 + np.exp((t - 140.0) / 20.0)) + 400.0
    alpha = np.full(n, 0.03)
    ca = database.lookup(GAS.mach(v, T), GAS.knudsen(rho, D), alpha).ca
    ax = -0.5 * rho * v**2 * AREA * ca / MASS
    return SimpleNamespace(t=t, h=h, rho=rho, v=v, alpha=alpha, ax=ax, g=np.full(n, G), n=n, database=database)


def extract(e, ax=None, *, noise=1e-9, top=T, mass=MASS, **keywords):
    ax = e.ax if ax is None else ax
    raw = np.broadcast_to(np.asarray(noise, float), e.t.shape)
    axial = AxialForce(ax, raw, raw, keywords.pop("bias", 0.0), mass, keywords.pop("mass_sigma", 0.0))
    valid = keywords.pop("valid", np.ones(e.n, bool))
    return extract_atmosphere(
        e.t, e.h, e.v, e.alpha, e.g, e.g * e.h, axial, valid, e.database, GAS, D, top_temperature=top,
        **{"discrepancy": COMMON, **keywords},
    )  # fmt: skip


def test_gas_closed_forms():
    n = 1e-5 / GAS.molecule_mass
    assert GAS.mean_free_path(1e-5) == pytest.approx(1 / (np.sqrt(2) * np.pi * 4.64e-10**2 * n))
    assert GAS.knudsen(1e-5, 2.0) == pytest.approx(GAS.mean_free_path(1e-5) / 2)
    assert GAS.temperature(GAS.constant * 200 * 1e-3, 1e-3) == pytest.approx(200)
    assert GAS.mach(500.0, 200.0) == pytest.approx(500 / np.sqrt(1.3 * 188.92 * 200))


@pytest.mark.parametrize(
    "ca",
    [
        lambda m, k, a: 1.7 + 0 * m,
        lambda m, k, a: 1.7 + 0.3 / (1 + 1e-2 / k) + 0.01 * np.tanh(m - 5) - a**2,
    ],
)
def test_an_exponential_atmosphere_comes_back(ca):
    e = entry(database=Drag(ca))
    profile = extract(e)
    np.testing.assert_allclose(profile.density, e.rho, rtol=2e-8)
    np.testing.assert_allclose(profile.pressure, e.rho * GAS.constant * T, rtol=2e-8)
    np.testing.assert_allclose(profile.temperature, T, rtol=2e-8)
    np.testing.assert_allclose(profile.mach, GAS.mach(e.v, T), rtol=2e-8)
    assert 1 <= profile.iterations < 20


def test_pressure_from_zero_forgets_its_start():
    e = entry()
    profile = extract(e, top=None)
    late = e.rho > 1000 * e.rho[0]
    np.testing.assert_allclose(profile.temperature[late], T, rtol=1.1e-3)
    np.testing.assert_allclose(profile.pressure, (e.rho - e.rho[0]) * G * H, rtol=1e-7, atol=1e-12)


def test_the_slow_twin():
    """Fixed point and hydrostatic integral written out sample by sample."""
    database = Drag(lambda m, k, a: 1.6 + 0.3 / (1 + 1e-2 / k) + 0.004 * m)
    e = entry(400, database)
    profile = extract(e, top=T)
    temperature = np.full(e.n, 250.0)
    rho = e.rho * 1.3
    for _ in range(60):
        for i in range(e.n):
            ca = database.lookup(GAS.mach(e.v[i], temperature[i]), GAS.knudsen(rho[i], D), e.alpha[i]).ca
            rho[i] = -2 * MASS * e.ax[i] / (ca * AREA * e.v[i] ** 2)
        p = np.empty(e.n)
        p[0] = rho[0] * GAS.constant * T
        for i in range(1, e.n):
            fine = np.linspace(0, 1, 41)
            weight = np.exp(np.interp(fine, [0, 1], np.log([rho[i - 1], rho[i]]))) * G
            p[i] = p[i - 1] + np.trapezoid(weight, fine) * (e.h[i - 1] - e.h[i])
        temperature = GAS.temperature(p, rho)
    np.testing.assert_allclose(profile.density, rho, rtol=1e-5)
    np.testing.assert_allclose(profile.temperature, temperature, rtol=1e-4)


def test_nothing_outside_the_valid_stretch_and_mass_in_time():
    e = entry()
    valid = e.t > 30
    mass = np.where(e.t > 100, 0.5, 1.0) * MASS
    profile = extract(e, e.ax * MASS / mass, valid=valid, mass=mass)
    assert np.isnan(profile.density[~valid]).all() and np.isfinite(profile.temperature[valid]).all()
    np.testing.assert_allclose(profile.density[valid], e.rho[valid], rtol=2e-8)


def test_bands_are_those_of_sampled_errors():
    rng, e = np.random.default_rng(5), entry(400)
    noise, bias, ca, mass, v = 2e-4, 1e-4, 0.02, 6.0, 8.0
    wind, sink, turn = 5.0 + 0.05 * e.t, 4.0, 5e-3
    e.database = Drag(lambda m, k, a: 1.7 - 2.0 * a**2)
    keywords = {"noise": noise, "bias": bias, "mass_sigma": mass, "speed_sigma": v, "angle_sigma": turn}
    keywords |= {"wind_sigma": wind, "sink_sigma": sink}
    e.database.sigma = 3 * ca
    band = extract(e, **keywords, top_temperature_sigma=10.0)
    runs = []
    for _ in range(600):
        factor = 1 + ca * rng.normal()
        lower = Drag(lambda m, k, a, f=factor: f * (1.7 - 2.0 * a**2))
        # the error of the angle rotates with the body: at any sample either sign is as frequent
        alpha = e.alpha + turn * (np.cos(e.t) * rng.normal() + np.sin(e.t) * rng.normal())
        shifted = replace_entry(
            e, v=e.v + v * rng.normal() + wind * rng.normal(), h=e.h + sink * e.t * rng.normal(), alpha=alpha,
            database=lower,
        )  # fmt: skip
        measured = e.ax + bias * rng.normal() + noise * rng.normal(size=e.n)
        profile = extract(shifted, measured, mass=MASS + mass * rng.normal(), top=T + 10.0 * rng.normal())
        runs.append((profile.density, profile.pressure, profile.temperature))
    scatter = np.std(np.array(runs), axis=0)
    for got, stated in zip(scatter, (band.density_sigma, band.pressure_sigma, band.temperature_sigma), strict=True):
        ratio = got[5:] / stated[5:]
        assert np.all(np.abs(ratio - 1) < 0.15), (ratio.min(), ratio.max())


def test_a_preflight_density_at_a_wrong_altitude():
    """500 m are 5 % of a scale height."""
    e = entry()
    profile = preflight_atmosphere(
        e.t, e.h, e.v, e.alpha, e.rho, np.full(e.n, T), e.database, GAS, D, altitude_sigma=500.0, gravity=G
    )
    np.testing.assert_allclose(profile.density_sigma, e.rho * 500.0 / H)


def test_noise_and_bias_of_the_first_samples_reach_the_top():
    """The density there is a fit's end, and the pressure below remembers it: 5 % of noise and of bias at the top."""
    rng, e = np.random.default_rng(2), entry(400)
    size = 0.05 * abs(e.ax[0])
    e.database.sigma = 0.0
    band = extract(e, noise=size, bias=size)
    runs = [extract(e, e.ax + size * rng.normal() + size * rng.normal(size=e.n)).pressure for _ in range(600)]
    ratio = np.std(runs, axis=0)[:200] / band.pressure_sigma[:200]
    assert np.all(np.abs(ratio - 1) < 0.15), (ratio.min(), ratio.max())


def replace_entry(e, **changes):
    return SimpleNamespace(**{**vars(e), **changes})


def test_common_errors_cancel_in_temperature():
    e = entry()
    e.database.sigma = 0.15
    profile = extract(e, mass_sigma=20.0)
    assert np.all(profile.temperature_sigma < 0.002 * T)
    np.testing.assert_allclose(profile.pressure_sigma / profile.pressure, np.hypot(0.05, 20 / MASS), rtol=1e-3)


@pytest.mark.parametrize("exponent", [0.7, 0.85, 1.2, 1.4])
def test_the_band_of_the_temperature_contains_another_bridge(exponent):
    """CA of the flight is bridged with another power of the weight: 0.8 to 1.6 sigma of CA by the thesis's 5 %."""

    def ca(power):
        return lambda m, k, a: 1.724 + 0.377 * bridge(k) ** power + 0 * m

    e = entry(4000)
    e.h = 1.28e5 - 600.0 * e.t
    e.rho = 2e-9 * np.exp((e.h[0] - e.h) / H)
    knudsen = GAS.knudsen(e.rho, D)
    e.ax = -0.5 * e.rho * e.v**2 * AREA * ca(exponent)(0.0, knudsen, e.alpha) / MASS
    e.database = Drag(ca(1.0), continuum_limit=1e-3)
    profile = extract(e, discrepancy=FIELD)
    transitional = (knudsen < 10.0) & (knudsen > 1e-4)
    error = np.abs(profile.temperature - T)[transitional]
    of_density = np.max((np.abs(profile.density - e.rho) / profile.density_sigma)[transitional])
    assert error.max() > 0.5  # K
    assert 0.7 < of_density < 1.7
    # no further off than CA itself, in sigmas
    assert np.max(error / profile.temperature_sigma[transitional]) < of_density
    # an error of CA that is the same at all altitudes changes no temperature and would leave no band
    e.database = Drag(ca(1.0))
    assert np.all(extract(e).temperature_sigma[transitional] < 1e-3)


@pytest.mark.parametrize("separate", [False, True])
def test_the_band_of_a_field_of_ca_over_mach_and_knudsen_number(separate):
    """Realisations of the field by the Cholesky factor of its covariance, point by point."""
    rng, e = np.random.default_rng(4), entry(400)
    e.database = Drag(lambda m, k, a: 1.7 + 0.0 * k, sigma=0.06, continuum_limit=1e-3)
    e.database.join = "switch" if separate else "blend"
    band, runs = extract(e, discrepancy=FIELD), []
    mach, knudsen = GAS.mach(e.v, T), GAS.knudsen(e.rho, D)
    rarefied = knudsen > 1e-3
    x = np.where(rarefied, np.log10(knudsen / 1e-3), np.log(mach / mach[~rarefied].max()) / 0.5)
    d = np.sqrt(3.0) * np.abs(np.subtract.outer(x, x))
    covariance = (1.0 + d) * np.exp(-d)
    if separate:
        covariance[rarefied[:, None] != rarefied] = 0.0
    root = np.linalg.cholesky(covariance + 1e-9 * np.eye(e.n))
    for _ in range(600):
        profile = extract(e, e.ax * (1.0 + 0.02 * root @ rng.normal(size=e.n)))
        runs.append((profile.density, profile.pressure, profile.temperature))
    scatter = np.std(np.array(runs), axis=0)
    for got, stated in zip(scatter, (band.density_sigma, band.pressure_sigma, band.temperature_sigma), strict=True):
        visible = stated > 0.2 * stated.max()
        assert np.all(np.abs(got[visible] / stated[visible] - 1) < 0.15)
    # one error common to all flow would leave nearly no band of the temperature
    assert np.median(band.temperature_sigma) > 10.0 * np.median(extract(e).temperature_sigma)


def test_a_sample_at_a_step_of_the_database_takes_the_mean_of_both_sides():
    """With the continuum's CA the density is rarefied, and vice versa: no CA of the database is consistent."""
    e = entry(n=20000, database=Drag(lambda m, k, a: 1.713 + 0 * m))
    step = Drag(lambda m, k, a: np.where(k > 1e-3, 1.712, 1.714))
    profile = extract(replace_entry(e, database=step))
    either = np.where(profile.knudsen > 1e-3, 1.712, 1.714)
    ratio = profile.density / e.rho * either / 1.713
    between = np.abs(ratio - 1.0) > 1e-6
    assert 1 <= between.sum() <= 3
    np.testing.assert_allclose(profile.density[between], e.rho[between], rtol=1e-6)
    assert np.abs(np.log(profile.knudsen[between] / 1e-3)).max() < 0.002


def test_a_cycle_of_three_iterations_at_a_step_has_the_mean_of_both_sides():
    """On the continuum's side CA converges to a value beyond the step, and crosses it after two iterations only."""
    e = entry(n=20000, database=Drag(lambda m, k, a: 1.72 + 0 * m))
    step = Drag(lambda m, k, a: np.where(k > 1e-3, 1.71, 1.7235 * (k / 1e-3) ** 0.2))
    profile = extract(replace_entry(e, database=step))
    near = np.abs(np.log(profile.knudsen / 1e-3)) < 0.02
    ratio = profile.density / e.rho
    assert near.any() and np.all((ratio[near] > 1.72 / 1.7235 - 1e-9) & (ratio[near] < 1.72 / 1.71 + 1e-9))


def test_preflight():
    e = entry()
    profile = preflight_atmosphere(
        e.t, e.h, e.v, e.alpha, e.rho, np.full(e.n, T), e.database, GAS, D, density_sigma=0.1
    )
    np.testing.assert_allclose(profile.pressure, e.rho * GAS.constant * T)
    np.testing.assert_allclose(profile.density_sigma, 0.1 * e.rho)
    assert profile.iterations == 0 and profile.valid.all()


def test_bad_input():
    e = entry()
    with pytest.raises(InputError, match="never rises"):
        extract(e, valid=np.zeros(e.n, bool))
    with pytest.raises(InputError, match="must be negative"):
        extract(e, -e.ax)
    with pytest.raises(InputError, match="density must decrease with altitude"):
        check_decreasing(np.array([0.0, 1e3, 2e3]), np.array([1e-2, 1.1e-2, 1e-3]))
    with pytest.raises(InputError, match="must be positive"):
        check_decreasing(np.array([0.0, 1e3]), np.array([1e-2, 0.0]))
    jumpy = Drag(lambda m, k, a: 1.0 + (k * 1e5 % 2 > 1))
    with pytest.raises(InputError, match="iterations on CA"):
        extract(replace_entry(e, database=jumpy))
    assert replace(extract(e)).valid.all()
