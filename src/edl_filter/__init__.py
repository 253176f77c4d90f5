"""Planetary entry reconstruction from inertial telemetry.

This docstring fixes frames, names, units and array shapes once for the whole package.

Units
    SI everywhere; angles in radians. Degrees appear only in mission files, tables for people and
    figures, and then the name ends in ``_deg``.

Frames
    ``inertial``
        Planet-centred inertial (the thesis's PICS): z along the rotation axis (north), x along the
        ascending node of the planet's equator on the Earth mean equator of J2000 (the IAU node),
        frozen at the epoch.
    ``fixed``
        Planet-fixed: the inertial frame turned about z by the prime meridian's angle.
    ``body``
        Origin at the centre of mass, x along the symmetry axis towards the nose, y right, z down.
        Drag gives a negative x specific force.
    ``imu``
        The sensing axes of one IMU, fixed in the body.
    ``j2000``
        Earth mean equator and equinox of J2000, in which MER's on-board quaternions are given.

Rotations
    Quaternions are scalar-last ``[x, y, z, w]``. ``a_from_b`` takes components in b to components
    in a. A small rotation is a rotation vector; an attitude error is in body axes:
    ``stated = true ⊗ exp(error)``.

Times
    Seconds since the mission's epoch (for MER: entry interface, r = 3522.2 km). A sample of an IMU is
    a mean over an interval and carries the time of the interval's end.

Arrays
    Time runs along the first axis: ``(N,)``, ``(N, 3)`` for vectors, ``(N, 4)`` for quaternions.
    Kernels alone use ``(state, sigma)``.

Use
    >>> from edl_filter import Mission, reconstruct
    >>> reconstruction = reconstruct(Mission.load("missions/mer_a.yaml"))

    `Mission`, `reconstruct`, `Reconstruction`, `read_result` and `InputError` are the public names; they are
    imported when they are first asked for, so that a command's help need not wait for a compiler.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from edl_filter.errors import InputError
    from edl_filter.mission import Mission
    from edl_filter.reconstruction import Reconstruction, reconstruct
    from edl_filter.results import read as read_result

__version__ = "0.1.0"
__all__ = ["InputError", "Mission", "Reconstruction", "__version__", "read_result", "reconstruct"]

#: Public name → module and its name there.
_PUBLIC = {
    "InputError": ("edl_filter.errors", "InputError"),
    "Mission": ("edl_filter.mission", "Mission"),
    "Reconstruction": ("edl_filter.reconstruction", "Reconstruction"),
    "read_result": ("edl_filter.results", "read"),
    "reconstruct": ("edl_filter.reconstruction", "reconstruct"),
}


def __getattr__(name: str) -> Any:
    if name not in _PUBLIC:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module, there = _PUBLIC[name]
    value = getattr(import_module(module), there)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *_PUBLIC})
