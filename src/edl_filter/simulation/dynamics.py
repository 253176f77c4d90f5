"""Equations of motion of an entry vehicle and a fixed-step Runge-Kutta method of order 4, compiled.

The state has 25 elements: inertial position (0:3, m) and velocity (3:6, m/s), inertial_from_body (6:10, scalar last),
body rates (10:13, rad/s), and the time integrals, since the start, of what instruments measure: specific force at the
centre of mass (13:16, m/s, body axes), rates (16:19, rad), and products of rates (19:25: xx, yy, zz, xy, xz, yz;
rad²/s).

Equations
---------
- ``r' = v``, ``v' = g(r) + R f``; gravity with J2 (Vallado 2013, eq. 8-30; `edl_filter.planet.gravity`).
- ``q' = q ⊗ (w, 0) / 2`` (Shuster 1993, eq. 305), ``I w' = M - w × I w`` (Euler).
- Aerodynamic force ``q S (-CA, CY, -CN)``, total coefficients split by the lateral flow, moments moved from the nose to
  the centre of mass, damping ``Cmq (rate D / 2V) q S D`` (`edl_filter.effects.forward_model`).
- Parachute: drag along the air-relative velocity at the attachment, which therefore damps the oscillation too.
- Touchdown: velocity relative to the ground, and rate relative to the planet's, fall linearly to zero; then rest.
"""

import numpy as np
from numba import njit

from edl_filter.aero.database import INDEX_MACH
from edl_filter.planet.gravity import gravity
from edl_filter.rotation_kernels import direction_cosines

#: Number of elements of a state.
SIZE = 25
#: Phases of a flight.
ENTRY, DESCENT, STOP, REST = 0, 1, 2, 3
#: Number of columns of the increments: CA, CN, Cm about the nose, Cl, Cmq; their slopes over the angle (1/rad); force
#: (N) and moment (N m); and the angle at which the coefficients were evaluated (rad).
INCREMENTS = 17


@njit(cache=True, error_model="numpy")
def bracket(nodes, x):
    """Place of a value between nodes; held at the edges.

    Parameters
    ----------
    nodes : (K,) array
        Increasing, in the unit of `x`.
    x : float
        The value.

    Returns
    -------
    index : int
        Of the node below `x`.
    fraction : float
        Of the step from that node to the next.
    """
    last = nodes.size - 1
    if last == 0 or x <= nodes[0]:
        return 0, 0.0
    if x >= nodes[last]:
        return last - 1, 1.0
    low, high = 0, last
    while high - low > 1:
        middle = (low + high) // 2
        if nodes[middle] <= x:
            low = middle
        else:
            high = middle
    return low, (x - nodes[low]) / (nodes[low + 1] - nodes[low])


@njit(cache=True, error_model="numpy")
def bilinear(rows, columns, values, x, y, k):
    """Bilinear interpolation of a table, held at the edges.

    Parameters
    ----------
    rows, columns : (R,) and (C,) arrays
        Increasing nodes, in the units of `x` and `y`.
    values : (R, C, K) array
        K quantities.
    x, y : float
        Place along rows and along columns.
    k : int
        Index of the quantity.

    Returns
    -------
    float
        In the unit of the quantity.
    """
    i, u = bracket(rows, x)
    j, v = bracket(columns, y)
    below = values[i, j, k] + v * (values[i, j + 1, k] - values[i, j, k])
    if u == 0.0:
        return below
    above = values[i + 1, j, k] + v * (values[i + 1, j + 1, k] - values[i + 1, j, k])
    return below + u * (above - below)


@njit(cache=True, error_model="numpy")
def linear(nodes, values, x):
    """Linear interpolation, held at the edges.

    Parameters
    ----------
    nodes, values : (K,) arrays
        Increasing nodes in the unit of `x`, and the values at them.
    x : float
        Place of the result.

    Returns
    -------
    float
        In the unit of the values.
    """
    i, u = bracket(nodes, x)
    if u == 0.0:
        return values[i]
    return values[i] + u * (values[i + 1] - values[i])


@njit(cache=True, error_model="numpy")
def locate(x, y, z, radius, flattening):
    """Areodetic altitude and latitude.

    Bowring's iteration, as in `edl_filter.planet.ellipsoid`; after three steps the error is 1e-9 m for a Mars-like
    planet.

    Parameters
    ----------
    x, y, z : float
        Position, m; z along the axis of rotation.
    radius : float
        Equatorial, m.
    flattening : float
        Of the ellipsoid.

    Returns
    -------
    altitude : float
        m.
    sine, cosine : float
        Of the areodetic latitude.
    """
    b = radius * (1.0 - flattening)
    p = np.sqrt(x * x + y * y)
    e2 = flattening * (2.0 - flattening)
    s, c = radius * z, b * p
    nz, np_ = z, p
    for _ in range(3):
        norm = np.sqrt(s * s + c * c)
        s, c = s / norm, c / norm
        nz = z + e2 * radius * radius / b * s * s * s
        np_ = p - e2 * radius * c * c * c
        s, c = (1.0 - flattening) * nz, np_
    norm = np.sqrt(nz * nz + np_ * np_)
    sine, cosine = nz / norm, np_ / norm
    norm = np.sqrt(s * s + c * c)
    s, c = s / norm, c / norm
    return (p - radius * c) * cosine + (z - b * s) * sine, sine, cosine


@njit(cache=True, error_model="numpy")
def air_at(t, altitude):
    """Air at an altitude.

    Parameters
    ----------
    t : Tables
        With the table of the air ``(N, 4)``.
    altitude : float
        m.

    Returns
    -------
    density, sound : float
        Density (kg/m³) and speed of sound (m/s).
    east, north : float
        Wind towards east and north, m/s.
    """
    x = (altitude - t.air_start) / t.air_step
    last = t.air.shape[0] - 2
    i = min(max(int(np.floor(x)), 0), last)
    u = x - i
    w = min(max(u, 0.0), 1.0)
    a, b = t.air[i], t.air[i + 1]
    density = np.exp(a[0] + u * (b[0] - a[0]))
    sound = np.sqrt(a[1] + w * (b[1] - a[1]))
    return density, sound, a[2] + w * (b[2] - a[2]), a[3] + w * (b[3] - a[3])


@njit(cache=True, error_model="numpy")
def coefficients(t, mach, speed, knudsen, alpha):
    """CA, CN and Cm about the nose, in the plane of the total angle.

    Parameters
    ----------
    t : Tables
        With the tables of coefficients, ``(M, A, 3)`` and ``(K, B, 3)``.
    mach, knudsen : float
        Of the flow.
    speed : float
        Air-relative, m/s; used where the table is entered by speed.
    alpha : float
        Total angle of attack, rad.

    Returns
    -------
    ca, cn, cm : float
    """
    index = mach
    if t.vehicle[9] > 0.0:  # the hypersonic part is entered by speed (edl_filter.aero.database)
        low, high = INDEX_MACH
        index = mach + min(max((mach - low) / (high - low), 0.0), 1.0) * (speed / t.vehicle[9] - mach)
    ca = bilinear(t.mach, t.alpha, t.continuum, index, alpha, 0)
    cn = bilinear(t.mach, t.alpha, t.continuum, index, alpha, 1)
    cm = bilinear(t.mach, t.alpha, t.continuum, index, alpha, 2)
    if knudsen > t.vehicle[8]:
        x = np.log10(knudsen)
        weight = 1.0 - linear(t.log_knudsen, t.share, x)
        ca = weight * ca + bilinear(t.log_knudsen, t.thin_alpha, t.thin, x, alpha, 0)
        cn = weight * cn + bilinear(t.log_knudsen, t.thin_alpha, t.thin, x, alpha, 1)
        cm = weight * cm + bilinear(t.log_knudsen, t.thin_alpha, t.thin, x, alpha, 2)
    return ca, cn, cm


@njit(cache=True, error_model="numpy")
def derivative(time, s, d, phase, t, stop, more):
    """Time derivative of the state.

    Parameters
    ----------
    time : float
        s.
    s, d : (25,) arrays
        State; array that is filled with its derivative.
    phase : int
        `ENTRY`, `DESCENT`, `STOP` or `REST`.
    t : Tables
        The forward model.
    stop : (7,) array
        Touchdown: time (s), derivative of the velocity relative to the ground (3, m/s², inertial axes at that time) and
        of the rate relative to the planet's (3, rad/s², body axes). Used while the vehicle stops.
    more : (17,) array
        Increments (`INCREMENTS`).

    Returns
    -------
    float
        Dynamic pressure, Pa; zero on the ground.
    """
    x, y, z = s[0], s[1], s[2]
    qx, qy, qz, qw = s[6], s[7], s[8], s[9]
    wx, wy, wz = s[10], s[11], s[12]
    # inertial_from_body as a matrix
    m00, m01, m02, m10, m11, m12, m20, m21, m22 = direction_cosines(qx, qy, qz, qw)
    gx, gy, gz = gravity(x, y, z, t.planet[0], t.planet[1], t.planet[2])
    pressure = 0.0
    if phase >= STOP:
        ground = t.planet[5]
        # velocity relative to the ground, its derivative, and the acceleration of the rotating frame
        ux, uy = s[3] + ground * y, s[4] - ground * x
        bx, by, bz, tx, ty, tz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        if phase == STOP:
            angle = ground * (time - stop[0])
            sine, cosine = np.sin(angle), np.cos(angle)
            bx, by, bz = cosine * stop[1] - sine * stop[2], sine * stop[1] + cosine * stop[2], stop[3]
            tx, ty, tz = stop[4], stop[5], stop[6]
        ax = bx - 2.0 * ground * uy - ground * ground * x
        ay = by + 2.0 * ground * ux - ground * ground * y
        az = bz
        d[3], d[4], d[5] = ax, ay, az
        ax, ay, az = ax - gx, ay - gy, az - gz
        fx = m00 * ax + m10 * ay + m20 * az
        fy = m01 * ax + m11 * ay + m21 * az
        fz = m02 * ax + m12 * ay + m22 * az
        # derivative of the planet's rate in body axes
        ox, oy, oz = m20 * ground, m21 * ground, m22 * ground
        d[10] = tx - (wy * oz - wz * oy)
        d[11] = ty - (wz * ox - wx * oz)
        d[12] = tz - (wx * oy - wy * ox)
    else:
        altitude, sine, cosine = locate(x, y, z, t.planet[3], t.planet[4])
        density, sound, east, north = air_at(t, altitude)
        p = np.sqrt(x * x + y * y)
        cl, sl = x / p, y / p
        ax = s[3] + t.planet[6] * y + sl * east + sine * cl * north
        ay = s[4] - t.planet[6] * x - cl * east + sine * sl * north
        az = s[5] - cosine * north
        u = m00 * ax + m10 * ay + m20 * az
        v = m01 * ax + m11 * ay + m21 * az
        w = m02 * ax + m12 * ay + m22 * az
        lateral = np.sqrt(v * v + w * w)
        speed = np.sqrt(u * u + lateral * lateral)
        mach = speed / sound
        pressure = 0.5 * density * speed * speed
        alpha = np.arctan2(lateral, u)
        ca, cn, cm = coefficients(t, mach, speed, t.vehicle[7] / density, alpha)
        off = alpha - more[16]
        ca += more[0] + more[5] * off
        cn += more[1] + more[6] * off
        cm += more[2] + more[7] * off
        roll = more[3] + more[8] * off
        damping = linear(t.damping_mach, t.damping, mach) + more[4] + more[9] * off
        mass, size, area, back = t.vehicle[0], t.vehicle[1], t.vehicle[2], t.vehicle[3]
        damping *= 0.5 * size / max(speed, 1.0)
        sine, cosine = 0.0, 1.0
        if lateral > 0.0:
            sine, cosine = v / lateral, w / lateral
        cm += back * cn
        push = pressure * area
        fx, fy, fz = -push * ca, -push * cn * sine, -push * cn * cosine
        mx = push * size * roll
        my = push * size * (cm * cosine + damping * wy)
        mz = push * size * (-cm * sine + damping * wz)
        ox, oy, oz = t.vehicle[4], t.vehicle[5], t.vehicle[6]
        mx -= oy * fz - oz * fy
        my -= oz * fx - ox * fz
        mz -= ox * fy - oy * fx
        if phase == DESCENT:
            ex, ey, ez = -t.parachute[1] - ox, -oy, -oz
            pu = u + wy * ez - wz * ey
            pv = v + wz * ex - wx * ez
            pw = w + wx * ey - wy * ex
            ps = np.sqrt(pu * pu + pv * pv + pw * pw)
            drag = linear(t.parachute_mach, t.parachute_drag, ps / sound) * t.parachute[0]
            drag *= 0.5 * density * ps * min(max((time - t.parachute[3]) / t.parachute[2], 0.0), 1.0)
            px, py, pz = -drag * pu, -drag * pv, -drag * pw
            fx, fy, fz = fx + px, fy + py, fz + pz
            mx += ey * pz - ez * py
            my += ez * px - ex * pz
            mz += ex * py - ey * px
        fx, fy, fz = (fx + more[10]) / mass, (fy + more[11]) / mass, (fz + more[12]) / mass
        d[3] = gx + m00 * fx + m01 * fy + m02 * fz
        d[4] = gy + m10 * fx + m11 * fy + m12 * fz
        d[5] = gz + m20 * fx + m21 * fy + m22 * fz
        i = t.inertia
        hx = i[0, 0] * wx + i[0, 1] * wy + i[0, 2] * wz
        hy = i[1, 0] * wx + i[1, 1] * wy + i[1, 2] * wz
        hz = i[2, 0] * wx + i[2, 1] * wy + i[2, 2] * wz
        mx += more[13] - (wy * hz - wz * hy)
        my += more[14] - (wz * hx - wx * hz)
        mz += more[15] - (wx * hy - wy * hx)
        i = t.inverse
        d[10] = i[0, 0] * mx + i[0, 1] * my + i[0, 2] * mz
        d[11] = i[1, 0] * mx + i[1, 1] * my + i[1, 2] * mz
        d[12] = i[2, 0] * mx + i[2, 1] * my + i[2, 2] * mz
    d[0], d[1], d[2] = s[3], s[4], s[5]
    d[6] = 0.5 * (qw * wx + qy * wz - qz * wy)
    d[7] = 0.5 * (qw * wy - qx * wz + qz * wx)
    d[8] = 0.5 * (qw * wz + qx * wy - qy * wx)
    d[9] = -0.5 * (qx * wx + qy * wy + qz * wz)
    d[13], d[14], d[15] = fx, fy, fz
    d[16], d[17], d[18] = wx, wy, wz
    d[19], d[20], d[21] = wx * wx, wy * wy, wz * wz
    d[22], d[23], d[24] = wx * wy, wx * wz, wy * wz
    return pressure


@njit(cache=True, error_model="numpy")
def march(start, step, state, slope, phase, t, stop, more, every, limit, armed):
    """Integrate with fixed steps until an event or the end of the arrays.

    Parameters
    ----------
    start, step : float
        Time of the first state and length of a step, s.
    state, slope : (n + 1, 25) arrays
        Row 0 of `state` is the start; states, and their derivatives within this phase, are filled in.
    phase, t, stop
        As in `derivative`.
    more : (2 n + 1, 17) array
        Increments at the steps' beginnings, middles and ends; one row if there are none.
    every : int
        Number of steps from one check for the event to the next, counted from the first.
    limit : float
        Entry: dynamic pressure (Pa) at which, falling, the parachute is deployed. Descent: radius (m) of the surface.
    armed : bool
        Whether the dynamic pressure has been above the limit.

    Returns
    -------
    done : int
        Number of steps.
    event : bool
        Whether the last one ended with the event.
    armed : bool
        As above, at the end.
    """
    n = state.shape[0] - 1
    none = more.shape[0] == 1
    k2, k3, k4, y = np.empty(SIZE), np.empty(SIZE), np.empty(SIZE), np.empty(SIZE)
    half = 0.5 * step
    for i in range(n + 1):
        time = start + i * step
        a = 0 if none else 2 * i
        k1 = slope[i]
        pressure = derivative(time, state[i], k1, phase, t, stop, more[a])
        armed = armed or pressure > limit
        if i > 0 and i % every == 0:
            if phase == ENTRY and armed and pressure <= limit:
                return i, True, armed
            if phase == DESCENT:
                s = state[i]
                if s[0] * s[0] + s[1] * s[1] + s[2] * s[2] <= limit * limit:
                    return i, True, armed
        if i == n:
            break
        b, c = (0, 0) if none else (2 * i + 1, 2 * i + 2)
        for k in range(SIZE):
            y[k] = state[i, k] + half * k1[k]
        derivative(time + half, y, k2, phase, t, stop, more[b])
        for k in range(SIZE):
            y[k] = state[i, k] + half * k2[k]
        derivative(time + half, y, k3, phase, t, stop, more[b])
        for k in range(SIZE):
            y[k] = state[i, k] + step * k3[k]
        derivative(time + step, y, k4, phase, t, stop, more[c])
        for k in range(SIZE):
            state[i + 1, k] = state[i, k] + step / 6.0 * (k1[k] + 2.0 * (k2[k] + k3[k]) + k4[k])
        q = state[i + 1, 6:10]
        norm = np.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
        for k in range(6, 10):
            state[i + 1, k] /= norm
    return n, False, armed
