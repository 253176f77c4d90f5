"""Windows of a simulated rotational motion with a lost stretch, and the dense form of their linear model."""

from dataclasses import replace

import numpy as np
from test_rotational_dynamics import DISTURBED, a_state, advanced, loads_of, node_times, varying_loads

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
    observed = np.ones((count, 6), bool)
    observed[first:last] = False
    approximate = np.zeros((count, SIZE))
    approximate[:, :7] = states[:, :7]
    approximate[first:last, 4:7] = states[first - 1, 4:7]  # as an autoregression, which does not know the motion
    readings[first:last] = readings[first - 1]
    noise = np.tile(NOISE, (count, 1))
    time = INTERVAL * np.arange(count + 1)
    still = np.eye(6), np.zeros((count, 3))
    return Window(time, readings, noise, observed, *still, first, last, approximate, loads, STEPS), truth


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


def uneven_window():
    """Seven bins of different lengths with two lost ones, in loads that change, and the true states.

    The disturbances decay from bin to bin as those of the model.
    """
    edges, steps = np.array([0.0, 0.03, 0.05, 0.09, 0.1, 0.14, 0.16, 0.2]), 3
    loads, count = varying_loads(node_times(edges, steps)), len(edges) - 1
    state = a_state(0.5 * np.array(DISTURBED), (-1.2, 0.22, 0.12), (-0.5, 0.6, 0.4))
    observed = np.ones((count, 6), bool)
    observed[3:5] = False
    states, readings = np.zeros((count, SIZE)), np.zeros((count, 6))
    window = Window(
        edges, readings, np.tile(NOISE, (count, 1)), observed, np.eye(6), np.zeros((count, 3)), 3, 5,
        np.tile(state, (count, 1)), loads, steps,
    )  # fmt: skip
    decay = np.diagonal(linearise_window(window, window.states).transition, axis1=1, axis2=2)[:, 6:]
    for t in range(count):
        states[t] = state
        part = varying_loads(node_times(edges[t : t + 2], steps))
        state, readings[t] = advanced(state, part, window.interval[t], steps)
        state[7:] *= decay[t]
    window.states[:] = states
    window.states[:, 7:] = 0.0
    return window, np.concatenate((states, state[None]))


#: Axes of which the first rate is oblique to the body, and the place of an IMU, m.
OBLIQUE = np.eye(6)
OBLIQUE[:3, :3] = [[0.6, 0.0, 0.8], [0.0, 1.0, 0.0], [-0.8, 0.0, 0.6]]
ARM = np.array([0.3, -0.5, 0.2])


def partly_read(window, ends):
    """The window with one rate lost alone, along an oblique axis, and forces that are read at a place off the centre.

    The acceleration of that place is the difference of its velocity ``ω × r`` over the bin, and ``ω × (ω × r)``, with
    the rate linear in time, by Simpson's rule.
    """
    change, observed, arm = np.diff(ends, axis=0), window.observed.copy(), np.zeros_like(window.arm)
    part = slice(window.first, window.last)
    observed[part, 1:], arm[part] = True, ARM
    readings = window.readings.copy()
    for share, weight in ((-0.5, 1.0 / 6.0), (0.0, 4.0 / 6.0), (0.5, 1.0 / 6.0)):
        rate = window.readings[:, :3] + share * change
        readings[:, 3:] += weight * np.cross(rate, np.cross(rate, arm))
    readings[:, 3:] += np.cross(change, arm) / window.interval[:, None]
    return replace(window, readings=readings @ OBLIQUE.T, observed=observed, axes=OBLIQUE, arm=arm)


def small_window():
    """Eight bins with two lost ones, linearised off their most probable motion, and usual covariances."""
    window, _ = a_window(8, 3, 5, (0.05,), np.random.default_rng(1))
    motion = linearise_window(window, add_errors(window.states, np.full((8, ERROR_SIZE), 1e-4)))
    return window, motion, covariances(window, motion, MEDIANS)
