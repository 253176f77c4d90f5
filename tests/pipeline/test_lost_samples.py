"""A flight that lost a second of its IMU's samples is reconstructed as if it had not, or says how far it may be off."""

import shutil

import h5py
import numpy as np
import pytest
from faults import THREE_SIGMAS, across_parachute, outcome

from edl_filter.mission import Mission
from edl_filter.pipeline.reconstruct import reconstruct
from edl_filter.simulation import Scenario, simulate


@pytest.fixture
def lost_second(builtin_flight, tmp_path):
    """Reconstruction of the built-in flight without 8 samples (or with all) at a time, with both IMUs or one."""

    def run(two, lost=8, time=100.0):
        path = shutil.copy(builtin_flight, tmp_path / "flight.h5")
        with h5py.File(path, "a") as file:
            group = file["imu/primary"]
            first = int(np.searchsorted(group["time"][()], time))
            for key in ("time", "specific_force", "angular_rate"):
                values = np.delete(group[key][()], slice(first, first + lost), axis=0)
                del group[key]
                group[key] = values
            if not two:
                del file["imu/secondary"]
        return reconstruct(Mission.load("builtin:practice_mer", [f"telemetry.path={path}"]), leave_one_out=False)

    return run


def at_parachute(reconstruction):
    time = reconstruction.event_times["parachute_deploy"]
    node = int(np.argmin([abs(n.time - time) for n in reconstruction.filter_pass.nodes]))
    state, covariance = reconstruction.smoothed.states[node].nav[:6], reconstruction.smoothed.covariance[node]
    return state, np.sqrt(np.diag(covariance)[:6])


def altimeter_is_accepted(reconstruction):
    fused = [f for f in reconstruction.filter_pass.fused if f.constraint.name == "altimeter"]
    return len(fused) > 200 and all(f.accepted for f in fused)


def test_with_a_second_imu_the_parachute_opens_where_it_did(lost_second, practice_06):
    reconstruction = lost_second(True)
    state, _ = at_parachute(reconstruction)
    expected, _ = at_parachute(practice_06)
    assert np.linalg.norm(state[:3] - expected[:3]) < 50.0
    assert np.linalg.norm(state[3:] - expected[3:]) < 0.5
    assert altimeter_is_accepted(reconstruction)


def test_with_one_imu_the_parachute_is_within_its_sigmas(lost_second, practice_06):
    reconstruction = lost_second(False)
    state, sigma = at_parachute(reconstruction)
    expected, _ = at_parachute(practice_06)
    _, expected_sigma = at_parachute(lost_second(False, lost=0))
    assert np.all(np.abs(state - expected) < 3.0 * sigma)
    assert np.all(sigma >= 0.99 * expected_sigma)
    assert np.all(sigma[:3] < 2000.0)
    assert altimeter_is_accepted(reconstruction)


def test_without_the_opening_of_the_parachute_its_deployment_is_within_three_sigmas(lost_second, practice_06):
    """Two seconds about it are lost, and nothing else has them."""
    reconstruction = lost_second(False, lost=16, time=251.8)
    state, sigma = at_parachute(reconstruction)
    expected, _ = at_parachute(practice_06)
    assert np.all(np.abs(state - expected) < 3.0 * sigma)
    assert np.all(sigma[3:] < 5.0)
    assert altimeter_is_accepted(reconstruction)


@pytest.mark.slow
@pytest.mark.parametrize("vehicle", ["mer", "phoenix"])
def test_errors_without_the_opening_of_the_parachute_agree_with_their_sigmas(vehicle, tmp_path):
    """NEES of position and velocity over twelve flights: no more than twice its expectation, each within three sigmas.

    The motion in the shock is known by bounds, not by a distribution, so that its expectation is not met exactly.
    """
    scenario, squares = Scenario.load(f"builtin:{vehicle}"), []
    for seed in range(300, 312):
        flight = simulate(scenario, seed=seed)
        path = flight.write(tmp_path / f"{seed}.h5")
        with h5py.File(path, "a") as file:
            del file["imu/secondary"]
            across_parachute("primary")(file, 0.0, np.random.default_rng(0))
        mission = Mission.load(scenario.mission, [f"telemetry.path={path}"])
        row = outcome(reconstruct(mission, leave_one_out=False), flight.motion)
        assert row["trustworthy"], row["headline"]
        squares.append(row["square"])
    assert max(squares) < THREE_SIGMAS
    assert 0.4 < np.mean(squares) / 6.0 < 2.0
