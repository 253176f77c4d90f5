"""Messages of unknown keys, missing keys and unknown formats."""

import pytest
from shipped_missions import error_of, mission_data

from edl_filter.errors import InputError
from edl_filter.mission import Mission
from edl_filter.mission.error_messages import key_descriptions


def test_every_key_is_described():
    described = key_descriptions(Mission)
    assert not [key for key, text in described.items() if not text]
    assert described["planet.gravity.mu"] == "gravitational parameter, m^3/s^2"
    assert "telemetry.imus.*.gyro_noise" in described


@pytest.mark.parametrize(
    ("override", "nearest"),
    [
        ("planet.gravity.j3=0", "--set planet.gravity.j3: found an unknown key; nearest accepted: "),
        ("planet.gravity.j3=0", "nearest accepted: planet.gravity.j2"),
        ("planet.gravty.j2=0", "--set planet.gravty.j2: planet.gravty: found an unknown key; "),
        ("planet.gravty.j2=0", "nearest accepted: planet.gravity"),
        ("telemetry.imus.rover.gyro_nois=1", "nearest accepted: telemetry.imus.rover.gyro_noise"),
        ("j2=0", "nearest accepted: planet.gravity.j2"),
        ("constraints.rest.qqq=0", "accepted here: end_s"),
    ],
)  # fmt: skip
def test_unknown_keys_name_the_nearest(override, nearest):
    assert nearest in error_of(override)


def test_an_unknown_key_is_reported_before_the_missing_key_that_it_explains():
    stated = mission_data()
    stated["vehicle"]["masss"] = stated["vehicle"].pop("mass")
    with pytest.raises(InputError) as caught:
        Mission.from_dict(stated, "my.yaml")
    assert str(caught.value) == (
        "my.yaml: vehicle.masss: found an unknown key; nearest accepted: vehicle.mass (and 1 more problem)"
    )


def test_a_missing_key_is_named():
    with pytest.raises(InputError, match=r"telemetry\.path: found nothing; expected a required key \(flight"):
        Mission.load("builtin:practice_phoenix", ["telemetry={format: flight-file}"])
    stated = mission_data()
    del stated["planet"]["gravity"]["mu"], stated["vehicle"]["mass"], stated["name"]
    with pytest.raises(InputError, match=r"m: name: found nothing; .*\(and 2 more problems\)$"):
        Mission.from_dict(stated, "m")


def test_unknown_and_missing_formats():
    assert "telemetry: found format: 'x'; expected one of flight-file, mer-imu, phoenix-pds" in error_of(
        "telemetry.format=x"
    )
    assert "telemetry: found no key format" in error_of("telemetry={path: x}")
