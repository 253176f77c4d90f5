"""The filter's vector: an error about a propagated reference.

The first nine components are always there: position (m), velocity (m/s), both inertial, and attitude as a
rotation vector in body axes (rad), ``true = reference ⊗ exp(error)``. Then come the error sources to which
the mission gives a prior sigma; zero sigma means no state.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from edl_filter import rotations
from edl_filter.telemetry.record import SensorErrors

Array = NDArray[np.float64]

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
        sizes |= extra
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
    """A reference: navigation state (10,) and the other states as a full vector (n,), its first nine zero.

    The navigation state is position, velocity and inertial_from_body.
    """

    nav: Array
    errors: Array

    def plus(self, delta: Array) -> State:
        """This state moved by the error vector `delta` (n,)."""
        nav = self.nav.copy()
        nav[:6] += delta[:6]
        turn = rotations.from_rotation_vector(delta[6:9])
        nav[6:] = rotations.normalise(rotations.multiply(nav[6:], turn))
        errors = self.errors.copy()
        errors[9:] += delta[9:]
        return State(nav, errors)

    def minus(self, other: State) -> Array:
        """The error vector that moves `other` here."""
        delta = self.errors - other.errors
        delta[:6] = self.nav[:6] - other.nav[:6]
        turn = rotations.multiply(rotations.conjugate(other.nav[6:]), self.nav[6:])
        delta[6:9] = rotations.to_rotation_vector(turn)
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
    nav : (10, columns) array
    errors : (n, columns) array
        The other states in full.
    """
    nav = np.repeat(reference.nav[:, None], columns, axis=1)
    errors = np.repeat(reference.errors[:, None], columns, axis=1)
    count = len(sigmas)
    nav[:6, :count] += sigmas.T[:6]
    nav[6:, :count] = turned(reference.nav[6:], sigmas[:, 6:9])
    errors[9:, :count] += sigmas.T[9:]
    return nav, errors


def turned(attitude: Array, phi: Array) -> Array:
    """``attitude ⊗ exp(phi)`` for one quaternion and rotation vectors ``(S, 3)``, as ``(4, S)``."""
    x, y, z, w = attitude
    left = np.array([[w, -z, y, x], [z, w, -x, y], [-y, x, w, z], [-x, -y, -z, w]])
    return left @ rotations.from_rotation_vector(phi).T


def turned_left(phi: Array, attitudes: Array) -> Array:
    """``exp(phi) ⊗ attitude`` for rotation vectors ``(S, 3)`` and quaternions ``(4, S)``, as ``(4, S)``."""
    return rotations.multiply(rotations.from_rotation_vector(phi), attitudes.T).T


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
