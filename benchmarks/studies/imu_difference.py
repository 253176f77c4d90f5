"""The difference of the two IMUs: its size by the force, and the errors of samples filled from the other IMU.

`make study-imu-difference` (two minutes). On the rovers and on two practice flights, stretches of 1, 5 and 20 s of the
driving IMU before the parachute are taken for lost and filled from the other one. The errors of the velocity change and
of the rotation over a stretch are printed in their sigmas, RMS and largest of all axes. For each rover follows the
axial force of the rover's IMU minus the backshell's, both at the centre of mass, in spans of six seconds: it is a
function of the force, the same before the peak of the deceleration, after it, and before the increments begin.

    python benchmarks/studies/imu_difference.py
"""

from dataclasses import replace

import numpy as np
from lost_seconds import ROVERS

from edl_filter import Mission
from edl_filter.imu_model.lever_arm import lever_arm_acceleration
from edl_filter.pipeline.load import event_times, read_telemetry
from edl_filter.telemetry.resampling import means_between, readings_integral
from edl_filter.telemetry.sample_repair import repaired

FLIGHTS = (*ROVERS, "practice_mer", "practice_phoenix")
#: Lengths of the stretches, the step between their begins, and the time of the first one and up to the parachute, s.
LENGTHS, STEP, FIRST, LAST = (1.0, 5.0, 20.0), 3.7, 20.0, 2.0
#: Edges of the spans over which the forces are averaged, s: those of the archive's two tables do not join.
SPANS = (np.arange(-4.0, 90.0, 6.0), np.arange(91.0, 246.0, 6.0))
_TRIADS = (("specific_force", "force_noise", "force_fill_sigma"), ("angular_rate", "rate_noise", "rate_fill_sigma"))


def errors_in_sigmas(telemetry, deployed, begin, length):
    """Errors over one stretch in their sigmas, and themselves: (2, 3) arrays of velocity change and rotation."""
    record = telemetry.driving
    lost = (record.time > begin) & (record.time <= begin + length)
    missing = {name: np.where(lost[:, None], np.nan, getattr(record, name)) for name, _, _ in _TRIADS}
    filled = repaired(replace(telemetry, driving=replace(record, **missing)), parachute=deployed).driving
    interval, errors, sigmas = record.interval[lost, None], [], []
    for name, noise, fill in _TRIADS:
        errors.append(np.sum((getattr(filled, name) - getattr(record, name))[lost] * interval, axis=0))
        variance = getattr(filled, fill)[lost] ** 2 + getattr(filled, noise)[lost, None] ** 2
        sigmas.append(np.sqrt(np.sum(interval**2 * variance, axis=0)))
    return np.array(errors) / sigmas, np.array(errors)


def force_at_centre_of_mass(record):
    """Specific force (N, 3) of a record at the centre of mass, m/s², body axes."""
    return record.specific_force - lever_arm_acceleration(
        record.interval, record.angular_rate, record.position, record.unit
    )


def axial_differences(telemetry):
    """Middle of each span, axial force of the driving IMU, and how much larger the other one's is: (n, 3) array."""
    rows = []
    for edges in SPANS:
        means = [
            means_between(readings_integral(record, force_at_centre_of_mass(record), record.angular_rate), edges)[0]
            for record in (telemetry.driving, telemetry.checking[0])
        ]
        rows.append(np.column_stack((0.5 * (edges[1:] + edges[:-1]), means[0][:, 0], (means[1] - means[0])[:, 0])))
    return np.concatenate(rows)


def main():
    """Print both tables."""
    for name in FLIGHTS:
        mission = Mission.load(f"builtin:{name}")
        telemetry = read_telemetry(mission)
        deployed = event_times(mission, telemetry)["parachute_deploy"]
        for length in LENGTHS:
            begins = np.arange(FIRST, deployed - LAST - length, STEP)
            outcomes = [errors_in_sigmas(telemetry, deployed, begin, length) for begin in begins]
            sigmas, errors = (np.array(values) for values in zip(*outcomes, strict=True))
            rms, largest = np.sqrt(np.mean(sigmas**2, axis=(0, 2))), np.abs(sigmas).max(axis=(0, 2))
            velocity = np.sqrt(np.mean(np.sum(errors[:, 0] ** 2, axis=1)))
            print(
                f"{name:<16}{length:4.0f} s, {len(begins)} times: force RMS {rms[0]:.2f}, largest {largest[0]:.1f}; "
                f"rate {rms[1]:.2f}, {largest[1]:.1f} sigmas; velocity RMS {velocity:.4f} m/s"
            )
        if name in ROVERS:
            print("  time s  force m/s²  difference m/s²")
            for row in axial_differences(telemetry):
                print("  {:6.0f}  {:10.3f}  {:15.4f}".format(*row))


if __name__ == "__main__":
    main()
