"""The campaign file: messages, numbers of cases, paths."""

import copy
from pathlib import Path

import pytest

from edl_filter.errors import InputError
from edl_filter.simulation.campaign_config import Campaign

DATA = {
    "name": "t", "cases": 3,
    "flights": {"a": {"scenario": "builtin:mer"}, "b": {"scenario": "builtin:phoenix"}},
    "dispersions": {"x": {}, "y": {"imu_errors": 2.0}},
}  # fmt: skip


def changed(*path, value):
    data = copy.deepcopy(DATA)
    section = data
    for key in path[:-1]:
        section = section[key]
    section[path[-1]] = value
    return data


def test_more_cases_do_not_change_those_that_exist():
    few, many = Campaign.from_dict(DATA), Campaign.from_dict(changed("cases", value=30))
    assert few.total == 12 and many.total == 120
    assert [few.case(n) for n in range(12)] == [many.case(n) for n in range(12)]
    assert {(few.case(n).flight, few.case(n).dispersion) for n in range(4)} == set(few.groups)
    with pytest.raises(InputError, match="found case 12; expected 0 to 11"):
        few.case(12)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        ([1], "expected a mapping of keys"),
        (changed("flights", value={}), "flights: found no entry; expected at least one flight"),
        (changed("flights", "a", value={}), "found neither scenario nor mission; expected scenario: FILE"),
        (changed("flights", "a", value={"mission": "m.yaml", "scenario_set": ["seed=1"]}), "scenario_set without"),
        (changed("dispersions", "x", value={"databse": 1.0}), "nearest accepted: dispersions.x.database"),
        (changed("dispersions", "x", value={"air": {"density_sigma": 10.0}}), r"is it in %\?"),
        (changed("cases", value=0), "cases: found 0"),
        (
            changed("dispersions", "x", value={"effects": [{"name": "wind", "parameters": {"wE": {"low": 1.0}}}]}),
            "expected both, low not above high",
        ),
    ],
)
def test_wrong_input_is_one_message(data, message):
    with pytest.raises(InputError, match=message):
        Campaign.from_dict(data)


def test_what_a_measured_flight_cannot_have_is_refused():
    data = changed("flights", "b", value={"mission": "builtin:mer_a"})
    with pytest.raises(
        InputError, match=r"dispersions.y.vehicle: found mass or inertia; expected none: b is a measured"
    ):
        Campaign.from_dict(data | {"dispersions": {"y": {"vehicle": {"mass_sigma": 0.01}}}})
    database = {"dispersions": {"y": {"database": 1.0}}}
    with pytest.raises(InputError, match=r"does not depend on the database; or analysis: diagnose"):
        Campaign.from_dict(data | database)
    assert Campaign.from_dict(data | database | {"analysis": "diagnose"}).dispersions["y"].database == 1.0


def test_without_dispersions_there_is_one_that_draws_nothing():
    data = {key: value for key, value in DATA.items() if key != "dispersions"}
    assert Campaign.from_dict(data).groups == [("a", "nominal"), ("b", "nominal")]


def test_paths_start_from_the_folder_of_the_file(tmp_path):
    file = tmp_path / "campaign.yaml"
    file.write_text("name: t\ncases: 1\nflights: {a: {scenario: s.yaml}}\n")
    campaign = Campaign.load(file)
    assert campaign.path("s.yaml") == str(tmp_path / "s.yaml")
    assert campaign.path("builtin:mer") == "builtin:mer"
    with pytest.raises(InputError, match=r"no_file\.yaml"):
        Campaign.load(tmp_path / "no_file.yaml")


@pytest.mark.parametrize("file", sorted((Path(__file__).parents[2] / "missions" / "campaigns").glob("*.yaml")))
def test_shipped_campaigns_are_valid(file):
    from edl_filter.simulation.dispersion import draw_case, load_flight

    campaign = Campaign.load(file)
    for number in range(len(campaign.groups)):
        key = campaign.case(number)
        draw_case(campaign, key, load_flight(campaign, key.flight))
