"""The report from folders made by hand: what it says, what it must not hold, and what is missing."""

import json
import re

import folders
import h5py
import numpy as np
import pytest
from pages import body, data, numbers, page, section

from edl_filter.errors import InputError
from edl_filter.planet.gas import NAMED_GASES
from edl_filter.report.description import Axis, Band, Figure, Panel
from edl_filter.report.html import write_report
from edl_filter.report.html.bundle import bundle_path, with_bundle
from edl_filter.report.plotly_renderer import band_trace, event_marks, plotly_figure
from edl_filter.results.files import BUNDLE
from edl_filter.results.summary import gas_content


def test_the_sections_stand_in_the_order_of_the_reading(tmp_path):
    folders.complete_run(tmp_path)
    text = body(page(tmp_path))
    keys = ["verdict", "events", "where", "hypotheses", "left", "database", "ledger", "trajectory",
            "atmosphere", "coefficients",
            "constraints", "instruments", "provenance"]  # fmt: skip
    assert re.findall(r'<section id="(\w+)"', text) == keys
    assert "Missing: wind (gain 42 nats)." in section(text, "verdict")


def test_the_file_is_small_and_asks_nothing_of_a_network(tmp_path):
    folders.complete_run(tmp_path)
    text = page(tmp_path)
    assert len(text.encode()) < 8e5
    assert "plotly.js v" in (tmp_path / BUNDLE).read_text()[:500]
    assert text.count("<script") - body(text).count("<script") <= 3
    assert not re.search(r"""(?:src|href)\s*=\s*["']?\s*(?:https?:)?//""", body(text))
    own = body(text) + text[text.rindex("<script>") :]
    assert not re.search(r"url\(|@import|https?://|fetch\(|XMLHttpRequest", own)
    assert "default-src 'none'" in text


def test_reports_of_one_folder_share_the_plotting_library(tmp_path):
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        folders.complete_run(tmp_path / name)
        write_report(tmp_path / name)
    assert (tmp_path / "a" / BUNDLE).is_file() and (tmp_path / "b" / BUNDLE).is_file()
    for name in ("a", "b"):
        (tmp_path / name / BUNDLE).replace(tmp_path / BUNDLE)
        write_report(tmp_path / name)
    assert [p.parent for p in tmp_path.rglob(BUNDLE)] == [tmp_path]
    (tmp_path / BUNDLE).write_text("an older version")
    write_report(tmp_path / "a")
    assert (tmp_path / "a" / BUNDLE).stat().st_size == bundle_path().stat().st_size


def test_the_page_as_one_file(tmp_path):
    folders.complete_run(tmp_path)
    text = with_bundle(page(tmp_path))
    assert "plotly.js v" in text and len(text) > bundle_path().stat().st_size * 0.9


def test_a_hostile_title_stays_text(tmp_path):
    hostile = "</script><script>window.bad = 1</script><img src=x onerror=alert(1)>\u2028 & {{ 7 * 7 }}"
    folders.complete_run(tmp_path, hostile)
    folders.diagnosis(tmp_path, sentence=hostile)
    content = json.loads((tmp_path / "diagnosis.json").read_text())
    content["map"][0]["channel"], content["map"][0]["sentence"] = hostile, f"{hostile} fails"
    (tmp_path / "diagnosis.json").write_text(json.dumps(content))
    text = page(tmp_path)
    assert "<img" not in body(text) and "window.bad = 1</script>" not in text
    assert "&lt;img src=x onerror=alert(1)&gt;" in text
    assert data(text)["residuals"]["cells"][0]["channel"] == hostile


def test_a_run_without_a_diagnosis_says_so_and_how_to_get_one(tmp_path):
    folders.result(tmp_path)
    folders.summary(tmp_path)
    folders.residuals(tmp_path)  # of an earlier diagnosis
    text = page(tmp_path)
    command = f"edl-filter diagnose {tmp_path}"
    assert "has not been diagnosed" in section(text, "where") and command in section(text, "where")
    assert "Not diagnosed yet" in section(text, "verdict") and "all 1 constraints agree" in section(text, "verdict")
    assert 'class="cell' not in text.split("<script")[0]
    assert data(text)["residuals"] is None


def test_the_gas_of_mach_numbers_and_temperatures_is_said(tmp_path):
    folders.complete_run(tmp_path)
    gas = gas_content(NAMED_GASES["mars"])
    folders.summary(tmp_path, gas=gas)
    text = page(tmp_path)
    for key in ("events", "atmosphere"):
        assert "R 191.20 J/(kg K), γ 1.350 at 200 K" in section(text, key)


def test_what_a_folder_lacks_is_said(tmp_path):
    folders.summary(tmp_path)
    text = page(tmp_path)
    assert "no trajectory" in section(text, "trajectory")
    assert "no atmosphere" in section(text, "atmosphere")
    assert "no coefficients" in section(text, "coefficients")
    assert "no result.nc" in section(text, "provenance")
    folder = tmp_path / "other"
    folder.mkdir()
    folders.result(folder, postflight=False)
    text = page(folder)
    assert "no summary.json" in section(text, "events") and "no summary.json" in section(text, "constraints")
    assert "plot-flight" in section(text, "trajectory") and "no atmosphere" in section(text, "atmosphere")


def test_a_folder_without_a_result_is_refused(tmp_path):
    with pytest.raises(InputError, match="found no result; expected the folder that 'edl-filter run' writes"):
        write_report(tmp_path)


def test_a_folder_that_was_moved_still_renders(tmp_path):
    first = tmp_path / "first"
    first.mkdir()
    folders.complete_run(first)
    moved = first.rename(tmp_path / "second place")
    text = section(page(moved), "hypotheses")
    assert f"--from &#39;{moved}&#39;" in text
    assert "edl-filter add MISSION wind" in text  # its mission file is not known


def test_thinning_keeps_a_single_sample_peak(tmp_path):
    """In the unit and in sigmas, which are not at the same sample where sigma changes."""
    folders.complete_run(tmp_path)
    time, sigma = folders.residuals(tmp_path, samples=60_000, peak=321.0)
    packed = data(page(tmp_path))["residuals"]["channels"]["force_x"]
    x, y, sigmas = (numbers(packed[name]) for name in ("x", "y", "sigma"))
    assert len(x) == len(y) == len(sigmas) < 5000
    ratio = y / sigmas
    assert ratio.max() == pytest.approx(321.0, rel=1e-5)
    assert x[ratio.argmax()] == pytest.approx(time[20_000], abs=1e-3)
    largest = np.argmax(np.abs(folders.noise(60_000, 321.0)[0] * sigma))
    assert largest != 20_000
    assert x[np.abs(y).argmax()] == pytest.approx(time[largest], abs=1e-3)
    assert (sigmas.min(), sigmas.max()) == pytest.approx((sigma.min(), sigma.max()))


def test_a_band_has_a_gap_where_its_curves_have():
    x = np.arange(100.0)
    low = np.where((x > 40) & (x < 60), np.nan, -1.0)
    ends = numbers(band_trace(Band(x, low, -low))["x"])
    gaps = np.flatnonzero(np.isnan(ends))
    assert len(gaps) == 1 and not ((ends > 40) & (ends < 60)).any()


def test_every_event_has_a_line_and_a_label_in_order_of_time():
    events = {"heat_shield_separation": 95.0, "landing": 100.0, "peak_deceleration": 40.0, "bridle_cut": 99.0}
    shapes, notes = event_marks(events | {"rest": 101.0}, (0.0, 100.0))
    assert len(shapes) == 4
    assert [n["text"] for n in notes] == ["peak", "heat shield", "bridle cut", "landing"]
    assert {n["name"] for n in notes} == {"event"}  # by which the page's script moves them apart


def test_the_upper_margin_has_room_for_the_longest_label():
    def margin(**events):
        panel = Panel(Axis("x", "s"), Axis("y"), (), events=events)
        return plotly_figure(Figure("", ((panel,),), (1.0,)), 300)["layout"]["margin"]["t"]

    short, long = margin(landing=1.0), margin(**{"onset secondary rate x": 1.0})
    assert margin() < short < long and long > 22 * 6  # characters of 6 pixels at 11 points


def test_minus_signs_and_powers_are_those_of_print(tmp_path):
    folders.complete_run(tmp_path)
    folders.summary(tmp_path, headline="Contradicted at -3.5 m/s^2.", trustworthy=False)
    assert "Contradicted at −3.5 m/s²." in section(page(tmp_path), "verdict")


def test_the_mission_as_it_was_run_names_no_folder_of_the_machine(tmp_path):
    folders.complete_run(tmp_path)
    with h5py.File(tmp_path / "result.nc", "a") as file:
        file.attrs["mission_yaml"] = "name: toy\ntelemetry:\n  path: /home/me/flights/flight.h5  # mine\n"
    shown = section(page(tmp_path), "provenance")
    assert "flight.h5" in shown and "/home/me" not in shown


def test_labels_of_logarithmic_axes_are_texts_of_one_size():
    def ticks(low, high):
        panel = Panel(Axis("x", "s"), Axis("y", scale="log", range=(low, high)), ())
        axis = plotly_figure(Figure("", ((panel,),), (1.0,)), 300)["layout"]["yaxis"]
        return dict(zip(axis["ticktext"], axis["tickvals"], strict=True))

    assert ticks(1.5, 30.0) == {"1": 1.0, "2": 2.0, "5": 5.0, "10": 10.0, "20": 20.0, "50": 50.0,
                                "100": 100.0, "200": 200.0, "500": 500.0}  # fmt: skip
    assert {"10⁻⁸", "0.01", "10⁶"} <= ticks(1e-8, 1e6).keys()
    assert "10" not in ticks(1e-8, 1e6)  # every second decade


def test_no_coefficient_is_clipped(tmp_path):
    folders.complete_run(tmp_path)
    figures = data(page(tmp_path))["figures"]
    for name in ("CA", "Cl"):
        if (figure := figures.get(f"coefficient_{name}")) is None:
            continue
        low, high = figure["layout"]["yaxis"]["range"]
        for trace in figure["data"]:
            if trace.get("name") in ("flight", "database"):
                y = numbers(trace["y"])
                assert low <= np.nanmin(y) and np.nanmax(y) <= high, name
    assert "coefficient_CA" in figures


def test_provenance_has_no_path_of_a_machine(tmp_path):
    folders.complete_run(tmp_path)
    with h5py.File(tmp_path / "result.nc", "r+") as file:
        file.attrs["mission_file"] = "/home/someone/missions/toy.yaml"
    text = section(page(tmp_path), "provenance")
    assert "toy.yaml" in text and "/home/someone" not in text


def test_a_file_that_violates_its_schema_is_named_and_treated_as_missing(tmp_path):
    folders.complete_run(tmp_path)
    (tmp_path / "diagnosis.json").write_text('{"verdict": "clean"}')
    text = section(page(tmp_path), "verdict")
    assert "Not diagnosed yet" in text and "diagnosis.json: sentence: found nothing" in text


def test_coefficients_have_both_bands_and_the_instabilities(tmp_path):
    folders.complete_run(tmp_path)
    figure = data(page(tmp_path))["figures"]["coefficient_CN"]
    assert [t["name"] for t in figure["data"]] == ["database, 3 sigma", "flight, 1 sigma", "database", "flight"]
    x = numbers(figure["data"][3]["x"])
    assert (x[0], x[-1]) == (60.0, 250.0)  # the validation domain
    assert figure["layout"]["xaxis"]["title"]["text"] == "time since 2004-01-04 04:19:52 UTC (s)"
