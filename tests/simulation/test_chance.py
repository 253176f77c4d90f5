"""Random errors of the preflight atmosphere."""

import numpy as np

from edl_filter.simulation.chance import weather


def test_weather_is_the_same_for_the_same_stream():
    h = np.linspace(-5e3, 150e3, 50)
    (density, wind), (repeated, _) = (weather(np.random.default_rng(3), 0.01, 0.5, 1e4) for _ in range(2))
    np.testing.assert_array_equal(density.effect.density({}, h), repeated.effect.density({}, h))
    assert 0.003 < np.std(density.effect.density({}, h)) < 0.03
    assert wind.effect.wind({}, h).shape == (50, 2)
