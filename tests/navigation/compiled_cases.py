"""Layouts, states and samples on which compiled kernels of the navigation are compared with their readable twins."""

from dataclasses import replace

import numpy as np
import twins

from edl_filter.imu_model.sensor_errors import SensorErrors
from edl_filter.navigation.layout import Layout, State

#: Every state that a filter can have.
EVERY = Layout.of(
    (SensorErrors(1.0, 1.0, 1.0, 1.0, 1.0),),
    {"entry_epoch": 1, "entry_frame": 3, "onboard_rate": 3, "onboard_mounting": 3, "onboard_attitude": 3},
)
#: Without an on-board attitude; of the sensor errors, the biases only.
FEW = Layout.of((SensorErrors(accelerometer_bias=1.0, gyro_bias=1.0),), {"entry_frame": 3})


def random_state(random, layout):
    """A state with errors of every kind; the attitudes are not exactly of unit length, as after rounding."""
    nav = np.concatenate(
        ([3.4e6, 1e5, -2e5], [-300.0, 900.0, 100.0], random.standard_normal(8 if "onboard_attitude" in layout else 4))
    )
    for start in range(6, len(nav), 4):
        nav[start : start + 4] *= 1.001 / np.linalg.norm(nav[start : start + 4])
    return State(nav, random.standard_normal(layout.size))


def uneven_samples(random, count=14):
    """Samples of all kinds: unequal intervals and noise, one without rate noise, on-board rates of their own."""
    s = twins.samples(
        random.uniform(0.05, 0.3, count),
        10.0 * random.standard_normal((count, 3)),
        0.5 * random.standard_normal((count, 3)),
    )
    rate_noise = random.uniform(2e-3, 4e-3, (count, 3)) * (np.arange(count) != 4)[:, None]
    return replace(
        s,
        force_noise=random.uniform(0.05, 0.2, (count, 3)),
        rate_noise=rate_noise,
        shared_rate_noise=random.uniform(0.2, 0.9, (count, 3)) * rate_noise,
        coning_corrected=random.random(count) < 0.3,
        onboard_rate=s.rate + 0.05 * random.standard_normal((count, 3)),
    )


def filled(samples, random, force, rate):
    """Some samples with errors of a fill along one axis each, and one along all."""
    axes = np.zeros((len(samples.time), 3))
    axes[[2, 5, 9], [0, 1, 2]] = 1.0
    axes[7] = random.uniform(0.5, 2.0, 3)
    return replace(samples, force_fill_sigma=force * axes, rate_fill_sigma=rate * axes)
