"""Routes: library, results, figures, and jobs that succeed, fail or are cancelled."""

import base64
import json
import time

import numpy as np
import pytest
from contents import unknown

from edl_filter.report.description import Axis, Figure, Panel
from edl_filter.report.html.bundle import with_bundle
from edl_filter.report.residual_map import cell_colours, gradient

#: The force of the shipped flight at rest does not turn with the planet.
FINDING = "1 finding about samples; the report lists them."


def wait_for_job(client):
    for _ in range(600):
        job = client.get("/api/job").json()["job"]
        if job["state"] != "running":
            return job
        time.sleep(0.05)
    raise AssertionError(job)


def test_the_page_and_its_parts(client):
    page = client.get("/")
    assert page.headers["content-type"].startswith("text/html")
    assert "http" not in page.text.replace("http-equiv", "")  # no external resources
    for part in ("workbench.css", "workbench.js", "figures.js", "reconstruction.js", "plotly.js"):
        assert part in page.text
        assert client.get(f"/{part}").status_code == 200


def test_library(client, root):
    library = client.get("/api/library").json()
    assert library["root"] == str(root)
    mission = library["missions"][0]
    assert (mission["name"], mission["commands"][1]) == ("flight.yaml", "edl-filter diagnose results/flight-2")
    assert library["results"] == [
        {
            "path": "results/flight", "title": "Practice flight, MER-like vehicle", "effects": [],
            "verdict": "missing", "headline": None,
        }
    ]  # fmt: skip


def test_result_with_commands(client):
    result = client.get("/api/result", params={"path": "results/flight"}).json()
    assert result["diagnosis"]["verdict"] == "missing"
    assert [s["path"] for s in result["steps"]] == ["results/flight"]
    assert result["diagnosing"] == ["edl-filter diagnose results/flight"]
    assert result["adding"]["wind"][0].startswith("edl-filter add ")
    assert " com_offset --from " in result["adding"]["com_offset"][0]
    assert result["comparing"] == []
    assert (result["next"], result["next_commands"]) == ("Next: add wind to the model and refit it", [])


def test_an_unknown_flight_has_its_next_command(client, root):
    path = root / "results/flight/diagnosis.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | unknown() | {"none_gain": -700.0}))
    result = client.get("/api/result", params={"path": "results/flight"}).json()
    assert result["next_commands"] == ["edl-filter diagnose results/flight --file my_effect.py"]
    assert result["remarks"][0].startswith("“Nothing is missing” is excluded")


def test_result_without_diagnosis(client, root):
    (root / "results/flight/diagnosis.json").unlink()
    result = client.get("/api/result", params={"path": "results/flight"}).json()
    assert (result["diagnosis"], result["adding"]) == (None, {})


def test_overview_of_a_reconstruction(client, root):
    overview = client.get("/api/overview", params={"path": "results/flight"}).json()
    summary = json.loads((root / "results/flight/summary.json").read_text())
    assert overview["warnings"] == [FINDING] and overview["report"]
    for name, event in overview["events"].items():
        assert event["altitude_m"] == summary["events"][name]["altitude_m"]
    assert overview["events"].keys() == summary["events"].keys() >= {"parachute_deploy", "landing"}
    assert overview["constraints"]["landing"] == {"uses": 1, "accepted_uses": 1, "dof": 3} | {
        "nis": summary["constraints"]["landing"]["nis"], "verdict": "✓ accepted", "tone": "good"
    }  # fmt: skip
    curves = {trace["name"]: trace for trace in overview["trajectory"]["data"]}
    assert list(curves) == ["altitude", "velocity", "altitude (m)", "velocity (m/s)"]
    time, altitude = (unpacked(curves["altitude"][axis]) for axis in "xy")
    landing = summary["events"]["landing"]["time_s"]
    assert landing < time[-1] < landing + 3.0  # not the rest on the ground
    assert altitude[0] == pytest.approx(1e-3 * summary["events"]["entry_interface"]["altitude_m"], rel=1e-3)


def test_warnings_about_trust_come_first(client, root):
    path = root / "results/flight/summary.json"
    cause = {"kind": "clock", "sentence": "the clock", "gain": 9.0, "consistent": True}
    doubted = {"trustworthy": False, "headline": "Do not trust this result: it is a test.", "notes": ["A note."]}
    causes = [cause, cause | {"sentence": "a sign"}, cause | {"sentence": "no cause", "consistent": False}]
    path.write_text(json.dumps(json.loads(path.read_text()) | doubted | {"causes": causes}))
    overview = client.get("/api/overview", params={"path": "results/flight"}).json()
    warnings = overview["warnings"]
    assert overview["notes"] == ["A note."]
    assert warnings == [doubted["headline"], "Also consistent with the data: a sign.", FINDING]
    content = json.loads(path.read_text()) | {"trustworthy": True, "headline": None, "causes": []}
    content["constraints"]["parachute"] |= {"uses": 1, "accepted_uses": 0}
    path.write_text(json.dumps(content))
    warnings = client.get("/api/overview", params={"path": "results/flight"}).json()["warnings"]
    assert warnings == ["Parachute: 1 of 1 uses contradict all other data and were left out.", FINDING]
    path.unlink()
    (missing,) = client.get("/api/overview", params={"path": "results/flight"}).json()["warnings"]
    assert "found no summary" in missing


def test_the_report_is_in_a_sandbox(client, root):
    report = client.get("/report", params={"path": "results/flight"})
    assert report.text == with_bundle((root / "results/flight/report.html").read_text())
    assert "plotly.js v" in report.text
    policies = report.headers.get_list("content-security-policy")
    assert len(policies) == 1 and "sandbox allow-scripts" in policies[0] and "allow-same-origin" not in policies[0]
    assert report.headers["x-content-type-options"] == "nosniff"
    (root / "results/flight/report.html").unlink()
    assert client.get("/report", params={"path": "results/flight"}).status_code == 400


def unpacked(numbers):
    return np.frombuffer(base64.b64decode(numbers["bdata"]), "<f4")


def test_residual(client):
    residual = client.get("/api/residual", params={"path": "results/flight", "channel": "force_x"}).json()
    channel = residual["channel"]
    assert channel["unit"] == "m/s²" and residual["uses"] is None and residual["axes"]["span"] == [0.0, 3.0]
    expected = {"x": [0.0, 1.0, 2.0, 3.0], "y": [1.0, np.nan, 3.0, 4.0], "sigma": [0.5, np.nan, 1.5, 2.0]}
    for key, values in expected.items():  # a gap where the channel was not compared
        assert unpacked(channel[key]) == pytest.approx(values, nan_ok=True)


def test_innovations_of_a_constraint(client):
    residual = client.get("/api/residual", params={"path": "results/flight", "channel": "landing"}).json()
    assert residual["channel"] is None and residual["uses"]["once"] and len(residual["uses"]["values"]) == 3


def test_residual_that_does_not_exist(client, root):
    ask = {"path": "results/flight", "channel": "wind"}
    response = client.get("/api/residual", params=ask)
    assert response.status_code == 400
    assert response.json()["error"] == "residual: found 'wind'; accepted: force_x, force_y, landing."
    (root / "results/flight/diagnosis.json").unlink()
    assert "diagnose the result first" in client.get("/api/residual", params=ask).json()["error"]


def test_a_figure_without_finite_limits_is_displayed(client, monkeypatch):
    """JSON has no NaN: a response with it would be an error of the server."""
    figure = Figure("", ((Panel(Axis(range=(0.0, np.nan)), Axis(), ()),),), (1.0,))
    monkeypatch.setattr("edl_filter.serve.overview.altitude_velocity", lambda _: figure)
    response = client.get("/api/overview", params={"path": "results/flight"})
    assert response.json()["trajectory"]["layout"]["xaxis"]["range"] == [0.0, None]


def test_the_map_is_drawn_as_in_the_report(client):
    residual_map = client.get("/api/result", params={"path": "results/flight"}).json()["map"]
    assert residual_map["channels"] == ["force_x", "force_y"] and residual_map["regimes"] == ["hypersonic"]
    fails, holds, constraint = residual_map["drawn"]
    assert (fails["background"], fails["ink"]) == cell_colours(12.0, 12.0) and fails["text"] == "12.0"
    assert fails["sentence"].startswith("force x") and constraint["text"] == "0.90"
    assert holds == {}  # no RMS
    assert residual_map["worst"] == 12.0 and residual_map["gradient"] == gradient()


@pytest.mark.parametrize("path", ["..", "../served/results/flight", "/etc", "out"])
def test_paths_out_of_the_folder_are_refused(client, root, tmp_path, path):
    (tmp_path / "outside").mkdir()
    (root / "out").symlink_to(tmp_path / "outside")
    responses = [
        client.get("/api/result", params={"path": path}),
        client.get("/api/residual", params={"path": path, "channel": "force_x"}),
        client.get("/api/overview", params={"path": path}),
        client.get("/report", params={"path": path}),
        client.post("/api/run", json={"mission": f"{path}/flight.yaml"}),
        client.post("/api/improve", json={"mission": f"{path}/flight.yaml"}),
        client.post("/api/identifiability", json={"mission": f"{path}/flight.yaml"}),
        client.post("/api/diagnose", json={"result": path}),
        client.post("/api/add", json={"result": path, "effect": "wind"}),
    ]
    for response in responses:
        assert (response.status_code, response.json()["error"].startswith("Refused: ")) == (403, True), response.text
    assert client.get("/api/job").json() == {"job": None}


@pytest.mark.parametrize(
    ("body", "message"),
    [
        (b"[]", "The request holds no JSON object."),
        (b"{", "The request holds no JSON object."),
        (b"{}", "The request does not name its mission."),
        (b'{"mission": 3}', "The request does not name its mission."),
        (b'{"mission": "none.yaml"}', "none.yaml: found no such mission in the served folder."),
    ],
)
def test_incomplete_requests_are_refused(client, body, message):
    response = client.post("/api/run", content=body, headers={"Content-Type": "application/json"})
    assert (response.status_code, response.json()) == (400, {"error": message})


def test_a_long_request_is_refused(client):
    assert client.post("/api/run", json={"mission": "x" * 20_000}).status_code == 413


def test_a_failed_job_has_an_error_message(client, root):
    text = (root / "flight.yaml").read_text()
    (root / "flight.yaml").write_text(text.replace("mass: 832.0 ", "mass: -1.0 "))
    response = client.post("/api/run", json={"mission": "flight.yaml"})
    assert response.status_code == 202
    job = wait_for_job(client)
    assert (job["state"], job["at"]) == ("failed", 0)
    assert job["error"].startswith("flight.yaml: vehicle.mass")
    assert not (root / "results" / "flight-2").exists()


def run_until(client, root, pattern):
    """Start a run and wait for a file of its output."""
    client.post("/api/run", json={"mission": "flight.yaml"})
    for _ in range(2400):
        if list((root / "results" / "flight-2").glob(pattern)):
            return
        time.sleep(0.05)
    raise AssertionError(client.get("/api/job").json())


@pytest.mark.parametrize("held_client", ["while writing"], indirect=True)
def test_a_job_that_is_cancelled_while_it_writes_leaves_no_files(held_client, root):
    client = held_client
    run_until(client, root, ".*/result.nc")
    assert client.get("/api/job").json()["job"]["said"]  # current step of the command
    second = client.post("/api/run", json={"mission": "flight.yaml"})
    assert second.status_code == 409
    assert "is still at work" in second.json()["error"]
    job = client.post("/api/cancel", json={}).json()["job"]
    assert (job["state"], job["result"]) == ("cancelled", "results/flight-2")
    assert not (root / "results" / "flight-2").exists()  # neither temporary files nor a result


@pytest.mark.parametrize("held_client", ["after the result"], indirect=True)
def test_a_job_that_is_cancelled_after_its_result_was_written_leaves_it_whole(held_client, root):
    client = held_client
    run_until(client, root, "summary.json")
    assert client.post("/api/cancel", json={}).json()["job"]["state"] == "cancelled"
    folder = root / "results" / "flight-2"
    assert {path.name for path in folder.iterdir()} == {"result.nc", "summary.json", "tables"}
    assert client.get("/api/result", params={"path": "results/flight-2"}).status_code == 200


def test_a_finished_job(client, root):
    text = (root / "flight.yaml").read_text()
    (root / "flight.yaml").write_text(text.replace("figures: true", "figures: false"))
    client.post("/api/run", json={"mission": "flight.yaml", "diagnose": False})
    job = wait_for_job(client)
    assert (job["state"], job["error"]) == ("done", "")
    assert json.loads((root / job["result"] / "summary.json").read_text())["mission"] == "practice_mer"
    assert job["result"] in [r["path"] for r in client.get("/api/library").json()["results"]]
