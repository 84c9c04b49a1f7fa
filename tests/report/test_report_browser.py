"""The report in a real browser: Debian's Chromium, headless and without a network."""

import io
import re
import shutil
import time
from dataclasses import dataclass, field
from pathlib import Path

import pytest
from report_helpers import hidden_material

from cosim.report.folder import load
from cosim.report.language import reported_in
from cosim.report.page import page as made_page
from cosim.report.page import write_report

pytestmark = pytest.mark.browser

# of each plot: traces wanted, and those of which something is on the screen
DRAWN = """() => [...document.querySelectorAll('.plot')].map(plot => {
  const wanted = (plot.data || []).filter(trace => trace.visible !== 'legendonly');
  const marks = [...plot.querySelectorAll('.scatterlayer .trace, .barlayer .trace')];
  const seen = marks.filter(m => [...m.querySelectorAll('path')].some(p => (p.getAttribute('d') || '').length > 4));
  const box = plot.getBoundingClientRect();
  return {key: plot.id, wanted: wanted.length, seen: seen.length, width: box.width, height: box.height,
          titles: [...plot.querySelectorAll('.xtitle, .ytitle')].map(t => t.textContent)};
})"""


@dataclass
class Visit:
    """A page, and what happened while it loaded."""

    page: object
    errors: list[str] = field(default_factory=list)
    requests: list[str] = field(default_factory=list)


def visit(browser, file: Path) -> Visit:
    """Open a file with the network off and wait until its last plot is drawn."""
    context = browser.new_context(viewport={"width": 1100, "height": 900}, offline=True)
    found = Visit(context.new_page())
    found.page.on(
        "console", lambda m: found.errors.append(m.text) if m.type in ("error", "warning") else None
    )
    found.page.on("pageerror", lambda e: found.errors.append(str(e)))
    found.page.on("request", lambda r: found.requests.append(r.url))
    found.page.goto(file.as_uri())
    found.page.wait_for_selector("html[data-drawn]", state="attached")
    return found


@pytest.fixture(scope="module")
def opened(browser, diagnosed) -> Visit:
    return visit(browser, diagnosed / "report.html")


@pytest.fixture(scope="module")
def left_as_found(browser, diagnosed) -> Visit:
    """A page for tests that fold and zoom back what they unfolded and zoomed."""
    return visit(browser, diagnosed / "report.html")


def until(page: object, condition: str, seconds: float = 60.0) -> None:
    """Ask from outside until a condition holds: the page's policy lets nobody wait inside it (that would evaluate text)."""
    end = time.monotonic() + seconds
    while not page.evaluate(condition):
        assert time.monotonic() < end, condition
        page.wait_for_timeout(20)


def unfold(found: Visit) -> None:
    """Open everything, and wait until it is drawn."""
    found.page.evaluate("document.querySelectorAll('details').forEach(d => { d.open = true; })")
    until(found.page, "document.documentElement.dataset.drawn == document.querySelectorAll('.plot').length")


def check_drawn(found: Visit) -> list[dict]:
    unfold(found)
    plots = found.page.evaluate(DRAWN)
    assert plots
    assert found.errors == []
    for plot in plots:
        assert plot["wanted"] > 0, plot
        assert plot["seen"] == plot["wanted"], plot
        assert plot["width"] > 500, plot
        assert plot["height"] > 200, plot
        assert plot["key"] == "localisation" or all("[" in title for title in plot["titles"]), plot
    return plots


def test_every_plot_is_drawn_without_a_script_error(opened):
    plots = check_drawn(opened)
    keys = {plot["key"] for plot in plots}
    assert {
        "signal-slew",
        "localisation",
        "residual-mechanical-slew",
        "evidence-mechanical-coulomb_friction",
    } <= keys


def test_nothing_is_loaded_but_the_file(opened):
    assert len(opened.requests) == 1
    assert opened.requests[0].startswith("file:")


def test_zooming_shows_the_hundredths_of_a_second(opened):
    seen = opened.page.evaluate("""async () => {
      const plot = document.getElementById('signal-slew');
      await Plotly.relayout(plot, {'xaxis.range': [5, 5.5]});
      return plot._fullData[0].x.filter(v => v >= 5 && v <= 5.5).length;
    }""")
    assert seen >= 90  # two values each 10 ms
    box = opened.page.evaluate("document.getElementById('signal-slew')._fullLayout.xaxis.range")
    assert box == [5, 5.5]


def test_the_first_screen_shows_the_verdict_and_where_it_comes_from(opened):
    opened.page.evaluate("window.scrollTo(0, 0)")
    for text in ("explained", "synthetic log", "is missing in the mechanics"):
        box = opened.page.get_by_text(text).first.bounding_box()
        assert box is not None
        assert box["y"] + box["height"] < 900


def test_a_report_of_one_cause_is_half_as_high_as_it_once_was(left_as_found):
    """4375 px for one named cause in November 2026; what is not needed at first sight is folded, and opens."""
    page = left_as_found.page
    assert page.evaluate("document.documentElement.scrollHeight") <= 4375 / 2
    table = page.get_by_role("columnheader", name="RMSE before")
    assert not table.is_visible()
    page.get_by_text("Errors in numbers").click()
    assert table.is_visible()
    page.get_by_text("Errors in numbers").click()
    assert not table.is_visible()


def test_paper_has_the_numbers_and_the_screen_folds_them_again(left_as_found):
    page = left_as_found.page
    table = page.get_by_role("columnheader", name="RMSE before")
    page.evaluate("window.dispatchEvent(new Event('beforeprint'))")
    assert table.is_visible()
    page.evaluate("window.dispatchEvent(new Event('afterprint'))")
    assert not table.is_visible()


def test_a_plot_is_zoomed_and_moved_by_keys(left_as_found):
    page = left_as_found.page
    reach = "document.getElementById('{}').layout.xaxis.range.map(Number)"
    signal, residual = reach.format("signal-slew"), reach.format("residual-mechanical-slew")
    low, high = page.evaluate(signal)
    page.locator("#signal-slew").focus()
    page.keyboard.press("+")
    until(page, f"{signal}[1] - {signal}[0] < {0.51 * (high - low)}")
    near = page.evaluate(signal)
    until(page, f"Math.abs({residual}[0] - {near[0]}) < 1e-9")
    page.keyboard.press("ArrowRight")
    until(page, f"{signal}[0] > {near[0]}")
    page.keyboard.press("0")
    until(page, f"{signal}[1] - {signal}[0] > {0.99 * (high - low)}")


def test_a_single_cause_prints_on_four_pages_and_every_plot_within_the_paper(browser, diagnosed):
    found = visit(browser, diagnosed / "report.html")
    found.page.evaluate("window.dispatchEvent(new Event('beforeprint'))")
    found.page.wait_for_timeout(500)
    every = "[...document.querySelectorAll('.plot .main-svg')]"
    widths = found.page.evaluate(f"{every}.map(s => s.getBoundingClientRect().width)")
    assert widths
    assert max(widths) <= 700  # A4 less margins at 96 dots an inch
    printed = found.page.pdf(format="A4")
    assert printed.startswith(b"%PDF")
    assert 1 <= len(re.findall(rb"/Type\s*/Page\b", printed)) <= 4


@pytest.mark.parametrize("language", ["en", "de"])
def test_tables_fit_on_paper_and_scroll_by_themselves_on_a_phone(browser, diagnosed, tmp_path, language):
    folder = tmp_path / "page"
    shutil.copytree(diagnosed, folder)
    page = visit(browser, write_report(folder, language)).page
    page.set_viewport_size({"width": 420, "height": 900})
    until(page, "document.documentElement.scrollWidth <= 420", 10.0)  # the plots follow
    page.set_viewport_size({"width": 718, "height": 900})  # A4 less margins at 96 dots an inch
    page.emulate_media(media="print")
    tables = "[...document.querySelectorAll('table')].map(t => t.getBoundingClientRect().right)"
    assert max(page.evaluate(tables)) <= 718


def test_a_screenshot_holds_the_colours_of_both_models(opened):
    image = pytest.importorskip("PIL.Image", reason="Pillow comes with matplotlib")
    plot = opened.page.locator("#evidence-mechanical-coulomb_friction")
    with image.open(io.BytesIO(plot.screenshot())) as picture:
        colours = {colour for _, colour in picture.convert("RGB").getcolors(1 << 24)}
    for wanted in ((0xD1, 0x49, 0x5B), (0x1F, 0x6F, 0xB2)):
        assert min(sum(abs(a - b) for a, b in zip(c, wanted, strict=True)) for c in colours) < 30


def test_one_zoom_and_one_cursor_for_all_signals(browser, diagnosed):
    page = visit(browser, diagnosed / "report.html").page
    page.evaluate("Plotly.relayout(document.getElementById('signal-slew'), {'xaxis.range': [5, 6]})")
    other = "document.getElementById('residual-mechanical-slew')"
    until(page, f"String({other}.layout.xaxis.range) === '5,6'")
    page.locator("#signal-slew").scroll_into_view_if_needed()
    box = page.locator("#signal-slew").bounding_box()
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 3)
    marks = page.evaluate(
        "['signal-slew', 'residual-mechanical-slew'].map(id => { const c = document.querySelector(`#${id} .cursor`);"
        " return [c.style.display, parseFloat(c.style.left)]; })"
    )
    assert [shown for shown, _ in marks] == ["block", "block"]
    assert all(100 < left < 900 for _, left in marks)
    # what is not over the log's time keeps its own axes
    torque = page.evaluate(
        "document.getElementById('evidence-mechanical-coulomb_friction')._fullLayout.xaxis.range"
    )
    assert torque != [5, 6]


def test_what_is_within_noise_is_folded_and_a_click_on_its_block_opens_it(browser, diagnosed):
    page = visit(browser, diagnosed / "report.html").page
    assert page.locator("#signal-slew").is_visible()
    assert not page.locator("#signal-p_supply").is_visible()
    assert not page.locator("#residual-dcv-spool").is_visible()
    hot = page.locator(".chain a.hot")
    assert hot.count() == 1
    assert "mechanics" in hot.inner_text()
    hot.click()
    assert page.evaluate("location.hash") == "#cause-1"
    page.locator(".chain a", has_text="valve").focus()
    page.keyboard.press("Enter")
    until(page, "document.getElementById('residual-dcv-spool').data")
    assert page.locator("#residual-dcv-spool").is_visible()


def test_a_cause_is_taken_out_and_put_back(left_as_found):
    page = left_as_found.page
    states = (
        "document.getElementById('residual-mechanical-slew').data"
        ".filter(t => ['extended model', 'without Coulomb friction'].includes(t.name)).map(t => t.visible ?? true)"
    )
    assert page.evaluate(states) == [True, "legendonly"]
    page.get_by_role("button", name="without it").click()
    assert page.evaluate(states) == ["legendonly", True]
    page.get_by_role("button", name="with it", exact=True).click()
    assert page.evaluate(states) == [True, "legendonly"]


def test_a_german_report_can_be_explored_too(browser, diagnosed, tmp_path):
    file = tmp_path / "report.html"
    with reported_in("de"):
        file.write_text(made_page(load(diagnosed)), encoding="utf-8")
    found = visit(browser, file)
    page = found.page
    states = (
        "document.getElementById('residual-mechanical-slew').data"
        ".filter(t => ['erweitertes Modell', 'ohne Coulomb-Reibung'].includes(t.name)).map(t => t.visible ?? true)"
    )
    assert page.evaluate(states) == [True, "legendonly"]
    page.get_by_role("button", name="ohne sie").click()
    assert page.evaluate(states) == ["legendonly", True]
    page.evaluate("Plotly.relayout(document.getElementById('signal-slew'), {'xaxis.range': [5, 6]})")
    other = "document.getElementById('residual-mechanical-slew')"
    until(page, f"String({other}.layout.xaxis.range) === '5,6'")
    assert page.get_by_role("button", name="Dunkel").count() == 1
    assert found.errors == []


def test_dark_as_the_system_says_or_by_key_and_white_on_paper(browser, diagnosed):
    context = browser.new_context(color_scheme="dark", offline=True)
    page = context.new_page()
    page.goto((diagnosed / "report.html").as_uri())
    page.wait_for_selector("html[data-drawn]", state="attached")
    look = "[document.documentElement.dataset.theme, document.getElementById('signal-slew')._fullLayout.paper_bgcolor]"
    assert page.evaluate(look) == ["dark", "#12161c"]
    page.keyboard.press("d")
    until(page, f"String({look}) === 'light,#fff'")
    page.keyboard.press("d")
    until(page, f"String({look}) === 'dark,#12161c'")
    page.evaluate("window.dispatchEvent(new Event('beforeprint'))")
    until(page, f"String({look}) === 'light,#fff'")


def test_two_causes_print_on_five_pages(browser, tmp_path):
    """With every signal off and every block at fault, which makes ten pictures: more than two causes need."""
    file = tmp_path / "report.html"
    material = hidden_material("mechanical.coulomb_friction", duration=25.0, also=("continuity.flow_gain",))
    file.write_text(made_page(material), encoding="utf-8")
    page = visit(browser, file).page
    heights = "() => [...document.querySelectorAll('.plot')].filter(p => p.data).map(p => p.layout.height)"
    before = page.evaluate(heights)
    page.evaluate("window.dispatchEvent(new Event('beforeprint'))")
    page.wait_for_timeout(500)
    pages = re.findall(rb"/Type\s*/Page\b", page.pdf(format="A4"))
    assert len(page.query_selector_all(".plot")) >= 8
    assert 1 <= len(pages) <= 5
    page.evaluate("window.dispatchEvent(new Event('afterprint'))")
    page.wait_for_timeout(500)
    assert page.evaluate(heights) == before


def test_bars_logarithms_and_loops_are_drawn_too(browser, tmp_path):
    also = ("sensor.dropout", "dcv.hysteresis", "continuity.leakage", "dcv.stroke_limit")
    material = hidden_material("mechanical.compliance", duration=25.0, also=also)
    file = tmp_path / "report.html"
    file.write_text(made_page(material), encoding="utf-8")
    plots = check_drawn(visit(browser, file))
    keys = {plot["key"] for plot in plots}
    assert {f"evidence-{e.replace('.', '-')}" for e in ("mechanical.compliance", *also)} <= keys
