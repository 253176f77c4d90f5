"""Slow, readable twins of the simulator's kernel, and small worlds with closed solutions."""

from dataclasses import replace

import numpy as np
from scipy.integrate import solve_ivp

from edl_filter import rotations
from edl_filter.aero.damping import Damping
from edl_filter.aero.database import Database
from edl_filter.aero.grid import GridTable
from edl_filter.effects.forward_model import ForwardModel
from edl_filter.effects.types import Body
from edl_filter.planet import Planet
from edl_filter.planet.atmosphere import Atmosphere
from edl_filter.planet.gas import Gas

MARS = Planet("mars", 4.282837e13, 1.960454e-3, 3396190.0, 3396190.0, 5.886e-3, 7.088218e-5, 0.3)
INERTIA = np.array([[270.0, 1.5, -0.8], [1.5, 205.0, -0.6], [-0.8, -0.6, 210.0]])
START = np.array([
    3.43e6, 2e5, -3e5, -700.0, 3800.0, 900.0, 0.1, -0.2, 0.5, 0.83666002653407556, 0.2, 0.05, -0.03
])  # fmt: skip


def smooth_world(planet=MARS, density=1.5e-2, scale_height=11e3, ca=1.6, cn=0.4, cm=-0.2, inertia=INERTIA):
    """Isothermal air, CA constant, CN and Cm proportional to the angle: smooth wherever it flies nose first."""
    altitude = np.array([-10e3, 300e3])
    air = Atmosphere(altitude, np.log(density) - altitude / scale_height, np.full(2, 190.0), np.zeros((2, 2)), Gas())
    nodes, alpha = np.array([0.0, 1e3]), np.array([0.0, np.pi])
    ones, slope = np.ones((2, 2)), np.tile(alpha, (2, 1))
    table = GridTable("mach", nodes, alpha, ca * ones, cn * slope, cm * slope)
    thin = GridTable("knudsen", np.array([1e-3, 10.0]), alpha, ca * ones, cn * slope, cm * slope)
    database = Database(table, thin, join="switch")
    return ForwardModel(
        planet, air, Gas(), database, Damping(np.array([0.0, 1e3]), np.full(2, -0.3)), Body(832.0, inertia), 2.65, 0.27
    )


def empty(forward_model):
    """The world without its air."""
    return replace(forward_model, atmosphere=replace(forward_model.atmosphere, log_density=np.array([-600.0, -600.1])))


def turned_into(air_velocity, alpha, beta=0.0):
    """An attitude with given angles of attack and sideslip."""
    forward = air_velocity / np.linalg.norm(air_velocity)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    wind = rotations.from_matrix(np.column_stack((forward, right, np.cross(forward, right))))
    for turn in ([0.0, 0.0, -beta], [0.0, alpha, 0.0]):
        wind = rotations.multiply(wind, rotations.from_rotation_vector(turn))
    return rotations.normalise(wind)


def entering(forward_model, alpha=0.1, beta=0.05):
    """A state in the air, nose first, with small angles."""
    start = START.copy()
    start[6:10] = turned_into(forward_model.planet.velocity_relative(start[:3], start[3:6]), alpha, beta)
    return start


def parachute_force(forward_model, flow, chute, age):
    """Force and moment about the true centre of mass of a canopy `age` seconds after deployment, (3,) each."""
    arm = np.array([-chute.arm, 0.0, 0.0]) - forward_model.rigid_body.offset
    wind = flow.velocity_body[0] + np.cross(flow.rate[0], arm)
    speed = np.linalg.norm(wind)
    drag = np.interp(speed / (flow.speed[0] / flow.mach[0]), chute.mach, chute.drag_coefficient) * chute.area
    force = -0.5 * flow.density[0] * speed * wind * drag * np.clip(age / chute.inflation, 0.0, 1.0)
    return force, np.cross(arm, force)


def derivative(forward_model, time, state, chute=None, age=0.0):
    """Time derivative of position, velocity, attitude and rates, ``(13,)``, from `ForwardModel.loads`."""
    position, velocity, attitude, rate = state[:3], state[3:6], state[6:10], state[10:13]
    flow = forward_model.flow(np.array([time]), position[None], velocity[None], attitude[None], rate[None])
    force, moment = (x[0] for x in forward_model.loads(flow))
    if chute is not None:
        more = parachute_force(forward_model, flow, chute, age)
        force, moment = force + more[0], moment + more[1]
    body = forward_model.rigid_body
    return np.concatenate((
        velocity,
        forward_model.gravity_planet.gravity(position) + rotations.rotate(attitude, force / body.mass),
        0.5 * rotations.multiply(attitude, np.append(rate, 0.0)),
        np.linalg.solve(body.inertia, moment - np.cross(rate, body.inertia @ rate)),
    ))  # fmt: skip


def integrate(forward_model, start, time):
    """State at `time` by DOP853."""
    solution = solve_ivp(
        lambda t, y: derivative(forward_model, t, y), (0.0, time), start, "DOP853", rtol=1e-11, atol=1e-9
    )
    return solution.y[:, -1]
