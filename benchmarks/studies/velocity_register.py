"""When the rovers' computer added an increment to its velocity register: `make study-velocity-register` (a minute).

The table TRANSFORMED has the velocity that the computer accumulated from the rover's IMU in axes that do not rotate,
HIGHRATE the increments themselves. Both end at the clock count of their rows. The increments are summed here with the
attitude from the gyros of the same IMU; rotation, offset and scale of the register against the sum are fitted. Three
hypotheses are compared: the register contains all increments up to its row; it is one increment late; it is one
increment late, and an increment is rotated with the attitude of the cycle in which it is added.

With the last of them, and with the on-board quaternions as attitude, the axes of the register in J2000 and the
alignment error of the on-board transform (`MerImu.transformed_alignment`) are fitted together: a rotation, an offset, a
scale, and the shares of the axial force in the two lateral ones. The axes are compared with north, east and down at the
landing site that was aimed at, which nothing in the fit contains.

    python benchmarks/studies/velocity_register.py
"""

import numpy as np
from lost_seconds import ROVERS
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation, RotationSpline

from edl_filter import Mission
from edl_filter.io.csv_table import package_data
from edl_filter.pipeline.load import mer_setup
from edl_filter.telemetry.mer_archive import read_mer_tables
from edl_filter.telemetry.mer_compact import FILE_NAMES
from edl_filter.telemetry.mer_register import register_rows
from edl_filter.telemetry.mer_segments import (
    BODY_FROM_SPACECRAFT,
    MerSetup,
    highrate_segment,
    sample_end,
    usable_quaternions,
)

#: Hypothesis → whether the increment, and whether the attitude with which it is rotated, is that of the cycle before.
HYPOTHESES = {
    "up to its row": (False, False),
    "one increment late": (True, True),
    "late, attitude of its cycle": (True, False),
}
#: Spans before the parachute, in which one rotation is fitted; and in the bounces, in which steps are compared, s.
SMOOTH, BOUNCES = (92.0, 244.0), ((335.0, 340.0), (340.0, 345.0), (345.0, 350.0), (350.0, 355.0), (355.0, 360.0))

#: Span in which axes and alignment are fitted, its parts and the span after it, s: the force is above 11 m/s² up to
#: 200 s. The spread of the fits over the latter four is how well the axes are known.
FIT, PARTS = (91.0, 200.0), ((91.0, 122.0), (122.0, 160.0), (160.0, 200.0), (200.0, 244.0))
#: Latitude and east longitude (deg) of the landing site that was aimed at (Desai and Knocke, docs/citations.md).
TARGETS = {"mer_a": (-14.59, 175.3), "mer_b": (-1.98, 360.0 - 5.94)}


def summed(force, rate, interval, increment_before, attitude_before):
    """Velocity (N + 1, 3) in the axes of the first sample, by adding N increments in a computer's cycles.

    Parameters
    ----------
    force, rate : (N, 3) arrays
        Means over the samples, m/s² and rad/s.
    interval : (N,) array
        Length of the samples, s.
    increment_before, attitude_before : bool
        Whether a cycle adds the increment, and uses the attitude, of the cycle before.
    """
    turns = rate * interval[:, None]
    attitude = [Rotation.identity()]
    for turn in turns:
        attitude.append(attitude[-1] * Rotation.from_rotvec(turn))
    cycle = np.arange(len(force))
    before = np.maximum(cycle - 1, 0)
    added, turned = before if increment_before else cycle, before if attitude_before else cycle
    middle = Rotation.concatenate(attitude)[turned] * Rotation.from_rotvec(0.5 * turns[turned])
    return np.vstack((np.zeros(3), np.cumsum(middle.apply(force[added]) * interval[added, None], axis=0)))


def fitted(velocity, register):
    """RMS (m/s) of the register (n, 3) less the velocity (n, 3) with rotation, offset and scale fitted; the scale."""
    start, _ = Rotation.align_vectors(register - register[0], velocity - velocity[0])

    def residuals(p):
        return ((1.0 + p[6]) * Rotation.from_rotvec(p[:3]).apply(velocity) + p[3:6] - register).ravel()

    fit = least_squares(residuals, [*start.as_rotvec(), *(register[0] - start.apply(velocity[0])), 0.0])
    return float(np.sqrt(np.mean(fit.fun**2))), float(fit.x[6])


def rms_of_steps(velocity, register):
    """RMS of the register's steps (n, 3) less those of the velocity (n, 3) with a fitted rotation, m/s."""
    steps, read = np.diff(velocity, axis=0), np.diff(register, axis=0)
    rotation, _ = Rotation.align_vectors(read, steps)
    return float(np.sqrt(np.mean((rotation.apply(steps) - read) ** 2)))


def within(tables, setup, begin, end):
    """Force, rate and interval of HIGHRATE within a span; index of each end of a sample with a register, and this."""
    segment, _ = highrate_segment(tables, setup, "rover")
    segment = segment.between(begin, end)
    edges = np.append(segment.start, segment.time)
    rows = register_rows(tables)
    time = sample_end(tables, setup, "rover", tables.transformed.sclk[rows])
    index = np.abs(edges[:, None] - time).argmin(axis=0)
    usable = (np.abs(edges[index] - time) < 0.01) & (index > 0)
    return segment.force, segment.rate, segment.interval, index[usable], tables.transformed.velocity[rows[usable]]


def tables_of(rover):
    """Mission, constants and cleaned tables of a rover."""
    mission = Mission.load(f"builtin:{rover}")
    spacecraft = mission.telemetry.spacecraft
    return mission, mer_setup(mission), read_mer_tables(package_data(FILE_NAMES[spacecraft]), spacecraft)


def comparison(rover):
    """Hypothesis → RMS before the parachute and scale, and RMS of the steps in each span of the bounces."""
    _, setup, tables = tables_of(rover)
    spans = [within(tables, setup, *span) for span in (SMOOTH, *BOUNCES)]
    outcome = {}
    for name, delays in HYPOTHESES.items():
        sums = [(summed(force, rate, interval, *delays)[index], read) for force, rate, interval, index, read in spans]
        outcome[name] = *fitted(*sums[0]), [rms_of_steps(*pair) for pair in sums[1:]]
    return outcome


def fitted_axes(force, interval, attitude, index, register):
    """Axes of a register and alignment of the on-board transform.

    Parameters
    ----------
    force : (N, 3) array
        Means over the samples, m/s², body axes.
    interval : (N,) array
        Length of the samples, s.
    attitude : Rotation
        N, each that of the cycle in which a sample is added, at its middle: J2000 from body.
    index : (n,) array of int
        Number of samples that each value of the register contains.
    register : (n, 3) array
        m/s.

    Returns
    -------
    axes : (3, 3) array
        Rows in J2000.
    alignment : (2,) array
        Shares of the axial force that the transform adds to the forces along body y and z, rad.
    rms : float
        Of the residuals, m/s.
    """

    def velocity(alignment):
        aligned = force + force[:, :1] * np.array([0.0, *alignment])
        return np.vstack((np.zeros(3), np.cumsum(attitude.apply(aligned) * interval[:, None], axis=0)))[index]

    def residuals(p):
        return ((1.0 + p[6]) * Rotation.from_rotvec(p[:3]).apply(velocity(p[7:])) + p[3:6] - register).ravel()

    start = velocity(np.zeros(2))
    turn, _ = Rotation.align_vectors(register - register[0], start - start[0])
    fit = least_squares(
        residuals,
        [*turn.as_rotvec(), *(register[0] - turn.apply(start[0])), 0.0, 0.0, 0.0],
        x_scale=[1e-2, 1e-2, 1e-2, 1.0, 1.0, 1.0, 1e-3, 1e-3, 1e-3],
    )
    return Rotation.from_rotvec(fit.x[:3]).as_matrix(), fit.x[7:], float(np.sqrt(np.mean(fit.fun**2)))


def axes_and_alignment(tables, setup: MerSetup, begin, end):
    """`fitted_axes` of a rover's register against HIGHRATE of its IMU, within a span."""
    force, _, interval, index, register = within(tables, setup, begin, end)
    segment = highrate_segment(tables, setup, "rover")[0].between(begin, end)
    t = tables.transformed
    time = sample_end(tables, setup, "rover", t.sclk)
    near = usable_quaternions(t.rover_j2000_from_sc, t.rover_sigma) & (np.abs(time - 0.5 * (begin + end)) < end - begin)
    onboard = RotationSpline(time[near], Rotation.from_quat(t.rover_j2000_from_sc[near]))
    cycle = onboard(segment.time + 0.5 * interval) * Rotation.from_matrix(BODY_FROM_SPACECRAFT.T)
    return fitted_axes(force, interval, cycle, index - 1, register)


def site(mission, axes, time):
    """Latitude, east longitude at a time after entry, and angle of the second axis to the east, deg."""
    _, east, down = axes @ mission.planet.j2000_from_inertial_matrix
    longitude = np.degrees(np.arctan2(-down[1], -down[0]) - mission.planet.rotation_rate * time)
    longitude -= mission.planet.prime_meridian_deg
    return np.degrees(np.arcsin(-down[2])), longitude % 360.0, np.degrees(np.arcsin(east[2]))


def main():
    """Print a table of both rovers."""
    for rover in ROVERS:
        print(f"{rover}: RMS from {SMOOTH[0]:g} to {SMOOTH[1]:g} s (m/s), scale, RMS of the steps in the bounces (m/s)")
        for name, (rms, scale, steps) in comparison(rover).items():
            print(f"  {name:<28}{rms:8.3f}{scale:10.5f}   " + " ".join(f"{step:6.2f}" for step in steps))
        mission, setup, tables = tables_of(rover)
        landing = mission.event_times()["landing"]
        latitude, longitude = TARGETS[rover]
        print(f"  axes of the register; target at {latitude:.2f} N, {longitude:.2f} E")
        for span in (FIT, *PARTS):
            axes, alignment, rms = axes_and_alignment(tables, setup, *span)
            north, east, tilt = site(mission, axes, landing)
            print(
                f"  {span[0]:5.0f} to {span[1]:3.0f} s: down at {north:7.3f} N, {east:7.3f} E (at landing), east axis "
                f"{tilt:6.3f} deg from the equator; "
                f"transform {1e3 * alignment[0]:6.3f}, {1e3 * alignment[1]:6.3f} mrad; RMS {rms:.4f} m/s"
            )
            if span == FIT:
                print("\n".join(f"      - [{x:.5f}, {y:.5f}, {z:.5f}]" for x, y, z in axes))


if __name__ == "__main__":
    main()
