"""The workbench in a browser: practice flight 01 from its first run to the noise floor (`make test-browser`).

Two reconstructions and two diagnoses take one to three minutes, which is too long for `make test`.
"""

import os
import re
import signal
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import pytest

from edl_filter.mission import shipped_mission

pytestmark = pytest.mark.browser

#: Greatest duration of a run and its diagnosis on a busy machine, s.
TIMEOUT = 300
#: Normalised RMS below which no cell fails.
LIMIT = "\ndiagnosis:\n  cell_minimum_rms: 1.15\n"


@pytest.fixture
def folder(practice, tmp_path):
    """A folder that contains only the mission of practice flight 01, with another limit of a cell that fails."""
    text = shipped_mission("practice_mer").read_text()
    assert "path: builtin:practice_06 " in text
    (tmp_path / "flight_01.yaml").write_text(text.replace("builtin:practice_06 ", f"{practice(1)} ") + LIMIT)
    return tmp_path


@pytest.fixture
def address(folder):
    """Address of a server, which is stopped by an interrupt."""
    command = [sys.executable, "-m", "edl_filter", "serve", str(folder), "--port", "0", "--no-browser"]
    environment = os.environ | {"PYTHONUNBUFFERED": "1"}
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment) as server:
        yield server.stdout.readline().split()[0]
        server.send_signal(signal.SIGINT)
        assert server.wait(30) == 0


@pytest.fixture
def page(browser, address):
    """A page that must log no errors and must send requests to its own server only."""
    opened = browser.new_page(viewport={"width": 1280, "height": 900})
    opened.set_default_timeout(20_000)
    console, foreign_requests = [], []
    opened.on("console", lambda m: console.append(m.text) if m.type in ("error", "warning") else None)
    opened.on("pageerror", lambda e: console.append(str(e)))
    own_urls = (address, "data:", f"blob:{address}")
    opened.on("request", lambda r: None if r.url.startswith(own_urls) else foreign_requests.append(r.url))
    opened.goto(address)
    yield opened
    opened.close()
    assert console == []
    assert foreign_requests == []


def assert_reconstruction(page):
    """Events, trajectory, constraints and the link to the report are displayed, and the page is not too wide."""
    for event in ("entry interface", "parachute deploy", "landing"):
        assert event in page.inner_text("#events")
    page.wait_for_selector("#trajectory .scatterlayer .trace >> nth=1")
    assert page.locator("#trajectory .legendtext").all_text_contents() == ["altitude (m)", "velocity (m/s)"]
    assert page.locator("#constraints tbody tr").count() >= 3
    labels = page.locator("#trajectory .annotation").evaluate_all(
        "(all) => all.map((a) => a.getBoundingClientRect()).map((box) => [box.left, box.right, box.bottom])"
    )
    top = page.locator("#trajectory").evaluate("(p) => p.getBoundingClientRect().top + p._fullLayout._size.t")
    assert len(labels) >= 3 and all(bottom <= top + 2.0 for *_, bottom in labels)  # above the curves
    for (_, right, _), (left, *_) in pairwise(sorted(labels)):
        assert left > right - 4.0
    assert page.get_attribute("#report", "href").startswith("report?path=")


def take_screenshots(page, name):
    """Check the width at three sizes, light and dark; save pictures where EDL_FILTER_SCREENSHOTS names a folder."""
    target = os.environ.get("EDL_FILTER_SCREENSHOTS")
    for scheme in ("light", "dark"):
        page.emulate_media(color_scheme=scheme)
        for width in (390, 1280, 1920):
            page.set_viewport_size({"width": width, "height": 900})
            page.wait_for_timeout(500)
            assert page.evaluate("document.documentElement.scrollWidth <= innerWidth"), (name, scheme, width)
            if target:
                page.screenshot(path=f"{target}/{name}_{width}_{scheme}.png", full_page=True)
    page.emulate_media(color_scheme="light")
    page.set_viewport_size({"width": 1280, "height": 900})


def test_from_the_first_run_to_the_noise_floor(page, folder):
    page.click('#missions button[data-name="flight_01.yaml"]')
    page.wait_for_selector("#run:enabled")
    assert "edl-filter run flight_01.yaml -o results/flight_01" in page.inner_text("main")
    page.click("#run")
    page.wait_for_selector("#job-steps li[data-state=running]")
    assert page.is_disabled("#run")

    page.wait_for_selector("#verdict[data-verdict=missing]", timeout=1000 * TIMEOUT)
    assert "wind" in page.inner_text("#verdict")
    assert page.locator("#ledger").count() == 0
    assert "outlined: fails (above 1.15 and statistically significant)" in page.inner_text(".legend:has(.box)")
    failing = page.locator(".map button.fails")
    assert failing.count() > 5
    page.click('.map button.fails[data-channel="moment_y"]')
    page.wait_for_selector("#residual .plot .scatterlayer .trace")
    assert page.locator("#residual .legendtext").all_text_contents() == ["±2 sigma", "±1 sigma", "residual"]
    assert "rad/s²" in page.inner_text("#residual")

    page.keyboard.press("ArrowUp")  # one tab stop: arrow keys move from cell to cell
    assert page.evaluate("document.activeElement.dataset.channel") == "moment_x"
    assert page.locator(".map button[tabindex='0']").count() == 1
    assert "Next: add wind to the model and refit it." in page.inner_text("#verdict")
    page.click("#next button")
    assert page.evaluate("document.activeElement.id") == "add"

    hypothesis = page.locator('#hypotheses label[data-effect="wind"]')
    assert hypothesis.locator("input").is_checked()  # the leader
    assert page.is_enabled("#add") and page.inner_text("#add") == "Add wind and run"
    assert_reconstruction(page)
    assert re.search(
        r"probability 9\d\.\d %", hypothesis.inner_text()
    )  # 100 % less what the local model may be wrong by
    assert re.search(r"east\s+−3\d\.\d+ ± 0\.\d+\s+m/s", hypothesis.inner_text())
    assert "edl-filter add flight_01.yaml wind --from results/flight_01" in page.inner_text("#plan")
    page.click("#add")

    page.wait_for_selector("#verdict[data-verdict=clean]", timeout=1000 * TIMEOUT)
    assert page.inner_text("#verdict strong").startswith("None of the 78 cells of the residual map fails.")
    assert "Noise floor reached" in page.inner_text("#verdict")
    ledger = {row.split("\t")[0]: row.split("\t")[1:] for row in page.inner_text("#ledger tbody").splitlines()}
    first, last, decrease = ledger["moment y"]
    assert float(first) > 1.5  # the stated uncertainty of density and wind absorbs most of the failure
    assert float(last) < 1.1
    assert float(decrease.removesuffix(" %")) == pytest.approx(100.0 * (1.0 - float(last) / float(first)), abs=1.0)
    assert page.locator(".map button.fails").count() == 0
    assert (folder / "flight_01+wind.yaml").is_file()
    assert (folder / "results" / "flight_01+wind" / "diagnosis.json").is_file()

    page.reload()  # the page reads its content from files
    page.wait_for_selector("#ledger")
    assert page.locator("#hypotheses input:checked").count() == 0  # nothing needs to be added
    with page.context.expect_page() as opened:
        page.click("#report")
    report = opened.value
    report.wait_for_selector("h1")
    assert "edl-filter" in report.content() and len(report.content()) > 100_000
    report.close()
    take_screenshots(page, "result")


def test_improve_and_detectable_sizes_by_button(page, folder):
    """The shipped flight, to which nothing is to be added: one diagnosis."""
    page.click("#shipped-box summary")
    page.click('#shipped button[data-name="builtin:practice_mer"]')
    page.click("#identifiability")
    page.wait_for_selector("#job[data-state=running]")
    assert page.is_disabled("#improve")
    assert "A job is running: Detectable sizes of builtin:practice_mer" in page.inner_text(".why[data-busy]")
    page.wait_for_selector("#study tbody tr", timeout=1000 * TIMEOUT)
    assert "remnant torque" in page.inner_text("#study")
    take_screenshots(page, "study")
    page.click("#improve")
    page.wait_for_selector("#verdict[data-verdict=clean]", timeout=1000 * TIMEOUT)
    assert "results/practice_mer_improved" in page.inner_text("main")
    assert_reconstruction(page)
    assert (folder / "results" / "practice_mer_improved" / "ledger.jsonl").is_file()


def test_a_run_that_is_not_to_be_trusted_says_so_first(page, folder):
    text = (folder / "flight_01.yaml").read_text()
    (folder / "doubted.yaml").write_text(re.sub("path: .*practice_01.h5 ", "path: builtin:unknown_1 ", text))
    page.reload()
    page.click('#missions button[data-name="doubted.yaml"]')
    page.click("#run-only")
    page.wait_for_selector("#warnings #trust", timeout=1000 * TIMEOUT)
    assert page.inner_text("#trust").startswith("Do not trust this result")
    first = page.evaluate("document.querySelector('main').querySelector('section, .verdict, table').id")
    assert first == "warnings"
    assert_reconstruction(page)
    assert page.is_enabled("#diagnose")
    take_screenshots(page, "doubted")


def test_narrow_page_with_broken_missions_and_a_cancelled_run(page, folder):
    text = Path(folder / "flight_01.yaml").read_text()
    (folder / "wrong.yaml").write_text(text.replace("mass: 832.0 ", "mass: -1.0 ").replace("alpha: 0.5", "alfa: 0.5"))
    (folder / "syntax.yaml").write_text(text.replace("mass: 832.0 ", "mass: [832.0 "))
    page.set_viewport_size({"width": 390, "height": 844})
    page.reload()
    page.click('#missions button[data-name="syntax.yaml"]')
    page.wait_for_selector("#problems")
    assert page.inner_text("#problems li").startswith("syntax.yaml: line ")
    assert "cannot run" in page.inner_text('#missions button[data-name="wrong.yaml"]')
    page.click('#missions button[data-name="wrong.yaml"]')
    page.wait_for_selector("#problems li:nth-child(2)")
    assert "wrong.yaml: filter.alfa" in page.inner_text("#problems")
    assert "wrong.yaml: vehicle.mass" in page.inner_text("#problems")
    for button in ("#run", "#run-only", "#improve", "#identifiability"):
        assert page.is_disabled(button)
    assert "The mission has problems" in page.inner_text("main .why:not([hidden])")
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
    take_screenshots(page, "broken")
    page.set_viewport_size({"width": 390, "height": 844})

    page.click('#missions button[data-name="flight_01.yaml"]')
    page.click("#run")
    page.wait_for_selector("#job-steps li[data-state=running]")
    page.click("#cancel")
    page.wait_for_selector("#job[data-state=cancelled]")
    page.wait_for_selector("#run:enabled")
    assert not (folder / "results").exists()
    assert "-o results/flight_01\n" in page.inner_text("main")  # the name is free again
