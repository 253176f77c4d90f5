"""Contents of a summary."""

import io
import json
from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console

from edl_filter.report.terminal.run import constraints_table, information_table
from edl_filter.report.text import constraint_verdict
from edl_filter.results.files import finite
from edl_filter.results.schema.summary import ConstraintSummary
from edl_filter.results.summary import constraint


def test_summary(written, practice_06):
    summary = json.loads(written["summary"].read_text(), parse_constant=lambda c: pytest.fail(f"{c} in JSON"))
    assert set(summary["events"]) >= {"parachute_deploy", "peak_deceleration", "landing", "entry_interface"}
    assert {"time_s", "altitude_m", "velocity_m_s", "mach", "dynamic_pressure_pa"} <= set(
        summary["events"]["parachute_deploy"]
    )
    assert (summary["gas"]["name"], summary["gas"]["constant"]) == ("thesis", 188.92)
    assert summary["gas"]["heat_capacity_ratio_200_k"] == 1.3
    landing = summary["landing"]
    assert landing["miss_m"] < 3.0 * landing["sigma_m"]
    assert landing["left_out"]["miss_m"] < 3.0 * landing["left_out"]["sigma_m"]
    for statement in practice_06.constraint_checks:
        c = summary["constraints"][statement.name]
        assert c["nis"] == pytest.approx(float(statement.nis.sum()))
        assert len(c["innovation"]) == len(c["components"])
    assert summary["residuals"] == {}  # the run has no effects, so that only a diagnosis compares it with its model
    innovation_rms = summary["innovation_rms"]
    assert innovation_rms.keys() == summary["constraints"].keys()
    for name, by_component in innovation_rms.items():
        assert tuple(by_component) == tuple(summary["constraints"][name]["components"])
        assert all(0.0 <= rms < 5.0 for rms in by_component.values())
    assert {"telemetry", "filter", "smoother", "write"} <= set(summary["timing_s"])


def test_landing_and_events_are_stated_in_local_axes(written, practice_06):
    content = written["content"]
    for place in (content["landing"], content["landing"]["left_out"]):
        assert place["miss_m"] == pytest.approx(np.hypot(place["miss_east_m"], place["miss_north_m"]))
        assert place["sigma_m"] == pytest.approx(np.hypot(place["sigma_east_m"], place["sigma_north_m"]))
        assert place["sigma_up_m"] > 0.0
    statement = next(s for s in practice_06.constraint_checks if s.name == "landing")
    out = content["landing"]["left_out"]
    length = np.linalg.norm([out[f"miss_{a}_m"] for a in ("east", "north", "up")])
    assert length == pytest.approx(np.linalg.norm(statement.left_out))
    landed, deployed = content["events"]["landing"], content["events"]["parachute_deploy"]
    assert np.hypot(landed["east_m"], landed["north_m"]) < 200.0
    assert deployed["up_m"] == pytest.approx(deployed["height_above_site_m"], abs=10.0)
    speed = np.linalg.norm([deployed[f"velocity_{a}_m_s"] for a in ("east", "north", "up")])
    assert speed == pytest.approx(deployed["velocity_m_s"], abs=0.1)


def test_what_compares_nothing_has_no_verdict(practice_06):
    row = constraint(replace(practice_06.constraint_checks[0], dof=0))
    assert row["nis_interval_99_9"] is None and row["consistent"] is None
    assert (row["accepted"], row["accepted_uses"], row["uses"]) == (True, 1, 1)
    model = ConstraintSummary.of(row)
    assert constraint_verdict(model) == ("– not judged", "muted")
    console = Console(width=120, record=True, file=io.StringIO())
    console.print(constraints_table({"entry_state": model}))
    assert "nan" not in console.export_text()


def test_information_gains_are_in_the_summary_and_the_terminal(written, practice_06):
    checks = {s.name: s for s in practice_06.constraint_checks}
    rows = written["content"]["constraints"]
    for name, s in checks.items():
        assert rows[name]["left_out_information_nats"] == pytest.approx(s.left_out_information)
    assert np.isnan(rows["entry_state"]["information_nats"])  # the filter starts with it
    assert rows["altimeter"]["information_nats"] == pytest.approx(checks["altimeter"].information.sum())
    # 261 heights repeat each other and the landing: beyond the others they gain less than in order
    assert 0.0 < rows["altimeter"]["left_out_information_nats"] < rows["altimeter"]["information_nats"]
    assert rows["parachute"]["left_out_information_nats"] < 0.01
    console = Console(width=100, record=True, file=io.StringIO())
    console.print(information_table({n: ConstraintSummary.of(finite(row)) for n, row in rows.items()}))
    text = console.export_text()
    landing = rows["landing"]["left_out_information_nats"]
    assert f"{landing:.2f}" in text and "–" in text and "nan" not in text
