"""Effects in the reconstruction and the model: off they change nothing, the true one sets a practice flight right."""

import json

import numpy as np
import pytest
from left_out import left_out_sigmas

from edl_filter.effects import EffectInstance
from edl_filter.effects.registry import find_effect
from edl_filter.errors import InputError
from edl_filter.mission import Mission
from edl_filter.pipeline.forward_model import forward_model_of
from edl_filter.pipeline.reconstruct import reconstruct
from edl_filter.postflight.flight import derived_quantities
from edl_filter.results import Result

#: Flight → vehicle, hidden effect, its true parameters (practice/answers.json).
HIDDEN = {
    1: ("mer", "wind", {"east": -37.58, "north": 33.544, "h_lo": 7773.8, "h_hi": 21531.9}),
    2: ("mer", "remnant_torque", {"Cl": -2.3194e-6, "Cm": 1.75337e-3, "Cn": 6.56712e-4, "t0": 129.0, "t1": 400.0}),
    3: ("phoenix", "com_offset", {"dy": 4.1216e-3, "dz": -3.09206e-3}),
    4: ("mer", "accelerometer_misalignment", {"my": 0.01127612, "mz": 0.00712172}),
    7: ("mer", "density_wave", {"A": 0.118368, "L": 14254.57, "phase": 3.15719}),
}


@pytest.fixture(scope="module")
def flown(practice):
    """Function that reconstructs a practice flight with its true effect, or without."""
    runs = {}

    def fly(n, on):
        if (n, on) not in runs:
            vehicle, name, values = HIDDEN[n]
            effects = json.dumps([{"name": name, "parameters": values}] if on else [])
            changes = [f"telemetry.path={practice(n)}", f"effects={effects}"]
            # the checks of the constraints are needed for one flight
            runs[n, on] = reconstruct(Mission.load(f"builtin:practice_{vehicle}", changes), leave_one_out=n == 4)
        return runs[n, on]

    return fly


@pytest.fixture(scope="module")
def postflight_of(flown):
    """Function that derives the post-flight layer of a flight of `flown`."""
    results = {}

    def get(n, on):
        if (n, on) not in results:
            results[n, on] = derived_quantities(flown(n, on)).postflight
        return results[n, on]

    return get


def test_no_effects_leave_every_number_bit_for_bit(practice_06):
    empty = reconstruct(Mission.load("builtin:practice_mer", ["effects=[]"]))
    assert empty.problem.planet is empty.planet and empty.effects == ()
    before, after = Result(practice_06).groups, Result(empty).groups
    assert before.keys() == after.keys()
    for path, group in before.items():
        for name, variable in group.variables.items():
            np.testing.assert_array_equal(after[path].variables[name].values, variable.values, f"{path}/{name}")


def test_effects_at_zero_change_nothing_that_counts(practice_06):
    names = ("gyro_bias", "com_offset", "gravity_oblateness", "density_wave", "wind", "atmosphere_rotation", "mass",
             "attitude_frame", "imu_time_offset", "imu_lever_arm", "accelerometer_misalignment")  # fmt: skip
    off = reconstruct(practice_06.mission, [EffectInstance(find_effect(name), {}) for name in names])
    np.testing.assert_allclose(off.trajectory.position, practice_06.trajectory.position, atol=1e-6)
    np.testing.assert_allclose(off.trajectory.velocity, practice_06.trajectory.velocity, atol=1e-9)
    without, reference = derived_quantities(off), derived_quantities(practice_06)
    np.testing.assert_allclose(without.air.velocity_body, reference.air.velocity_body, atol=1e-6)
    for name, values in reference.postflight.flight.coefficients.value.items():
        np.testing.assert_allclose(without.postflight.flight.coefficients.value[name], values, rtol=1e-6, atol=1e-10)


def test_the_true_misalignment_brings_landing_rest_and_the_other_imu_back(flown):
    before, after = flown(4, False), flown(4, True)
    nis = {s.name: s for s in before.constraint_checks}
    assert not nis["rest_gravity"].consistent and left_out_sigmas(nis["rest_velocity"]) > 3.0
    for s in after.constraint_checks:
        assert s.consistent and left_out_sigmas(s) < 3.0, s.name
    fits = [r.comparison["secondary"].windows[-1] for r in (before, after)]
    assert np.all(np.abs(fits[0].slope) > 20.0 * fits[0].slope_sigma)
    assert np.all(np.abs(fits[1].slope) < 3.0 * fits[1].slope_sigma)


def lateral_misses(d):
    """Spread of the flight's coefficients about the database's where the air is thick, from its post-flight layer."""
    thick = d.flight.coefficients.dynamic_pressure > 500.0
    miss = {
        k: (d.flight.coefficients.value[k] - d.flight.database_measured.value[k])[thick]
        for k in ("CN", "CY", "Cm", "Cn")
    }
    return {k: float(np.sqrt(np.nanmean(x**2))) for k, x in miss.items()}


#: What the alignment of the accelerometers leaves of CN and CY: three sigma, each 1e-4 rad times CA.
ALIGNMENT = 3.0 * 1e-4 * 1.7


@pytest.mark.parametrize(("n", "channels", "least"), [(1, ("Cm", "Cn"), 50.0), (3, ("Cm", "Cn"), 10.0)])
@pytest.mark.slow
def test_the_true_wind_and_centre_of_mass_bring_the_coefficients_back(postflight_of, n, channels, least):
    before, after = lateral_misses(postflight_of(n, False)), lateral_misses(postflight_of(n, True))
    for name in channels:
        assert after[name] < before[name] / least, (name, before[name], after[name])
    if n == 1:  # the wind changes the direction of the force too
        for name in ("CN", "CY"):
            assert after[name] < ALIGNMENT < before[name] / 5.0, (name, before[name], after[name])


def test_the_true_wave_is_in_the_expected_density(postflight_of):
    spread = []
    for on in (False, True):
        d = postflight_of(7, on)
        thick = d.flight.coefficients.dynamic_pressure > 500.0
        spread.append(np.nanstd((d.flight.atmosphere.density / d.preflight.atmosphere.density)[thick]))
    assert spread[0] > 0.07 and spread[1] < 0.01


@pytest.mark.parametrize(("n", "least"), [(1, 20.0), (2, 15.0), (3, 10.0)])
def test_the_world_with_the_true_effect_predicts_the_moments(flown, postflight_of, n, least):
    """Loads at the trajectory's own states against Euler's equations: what is left is sampling."""
    rms = []
    for on in (False, True):
        flight = flown(n, on)
        d, t = postflight_of(n, on), flight.trajectory
        forward_model = forward_model_of(flight.mission, flight.planet, flight.atmosphere)
        flow = forward_model.flow(t.time, t.position, t.velocity, t.inertial_from_body, t.angular_rate)
        _, moment = forward_model.loads(flow)
        expected = d.motion.smoother.smooth(0.5 * (moment[1:] + moment[:-1])[: len(d.time)])
        miss = (d.motion.moments.moment - expected)[d.time > 80.0, 1:]
        rms.append(np.sqrt(np.mean(miss**2)))
    assert rms[1] < rms[0] / least, rms


def test_oblateness_added_to_a_point_mass_is_the_mission_with_it(practice_06):
    j2 = practice_06.mission.planet.gravity.j2
    point = Mission.load("builtin:practice_mer", ["planet.gravity.j2=0"])
    added = reconstruct(point, [EffectInstance(find_effect("gravity_oblateness"), {"J2": j2})])
    assert added.planet.j2 == 0.0 and added.problem.planet.j2 == j2
    np.testing.assert_array_equal(added.trajectory.position, practice_06.trajectory.position)


def test_the_state_is_turned_and_the_imus_named(practice_06):
    turn = [EffectInstance(find_effect("attitude_frame"), {"rz": 1e-3})]
    initial = reconstruct(practice_06.mission, turn).problem.initial
    stated = practice_06.problem.initial
    assert np.linalg.norm(initial.position - stated.position) == pytest.approx(
        1e-3 * np.hypot(*stated.position[:2]), rel=1e-6
    )
    mission = Mission.load("builtin:practice_mer", ["effects=[{name: gyro_bias, imu: third}]"])
    with pytest.raises(InputError, match=r"effects.0.imu: found 'third', .* accepted: primary, secondary"):
        reconstruct(mission)


def test_a_prediction_needs_aerodynamics_and_inertia(practice_06):
    for key in ("aerodynamics", "vehicle.inertia"):
        mission = Mission.load("builtin:practice_mer", [f"{key}=null"])
        with pytest.raises(InputError, match=f"{key}: found nothing; a prediction needs it"):
            forward_model_of(mission, practice_06.planet, practice_06.atmosphere)


def test_a_run_says_which_effects_are_in_the_model(practice_06):
    from edl_filter.report.sentences import effect_lines
    from edl_filter.results.schema.summary import ModelEffect

    effects = [
        EffectInstance(find_effect("gyro_bias"), {"bx": 1e-5}, "secondary"),
        EffectInstance(find_effect("wind"), {}),
    ]
    estimates = Result(reconstruct(practice_06.mission, effects)).summary()["effects"]
    bias = estimates["gyro_bias in secondary"]
    assert (bias["imu"], bias["fixed"], list(bias["parameters"])) == ("secondary", False, ["bx", "by", "bz"])
    assert bias["parameters"]["bx"] == {"estimate": 1e-5, "sigma": None, "unit": "rad/s", "start": None}
    assert effect_lines({name: ModelEffect.of(e) for name, e in estimates.items()}) == [
        "Effect in the model: gyro_bias in secondary (bx 1e-05).",
        "Effect in the model: wind (off).",
    ]
    assert Result(practice_06).summary()["effects"] == {}
