"""One epoch of the unscented and of the extended filter over numbers of states and of samples.

An epoch is a prediction over its samples and an update with a position. The bare kernel propagates the same sigma
points over the same samples.

Run: ``python benchmarks/bench_epochs.py``
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from measuring import Grid, Section, Times, interleaved, run
from peer_problem import MARS, PositionFix

from edl_filter.estimation.parallel import one_blas_thread
from edl_filter.imu_model.sensor_errors import SensorErrors
from edl_filter.navigation import strapdown
from edl_filter.navigation.compiled_ukf import CompiledUKF
from edl_filter.navigation.ekf import ErrorStateEKF
from edl_filter.navigation.increments import Samples
from edl_filter.navigation.layout import ONBOARD, Layout, State

SAMPLES = (1, 8, 25, 200)
_SENSORS = {
    15: SensorErrors(accelerometer_bias=0.02, gyro_bias=1e-4),
    18: SensorErrors(accelerometer_bias=0.02, gyro_bias=1e-4, accelerometer_scale=1e-3),
    21: SensorErrors(accelerometer_bias=0.02, gyro_bias=1e-4, accelerometer_scale=1e-3, gyro_scale=1e-3),
    24: SensorErrors(0.02, 1e-3, 2e-3, 1e-4, 1e-3),
}
#: States of an entry that is stated for a wrong time and in a wrong frame, and of an attitude computed on board.
_ENTRY = {"entry_epoch": 1, "entry_frame": 3, "onboard_rate": 3, "onboard_mounting": 3, ONBOARD: 3}
LAYOUTS = {n: Layout.of((errors,), {}) for n, errors in _SENSORS.items()} | {37: Layout.of((_SENSORS[24],), _ENTRY)}
_SIGMAS = {
    "position": 100.0,
    "velocity": 1.0,
    "attitude": 1e-3,
    "accelerometer_bias": 0.02,
    "accelerometer_scale": 1e-3,
    "accelerometer_misalignment": 1e-3,
    "gyro_bias": 1e-4,
    "gyro_scale": 1e-3,
    "entry_epoch": 0.1,
    "entry_frame": 1e-5,
    "onboard_rate": 1e-5,
    "onboard_mounting": 1e-4,
    ONBOARD: 1e-4,
}


def samples_of(count: int) -> Samples:
    """A braking, turning vehicle, 8 Hz."""
    rng, full = np.random.default_rng(3), np.ones(count)
    force = np.array([-25.0, 1.0, -3.0]) + rng.standard_normal((count, 3))
    rate = np.array([0.2, -0.05, 0.05]) + 0.05 * rng.standard_normal((count, 3))
    return Samples(
        time=0.125 * np.arange(1, count + 1),
        interval=0.125 * full,
        force=force,
        rate=rate,
        mean_force=force,
        mean_rate=rate,
        force_noise=0.02 * full,
        rate_noise=1e-4 * full,
        shared_rate_noise=5e-5 * full,
        coning_corrected=np.zeros(count, bool),
        unit=np.zeros(count, int),
    )


def epoch(filter_class: Any, layout: Layout, samples: Samples) -> Callable[[], None]:
    """One epoch from the same start."""
    nav = np.array([3.39e6, 2e5, -3e5, -200.0, 4900.0, 300.0, 0.1, -0.3, 0.4, np.sqrt(0.74)])
    nav = np.concatenate((nav, nav[6:])) if ONBOARD in layout else nav
    sigmas = np.concatenate([np.full(s.stop - s.start, _SIGMAS[name]) for name, s in layout.slices.items()])
    estimator = filter_class(layout, State(nav, np.zeros(layout.size)), np.diag(sigmas**2), MARS)
    state, covariance, points = estimator.state, estimator.covariance.copy(), getattr(estimator, "sigma_points", None)
    fix = PositionFix(float(samples.time[-1]), nav[:3] + samples.time[-1] * nav[3:6], 400.0 * np.eye(3))

    def run_epoch() -> None:
        estimator.state, estimator.covariance = state, covariance
        if points is not None:
            estimator.sigma_points = points
        estimator.predict(samples)
        estimator.update(fix, estimator.innovation(fix))

    return run_epoch


def kernel(layout: Layout, samples: Samples) -> Callable[[], None]:
    """Bare propagation of the sigma points."""
    columns = strapdown.padded(2 * layout.size + 1)
    states = np.repeat(
        np.array([3.39e6, 2e5, -3e5, -200.0, 4900.0, 300.0, 0.0, 0.0, 0.0, 1.0])[:, None], columns, axis=1
    )
    force_map, rate_map = np.zeros((12, columns)), np.zeros((6, columns))
    force_map[[0, 4, 8]], rate_map[:3] = 1.0, 1.0
    s, p = samples, MARS
    return lambda: strapdown.propagate(
        states.copy(), force_map, rate_map, s.interval, s.force, s.rate, p.mu, p.j2, p.gravity_radius
    )


def grid(times: Times, text: str, title: str, cell: Callable[[int, int], float]) -> Section:
    """Section of one table over states and samples."""
    lines = {f"{n}": [cell(n, count) for count in SAMPLES] for n in LAYOUTS}
    return Section(title, text, grid=Grid("states", [f"{c} samples" if c > 1 else "1 sample" for c in SAMPLES], lines))


def measure() -> list[Section]:
    """All sections."""
    functions: dict[str, Callable[[], None]] = {}
    for n, layout in LAYOUTS.items():
        for count in SAMPLES:
            s = samples_of(count)
            functions[f"ukf {n} {count}"] = epoch(CompiledUKF, layout, s)
            functions[f"ekf {n} {count}"] = epoch(ErrorStateEKF, layout, s)
            functions[f"kernel {n} {count}"] = kernel(layout, s)
    with one_blas_thread():
        times = interleaved(functions, rounds=7, shortest=0.01)
    least, unit = times.least, times.least("ukf 15 1")
    return [
        grid(
            times,
            "Unscented filter, relative to its epoch of 15 states and one sample: growth with both.",
            "Epoch: growth of the UKF",
            lambda n, c: least(f"ukf {n} {c}") / unit,
        ),
        grid(
            times,
            "Unscented filter, relative to the bare kernel's propagation of the same sigma points and samples.",
            "Epoch: UKF against the bare kernel",
            lambda n, c: least(f"ukf {n} {c}") / least(f"kernel {n} {c}"),
        ),
        grid(
            times,
            "Extended filter, relative to the unscented one.",
            "Epoch: EKF against UKF",
            lambda n, c: least(f"ekf {n} {c}") / least(f"ukf {n} {c}"),
        ),
    ]


if __name__ == "__main__":
    run(measure)
