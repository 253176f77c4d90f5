"""Rotation of the planet, and of the atmosphere with it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from edl_filter import rotations

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Rotation:
    """Uniform rotation about the inertial z axis.

    Attributes
    ----------
    rate : float
        rad/s, positive eastward.
    prime_meridian_at_epoch : float
        Angle from the inertial x axis to the prime meridian at time 0, rad.
    """

    rate: float
    prime_meridian_at_epoch: float

    def angle(self, time: ArrayLike) -> Array:
        """Angle from the inertial x axis to the prime meridian at `time` (s since the epoch), rad."""
        return self.prime_meridian_at_epoch + self.rate * np.asarray(time, float)

    def fixed_from_inertial(self, time: ArrayLike) -> Array:
        """Quaternions ``(..., 4)`` at `time` (...), s, that take inertial components to planet-fixed ones."""
        # The axes turn forward by the angle, so components turn backward
        half = -0.5 * self.angle(time)
        zero = np.zeros_like(half)
        return np.stack((zero, zero, np.sin(half), np.cos(half)), axis=-1)

    def to_fixed(self, time: ArrayLike, vector: ArrayLike) -> Array:
        """Planet-fixed components of an inertial position or direction ``(..., 3)`` at `time` (...), s."""
        return rotations.rotate(self.fixed_from_inertial(time), vector)

    def to_inertial(self, time: ArrayLike, vector: ArrayLike) -> Array:
        """Inertial components of a planet-fixed position or direction ``(..., 3)`` at `time` (...), s."""
        return rotations.rotate(rotations.conjugate(self.fixed_from_inertial(time)), vector)

    def velocity_relative(self, position: ArrayLike, velocity: ArrayLike) -> Array:
        """Velocity against the ground and the rigidly rotating air, ``v - ω × r`` (thesis eq. 3.6).

        Parameters
        ----------
        position, velocity : (..., 3) arrays
            m and m/s, both inertial or both in one set of axes that shares the inertial z.

        Returns
        -------
        (..., 3) array
            m/s, in the axes of the arguments (not turned to the fixed frame).
        """
        return np.asarray(velocity, float) - self._frame_velocity(position)

    def velocity_inertial(self, position: ArrayLike, velocity_relative: ArrayLike) -> Array:
        """Inertial velocity ``v + ω × r``, m/s: the inverse of `velocity_relative`."""
        return np.asarray(velocity_relative, float) + self._frame_velocity(position)

    def _frame_velocity(self, position: ArrayLike) -> Array:
        x, y, z = np.moveaxis(np.asarray(position, float), -1, 0)
        return np.stack((-self.rate * y, self.rate * x, np.zeros_like(z)), axis=-1)
