"""Effects in an IMU: constant errors of accelerometers and gyros, its place, and its clock.

Errors are in body axes. Several of one sensor act in the order misalignment, scale, bias:
``f_m = (1 + s) ∘ (R(m) f) + b`` (`edl_filter.effects.readings`).
"""

from __future__ import annotations

import numpy as np

from edl_filter import rotations
from edl_filter.effects.effect import Array, Effect, Parameter, Values

AXES = ("x", "y", "z")


def vector(prefix: str, unit: str, description: str, sigma: float, bound: float) -> tuple[Parameter, ...]:
    """Three components of a size, named `prefix` with x, y and z, within ± `bound`."""
    return tuple(
        Parameter(f"{prefix}{axis}", unit, f"{description}, body {axis}", sigma, low=-bound, high=bound)
        for axis in AXES
    )


def components(p: Values, prefix: str) -> Array:
    """The vector ``(3,)`` of the parameters named `prefix` with x, y and z."""
    return np.array([p[prefix + axis] for axis in AXES])


class AccelerometerBias(Effect):
    """``f_m = f + b``."""

    name = "accelerometer_bias"
    family = "sensor"
    summary = "constant error of the accelerometers: f_m = f + b"
    shows = (
        "The second IMU's readings differ by a constant in all three axes, before entry too, and the position at "
        "landing drifts off with the square of time."
    )
    source = "Thomas (2011), section 3.2; the rovers' pre-entry means reach 4e-3 to 1e-2 m/s^2"
    parameters = vector("b", "m/s^2", "bias", 5e-3, 0.5)

    def imu(self, p: Values, time: Array, force: Array, rate: Array) -> tuple[Array, Array]:
        """Bias added."""
        return force + components(p, "b"), rate

    def corrected(self, p: Values, time: Array, force: Array, rate: Array) -> tuple[Array, Array]:
        """Bias taken off."""
        return force - components(p, "b"), rate


class AccelerometerScale(Effect):
    """``f_m = (1 + s) ∘ f``."""

    name = "accelerometer_scale"
    family = "sensor"
    summary = "scale error of the accelerometers: f_m = (1 + s) f, axis by axis"
    shows = (
        "The second IMU's readings differ in proportion to the deceleration, gravity at rest has the wrong size, and "
        "the velocity lost to drag does not reach the landing site."
    )
    source = "LN-200S data sheet (300 ppm); beyond it, a loop that lost its calibration"
    parameters = vector("s", "", "scale error", 4e-3, 0.1)

    def imu(self, p: Values, time: Array, force: Array, rate: Array) -> tuple[Array, Array]:
        """Scaled."""
        return force * (1.0 + components(p, "s")), rate

    def corrected(self, p: Values, time: Array, force: Array, rate: Array) -> tuple[Array, Array]:
        """Scale taken off."""
        return force / (1.0 + components(p, "s")), rate


class AccelerometerMisalignment(Effect):
    """``f_m = R(m) f`` with a rotation vector in body axes."""

    name = "accelerometer_misalignment"
    family = "sensor"
    summary = "accelerometers turned against the body's axes: f_m = R(m) f, m a rotation vector"
    shows = (
        "A share of the axial deceleration, near peak above all, stands in the lateral axes against the second IMU and "
        "against CN and CY; gravity at rest points elsewhere."
    )
    source = "Thomas (2011), section 3.2: 0.3 degrees between backshell and rover"
    parameters = vector("m", "rad", "rotation vector", 6e-3, 0.2)

    def imu(self, p: Values, time: Array, force: Array, rate: Array) -> tuple[Array, Array]:
        """Turned."""
        return rotations.rotate(rotations.from_rotation_vector(components(p, "m")), force), rate

    def corrected(self, p: Values, time: Array, force: Array, rate: Array) -> tuple[Array, Array]:
        """Turned back."""
        return rotations.rotate(rotations.from_rotation_vector(-components(p, "m")), force), rate


class GyroBias(Effect):
    """``w_m = w + b``."""

    name = "gyro_bias"
    family = "sensor"
    summary = "constant error of the gyros: w_m = w + b"
    shows = (
        "The attitude drifts in proportion to time: rates at rest are not the planet's, the second IMU's rates differ "
        "by a constant, and the site is missed as if the drag had turned."
    )
    source = "LN-200S data sheet (1 deg/h) and Spirit's and Opportunity's drift at rest (10 deg/h)"
    parameters = vector("b", "rad/s", "bias", 6e-5, 5e-3)

    def imu(self, p: Values, time: Array, force: Array, rate: Array) -> tuple[Array, Array]:
        """Bias added."""
        return force, rate + components(p, "b")

    def corrected(self, p: Values, time: Array, force: Array, rate: Array) -> tuple[Array, Array]:
        """Bias taken off."""
        return force, rate - components(p, "b")


class GyroScale(Effect):
    """``w_m = (1 + s) ∘ w``."""

    name = "gyro_scale"
    family = "sensor"
    summary = "scale error of the gyros: w_m = (1 + s) w, axis by axis"
    shows = (
        "On a spinning vehicle the roll angle runs away by the scale times the turns made, and rates and angular "
        "accelerations differ from the second IMU's in proportion."
    )
    source = "LN-200S data sheet (100 ppm); beyond it, a loop that lost its calibration"
    parameters = vector("s", "", "scale error", 2e-3, 0.1)

    def imu(self, p: Values, time: Array, force: Array, rate: Array) -> tuple[Array, Array]:
        """Scaled."""
        return force, rate * (1.0 + components(p, "s"))

    def corrected(self, p: Values, time: Array, force: Array, rate: Array) -> tuple[Array, Array]:
        """Scale taken off."""
        return force, rate / (1.0 + components(p, "s"))


class ImuLeverArm(Effect):
    """The IMU sits at its stated position + d."""

    name = "imu_lever_arm"
    family = "sensor"
    summary = "the IMU sits at its stated position + d"
    shows = (
        "Specific force at the centre of mass keeps a part that goes with the rates squared and their changes: a "
        "constant on a spinning vehicle, the oscillation's own period where it swings."
    )
    source = "Thomas (2011), eq. 3.3 and section 3.2: positions of the rovers' IMUs from drawings and from the data"
    parameters = vector("d", "m", "displacement", 0.25, 3.0)

    def imu_position(self, p: Values) -> Array:
        """The displacement."""
        return components(p, "d")


class ImuTimeOffset(Effect):
    """``w_m(t) = w(t - tau)``."""

    name = "imu_time_offset"
    family = "sensor"
    summary = "gyro samples late against the accelerometers': w_m(t) = w(t - tau)"
    shows = (
        "Where the vehicle swings, forces lead the rates: residuals of moments and lateral forces go with the rates' "
        "changes, and the second IMU's rates run ahead."
    )
    source = "channels of one telemetry stream may differ by about a sample, at 8 Hz"
    parameters = (Parameter("tau", "s", "delay of the gyros' samples", 0.1, low=-2.0, high=2.0),)

    def imu(self, p: Values, time: Array, force: Array, rate: Array) -> tuple[Array, Array]:
        """Rates of `tau` earlier."""
        return force, delayed(time, rate, p["tau"])

    def corrected(self, p: Values, time: Array, force: Array, rate: Array) -> tuple[Array, Array]:
        """Rates brought forward by `tau`."""
        return force, delayed(time, rate, -p["tau"])


def delayed(time: Array, mean: Array, delay: float) -> Array:
    """Means over the same intervals of what happened `delay` earlier.

    The integral of a signal is known exactly at the edges of its samples; a cubic spline through them is read at the
    shifted edges. Before the first and after the last sample the signal holds.

    Parameters
    ----------
    time : (N,) array
        Ends of adjoining intervals, s; the first is as long as the second.
    mean : (N, 3) array
        Means over them; NaN where nothing is known, which stays NaN.
    delay : float
        s, of either sign.
    """
    from scipy.interpolate import CubicSpline  # slow to import

    if delay == 0.0:
        return mean
    edges = np.concatenate((2.0 * time[:1] - time[1:2], time))
    interval = np.diff(edges)[:, None]
    known = np.isfinite(mean)
    whole = mean if known.all() else np.stack(
        [np.interp(time, time[k], m[k]) if k.any() else np.zeros(len(m)) for m, k in zip(mean.T, known.T, strict=True)],
        axis=1,
    )  # fmt: skip
    turned = np.concatenate((np.zeros((1, mean.shape[1])), np.cumsum(whole * interval, axis=0)))
    at = edges - delay
    inside = CubicSpline(edges, turned, axis=0)(np.clip(at, edges[0], edges[-1]))
    before, after = np.minimum(at - edges[0], 0.0)[:, None], np.maximum(at - edges[-1], 0.0)[:, None]
    shifted = np.diff(inside + before * whole[0] + after * whole[-1], axis=0) / interval
    return np.where(known, shifted, np.nan)


EFFECTS = (
    AccelerometerBias, AccelerometerScale, AccelerometerMisalignment, GyroBias, GyroScale, ImuLeverArm, ImuTimeOffset
)  # fmt: skip
