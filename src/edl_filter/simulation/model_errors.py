"""Random errors of what a mission states, as effects in its model: entry state, sensors, database.

A measured flight has one telemetry; what its reconstruction assumes is dispersed instead. Each error is drawn once and
held. `edl_filter.simulation.air_errors.AirError` is that of the air.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from edl_filter import rotations
from edl_filter.aero.uncertainty import three_sigma
from edl_filter.effects.base import Effect
from edl_filter.effects.parameters import Values
from edl_filter.effects.types import AeroCoefficients, FlightCondition
from edl_filter.estimation.random_fields import smooth_field
from edl_filter.imu_model.sensor_errors import apply_errors, remove_errors
from edl_filter.simulation.database_errors import ANGLE_LENGTH_DEG, DECADES_LENGTH, LN_MACH_LENGTH, ODD_ANGLE_DEG
from edl_filter.telemetry.record import InitialState
from edl_filter.types import Array

#: Nodes of the field of the database's errors: ln Mach, log10 Kn, and angle (deg); constant outside.
_LN_MACH, _LOG_KNUDSEN = np.linspace(np.log(0.5), np.log(40.0), 19), np.arange(-3.0, 2.01, 0.5)
_ANGLE_DEG = np.arange(0.0, 45.1, 3.0)


class EntryStateError(Effect):
    """The true entry state differs from the stated one by a constant ``(9,)``: m, m/s, rad in body axes."""

    name = "drawn_entry_state"
    family = "entry"
    summary = "constant difference of the entry state from the stated one"

    def __init__(self, difference: Array) -> None:
        self.difference = difference

    def entry_state(self, p: Values, initial: InitialState) -> InitialState:
        """The stated state with the difference added; its covariance stays."""
        turn = rotations.from_rotation_vector(self.difference[6:])
        return replace(
            initial,
            position=initial.position + self.difference[:3],
            velocity=initial.velocity + self.difference[3:6],
            inertial_from_body=rotations.multiply(initial.inertial_from_body, turn),
        )


class ImuErrors(Effect):
    """Constant errors of the driving IMU, ``(3,)`` each by name (`imu_model.sensor_errors.SENSOR_STATES`)."""

    name = "drawn_imu_errors"
    family = "sensor"
    summary = "constant sensor errors of the driving IMU"

    def __init__(self, errors: Mapping[str, Array]) -> None:
        self.force = {
            "misalignment": errors["accelerometer_misalignment"],
            "scale": errors["accelerometer_scale"],
            "bias": errors["accelerometer_bias"],
        }
        self.rate = {"scale": errors["gyro_scale"], "bias": errors["gyro_bias"]}

    def imu(self, p: Values, time: Array, force: Array, rate: Array) -> tuple[Array, Array]:
        """Readings with the errors."""
        return apply_errors(force, **self.force), apply_errors(rate, **self.rate)

    def corrected(self, p: Values, time: Array, force: Array, rate: Array) -> tuple[Array, Array]:
        """Readings without them."""
        return remove_errors(force, **self.force), remove_errors(rate, **self.rate)


class DatabaseError(Effect):
    """Errors of CA, CN and Cm as in `edl_filter.simulation.database_errors`, for tables of any kind.

    Parameters
    ----------
    random : Generator
        Source of the errors.
    family : str
        Vehicle family, which determines the three sigma.
    scale : float
        Factor on the standard deviation.
    """

    name = "drawn_database"
    family = "aerodynamics"
    summary = "random error of the aerodynamic database"

    def __init__(self, random: np.random.Generator, family: str, scale: float) -> None:
        self.vehicle_family, self.scale = family, scale
        draw = [(_LN_MACH, LN_MACH_LENGTH), (_LOG_KNUDSEN, DECADES_LENGTH)]
        self.fields = [
            [smooth_field(random, points, length, _ANGLE_DEG, ANGLE_LENGTH_DEG) for _ in range(3)]
            for points, length in draw
        ]

    def coefficients(self, p: Values, flow: FlightCondition, totals: AeroCoefficients) -> AeroCoefficients:
        """Totals with the errors."""
        angle = np.degrees(flow.alpha_total)
        with np.errstate(divide="ignore"):
            places = (np.log(np.maximum(flow.mach, 1e-9)), np.log10(np.maximum(flow.knudsen, 1e-30)))
        rarefied = places[1] > _LOG_KNUDSEN[0]
        ca, cn, cm = (
            np.where(
                rarefied,
                _bilinear(self.fields[1][k], _LOG_KNUDSEN, places[1], angle),
                _bilinear(self.fields[0][k], _LN_MACH, places[0], angle),
            )
            for k in range(3)
        )
        sigma = three_sigma(self.vehicle_family, flow.mach, flow.knudsen, totals.ca)
        odd = np.tanh(angle / ODD_ANGLE_DEG)
        part = self.scale / 3.0
        return replace(
            totals,
            ca=totals.ca + part * sigma.ca * ca,
            cn=totals.cn + part * sigma.cn * cn * odd,
            cm_nose=totals.cm_nose + part * sigma.cm * cm * odd,
        )


def _bilinear(field: Array, nodes: Array, place: Array, angle: Array) -> Array:
    """Field ``(N, A)`` over even `nodes` and `_ANGLE_DEG`, at places and angles ``(S,)``; constant outside."""
    u = np.clip((place - nodes[0]) / (nodes[1] - nodes[0]), 0.0, len(nodes) - 1.0)
    v = np.clip(angle / (_ANGLE_DEG[1] - _ANGLE_DEG[0]), 0.0, len(_ANGLE_DEG) - 1.0)
    i, j = np.minimum(u.astype(int), len(nodes) - 2), np.minimum(v.astype(int), len(_ANGLE_DEG) - 2)
    du, dv = u - i, v - j
    low = (1.0 - dv) * field[i, j] + dv * field[i, j + 1]
    high = (1.0 - dv) * field[i + 1, j] + dv * field[i + 1, j + 1]
    return (1.0 - du) * low + du * high
