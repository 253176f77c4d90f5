"""When the rovers' computer added an increment to its velocity register: `make study-velocity-register` (a minute).

The table TRANSFORMED has the velocity that the computer accumulated from the rover's IMU in axes that do not rotate,
HIGHRATE the increments themselves. Both end at the clock count of their rows. The increments are summed here with the
attitude from the gyros of the same IMU; rotation, offset and scale of the register against the sum are fitted. Three
hypotheses are compared: the register contains all increments up to its row; it is one increment late; it is one
increment late, and an increment is rotated with the attitude of the cycle in which it is added.

    python benchmarks/studies/velocity_register.py
"""

import numpy as np
from lost_seconds import ROVERS
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from edl_filter import Mission
from edl_filter.io.csv_table import package_data
from edl_filter.pipeline.load import mer_setup
from edl_filter.telemetry.mer_archive import read_mer_tables
from edl_filter.telemetry.mer_compact import FILE_NAMES
from edl_filter.telemetry.mer_register import register_rows
from edl_filter.telemetry.mer_segments import highrate_segment, sample_end

#: Hypothesis → whether the increment, and whether the attitude with which it is rotated, is that of the cycle before.
HYPOTHESES = {
    "up to its row": (False, False),
    "one increment late": (True, True),
    "late, attitude of its cycle": (True, False),
}
#: Spans before the parachute, in which one rotation is fitted; and in the bounces, in which steps are compared, s.
SMOOTH, BOUNCES = (92.0, 244.0), ((335.0, 340.0), (340.0, 345.0), (345.0, 350.0), (350.0, 355.0), (355.0, 360.0))


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


def comparison(rover):
    """Hypothesis → RMS before the parachute and scale, and RMS of the steps in each span of the bounces."""
    mission = Mission.load(f"builtin:{rover}")
    setup = mer_setup(mission)
    spacecraft = mission.telemetry.spacecraft
    tables = read_mer_tables(package_data(FILE_NAMES[spacecraft]), spacecraft)
    spans = [within(tables, setup, *span) for span in (SMOOTH, *BOUNCES)]
    outcome = {}
    for name, delays in HYPOTHESES.items():
        sums = [(summed(force, rate, interval, *delays)[index], read) for force, rate, interval, index, read in spans]
        outcome[name] = *fitted(*sums[0]), [rms_of_steps(*pair) for pair in sums[1:]]
    return outcome


def main():
    """Print a table of both rovers."""
    for rover in ROVERS:
        print(f"{rover}: RMS from {SMOOTH[0]:g} to {SMOOTH[1]:g} s (m/s), scale, RMS of the steps in the bounces (m/s)")
        for name, (rms, scale, steps) in comparison(rover).items():
            print(f"  {name:<28}{rms:8.3f}{scale:10.5f}   " + " ".join(f"{step:6.2f}" for step in steps))


if __name__ == "__main__":
    main()
