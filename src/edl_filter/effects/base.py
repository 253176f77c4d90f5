"""What a physical effect is: one statement with parameters, off at zero, and the places where it may act.

An effect declares what a person must know of it and overrides the hooks that it needs; every hook is vectorised over
time and leaves things as they are if it is not overridden. The same object serves reconstruction, prediction and
simulation. `p` is always a mapping from parameter names to numbers, in the units of the declaration (SI, radians).

The hooks
---------
imu
    What a sensor reads of the true motion; `corrected` is its inverse.
imu_position
    By how much the IMU sits away from where the mission says, m, body axes.
gravity, atmosphere_rate
    Planet with another field; factor on the rate at which the air turns with the planet.
wind, density
    Added wind towards east and north; factor on the density; by areodetic altitude.
coefficients
    Total coefficients in the plane of the total angle, rolling moment and damping.
force_moment
    Further body-fixed force and moment, N and N m.
vehicle
    Mass, inertia, centre of mass.
entry_state
    Position and velocity of the stated entry state.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:  # a compiler comes with the planet, and a table of the catalogue needs none
    from edl_filter.planet import Planet
    from edl_filter.telemetry.record import InitialState

Array = NDArray[np.float64]
Values = Mapping[str, float]

#: What a parameter says: how much (the effect is linear in it, or nearly), or where (scanned, not linearised at zero).
KINDS = ("size", "time", "altitude", "length", "phase", "mach", "frequency")


@dataclass(frozen=True)
class Parameter:
    """One number of an effect.

    Attributes
    ----------
    name, unit, description : str
    sigma : float
        Plausible size: one sigma of a size about zero. Not used for the other kinds, which are uniform in their range.
    kind : str
        One of `KINDS`. An effect is off when all its parameters of kind ``size`` are zero.
    low, high : float
        Bounds. For a ``time``, infinite bounds stand for the flight's own, from entry to parachute.
    scan : int
        For the kinds that say where: how many values the diagnosis tries between the bounds.
    default : float
        Value where none is given.
    """

    name: str
    unit: str
    description: str
    sigma: float = 0.0
    kind: str = "size"
    low: float = -np.inf
    high: float = np.inf
    scan: int = 0
    default: float = 0.0


@dataclass(frozen=True)
class Flow:
    """Where the vehicle is and how the air meets it, ``(N,)`` each if not said otherwise.

    Attributes
    ----------
    time : array
        s since the epoch.
    altitude : array
        Areodetic, m.
    velocity_body : (N, 3) array
        Air-relative, m/s.
    rate : (N, 3) array
        Angular rate, rad/s, body axes.
    speed, density, mach, knudsen, dynamic_pressure : arrays
        m/s, kg/m³, 1, 1, Pa.
    alpha_total : array
        rad.
    diameter : float
        Reference length, m; the reference area is pi D²/4.
    """

    time: Array
    altitude: Array
    velocity_body: Array
    rate: Array
    speed: Array
    density: Array
    mach: Array
    knudsen: Array
    dynamic_pressure: Array
    alpha_total: Array
    diameter: float = np.nan

    @property
    def area(self) -> float:
        """Reference area, m²."""
        return np.pi / 4.0 * self.diameter**2


@dataclass(frozen=True)
class Totals:
    """Coefficients in the plane of the total angle, ``(N,)`` each; the pitching moment is about the nose.

    Attributes
    ----------
    ca, cn, cm_nose : arrays
        Along -x, along the lateral flow's plane, and nose-up in that plane.
    cl : array
        Rolling moment.
    cmq : array
        Pitch and yaw damping: moment coefficient over rate D / 2V.
    """

    ca: Array
    cn: Array
    cm_nose: Array
    cl: Array
    cmq: Array


@dataclass(frozen=True)
class Body:
    """The vehicle as a rigid body.

    Attributes
    ----------
    mass : float
        kg.
    inertia : (3, 3) array
        About the centre of mass, kg m²; elements off the diagonal are minus the products.
    offset : (3,) array
        Centre of mass against the point on the axis that the mission names, m, body axes: what the mission puts it
        beside the axis, and what effects move it further. What is bolted to the vehicle does not move with it.
    """

    mass: float
    inertia: Array
    offset: Array = field(default_factory=lambda: np.zeros(3))

    def centre(self, x_over_d: float, diameter: float) -> tuple[float, float, float]:
        """Centre of mass in diameters: behind the nose, to the right (+y) and down (+z).

        Parameters
        ----------
        x_over_d, diameter : float
            The mission's point on the axis, diameters behind the nose; m.
        """
        x, y, z = (float(d) / diameter for d in self.offset)
        return x_over_d - x, y, z


class Effect:
    """Base of all effects; see the module for the hooks.

    Attributes
    ----------
    name : str
        As in missions and tables.
    family : str
        ``sensor``, ``vehicle``, ``planet``, ``atmosphere``, ``aerodynamics``, ``entry`` or ``user``.
    summary : str
        What it is, one line.
    shows : str
        How it shows in the residuals, one sentence.
    region : str
        Where it is valid.
    source : str
        Where form and plausible size come from.
    parameters : tuple of Parameter
    half_turn : tuple of str
        Sizes that change their sign with half a turn of the phases: estimates are told with the first not negative.
    number : int
        Which of its kind it is in a model: the second is called ``name_2`` (`again`).
    file : Path or None
        Python file that it was read from, for a user's.
    """

    name: ClassVar[str] = ""
    number: ClassVar[int] = 1
    family: ClassVar[str] = "user"
    summary: ClassVar[str] = ""
    shows: ClassVar[str] = ""
    region: ClassVar[str] = "everywhere"
    source: ClassVar[str] = ""
    half_turn: ClassVar[tuple[str, ...]] = ()
    parameters: ClassVar[tuple[Parameter, ...]] = ()
    file: Path | None = None

    def imu(self, p: Values, time: Array, force: Array, rate: Array) -> tuple[Array, Array]:
        """What the sensor reads where the true means are `force` and `rate`, ``(N, 3)``, body axes.

        `time` is the end of each sample's interval; intervals adjoin.
        """
        return force, rate

    def corrected(self, p: Values, time: Array, force: Array, rate: Array) -> tuple[Array, Array]:
        """What was true where the sensor read `force` and `rate`: `imu` inverted by iteration.

        Converges for errors that are small against what they act on; overridden where a closed form exists.
        """
        f, w = force, rate
        for _ in range(4):
            read_f, read_w = self.imu(p, time, f, w)
            f, w = f + (force - read_f), w + (rate - read_w)
        return f, w

    def imu_position(self, p: Values) -> Array:
        """By how much the IMU sits away from its stated position, ``(3,)``, m, body axes."""
        return np.zeros(3)

    def gravity(self, p: Values, planet: Planet) -> Planet:
        """The planet with another gravity field."""
        return planet

    def atmosphere_rate(self, p: Values) -> float:
        """Factor on the rate at which the air turns with the planet."""
        return 1.0

    def wind(self, p: Values, altitude: Array) -> Array:
        """Further velocity of the air towards east and north, ``(N, 2)``, m/s."""
        return np.zeros((len(altitude), 2))

    def density(self, p: Values, altitude: Array) -> Array:
        """Factor on the density, ``(N,)``."""
        return np.ones(len(altitude))

    def coefficients(self, p: Values, flow: Flow, totals: Totals) -> Totals:
        """Other coefficients."""
        return totals

    def force_moment(self, p: Values, flow: Flow) -> tuple[Array, Array]:
        """Further force (N) and moment about the centre of mass (N m), ``(N, 3)`` each, body axes."""
        return np.zeros((len(flow.time), 3)), np.zeros((len(flow.time), 3))

    def vehicle(self, p: Values, body: Body) -> Body:
        """Another rigid body."""
        return body

    def entry_state(self, p: Values, initial: InitialState) -> InitialState:
        """The true entry state where `initial` was stated."""
        return initial

    def acts(self, hook: str) -> bool:
        """Whether the effect overrides `hook`."""
        return getattr(type(self), hook) is not getattr(Effect, hook)

    def completed(self, values: Values) -> dict[str, float]:
        """All parameters by name: those of `values`, the others at their defaults."""
        return {q.name: float(values.get(q.name, q.default)) for q in self.parameters}

    def at(self, **values: float) -> Active:
        """The effect switched on: what is not named takes its default, which is zero for sizes.

        Raises
        ------
        InputError
            There is no such parameter, or it is out of its bounds.
        """
        from edl_filter.effects.loading import checked_values

        return Active(self, checked_values(self, values))

    def __repr__(self) -> str:
        return f"<effect {self.name}: {self.summary}>"

    def _repr_html_(self) -> str:
        from edl_filter.report.cards import effect_card

        return effect_card(self)

    @property
    def sizes(self) -> tuple[Parameter, ...]:
        """Parameters that say how much."""
        return tuple(q for q in self.parameters if q.kind == "size")

    @property
    def places(self) -> tuple[Parameter, ...]:
        """Parameters that say where, when or how long."""
        return tuple(q for q in self.parameters if q.kind != "size")


@dataclass(frozen=True)
class Active:
    """An effect switched on.

    Attributes
    ----------
    effect : Effect
    values : dict
        Parameter → number; what is not named takes its default, which is zero for sizes.
    imu : str or None
        Which IMU a sensor effect sits in; None is the driving one.
    fixed : bool
        Held at its values instead of being refitted.
    """

    effect: Effect
    values: dict[str, float]
    imu: str | None = None
    fixed: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "values", self.effect.completed(self.values))

    @property
    def name(self) -> str:
        """The effect's."""
        return self.effect.name

    @property
    def fitted(self) -> tuple[Parameter, ...]:
        """Parameters that are to be found: sizes, and places where they are finite; none if it is fixed."""
        if self.fixed:
            return ()
        return tuple(q for q in self.effect.parameters if q.kind == "size" or np.isfinite(self.values[q.name]))

    def unsized(self) -> Active:
        """The same as if it were not there: its places stay, its sizes are zero."""
        return replace(self, values=self.values | {q.name: 0.0 for q in self.effect.sizes})

    def in_one_turn(self) -> Active:
        """The same in one form: an amplitude that is not negative, phases between their bounds."""
        swapped = self.effect.half_turn
        flips = bool(swapped) and self.values[swapped[0]] < 0.0
        sizes = {name: -self.values[name] for name in swapped} if flips else {}
        turned = {}
        for q in self._phases:
            turn = q.high - q.low
            turned[q.name] = q.low + (self.values[q.name] + (0.5 * turn if flips else 0.0) - q.low) % turn
        return replace(self, values=self.values | sizes | turned)

    def change_from(self, other: Mapping[str, float], parameter: str) -> float:
        """By how much a parameter differs from another value, not counting whole turns of a phase."""
        change = abs(self.values[parameter] - other[parameter])
        for q in self._phases:
            if q.name == parameter:
                change = min(change % (q.high - q.low), -change % (q.high - q.low))
        return change

    @property
    def _phases(self) -> tuple[Parameter, ...]:
        return tuple(q for q in self.effect.parameters if q.kind == "phase" and np.isfinite(q.high - q.low))
