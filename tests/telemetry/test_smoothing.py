"""The thesis's filters against closed forms and slow reference implementations."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from edl_filter import rotations
from edl_filter.errors import InputError
from edl_filter.telemetry import smoothing


def reference_batch_polynomial(time, values, points, order):
    """One least-squares polynomial per sample, written out."""
    n, half = len(time), points // 2
    out = np.empty(n)
    for i in range(n):
        start = min(max(i - half, 0), n - points)
        t = time[start : start + points] - time[i]
        scale = np.abs(t).max() or 1.0
        powers = np.vander(t / scale, order + 1, increasing=True)
        out[i] = np.linalg.lstsq(powers, values[start : start + points], rcond=None)[0][0]
    return out


def jittered_time(n, seed=0):
    return np.cumsum(np.random.default_rng(seed).choice([0.125, 0.25], n))


# --- rates from quaternions


@given(
    st.tuples(*[st.floats(-2.0, 2.0)] * 3).map(np.array),
    st.lists(st.floats(0.05, 1.0), min_size=2, max_size=6),
    st.lists(st.booleans(), min_size=7, max_size=7),
)
def test_constant_rate_is_exact_for_any_signs_of_the_quaternions(rate, steps, flips):
    time = np.concatenate(([0.0], np.cumsum(steps)))
    start = rotations.normalise([0.1, -0.4, 0.3, 0.8])
    q = rotations.multiply(start, rotations.from_rotation_vector(time[:, None] * rate))
    q[np.array(flips[: len(q)])] *= -1.0
    computed = smoothing.rates_from_quaternions(time, q)
    assert computed.shape == (len(steps), 3)
    if np.linalg.norm(rate) * np.max(steps) < np.pi:  # a rotation by more than 180 degrees is ambiguous
        np.testing.assert_allclose(computed, np.broadcast_to(rate, computed.shape), atol=1e-12)


def test_rates_tend_to_eq_3_1_for_short_steps():
    # Coning motion: q = exp(0.21 t z) exp(0.3 sin(t) x); eq. 3.1 with a central difference of q
    time = np.arange(0.0, 2.0, 1e-3)

    def attitude(t):
        zero = np.zeros_like(t)
        spin = rotations.from_rotation_vector(np.stack((zero, zero, 0.21 * t), -1))
        return rotations.multiply(spin, rotations.from_rotation_vector(np.stack((0.3 * np.sin(t), zero, zero), -1)))

    middle, h = 0.5 * (time[1:] + time[:-1]), 1e-5
    derivative = (attitude(middle + h) - attitude(middle - h)) / (2 * h)
    eq_3_1 = 2.0 * rotations.multiply(rotations.conjugate(attitude(middle)), derivative)[:, :3]
    computed = smoothing.rates_from_quaternions(time, attitude(time))
    np.testing.assert_allclose(computed, eq_3_1, atol=1e-7)


def test_invalid_quaternions_raise():
    q = np.array([[0.0, 0.0, 0.0, 1.0]] * 3)
    with pytest.raises(InputError, match=r"Quaternion 1 at 1\.0+ s has length 0\.5"):
        smoothing.rates_from_quaternions([0.0, 1.0, 2.0], q * [[1.0], [0.5], [1.0]])
    with pytest.raises(InputError, match=r"quaternions have NaN or infinity in row 2"):
        smoothing.rates_from_quaternions([0.0, 1.0, 2.0], q * [[1.0], [1.0], [np.nan]])
    with pytest.raises(InputError, match=r"Time must increase, but .*1\.0.* follows .*1\.0"):
        smoothing.rates_from_quaternions([0.0, 1.0, 1.0], q)


# --- batch polynomial


@pytest.mark.parametrize(("points", "order"), [(7, 2), (5, 0), (9, 3), (41, 2), (1, 0)])
@pytest.mark.parametrize("kind", ["even", "epoch", "jittered", "one gap"])
def test_batch_polynomial_equals_the_reference(points, order, kind):
    n = 60
    time = {
        "even": 0.125 * np.arange(n),
        "epoch": (126462175.0 + 0.125 * np.arange(n)) - 126462085.4,
        "jittered": jittered_time(n),
        "one gap": 0.125 * np.arange(n) + np.where(np.arange(n) > 33, 0.75, 0.0),
    }[kind]
    values = np.random.default_rng(1).normal(size=n) + np.sin(time)
    np.testing.assert_allclose(
        smoothing.batch_polynomial(time, values, points, order),
        reference_batch_polynomial(time, values, points, order),
        atol=1e-6 if kind == "epoch" else 1e-11,
    )


@given(st.integers(0, 4), st.integers(0, 1000), st.integers(0, 10))
def test_polynomial_passes_unchanged_at_uneven_times_and_at_the_ends(order, seed, extra):
    rng = np.random.default_rng(seed)
    time = np.cumsum(rng.uniform(0.05, 1.0, 40))
    values = np.polynomial.Polynomial(rng.normal(size=order + 1), domain=time[[0, -1]])(time)
    points = 2 * ((order + 2 + extra) // 2) + 1
    np.testing.assert_allclose(smoothing.batch_polynomial(time, values, points, order), values, atol=1e-10)


def test_columns_are_independent_at_the_longest_batch_of_the_thesis():
    time = jittered_time(1200)
    values = np.random.default_rng(2).normal(size=(1200, 3))
    computed = smoothing.batch_polynomial(time, values, 901)
    np.testing.assert_allclose(
        computed[700, 2], reference_batch_polynomial(time, values[:, 2], 901, 2)[700], atol=1e-12
    )
    single_column = smoothing.batch_polynomial(time, values[:, 1], 901)
    np.testing.assert_allclose(computed[:, 1], single_column, atol=1e-13)


@pytest.mark.parametrize("points", [5, 7, 31, 901])
def test_half_the_power_passes_at_the_bandwidth(points):
    interval = 0.125
    frequency = smoothing.batch_polynomial_bandwidth(points, 2, interval)
    time = interval * np.arange(4 * points)
    wave = np.cos(2 * np.pi * frequency * (time - time[2 * points]))
    gain = smoothing.batch_polynomial(time, wave, points)[2 * points]
    assert gain == pytest.approx(np.sqrt(0.5), abs=1e-9)
    slower = np.cos(2 * np.pi * 0.9 * frequency * (time - time[2 * points]))
    assert smoothing.batch_polynomial(time, slower, points)[2 * points] > gain


def test_bandwidth_of_a_moving_average():
    # The running mean of N points: sin(pi f N) / (N sin(pi f)); tends to 0.4429 / N
    assert smoothing.batch_polynomial_bandwidth(1001, 0, 1.0) == pytest.approx(0.44295 / 1001, rel=1e-4)
    assert smoothing.batch_polynomial_bandwidth(3, 2, 0.125) == 4.0  # passes everything: Nyquist


@pytest.mark.parametrize(
    ("points", "order", "message"),
    [
        (6, 2, "6 points has no middle sample; an odd number"),
        (0, 0, "0 points has no middle sample"),
        (3, 3, "degree 3 needs 0 <= degree < points; points is 3"),
        (7, -1, "degree -1"),
        (21, 2, "21 points is longer than the data: 20 samples"),
    ],
)
def test_invalid_batch_raises(points, order, message):
    with pytest.raises(InputError, match=message):
        smoothing.batch_polynomial(np.arange(20.0), np.zeros(20), points, order)


def test_invalid_data_raise():
    values = np.zeros((20, 3))
    values[4, 1] = np.nan
    with pytest.raises(InputError, match="NaN or infinity in row 4"):
        smoothing.batch_polynomial(np.arange(20.0), values, 7)
    with pytest.raises(InputError, match="first axes must agree"):
        smoothing.batch_polynomial(np.arange(19.0), values, 7)
    with pytest.raises(InputError, match="Time must increase"):
        smoothing.batch_polynomial(-np.arange(20.0), np.zeros(20), 7)


# --- low-pass


@pytest.mark.parametrize(("cutoff", "order"), [(17.0, 4), (15.0, 4), (2.0, 2), (80.0, 5)])
def test_low_pass_passes_half_the_power_at_its_bandwidth(cutoff, order):
    interval = 1.0 / 200.0
    # the gain of both passes is 1 / (1 + w^(2 order)), w the ratio of the prewarped frequencies
    ratio = (np.sqrt(2.0) - 1.0) ** (0.5 / order)
    frequency = np.arctan(np.tan(np.pi * cutoff * interval) * ratio) / (np.pi * interval)
    assert 0.0 < frequency < cutoff
    time = interval * (np.arange(4001) - 2000)
    wave = np.stack((np.cos(2 * np.pi * frequency * time), np.cos(2 * np.pi * cutoff * time)), -1)
    gains = smoothing.low_pass(wave, interval, cutoff, order)[2000]
    np.testing.assert_allclose(gains, [np.sqrt(0.5), 0.5], atol=1e-6)  # two passes: half the amplitude at the cut-off


def test_low_pass_has_zero_phase_and_passes_a_straight_line():
    interval = 0.005
    time = interval * np.arange(-1000, 1001)
    pulse = smoothing.low_pass(np.exp(-((time / 0.1) ** 2)), interval, 17.0)
    np.testing.assert_allclose(pulse, pulse[::-1], atol=1e-9)
    np.testing.assert_allclose(smoothing.low_pass(2.0 + 3.0 * time, interval, 17.0), 2.0 + 3.0 * time, atol=1e-6)


def test_invalid_low_pass_raises():
    with pytest.raises(InputError, match=r"4\.0 Hz is not between 0 and the Nyquist frequency 4\.0"):
        smoothing.low_pass(np.zeros(100), 0.125, 4.0)
    with pytest.raises(InputError, match="Nyquist"):
        smoothing.low_pass(np.zeros(100), 0.125, 0.0)
    with pytest.raises(InputError, match=r"1\.0 Hz needs more than 32 samples; there are 32"):
        smoothing.low_pass(np.zeros(32), 0.125, 1.0)
    with pytest.raises(InputError, match="NaN or infinity in row 0"):
        smoothing.low_pass(np.full(100, np.nan), 0.125, 1.0)


# --- angular acceleration


@given(st.integers(0, 1000))
def test_quadratic_rate_gives_its_exact_derivative_at_the_samples(seed):
    rng = np.random.default_rng(seed)
    time = np.cumsum(rng.uniform(0.05, 0.5, 15))
    a, b, c = rng.normal(size=(3, 3))
    rate = a + b * time[:, None] + c * time[:, None] ** 2
    expected = b + 2 * c * time[:, None]
    for smooth in (None, lambda t, v: smoothing.batch_polynomial(t, v, 7)):
        computed = smoothing.differentiated_rates(time, rate, smooth)
        np.testing.assert_allclose(computed, expected, atol=1e-9)


def test_oscillation_has_no_delay_and_the_stated_gain():
    time, frequency = 0.125 * np.arange(801), 0.7
    rate = np.sin(2 * np.pi * frequency * time)
    computed = smoothing.differentiated_rates(time, rate)[1:-1]
    phase = 2 * np.pi * frequency * 0.125
    expected = 2 * np.pi * frequency * np.cos(2 * np.pi * frequency * time)[1:-1] * np.sin(phase) / phase
    np.testing.assert_allclose(computed, expected, atol=1e-10)


def test_fewer_than_three_rates_raise():
    with pytest.raises(InputError, match="at least 3 rates; there are 2"):
        smoothing.differentiated_rates([0.0, 1.0], np.zeros((2, 3)))


# --- the real flight


def test_spirit_rates_from_quaternions_agree_with_the_gyros(mer_folder):
    # For a minute from 90 s after entry both the on-board quaternion (TRANSFORMED) and the gyros' angle increments
    # (HIGHRATE) exist, from the backshell's unit. The norm of the rate is independent of the frame.
    table = np.loadtxt(mer_folder / "DATA" / "2TRANSFORMED.TAB", max_rows=4600)
    gyro = np.loadtxt(mer_folder / "DATA" / "2HIGHRATE.TAB", max_rows=500)
    time, first = np.unique(table[:, 0], return_index=True)
    inside = (time > 126462174.8) & (time < 126462235.0)
    # Shuster's quaternion from J2000 to the spacecraft has the same four elements as Hamilton's j2000_from_body
    time, j2000_from_body = time[inside], table[first[inside], 5:9]
    rate = smoothing.rates_from_quaternions(time, j2000_from_body)
    cumulative_angle = np.vstack((np.zeros(3), np.cumsum(gyro[:, 7:10], axis=0)))
    knots = np.append(gyro[0, 0] - 0.125, gyro[:, 0])
    angle = np.stack([np.interp(time, knots, column) for column in cumulative_angle.T], axis=-1)
    expected = np.linalg.norm(np.diff(angle, axis=0), axis=-1) / np.diff(time)
    difference = np.linalg.norm(rate, axis=-1) - expected
    assert len(difference) > 200
    assert difference.std() < 4e-5  # from six decimals of the quaternion over 0.25 s
    assert np.median(rate[:, 2]) == pytest.approx(0.21, abs=0.02)  # spin, about the archive's +z
