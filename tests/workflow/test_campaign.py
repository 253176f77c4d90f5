"""Campaigns on processes of this machine: complete, resumed, extended; cases that fail, and a disk that is full."""

import json
import sys
from dataclasses import replace

import pytest

from edl_filter.errors import InputError
from edl_filter.workflow.campaign_files import CampaignJob, claim_folder, ranges_text, read_failures, read_records
from edl_filter.workflow.campaign_process import run_block


def test_all_cases_are_run_once_and_a_second_run_has_nothing_to_do(faults):
    outcome = faults.run(12)
    assert outcome.stopped == "" and outcome.sentence == "12 of 12 cases are done."
    assert sorted(faults.numbers("ended")) == list(range(12))
    assert [r["case"] for r in read_records(faults.results, 0)] == list(range(12))
    assert faults.run(12).stopped == "" and len(faults.numbers("begun")) == 12
    assert faults.run(15).progress.done.sum() == 15  # more cases are added to those that exist
    assert sorted(faults.numbers("begun")) == list(range(15))


@pytest.mark.slow
def test_cases_that_fail_are_kept_with_a_command_and_run_again_on_request(faults):
    faults.set(n1="raise", n2="hang", n4="exit")
    outcome = faults.run(8, time_limit_s=1.0)
    assert outcome.stopped == "" and outcome.progress.missing == []
    assert outcome.sentence == "5 of 8 cases are done, 3 failed."
    failures = {f["case"]: f for f in read_failures(faults.results)}
    assert {n: f["kind"] for n, f in failures.items()} == {1: "error", 2: "time limit", 4: "process ended"}
    assert failures[1]["message"] == "ZeroDivisionError: a case that raises"
    assert "faulty_cases.py" in failures[1]["traceback"]
    assert "longer than" in failures[2]["message"] and "exit code 7" in failures[4]["message"]
    assert all(f["command"].endswith(f"--case {n}") and f["seed"] == [1, n] for n, f in failures.items())
    begun = len(faults.numbers("begun"))
    assert faults.run(8, time_limit_s=1.0).progress.failed.sum() == 3  # failures are no missing cases
    assert len(faults.numbers("begun")) == begun
    faults.set()
    outcome = faults.run(8, retry=True)
    assert outcome.sentence == "8 of 8 cases are done." and read_failures(faults.results) == []
    assert sorted(faults.numbers("begun")[begun:]) == [1, 2, 4]


@pytest.mark.slow
def test_a_full_disk_ends_the_campaign_says_what_is_missing_and_it_resumes(faults):
    faults.set(**{f"n{n}": "full" for n in range(6, 40)})
    outcome = faults.run(40)
    missing = outcome.progress.missing
    assert set(missing) >= set(range(6, 40)) and outcome.progress.failed.sum() == 0
    assert "could not be written" in outcome.stopped and "File too large" in outcome.stopped
    done = 40 - len(missing)
    assert outcome.sentence == f"{done} of 40 cases are done, {len(missing)} are missing ({ranges_text(missing)})."
    assert len(faults.numbers("begun")) < 40  # no further case is begun
    assert [p for p in (faults.results / "cases").rglob(".*") if p.is_file()] == []
    faults.set()
    assert faults.run(40).sentence == "40 of 40 cases are done."
    assert set(faults.numbers("ended")) == set(range(40))


def test_another_campaign_is_refused_in_the_folder(faults):
    claim_folder(faults.results, faults.campaign(2))
    claim_folder(faults.results, faults.campaign(5))  # more cases of the same campaign
    campaign = faults.campaign(2).model_copy(update={"seed": 7})
    with pytest.raises(InputError, match=r"cases of another campaign \(seed differs\); name another folder with -o"):
        claim_folder(faults.results, campaign)
    identity = faults.results / "campaign.json"
    identity.write_text(json.dumps(json.loads(identity.read_text()) | {"version": "0.0.1"}))
    with pytest.raises(InputError, match=r"holds cases of edl-filter 0\.0\.1"):
        claim_folder(faults.results, faults.campaign(2))


def test_a_scheduler_that_does_not_answer_is_one_message(faults):
    with pytest.raises(InputError, match=r"--scheduler tcp://127\.0\.0\.1:1: no dask scheduler answers there"):
        faults.run(2, scheduler="tcp://127.0.0.1:1", patience_s=1.0)


def test_without_dask_the_message_names_the_extra(faults, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(InputError, match=r"edl-filter\[campaign\]"):
        faults.run(2)


def test_a_worker_of_another_version_runs_nothing(faults):
    job = replace(CampaignJob.of(faults.campaign(2), faults.results), version="0.0.1")
    outcome = run_block(job, [0, 1])
    assert "a worker has edl-filter" in outcome["not_written"] and faults.numbers("begun") == []


def test_ranges_of_numbers():
    assert ranges_text([]) == "" and ranges_text([4]) == "4"
    assert ranges_text([0, 1, 2, 5, 7, 8]) == "0-2, 5, 7-8"
    assert ranges_text([0, 2, 4, 6], most=2) == "0, 2 …"
