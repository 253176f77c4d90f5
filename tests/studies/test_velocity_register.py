"""The study of the velocity register: registers that are known, and that of Opportunity."""

import numpy as np
import pytest
import velocity_register as study
from scipy.spatial.transform import Rotation


@pytest.mark.parametrize("true", study.HYPOTHESES)
def test_a_register_is_that_of_its_hypothesis(true):
    """Axes, offset and scale are not known; the sum is computed sample by sample."""
    random = np.random.default_rng(0)
    force, rate = 20.0 * random.standard_normal((80, 3)), 0.8 * random.standard_normal((80, 3))
    interval = np.full(80, 0.125)
    increment_before, attitude_before = study.HYPOTHESES[true]
    attitude, velocity, register = [Rotation.identity()], np.zeros(3), [np.zeros(3)]
    for k in range(80):
        attitude.append(attitude[k] * Rotation.from_rotvec(rate[k] * 0.125))
        i, j = max(k - increment_before, 0), max(k - attitude_before, 0)
        velocity = velocity + (attitude[j] * Rotation.from_rotvec(0.0625 * rate[j])).apply(force[i]) * 0.125
        register.append(velocity)
    axes = Rotation.from_rotvec([0.4, -1.2, 2.0])
    read = 1.003 * axes.apply(register) + np.array([-30.0, 400.0, 7.0])
    for name, delays in study.HYPOTHESES.items():
        rms, scale = study.fitted(study.summed(force, rate, interval, *delays), read)
        steps = study.rms_of_steps(study.summed(force, rate, interval, *delays), read / 1.003)
        if name == true:
            assert rms < 1e-6 and scale == pytest.approx(0.003, abs=1e-9) and steps < 1e-9
        else:
            assert rms > 0.1 and steps > 0.1


def test_the_register_of_opportunity_is_one_increment_late():
    outcome = study.comparison("mer_b")
    rms = {name: value[0] for name, value in outcome.items()}
    assert rms["late, attitude of its cycle"] < 0.06 < 0.1 < rms["one increment late"] < 0.2
    assert rms["up to its row"] > 0.5
    for late, punctual in zip(outcome["late, attitude of its cycle"][2], outcome["up to its row"][2], strict=True):
        assert late < 0.5 * punctual


def test_axes_and_alignment_of_a_known_register():
    """The register of an on-board transform that adds shares of the axial force to the lateral ones."""
    random = np.random.default_rng(1)
    force = np.column_stack((-30.0 + 10.0 * random.standard_normal(200), 0.5 * random.standard_normal((200, 2))))
    interval, turn = np.full(200, 0.125), np.outer(np.arange(200), [0.025, 0.002, -0.003])
    attitude = Rotation.from_rotvec([0.3, 0.8, -2.0]) * Rotation.from_rotvec(turn)
    axes, shares = Rotation.from_rotvec([0.4, -1.2, 2.0]), np.array([1.3e-3, -0.4e-3])
    velocity, register = np.zeros(3), [np.zeros(3)]
    for k in range(200):
        onboard = force[k] + np.array([0.0, shares[0] * force[k, 0], shares[1] * force[k, 0]])
        velocity = velocity + attitude[k].apply(onboard) * interval[k]
        register.append(1.002 * axes.apply(velocity))
    index = np.arange(0, 201, 3)
    fit, alignment, rms = study.fitted_axes(force, interval, attitude, index, np.array(register)[index])
    assert rms < 1e-6
    np.testing.assert_allclose(fit, axes.as_matrix(), atol=1e-8)
    np.testing.assert_allclose(alignment, shares, atol=1e-8)


@pytest.mark.parametrize("rover", study.ROVERS)
def test_the_axes_of_the_rovers_registers_are_north_east_and_down_at_the_target(rover):
    """Neither the latitude of the target nor the pole is in the fit; the mission states what the fit gives."""
    mission, setup, tables = study.tables_of(rover)
    axes, alignment, rms = study.axes_and_alignment(tables, setup, *study.FIT)
    latitude, _, tilt = study.site(mission, axes, mission.event_times()["landing"])
    assert latitude == pytest.approx(study.TARGETS[rover][0], abs=0.05)
    assert abs(tilt) < 0.01
    assert rms < 0.03
    imu, register = mission.telemetry.imus["rover"], mission.telemetry.velocity_register
    np.testing.assert_allclose(register.frame_matrix, axes, atol=2e-5)
    np.testing.assert_allclose(imu.transformed_alignment, alignment, atol=0.0005 * np.pi / 180.0)
