"""Windows of a simulated rotational motion with a lost stretch, and the dense form of their linear model."""

import numpy as np
from test_rotational_dynamics import a_state, loads_of

from edl_filter.navigation.motion_model import MEDIANS, Window, covariances, linearise_window
from edl_filter.navigation.rotational_dynamics import ERROR_SIZE, SIZE, add_errors, linearise

NOISE = np.array([2e-4] * 3 + [0.01] * 3)
INTERVAL, STEPS = 0.125, 5


def flown(count, disturbances, change=None):
    """True readings (count, 6) and states of a motion with given disturbances, which `change` may alter at each bin."""
    loads, state = loads_of(count, STEPS), a_state(disturbances)
    nodes = 2 * STEPS + 1
    part = loads._replace(**{k: getattr(loads, k)[:nodes] for k in (
        "air", "pressure_area", "coefficients", "cmq", "rate_scale")})  # fmt: skip
    states, readings = [], []
    for t in range(count):
        if change is not None:
            state = change(t, state)
        states.append(state)
        ends, reading, _, _ = linearise(state[None], part, np.array([INTERVAL]), STEPS)
        state = ends[0]
        readings.append(reading[0])
    return np.array(readings), np.array(states), loads


def a_window(count, first, last, disturbances=(), random=None, change=None):
    """Window of a simulated motion, with the true readings."""
    truth, states, loads = flown(count, disturbances, change)
    readings = truth.copy()
    if random is not None:
        readings += NOISE * random.standard_normal(truth.shape)
    observed = np.ones(count, bool)
    observed[first:last] = False
    approximate = np.zeros((count, SIZE))
    approximate[:, :7] = states[:, :7]
    approximate[first:last, 4:7] = states[first - 1, 4:7]  # as an autoregression, which does not know the motion
    readings[first:last] = readings[first - 1]
    noise = np.tile(NOISE, (count, 1))
    time = INTERVAL * np.arange(count + 1)
    return Window(time, readings, noise, observed, first, last, approximate, loads, STEPS), truth


def dense(window, motion, c):
    """Mean (n,) and covariance (n, n) of all errors before any reading, and the design of all readings."""
    count = len(window.observed)
    mean, covariance = [motion.initial], np.zeros((count, count, ERROR_SIZE, ERROR_SIZE))
    covariance[0, 0] = c.initial
    for t in range(1, count):
        f = motion.transition[t - 1]
        mean.append(f @ mean[-1])
        for k in range(t):
            covariance[t, k] = f @ covariance[t - 1, k]
            covariance[k, t] = covariance[t, k].T
        covariance[t, t] = f @ covariance[t - 1, t - 1] @ f.T + c.process_noise[t - 1]
    size = count * ERROR_SIZE
    full = covariance.transpose(0, 2, 1, 3).reshape(size, size)
    design = np.zeros((count, 6, count, ERROR_SIZE))
    design[range(count), :, range(count)] = motion.design
    return np.concatenate(mean), full, design.reshape(6 * count, size)


def small_window():
    """Eight bins with two lost ones, linearised off their most probable motion, and usual covariances."""
    window, _ = a_window(8, 3, 5, (0.05,), np.random.default_rng(1))
    motion = linearise_window(window, add_errors(window.states, np.full((8, ERROR_SIZE), 1e-4)))
    return window, motion, covariances(window, motion, MEDIANS)
