"""Uniform rotation of the planet, and of the atmosphere with it.

Input: times, inertial or planet-fixed vectors. Output: their components in the other frame, and velocities relative to
the rotating ground (thesis eq. 3.6).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from edl_filter import rotations
from edl_filter.types import Array


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
        """Angle from the inertial x axis to the prime meridian.

        Parameters
        ----------
        time : (...) array
            s since the epoch.

        Returns
        -------
        (...) array
            rad.
        """
        return self.prime_meridian_at_epoch + self.rate * np.asarray(time, float)

    def fixed_from_inertial(self, time: ArrayLike) -> Array:
        """Quaternions that take inertial components to planet-fixed ones.

        Parameters
        ----------
        time : (...) array
            s since the epoch.

        Returns
        -------
        (..., 4) array
        """
        # The axes rotate by the positive angle, so that the components rotate by the negative one
        half = -0.5 * self.angle(time)
        zero = np.zeros_like(half)
        return np.stack((zero, zero, np.sin(half), np.cos(half)), axis=-1)

    def to_fixed(self, time: ArrayLike, vector: ArrayLike) -> Array:
        """Planet-fixed components of an inertial position or direction.

        Parameters
        ----------
        time : (...) array
            s since the epoch.
        vector : (..., 3) array
            Any unit.

        Returns
        -------
        (..., 3) array
            In the unit of `vector`.
        """
        return rotations.rotate(self.fixed_from_inertial(time), vector)

    def to_inertial(self, time: ArrayLike, vector: ArrayLike) -> Array:
        """Inertial components of a planet-fixed position or direction.

        Parameters
        ----------
        time : (...) array
            s since the epoch.
        vector : (..., 3) array
            Any unit.

        Returns
        -------
        (..., 3) array
            In the unit of `vector`.
        """
        return rotations.rotate(rotations.conjugate(self.fixed_from_inertial(time)), vector)

    def velocity_relative(self, position: ArrayLike, velocity: ArrayLike) -> Array:
        """Velocity relative to the ground and the rigidly rotating air, ``v - ω × r`` (thesis eq. 3.6).

        Parameters
        ----------
        position, velocity : (..., 3) arrays
            m and m/s; both in inertial axes, or both in the same other axes with the inertial z axis.

        Returns
        -------
        (..., 3) array
            m/s, in the axes of the arguments (not in the planet-fixed frame).
        """
        x, y, z = np.moveaxis(np.asarray(position, float), -1, 0)
        frame_velocity = np.stack((-self.rate * y, self.rate * x, np.zeros_like(z)), axis=-1)  # ω × r
        return np.asarray(velocity, float) - frame_velocity
