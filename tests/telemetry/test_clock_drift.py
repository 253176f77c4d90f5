"""Times of an IMU whose clock drifts against another one's."""

from dataclasses import replace

import numpy as np
import pytest

from edl_filter.telemetry.clock_drift import without_relative_drift
from edl_filter.telemetry.flight_file import read_flight_file


@pytest.mark.parametrize("ratio", [-5e-4, 1e-3])
def test_a_relative_drift_is_removed(ratio, builtin_flight):
    telemetry = read_flight_file(builtin_flight)
    record, reference = telemetry.driving, telemetry.checking[0]
    drifting = replace(
        record,
        time=record.start + (1.0 + ratio) * (record.time - record.start),
        interval=(1.0 + ratio) * record.interval,
    )
    steady = without_relative_drift(drifting, reference, 250.0)
    np.testing.assert_allclose(steady.interval, record.interval, rtol=1e-4)
