"""What tests of several parts share: our packages, built once."""

import shutil
import signal
from collections.abc import Iterator

import pytest
from hypothesis import settings

from cosim.cli import main
from cosim.paths import ssp_folder
from cosim.ssp.write import write_ssp

# a busy machine may take any time for an example; the same examples every time, others with --hypothesis-profile search
settings.register_profile("search", deadline=None)
settings.register_profile("same", deadline=None, derandomize=True)
settings.load_profile("same")


CHROMIUM = ["--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-background-networking",
            "--disable-component-update", "--disable-sync"]  # fmt: skip


@pytest.fixture(scope="session", autouse=True)
def heeds_interrupts() -> Iterator[None]:
    """Children get Ctrl-C even where the tests run in a shell's background, which ignores it and hands that on."""
    before = signal.getsignal(signal.SIGINT)
    if before is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture(scope="session")
def packages(tmp_path_factory):
    """The open packages by name."""
    folder = tmp_path_factory.mktemp("packages")
    return {
        name: write_ssp(ssp_folder() / f"{name}.ssd", folder / f"{name}_open.ssp", open=True)
        for name in ("simplified", "full_order", "physical")
    }


@pytest.fixture
def built(packages, monkeypatch):
    """The build folder of the command line: the packages under their names."""
    folder = packages["simplified"].parent
    if not (folder / "ssp").exists():
        (folder / "ssp").symlink_to(folder, target_is_directory=True)
    monkeypatch.setenv("COSIM_BUILD", str(folder))
    return folder


@pytest.fixture
def command(capsys):
    """Runs the command line in this process: words -> exit code, stdout, stderr."""

    def call(*words):
        with pytest.raises(SystemExit) as stop:
            main([*map(str, words)])
        captured = capsys.readouterr()
        return stop.value.code, captured.out, captured.err

    return call


@pytest.fixture(scope="module")
def browser() -> Iterator[object]:
    """Debian's Chromium, headless."""
    playwright = pytest.importorskip(
        "playwright.sync_api", reason="playwright (extra 'dev') is not installed"
    )
    found = shutil.which("chromium") or shutil.which("google-chrome") or shutil.which("chromium-browser")
    if found is None:
        pytest.skip("no Chromium: apt install chromium")
    with playwright.sync_playwright() as running:
        started = running.chromium.launch(executable_path=found, headless=True, args=CHROMIUM)
        yield started
        started.close()
