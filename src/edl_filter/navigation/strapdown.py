"""Strapdown propagation of all sigma points over all samples of an interval, in one call.

Leapfrog in position and velocity (drift half a step, kick by gravity and specific force at mid-step,
drift the other half: symplectic, second order, one gravity a step) and an exact rotation for a constant
rate in attitude. The samples are effective means over their intervals, as `increments.effective_samples`
gives them; with those the step has the accuracy of the classical two-sample coning and sculling
algorithms (Savage, J. Guidance 21, 1998).

Layout: structure of arrays, samples in the outer loop and sigma points in the inner one. The rows of
a block of `LANES` sigma points are adjacent in one flat array, so that every distance is a constant
at compile time: the compiler needs no aliasing checks and runs the inner loop in vector registers. There is no
branch and no allocation in the loops.

`FAST` has no reassociation. A kernel is optimised by itself and again within a kernel that calls it; each optimisation
may associate sums anew, and which of the two codes a process executes depends on whether it compiles or reads the
cache. Contraction (fused multiply-add) and reciprocals do not depend on this, so that the run that compiles has the
same bits as all later ones. The loops are put in line into `propagate`.
"""

import numpy as np
from numba import njit

from edl_filter.rotation_kernels import product

LANES = 16  # sigma points in a block; their number is padded to a multiple of this
FAST = {"contract", "arcp", "nsz"}
ROWS = 28  # of a block: 10 of the state, 12 of the force map, 6 of the rate map


def padded(count: int) -> int:
    """`count` rounded up to a multiple of `LANES`."""
    return -(-count // LANES) * LANES


@njit(cache=True, fastmath=FAST, error_model="numpy")
def propagate(state, force_map, rate_map, interval, force, rate, mu, j2, radius):
    """Propagate every sigma point over every sample, in place.

    Parameters
    ----------
    state : (10, S) array, changed in place
        Inertial position (m) and velocity (m/s), and inertial_from_body (scalar last); a column is a
        sigma point, S a multiple of `LANES`.
    force_map : (12, S) array
        Corrects the accelerometers' errors: true = A measured + c; A row by row (9), then c (3), m/s².
    rate_map : (6, S) array
        Corrects the gyros' errors: true = a ∘ measured + c; a (3), then c (3), rad/s.
    interval : (N,) array
        s.
    force, rate : (N, 3) arrays
        Effective specific force (m/s², at the centre of mass) and rate (rad/s), body axes. The rotation
        over a sample is exact to 1e-12 up to 1 rad.
    mu, j2, radius : float
        Gravity: m³/s², second zonal harmonic, and its reference radius, m (thesis eq. 3.5).
    """
    blocks = state.shape[1] // LANES
    work = np.empty(blocks * ROWS * LANES)
    for b in range(blocks):
        for lane in range(LANES):
            s = b * LANES + lane
            o = b * ROWS * LANES + lane
            for k in range(10):
                work[o + k * LANES] = state[k, s]
            for k in range(12):
                work[o + (10 + k) * LANES] = force_map[k, s]
            for k in range(6):
                work[o + (22 + k) * LANES] = rate_map[k, s]
    _propagate_blocks(work, blocks, interval, force, rate, mu, j2, radius)
    for b in range(blocks):
        for lane in range(LANES):
            o = b * ROWS * LANES + lane
            for k in range(10):
                state[k, b * LANES + lane] = work[o + k * LANES]


@njit(cache=True, fastmath=FAST, error_model="numpy", inline="always")
def _propagate_blocks(work, blocks, interval, force, rate, mu, j2, radius):
    """Propagate all blocks: loops over samples, blocks and lanes, from the outside in."""
    j = 1.5 * j2 * radius * radius
    for i in range(interval.size):
        dt = interval[i]
        fx, fy, fz = force[i, 0], force[i, 1], force[i, 2]
        wx, wy, wz = rate[i, 0], rate[i, 1], rate[i, 2]
        for b in range(blocks):
            for lane in range(LANES):
                o = b * ROWS * LANES + lane
                ax = work[o + 22 * LANES] * wx + work[o + 25 * LANES]
                ay = work[o + 23 * LANES] * wy + work[o + 26 * LANES]
                az = work[o + 24 * LANES] * wz + work[o + 27 * LANES]
                bx = work[o + 10 * LANES] * fx + work[o + 11 * LANES] * fy + work[o + 12 * LANES] * fz
                bx += work[o + 19 * LANES]
                by = work[o + 13 * LANES] * fx + work[o + 14 * LANES] * fy + work[o + 15 * LANES] * fz
                by += work[o + 20 * LANES]
                bz = work[o + 16 * LANES] * fx + work[o + 17 * LANES] * fy + work[o + 18 * LANES] * fz
                bz += work[o + 21 * LANES]
                x, y, z, vx, vy, vz, qx, qy, qz, qw = step(
                    work[o], work[o + LANES], work[o + 2 * LANES],
                    work[o + 3 * LANES], work[o + 4 * LANES], work[o + 5 * LANES],
                    work[o + 6 * LANES], work[o + 7 * LANES], work[o + 8 * LANES], work[o + 9 * LANES],
                    dt, bx, by, bz, ax, ay, az, mu, j,
                )  # fmt: skip
                work[o], work[o + LANES], work[o + 2 * LANES] = x, y, z
                work[o + 3 * LANES], work[o + 4 * LANES], work[o + 5 * LANES] = vx, vy, vz
                work[o + 6 * LANES], work[o + 7 * LANES] = qx, qy
                work[o + 8 * LANES], work[o + 9 * LANES] = qz, qw


@njit(cache=True, fastmath=FAST, error_model="numpy", inline="always")
def step(x, y, z, vx, vy, vz, qx, qy, qz, qw, dt, fx, fy, fz, wx, wy, wz, mu, j):
    """One state over one sample.

    Parameters
    ----------
    x, y, z, vx, vy, vz : float
        Position (m) and velocity (m/s), inertial axes.
    qx, qy, qz, qw : float
        inertial_from_body.
    dt : float
        s.
    fx, fy, fz, wx, wy, wz : float
        Specific force (m/s²) and rate (rad/s), body axes.
    mu : float
        Gravitational parameter, m³/s².
    j : float
        3/2 J2 times the squared reference radius, m².

    Returns
    -------
    tuple of ten floats
        Position, velocity and attitude at the end of the sample.
    """
    # half the rotation of this sample as a quaternion; with the sine and cosine of `rotation_kernels.quaternion`, which
    # are no vector instructions, `propagate` takes 2.1 times and Spirit's filter 1.1 times as long
    c = 0.25 * dt
    ax, ay, az = c * wx, c * wy, c * wz
    u = ax * ax + ay * ay + az * az
    hw = 1.0 - u / 2.0 * (1.0 - u / 12.0 * (1.0 - u / 30.0 * (1.0 - u / 56.0)))
    sc = 1.0 - u / 6.0 * (1.0 - u / 20.0 * (1.0 - u / 42.0 * (1.0 - u / 72.0)))
    hx, hy, hz = sc * ax, sc * ay, sc * az
    mx, my, mz, mw = product((qx, qy, qz, qw), (hx, hy, hz, hw))
    hh = 2.0 * hw  # the same half turn again: q(2t) = 2 cos(t) q(t) - q(0)
    ex = hh * mx - qx
    ey = hh * my - qy
    ez = hh * mz - qz
    ew = hh * mw - qw
    n = 1.5 - 0.5 * (ex * ex + ey * ey + ez * ez + ew * ew)  # one Newton step towards unit norm
    # specific force, turned by the attitude at mid-step
    tx = 2.0 * (my * fz - mz * fy)
    ty = 2.0 * (mz * fx - mx * fz)
    tz = 2.0 * (mx * fy - my * fx)
    gx = fx + mw * tx + my * tz - mz * ty
    gy = fy + mw * ty + mz * tx - mx * tz
    gz = fz + mw * tz + mx * ty - my * tx
    # drift, kick, drift
    half = 0.5 * dt
    x, y, z = x + half * vx, y + half * vy, z + half * vz
    r2 = 1.0 / (x * x + y * y + z * z)
    a = -mu * r2 * np.sqrt(r2)
    h = j * r2
    d = 5.0 * z * z * r2
    vx = vx + dt * (gx + a * x * (1.0 + h * (1.0 - d)))
    vy = vy + dt * (gy + a * y * (1.0 + h * (1.0 - d)))
    vz = vz + dt * (gz + a * z * (1.0 + h * (3.0 - d)))
    return x + half * vx, y + half * vy, z + half * vz, vx, vy, vz, n * ex, n * ey, n * ez, n * ew
