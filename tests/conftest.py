"""What tests of several parts share: our packages and what takes long, made once for all processes of a run."""

import dataclasses
import gc
import importlib.util
import os
import shutil
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings
from hypothesis.internal.conjecture import providers
from matplotlib.figure import Figure

from cosim.cli import main
from cosim.paths import ssp_folder
from cosim.ssp.write import write_ssp

# a busy machine may take any time for an example; the same examples every time, others with --hypothesis-profile search
settings.register_profile("search", deadline=None)
settings.register_profile("same", deadline=None, derandomize=True)
settings.load_profile("same")


def pytest_configure(config: pytest.Config) -> None:
    """Examples are not made of the numbers in whichever of our modules a process happens to have loaded."""
    if config.getoption("--hypothesis-profile", None) is None and hasattr(providers, "_get_local_constants"):
        providers._get_local_constants = lambda: providers._local_constants


CHROMIUM = ["--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-background-networking",
            "--disable-component-update", "--disable-sync"]  # fmt: skip


# files of a few long tests: begun last, one of them would keep one process busy while the others wait; the first compiles
# on a new host what the diagnosis runs, and the three behind it need nothing of it, so that it is compiled once only; so
# does the last what the tests of the live link run in two processes at once
LONG = (
    "diagnosis/test_blind.py",
    "test_closed_loop.py",
    "native/test_native_package.py",
    "clients/test_clients.py",
    "diagnosis/test_computed_logs.py",
    "diagnosis/test_forms.py",
    "test_tutorials.py",
    "test_notebooks.py",
    "test_compiled.py",
    "live/test_live_closed_loop.py",
)
SLOWEST = 1800.0  # s that one process waits for what another makes
BROWSER = 120_000.0  # ms within which a browser has done what it was asked for, on a machine with other work


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Long files first; the processes of a run take files in this order (`--no-loadscope-reorder`)."""
    tests = Path(__file__).parent
    place = {name: i for i, name in enumerate(LONG)}
    items.sort(key=lambda item: place.get(item.path.relative_to(tests).as_posix(), len(LONG)))


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Iterator[None]:
    """What is collected lasts: it is not searched for garbage, neither now nor while the tests run."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


@pytest.fixture(scope="session")
def made_once(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str, Callable[[Path], object]], Path]:
    """A folder that `make` fills, made by the first process that asks for this name; each process has a copy of its own."""
    own = tmp_path_factory.getbasetemp()
    common = own.parent if "PYTEST_XDIST_WORKER" in os.environ else own

    def folder(name: str, make: Callable[[Path], object]) -> Path:
        whole, begun = common / f"{name}_made", common / f"{name}_begun"
        until = time.monotonic() + SLOWEST
        while not whole.is_dir():
            try:
                begun.mkdir()
            except FileExistsError:
                assert time.monotonic() < until, f"{name} is not made in {SLOWEST} s"
                time.sleep(0.1)
                continue
            if whole.is_dir():  # the other one has ended since we looked, and so left this name free
                begun.rmdir()
                break
            try:
                make(begun)
            except BaseException:
                shutil.rmtree(begun)
                raise
            begun.rename(whole)
        return Path(shutil.copytree(whole, tmp_path_factory.mktemp(name) / name))

    return folder


@pytest.fixture(scope="session", autouse=True)
def heeds_interrupts() -> Iterator[None]:
    """Children get Ctrl-C even where the tests run in a shell's background, which ignores it and hands that on."""
    before = signal.getsignal(signal.SIGINT)
    if before is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture(scope="session", autouse=True)
def unsynced() -> Iterator[None]:
    """No disk is waited for: no test cuts the power, and a disk that refuses is `fault_injection`'s."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "fsync", lambda handle: None)
        yield


@pytest.fixture(scope="session")
def packages(made_once):
    """The open packages by name."""
    names = ("simplified", "full_order", "physical")

    def make(folder):
        for name in names:
            write_ssp(ssp_folder() / f"{name}.ssd", folder / f"{name}_open.ssp", open=True)

    folder = made_once("packages", make)
    return {name: folder / f"{name}_open.ssp" for name in names}


@pytest.fixture(scope="session")
def rubbing(made_once) -> Path:
    """Folder of one real diagnosis, 150 N m of dry friction in 25 s of the rig, with its report where it can be made."""
    from cosim.diagnosis.answer.answer import answer
    from cosim.diagnosis.pipeline.diagnose import diagnose
    from cosim.report.deliver import handed_over
    from cosim.report.page import save_and_report
    from cosim.rig import as_log, make_log

    def make(folder: Path) -> None:
        run = make_log("mixed", 25.0, ["mechanical.coulomb_friction:tau_c=150 N.m"], seed=4)
        log = dataclasses.replace(as_log(run), source=Path("<b>rig & co.csv"), sha256="ab" * 32)
        found = diagnose(log, folder=folder / "made")
        handed_over(found, log, folder)
        shutil.rmtree(folder / "made")
        result = answer(found, log, None)
        (folder / "diagnosis.json").write_text(result.model_dump_json(indent=2), encoding="utf-8")
        if importlib.util.find_spec("plotly") and importlib.util.find_spec("jinja2"):
            assert save_and_report(found, result, folder) == folder / "report.html"

    return made_once("diagnosis", make)


@pytest.fixture(scope="session")
def place(packages):
    """A build folder: the packages under their names."""
    folder = packages["simplified"].parent
    (folder / "ssp").symlink_to(folder, target_is_directory=True)
    return folder


@pytest.fixture
def built(place, monkeypatch):
    """The build folder of the command line."""
    monkeypatch.setenv("COSIM_BUILD", str(place))
    return place


@pytest.fixture
def command(capsys):
    """Runs the command line in this process: words -> exit code, stdout, stderr."""

    def call(*words):
        with pytest.raises(SystemExit) as stop:
            main([*map(str, words)])
        captured = capsys.readouterr()
        return stop.value.code, captured.out, captured.err

    return call


@pytest.fixture
def finished(command):
    """Runs the command line in this process: words -> what `subprocess.run` would say of it."""

    def call(*words):
        code, out, err = command(*words)
        return subprocess.CompletedProcess(words, code, out, err)

    return call


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pictures are laid out and not drawn: for tests that look at everything else that a command writes."""
    monkeypatch.setattr(Figure, "savefig", lambda figure, file, **_: Path(file).write_bytes(b"picture"))


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
        started = running.chromium.launch(
            executable_path=found, headless=True, args=CHROMIUM, timeout=BROWSER
        )
        plain = started.new_context

        def patient(**options: Any) -> Any:
            context = plain(**options)
            context.set_default_timeout(BROWSER)
            return context

        started.new_context = patient
        yield started
        started.close()
