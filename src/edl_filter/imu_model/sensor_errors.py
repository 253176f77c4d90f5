"""Constant errors of accelerometers and gyros.

Each triad of sensors errs in body axes, in the order misalignment m (a rotation vector), scale s, bias b::

    f_m = (1 + s) ∘ (R(m) f) + b          w_m = (1 + s) ∘ w + b

The gyros have no misalignment of their own, because they define the body's axes. The model is that of Groves 2013,
section 4.4, with a rotation in place of the small cross-coupling matrix.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields

import numpy as np

from edl_filter import rotations
from edl_filter.types import Array


@dataclass(frozen=True)
class SensorErrors:
    """One-sigma sizes of an IMU's constant errors, per body axis (zero: no such error).

    Attributes
    ----------
    accelerometer_bias : float
        m/s².
    accelerometer_scale : float
        Relative.
    accelerometer_misalignment : float
        rad.
    gyro_bias : float
        rad/s.
    gyro_scale : float
        Relative.
    """

    accelerometer_bias: float = 0.0
    accelerometer_scale: float = 0.0
    accelerometer_misalignment: float = 0.0
    gyro_bias: float = 0.0
    gyro_scale: float = 0.0


#: Names of the error states of one instrument, in the order in which filters hold them.
SENSOR_STATES = tuple(f.name for f in fields(SensorErrors))


def apply_errors(
    values: Array, misalignment: Array | None = None, scale: Array | None = None, bias: Array | None = None
) -> Array:
    """Readings of one triad of sensors: ``(1 + s) ∘ (R(m) v) + b``.

    Parameters
    ----------
    values : (..., 3) array
        True specific force (m/s²) or angular rate (rad/s), body axes.
    misalignment, scale, bias : (3,) or (..., 3) arrays, optional
        rad, relative, and the unit of `values`; None: no such error.

    Returns
    -------
    (..., 3) array
        In the unit of `values`.
    """
    if misalignment is not None:
        values = rotations.rotate(rotations.from_rotation_vector(misalignment), values)
    if scale is not None:
        values = values * (1.0 + scale)
    return values if bias is None else values + bias


def remove_errors(
    readings: Array, misalignment: Array | None = None, scale: Array | None = None, bias: Array | None = None
) -> Array:
    """True values where one triad of sensors gave `readings`: the inverse of `apply_errors`.

    Parameters
    ----------
    readings : (..., 3) array
        m/s² or rad/s, body axes.
    misalignment, scale, bias : (3,) or (..., 3) arrays, optional
        As in `apply_errors`.

    Returns
    -------
    (..., 3) array
        ``R(m)ᵀ ((v_m - b) / (1 + s))``, in the unit of `readings`.
    """
    if bias is not None:
        readings = readings - bias
    if scale is not None:
        readings = readings / (1.0 + scale)
    if misalignment is not None:
        readings = rotations.rotate(rotations.from_rotation_vector(-misalignment), readings)
    return readings


def correction_maps(errors: Mapping[str, Array], count: int) -> tuple[Array, Array]:
    """The inverse of the error model as linear maps of the readings, one per column.

    Parameters
    ----------
    errors : mapping of str to (3, S) array
        Errors by name (`SENSOR_STATES`), m/s², relative, rad, rad/s, relative; a missing name means no such error.
    count : int
        S, the number of sets of errors.

    Returns
    -------
    force_map : (12, S) array
        ``f = A f_m + c``: A row by row (9), then c (3), m/s².
    rate_map : (6, S) array
        ``w = a ∘ w_m + c``: a (3), then c (3), rad/s.
    """
    from edl_filter.imu_model.compiled_corrections import sensor_correction_maps  # who reads a mission needs no numba

    names = [name for name in SENSOR_STATES if name in errors]
    places = np.array([3 * names.index(name) if name in names else -1 for name in SENSOR_STATES])
    rows = np.empty((3 * len(names), count))
    for name, place in zip(names, places[places >= 0], strict=True):
        rows[place : place + 3] = errors[name]
    return sensor_correction_maps(rows, places)


def reading_jacobian(force: Array, rate: Array, errors: Mapping[str, Array] | None = None) -> dict[str, Array]:
    """Derivatives of an instrument's readings with respect to its errors.

    Parameters
    ----------
    force, rate : (N, 3) arrays
        True specific force (m/s²) and angular rate (rad/s), body axes.
    errors : mapping of str to (3,) array, optional
        Linearisation point, by name; a missing name means zero.

    Returns
    -------
    dict of str to (N, 3, 3) array
        By name, in the order of `SENSOR_STATES`: derivatives of the force's readings by the accelerometers' errors and
        of the rate's readings by the gyros' errors.
    """
    errors = {} if errors is None else errors
    scale, turn = errors.get("accelerometer_scale", np.zeros(3)), errors.get("accelerometer_misalignment", np.zeros(3))
    identity = np.broadcast_to(np.eye(3), (len(force), 3, 3))
    matrix = rotations.to_matrix(rotations.from_rotation_vector(turn))
    by_name = {
        "accelerometer_bias": identity,
        "accelerometer_scale": (force @ matrix.T)[:, :, None] * np.eye(3),
        "accelerometer_misalignment": -(1.0 + scale)[:, None]
        * (matrix @ rotations.cross_matrix(force) @ rotations.right_jacobian(turn)),
        "gyro_bias": identity,
        "gyro_scale": rate[:, :, None] * np.eye(3),
    }
    return {name: by_name[name] for name in SENSOR_STATES}
