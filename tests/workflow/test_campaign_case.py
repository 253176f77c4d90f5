"""One case: its record, that it can be repeated, and that it is what the commands for one flight compute."""

from types import SimpleNamespace

import contents
import numpy as np
import pytest

from edl_filter.effects.base import EffectInstance, key_of
from edl_filter.effects.registry import find_effect
from edl_filter.mission import Mission
from edl_filter.pipeline.load import check_settings
from edl_filter.pipeline.reconstruct import FlightInputs, reconstruct
from edl_filter.results.campaign_variables import VARIABLES
from edl_filter.results.verdicts import VERDICTS
from edl_filter.simulation import Scenario, simulate
from edl_filter.simulation.campaign_config import Campaign
from edl_filter.workflow import campaign_case
from edl_filter.workflow.campaign_case import CaseRunner, landing_values

CAMPAIGN = {
    "name": "t", "cases": 5,
    "flights": {"simulated": {"scenario": "builtin:mer"}, "spirit": {"mission": "builtin:mer_a"}},
    "dispersions": {
        "stated": {},
        "wide": {
            "initial_state": {"position_sigma": 200.0}, "imu_errors": 1.0, "air": {"density_sigma": 0.05},
            "effects": [{"name": "wind"}],
        },
    },
}  # fmt: skip


def comparable(record):
    """A record without its computing times."""
    return {key: value for key, value in record.items() if not key.endswith("seconds")}


@pytest.fixture(scope="module")
def runner():
    return CaseRunner(Campaign.from_dict(CAMPAIGN))


@pytest.fixture(scope="module")
def records(runner):
    return {number: runner.run(number) for number in range(4)}


def test_records_have_known_variables_only(records):
    assert [(r["flight"], r["dispersion"]) for r in records.values()] == [
        ("simulated", "stated"), ("simulated", "wide"), ("spirit", "stated"), ("spirit", "wide")
    ]  # fmt: skip
    for record in records.values():
        assert set(record["values"]) <= set(VARIABLES)
        assert record["values"]["trustworthy"] == 1.0
    assert records[1]["hidden"] == ["wind"] and records[0]["hidden"] == []


def test_a_case_is_the_same_alone_and_in_another_process_of_the_campaign(records):
    alone = CaseRunner(Campaign.from_dict(CAMPAIGN | {"cases": 50}))
    for number in (3, 1):
        assert comparable(alone.run(number)) == comparable(records[number])


def test_an_undispersed_simulated_case_is_the_flight_of_its_seed(records, tmp_path):
    scenario = Scenario.load("builtin:mer")
    path = simulate(scenario, seed=records[0]["seed"]).write(tmp_path / "flight.h5")
    reconstruction = reconstruct(Mission.load("builtin:practice_mer", [f"telemetry.path={path}"]))
    expected, values = landing_values(reconstruction), records[0]["values"]
    for name in ("landing_position", "predicted_landing_position"):
        np.testing.assert_allclose(list(values[name].values()), list(expected[name].values()), atol=1e-3)
    assert values["landing_sigma"] == pytest.approx(expected["landing_sigma"], rel=1e-6)


def test_an_undispersed_measured_case_is_its_reconstruction(records):
    reconstruction = reconstruct(Mission.load("builtin:mer_a"))
    values = records[2]["values"]
    expected = landing_values(reconstruction)["landing_position"]
    assert values["landing_position"] == expected
    checks = {c.name: c for c in reconstruction.constraint_checks}
    assert values["left_out_nis"]["landing"] == checks["landing"].left_out_nis
    assert values["drawn"] == {} and "state_error" not in values
    # drawn errors do not contradict the attitude that was computed on board
    assert records[3]["values"]["nis"]["onboard_attitude"] < 2.0 * records[3]["values"]["dof"]["onboard_attitude"]
    moved = records[3]["values"]["predicted_landing_position"]
    assert np.linalg.norm(np.subtract(list(moved.values()), list(values["predicted_landing_position"].values()))) > 1.0


def test_errors_of_the_state_are_those_of_the_truth(records):
    values = records[0]["values"]
    error = np.array(list(values["state_error"]["rest"].values()))
    sigma = np.array(list(values["state_sigma"]["rest"].values()))
    assert np.all(np.abs(error) < 6.0 * sigma) and np.all(sigma > 0.0)
    assert 0.0 < values["nees"]["entry"]["all"] < 40.0
    difference = np.subtract(*(list(values[n].values()) for n in ("landing_position", "true_landing_position")))
    assert np.linalg.norm(difference) < 6.0 * values["landing_sigma"] + 30.0


@pytest.mark.parametrize(
    ("imu", "label", "same_as", "right"),
    [
        ("secondary", "gyro_scale in secondary", [], 1.0),
        ("secondary", "gyro_scale", [], 0.0),  # in the driving IMU
        ("secondary", "mass", ["gyro_scale in secondary"], 1.0),
        ("primary", "gyro_scale", [], 1.0),  # the driving IMU, named in the campaign
        (None, "gyro_scale", [], 1.0),
        (None, "gyro_scale in secondary", [], 0.0),
    ],
)
def test_a_sensor_effect_is_right_in_its_own_imu_only(runner, monkeypatch, imu, label, same_as, right):
    """And both IMUs have a probability of their own."""
    key = key_of(label)
    ranking = [
        contents.hypothesis(effect=key[0], imu=key[1], label=label, same_as=same_as, probability=0.8),
        contents.hypothesis(effect=key[0], imu="elsewhere", label=f"{key[0]} in elsewhere", probability=0.1),
    ]
    diagnosis = SimpleNamespace(content=lambda: contents.diagnosis(ranking=ranking))
    monkeypatch.setattr("edl_filter.diagnosis.diagnosis.diagnose", lambda *_: diagnosis)
    monkeypatch.setattr("edl_filter.diagnosis.linear_model.flight_case.flight_case", lambda _: None)
    monkeypatch.setattr(campaign_case, "reconstruct", lambda *_, **__: None)
    flight = runner._flight("simulated")
    flown = simulate(flight.scenario, (), 1)
    inputs = FlightInputs(flown.telemetry(check_settings(flight.mission)))
    hidden = EffectInstance(find_effect("gyro_scale"), {"sx": 1e-3}, imu)
    values = campaign_case.diagnosis_values(flight, inputs, (), (hidden,))
    assert values["leader_right"] == right and values["named"] == 1.0
    assert values["probability"] == {label: 0.8, f"{key[0]} in elsewhere": 0.1}
    assert VERDICTS[int(values["verdict"])] == "missing"
