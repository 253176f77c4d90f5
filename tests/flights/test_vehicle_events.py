"""A flight whose vehicle changes in the aerodynamic phase: ballast is ejected, and the second IMU moves.

Mass, inertia, centre of mass and the positions of both IMUs change at 150 s, near peak deceleration. The mission states
what changed, as it does for a real flight.
"""

import numpy as np
import pytest
from scipy.stats import chi2

from edl_filter import rotations
from edl_filter.diagnosis.diagnosis import diagnose
from edl_filter.diagnosis.linear_model.flight_case import flight_case, load_case
from edl_filter.diagnosis.linear_model.linearization import linearize
from edl_filter.diagnosis.residual_analysis.residual_map import model_rms
from edl_filter.effects.base import EffectInstance
from edl_filter.effects.registry import catalogue, find_effect
from edl_filter.mission import Mission
from edl_filter.pipeline.reconstruct import reconstruct
from edl_filter.results import Result
from edl_filter.simulation import Scenario, simulate

CHANGE = (
    "mass: 812.0, centre_of_mass_shift: [0.03, 0.002, -0.0025], "
    "inertia: {xx: 264.0, yy: 199.0, zz: 203.0, xy: -1.5, xz: 0.8, yz: 0.6}, "
    "imu_positions: {secondary: [-0.4, 0.42, -0.2]}"
)
SCENARIO = f"events={{ballast: {{time_s: 150.0, {CHANGE}}}}}"
MISSION = f"vehicle.events={{ballast: {{time_s: 150.0, sigma_s: 0.02, {CHANGE}}}}}"
TIMES = (100.0, 149.0, 151.0, 200.0, 240.0, 300.0, 330.0)


def flown(folder, hidden=()):
    """A simulated flight, and the mission of it."""
    flight = simulate(Scenario.load("builtin:mer", [SCENARIO]), list(hidden), 1)
    path = flight.write(folder / "flight.h5")
    return flight, Mission.load("builtin:practice_mer", [f"telemetry.path={path}", MISSION])


@pytest.fixture(scope="module")
def flight_and_mission(tmp_path_factory):
    return flown(tmp_path_factory.mktemp("clean"))


@pytest.fixture(scope="module")
def reconstruction(flight_and_mission):
    return reconstruct(flight_and_mission[1])


def test_errors_are_as_large_as_stated(flight_and_mission, reconstruction):
    """Squared errors of position, velocity and attitude in units of their covariance, before and after the event."""
    truth, t = flight_and_mission[0].contents.truth, reconstruction.trajectory
    for time in TIMES:
        i, k = int(np.searchsorted(t.time, time - 1e-6)), int(np.searchsorted(truth["time"], time - 1e-6))
        rotation = rotations.multiply(truth["attitude"][k], rotations.conjugate(t.inertial_from_body[i]))
        error = np.concatenate((
            truth["position"][k] - t.position[i],
            truth["velocity"][k] - t.velocity[i],
            rotations.to_rotation_vector(rotation),
        ))  # fmt: skip
        assert error @ np.linalg.solve(t.covariance[i], error) < chi2.isf(1e-4, 9), time


def test_every_constraint_is_predicted_from_the_others(reconstruction):
    checks = {c.name: c for c in reconstruction.constraint_checks}
    assert {"landing", "altimeter", "parachute"} <= set(checks)
    for name, check in checks.items():
        assert np.all(check.accepted), name


def test_density_and_moments_after_the_event_are_those_of_the_new_vehicle(flight_and_mission, reconstruction):
    """The mass at entry would make the density 2.5 % too high, its centre of mass Cm and Cn wrong by 1.3e-3."""
    postflight, truth = Result(reconstruction).derived.postflight, flight_and_mission[0].contents.truth
    after = (postflight.time > 152.0) & (postflight.time < 240.0)
    true = np.interp(postflight.time[after], truth["time"], np.log(truth["density"]))
    assert np.mean(np.log(postflight.flight.atmosphere.density[after]) - true) == pytest.approx(0.0, abs=5e-3)
    for name in ("Cm", "Cn"):
        difference = postflight.flight.coefficients.value[name] - postflight.flight.database_measured.value[name]
        assert np.nanmean(difference[after]) == pytest.approx(0.0, abs=1e-4), name


def test_the_checking_imu_agrees_before_and_after_the_event(reconstruction):
    """With both IMUs' positions at entry its lateral residuals would be tens of sigmas after the event."""
    rms = model_rms(linearize(flight_case(reconstruction)))
    assert all(rms[f"secondary_force_{axis}"] < 1.2 for axis in "xyz"), rms
    assert all(rms[f"force_{axis}"] < 1.2 and rms[f"moment_{axis}"] < 1.2 for axis in "xyz"), rms


@pytest.mark.slow
def test_a_clean_flight_is_clean(reconstruction):
    diagnosis = diagnose(flight_case(reconstruction), catalogue().values())
    assert diagnosis.verdict.verdict == "clean", diagnosis.verdict.sentence


@pytest.mark.effects
@pytest.mark.parametrize(
    ("name", "imu", "values"),
    [
        ("com_offset", None, {"dx": 0.0, "dy": 0.004, "dz": -0.003}),
        ("imu_lever_arm", "secondary", {"dx": 0.03, "dy": -0.02, "dz": 0.04}),
    ],
)
def test_a_hidden_effect_is_named(name, imu, values, tmp_path):
    _, mission = flown(tmp_path, [EffectInstance(find_effect(name), values, imu)])
    diagnosis = diagnose(load_case(mission, ()), catalogue().values())
    assert diagnosis.verdict.verdict == "missing", diagnosis.verdict.sentence
    hypothesis = diagnosis.verdict.entries[0].hypothesis
    assert hypothesis.key == (name, imu), diagnosis.verdict.sentence
    estimate = hypothesis.fit.parameters((name, imu))
    for parameter, (value, sigma) in estimate.items():
        assert abs(value - values[parameter]) < 4.0 * sigma, (parameter, value, sigma)
