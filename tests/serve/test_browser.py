"""Practice flight 01 from the first look to the noise floor, by clicking only (`make test-browser`).

Two reconstructions and two diagnoses take one to three minutes, which is too long for `make test`.
"""

import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from edl_filter.mission import shipped_mission

pytestmark = pytest.mark.browser

#: Seconds that a run and its diagnosis may take on a busy machine.
PATIENCE = 300


@pytest.fixture
def folder(practice, tmp_path):
    """A folder with nothing but the mission of practice flight 01."""
    text = shipped_mission("practice_mer").read_text()
    assert "path: builtin:practice_06 " in text
    (tmp_path / "flight_01.yaml").write_text(text.replace("builtin:practice_06 ", f"{practice(1)} "))
    return tmp_path


@pytest.fixture
def address(folder):
    """Address of a server of its own, ended as a person ends it."""
    command = [sys.executable, "-m", "edl_filter.cli", "serve", str(folder), "--port", "0", "--no-browser"]
    told = os.environ | {"PYTHONUNBUFFERED": "1"}
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=told) as server:
        yield server.stdout.readline().split()[0]
        server.send_signal(signal.SIGINT)
        assert server.wait(30) == 0


@pytest.fixture
def page(browser, address):
    """A page that must not complain, and must not ask anyone else for anything."""
    opened = browser.new_page(viewport={"width": 1280, "height": 900})
    opened.set_default_timeout(20_000)
    said, elsewhere = [], []
    opened.on("console", lambda m: said.append(m.text) if m.type in ("error", "warning") else None)
    opened.on("pageerror", lambda e: said.append(str(e)))
    own = (address, "data:", f"blob:{address}")
    opened.on("request", lambda r: None if r.url.startswith(own) else elsewhere.append(r.url))
    opened.goto(address)
    yield opened
    opened.close()
    assert said == []
    assert elsewhere == []


def test_from_first_look_to_noise_floor(page, folder):
    page.click('#missions button[data-name="flight_01.yaml"]')
    page.wait_for_selector("#run:enabled")
    assert "edl-filter run flight_01.yaml -o results/flight_01" in page.inner_text("main")
    page.click("#run")
    page.wait_for_selector("#job-steps li[data-state=running]")
    assert page.is_disabled("#run")

    page.wait_for_selector("#verdict[data-verdict=missing]", timeout=1000 * PATIENCE)
    assert "wind" in page.inner_text("#verdict")
    assert page.locator("#ledger").count() == 0
    failing = page.locator(".map button.fails")
    assert failing.count() > 5
    page.click('.map button.fails[data-channel="moment_y"]')
    page.wait_for_selector("#residual .plot .scatterlayer .trace")
    assert page.locator("#residual .legendtext").all_text_contents() == ["residual", "±1 sigma", "±2 sigma"]
    assert "rad/s²" in page.inner_text("#residual")

    assert page.is_disabled("#add")
    hypothesis = page.locator('#hypotheses label[data-effect="wind"]')
    assert "probability > 99.9 %" in hypothesis.inner_text()
    assert re.search(r"east\s+−3\d\.\d+ ± 0\.\d+\s+m/s", hypothesis.inner_text())
    hypothesis.click()
    assert "edl-filter add flight_01.yaml wind --from results/flight_01" in page.inner_text("#plan")
    page.click("#add")

    page.wait_for_selector("#verdict[data-verdict=clean]", timeout=1000 * PATIENCE)
    assert "Noise floor reached" in page.inner_text("#verdict")
    fall = {row.split("\t")[0]: row.split("\t")[1:] for row in page.inner_text("#ledger tbody").splitlines()}
    before, after, percent = fall["moment y"]
    assert float(before) > 5.0  # chance has 1.1; at the likeliest noise part of the failure is a turn of the path
    assert float(after) < 1.1
    assert float(percent.removesuffix(" %")) == pytest.approx(100.0 * (1.0 - float(after) / float(before)), abs=1.0)
    assert page.locator(".map button.fails").count() == 0
    assert (folder / "flight_01+wind.yaml").is_file()
    assert (folder / "results" / "flight_01+wind" / "diagnosis.json").is_file()

    page.reload()  # all of it stands in files
    page.wait_for_selector("#ledger")


def test_a_narrow_page_a_mistake_and_a_cancel(page, folder):
    text = Path(folder / "flight_01.yaml").read_text()
    (folder / "wrong.yaml").write_text(text.replace("mass: 832.0 ", "mass: -1.0 "))
    page.set_viewport_size({"width": 390, "height": 844})
    page.reload()
    page.click('#missions button[data-name="wrong.yaml"]')
    page.click("#run-only")
    page.wait_for_selector("#job-error:not([hidden])")
    assert page.inner_text("#job-error").startswith("wrong.yaml: vehicle.mass")
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")

    page.click('#missions button[data-name="flight_01.yaml"]')
    page.click("#run")
    page.click("#cancel")
    page.wait_for_selector("#job[data-state=cancelled]")
    page.wait_for_selector("#run:enabled")
    assert not (folder / "results" / "flight_01" / "result.nc").exists()
