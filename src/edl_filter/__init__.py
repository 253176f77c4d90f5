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
    >>> reconstruction.plot.trajectory()         # matplotlib axes; dir(reconstruction.plot) has the others
    >>> reconstruction.to_xarray()["trajectory"]["altitude"]

    The loop in Python, as the notebooks go through it (``notebooks/``, `docs/notebooks.md`):

    >>> from edl_filter import diagnose, refit
    >>> diagnosis = diagnose(reconstruction)     # .residuals, .errors, .leader, .plot.heatmap()
    >>> improved = refit(reconstruction.mission.with_effect(diagnosis.leader))
    >>> diagnose(improved).plot.fall(diagnosis)

    `improve` goes round by itself, `simulate` flies a `Scenario` with hidden effects, `catalogue` and `effect` give
    the effects. All public names (`__all__`) are imported when they are first asked for, so that a command's help
    need not wait for a compiler.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from edl_filter.api import catalogue, diagnose, effect, improve, refit
    from edl_filter.diagnosis.diagnose import Diagnosis
    from edl_filter.effects import Effect, Parameter
    from edl_filter.errors import InputError
    from edl_filter.mission import Mission
    from edl_filter.reconstruction import Reconstruction, reconstruct
    from edl_filter.results import read as read_result
    from edl_filter.simulation.scenario import Scenario
    from edl_filter.simulation.simulate import simulate

__version__ = "0.1.0"
__all__ = [
    "Diagnosis",
    "Effect",
    "InputError",
    "Mission",
    "Parameter",
    "Reconstruction",
    "Scenario",
    "__version__",
    "catalogue",
    "diagnose",
    "effect",
    "improve",
    "read_result",
    "reconstruct",
    "refit",
    "simulate",
]

#: Public name → module and its name there.
_PUBLIC = {
    "Diagnosis": ("edl_filter.diagnosis.diagnose", "Diagnosis"),
    "Effect": ("edl_filter.effects", "Effect"),
    "InputError": ("edl_filter.errors", "InputError"),
    "Mission": ("edl_filter.mission", "Mission"),
    "Parameter": ("edl_filter.effects", "Parameter"),
    "Reconstruction": ("edl_filter.reconstruction", "Reconstruction"),
    "Scenario": ("edl_filter.simulation", "Scenario"),
    "catalogue": ("edl_filter.api", "catalogue"),
    "diagnose": ("edl_filter.api", "diagnose"),
    "effect": ("edl_filter.api", "effect"),
    "improve": ("edl_filter.api", "improve"),
    "read_result": ("edl_filter.results", "read"),
    "reconstruct": ("edl_filter.reconstruction", "reconstruct"),
    "refit": ("edl_filter.api", "refit"),
    "simulate": ("edl_filter.simulation", "simulate"),
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
