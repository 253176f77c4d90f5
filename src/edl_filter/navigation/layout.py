"""The filter's vector: an error about a propagated reference.

The first nine components are always there: position (m), velocity (m/s), both inertial, and attitude as a
rotation vector in body axes (rad), ``true = reference ⊗ exp(error)``. Then come the error sources to which
the mission gives a prior sigma; zero sigma means no state. The attitude that was computed on board, if there is
one, comes last.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from edl_filter import rotations
from edl_filter.telemetry.record import SensorErrors

Array = NDArray[np.float64]

ONBOARD = "onboard_attitude"
SENSOR_STATES = tuple(f.name for f in fields(SensorErrors))
UNITS = {
    "position": "m",
    "velocity": "m/s",
    "attitude": "rad",
    "accelerometer_bias": "m/s^2",
    "accelerometer_scale": "1",
    "accelerometer_misalignment": "rad",
    "gyro_bias": "rad/s",
    "gyro_scale": "1",
    "entry_epoch": "s",
    "entry_frame": "rad",
    "onboard_rate": "rad/s",
    "onboard_mounting": "rad",
    "onboard_attitude": "rad",
}


@dataclass(frozen=True)
class Layout:
    """Which states there are, and where each stands in the vector.

    Attributes
    ----------
    slices : dict
        Name → slice, in order. ``position``, ``velocity`` and ``attitude`` first.
    """

    slices: dict[str, slice]

    @classmethod
    def of(cls, errors: tuple[SensorErrors, ...], extra: dict[str, int]) -> Layout:
        """Layout for instruments with the given priors and `extra` states (name → length)."""
        sizes = {"position": 3, "velocity": 3, "attitude": 3}
        sizes |= {n: 3 for n in SENSOR_STATES if any(getattr(e, n) > 0.0 for e in errors)}
        sizes |= {n: size for n, size in extra.items() if n != ONBOARD}
        sizes |= {n: size for n, size in extra.items() if n == ONBOARD}  # the last, where `State` looks for it
        slices, start = {}, 0
        for name, size in sizes.items():
            slices[name] = slice(start, start + size)
            start += size
        return cls(slices)

    @property
    def size(self) -> int:
        """Length of the vector."""
        return max(s.stop for s in self.slices.values())

    def __contains__(self, name: str) -> bool:
        return name in self.slices

    def __getitem__(self, name: str) -> slice:
        return self.slices[name]

    @property
    def sensor(self) -> slice:
        """All sensor errors together."""
        names = [n for n in SENSOR_STATES if n in self]
        return slice(self[names[0]].start, self[names[-1]].stop) if names else slice(9, 9)


@dataclass(frozen=True)
class State:
    """A reference.

    Attributes
    ----------
    nav : (10,) or (14,) array
        Inertial position (m) and velocity (m/s), inertial_from_body, and where there is one the attitude that was
        computed on board; the error of the latter, a rotation vector in body axes, is then the vector's last three.
    errors : (n,) array
        The other states in full; zero where `nav` holds the state.
    """

    nav: Array
    errors: Array

    def plus(self, delta: Array) -> State:
        """This state moved by the error vector `delta` (n,)."""
        nav, errors = self.nav.copy(), self.errors.copy()
        nav[:6] += delta[:6]
        errors[9:] += delta[9:]
        nav[6:10] = turned(nav[6:10], delta[None, 6:9])[:, 0]
        if len(nav) == 14:
            nav[10:] = turned(nav[10:], delta[None, -3:])[:, 0]
            errors[-3:] = 0.0
        return State(nav, errors)

    def minus(self, other: State) -> Array:
        """The error vector that moves `other` here."""
        delta = self.errors - other.errors
        delta[:6] = self.nav[:6] - other.nav[:6]
        delta[6:9] = attitude_errors(other.nav[6:10], self.nav[6:10, None])[0]
        if len(self.nav) == 14:
            delta[-3:] = attitude_errors(other.nav[10:], self.nav[10:, None])[0]
        return delta


def sigma_states(reference: State, sigmas: Array, columns: int) -> tuple[Array, Array]:
    """Sigma points as full states.

    Parameters
    ----------
    reference : State
    sigmas : (S, n) array
        Error vectors.
    columns : int
        Number of columns wanted, at least S; the rest repeat the reference.

    Returns
    -------
    nav : (10 or 14, columns) array
    errors : (n, columns) array
        The other states in full.
    """
    nav = np.repeat(reference.nav[:, None], columns, axis=1)
    errors = np.repeat(reference.errors[:, None], columns, axis=1)
    count = len(sigmas)
    nav[:6, :count] += sigmas.T[:6]
    nav[6:10, :count] = turned(reference.nav[6:10], sigmas[:, 6:9])
    errors[9:, :count] += sigmas.T[9:]
    if len(nav) == 14:
        nav[10:, :count] = turned(reference.nav[10:], sigmas[:, -3:])
        errors[-3:] = 0.0
    return nav, errors


def turned(attitude: Array, phi: Array) -> Array:
    """``attitude ⊗ exp(phi)`` for one quaternion and rotation vectors ``(S, 3)``, as unit quaternions ``(4, S)``."""
    x, y, z, w = attitude
    left = np.array([[w, -z, y, x], [z, w, -x, y], [-y, x, w, z], [-x, -y, -z, w]])
    out = left @ rotations.from_rotation_vector(phi).T
    return out / np.sqrt(np.sum(out**2, axis=0))


def attitude_errors(attitude: Array, others: Array) -> Array:
    """Rotation vectors ``(S, 3)`` that take one quaternion to each column of `others` ``(4, S)``."""
    x, y, z, w = attitude
    inverse = np.array([[w, z, -y, -x], [-z, w, x, -y], [y, -x, w, -z], [x, y, z, w]])
    return rotations.to_rotation_vector((inverse @ others).T)


def sensor_maps(layout: Layout, errors: Array) -> tuple[Array, Array]:
    """What undoes the sensor errors, for `strapdown.propagate`.

    Errors are in body axes in the order misalignment, scale, bias: ``f_m = (1 + s) ∘ (R(m) f) + b``, so
    ``f = R(m)ᵀ ((f_m - b) / (1 + s))``; the gyros have no misalignment of their own, since the body's axes
    are defined by them.

    Parameters
    ----------
    layout : Layout
    errors : (n, S) array

    Returns
    -------
    force_map : (12, S) array
    rate_map : (6, S) array
    """
    count = errors.shape[1]

    def get(name: str) -> Array:
        return errors[layout[name]] if name in layout else np.zeros((3, count))

    scale = 1.0 / (1.0 + get("accelerometer_scale"))
    turn = rotations.to_matrix(rotations.from_rotation_vector(get("accelerometer_misalignment").T))
    inverse = np.transpose(turn, (2, 1, 0)) * scale[None]  # (row, column, sigma): R(m)ᵀ diag(1 / (1 + s))
    offset = -np.einsum("ijs,js->is", inverse, get("accelerometer_bias"))
    rate = 1.0 / (1.0 + get("gyro_scale"))
    force_map = np.concatenate((inverse.reshape(9, count), offset))
    return force_map, np.concatenate((rate, -rate * get("gyro_bias")))
