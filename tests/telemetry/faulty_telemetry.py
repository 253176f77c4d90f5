"""Telemetry of a flight with exchanged axes or another altimeter."""

from dataclasses import replace

import numpy as np

SWAP_XY = np.eye(3)[[1, 0, 2]]
SWAP_XZ = np.eye(3)[[2, 1, 0]]


def turned(telemetry, matrix, *quantities):
    driving = telemetry.driving
    return replace(
        telemetry, driving=replace(driving, **{q: getattr(driving, q) @ np.asarray(matrix).T for q in quantities})
    )


def with_altimeter(telemetry, offset):
    altimeter = telemetry.altimeter
    return replace(telemetry, altimeter=replace(altimeter, height=altimeter.height + offset))
