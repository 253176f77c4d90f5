"""One case: what is drawn, from seed and number alone."""

import numpy as np
import pytest

from edl_filter.errors import InputError
from edl_filter.imu_model.sensor_errors import SensorErrors
from edl_filter.simulation.campaign_config import Campaign
from edl_filter.simulation.dispersion import draw_case, load_flight

WIDE = {
    "initial_state": {"position_sigma": 100.0, "velocity_sigma": 2.0, "attitude_sigma_deg": 0.1},
    "imu_errors": 2.0, "air": {"density_sigma": 0.1}, "database": 1.0,
    "vehicle": {"mass_sigma": 0.01, "inertia_sigma": 0.02},
    "effects": [
        {"name": "accelerometer_bias", "probability": 0.5, "parameters": {"bx": {"low": 0.01, "high": 0.02}, "by": 0.0}}
    ],
}  # fmt: skip


def campaign_of(dispersion, flight=None, **more):
    flights = {"a": flight or {"scenario": "builtin:mer"}}
    return Campaign.from_dict({"name": "t", "cases": 400, "flights": flights, "dispersions": {"d": dispersion}} | more)


def draws(campaign, numbers):
    flight = load_flight(campaign, "a")
    return [draw_case(campaign, campaign.case(n), flight) for n in numbers]


def test_a_case_depends_on_seed_and_number_alone():
    campaign = campaign_of(WIDE)
    first, again = draws(campaign, [7]), draws(campaign, [3, 7])[1:]
    assert first[0].values == again[0].values and first[0].seed == again[0].seed
    assert np.array_equal(first[0].errors.database.continuum.CA, again[0].errors.database.continuum.CA)
    assert draws(campaign, [8])[0].seed != first[0].seed
    assert draws(campaign_of(WIDE, seed=2), [7])[0].seed != first[0].seed


def test_one_dispersion_does_not_change_what_another_draws():
    less = {key: value for key, value in WIDE.items() if key not in ("initial_state", "database")}
    (wide,), (narrow,) = draws(campaign_of(WIDE), [5]), draws(campaign_of(less), [5])
    assert narrow.errors.mass_factor == wide.errors.mass_factor and narrow.seed == wide.seed
    assert narrow.errors.database is None and not narrow.errors.start.any()


def test_draws_have_their_stated_distributions():
    no_database = {key: value for key, value in WIDE.items() if key != "database"}
    cases = draws(campaign_of(no_database), range(400))
    start = np.array([c.errors.start for c in cases])
    scale = np.repeat([100.0, 2.0, np.radians(0.1)], 3)
    np.testing.assert_allclose(start.std(axis=0) / scale, 1.0, atol=0.18)
    assert np.std([c.errors.mass_factor for c in cases]) == pytest.approx(0.01, rel=0.18)
    assert np.std([c.errors.inertia_factor for c in cases]) == pytest.approx(0.02, rel=0.18)
    assert all(c.errors.imu_scale == 2.0 for c in cases)
    present = [c for c in cases if c.hidden]
    assert 150 < len(present) < 250
    bx = [c.values["accelerometer_bias.bx"] for c in present]
    assert 0.01 <= min(bx) < 0.0115 and 0.0185 < max(bx) <= 0.02
    assert {c.values["accelerometer_bias.by"] for c in present} == {0.0}
    bz = np.std([c.values["accelerometer_bias.bz"] for c in present])
    assert bz == pytest.approx(5e-3, rel=0.25)  # the plausible size of the catalogue


def test_the_errors_of_a_measured_flight_are_in_its_model():
    dispersion = {key: value for key, value in WIDE.items() if key not in ("vehicle", "effects")}
    campaign = campaign_of(dispersion, {"mission": "builtin:mer_a"}, analysis="diagnose")
    cases = draws(campaign, range(60))
    assert {tuple(e.name for e in c.model_errors) for c in cases} == {("drawn_entry_state", "drawn_database")}
    assert cases[0].hidden == () and cases[0].effects[0].name == "drawn_air"
    sigmas = SensorErrors(1e-3, 0.0, 0.0, 0.0, 0.0)
    biases = [c.imu_errors(sigmas)[0].effect.force["bias"] for c in cases]
    assert np.std(biases) == pytest.approx(2e-3, rel=0.3)
    assert cases[0].values["imu_errors.accelerometer_bias_y"] == biases[0][1]
    # the attitude that was computed on board from the same gyros has their errors too
    gyros = cases[0].imu_errors(SensorErrors(1e-3, 1e-3, 1e-3, 1e-3, 1e-3))[0].effect.rate
    assert not gyros["bias"].any() and not gyros["scale"].any()
    assert draws(campaign_of({}, {"mission": "builtin:mer_a"}), [0])[0].imu_errors(sigmas) == ()


@pytest.mark.parametrize(
    ("effect", "message"),
    [
        ({"name": "winds"}, "wind"),
        ({"name": "wind", "parameters": {"q": 1.0}}, r"effects.0.parameters: found q; wind has"),
        ({"name": "wind", "imu": "primary"}, "wind sits in no IMU"),
        ({"name": "accelerometer_bias", "parameters": {"bx": 4.0}}, "found 4 in 1000 draws; expected m/s"),
    ],
)
def test_wrong_effects_are_one_message(effect, message):
    with pytest.raises(InputError, match=message):
        draws(campaign_of({"effects": [effect]}), [0])
