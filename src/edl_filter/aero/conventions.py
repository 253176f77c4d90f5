"""Quantities to which aerodynamic coefficients refer: reference area and angles of the air-relative velocity."""

from __future__ import annotations

import numpy as np

from edl_filter.types import Array


def reference_area(diameter: float) -> float:
    """Reference area ``π D² / 4`` (m²) of a vehicle or a parachute of a diameter (m)."""
    return np.pi / 4.0 * diameter**2


def total_angle(velocity_body: Array) -> Array:
    """Total angle of attack ``acos(u / V)`` (N,), rad, of an air-relative velocity (N, 3) along the body axes."""
    u, v, w = velocity_body.T
    return np.arctan2(np.hypot(v, w), u)


def attack_and_sideslip(velocity_body: Array) -> tuple[Array, Array]:
    """``atan2(w, u)`` and ``asin(v / V)``, (N,) each, rad, of an air-relative velocity (N, 3) along the body axes."""
    u, v, w = velocity_body.T
    return np.arctan2(w, u), np.arctan2(v, np.hypot(u, w))
