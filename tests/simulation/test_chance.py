import numpy as np
import pytest

from edl_filter.simulation.chance import smooth_noise, weather


def test_smooth_noise_has_its_size_and_correlation():
    x = np.array([smooth_noise(np.random.default_rng(k), 41, 500.0, 0.02, 10e3) for k in range(4000)])
    np.testing.assert_allclose(x.std(axis=0), 0.02, rtol=0.05)
    for steps in (20, 1):
        d = np.sqrt(3.0) * steps * 500.0 / 10e3
        found = np.corrcoef(x[:, 7], x[:, 7 + steps])[0, 1]
        assert found == pytest.approx((1.0 + d) * np.exp(-d), abs=0.04 * d)


def test_weather_is_the_same_for_the_same_stream():
    h = np.linspace(-5e3, 150e3, 50)
    (density, wind), (again, _) = (weather(np.random.default_rng(3), 0.01, 0.5, 1e4) for _ in range(2))
    np.testing.assert_array_equal(density.effect.density({}, h), again.effect.density({}, h))
    assert 0.003 < np.std(density.effect.density({}, h)) < 0.03
    assert wind.effect.wind({}, h).shape == (50, 2)
