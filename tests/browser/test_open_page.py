"""The page of `cosim open` in a real browser, from a dropped log to the report, and its end."""

import base64
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import pytest

pytestmark = pytest.mark.browser

# a page that the machine holds up may miss the first of these
WELL_UNDER_WAY = re.compile("mechanical|extended model|gain on held-out data")
# what a reader of the screen would say of each part that can be used
NAMELESS = """() => [...document.querySelectorAll('input, select, button, a')].filter(part => part.checkVisibility() &&
  !(part.getAttribute('aria-label') || part.textContent.trim() || [...(part.labels || [])].some(l => l.textContent.trim())))
  .map(part => part.outerHTML)"""


@dataclass
class Opened:
    """`cosim open` as a process of its own, and a page that shows it."""

    process: subprocess.Popen
    page: object
    url: str
    temporary: Path
    out: Path
    errors: list[str] = field(default_factory=list)
    requests: list[str] = field(default_factory=list)

    def text(self, selector: str) -> str:
        return self.page.inner_text(selector)

    def ended(self) -> tuple[int, str]:
        """Exit code and stdout; nothing of what was dropped is left."""
        out, err = self.process.communicate(timeout=600)
        assert list(self.temporary.glob("cosim-open-*")) == []
        assert "Traceback" not in err
        return self.process.returncode, out


@pytest.fixture
def opened(browser, tmp_path, request) -> Iterator[Opened]:
    """A parameter is the browser's language."""
    temporary = tmp_path / "tmp"
    temporary.mkdir()
    environment = os.environ | {
        "TMPDIR": str(temporary),
        "TEMP": str(temporary),
        "COSIM_BUILD": str(tmp_path / "build"),
    }
    process = subprocess.Popen(
        [sys.executable, "-m", "cosim", "open", "--no-browser", "--out", str(tmp_path / "out")],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, encoding="utf-8", env=environment, cwd=tmp_path,
    )  # fmt: skip
    url = process.stdout.readline().strip()
    assert url.startswith("http://127.0.0.1:"), process.communicate(timeout=30)
    context = browser.new_context(
        viewport={"width": 1180, "height": 900}, locale=getattr(request, "param", "en-GB")
    )
    found = Opened(process, context.new_page(), url, temporary, tmp_path / "out")
    found.page.on(
        "console", lambda m: found.errors.append(m.text) if m.type in ("error", "warning") else None
    )
    found.page.on("pageerror", lambda e: found.errors.append(str(e)))
    found.page.on("request", lambda r: found.requests.append(r.url))
    found.page.goto(url)
    found.page.wait_for_selector("#model option", state="attached")
    yield found
    if process.poll() is None:
        process.kill()
        process.communicate()
    context.close()


def drop(found: Opened, file: Path) -> None:
    """Drop a file on the page, as a hand does."""
    found.page.evaluate(
        """([name, text]) => {
        const carried = new DataTransfer();
        carried.items.add(new File([Uint8Array.from(atob(text), c => c.charCodeAt(0))], name));
        dispatchEvent(new DragEvent('drop', {dataTransfer: carried, cancelable: true, bubbles: true}));
    }""",
        [file.name, base64.b64encode(file.read_bytes()).decode()],
    )
    found.page.wait_for_selector("#main-rows tr, #file-error:not([hidden])")


def choose(found: Opened, signal_name: str, column: str) -> None:
    found.page.locator(f"tr[data-signal={signal_name}] select").select_option(label=column)


def test_mapped_by_hand_started_stopped_and_ended(opened, german, tmp_path):
    page = opened.page
    (tmp_path / "letter.csv").write_text("Dear all,\nno numbers here\n")
    drop(opened, tmp_path / "letter.csv")
    assert opened.text("#file-error") == "letter.csv holds no column of numbers: is it a log?"
    drop(opened, german)
    page.wait_for_selector("#main-rows tr")
    assert not page.is_visible("#file-error")
    assert "8001 samples, 8 s, 1000 a second" in opened.text("#log-facts")
    assert opened.text("#summary") == "5 of 8 signals have a column."
    assert page.locator("tr[data-signal=slew] select").input_value() == ""
    assert page.locator("tr[data-signal=u] svg path").get_attribute("d").startswith("M")
    assert page.evaluate(NAMELESS) == []

    choose(opened, "slew", "Lage")
    choose(opened, "u", "not measured")
    page.click("#diagnose")
    page.wait_for_selector("#form-error:not([hidden])")
    assert opened.text("#form-error").startswith("u (slew valve command")
    assert page.evaluate("document.activeElement.closest('tr').dataset.signal") == "u"
    refused = "Failed to load resource: the server responded with a status of 422 (Unprocessable Entity)"
    assert opened.errors == [refused] * 2, "the letter and the form, nothing else"

    choose(opened, "u", "Ventilbefehl (%)")
    page.click("#diagnose")
    page.locator("#doing", has_text=WELL_UNDER_WAY).wait_for()
    assert page.locator("#bar").get_attribute("value") is not None
    assert page.is_disabled("#model")
    page.reload()  # the page is a view: nothing is lost
    page.wait_for_selector("#stop:not([hidden])")
    assert page.locator("tr[data-signal=slew] select").input_value() == "6"
    page.click("#stop")
    page.wait_for_selector("#answer:not([hidden])")
    assert opened.text("#answer-title") == "Answer, as far as it was found"
    assert not page.is_disabled("#diagnose")
    (folder,) = opened.out.iterdir()
    assert opened.text("#folder") == str(folder)
    assert {"diagnosis.json", "mapping.toml"} <= {p.name for p in folder.iterdir()}
    page.click("#close")
    page.wait_for_selector("#gone:not([hidden])")
    code, out = opened.ended()
    assert code == 0
    assert str(folder) in out
    assert {r.split("?")[0].removeprefix(opened.url) for r in opened.requests} <= {
        "", "page.css", "page.js", "state", "file", "diagnose", "stop", "close", "report", "language", "data:,",
    }  # fmt: skip


@pytest.mark.parametrize("opened", ["de-AT"], indirect=True)
def test_a_german_browser_and_more_files_of_one_machine(opened, german, tmp_path):
    page = opened.page
    page.locator("h1", has_text="Was stimmt in der Simulation nicht?").wait_for()
    assert page.get_attribute("html", "lang") == "de"
    second, third = tmp_path / "second.csv", tmp_path / "third.csv"
    lines = german.read_bytes().splitlines(keepends=True)
    second.write_bytes(b"".join(lines[:4001]))
    third.write_bytes(b"".join(lines[:1] + lines[4001:]))
    tracker = tmp_path / "tracker.csv"
    rows = (f"{0.0125 * k:.4f},{10 + 0.01 * k:.3f}" for k in range(600))
    tracker.write_text("\n".join(["time [s],slew_external [deg]", *rows]) + "\n")
    page.set_input_files("#files", [german, second, tracker])
    page.locator("#beside-files li", has_text="tracker.csv").wait_for()
    assert opened.text("#log-facts").startswith("8001 Werte, 8 s, 1000 je Sekunde.")
    assert opened.text("#summary") == "5 von 8 Signalen haben eine Spalte."
    choose(opened, "slew", "Lage")
    page.locator("tr[data-signal=slew] [data-kind=gain]").fill("-1,5")
    page.set_input_files("#add-held-out", third)
    page.locator("#beside-files li", has_text="third.csv").wait_for()
    assert [" ".join(text.split()) for text in page.locator("#beside-files li").all_inner_texts()] == [
        "second.csv wird mit untersucht, 4000 Werte, 3,999 s Entfernen",
        "tracker.csv Aufzeichnung des Trackers, 600 Werte, 7,487 s Entfernen",
        "third.csv an ihr wird geprüft, was gewonnen ist, 4001 Werte, 4 s Entfernen",
    ]
    page.get_by_role("button", name="tracker.csv entfernen").click()
    page.locator("#beside-files li", has_text="tracker.csv").wait_for(state="detached")
    page.set_input_files("#add-more", tmp_path / "second.csv")
    page.wait_for_selector("#file-error:not([hidden])")
    assert opened.text("#file-error") == "second.csv ist dieselbe Aufzeichnung wie second.csv"
    assert page.evaluate(NAMELESS) == []

    page.select_option("#language", "en")
    page.locator("h1", has_text="What does the simulation get wrong?").wait_for()
    assert opened.text("#summary") == "6 of 8 signals have a column."
    assert page.locator("tr[data-signal=slew] select").input_value() == "6", "what was chosen stays"
    assert page.locator("tr[data-signal=slew] [data-kind=gain]").input_value() == "-1,5"
    assert page.input_value("#language") == "en"


@pytest.mark.slow
def test_ctrl_c_with_nothing_going_on_is_the_end(opened):
    opened.process.send_signal(signal.SIGINT if os.name != "nt" else signal.CTRL_C_EVENT)
    assert opened.ended()[0] == 0
    opened.page.wait_for_selector("#gone:not([hidden])", timeout=10_000)
    assert "cosim open" in opened.text("#gone")


@pytest.mark.slow
def test_from_a_log_to_the_named_cause_and_its_report(opened, german):
    page = opened.page
    page.emulate_media(color_scheme="dark")
    began = time.monotonic()
    page.set_input_files("#files", german)
    page.wait_for_selector("#main-rows tr")
    choose(opened, "slew", "Lage")
    page.click("#diagnose")
    page.wait_for_selector("#answer:not([hidden])", timeout=300_000)
    print(f"{time.monotonic() - began:.1f} s from the log to the answer")
    assert "explained" in opened.text("#lines")
    assert "dry friction (mechanical.coulomb_friction): 300" in opened.text("#lines")
    frame = page.frame_locator("#frame")
    frame.locator("html[data-drawn]").wait_for(state="attached", timeout=60_000)
    assert "friction wrong" in frame.locator("dl.told").inner_text()
    assert "Messung März" in frame.locator("h1").inner_text()
    frame.get_by_role("button", name="without it").click()  # its script runs
    # and reaches nothing: not the page, not the server
    inner = page.frames[1]
    assert (
        inner.evaluate("() => { try { return parent.document.title; } catch (e) { return e.name; } }")
        == "SecurityError"
    )
    assert inner.evaluate("fetch('state').then(r => r.status, e => 'refused')") == "refused"
    assert [
        e for e in opened.errors if "state" not in e and "SecurityError" not in e and "connect-src" not in e
    ] == []

    page.click("#diagnose")
    page.locator("#doing", has_text="mechanical").wait_for(timeout=60_000)
    opened.process.send_signal(signal.SIGINT)
    assert opened.ended()[0] == 130
    assert len([f for f in opened.out.iterdir() if (f / "diagnosis.json").is_file()]) == 2, (
        "what was found is kept"
    )
