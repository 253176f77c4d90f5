"""The record joined from the archive's three products, on the real tables."""

import re
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from edl_filter import rotations
from edl_filter.errors import InputError
from edl_filter.mission import Mission, shipped_mission
from edl_filter.mission.mission import require_prediction_inputs
from edl_filter.navigation.increments import effective_samples
from edl_filter.navigation.noise import sample_attitudes
from edl_filter.pipeline.constraints import onboard_attitudes
from edl_filter.pipeline.load import mer_setup
from edl_filter.telemetry.calibration import compare
from edl_filter.telemetry.increment_clock import INCREMENT
from edl_filter.telemetry.mer_archive import read_mer_tables
from edl_filter.telemetry.mer_flight import mer_telemetry
from edl_filter.telemetry.mer_register import register_segment
from edl_filter.telemetry.mer_segments import (
    BODY_FROM_SPACECRAFT,
    highrate_segment,
    onboard_attitude,
    sample_end,
    transformed_segment,
)
from edl_filter.telemetry.sample_checks import CheckSettings
from edl_filter.telemetry.sample_repair import repaired

ROVERS = {"mer_a": 2, "mer_b": 1}
SPACECRAFT_FROM_BODY = rotations.from_matrix(BODY_FROM_SPACECRAFT.T)


@pytest.fixture(scope="module", params=ROVERS)
def rover(request, mer_folder):
    mission = Mission.load(shipped_mission(request.param))
    tables = read_mer_tables(mer_folder, ROVERS[request.param])
    setup = mer_setup(mission)
    return mission, tables, setup, mer_telemetry(tables, setup)


def from_source(record, name):
    return record.source == record.sources.index(name)


def test_products_adjoin_without_gaps(rover):
    _, tables, setup, telemetry = rover
    record = telemetry.driving
    np.testing.assert_allclose(record.time[1:] - record.interval[1:], record.time[:-1], atol=1e-9)
    assert np.isfinite(record.specific_force).all() and np.isfinite(record.angular_rate).all()
    highrate = tables.highrate.sclk - setup.epoch_sclk
    clock = tables.clocks["backshell"]
    start = clock.time(tables.highrate.sclk[:1] - 0.125)[0] - setup.epoch_sclk
    assert highrate[0] - 0.125 - INCREMENT < start < highrate[0] - 0.125
    assert record.time[from_source(record, "TRANSFORMED")][-1] == pytest.approx(start, abs=1e-7)
    assert record.time[from_source(record, "HIGHRATE")][-1] == pytest.approx(highrate[-1] - 0.125, abs=0.25)
    assert record.time[from_source(record, "register")][-1] == pytest.approx(setup.end, abs=0.5)


def test_rover_drives_from_separation_on(rover):
    _, _, setup, record = rover[0], rover[1], rover[2], rover[3].driving
    before = record.time <= setup.separation + 1e-6
    assert set(record.unit[before]) == {record.units.index("backshell")}
    assert record.units.index("backshell") not in set(record.unit[~before])
    assert np.all(record.position[~before] == 0.0)
    shield = setup.events["heat_shield_separation"]
    highrate, middle = from_source(record, "HIGHRATE") & before, record.time - 0.5 * record.interval
    for rows, position in (
        (highrate & (middle < shield), setup.imus["backshell"].position),
        (highrate & (middle > shield), setup.positions[shield]),  # without the shield the centre of mass is farther aft
    ):
        assert rows.sum() > 50
        np.testing.assert_allclose(record.position[rows], np.tile(BODY_FROM_SPACECRAFT @ position, (rows.sum(), 1)))


def test_body_axes_are_a_permutation_of_the_archives(rover):
    record = rover[3].driving
    near_peak = (record.time > 100.0) & (record.time < 140.0)
    assert np.all(record.specific_force[near_peak, 0] < -30.0)  # drag on the nose
    assert np.median(np.abs(record.specific_force[near_peak, 1:])) < 1.0
    assert np.linalg.det(BODY_FROM_SPACECRAFT) == pytest.approx(1.0)
    np.testing.assert_array_equal(BODY_FROM_SPACECRAFT @ [0.0, 0.0, 1.0], [1.0, 0.0, 0.0])


def test_rates_are_continuous_across_the_join(rover):
    record = rover[3].driving
    first = np.flatnonzero(from_source(record, "HIGHRATE"))[0]
    assert record.angular_rate[first - 1, 0] == pytest.approx(record.angular_rate[first, 0], abs=2e-3)
    assert 0.18 < record.angular_rate[first, 0] < 0.24  # about 2 rpm: HIGHRATE's columns are increments


def test_gyros_agree_with_the_on_board_quaternion(rover):
    """With the on-board rate correction the difference is 0.002 deg over ten seconds, before parachute deployment."""
    telemetry = rover[3]
    samples, attitude = effective_samples(telemetry.driving), telemetry.attitude
    errors = []
    rows = [np.argmin(np.abs(attitude.time - t)) for t in np.arange(95.0, 245.0, 10.0)]
    for a, b in pairwise(rows):
        part = samples.part(samples.index(attitude.time[a]), samples.index(attitude.time[b]))
        end = sample_attitudes(part.interval, part.rate, attitude.inertial_from_body[a])[1]
        errors.append(rotations.rotation_vector_between(attitude.inertial_from_body[b], end))
    rms = np.degrees(np.sqrt(np.mean(np.square(errors), axis=0)))
    assert np.all(rms < 0.002)


def test_rate_correction_is_applied_to_highrate(rover):
    mission, tables, setup, _ = rover
    corrected = highrate_segment(tables, setup, "rover")[0].rate.mean(axis=0)
    key = "telemetry.imus.rover.onboard_rate_correction_deg_h=[0, 0, 0]"
    uncorrected_setup = mer_setup(Mission.load(mission.source, [key]))
    uncorrected = highrate_segment(tables, uncorrected_setup, "rover")[0].rate.mean(axis=0)
    correction = np.degrees(uncorrected - corrected) * 3600.0
    assert correction[0] == pytest.approx(mission.telemetry.imus["rover"].onboard_rate_correction_deg_h[2])


def test_attitude_across_the_gap_is_that_of_the_quaternions(rover):
    mission, _, _, telemetry = rover
    record = telemetry.driving
    gap = from_source(record, "gap")
    length = record.interval[gap].sum()
    # 0.875 and 0.75 s between samples; the IMU's clock is fast by some 15 ppm
    assert length == pytest.approx(0.75 if mission.name == "mer_a" else 0.625, rel=2e-5)
    assert np.all(record.coning_corrected[gap]) and np.all(record.shared_rate_noise[gap] == 0.0)
    samples = effective_samples(record)
    first, last = np.flatnonzero(gap)[[0, -1]]
    attitude = telemetry.attitude
    a = np.flatnonzero(attitude.time <= record.time[first] - record.interval[first] + 1e-6)[-1]
    b = np.flatnonzero(attitude.time >= record.time[last] - 1e-6)[0]
    part = samples.part(samples.index(attitude.time[a]), samples.index(attitude.time[b]))
    end = sample_attitudes(part.interval, part.rate, attitude.inertial_from_body[a])[1]
    error = rotations.rotation_vector_between(attitude.inertial_from_body[b], end)
    assert np.degrees(np.linalg.norm(error)) < 0.05
    rotation = rotations.rotation_vector_between(attitude.inertial_from_body[a], attitude.inertial_from_body[b])
    if mission.name == "mer_a":
        assert np.degrees(np.linalg.norm(rotation)) > 10.0


def test_register_ends_at_the_quaternion_and_velocity_also_across_a_gap_of_15_seconds(rover):
    """The register of a row ends one increment before its quaternion, and is rotated with the quaternions' attitude."""
    _, tables, setup, telemetry = rover
    record, t = telemetry.driving, tables.transformed
    read, ends = (sample_end(tables, setup, unit, t.sclk) for unit in ("rover", "register"))
    np.testing.assert_allclose(read - ends, 0.125, atol=3e-3)
    rows = from_source(record, "register")
    first = record.time[rows][0] - record.interval[rows][0]
    start, stop = (int(np.argmin(np.abs(ends - time))) for time in (first, 470.0))
    assert first == pytest.approx(ends[start], abs=1e-6)
    samples = effective_samples(record)
    part = samples.part(samples.index(first), samples.index(ends[stop]))
    between = Slerp(read, Rotation.from_quat(rotations.multiply(t.rover_j2000_from_sc, SPACECRAFT_FROM_BODY)))
    attitude_before = from_highrate(tables, setup, read[start], t.rover_j2000_from_sc[start])
    _, end = sample_attitudes(part.interval, part.rate, attitude_before)
    error = rotations.rotation_vector_between(between(ends[stop]).as_quat(), end)
    assert np.degrees(np.linalg.norm(error)) < 1e-3
    attitude_at_middle = between(np.minimum(part.time - 0.5 * part.interval + 0.125, read[stop])).as_quat()
    velocity_increment = part.interval @ rotations.rotate(attitude_at_middle, onboard_force(part.force, setup))
    register = rotations.rotate(setup.j2000_from_register, t.velocity[stop] - t.velocity[start])
    np.testing.assert_allclose(velocity_increment, register, atol=1e-3)
    assert np.max(part.interval) <= 0.25 + 1e-9


def onboard_force(force, setup):
    """Force of the rover's IMU, body axes, with the alignment error of the on-board transform."""
    return force + force[:, :1] * np.array([0.0, *setup.imus["rover"].transformed_alignment])


def from_highrate(tables, setup, end, attitude):
    """Body's attitude one increment before a quaternion of the rover, by its gyros."""
    segment = highrate_segment(tables, setup, "rover")[0].between(end - 0.13, end)
    (rate,), (interval,) = segment.rate, segment.interval
    turned = rotations.from_rotation_vector(-rate * interval)
    return rotations.multiply(rotations.multiply(attitude, SPACECRAFT_FROM_BODY), turned)


class TestRegister:
    """The register of a lander that turns, computed cycle by cycle as the rover's computer does."""

    RATE, SLOPE = np.array([0.25, -0.15, 0.1]), np.array([0.9, -0.6, 0.4])  # rad/s and m/s³, body axes
    START = np.array([-3.0, 1.0, 2.0])  # m/s²

    @classmethod
    def turned(cls, time):
        """Rotation vector since time 0, rad: about one axis, at a rate that changes by a tenth in a second."""
        return cls.RATE * (np.asarray(time) + 0.05 * np.asarray(time) ** 2)[..., None]

    @classmethod
    def force(cls, time):
        return cls.START + cls.SLOPE * np.asarray(time)[..., None]

    def segment(self, rover, rows, turn_before=None):
        """Segment of the register over rows of the table; its times are relative to the first row."""
        _, tables, setup, _ = rover
        aligned = replace(setup.imus["rover"], transformed_alignment=np.array([0.02, -0.03]))
        setup = replace(setup, imus={**setup.imus, "rover": aligned})
        t = tables.transformed
        read = t.sclk - setup.epoch_sclk - tables.clocks["rover"].lag(t.sclk)
        time = read - read[rows[0]]
        attitude = rotations.multiply(
            rotations.from_rotation_vector(self.turned(time)), rotations.conjugate(SPACECRAFT_FROM_BODY)
        )
        cycle_end = np.arange(0.0, time[rows[-1]] + 0.01, 0.125)
        attitude_of_cycle = rotations.from_rotation_vector(self.turned(cycle_end - 0.0625))
        increment_before = onboard_force(self.force(cycle_end - 0.125 - 0.0625), setup) * 0.125
        summed = np.cumsum(rotations.rotate(attitude_of_cycle, increment_before), axis=0)
        velocity = np.full_like(t.velocity, np.nan)
        cycles = np.round(time[rows] / 0.125).astype(int)
        velocity[rows] = rotations.rotate(rotations.conjugate(setup.j2000_from_register), summed[cycles])
        synthetic = replace(tables, transformed=replace(t, rover_j2000_from_sc=attitude, velocity=velocity))
        (segment,) = register_segment(synthetic, setup, read[rows[0]] - 0.2, np.inf, turn_before)
        return replace(segment, time=segment.time - read[rows[0]])

    @pytest.mark.parametrize("lost", [range(0), range(20, 30)], ids=["complete", "ten rows lost"])
    def test_force_and_rate_are_those_of_the_increments_in_the_register(self, rover, lost):
        first = int(np.searchsorted(rover[1].transformed.sclk - rover[2].epoch_sclk, 440.0))
        rows = np.delete(np.arange(first, first + 40), lost)
        ends = rover[1].transformed.sclk - rover[1].transformed.sclk[first] - 0.125
        segment = self.segment(rover, rows)
        middle = segment.time - 0.5 * segment.interval
        assert segment.start == pytest.approx(-0.125, abs=1e-3)
        assert segment.time[-1] == pytest.approx(ends[rows[-1]], abs=1e-3)
        edges = np.append(segment.start, segment.time)
        rate = np.diff(self.turned(edges), axis=0) / segment.interval[:, None]
        across_rate = (middle > ends[first + 18]) & (middle < ends[first + 31]) & bool(lost)
        inside = ~across_rate & (middle > 0.2) & (middle < middle[-1])  # the rates beyond the ends are not known
        # the spline has no angular acceleration at its ends
        np.testing.assert_allclose(segment.rate[inside], rate[inside], atol=7e-4)
        rotation = segment.interval @ segment.rate  # about one axis
        np.testing.assert_allclose(rotation, self.turned(edges[-1]) - self.turned(edges[0]), atol=1e-3)
        across = (middle > ends[first + 19]) & (middle < ends[first + 30]) & bool(lost)
        np.testing.assert_allclose(segment.force[~across], self.force(middle[~across]), atol=6e-3)

    def test_a_row_between_two_gaps_has_the_mean_rate_across_one_of_them(self, rover):
        first = int(np.searchsorted(rover[1].transformed.sclk - rover[2].epoch_sclk, 440.0))
        segment = self.segment(rover, np.r_[first, first + 8 : first + 20, first + 30])
        assert segment.start == pytest.approx(-0.125, abs=1e-3)
        edges = np.append(segment.start, segment.time)
        rate = np.diff(self.turned(edges), axis=0) / segment.interval[:, None]
        np.testing.assert_allclose(segment.rate, rate, atol=0.06)

    def test_the_rotation_to_the_first_quaternion_can_be_stated(self, rover):
        first = int(np.searchsorted(rover[1].transformed.sclk - rover[2].epoch_sclk, 440.0))
        stated = BODY_FROM_SPACECRAFT.T @ [0.0, 0.01, 0.0]
        rows = np.arange(first, first + 40)
        segment, default = self.segment(rover, rows, stated), self.segment(rover, rows)
        step = float(np.diff(rover[1].transformed.sclk[rows[:2]])[0])
        by_first_interval = self.turned(step) / step * 0.125
        difference = (segment.rate[0] - default.rate[0]) * segment.interval[0]
        np.testing.assert_allclose(difference, [0.0, 0.01, 0.0] - by_first_interval, atol=1e-3)
        np.testing.assert_array_equal(segment.rate[1:], default.rate[1:])
        np.testing.assert_array_equal(segment.force, default.force)


def test_rover_and_backshell_agree_before_separation(rover):
    """At the centre of mass they agree to a few hundredths m/s² (facts file), before their axes are aligned."""
    mission, tables, setup, _ = rover
    key = "telemetry.imus.rover.alignment_deg=[0, 0, 0]"
    telemetry = mer_telemetry(tables, mer_setup(Mission.load(mission.source, [key])))
    estimate = compare(telemetry.driving, telemetry.checking[0], setup.events["parachute_deploy"])
    late = estimate.windows[-1]
    assert (late.start, late.end) == (140.0, 250.0)
    rotation = np.degrees(late.slope[::-1])  # about y (with the other sign) and z of the body
    expected = {"mer_a": (0.032, 0.007), "mer_b": (0.040, -0.045)}[mission.name]
    np.testing.assert_allclose(np.abs(rotation), np.abs(expected), atol=0.03)
    assert np.all(late.residual_rms < 0.02)
    assert len(estimate.windows) == 2


def test_on_board_attitude_is_used_with_gyros_and_not_inside_the_gap(rover):
    telemetry = rover[3]
    used = np.array([c.time for c in onboard_attitudes(telemetry, 10.0, 0.0)])
    record = telemetry.driving
    assert used[0] > record.time[from_source(record, "TRANSFORMED")][-1]
    assert used[-1] <= record.time[from_source(record, "HIGHRATE")][-1]
    in_gap = from_source(record, "gap")
    gap = record.time[in_gap]
    assert not np.any((used > gap[0] - record.interval[in_gap][0] + 1e-6) & (used < gap[-1] - 1e-6))
    assert np.any(np.abs(used - gap[-1]) < 0.3)
    sigma = onboard_attitude(*rover[1:3]).sigma
    assert np.all(sigma < 1e-4)


def test_transformed_alignment_is_subtracted(rover):
    mission, tables, setup, _ = rover
    key = "telemetry.imus.backshell.transformed_alignment_deg=[0, 0]"
    uncorrected, _ = transformed_segment(tables, mer_setup(Mission.load(mission.source, [key])), 80.0)
    corrected, findings = transformed_segment(tables, setup, 80.0)
    assert findings == []
    ratio = (uncorrected.force - corrected.force)[:, 1:] / corrected.force[:, :1]
    expected = np.radians(mission.telemetry.imus["backshell"].transformed_alignment_deg)
    np.testing.assert_allclose(ratio[-40:], np.tile(expected, (40, 1)), rtol=1e-9)


def test_register_segment_can_begin_before_highrate(rover):
    _, tables, setup, _ = rover
    (segment,) = register_segment(tables, setup, 0.0, 60.0)
    assert segment.time[-1] <= 60.0 + 1e-6 and segment.coning_corrected and segment.sculling_corrected


def test_separation_outside_highrate_raises(rover):
    _, tables, setup, _ = rover
    with pytest.raises(InputError, match="backshell_separation at 20 s lies outside the HIGHRATE table"):
        mer_telemetry(tables, replace(setup, separation=20.0))


def test_span_beyond_the_telemetry_raises(rover):
    _, tables, setup, _ = rover
    with pytest.raises(InputError, match=r"telemetry\.start_s and end_s ask for -2000 to 560 s") as raised:
        mer_telemetry(tables, replace(setup, start=-2000.0))
    expected = tables.transformed.sclk[[0, -1]] - setup.epoch_sclk
    first, last = re.search(r"has (\S+) to (\S+) s\.$", str(raised.value)).groups()
    assert float(first) == pytest.approx(expected[0], abs=1.0)
    assert float(last) == pytest.approx(expected[1], abs=1.0)


def test_record_that_ends_within_highrate_has_no_register_samples(rover):
    _, tables, setup, telemetry = rover
    short = mer_telemetry(tables, replace(setup, end=300.0)).driving
    expected = telemetry.driving.between(setup.start, 300.0)
    assert short.time[-1] == pytest.approx(300.0, abs=0.2)
    assert not np.any(from_source(short, "register"))
    np.testing.assert_array_equal(short.specific_force, expected.specific_force)
    np.testing.assert_array_equal(short.rate_noise, expected.rate_noise)
    assert register_segment(tables, setup, 500.0, 499.0) == []
    assert mer_telemetry(tables, replace(setup, end=-100.0)).checking == ()


def test_tables_of_the_other_rover_raise(rover):
    _, tables, setup, _ = rover
    with pytest.raises(InputError, match=r"^telemetry\.spacecraft: .*telemetry\.epoch_sclk = 1000\.000"):
        mer_telemetry(tables, replace(setup, epoch_sclk=1000.0))


def with_increments(tables, unit, change):
    """Tables whose increments of velocity and angle of one IMU are changed in place by a function."""
    names = [f"{unit}_{quantity}_increment" for quantity in ("velocity", "angle")]
    arrays = {name: getattr(tables.highrate, name).copy() for name in names}
    change(*arrays.values())
    return replace(tables, highrate=replace(tables.highrate, **arrays))


def row_at(tables, setup, time):
    return int(np.searchsorted(tables.highrate.sclk - setup.epoch_sclk, time))


@pytest.mark.parametrize(("kind", "value"), [("all_zero", 0.0), ("not_finite", np.nan), ("duplicated", None)])
def test_accelerations_that_no_sensor_can_have_read_are_filled_from_the_other_imu(kind, value, rover):
    """Of TRANSFORMED, before the increments begin; None: the packet is repeated. The rates are left."""
    _, tables, setup, telemetry = rover
    acceleration = tables.transformed.backshell_acceleration.copy()
    first = int(np.searchsorted(tables.transformed.sclk - setup.epoch_sclk, 80.0))
    acceleration[first + 1 : first + 17] = acceleration[first] if value is None else value
    read = mer_telemetry(
        replace(tables, transformed=replace(tables.transformed, backshell_acceleration=acceleration)), setup
    )
    (finding,) = read.findings
    assert (finding.imu, finding.channel, finding.kind, finding.samples) == ("driving", "force", kind, 16)
    lost = (read.driving.time > finding.start + 0.01) & (read.driving.time < finding.end + 0.01)
    assert np.isnan(read.driving.specific_force[lost]).all() and lost.sum() == 16
    np.testing.assert_array_equal(read.driving.angular_rate, telemetry.driving.angular_rate)
    filled = repaired(read, parachute=setup.events["parachute_deploy"]).driving
    interval = filled.interval[lost, None]
    difference = np.sum((filled.specific_force - telemetry.driving.specific_force)[lost] * interval, axis=0)
    axial = np.sum((telemetry.driving.specific_force[:, :1] * telemetry.driving.interval[:, None])[lost])
    fill, noise = filled.force_fill_sigma[lost], filled.force_noise[lost][:, None]
    sigma = np.sqrt(np.sum((interval * fill) ** 2 + (interval * noise) ** 2, axis=0))
    assert np.all(np.abs(difference) < 3.0 * sigma) and np.all(sigma < 0.1) and abs(axial) > 50.0  # m/s


class TestLostIncrements:
    """Increments that no sensor can have read, in the columns of one IMU."""

    def test_those_of_the_driving_imu_are_filled_from_the_other_one(self, rover):
        _, tables, setup, telemetry = rover
        first = row_at(tables, setup, 130.0)

        def packets_of_zeros(velocity, angle):
            velocity[first : first + 16] = angle[first : first + 16] = 0.0

        read = mer_telemetry(with_increments(tables, "backshell", packets_of_zeros), setup)
        (finding,) = read.findings
        assert (finding.imu, finding.kind, finding.samples) == ("driving", "all_zero", 16)
        lost = (read.driving.time > finding.start + 0.01) & (read.driving.time < finding.end + 0.01)
        for name in ("specific_force", "angular_rate"):
            values, complete = getattr(read.driving, name), getattr(telemetry.driving, name)
            assert np.isnan(values[lost]).all() and lost.sum() == 16
            np.testing.assert_array_equal(values[~lost], complete[~lost])
        filled = repaired(read, parachute=setup.events["parachute_deploy"])
        assert filled.findings[0].repair == "filled from rover"
        difference = np.sum((filled.driving.specific_force - telemetry.driving.specific_force)[lost] * 0.125, axis=0)
        fill, noise = filled.driving.force_fill_sigma[lost], filled.driving.force_noise[lost][:, None]
        sigma = 0.125 * np.sqrt(np.sum(fill**2 + noise**2, axis=0))
        assert np.all(np.abs(difference) < 3.0 * sigma) and np.all(sigma < 0.1)  # m/s, of more than 50

    def test_five_lost_seconds_are_inside_their_sigmas(self, rover):
        """In smooth flight, of either triad; one IMU's axial force is not linear (docs/validation.md)."""
        telemetry, deployed = rover[3], rover[2].events["parachute_deploy"]
        record, sigmas, errors = telemetry.driving, [], []
        for begin in np.arange(92.0, 240.0, 14.0):
            lost = (record.time > begin) & (record.time <= begin + 5.0)
            force, rate = (np.where(lost[:, None], np.nan, v) for v in (record.specific_force, record.angular_rate))
            missing = replace(record, specific_force=force, angular_rate=rate)
            filled = repaired(replace(telemetry, driving=missing), parachute=deployed).driving
            interval = record.interval[lost, None]
            for name, fill, noise in (
                ("specific_force", filled.force_fill_sigma, filled.force_noise),
                ("angular_rate", filled.rate_fill_sigma, filled.rate_noise),
            ):
                error = np.sum((getattr(filled, name) - getattr(record, name))[lost] * interval, axis=0)
                variance = np.sum(interval**2 * (fill[lost] ** 2 + noise[lost, None] ** 2), axis=0)
                sigmas.append(error / np.sqrt(variance))
            errors.append(np.sum((filled.specific_force - record.specific_force)[lost, 0] * interval[:, 0]))
        assert np.abs(sigmas).max() < 3.5 and np.sqrt(np.mean(np.square(sigmas))) < 1.0
        assert np.sqrt(np.mean(np.square(errors))) < 0.02  # m/s

    def test_a_stuck_axis_loses_its_triad(self, rover):
        _, tables, setup, telemetry = rover
        first = row_at(tables, setup, 150.0)

        def stuck_gyro(_, angle):
            angle[first + 1 : first + 40, 1] = angle[first, 1]

        read = mer_telemetry(with_increments(tables, "rover", stuck_gyro), setup)
        (finding,) = read.findings
        assert (finding.imu, finding.channel, finding.kind) == ("rover", "rate y", "stuck")
        (checking,) = read.checking
        assert np.isnan(checking.angular_rate).any(axis=1).sum() == finding.samples
        assert finding.samples in (40, 41)  # the next reading may have the same value
        np.testing.assert_array_equal(checking.specific_force, telemetry.checking[0].specific_force)
        np.testing.assert_array_equal(read.driving.angular_rate, telemetry.driving.angular_rate)
        lost, expected = np.isnan(checking.angular_rate).any(axis=1), telemetry.checking[0].angular_rate
        known, axis = checking.partial_rate[lost].swapaxes(0, 1)  # the other two axes are read
        np.testing.assert_allclose(np.linalg.norm(axis, axis=1), 1.0, atol=1e-12)
        across = expected[lost] - np.sum(expected[lost] * axis, axis=1, keepdims=True) * axis
        np.testing.assert_allclose(known, across, atol=1e-12)
        assert not checking.partial_rate[~lost].any() and not checking.partial_force.any()

    def test_what_the_record_does_not_have_is_no_finding(self, rover):
        """The backshell's IMU after the time up to which it is read."""
        _, tables, setup, _ = rover
        first = row_at(tables, setup, 150.0)

        def packets_of_zeros(velocity, angle):
            velocity[first : first + 16] = angle[first : first + 16] = 0.0

        read = mer_telemetry(with_increments(tables, "backshell", packets_of_zeros), replace(setup, end=140.0))
        assert read.findings == ()

    def test_checks_that_are_disabled_leave_them(self, rover):
        _, tables, setup, _ = rover
        first = row_at(tables, setup, 130.0)

        def packets_of_zeros(velocity, angle):
            velocity[first : first + 16] = angle[first : first + 16] = 0.0

        faulty = with_increments(tables, "backshell", packets_of_zeros)
        read = mer_telemetry(faulty, setup, CheckSettings(enabled=False))
        assert read.findings == () and np.isfinite(read.driving.specific_force).all()

    def test_next_to_a_gap_of_the_table_the_attitude_across_it_stays(self, rover):
        """The gyros between the quaternions and the gap are interpolated where they were lost."""
        _, tables, setup, telemetry = rover
        gap = from_source(telemetry.driving, "gap")
        last = row_at(tables, setup, telemetry.driving.time[gap][0] - 0.2)

        def lost_before_the_gap(velocity, angle):
            velocity[last - 16 : last + 1] = angle[last - 16 : last + 1] = 0.0

        read = mer_telemetry(with_increments(tables, unit_at_gap(telemetry), lost_before_the_gap), setup)
        assert read.findings[0].kind == "all_zero"
        rate, expected = read.driving.angular_rate[gap], telemetry.driving.angular_rate[gap]
        rotation = np.sum((rate - expected) * telemetry.driving.interval[gap, None], axis=0)
        assert np.degrees(np.linalg.norm(rotation)) < 5.0
        assert np.isfinite(read.driving.force_noise).all() and np.isfinite(read.driving.rate_noise).all()
        complete = repaired(read, parachute=setup.events["parachute_deploy"])
        assert np.isfinite(complete.driving.specific_force).all() and np.isfinite(complete.driving.angular_rate).all()


def unit_at_gap(telemetry):
    record = telemetry.driving
    return record.units[record.unit[np.flatnonzero(from_source(record, "gap"))[0]]]


@pytest.fixture(scope="module")
def rover_drives(rover):
    """Telemetry in which the rover's IMU drives from the start of HIGHRATE on."""
    mission, tables, _, _ = rover
    return mer_telemetry(tables, mer_setup(Mission.load(mission.source, ["telemetry.driving=rover"])))


class TestRoverDrives:
    """`telemetry.driving: rover`, as the thesis flew from 90 s on."""

    def test_from_the_start_of_highrate_on(self, rover, rover_drives):
        _, tables, setup, backshell_drives = rover
        record, start = rover_drives.driving, tables.highrate.sclk[0] - setup.epoch_sclk
        names = np.array(record.units)[record.unit]
        assert set(names[record.time < start - INCREMENT]) == {"backshell"}
        assert "backshell" not in names[record.time > start + 0.01]
        np.testing.assert_allclose(record.time[1:] - record.interval[1:], record.time[:-1], atol=1e-9)
        (checking,) = rover_drives.checking
        assert checking.name == "backshell" and checking.time[-1] <= setup.separation
        # the readings are those of the record in which the rover checks, in its own axes
        (rover_readings,) = backshell_drives.checking
        k, i = (np.searchsorted(x.time, 200.0) for x in (record, rover_readings))
        aligned = rotations.rotate(
            rotations.from_rotation_vector(BODY_FROM_SPACECRAFT @ setup.imus["rover"].alignment),
            record.specific_force[k : k + 8],
        )
        np.testing.assert_allclose(aligned, rover_readings.specific_force[i : i + 8], atol=1e-9)
        np.testing.assert_allclose(record.position[k], rover_readings.position[i])

    def test_the_heat_shield_moves_both_imus_alike(self, rover, rover_drives):
        setup = rover[2]
        shield = setup.events["heat_shield_separation"]
        for record in (rover_drives.driving, rover_drives.checking[0]):
            before, after = (record.position[np.searchsorted(record.time, shield + dt)] for dt in (-1.0, 1.0))
            np.testing.assert_allclose(
                after - before,
                BODY_FROM_SPACECRAFT @ (setup.positions[shield] - setup.imus["backshell"].position),
                atol=1e-12,
            )

    def test_from_a_later_time(self, rover):
        mission, tables, _, _ = rover
        changes = ["telemetry.driving=rover", "telemetry.driving_from_s=150"]
        record = mer_telemetry(tables, mer_setup(Mission.load(mission.source, changes))).driving
        names = np.array(record.units)[record.unit]
        assert names[np.searchsorted(record.time, 149.8)] == "backshell"
        assert names[np.searchsorted(record.time, 150.2)] == "rover"

    @pytest.mark.parametrize(
        ("changes", "message"),
        [
            (
                ["telemetry.driving_from_s=150"],
                r"telemetry.driving_from_s: found 150.*expected telemetry.driving: rover",
            ),
            (
                ["telemetry.driving=rover", "telemetry.driving_from_s=300"],
                r"driving_from_s: found 300 s; expected a time",
            ),
        ],
    )
    def test_times_that_make_no_sense_are_refused(self, rover, changes, message):
        mission, tables, _, _ = rover
        with pytest.raises(InputError, match=message):
            mer_telemetry(tables, mer_setup(Mission.load(mission.source, changes)))

    def test_a_diagnosis_says_that_it_needs_the_other_imu(self, rover):
        mission = Mission.load(rover[0].source, ["telemetry.driving=rover"])
        with pytest.raises(InputError, match=r"telemetry.driving: found rover; a diagnosis compares"):
            require_prediction_inputs(mission)
