"""Effects in an IMU: constant errors of accelerometers and gyros, lever arm, and timing.

Errors are in body axes. Several of one sensor act in the order misalignment, scale, bias:
``f_m = (1 + s) ∘ (R(m) f) + b`` (`edl_filter.effects.sensor_chain`).
"""

from __future__ import annotations

import numpy as np

from edl_filter.effects.base import Effect
from edl_filter.effects.parameters import Parameter, Values
from edl_filter.imu_model.sensor_errors import apply_errors, remove_errors
from edl_filter.types import AXES, Array


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
        "The second IMU's readings differ by a constant in all three axes, before entry too, and the error of the "
        "position at landing grows with the square of time."
    )
    source = (
        "Thomas (2011), section 3.2; size: the rovers' pre-entry means are 4e-3 to 1e-2 m/s^2 (computed from the "
        "telemetry)"
    )
    parameters = vector("b", "m/s^2", "bias", 5e-3, 0.5)

    def imu(self, p: Values, time: Array, force: Array, rate: Array) -> tuple[Array, Array]:
        """Bias added."""
        return apply_errors(force, bias=components(p, "b")), rate

    def corrected(self, p: Values, time: Array, force: Array, rate: Array) -> tuple[Array, Array]:
        """Bias subtracted."""
        return remove_errors(force, bias=components(p, "b")), rate


class AccelerometerScale(Effect):
    """``f_m = (1 + s) ∘ f``."""

    name = "accelerometer_scale"
    family = "sensor"
    summary = "scale error of the accelerometers: f_m = (1 + s) f, axis by axis"
    shows = (
        "The second IMU's readings differ in proportion to the deceleration, gravity at rest has the wrong magnitude, "
        "and the integrated deceleration is inconsistent with the landing site."
    )
    source = "LN-200S data sheet (300 ppm); larger: a loop that lost its calibration"
    parameters = vector("s", "", "scale error", 4e-3, 0.1)

    def imu(self, p: Values, time: Array, force: Array, rate: Array) -> tuple[Array, Array]:
        """Multiplied by the scale."""
        return apply_errors(force, scale=components(p, "s")), rate

    def corrected(self, p: Values, time: Array, force: Array, rate: Array) -> tuple[Array, Array]:
        """Divided by the scale."""
        return remove_errors(force, scale=components(p, "s")), rate


class AccelerometerMisalignment(Effect):
    """``f_m = R(m) f`` with a rotation vector in body axes."""

    name = "accelerometer_misalignment"
    family = "sensor"
    summary = "accelerometers rotated relative to the body axes: f_m = R(m) f, m a rotation vector"
    shows = (
        "A fraction of the axial deceleration, largest near its peak, appears in the lateral residuals against the "
        "second IMU and in CN and CY; the direction of gravity at rest is wrong."
    )
    source = (
        "Thomas (2011), section 3.2, estimates it between backshell and rover; size: the archive's accelerations are "
        "rotated by up to 0.3 degrees against its gyros (computed from the telemetry)"
    )
    parameters = vector("m", "rad", "rotation vector", 6e-3, 0.2)

    def imu(self, p: Values, time: Array, force: Array, rate: Array) -> tuple[Array, Array]:
        """Force rotated by m."""
        return apply_errors(force, misalignment=components(p, "m")), rate

    def corrected(self, p: Values, time: Array, force: Array, rate: Array) -> tuple[Array, Array]:
        """Force rotated by −m."""
        return remove_errors(force, misalignment=components(p, "m")), rate


class GyroBias(Effect):
    """``w_m = w + b``."""

    name = "gyro_bias"
    family = "sensor"
    summary = "constant error of the gyros: w_m = w + b"
    shows = (
        "The attitude error grows in proportion to time: rates at rest differ from the planet's, the second IMU's "
        "rates differ by a constant, and the landing site is missed as if the drag had another direction."
    )
    source = "LN-200S data sheet (1 deg/h) and Spirit's and Opportunity's drift at rest (10 deg/h)"
    parameters = vector("b", "rad/s", "bias", 6e-5, 5e-3)

    def imu(self, p: Values, time: Array, force: Array, rate: Array) -> tuple[Array, Array]:
        """Bias added."""
        return force, apply_errors(rate, bias=components(p, "b"))

    def corrected(self, p: Values, time: Array, force: Array, rate: Array) -> tuple[Array, Array]:
        """Bias subtracted."""
        return force, remove_errors(rate, bias=components(p, "b"))


class GyroScale(Effect):
    """``w_m = (1 + s) ∘ w``."""

    name = "gyro_scale"
    family = "sensor"
    summary = "scale error of the gyros: w_m = (1 + s) w, axis by axis"
    shows = (
        "On a spinning vehicle the error of the roll angle grows by the scale error times the angle turned, and rates "
        "and angular accelerations differ from the second IMU's in proportion."
    )
    source = "LN-200S data sheet (100 ppm); larger: a loop that lost its calibration"
    parameters = vector("s", "", "scale error", 2e-3, 0.1)

    def imu(self, p: Values, time: Array, force: Array, rate: Array) -> tuple[Array, Array]:
        """Multiplied by the scale."""
        return force, apply_errors(rate, scale=components(p, "s"))

    def corrected(self, p: Values, time: Array, force: Array, rate: Array) -> tuple[Array, Array]:
        """Divided by the scale."""
        return force, remove_errors(rate, scale=components(p, "s"))


class ImuLeverArm(Effect):
    """The IMU is at its stated position + d."""

    name = "imu_lever_arm"
    family = "sensor"
    summary = "the IMU is at its stated position + d"
    shows = (
        "The residual of the specific force at the centre of mass has a part in proportion to the squared rates and to "
        "the angular acceleration: constant on a spinning vehicle, with the period of the oscillation where it "
        "oscillates."
    )
    source = "Thomas (2011), eq. 3.3 and table 3.4, whose digits are missing in the text; the size is assumed"
    parameters = vector("d", "m", "displacement", 0.25, 3.0)

    def imu_position(self, p: Values) -> Array:
        """Displacement ``(3,)``, m, body axes."""
        return components(p, "d")


class ImuTimeOffset(Effect):
    """``w_m(t) = w(t - tau)``."""

    name = "imu_time_offset"
    family = "sensor"
    summary = "gyro samples are later than the accelerometers': w_m(t) = w(t - tau)"
    shows = (
        "Where the vehicle oscillates, forces lead the rates: residuals of moments and lateral forces are proportional "
        "to the angular acceleration, and the second IMU's rates lead too."
    )
    source = "channels of one telemetry stream may differ by about a sample, at 8 Hz"
    parameters = (Parameter("tau", "s", "delay of the gyros' samples", 0.1, low=-2.0, high=2.0),)
    interpolates_rates = True

    def imu(self, p: Values, time: Array, force: Array, rate: Array) -> tuple[Array, Array]:
        """Rates of the time `tau` earlier."""
        return force, delayed(time, rate, p["tau"])

    def corrected(self, p: Values, time: Array, force: Array, rate: Array) -> tuple[Array, Array]:
        """Rates of the time `tau` later."""
        return force, delayed(time, rate, -p["tau"])


def delayed(time: Array, mean: Array, delay: float) -> Array:
    """Means over the same intervals of the signal `delay` earlier.

    The integral of a signal is known exactly at the edges of its samples; a cubic spline through these values is
    evaluated at the shifted edges. Before the first and after the last sample the signal is held constant.

    Parameters
    ----------
    time : (N,) array
        Ends of adjoining intervals, s; the first is as long as the second.
    mean : (N, 3) array
        Means over them, in any unit; samples that are NaN stay NaN.
    delay : float
        s, of either sign.

    Returns
    -------
    (N, 3) array
        In the unit of `mean`.
    """
    from scipy.interpolate import CubicSpline  # slow to import

    if delay == 0.0:
        return mean
    edges = np.concatenate((2.0 * time[:1] - time[1:2], time))
    interval = np.diff(edges)[:, None]
    valid = np.isfinite(mean)
    filled = mean if valid.all() else np.stack(
        [np.interp(time, time[k], m[k]) if k.any() else np.zeros(len(m)) for m, k in zip(mean.T, valid.T, strict=True)],
        axis=1,
    )  # fmt: skip
    integral = np.concatenate((np.zeros((1, mean.shape[1])), np.cumsum(filled * interval, axis=0)))
    shifted = edges - delay
    inside = CubicSpline(edges, integral, axis=0)(np.clip(shifted, edges[0], edges[-1]))
    before, after = np.minimum(shifted - edges[0], 0.0)[:, None], np.maximum(shifted - edges[-1], 0.0)[:, None]
    delayed_mean = np.diff(inside + before * filled[0] + after * filled[-1], axis=0) / interval
    return np.where(valid, delayed_mean, np.nan)


EFFECTS = (
    AccelerometerBias, AccelerometerScale, AccelerometerMisalignment, GyroBias, GyroScale, ImuLeverArm, ImuTimeOffset
)  # fmt: skip
