"""The command campaign: messages, one case, the report, and a whole campaign on one worker."""

import json

import pytest
from command_checks import assert_input_error

from edl_filter.simulation.campaign_config import Campaign
from edl_filter.workflow.campaign_files import claim_folder, write_failure, write_record

TEXT = """
name: small
cases: 4
leave_one_out: false
flights:
  spirit: {mission: builtin:mer_a}
dispersions:
  wide: {initial_state: {position_sigma: 200.0}}
"""


@pytest.fixture
def campaign_file(tmp_path):
    file = tmp_path / "small.yaml"
    file.write_text(TEXT)
    return file


def test_wrong_arguments_are_one_message(cli, campaign_file, tmp_path):
    assert_input_error(cli("campaign", "nowhere.yaml"), "nowhere.yaml")
    assert_input_error(cli("campaign", str(campaign_file), "folder"), "-o names the folder")
    both = cli("campaign", str(campaign_file), "--scheduler", "tcp://192.0.2.1:1", "--workers", "2")
    assert_input_error(both, "--workers", "leave one of them out")
    assert_input_error(cli("campaign", str(campaign_file), "--case", "4"), "found case 4; expected 0 to 3")
    assert_input_error(cli("campaign", "report"), "found no folder")
    assert_input_error(cli("campaign", "report", str(tmp_path)), "found no campaign.json")


def test_one_case_prints_its_record(cli, campaign_file):
    result = cli("campaign", str(campaign_file), "--case", "2")
    assert result.exit_code == 0, result.output
    record = json.loads(result.stdout)
    assert (record["case"], record["flight"], record["dispersion"]) == (2, "spirit", "wide")
    assert set(record["values"]["drawn"]) > {"initial_state.position_x"}


def test_the_report_of_complete_cases_names_failures(cli, campaign_file, tmp_path):
    folder = tmp_path / "results"
    folder.mkdir()
    campaign = Campaign.load(campaign_file)
    claim_folder(folder, campaign)
    for number in range(3):
        values = {
            "trustworthy": 1.0, "event_time": {"landing": 100.0 + number}, "landing_sigma": 1.0,
            "landing_position": {"x": 3.39e6, "y": 10.0 * number, "z": float(number**2)},
        }  # fmt: skip
        write_record(
            folder, {"case": number, "flight": "spirit", "dispersion": "wide", "values": values, "seconds": 1.0}
        )
    write_failure(folder, campaign, 3, "error", "ZeroDivisionError: oops")
    result = cli("campaign", "report", str(folder))
    assert result.exit_code == 0, result.output
    assert "Case 3 failed (error): ZeroDivisionError: oops" in result.stdout
    assert f"edl-filter campaign {campaign_file} --case 3" in result.stdout.replace("\n", " ")
    assert {p.name for p in (folder / "figures").iterdir()} == {"landing_ellipses.png", "event_percentiles.png"}
    content = json.loads((folder / "statistics.json").read_text())
    assert content["outcomes"] == {"done": 3, "failed": 1, "missing": 0}
    as_json = json.loads(cli("campaign", "report", str(folder), "--json").stdout)
    assert as_json["outcomes"] == content["outcomes"]


@pytest.mark.slow
def test_a_campaign_runs_reports_and_extends(cli, campaign_file, tmp_path):
    folder = tmp_path / "results"
    result = cli("campaign", str(campaign_file), "-o", str(folder), "--workers", "1", "--json")
    assert result.exit_code == 0, result.output
    assert json.loads(result.stdout) | {"folder": ""} == {
        "cases": 4, "done": 4, "failed": 0, "missing": 0, "folder": ""
    }  # fmt: skip
    alone = json.loads(cli("campaign", str(campaign_file), "--case", "1").stdout)
    kept = json.loads((folder / "cases" / "000000" / "000000001.json").read_text())
    assert kept["values"] == alone["values"]
    assert cli("campaign", "report", str(folder)).exit_code == 0
    campaign_file.write_text(TEXT.replace("cases: 4", "cases: 5"))
    again = cli("campaign", str(campaign_file), "-o", str(folder), "--workers", "1")
    assert "5 of 5 cases are done." in again.stdout
    campaign_file.write_text(TEXT.replace("200.0", "300.0"))
    refused = cli("campaign", str(campaign_file), "-o", str(folder))
    assert_input_error(refused, "cases of another campaign (dispersions differs)")
