"""The filter's vector: an error about a propagated reference state.

The first nine components are always there: position (m), velocity (m/s), both inertial, and attitude as a
rotation vector in body axes (rad), ``true = reference ⊗ exp(error)``. Then come the error sources to which
the mission gives a prior sigma; zero sigma means no state. The error of the attitude that was computed on board, if
there is one, comes last.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from edl_filter import rotations
from edl_filter.imu_model.sensor_errors import SENSOR_STATES, SensorErrors, correction_maps
from edl_filter.types import Array

ONBOARD = "onboard_attitude"
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


def consecutive_slices(sizes: Mapping[str, int], start: int = 0) -> dict[str, slice]:
    """Slices of adjoining blocks of a vector, by name, from their sizes; the first block begins at `start`."""
    slices = {}
    for name, size in sizes.items():
        slices[name] = slice(start, start + size)
        start += size
    return slices


@dataclass(frozen=True)
class Layout:
    """The states of the vector, and the position of each in it.

    Attributes
    ----------
    slices : dict
        Name → slice, in order. ``position``, ``velocity`` and ``attitude`` first.
    """

    slices: dict[str, slice]

    @classmethod
    def of(cls, errors: tuple[SensorErrors, ...], extra: dict[str, int]) -> Layout:
        """Layout for instruments with the given priors.

        Parameters
        ----------
        errors : tuple of SensorErrors
            Prior sigmas by instrument; an error is a state if any instrument has it.
        extra : dict
            Further states: name → length.

        Returns
        -------
        Layout
        """
        sizes = {"position": 3, "velocity": 3, "attitude": 3}
        sizes |= {n: 3 for n in SENSOR_STATES if any(getattr(e, n) > 0.0 for e in errors)}
        sizes |= {n: size for n, size in extra.items() if n != ONBOARD}
        sizes |= {n: size for n, size in extra.items() if n == ONBOARD}  # last, as `State` assumes
        return cls(consecutive_slices(sizes))

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
    """A reference state.

    Attributes
    ----------
    nav : (10,) or (14,) array
        Inertial position (m) and velocity (m/s), inertial_from_body, and where there is one the attitude that was
        computed on board; the error of the latter, a rotation vector in body axes, is then the vector's last three.
    errors : (n,) array
        The other states in full, in the units of `UNITS`; zero where `nav` holds the state.
    """

    nav: Array
    errors: Array

    def plus(self, delta: Array) -> State:
        """This state moved by the error vector `delta` (n,)."""
        nav, errors = self.nav.copy(), self.errors.copy()
        nav[:6] += delta[:6]
        errors[9:] += delta[9:]
        nav[6:10] = perturbed_attitudes(nav[6:10], delta[None, 6:9])[:, 0]
        if len(nav) == 14:
            nav[10:] = perturbed_attitudes(nav[10:], delta[None, -3:])[:, 0]
            errors[-3:] = 0.0
        return State(nav, errors)

    def minus(self, reference: State) -> Array:
        """The error vector (n,) that moves `reference` to this state."""
        delta = self.errors - reference.errors
        delta[:6] = self.nav[:6] - reference.nav[:6]
        delta[6:9] = attitude_errors(reference.nav[6:10], self.nav[6:10, None])[0]
        if len(self.nav) == 14:
            delta[-3:] = attitude_errors(reference.nav[10:], self.nav[10:, None])[0]
        return delta


def sigma_states(reference: State, sigmas: Array, columns: int) -> tuple[Array, Array]:
    """Error vectors about a reference as full states, one per column.

    Parameters
    ----------
    reference : State
        State that the errors refer to.
    sigmas : (S, n) array
        Error vectors, in the units of `UNITS`.
    columns : int
        Number of columns of the result, at least S; the columns after the first S repeat the reference.

    Returns
    -------
    nav : (10 or 14, columns) array
        As `State.nav`.
    errors : (n, columns) array
        As `State.errors`.
    """
    nav = np.repeat(reference.nav[:, None], columns, axis=1)
    errors = np.repeat(reference.errors[:, None], columns, axis=1)
    count = len(sigmas)
    nav[:6, :count] += sigmas.T[:6]
    nav[6:10, :count] = perturbed_attitudes(reference.nav[6:10], sigmas[:, 6:9])
    errors[9:, :count] += sigmas.T[9:]
    if len(nav) == 14:
        nav[10:, :count] = perturbed_attitudes(reference.nav[10:], sigmas[:, -3:])
        errors[-3:] = 0.0
    return nav, errors


def perturbed_attitudes(attitude: Array, phi: Array) -> Array:
    """``attitude ⊗ exp(phi)`` for one attitude and several rotation vectors.

    Parameters
    ----------
    attitude : (4,) array
        inertial_from_body.
    phi : (S, 3) array
        Rotation vectors in body axes, rad.

    Returns
    -------
    (4, S) array
        Unit quaternions.
    """
    out = rotations.product_matrix(attitude) @ rotations.from_rotation_vector(phi).T
    return out / np.sqrt(np.sum(out**2, axis=0))


def attitude_errors(attitude: Array, attitudes: Array) -> Array:
    """Rotation vectors in body axes that take one attitude to each of several.

    Parameters
    ----------
    attitude : (4,) array
        inertial_from_body.
    attitudes : (4, S) array
        inertial_from_body.

    Returns
    -------
    (S, 3) array
        rad: ``attitudes = attitude ⊗ exp(phi)``.
    """
    # of a unit quaternion, that of its conjugate; contiguous, so that equal attitudes have no error to the last bit
    inverse = np.ascontiguousarray(rotations.product_matrix(attitude).T)
    return rotations.to_rotation_vector((inverse @ attitudes).T)


def sensor_maps(layout: Layout, errors: Array) -> tuple[Array, Array]:
    """Linear maps that correct the sensors' readings, for `strapdown.propagate`.

    Parameters
    ----------
    layout : Layout
        Of the filter's vector.
    errors : (n, S) array
        As `State.errors`, one set per column.

    Returns
    -------
    force_map : (12, S) array
    rate_map : (6, S) array
        As `imu_model.sensor_errors.correction_maps` gives them.
    """
    return correction_maps({n: errors[layout[n]] for n in SENSOR_STATES if n in layout}, errors.shape[1])
