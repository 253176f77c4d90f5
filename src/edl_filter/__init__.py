"""Planetary entry reconstruction from inertial telemetry.

This docstring defines frames, names, units and array shapes for the whole package.

Units
    SI everywhere; angles in radians. Degrees appear only in mission files, tables for people and
    figures, and then the name ends in ``_deg``.

Frames
    ``inertial``
        Planet-centred inertial: z along the rotation axis (north), x along the ascending node of the
        planet's equator on the Earth mean equator of J2000 (the IAU node), frozen at the epoch. The
        thesis's entry states are in these axes, which it calls PICS.
    ``fixed``
        Planet-fixed: the inertial frame rotated about z by the prime meridian's angle.
    ``body``
        Origin at the centre of mass, x along the symmetry axis towards the nose, y right, z down.
        Drag gives a negative x specific force.
    ``imu``
        The sensing axes of one IMU, fixed in the body.
    ``j2000``
        Earth mean equator and equinox of J2000, in which MER's on-board quaternions are given.

Rotations
    Quaternions are scalar-last ``[x, y, z, w]``. ``a_from_b`` transforms components in b to components
    in a. A small rotation is a rotation vector; an attitude error is in body axes:
    ``stated = true ⊗ exp(error)``.

Times
    Seconds since the mission's epoch (for MER: entry interface, r = 3522.2 km). A sample of an IMU is
    the mean over an interval; its time is the end of the interval.

Arrays
    Time runs along the first axis: ``(N,)``, ``(N, 3)`` for vectors, ``(N, 4)`` for quaternions.
    Only kernels use ``(state, sigma)``.

Use
    >>> from edl_filter import Mission, reconstruct
    >>> flight = reconstruct(Mission.load("missions/mer_a.yaml"))
    >>> tree = flight.to_xarray()                # DataTree with units: trajectory, imu, constraints, postflight, …
    >>> tree["trajectory"]["altitude"]           # DataArray by time, m
    >>> flight.plot.trajectory()                 # matplotlib axes; dir(flight.plot) lists all plots

    Diagnosis and model improvement in Python, as in the notebooks (``notebooks/``, `docs/notebooks.md`):

    >>> from edl_filter import diagnose, refit, with_effect
    >>> diagnosis = diagnose(flight)             # .residuals, .errors, .leader, .plot.heatmap()
    >>> improved = refit(with_effect(flight.mission, diagnosis.leader))
    >>> diagnose(improved).plot.fall(diagnosis)

    `improve` repeats these steps automatically, `simulate` simulates a `Scenario` with hidden effects, `catalogue` and
    `effect` return effects. Each public name (`__all__`) is imported when it is first used, so that the help of a
    command does not wait for the import of numba.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from edl_filter import display
from edl_filter._version import __version__

if TYPE_CHECKING:
    from edl_filter.api import catalogue, diagnose, effect, improve, refit
    from edl_filter.diagnosis.diagnosis import Diagnosis
    from edl_filter.effects import Effect, Parameter
    from edl_filter.errors import InputError
    from edl_filter.mission import Mission
    from edl_filter.mission.edit_effects import with_effect, with_effects
    from edl_filter.results import Result, reconstruct
    from edl_filter.results import read as read_result
    from edl_filter.simulation.scenario import Scenario
    from edl_filter.simulation.simulate import simulate

__all__ = [
    "Diagnosis",
    "Effect",
    "InputError",
    "Mission",
    "Parameter",
    "Result",
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
    "with_effect",
    "with_effects",
]

#: Public name → module, and name of the attribute in it.
_PUBLIC = {
    "Diagnosis": ("edl_filter.diagnosis.diagnosis", "Diagnosis"),
    "Effect": ("edl_filter.effects", "Effect"),
    "InputError": ("edl_filter.errors", "InputError"),
    "Mission": ("edl_filter.mission", "Mission"),
    "Parameter": ("edl_filter.effects", "Parameter"),
    "Result": ("edl_filter.results", "Result"),
    "Scenario": ("edl_filter.simulation", "Scenario"),
    "catalogue": ("edl_filter.api", "catalogue"),
    "diagnose": ("edl_filter.api", "diagnose"),
    "effect": ("edl_filter.api", "effect"),
    "improve": ("edl_filter.api", "improve"),
    "read_result": ("edl_filter.results", "read"),
    "reconstruct": ("edl_filter.results", "reconstruct"),
    "refit": ("edl_filter.api", "refit"),
    "simulate": ("edl_filter.simulation", "simulate"),
    "with_effect": ("edl_filter.mission.edit_effects", "with_effect"),
    "with_effects": ("edl_filter.mission.edit_effects", "with_effects"),
}


#: Functions that display and save the objects of lower layers, imported on first use (`edl_filter.display`).
display.register(
    {
        ("html", "edl_filter.api.Catalogue"): "edl_filter.report.notebook:catalogue_card",
        ("html", "edl_filter.diagnosis.diagnosis.Diagnosis"): "edl_filter.report.notebook:diagnosis_card",
        ("html", "edl_filter.effects.base.Effect"): "edl_filter.report.notebook:effect_card",
        ("html", "edl_filter.mission.mission.Mission"): "edl_filter.report.notebook:mission_card",
        ("html", "edl_filter.results.result.Result"): "edl_filter.report.notebook:result_card",
        ("plot", "edl_filter.diagnosis.diagnosis.Diagnosis"): "edl_filter.report.plots:DiagnosisPlots",
        ("plot", "edl_filter.results.result.Result"): "edl_filter.report.plots:ResultPlots",
        ("save", "edl_filter.results.result.Result"): "edl_filter.workflow.run:write_outputs",
    }
)


def __getattr__(name: str) -> Any:
    if name not in _PUBLIC:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module, attribute = _PUBLIC[name]
    value = getattr(import_module(module), attribute)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
