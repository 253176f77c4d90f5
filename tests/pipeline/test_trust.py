"""Faults in the shipped flight: what the filter recovers, what is refused, and what is not trusted."""

from dataclasses import replace

import numpy as np
import pytest
from faulty_telemetry import SWAP_XZ, turned, with_altimeter

from edl_filter import rotations
from edl_filter.effects.base import EffectInstance
from edl_filter.effects.registry import catalogue
from edl_filter.effects.sensors import delayed
from edl_filter.errors import InputError
from edl_filter.mission import Mission
from edl_filter.navigation.recovery import run_with_recovery
from edl_filter.navigation.smoother import smooth
from edl_filter.pipeline.reconstruct import FlightInputs, assemble, lost_stretches, reconstruct
from edl_filter.pipeline.redundancy import contradicting
from edl_filter.pipeline.trust import check_record, judge
from edl_filter.simulation import Scenario, simulate
from edl_filter.telemetry.record import SampleFinding
from edl_filter.telemetry.sample_repair import repaired


def at_parachute(smoothed, telemetry):
    k = int(np.argmin(np.abs(smoothed.time - telemetry.parachute.time)))
    return smoothed.states[k].nav, np.sqrt(np.diag(smoothed.covariance[k]))


def test_a_clean_flight_is_not_changed_and_trusted(inputs, practice_06):
    mission, telemetry, planet, atmosphere = inputs
    problem = assemble(mission, telemetry, planet, atmosphere)
    same, _, recovery = run_with_recovery(problem)
    assert same is problem and recovery is None
    trust = judge(practice_06)
    assert trust.trustworthy and trust.headline is None and trust.causes == () and practice_06.recovery is None
    check_record(mission, telemetry, planet, atmosphere, problem)


@pytest.mark.parametrize("method", ["ukf", "ekf"])
@pytest.mark.parametrize("robust", ["none", "huber", "student_t"])
def test_one_altimeter_reading_in_seven_does_not_move_the_parachute(inputs, practice_06, method, robust):
    mission, telemetry, planet, atmosphere = inputs
    count = len(telemetry.altimeter.height)
    faulty = with_altimeter(telemetry, np.where(np.arange(count) % 7 == 0, 900.0, 0.0))
    problem = assemble(mission, faulty, planet, atmosphere)
    problem = replace(problem, settings=replace(problem.settings, method=method, robust=robust))
    _, filter_pass, recovery = run_with_recovery(problem)
    readings = [f for f in filter_pass.fused if f.constraint.name == "altimeter"]
    rejected = [k for k, f in enumerate(readings) if not f.accepted]
    assert recovery is None and contradicting(filter_pass) == {}
    assert set(range(0, count, 7)) <= set(rejected) and len(rejected) <= count // 7 + 3
    nav, sigma = at_parachute(smooth(filter_pass), telemetry)
    expected, _ = at_parachute(practice_06.smoothed, telemetry)
    assert np.abs(np.linalg.norm(nav[:3]) - np.linalg.norm(expected[:3])) < 5.0
    assert np.all(np.abs(nav[3:6] - expected[3:6]) < 3.0 * sigma[3:6])


def test_lost_samples_are_the_cause_of_a_contradiction(inputs, practice_06):
    mission, telemetry, planet, atmosphere = inputs
    driving = telemetry.driving
    lost = (driving.time > 100.0 - 0.06) & (driving.time < 100.94)
    first, last = np.flatnonzero(lost)[[0, -1]]
    keep = ~lost
    keep[last] = True  # one long sample, the mean of its neighbours, as the reader of flight files has it

    def fill(values):
        return np.where(lost[:, None], 0.5 * (values[first - 1] + values[last + 1]), values)

    filled = {q: fill(getattr(driving, q)) for q in ("specific_force", "angular_rate")}
    record = replace(driving, **filled, source=np.where(lost, 1, 0), sources=("flight file", "gap"))
    record = replace(record, interval=np.where(np.arange(len(lost)) == last, lost.sum() * 0.125, record.interval))
    faulty = replace(telemetry, driving=record.select(keep))
    assert lost_stretches(faulty.driving) == [pytest.approx((driving.time[first] - 0.125, driving.time[last]))]
    problem = assemble(mission, faulty, planet, atmosphere)
    changed, filter_pass, recovery = run_with_recovery(problem, lost_stretches(faulty.driving))
    assert recovery is not None and recovery.cause == "gap"
    assert (recovery.start, recovery.end) == pytest.approx((driving.time[first] - 0.125, driving.time[last]), abs=1e-6)
    assert np.count_nonzero(changed.samples.force_noise > problem.samples.force_noise) <= 2 * 3
    assert contradicting(filter_pass) == {}
    nav, sigma = at_parachute(smooth(filter_pass), telemetry)
    expected, _ = at_parachute(practice_06.smoothed, telemetry)
    assert np.all(np.abs(nav[:6] - expected[:6]) < 4.0 * sigma[:6])
    assert np.linalg.norm(nav[3:6] - expected[3:6]) < 3.0


@pytest.mark.parametrize("name", ["primary", "secondary"])
def test_exchanged_axes_of_a_whole_record_are_named_with_the_imu(inputs, name):
    # an exchange of body axes may be a sign in the axes of an IMU that is mounted obliquely: the same statement
    mission, telemetry, planet, atmosphere = inputs

    def exchanged(record):
        return replace(
            record, specific_force=record.specific_force[:, [1, 0, 2]], angular_rate=record.angular_rate[:, [1, 0, 2]]
        )

    records = [exchanged(r) if r.name == name else r for r in (telemetry.driving, *telemetry.checking)]
    faulty = replace(telemetry, driving=records[0], checking=tuple(records[1:]))
    with pytest.raises(InputError, match=f"axes of the .* in the accelerometers and gyros of IMU {name}"):
        check_record(mission, faulty, planet, atmosphere, assemble(mission, faulty, planet, atmosphere))


@pytest.mark.parametrize(
    ("matrix", "quantity", "finding", "cause"),
    [
        (np.diag([-1.0, 1.0, 1.0]), "specific_force", "points to +x of the body axes; drag points to -x", "sign of x"),
        pytest.param(
            SWAP_XZ,
            "specific_force",
            "points to -z of the body axes",
            "x and z exchanged in the accelerometers",
            marks=pytest.mark.slow,
        ),
        (np.eye(3) / 9.80665, "specific_force", "from an entry speed of 5400 m/s", "in g instead of m/s^2"),
        (np.eye(3) * 180.0 / np.pi, "angular_rate", "a rigid body has one rate", "its angular rate is in deg/s"),
    ],
)
def test_impossible_records_are_refused(inputs, matrix, quantity, finding, cause):
    mission, telemetry, planet, atmosphere = inputs
    faulty = turned(telemetry, matrix, quantity)
    problem = assemble(mission, faulty, planet, atmosphere)
    with pytest.raises(InputError) as refusal:
        check_record(mission, faulty, planet, atmosphere, problem)
    assert finding in str(refusal.value) and cause in str(refusal.value)
    unchecked = Mission.load("builtin:practice_mer", ("filter.sanity_check=false",))
    check_record(unchecked, faulty, planet, atmosphere, problem)


@pytest.mark.parametrize(
    ("begin", "end", "reason"),
    [(248.0, 258.0, "the parachute's inflation from 252.7 s on is among"), (253.0, 254.0, None), (180.0, 183.0, None)],
    ids=["across the inflation", "a second of it", "before it"],
)
def test_an_inflation_that_no_imu_has_is_named(inputs, begin, end, reason):
    mission, telemetry, _, atmosphere = inputs
    driving = telemetry.driving
    lost = (driving.time > begin) & (driving.time <= end)
    values = {k: np.where(lost[:, None], np.nan, getattr(driving, k)) for k in ("specific_force", "angular_rate")}
    finding = SampleFinding(driving.name, "all", begin, end, int(lost.sum()), "missing")
    gap = replace(telemetry, driving=replace(driving, **values), checking=(), findings=(finding,))
    gap = repaired(gap, parachute=telemetry.events["parachute_deploy"])
    result = reconstruct(mission, leave_one_out=False, inputs=FlightInputs(gap, atmosphere), compare_imus=False)
    trust = judge(result)
    assert trust.trustworthy == (reason is None)
    assert trust.headline is None if reason is None else reason in trust.headline


def test_an_attitude_of_which_nothing_is_known_is_named(practice_06):
    samples = practice_06.problem.samples
    filled = replace(samples, rate_fill_sigma=np.where((samples.time > 150.0)[:, None], 1e-6, np.zeros((1, 3))))
    lost = replace(practice_06, problem=replace(practice_06.problem, samples=filled))
    assert judge(lost).trustworthy
    nodes = [
        replace(n, transition=replace(n.transition, covariance=100.0 * np.eye(len(n.covariance))))
        if n.transition is not None and n.time > 160.0
        else n
        for n in lost.filter_pass.nodes
    ]
    unknown = judge(replace(lost, filter_pass=replace(lost.filter_pass, nodes=nodes)))
    assert not unknown.trustworthy and "its sigma is 573 degrees" in unknown.headline
    unsettled = judge(replace(lost, filter_pass=replace(lost.filter_pass, converged=False)))
    assert not unsettled.trustworthy and "no stable solution" in unsettled.headline


@pytest.mark.parametrize(
    ("height", "delay", "words"),
    [
        (100.0, 0.0, "m above the surface"),
        (-100.0, 0.0, "m below the surface"),
        (20.0, 0.0, "m above the surface"),
        pytest.param(0.0, 1.0, "the times of the altimeter are about", marks=pytest.mark.slow),
        (0.0, 0.25, "m above the surface"),
        (4.0, 0.0, None),
    ],
    ids=["high", "low", "slightly high", "late", "slightly late", "relief"],
)
def test_an_altimeter_by_which_the_vehicle_is_not_on_the_ground_is_not_trusted(inputs, height, delay, words):
    mission, telemetry, _, atmosphere = inputs
    altimeter = telemetry.altimeter
    wrong = replace(altimeter, height=altimeter.height + height, time=altimeter.time + delay)
    faulty = FlightInputs(replace(telemetry, altimeter=wrong), atmosphere)
    trust = judge(reconstruct(mission, leave_one_out=False, inputs=faulty, compare_imus=False))
    assert trust.trustworthy == (words is None)
    assert trust.headline is None if words is None else words in trust.headline
    if abs(height) >= 20.0:
        assert float(trust.headline.split("touched down ")[1].split(" m ")[0]) == pytest.approx(abs(height), abs=4.5)


def test_a_surface_that_may_be_far_from_the_ground_says_nothing_about_the_altimeter(inputs):
    _, telemetry, _, atmosphere = inputs
    mission = Mission.load("builtin:practice_mer", ("constraints.altimeter.relief_sigma=1000",))
    altimeter = replace(telemetry.altimeter, height=telemetry.altimeter.height + 100.0)
    faulty = FlightInputs(replace(telemetry, altimeter=altimeter), atmosphere)
    assert judge(reconstruct(mission, leave_one_out=False, inputs=faulty, compare_imus=False)).trustworthy


@pytest.mark.parametrize("late", [-5.0, 5.0, 30.0])
def test_a_deployment_without_an_opening_shock_is_not_trusted(inputs, late):
    """The readings show the parachute's opening, and where; half a second off is the time of its inflation."""
    mission, telemetry, _, atmosphere = inputs
    actual = telemetry.parachute.time

    def judged(time):
        events = telemetry.events | {"parachute_deploy": time}
        moved = replace(telemetry, parachute=replace(telemetry.parachute, time=time), events=events)
        return judge(reconstruct(mission, leave_one_out=False, inputs=FlightInputs(moved, atmosphere)))

    trust = judged(actual + late)
    assert not trust.trustworthy and f"stated deployment at {actual + late:.1f} s" in trust.headline
    at = float(trust.headline.split(" times at ")[1].split(" s")[0])
    assert at == pytest.approx(actual, abs=0.5)
    assert judged(actual - 0.5).trustworthy


@pytest.mark.parametrize(("ratio", "unknown"), [(2e-2, "attitude"), (1e-3, "velocity"), (1e-4, None)])
def test_one_imu_at_another_rate_than_stated_leaves_attitude_or_velocity_unknown(inputs, ratio, unknown):
    """It turns by some 60 rad before the parachute; the error model is linear up to a fifth of a radian.

    Gravity gives 940 m/s up to there; the velocity has a sigma of half a meter a second with a ratio of 1e-3.
    """
    mission, telemetry, _, atmosphere = inputs
    driving = replace(telemetry.driving, stated_interval=telemetry.driving.stated_interval * (1.0 + ratio))
    single = repaired(replace(telemetry, driving=driving, checking=()), parachute=telemetry.parachute.time)
    assert [f.kind for f in single.findings] == ["clock_drift", "rest_drift"]
    trust = judge(reconstruct(mission, leave_one_out=False, inputs=FlightInputs(single, atmosphere)))
    assert trust.trustworthy == (unknown is None)
    if unknown:
        assert f"{-100.0 * ratio / (1.0 + ratio):+.2g} %" in trust.headline
        assert f"the {unknown} is uncertain by" in trust.headline
    if unknown == "velocity":
        assert float(trust.headline.split("uncertain by ")[1].split(" m/s")[0]) == pytest.approx(0.94, abs=0.01)


def test_a_wrong_mounting_of_the_checking_imu_is_not_blamed_on_the_altimeter(inputs):
    """The driving record agrees with every measurement, so that nothing is a cause by its likelihood."""
    mission, telemetry, planet, atmosphere = inputs
    turn = rotations.to_matrix(rotations.from_rotation_vector([0.9, -1.2, 0.7]))
    checking = telemetry.checking[0]
    turned_readings = {q: getattr(checking, q) @ turn.T for q in ("specific_force", "angular_rate")}
    wrong = replace(telemetry, checking=(replace(checking, **turned_readings),))
    with pytest.raises(InputError, match="secondary differ by") as error:
        check_record(mission, wrong, planet, atmosphere, assemble(mission, wrong, planet, atmosphere))
    assert "altimeter" not in str(error.value) and "clock" not in str(error.value)


def test_force_and_rate_with_different_clocks_are_not_trusted_unless_the_model_has_them(inputs):
    mission, telemetry, _, atmosphere = inputs
    record = telemetry.driving
    late = replace(record, angular_rate=delayed(record.time, record.angular_rate, 0.05))
    checked = repaired(replace(telemetry, driving=late), parachute=telemetry.parachute.time)
    (finding,) = (f for f in checked.findings if f.kind == "delay")
    run = reconstruct(mission, leave_one_out=False, inputs=FlightInputs(checked, atmosphere))
    headline = judge(run).headline
    assert "the rate 0.050 s earlier than primary" in finding.repair and finding.repair.split(";")[0] in headline
    assert "different clocks" in headline and "imu_time_offset" in headline
    for tau, named in ((0.05, False), (0.0, True)):
        with_effect = replace(run, effects=(EffectInstance(catalogue()["imu_time_offset"], {"tau": tau}),))
        assert ("different clocks" in str(judge(with_effect).headline)) is named


@pytest.mark.parametrize(
    ("vehicle", "interval", "frequency"), [("mer", 0.25, 3.0), ("phoenix", 0.25, 2.2), ("mer", 0.125, None)]
)
def test_swinging_under_a_parachute_that_the_samples_do_not_resolve(tmp_path, vehicle, interval, frequency):
    """The pendulum's frequency follows from mass, inertia, half a diameter and the largest force of the opening."""
    scenario = Scenario.load(f"builtin:{vehicle}", [f"sampling.interval_s={interval}", "sampling.substeps=20"])
    path = simulate(scenario, (), 3).write(tmp_path / "flight.h5")
    mission = Mission.load(f"builtin:practice_{vehicle}", [f"telemetry.path={path}"])
    trust = judge(reconstruct(mission))
    if frequency is None:
        assert trust.trustworthy
        return
    assert not trust.trustworthy and f"samples at {1.0 / interval:g} Hz" in trust.headline
    assert float(trust.headline.split("up to about ")[1].split(" Hz")[0]) == pytest.approx(frequency, abs=0.15)
