"""docs/effects.md: its table is that of the declarations, and its example explains the practice flight."""

import os
import re
from pathlib import Path

import numpy as np
from effect_pages import catalogue_table

from edl_filter.effects.registry import catalogue
from edl_filter.effects.tables import as_plain
from edl_filter.mission import Mission, shipped_mission
from edl_filter.pipeline.forward_model import forward_model_of
from edl_filter.pipeline.reconstruct import reconstruct
from edl_filter.postflight.flight import derived_quantities
from edl_filter.workflow.add_effect import add_effect

DOCS = Path(__file__).parents[2] / "docs" / "effects.md"
BEGIN, END = "<!-- catalogue -->\n", "<!-- end of catalogue -->"


def test_the_table_is_up_to_date():
    text = DOCS.read_text(encoding="utf-8")
    before, rest = text.split(BEGIN)
    _, after = rest.split(END)
    updated = before + BEGIN + catalogue_table() + END + after
    if os.environ.get("EDL_FILTER_UPDATE_DOCS"):
        DOCS.write_text(updated, encoding="utf-8")
    assert updated == DOCS.read_text(encoding="utf-8")


def test_plain_data_have_no_infinities():
    for effect in catalogue().values():
        plain = as_plain(effect)
        numbers = [x for q in plain["parameters"] for x in q.values() if isinstance(x, float)]
        assert np.all(np.isfinite(numbers))
        assert [q["name"] for q in plain["parameters"]] == [q.name for q in effect.parameters]


def test_the_example_finds_what_practice_08_hides(practice, tmp_path):
    (code,) = re.findall(r"```python\n(.*?)```", DOCS.read_text(encoding="utf-8"), re.DOTALL)
    assert len(code.strip().splitlines()) < 40
    (tmp_path / "my_jet.py").write_text(code)
    values = ["A=7.279969", "f=0.6793651", "t0=63.53717", "t1=164.0253"]
    path = add_effect(
        str(shipped_mission("practice_mer")), "oscillating_jet", tmp_path / "m.yaml", values,
        file=str(tmp_path / "my_jet.py"),
    )  # fmt: skip
    flight = reconstruct(Mission.load(path, [f"telemetry.path={practice(8)}"]))
    d, t = derived_quantities(flight).postflight, flight.trajectory
    rms = []
    for effects in ((), None):
        forward_model = forward_model_of(flight.mission, flight.planet, flight.atmosphere, effects)
        flow = forward_model.flow(t.time, t.position, t.velocity, t.inertial_from_body, t.angular_rate)
        force, moment = (0.5 * (x[1:] + x[:-1])[: len(d.time)] for x in forward_model.loads(flow))
        part = (d.time > 65.0) & (d.time < 80.0)  # before the aerodynamic moments are large
        pitch = d.motion.moments.moment[:, 1] - d.motion.smoother.smooth(moment)[:, 1]
        normal = d.motion.force[:, 2] * forward_model.rigid_body.mass - d.motion.smoother.smooth(force)[:, 2]
        rms.append([np.sqrt(np.mean(x[part] ** 2)) for x in (pitch, normal)])
    assert rms[0][0] > 3.0 and rms[1][0] < 0.3 * rms[0][0], rms
    assert rms[1][1] < 0.5 * rms[0][1], rms
