"""Stochastic model of a vehicle's rotational motion around a lost stretch of readings, linearised about a motion.

Input: mean rates and specific force in bins of samples on both sides of the stretch and, of axes that are read there,
within it, and what acts on the vehicle along its path (`rotational_dynamics.PathLoads`). Model: attitude and rates
follow Euler's equations with disturbances of the coefficients and of the wind, which are Gauss-Markov processes. Their
sizes are hyperparameters with log-normal priors (`_PRIORS`). Output: the linear-Gaussian state-space model of the error
about a motion, and the posterior density of the hyperparameters.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from edl_filter.estimation.block_sparse import from_blocks
from edl_filter.estimation.kalman import log_likelihood
from edl_filter.estimation.linear_state_space import LinearStateSpace
from edl_filter.navigation.rotational_dynamics import (
    DISTURBANCES,
    ERROR_SIZE,
    PathLoads,
    linearise,
    state_differences,
)
from edl_filter.rotations import cross_matrix
from edl_filter.types import Array, BoolArray

#: Hyperparameter → median and width of its log-normal prior. The first two are white noise of the moment coefficients
#: (√s), and of the force relative to its size; the others are sigmas of disturbances, in their units. Medians: errors
#: of a database and of winds as they are usual; widths: from a database that is exact to one that is a proxy.
_PRIORS = {
    "moment_noise": (1e-5, 2.0),
    "force_noise": (1e-3, 2.0),
    "moment_scale": (0.05, 1.0),
    "rolling_moment": (1e-5, 2.0),
    "lateral_moment": (1e-4, 1.5),
    "axial_scale": (0.03, 1.0),
    "normal_scale": (0.05, 1.0),
    "lateral_force": (1e-3, 1.5),
    "moment_curvature": (0.1, 1.0),
    "damping": (0.1, 1.0),
    "wind": (3.0, 1.5),
}
#: Disturbance → hyperparameter that is its sigma, correlation time (s; stability and damping change with the Mach
#: number alone, the others also with angle of attack and air), and least sigma at the first sample.
_PROCESSES = {
    "moment_scale": ("moment_scale", 60.0, 0.1),
    "cl": ("rolling_moment", 20.0, 1e-4),
    "cm": ("lateral_moment", 20.0, 1e-3),
    "cn": ("lateral_moment", 20.0, 1e-3),
    "axial_scale": ("axial_scale", 20.0, 0.1),
    "normal_scale": ("normal_scale", 20.0, 0.2),
    "cy": ("lateral_force", 20.0, 0.01),
    "cz": ("lateral_force", 20.0, 0.01),
    "moment_curvature": ("moment_curvature", 60.0, 0.05),
    "damping": ("damping", 60.0, 0.05),
    "wind_x": ("wind", 10.0, 3.0),
    "wind_y": ("wind", 10.0, 3.0),
    "wind_z": ("wind", 10.0, 3.0),
}
MEDIANS, WIDTHS = np.log([m for m, _ in _PRIORS.values()]), np.array([w for _, w in _PRIORS.values()])
_SIZE_OF = np.array([list(_PRIORS).index(_PROCESSES[name][0]) for name in DISTURBANCES])
_CORRELATION_TIME = np.array([_PROCESSES[name][1] for name in DISTURBANCES])
#: Places of the disturbances in the error.
_DISTURBED = np.arange(ERROR_SIZE - len(DISTURBANCES), ERROR_SIZE)
#: Least sigma at the first sample: attitude relative to the air (rad; wind over speed), rates (rad/s), disturbances.
_FIRST_SIGMA = np.array([0.04] * 3 + [0.02] * 3 + [_PROCESSES[name][2] for name in DISTURBANCES])
#: Process noise of the attitude beyond that of the rates, rad: keeps covariances regular.
_ATTITUDE_NOISE = 1e-7


@dataclass(frozen=True)
class Window:
    """Readings around a lost stretch, in T bins of samples.

    Attributes
    ----------
    time : (T + 1,) array
        Edges, s.
    readings, noise : (T, 6) arrays
        Components of mean rates (rad/s) and specific force (m/s²) along `axes`, and one sigma of each.
    observed : (T, 6) boolean array
        False for components that are lost in this stretch, or were filled elsewhere.
    axes : (6, 6) array
        Rows: unit vectors of the components, body axes, of three rates and three forces. Other axes than the body's
        where one axis of an oblique IMU is lost alone.
    arm : (T, 3) array
        From the centre of mass to the place where the force is read, m, body axes. Zero in bins whose rates were read:
        their force has been transferred to the centre of mass.
    first, last : int
        The stretch is ``first:last``.
    states : (T, 20) array
        Approximate motion at the beginning of each bin (`navigation.rotational_dynamics`), without disturbances.
    loads : PathLoads
    steps : int
        Of the integration, in each bin.
    """

    time: Array
    readings: Array
    noise: Array
    observed: BoolArray
    axes: Array
    arm: Array
    first: int
    last: int
    states: Array
    loads: PathLoads
    steps: int

    @property
    def interval(self) -> Array:
        """Length (T,) of each bin, s."""
        return np.diff(self.time)

    @property
    def complete(self) -> BoolArray:
        """Bins (T,) of which all components are observed."""
        return np.asarray(self.observed.all(axis=1))


@dataclass(frozen=True)
class LinearisedMotion:
    """A window linearised about a motion.

    The error of the state is ``offset + e``, where e follows the homogeneous equations and has the prior mean `initial`
    at the first bin.

    Attributes
    ----------
    states : (T, 20) array
        Linearisation point.
    transition : (T, 19, 19) array
        From the beginning to the end of each bin.
    design : (T, 6, 19) array
        Of the readings, along the window's axes.
    offset : (T, 19) array
        Response to the defects of the linearisation point: its states need not follow from each other.
    residual : (T, 6) array
        Readings less those of linearisation point and offset.
    initial : (19,) array
        Prior mean of e at the first bin.
    moment_noise : (T, 3, 3) array
        Covariance of the rates at the end of each bin by white noise of the moment coefficients of 1 √s.
    arm_noise : (T, 6) array
        Variance of the readings by this noise, which accelerates the place where a force is read.
    """

    states: Array
    transition: Array
    design: Array
    offset: Array
    residual: Array
    initial: Array
    moment_noise: Array
    arm_noise: Array


@dataclass(frozen=True)
class Covariances:
    """Covariances of a linearised window under hyperparameters.

    Attributes
    ----------
    process_noise : (T, 19, 19) array
    row_variance : (T, 6) array
    initial : (19, 19) array
    """

    process_noise: Array
    row_variance: Array
    initial: Array


def linearise_window(window: Window, states: Array) -> LinearisedMotion:
    """Linearise a window about states ``(T, 20)``."""
    ends, readings, transition, design = linearise(states, window.loads, window.interval, window.steps)
    _with_arm(window, states, ends, transition, readings, design)
    readings, design = readings @ window.axes.T, window.axes @ design
    decay = np.exp(-window.interval[:, None] / _CORRELATION_TIME)
    ends[:, -len(DISTURBANCES) :] *= decay
    transition[:, _DISTURBED, _DISTURBED] *= decay
    defect = state_differences(ends[:-1], states[1:])
    offset = np.zeros((len(states), ERROR_SIZE))
    for t in range(len(states) - 1):
        offset[t + 1] = transition[t] @ offset[t] + defect[t]
    loads = window.loads
    push = loads.pressure_area[: -1 : 2 * window.steps] * loads.diameter
    response = push[:, None, None] * loads.inverse
    moment_noise = window.interval[:, None, None] * response @ np.swapaxes(response, 1, 2)
    acceleration_noise = moment_noise / window.interval[:, None, None] ** 2
    cross = cross_matrix(window.arm) @ window.axes[3:, 3:].T
    arm_noise = np.zeros_like(readings)
    arm_noise[:, 3:] = np.einsum("tji,tjk,tki->ti", cross, acceleration_noise, cross)
    return LinearisedMotion(
        states=states,
        transition=transition,
        design=design,
        offset=offset,
        residual=window.readings - readings - np.einsum("tij,tj->ti", design, offset),
        initial=state_differences(window.states[:1], states[:1])[0],
        moment_noise=moment_noise,
        arm_noise=arm_noise,
    )


def propagated_states(window: Window, states: Array) -> Array:
    """States of a window, those of the stretch propagated from its first bin with constant disturbances.

    Parameters
    ----------
    window : Window
        Readings around the stretch.
    states : (T, 20) array
        Of its motion; those of the stretch after its first bin are not used.

    Returns
    -------
    (T, 20) array
        In the stretch the motion obeys Euler's equations, which an approximate motion need not do.
    """
    states, loads, nodes = states.copy(), window.loads, 2 * window.steps
    at_nodes = ("air", "pressure_area", "coefficients", "cmq", "rate_scale")
    for t in range(window.first, window.last - 1):
        part = slice(nodes * t, nodes * (t + 1) + 1)
        bin_loads = loads._replace(**{name: getattr(loads, name)[part] for name in at_nodes})
        states[t + 1] = linearise(states[t : t + 1], bin_loads, window.interval[t : t + 1], window.steps)[0][0]
    return states


def _with_arm(window: Window, states: Array, ends: Array, transition: Array, readings: Array, design: Array) -> None:
    """Move forces (T, 6) and their design to the place where they are read, in place: lever arm of the mean rates.

    As in `imu_model.lever_arm`: ``Δω × r / dt + ω × (ω × r) + Δω × (Δω × r) / 12``, with the mean rate ω and its change
    Δω over the bin.
    """
    if not window.arm.any():
        return
    change = ends[:, 4:7] - states[:, 4:7]
    of_change = transition[:, 3:6].copy()
    of_change[:, range(3), range(3, 6)] -= 1.0
    for rate, of_rate, share in ((readings[:, :3], design[:, :3], 1.0), (change, of_change, 1.0 / 12.0)):
        acceleration, of_acceleration = _centripetal(rate, window.arm)
        readings[:, 3:] += share * acceleration
        design[:, 3:] += share * of_acceleration @ of_rate
    readings[:, 3:] += np.cross(change, window.arm) / window.interval[:, None]
    design[:, 3:] -= cross_matrix(window.arm) @ of_change / window.interval[:, None, None]


def _centripetal(rate: Array, arm: Array) -> tuple[Array, Array]:
    """``ω × (ω × r) = ω (ω · r) - r ω²`` (T, 3) and its derivative (T, 3, 3) with respect to ω."""
    along = np.sum(rate * arm, axis=1)[:, None]
    square = np.sum(rate**2, axis=1)[:, None]
    derivative = along[:, :, None] * np.eye(3) + rate[:, :, None] * arm[:, None] - 2.0 * arm[:, :, None] * rate[:, None]
    return rate * along - arm * square, derivative


def covariances(window: Window, motion: LinearisedMotion, log_sizes: Array) -> Covariances:
    """Covariances of a linearised window under hyperparameters.

    Parameters
    ----------
    window : Window
        Readings around the stretch.
    motion : LinearisedMotion
        The window linearised.
    log_sizes : (11,) array
        Logarithms of the hyperparameters (see `_PRIORS`).

    Returns
    -------
    Covariances
    """
    sizes = np.exp(log_sizes)
    sigma = sizes[_SIZE_OF]
    decay = np.exp(-window.interval[:, None] / _CORRELATION_TIME)
    noise, rates = np.zeros_like(motion.transition), slice(3, 6)
    noise[:, range(3), range(3)] = _ATTITUDE_NOISE**2
    noise[:, rates, rates] = sizes[0] ** 2 * motion.moment_noise
    noise[:, _DISTURBED, _DISTURBED] = sigma**2 * (1.0 - decay**2)
    variance = window.noise**2 + sizes[0] ** 2 * motion.arm_noise
    variance[:, 3:] += sizes[1] ** 2 * np.sum(window.readings[:, 3:] ** 2, axis=1, keepdims=True)
    first = _FIRST_SIGMA.copy()
    first[6:] = np.maximum(first[6:], sigma)
    return Covariances(noise, variance, np.diag(first**2))


def log_posterior(window: Window, motion: LinearisedMotion) -> Callable[[Array], float]:
    """Log density of the hyperparameters given the readings, with the motion marginalised.

    Parameters
    ----------
    window : Window
        Readings around the stretch.
    motion : LinearisedMotion
        The window linearised.

    Returns
    -------
    function
        From the logarithms of the hyperparameters ``(11,)`` to nats, without a constant. Its calls share what does not
        depend on them.
    """
    observed = window.observed
    readings, design = motion.residual[observed], motion.design[observed]
    every, no_change = slice(0, ERROR_SIZE), np.zeros((1, ERROR_SIZE, ERROR_SIZE))
    # a step begins where a bin begins, and has the readings of that bin
    change = np.concatenate((no_change, motion.transition[:-1] - np.eye(ERROR_SIZE)))
    increment = from_blocks(ERROR_SIZE, [(every, every, change)])
    row_start = np.concatenate(([0], np.cumsum(observed.sum(axis=1))))
    column = (np.cumsum(observed, axis=1) - 1)[observed]
    noise = from_blocks(ERROR_SIZE, [(every, every, covariances(window, motion, MEDIANS).process_noise)])

    def value(log_sizes: Array) -> float:
        c = covariances(window, motion, log_sizes)
        process_noise, row_noise = np.zeros_like(noise.values), np.zeros((len(readings), 6))
        process_noise[1:] = c.process_noise[:-1, noise.row, noise.column]
        row_noise[range(len(readings)), column] = c.row_variance[observed]
        model = LinearStateSpace(
            increment, replace(noise, values=process_noise), row_start, design, row_noise, c.initial
        )
        deviation = (log_sizes - MEDIANS) / WIDTHS
        return log_likelihood(model, readings, motion.initial) - 0.5 * float(deviation @ deviation)

    return value
