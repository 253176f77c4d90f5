"""Sections of a page about a diagnosis: hypotheses with their commands, what is left, and the ledger."""

import folders
import pytest
from contents import diagnosis, hypothesis
from pages import body, data, numbers, page, section

from edl_filter.report.diagnosis import ledger_levels


def test_a_hypothesis_has_size_sigma_unit_and_what_it_is_confused_with(tmp_path):
    folders.complete_run(tmp_path)
    text = section(page(tmp_path), "hypotheses")
    for part in ("−38.07 ± 0.53 m/s", "0.980", "mass", "a second probe would part them", "9.5 → 1", "something else",
                 "gyro_bias"):  # fmt: skip
        assert part in text


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({}, "sigma up to 0.003 m/s²\nand 0.001 rad/s²\nfixed to the body"),
        ({"with_dynamic_pressure": True},
         "sigma up to 0.003 m/s²\nand 0.001 rad/s²\nfixed to the body\nin proportion to\ndynamic pressure"),
        ({"form": "angle of attack", "with_dynamic_pressure": True, "force_m_s2": 0.0},
         "sigma up to 0.001 rad/s²\nin proportion to\nangle of attack and\ndynamic pressure"),
        ({"form": "error of one IMU", "angular_acceleration_rad_s2": 0.0, "rate_rad_s": 2e-6},
         "sigma up to 0.003 m/s²\nand 2e-06 rad/s\nerror of one IMU"),
        ({"force_m_s2": 0.0, "angular_acceleration_rad_s2": 0.0}, '<td class="text"></td>'),
    ],
)  # fmt: skip
def test_something_else_has_its_size_and_form(tmp_path, changes, expected):
    folders.complete_run(tmp_path)
    folders.diagnosis(tmp_path, something_else=diagnosis()["something_else"] | changes)
    row = section(page(tmp_path), "hypotheses").split(">something else</th>")[1].split("</tr>")[0]
    assert expected in row


def test_only_effects_that_gain_are_offered_with_the_file_that_defines_them(tmp_path):
    folders.complete_run(tmp_path)
    ranking = [hypothesis(effect="jet", label="jet"), hypothesis(effect="mass", label="mass", gain=-78.3)]
    folders.diagnosis(tmp_path, ranking=ranking, own_effects={"jet": "my jet.py"})
    text = body(page(tmp_path))
    assert text.count(f"edl-filter add MISSION jet --from {tmp_path} --file &#39;my jet.py&#39;") == 2
    assert "edl-filter add MISSION mass" not in text and "−78.3" in text


def test_the_command_for_a_sensor_effect_names_its_imu(tmp_path):
    folders.complete_run(tmp_path)
    folders.diagnosis(
        tmp_path, ranking=[hypothesis(effect="gyro_bias", imu="secondary", label="gyro_bias in secondary")]
    )
    text = section(page(tmp_path), "hypotheses")
    assert f"edl-filter add MISSION gyro_bias --from {tmp_path} --imu secondary" in text
    assert "gyro_bias in secondary" in text


def test_a_clean_verdict_and_an_unknown_one_say_what_is_left(tmp_path):
    folders.complete_run(tmp_path)
    folders.diagnosis(tmp_path, verdict="clean", ranking=[], where=[], onsets=[])
    text = page(tmp_path)
    assert "the model holds" in section(text, "left") and "No effect of the catalogue" in section(text, "hypotheses")
    assert "None of the 5 cells fails" in section(text, "where")
    remainder = folders.remainder("It follows q at 3 m/s^2.")
    folders.diagnosis(tmp_path, verdict="unknown", latent=folders.latent(), remainder=remainder)
    text = page(tmp_path)
    assert "It follows q at 3 m/s²." in section(text, "left") and "plot-missing" in section(text, "left")
    traces = data(text)["figures"]["missing"]["data"]
    curve = next(t for t in traces if t["name"] == "along x")
    assert abs(numbers(curve["y"])).max() == pytest.approx(20.0, rel=1e-3)


def test_the_waterfall_falls_as_the_ledger_says(tmp_path):
    folders.complete_run(tmp_path)
    folders.ledger(tmp_path)
    effects = {name: {"imu": None, "parameters": {}, "fixed": False} for name in ("wind", "mass")}
    folders.summary(tmp_path, effects=effects)
    text = page(tmp_path)
    bars = data(text)["figures"]["waterfall"]["data"][0]
    tops = [base + high for base, high in zip(bars["base"], bars["y"], strict=True)]
    assert tops == pytest.approx([40.0, 40.0, 6.0, 1.0]) and bars["base"][1:3] == pytest.approx([6.0, 1.0])
    assert "Stopped." in section(text, "ledger")


def test_a_ledger_of_another_model_is_not_shown(tmp_path):
    folders.complete_run(tmp_path)
    folders.ledger(tmp_path)  # its model has two effects, the run none
    assert "There is no ledger" in section(page(tmp_path), "ledger")
    assert ledger_levels([]) == []
