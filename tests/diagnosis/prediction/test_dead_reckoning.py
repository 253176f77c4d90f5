"""The path against navigation, and states between samples against a motion in closed form."""

from types import SimpleNamespace

import numpy as np
import pytest

from edl_filter import rotations
from edl_filter.diagnosis.bins import Bins
from edl_filter.diagnosis.path import PER_BIN, Path, dead_reckon, node_rates, nodes_of
from edl_filter.navigation import strapdown
from edl_filter.navigation.increments import Samples
from edl_filter.navigation.layout import Layout
from edl_filter.telemetry.record import SensorErrors

MARS = SimpleNamespace(mu=4.2828e13, j2=1.96e-3, gravity_radius=3.397e6)
ALL = SensorErrors(1e-2, 1e-3, 1e-2, 1e-4, 1e-3)
RATE = 8


def flown(seed=0, n=200, units=1):
    """Random readings, and a state above Mars."""
    rng = np.random.default_rng(seed)
    force = rng.normal(size=(n, 3)) + np.array([-20.0, 0.0, 0.0])
    rate = 0.2 * rng.normal(size=(n, 3))
    one = np.zeros(n)
    samples = Samples(
        time=10.0 + np.arange(1, n + 1) / RATE,
        interval=np.full(n, 1.0 / RATE),
        force=force,
        rate=rate,
        mean_force=force + 0.01,
        mean_rate=rate - 0.01,
        force_noise=one,
        rate_noise=one,
        shared_rate_noise=one,
        net_turn=np.zeros(n, bool),
        unit=(np.arange(n) * units // n).astype(np.int64),
    )
    attitude = rotations.normalise(rng.normal(size=4))
    return samples, np.concatenate(([3.4e6, 2e5, 6e5], [-500.0, 4000.0, 900.0], attitude))


def posed(samples, layout):
    return SimpleNamespace(samples=samples, planet=MARS, layout=layout)


def propagated(samples, start):
    """All samples in one call of the filter's kernel."""
    lanes = np.repeat(start[:, None], strapdown.LANES, axis=1)
    same = np.zeros((12, strapdown.LANES))
    same[[0, 4, 8]] = 1.0
    as_read = np.zeros((6, strapdown.LANES))
    as_read[:3] = 1.0
    strapdown.propagate(
        lanes, same, as_read, samples.interval, samples.force, samples.rate, MARS.mu, MARS.j2, MARS.gravity_radius
    )
    return lanes[:, 0]


def test_without_errors_it_is_the_propagation():
    samples, start = flown()
    layout = Layout.of((SensorErrors(),), {})
    path = dead_reckon(posed(samples, layout), start, np.zeros((1, layout.size)))
    assert path.nav.shape == (201, 10)
    np.testing.assert_array_equal(path.nav[0], start)
    np.testing.assert_allclose(path.nav[-1], propagated(samples, start), rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(path.nav[80], propagated(samples.part(0, 80), start), rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(path.time, np.concatenate(([10.0], samples.time)))
    np.testing.assert_array_equal(path.force, samples.mean_force)
    np.testing.assert_array_equal(path.rate, samples.mean_rate)


def test_each_instruments_errors_are_taken_off_its_own_samples():
    """What two wrong instruments read of a motion gives the motion again, if their errors are told."""
    true, start = flown(units=2)
    layout = Layout.of((ALL,), {})
    rng = np.random.default_rng(4)
    errors, read = np.zeros((2, layout.size)), {n: getattr(true, n).copy() for n in ("force", "mean_force")}
    read |= {n: getattr(true, n).copy() for n in ("rate", "mean_rate")}
    for u in range(2):
        e = {n: getattr(ALL, n) * rng.normal(size=3) for n in vars(ALL)}
        for name, value in e.items():
            errors[u, layout[name]] = value
        turn = rotations.from_rotation_vector(e["accelerometer_misalignment"])
        mine = true.unit == u
        for n in ("force", "mean_force"):
            turned = rotations.rotate(turn, read[n][mine])
            read[n][mine] = (1.0 + e["accelerometer_scale"]) * turned + e["accelerometer_bias"]
        for n in ("rate", "mean_rate"):
            read[n][mine] = (1.0 + e["gyro_scale"]) * read[n][mine] + e["gyro_bias"]
    wrong = Samples(**(vars(true) | read))
    path = dead_reckon(posed(wrong, layout), start, errors)
    np.testing.assert_allclose(path.force, true.mean_force, atol=1e-12)
    np.testing.assert_allclose(path.rate, true.mean_rate, atol=1e-12)
    np.testing.assert_allclose(path.nav[-1], propagated(true, start), rtol=1e-12, atol=1e-10)
    spoiled = dead_reckon(posed(wrong, layout), start, errors[::-1].copy())
    assert np.linalg.norm(spoiled.nav[-1, :3] - path.nav[-1, :3]) > 1.0


#: Coning: a precession and a spin of 1 Hz, which leave a slow roll and a lateral rate that goes round in a second.
ROLL, WIDE, NUTATION = 0.1, 0.1, 2.0 * np.pi


def coning(t):
    """Attitude and rate of ``exp(a t h) ⊗ exp(b t x)``, whose body rate is ``b x + R(-b t x) a h``."""
    a_h = np.array([ROLL - NUTATION, WIDE, 0.0])
    spin = np.zeros((len(t), 3))
    spin[:, 0] = NUTATION * t
    spinning = rotations.from_rotation_vector(spin)
    attitude = rotations.multiply(rotations.from_rotation_vector(t[:, None] * a_h), spinning)
    rate = rotations.rotate(rotations.conjugate(spinning), a_h) + np.array([NUTATION, 0.0, 0.0])
    return attitude, rate


def mean_rates(edges):
    """Integrals of the rate in closed form."""
    s, c = np.sin(NUTATION * edges) / NUTATION, np.cos(NUTATION * edges) / NUTATION
    whole = np.stack((ROLL * edges, WIDE * s, WIDE * c), axis=1)
    return np.diff(whole, axis=0) / np.diff(edges)[:, None]


@pytest.fixture(scope="module")
def nutating():
    """Nodes of ten seconds, their true attitude and rate, and a position of known cubic course."""
    edges = np.arange(81) / RATE
    t = edges[:, None]
    nav = np.concatenate((t**3 + [0.0, 1.0, 2.0], 3.0 * t**2 + [0.0, 1.0, 2.0], coning(edges)[0]), axis=1)
    path = Path(edges, nav, np.zeros((80, 3)), mean_rates(edges))
    bins = Bins(edges, np.ones(80, bool), 1)
    return nodes_of(path, bins, path.rate), path


def test_the_closed_form_turns_at_its_own_rate():
    """The test's own motion: a small turn by the rate goes from one attitude to the next."""
    t, h = np.linspace(0.0, 3.0, 50), 1e-4
    attitude, rate = coning(t)
    after = rotations.multiply(attitude, rotations.from_rotation_vector(h * coning(t + 0.5 * h)[1]))
    turned = rotations.multiply(rotations.conjugate(coning(t + h)[0]), after)
    assert np.abs(rotations.to_rotation_vector(turned)).max() < 1e-9
    fine = np.linspace(0.0, 0.125, 2001)
    np.testing.assert_allclose(
        np.trapezoid(coning(fine)[1], fine, axis=0) / 0.125, mean_rates(np.array([0.0, 0.125]))[0], atol=1e-8
    )
    assert np.ptp(rate[:, 1]) == pytest.approx(2.0 * WIDE, rel=1e-2)


def test_attitude_and_rate_between_samples(nutating):
    found, _ = nutating
    assert len(found.time) == 80 * PER_BIN + 1
    attitude, rate = coning(found.time)
    inside = (found.time > 0.5) & (found.time < 9.5)
    miss = rotations.to_rotation_vector(rotations.multiply(rotations.conjugate(attitude), found.nav[:, 6:]))
    assert np.linalg.norm(miss, axis=1)[inside].max() < 1e-5
    assert np.abs(found.rate - rate)[inside].max() < 2e-3 * WIDE


def test_at_the_edges_it_is_the_path(nutating):
    found, path = nutating
    np.testing.assert_allclose(found.nav[::PER_BIN], path.nav, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(found.time[::PER_BIN], path.time, atol=1e-12)


def test_position_between_samples_is_a_cubic(nutating):
    found, _ = nutating
    np.testing.assert_allclose(found.nav[:, 0], found.time**3, rtol=1e-10, atol=1e-9)
    np.testing.assert_allclose(found.nav[:, 4], 3.0 * found.time**2 + 1.0, rtol=1e-10, atol=1e-9)


def test_a_bin_without_rates_does_not_spoil_the_others():
    edges = np.arange(81) / RATE
    nav = np.concatenate((np.zeros((81, 6)), coning(edges)[0]), axis=1)
    path = Path(edges, nav, np.zeros((80, 3)), mean_rates(edges))
    rates = path.rate.copy()
    rates[10] = np.nan
    found = nodes_of(path, Bins(edges, np.ones(80, bool), 1), rates)
    assert np.isfinite(found.nav).all() and np.isfinite(found.rate).all()
    np.testing.assert_array_equal(node_rates(Bins(edges, np.ones(80, bool), 1), rates), found.rate)
    late = found.time > 5.0
    assert np.abs(found.rate - coning(found.time)[1])[late & (found.time < 9.5)].max() < 2e-3 * WIDE
