"""Landing of a reconstruction, and records that end before it."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from edl_filter.results.landing import landing, landing_sample

TIME = np.arange(0.0, 100.5, 0.5)


@pytest.mark.parametrize(
    ("constraints", "events", "sample", "landed"),
    [
        ({"landing": 90.0}, {"landing": 80.0}, 180, True),
        ({}, {"landing": 80.2}, 160, True),
        ({}, {"landing": 100.0 + 5e-7}, 200, True),
        ({"rest_velocity": 95.0}, {}, 200, True),
        ({"parachute": 50.0}, {"landing": 344.0}, 200, False),
        ({}, {}, 200, False),
    ],
)
def test_the_landing_is_that_of_its_constraint_or_its_event(constraints, events, sample, landed):
    fused = [SimpleNamespace(constraint=SimpleNamespace(name=n, time=t)) for n, t in constraints.items()]
    flight = SimpleNamespace(
        trajectory=SimpleNamespace(time=TIME), event_times=events, filter_pass=SimpleNamespace(fused=fused)
    )
    assert landing_sample(flight) == (sample, landed)


def test_a_record_that_ends_in_flight_has_no_miss(practice_06):
    whole = practice_06.trajectory
    count = int(np.searchsorted(whole.time, 200.0)) + 1
    arrays = {name: getattr(whole, name)[:count] for name in ("time", "position", "velocity", "inertial_from_body")}
    in_flight = SimpleNamespace(fused=[])
    ended = landing(replace(practice_06, trajectory=replace(whole, **arrays), filter_pass=in_flight))
    assert not ended["landed"] and ended["miss_m"] is None and "site_lat_deg" not in ended and "left_out" not in ended
    assert ended["time_s"] == whole.time[count - 1]
    assert ended["radius_m"] == pytest.approx(np.linalg.norm(whole.position[count - 1]))
    assert landing(practice_06)["landed"]
