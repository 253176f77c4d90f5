"""Routes: listing, a result, residuals, and work that is begun, fails and is cancelled."""

import json
import time

import pytest


def wait(client):
    for _ in range(600):
        job = client.get("/api/job").json()["job"]
        if job["state"] != "running":
            return job
        time.sleep(0.05)
    raise AssertionError(job)


def test_the_page_and_its_parts(client):
    page = client.get("/")
    assert page.headers["content-type"].startswith("text/html")
    assert "http" not in page.text.replace("http-equiv", "")  # nothing from elsewhere
    for part in ("workbench.css", "workbench.js", "plotly.js"):
        assert part in page.text
        assert client.get(f"/{part}").status_code == 200


def test_library(client, root):
    told = client.get("/api/library").json()
    assert told["root"] == str(root)
    mine = told["missions"][0]
    assert (mine["name"], mine["commands"][1]) == ("flight.yaml", "edl-filter diagnose results/flight-2")
    assert told["results"] == [
        {"path": "results/flight", "title": "Practice flight, MER-like vehicle", "effects": [], "verdict": "missing"}
    ]


def test_result_with_commands(client):
    told = client.get("/api/result", params={"path": "results/flight"}).json()
    assert told["diagnosis"]["verdict"] == "missing"
    assert [s["path"] for s in told["steps"]] == ["results/flight"]
    assert told["diagnosing"] == ["edl-filter diagnose results/flight"]
    assert told["adding"]["wind"][0].startswith("edl-filter add ")
    assert " com_offset --from " in told["adding"]["com_offset"][0]
    assert told["comparing"] == []


def test_result_without_diagnosis(client, root):
    (root / "results/flight/diagnosis.json").unlink()
    told = client.get("/api/result", params={"path": "results/flight"}).json()
    assert (told["diagnosis"], told["adding"]) == (None, {})


def test_residual(client):
    told = client.get("/api/residual", params={"path": "results/flight", "channel": "force_y"}).json()
    assert told["residual"] == [5.0, 6.0, 7.0, 8.0]


@pytest.mark.parametrize("path", ["..", "../served/results/flight", "/etc", "out"])
def test_paths_that_lead_out(client, root, tmp_path, path):
    (tmp_path / "elsewhere").mkdir()
    (root / "out").symlink_to(tmp_path / "elsewhere")
    asked = [
        client.get("/api/result", params={"path": path}),
        client.get("/api/residual", params={"path": path, "channel": "force_x"}),
        client.post("/api/run", json={"mission": f"{path}/flight.yaml"}),
        client.post("/api/diagnose", json={"result": path}),
        client.post("/api/add", json={"result": path, "effect": "wind"}),
    ]
    for answer in asked:
        assert (answer.status_code, answer.json()["error"].startswith("Refused: ")) == (403, True), answer.text
    assert client.get("/api/job").json() == {"job": None}


@pytest.mark.parametrize(
    ("sent", "said"),
    [
        (b"[]", "The request holds no JSON object."),
        (b"{", "The request holds no JSON object."),
        (b"{}", "The request does not name its mission."),
        (b'{"mission": 3}', "The request does not name its mission."),
        (b'{"mission": "none.yaml"}', "none.yaml: found no such mission in the served folder."),
    ],
)
def test_requests_that_say_nothing_useful(client, sent, said):
    answer = client.post("/api/run", content=sent, headers={"Content-Type": "application/json"})
    assert (answer.status_code, answer.json()) == (400, {"error": said})


def test_too_long_a_request(client):
    assert client.post("/api/run", json={"mission": "x" * 20_000}).status_code == 413


def test_a_job_that_fails_says_why(client, root):
    text = (root / "flight.yaml").read_text()
    (root / "flight.yaml").write_text(text.replace("mass: 832.0 ", "mass: -1.0 "))
    answer = client.post("/api/run", json={"mission": "flight.yaml"})
    assert answer.status_code == 202
    job = wait(client)
    assert (job["state"], job["at"]) == ("failed", 0)
    assert job["error"].startswith("flight.yaml: vehicle.mass")
    assert not (root / "results" / "flight-2").exists()


def test_a_job_is_cancelled_and_leaves_nothing(client, root):
    client.post("/api/run", json={"mission": "flight.yaml"})
    while not (said := client.get("/api/job").json()["job"]["said"]):  # what the command tells of itself
        time.sleep(0.02)
    assert said.startswith("Reconstructing Practice flight, MER-like vehicle")
    again = client.post("/api/run", json={"mission": "flight.yaml"})
    assert again.status_code == 409
    assert "is still at work" in again.json()["error"]
    told = client.post("/api/cancel", json={}).json()["job"]
    assert told["state"] == "cancelled"
    assert wait(client)["result"] == "results/flight-2"
    left = root / "results" / "flight-2"
    assert not left.exists() or not list(left.iterdir())  # nothing half-written, and no result either


def test_a_job_that_is_done(client, root):
    text = (root / "flight.yaml").read_text()
    (root / "flight.yaml").write_text(text.replace("figures: true", "figures: false"))
    client.post("/api/run", json={"mission": "flight.yaml", "diagnose": False})
    job = wait(client)
    assert (job["state"], job["error"]) == ("done", "")
    assert json.loads((root / job["result"] / "summary.json").read_text())["mission"] == "practice_mer"
    assert job["result"] in [r["path"] for r in client.get("/api/library").json()["results"]]
