"""A physical effect: one physical statement with parameters, off at zero, and the hooks through which it acts.

An effect declares its name, parameters and source, and overrides the hooks that it needs. Every hook is vectorised over
time; a hook that is not overridden changes nothing. The same object serves reconstruction, prediction and simulation.
`p` is always a mapping from parameter names to numbers, in the units of the declaration (SI, radians).

The hooks
---------
imu
    Reading of a sensor as a function of the true motion; `corrected` is its inverse.
imu_position
    Displacement of the IMU from its stated position, m, body axes.
gravity, atmosphere_rate
    Planet with another gravity field; factor on the rate at which the air rotates with the planet.
wind, density
    Added wind towards east and north, and factor on the density, by areodetic altitude.
coefficients
    Total coefficients in the plane of the total angle, rolling moment and damping.
force_moment
    Added body-fixed force and moment, N and N m.
vehicle
    Mass, inertia, centre of mass.
entry_state
    Position and velocity of the stated entry state.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, NamedTuple

import numpy as np

from edl_filter.display import render
from edl_filter.effects.parameters import Parameter as Parameter
from edl_filter.effects.parameters import Values, bounds_text, nearest
from edl_filter.effects.types import AeroCoefficients, Body, FlightCondition
from edl_filter.errors import InputError
from edl_filter.types import Array

if TYPE_CHECKING:  # `planet` imports a compiler, which a table of the catalogue does not need
    from edl_filter.planet import Planet
    from edl_filter.telemetry.record import InitialState

#: Hooks of an error that an IMU has.
SENSOR_HOOKS = ("imu", "corrected", "imu_position")
#: Hooks of the air.
AIR_HOOKS = ("atmosphere_rate", "wind", "density")
#: Hooks of all effects that are no errors of an IMU.
MODEL_HOOKS = (*AIR_HOOKS, "gravity", "coefficients", "force_moment", "vehicle", "entry_state")
#: Hooks that change the motion at the centre of mass which readings stand for.
READING_HOOKS = (*SENSOR_HOOKS, "vehicle")
#: Hooks that change the dead-reckoned path, or the readings along it.
PATH_HOOKS = (*READING_HOOKS, "gravity", "entry_state")
#: Name of an effect, and the IMU in which it acts (None: the driving one, or no sensor effect).
EffectKey = tuple[str, str | None]


class Problem(NamedTuple):
    """An invalid value: name of the parameter, text of the actual value, text of what is expected."""

    parameter: str
    actual: str
    expected: str


class Effect:
    """Base of all effects; the module's docstring lists the hooks.

    Attributes
    ----------
    name : str
        As in missions and tables.
    family : str
        ``sensor``, ``vehicle``, ``planet``, ``atmosphere``, ``aerodynamics``, ``entry`` or ``user``.
    summary : str
        Definition, one line.
    shows : str
        Effect on the residuals, one sentence.
    region : str
        Region of validity.
    source : str
        Source of form and plausible size.
    parameters : tuple of Parameter
    interpolates_rates : bool
        Whether `corrected` interpolates the rates between samples, as for a delay. The diagnosis then predicts the
        error of the interpolation by the hook `imu`, which must also accept means over parts of the samples.
    half_turn : tuple of str
        Sizes that change their sign with half a turn of the phases: estimates are stated with the first not negative.
    number : int
        1 for the effect itself; 2 and more for further instances of it in a model, which are called ``name_2`` and so
        on (`edl_filter.effects.instances`).
    file : Path or None
        Python file that defines it, for a user's effect.
    """

    name: ClassVar[str] = ""
    number: ClassVar[int] = 1
    family: ClassVar[str] = "user"
    summary: ClassVar[str] = ""
    shows: ClassVar[str] = ""
    region: ClassVar[str] = "everywhere"
    source: ClassVar[str] = ""
    interpolates_rates: ClassVar[bool] = False
    half_turn: ClassVar[tuple[str, ...]] = ()
    parameters: ClassVar[tuple[Parameter, ...]] = ()
    file: Path | None = None

    def imu(self, p: Values, time: Array, force: Array, rate: Array) -> tuple[Array, Array]:
        """Reading of the sensor where the true means are `force` and `rate`.

        Parameters
        ----------
        p : mapping
            Parameter → value.
        time : (N,) array
            End of each sample's interval, s; intervals adjoin.
        force, rate : (N, 3) arrays
            Means over the samples: specific force, m/s², and angular rate, rad/s; body axes.

        Returns
        -------
        force, rate : (N, 3) arrays
            The same units.
        """
        return force, rate

    def corrected(self, p: Values, time: Array, force: Array, rate: Array) -> tuple[Array, Array]:
        """True means where the sensor read `force` and `rate`: inverse of `imu`, by fixed-point iteration.

        Converges for errors that are small relative to the reading; overridden where a closed form exists.

        Parameters
        ----------
        p : mapping
            Parameter → value.
        time : (N,) array
            As in `imu`.
        force, rate : (N, 3) arrays
            Readings, m/s² and rad/s, body axes.

        Returns
        -------
        force, rate : (N, 3) arrays
            The same units.
        """
        f, w = force, rate
        for _ in range(4):
            read_f, read_w = self.imu(p, time, f, w)
            f, w = f + (force - read_f), w + (rate - read_w)
        return f, w

    def imu_position(self, p: Values) -> Array:
        """Displacement ``(3,)`` of the IMU from its stated position, m, body axes."""
        return np.zeros(3)

    def gravity(self, p: Values, planet: Planet) -> Planet:
        """The planet with the effect's gravity field."""
        return planet

    def atmosphere_rate(self, p: Values) -> float:
        """Factor on the rate at which the air rotates with the planet."""
        return 1.0

    def wind(self, p: Values, altitude: Array) -> Array:
        """Added velocity of the air.

        Parameters
        ----------
        p : mapping
            Parameter → value.
        altitude : (N,) array
            Areodetic, m.

        Returns
        -------
        (N, 2) array
            Towards east and north, m/s.
        """
        return np.zeros((len(altitude), 2))

    def density(self, p: Values, altitude: Array) -> Array:
        """Factor on the density.

        Parameters
        ----------
        p : mapping
            Parameter → value.
        altitude : (N,) array
            Areodetic, m.

        Returns
        -------
        (N,) array
        """
        return np.ones(len(altitude))

    def coefficients(self, p: Values, flow: FlightCondition, totals: AeroCoefficients) -> AeroCoefficients:
        """Total coefficients with the effect, where they are `totals` without it."""
        return totals

    def force_moment(self, p: Values, flow: FlightCondition) -> tuple[Array, Array]:
        """Added force (N) and moment about the centre of mass (N m), ``(N, 3)`` each, body axes."""
        return np.zeros((len(flow.time), 3)), np.zeros((len(flow.time), 3))

    def vehicle(self, p: Values, body: Body) -> Body:
        """The rigid body with the effect, where it is `body` without it."""
        return body

    def entry_state(self, p: Values, initial: InitialState) -> InitialState:
        """The true entry state where `initial` is the stated one."""
        return initial

    def acts(self, hook: str) -> bool:
        """Whether the effect overrides `hook`."""
        return getattr(type(self), hook) is not getattr(Effect, hook)

    @property
    def is_sensor_effect(self) -> bool:
        """Whether the effect is an error of an IMU: of its readings, or of its position."""
        return self._acts_by(SENSOR_HOOKS)

    @property
    def is_model_effect(self) -> bool:
        """Whether the effect is outside the IMUs: of vehicle, air, planet or entry state."""
        return self._acts_by(MODEL_HOOKS)

    @property
    def changes_air(self) -> bool:
        """Whether the effect changes the air that the vehicle meets."""
        return self._acts_by(AIR_HOOKS)

    @property
    def changes_readings(self) -> bool:
        """Whether the effect changes the motion at the centre of mass that readings stand for."""
        return self._acts_by(READING_HOOKS)

    @property
    def changes_path(self) -> bool:
        """Whether the effect changes the dead-reckoned path, or the readings along it."""
        return self._acts_by(PATH_HOOKS)

    def _acts_by(self, hooks: Sequence[str]) -> bool:
        return any(self.acts(hook) for hook in hooks)

    def problems(self, values: Values) -> Iterator[Problem]:
        """Yield a problem for each of `values` that names no parameter of the effect or is out of its bounds."""
        parameters = {q.name: q for q in self.parameters}
        for name, value in values.items():
            if name not in parameters:
                yield Problem(name, "an unknown key", f"a parameter of {self.name}; {nearest(name, parameters)}")
                continue
            q = parameters[name]
            if not q.low <= value <= q.high:  # NaN fails too
                yield Problem(name, f"{value:g}", bounds_text(q))

    def completed(self, values: Values) -> dict[str, float]:
        """All parameters by name: those of `values`, all others at their defaults; nothing is checked."""
        return {q.name: float(values.get(q.name, q.default)) for q in self.parameters}

    def checked(self, values: Values) -> dict[str, float]:
        """All parameters by name, as `completed`, of values that have no `problems`.

        Raises
        ------
        InputError
            The message begins with the parameter's name: there is no such parameter, or it is out of its bounds.
        """
        for problem in self.problems(values):
            raise InputError(f"{problem.parameter}: found {problem.actual}; expected {problem.expected}")
        return self.completed(values)

    def at(self, **values: float) -> EffectInstance:
        """The effect switched on: a parameter that is not named takes its default, which is zero for sizes.

        Raises
        ------
        InputError
            There is no such parameter, or it is out of its bounds.
        """
        return EffectInstance(self, self.checked(values))

    def __repr__(self) -> str:
        return f"<effect {self.name}: {self.summary}>"

    def _repr_html_(self) -> str:
        return str(render("html", self))

    @property
    def sizes(self) -> tuple[Parameter, ...]:
        """Parameters of kind ``size``: how large the effect is."""
        return tuple(q for q in self.parameters if q.kind == "size")

    @property
    def places(self) -> tuple[Parameter, ...]:
        """Parameters of all other kinds: where, when or at which length the effect acts."""
        return tuple(q for q in self.parameters if q.kind != "size")


@dataclass(frozen=True)
class EffectInstance:
    """An effect switched on.

    A model is a sequence of instances; each is identified by its `key`, the pair of the effect's name and the IMU.

    Attributes
    ----------
    effect : Effect
    values : dict
        Parameter → number; a parameter that is not named takes its default, which is zero for sizes.
    imu : str or None
        IMU of a sensor effect; None is the driving one.
    fixed : bool
        Held at its values instead of being refitted.
    """

    effect: Effect
    values: dict[str, float]
    imu: str | None = None
    fixed: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "values", self.effect.completed(self.values))

    def __repr__(self) -> str:
        """Label, and the parameters with their units to five digits."""
        parts = [f"{q.name} {self.values[q.name]:.5g} {q.unit}".rstrip() for q in self.effect.parameters]
        return f"<{self.label}: {', '.join(parts)}{'; fixed' if self.fixed else ''}>"

    @property
    def name(self) -> str:
        """Name of the effect."""
        return self.effect.name

    @property
    def key(self) -> EffectKey:
        """Name and IMU, which identify the instance in a model."""
        return self.name, self.imu

    @property
    def label(self) -> str:
        """The key as text, in messages and files: ``name``, or ``name in imu``."""
        return label_of(self.key)

    @property
    def fitted(self) -> tuple[Parameter, ...]:
        """Parameters to be estimated: sizes, and places where they are finite; none if it is fixed."""
        if self.fixed:
            return ()
        return tuple(q for q in self.effect.parameters if q.kind == "size" or np.isfinite(self.values[q.name]))

    def at_zero(self) -> EffectInstance:
        """The same instance with all sizes zero, so that it changes nothing; its places stay."""
        return replace(self, values=self.values | {q.name: 0.0 for q in self.effect.sizes})

    @property
    def is_zero(self) -> bool:
        """Whether it has sizes and all of them are zero, so that it changes nothing."""
        sizes = self.effect.sizes
        return bool(sizes) and not any(self.values[q.name] for q in sizes)

    def within_bounds(self) -> EffectInstance:
        """The same effect, each value limited to its bounds; a phase has none."""
        limited = {q.name: float(np.clip(self.values[q.name], q.low, q.high)) for q in self.effect.parameters}
        return replace(self, values=limited | {q.name: self.values[q.name] for q in self._phases})

    def canonical_phase(self) -> EffectInstance:
        """The same effect in canonical form: an amplitude that is not negative, phases between their bounds."""
        signed = self.effect.half_turn
        flips = bool(signed) and self.values[signed[0]] < 0.0
        sizes = {name: -self.values[name] for name in signed} if flips else {}
        phases = {}
        for q in self._phases:
            turn = q.high - q.low
            phases[q.name] = q.low + (self.values[q.name] + (0.5 * turn if flips else 0.0) - q.low) % turn
        return replace(self, values=self.values | sizes | phases)

    def change_from(self, values: Mapping[str, float], parameter: str) -> float:
        """Difference of a parameter from its value in `values`, modulo whole turns of a phase."""
        change = abs(self.values[parameter] - values[parameter])
        for q in self._phases:
            if q.name == parameter:
                change = min(change % (q.high - q.low), -change % (q.high - q.low))
        return change

    @property
    def _phases(self) -> tuple[Parameter, ...]:
        return tuple(q for q in self.effect.parameters if q.kind == "phase" and np.isfinite(q.high - q.low))


def label_of(key: EffectKey) -> str:
    """The key of an effect as text: ``name``, or ``name in imu``."""
    name, imu = key
    return name if imu is None else f"{name} in {imu}"


def key_of(label: str) -> EffectKey:
    """The key of an effect from its label: inverse of `label_of`."""
    name, _, imu = label.partition(" in ")
    return name, imu or None


def model_effects(effects: Iterable[EffectInstance]) -> tuple[EffectInstance, ...]:
    """Those of `effects` on which a forward model depends: all but errors of an IMU."""
    return tuple(a for a in effects if a.effect.is_model_effect)


def effect_with_key(effects: Iterable[EffectInstance], key: EffectKey) -> EffectInstance:
    """The instance that a key identifies in a model."""
    return next(a for a in effects if a.key == key)
