"""Integration of a flight from entry to rest: phases, events, and iteration of the increments of effects."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from edl_filter import rotations
from edl_filter.effects.forward_model import ForwardModel
from edl_filter.errors import InputError
from edl_filter.simulation.dynamics import DESCENT, ENTRY, REST, SIZE, STOP, march
from edl_filter.simulation.increments import NOTHING, Increments, change, with_middles
from edl_filter.simulation.parachute import Parachute
from edl_filter.simulation.tables import RigidBody, Tables, tabulate, tabulate_body
from edl_filter.types import Array

#: Length of a window, s: with effects that have increments, and without.
WINDOW, FREE_WINDOW = 1.0, 50.0
#: Number of iterations after which a window is halved.
MOST_ITERATIONS = 25


@dataclass(frozen=True)
class Course:
    """Events and durations of a flight.

    Attributes
    ----------
    interval : float
        The flight computer checks for events at each multiple of it, s.
    substeps : int
        Steps of the integration in one interval.
    deploy_pressure : float
        Dynamic pressure at which, falling, the parachute is deployed, Pa.
    surface_radius : float
        Radius of the surface at the landing site, m.
    stop, rest : float
        Time from touchdown to rest, and length of the record at rest, s: multiples of the interval.
    longest : float
        Limit of the time of flight, s.
    """

    interval: float
    substeps: int
    deploy_pressure: float
    surface_radius: float
    stop: float = 0.5
    rest: float = 19.5
    longest: float = 1500.0


@dataclass(frozen=True)
class Motion:
    """The true motion, at every step.

    Attributes
    ----------
    time : (N + 1,) array
        s.
    state : (N + 1, 25) array
        `edl_filter.simulation.dynamics`: of the centre of mass, at an event that moves it of the new one.
    before, after : (N, 25) arrays
        Derivative at the beginning and at the end of each step; they differ between two steps at an event.
    deployed, landed, stopped : float
        Times of the parachute's deployment, of the touchdown, and of rest, s.
    iterations : int
        Number of integrations of windows in the iteration of increments.
    """

    time: Array
    state: Array
    before: Array
    after: Array
    deployed: float
    landed: float
    stopped: float
    iterations: int = 0

    def at(self, time: Array) -> Array:
        """States at any times within the flight, by cubic Hermite interpolation, of order 4.

        Parameters
        ----------
        time : (K,) array
            s.

        Returns
        -------
        (K, 25) array
            As in `edl_filter.simulation.dynamics`.
        """
        i = np.clip(np.searchsorted(self.time, time, side="right") - 1, 0, len(self.time) - 2)
        h = (self.time[i + 1] - self.time[i])[:, None]
        u = (time - self.time[i])[:, None] / h
        a, b = self.state[i], self.state[i + 1]
        # differences from the first end, which do not lose digits of large positions
        rise = u * u * (3.0 - 2.0 * u)
        out = a + rise * (b - a) + h * u * (1.0 - u) * ((1.0 - u) * self.before[i] - u * self.after[i])
        out[:, 6:10] = rotations.normalise(out[:, 6:10])
        return out


def fly(forward_model: ForwardModel, parachute: Parachute, start: Array, course: Course) -> Motion:
    """Integrate a flight from time 0 to rest.

    Parameters
    ----------
    forward_model : ForwardModel
        With its effects. Times of its `changed_bodies` are multiples of the course's interval.
    parachute : Parachute
        Canopy that opens at deployment.
    start : (13,) array
        Inertial position (m) and velocity (m/s), inertial_from_body, body rates (rad/s).
    course : Course
        Events and durations.

    Returns
    -------
    Motion

    Raises
    ------
    InputError
        The vehicle never reaches the parachute's dynamic pressure, or the surface.
    """
    tables = tabulate(forward_model, parachute)
    flight = _Flight(tables, Increments.of(forward_model), course, start)
    flight.changes = [(t, tabulate_body(forward_model, body)) for t, body in forward_model.changed_bodies]
    deployed = flight.until(ENTRY, course.deploy_pressure, "the parachute's dynamic pressure, falling")
    chute = tables.parachute.copy()
    chute[3] = deployed
    flight.tables = tables._replace(parachute=chute)
    landed = flight.until(DESCENT, course.surface_radius, "the surface")
    flight.touch_down(landed, course.stop)
    flight.for_duration(STOP, course.stop)
    if flight.changes:
        raise InputError(
            f"simulation: an event changes the vehicle {flight.changes[0][0]:g} s after the start, but it lands at "
            f"{landed:g} s; expected a time before."
        )
    stopped = flight.time
    flight.for_duration(REST, course.rest)
    return flight.motion(deployed, landed, stopped)


class _Flight:
    """A flight up to the time that the integration has reached."""

    def __init__(self, tables: Tables, increments: Increments, course: Course, start: Array) -> None:
        self.tables, self.increments, self.course = tables, increments, course
        self.state = np.zeros(SIZE)
        self.state[:13] = start
        self.step = course.interval / course.substeps
        self.taken = 0
        self.iterations = 0
        self.armed = False
        self.stop = np.zeros(7)
        self.parts: list[tuple[Array, Array]] = []
        self.last = np.zeros((1, NOTHING.shape[1]))
        self.changes: list[tuple[float, RigidBody]] = []

    @property
    def time(self) -> float:
        """Time that the integration has reached, s."""
        # from whole intervals: a sum of steps would accumulate rounding errors
        return self.taken / self.course.substeps * self.course.interval

    def until(self, phase: int, limit: float, goal: str) -> float:
        """Integrate until the event of the phase and return its time, s."""
        event = False
        while not event:
            if self.time > self.course.longest:
                raise InputError(
                    f"simulation: after {self.time:.0f} s the vehicle has not reached {goal}; expected an entry "
                    "that comes down (look at speed, flight path angle, deployment pressure and surface radius)."
                )
            steps = self._steps(WINDOW if self.increments.needed else FREE_WINDOW)
            if self.changes:
                remaining = round((self.changes[0][0] - self.time) / self.course.interval) * self.course.substeps
                steps = min(steps, remaining)
            event = self._window(phase, limit, steps)
            if self.changes and self.time >= self.changes[0][0] - 0.5 * self.step:
                self._change_body(self.changes.pop(0)[1])
        return self.time

    def _change_body(self, body: RigidBody) -> None:
        """The body that an event leaves: the state becomes that of its centre of mass, at the same motion.

        A part that leaves does so without relative velocity: it takes its momentum with it, and rate and velocity of
        every point of the structure are continuous. The centre of mass is another of these points, d from the one
        before: its position changes by d and its velocity by w × d.
        """
        shift, s = body.offset - self.tables.vehicle[4:7], self.state
        s[:3] += rotations.rotate(s[6:10], shift)
        s[3:6] += rotations.rotate(s[6:10], np.cross(s[10:13], shift))
        vehicle = self.tables.vehicle.copy()
        vehicle[0], vehicle[4:7] = body.mass, body.offset
        self.tables = self.tables._replace(vehicle=vehicle, inertia=body.inertia, inverse=body.inverse)

    def for_duration(self, phase: int, length: float) -> None:
        """Integrate for a time, s."""
        if length > 0.0:
            self._append(*self._march(phase, 0.0, round(length / self.step), NOTHING)[:2], flying=False)

    def touch_down(self, time: float, length: float) -> None:
        """Set the velocity and the rate that fall to zero from touchdown (`time`, s) within `length`, s."""
        s, ground = self.state, self.tables.planet[5]
        velocity = s[3:6] - np.cross([0.0, 0.0, ground], s[:3])
        rate = s[10:13] - rotations.rotate(rotations.conjugate(s[6:10]), [0.0, 0.0, ground])
        self.stop = np.concatenate(([time], -velocity / length, -rate / length))

    def motion(self, deployed: float, landed: float, stopped: float) -> Motion:
        """The whole motion, all windows joined."""
        states = np.concatenate([state[:-1] for state, _ in self.parts] + [self.parts[-1][0][-1:]])
        before = np.concatenate([slope[:-1] for _, slope in self.parts])
        after = np.concatenate([slope[1:] for _, slope in self.parts])
        time = np.arange(len(states)) / self.course.substeps * self.course.interval
        return Motion(time, states, before, after, deployed, landed, stopped, self.iterations)

    def _steps(self, length: float) -> int:
        """Number of steps in the whole intervals nearest to `length`, s."""
        return max(1, round(length / self.course.interval)) * self.course.substeps

    def _march(self, phase: int, limit: float, steps: int, increments: Array) -> tuple[Array, Array, bool, bool]:
        """States and derivatives of a number of steps, whether they end with the event, and whether it is armed."""
        state, slope = np.empty((steps + 1, SIZE)), np.empty((steps + 1, SIZE))
        state[0] = self.state
        done, event, armed = march(
            self.time, self.step, state, slope, phase, self.tables, self.stop, increments, self.course.substeps, limit,
            self.armed,
        )  # fmt: skip
        return state[: done + 1], slope[: done + 1], event, armed

    def _window(self, phase: int, limit: float, steps: int) -> bool:
        """Integrate one window with the increments of the effects; whether it ended with the event."""
        if not self.increments.needed:
            state, slope, event, self.armed = self._march(phase, limit, steps, NOTHING)
            self._append(state, slope)
            return event
        used = np.repeat(self.last, 2 * steps + 1, axis=0)
        for _ in range(MOST_ITERATIONS):
            state, slope, event, armed = self._march(phase, limit, steps, used)
            self.iterations += 1
            if not np.all(np.isfinite(state[-1])):  # the assumed increments have too large an error
                return self._halved(phase, limit, steps, state)
            middles = with_middles(self.step, state, slope)
            time = self.time + 0.5 * self.step * np.arange(len(middles), dtype=float)
            evaluated = self.increments.at(time, middles)
            count = len(evaluated)
            converged = change(used[:count], evaluated) <= 1.0
            used[:count], used[count:] = evaluated, evaluated[-1]
            if converged:
                break
        else:
            if steps > self.course.substeps:
                return self._halved(phase, limit, steps, state)
            # a hook that is discontinuous in the state: the time of the discontinuity is then resolved to one step
        self.armed, self.last = armed, used[count - 1 : count]
        self._append(state, slope)
        return event

    def _halved(self, phase: int, limit: float, steps: int, state: Array) -> bool:
        """Integrate the window again with half its length."""
        if steps <= self.course.substeps:
            self._append(state, state)  # raises the error
        return self._window(phase, limit, self._steps(0.5 * steps * self.step))

    def _append(self, state: Array, slope: Array, flying: bool = True) -> None:
        """Append a window; in the air the vehicle must fly nose first."""
        each = self.course.substeps
        wrong = ~np.all(np.isfinite(state[::each]), axis=1)
        if not wrong.any() and flying:
            time = self.time + self.step * np.arange(0, len(state), each, dtype=float)
            flow = self.increments.forward_model.flow(time, *np.split(state[::each, :13], [3, 6, 10], axis=1))
            wrong = flow.velocity_body[:, 0] < 0.0
        if wrong.any():
            when = self.time + self.course.interval * int(np.argmax(wrong))
            raise InputError(
                f"simulation: the vehicle tumbles {when:.0f} s after the start, and no database holds then; "
                "expected effects and entry conditions with which it flies nose first."
            )
        self.parts.append((state, slope))
        self.taken += len(state) - 1
        self.state = state[-1].copy()
