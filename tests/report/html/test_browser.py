"""The report in a browser without a network."""

import folders
import pytest

from edl_filter.report.html import write_report
from edl_filter.results.files import BUNDLE

pytestmark = pytest.mark.browser


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    folder = tmp_path_factory.mktemp("run")
    folders.complete_run(folder)
    folders.diagnosis(folder, verdict="unknown", latent=folders.latent(), remainder=folders.remainder("It follows q."))
    return write_report(folder)


def visit(browser, path, **how):
    """Open the report; the page, what its console said, and what it asked for besides itself."""
    context = browser.new_context(**({"viewport": {"width": 1200, "height": 900}} | how))
    page, messages, asked = context.new_page(), [], []
    page.on("console", lambda message: messages.append(message.text) if message.type in ("error", "warning") else None)
    page.on("pageerror", lambda error: messages.append(str(error)))
    page.on("request", lambda request: asked.append(request.url))
    page.goto(path.as_uri())
    page.wait_for_selector("html[data-drawn]", timeout=60_000)
    return page, messages, [url for url in asked if url != path.as_uri() and not url.startswith(("data:", "blob:"))]


def residual(page):
    """Name of the plotted axis, its range in time, and how many points of the curve are drawn."""
    return page.evaluate(
        """() => { const p = document.getElementById("plot-residuals");
        const last = p.data[p.data.length - 1];
        return [p.layout.yaxis.title.text, p.layout.xaxis.range, last.y.length, last.y.some((v) => v !== 0)]; }"""
    )


def test_it_opens_without_an_error_and_without_a_network(browser, report):
    page, messages, asked = visit(browser, report)
    assert messages == [] and asked == [(report.parent / BUNDLE).as_uri()]
    wanted = page.evaluate("document.querySelectorAll('.plot').length")
    plots = page.evaluate(
        "[...document.querySelectorAll('.plot')].filter((p) => p.querySelector('path.js-line')).length"
    )
    assert plots == wanted >= 10
    assert "Missing: wind" in page.inner_text("#verdict")


def test_the_plotting_library_may_be_in_the_folder_above(browser, report, tmp_path):
    (tmp_path / "result").mkdir()
    copy = tmp_path / "result" / "report.html"
    copy.write_bytes(report.read_bytes())
    (tmp_path / BUNDLE).write_bytes((report.parent / BUNDLE).read_bytes())
    page, _, _ = visit(browser, copy)
    assert page.evaluate("document.querySelectorAll('path.js-line').length") > 10


def test_without_the_plotting_library_the_page_says_so(browser, report, tmp_path):
    copy = tmp_path / "report.html"
    copy.write_bytes(report.read_bytes())
    page = browser.new_page()
    page.goto(copy.as_uri())
    page.get_by_text("The plots need the file plotly.min.js").wait_for()


def test_a_click_on_a_cell_shows_its_residual_in_its_regime(browser, report):
    page, messages, _ = visit(browser, report)
    assert residual(page)[0] == "force x (m/s²)"  # the worst before any click
    page.get_by_label("force y in Mach above 15").click()
    name, (low, high), points, moves = residual(page)
    assert name == "force y (m/s²)" and points > 500 and moves
    assert 0.0 < low <= 20.0 and 120.0 <= high < 140.0
    rectangles = page.evaluate(
        "document.getElementById('plot-residuals').layout.shapes.filter((s) => s.type === 'rect')"
    )
    assert [(s["x0"], s["x1"]) for s in rectangles] == [(20.0, 120.0)]
    assert page.get_attribute(".cell[aria-pressed=true]", "data-cell") == "2"
    page.click("text=in sigmas")
    page.click("text=whole flight")
    assert residual(page)[:2] == ["force y (sigma)", [20.0, 220.0]]
    assert page.is_visible("#residuals-caption")
    page.get_by_label("landing in constraints").click()
    assert not page.is_visible("#residuals-caption")
    assert page.evaluate("document.getElementById('plot-residuals').layout.yaxis.title.text") == "innovation (sigma)"
    assert messages == []


def test_the_map_is_one_tab_stop_with_arrow_keys(browser, report):
    page, said, _ = visit(browser, report)
    assert page.locator(".cell[tabindex='0']").count() == 1
    assert page.locator(".map").first.evaluate("(m) => m.parentElement.tabIndex") == -1
    page.locator(".cell[tabindex='0']").focus()
    cell = "document.activeElement.getAttribute('aria-label')"
    assert page.evaluate(cell).startswith("force x in Mach below 15")  # the worst
    for key, label in (
        ("ArrowDown", "force y in Mach below 15"), ("ArrowLeft", "force y in Mach above 15"),
        ("ArrowLeft", "force y in Mach above 15"), ("ArrowDown", "landing in constraints"),
        ("ArrowUp", "force y in Mach above 15"),
    ):  # fmt: skip
        page.keyboard.press(key)
        assert page.evaluate(cell).startswith(label), key
        assert page.locator(".cell[tabindex='0']").count() == 1
    page.keyboard.press("Enter")
    assert residual(page)[0] == "force y (m/s²)"
    page.keyboard.press("Tab")
    assert not page.evaluate("document.activeElement.classList.contains('cell')") and said == []


@pytest.mark.parametrize("width", [390, 1920])
def test_labels_of_events_do_not_overlap(browser, report, width):
    page, _, _ = visit(browser, report, viewport={"width": width, "height": 900})
    boxes = page.evaluate(
        """() => [...document.querySelectorAll("#plot-flight .annotation")].map((a) => {
        const box = a.getBoundingClientRect(); return [box.left, box.right]; })"""
    )
    assert len(boxes) >= 2
    for (_, right), (left, _) in zip(sorted(boxes), sorted(boxes)[1:], strict=False):
        assert left > right - 3.0


def test_the_toggle_changes_page_and_plots(browser, report):
    page, messages, _ = visit(browser, report, color_scheme="light")

    def colours():
        return page.evaluate(
            """() => [getComputedStyle(document.body).backgroundColor,
            document.getElementById("plot-flight").data[0].line.color,
            document.getElementById("plot-flight").layout.font.color]"""
        )

    light = colours()
    page.click("#theme")
    dark = colours()
    assert all(a != b for a, b in zip(light, dark, strict=True)) and messages == []
    page.click("#theme")
    assert colours() == light
    by_system, _, _ = visit(browser, report, color_scheme="dark")
    assert by_system.evaluate("getComputedStyle(document.body).backgroundColor") == dark[0]


@pytest.mark.parametrize("width", [390, 1200])
def test_the_page_never_scrolls_sideways(browser, report, width):
    page, _, _ = visit(browser, report, viewport={"width": width, "height": 844})
    page.evaluate("document.querySelectorAll('details').forEach((d) => { d.open = true; })")
    assert page.evaluate("document.documentElement.scrollWidth <= window.innerWidth")


def test_paper_is_light_and_wide_enough(browser, report):
    page, messages, _ = visit(browser, report, color_scheme="dark", viewport={"width": 700, "height": 900})
    page.emulate_media(media="print", color_scheme="dark")
    page.evaluate("dispatchEvent(new Event('beforeprint'))")
    assert page.evaluate("getComputedStyle(document.body).backgroundColor") == "rgb(255, 255, 255)"
    assert page.evaluate("Math.max(...[...document.querySelectorAll('.plot svg')].map((s) => s.clientWidth))") <= 700
    assert not page.is_visible("#theme")
    page.evaluate("dispatchEvent(new Event('afterprint'))")
    assert page.evaluate("document.documentElement.dataset.theme") is None and messages == []


def test_a_command_is_copied(browser, report):
    page, _, _ = visit(browser, report)
    page.context.grant_permissions(["clipboard-read", "clipboard-write"])
    page.bring_to_front()  # only the page in front may write the clipboard; behind others it waits for ever
    page.locator("#hypotheses .copy").first.click()
    # not wait_for_function: from its second look on it evaluates text in the page, which the page's policy forbids
    page.locator("#hypotheses .copy:text-is('copied')").first.wait_for()
