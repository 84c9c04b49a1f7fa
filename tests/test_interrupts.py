"""Ctrl-C waits for compiled code, and is not lost."""

import contextlib
import importlib
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from importlib.machinery import SourceFileLoader
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
import typer

from cosim import cli
from cosim.compiled import CompiledBlock, load_compiled
from cosim.interrupts import ended_in_order, often_uninterrupted, stoppable, uninterrupted
from fmus import registry
from fmus.compose import compose

pytestmark = pytest.mark.skipif(os.name == "nt", reason="signals of POSIX")

STRUCK = """
import os, random, signal, threading
import numpy as np
from cosim.compiled import compiled_block
signal.signal(signal.SIGINT, signal.default_int_handler)
block, inputs, caught = compiled_block("mechanical"), np.full((1, 20), 1e5), 0
block.run(inputs, 1e-3, {"tau_c": 90.0})
random.seed(1)
for _ in range(60):
    strike = threading.Timer(random.uniform(0.001, 0.01), os.kill, (os.getpid(), signal.SIGINT))
    try:
        strike.start()
        while True:
            block.run(inputs, 1e-3, {"tau_c": 90.0})
    except KeyboardInterrupt:
        caught += 1
    strike.join()
print(caught)
"""


def test_ctrl_c_within_compiled_code_does_not_kill_the_process() -> None:
    done = subprocess.run([sys.executable, "-c", STRUCK], capture_output=True, text=True, check=False)
    assert done.returncode == 0, (done.returncode, done.stderr[-2000:])
    assert done.stdout.strip() == "60"


def struck_twice(reached: list[bool]) -> None:
    with uninterrupted():
        os.kill(os.getpid(), signal.SIGINT)
        os.kill(os.getpid(), signal.SIGINT)
        reached.append(True)


@pytest.mark.parametrize("around", [contextlib.nullcontext, often_uninterrupted])
def test_the_handler_is_called_when_the_block_ends(
    around: Callable[[], contextlib.AbstractContextManager[None]],
) -> None:
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    reached: list[bool] = []
    try:
        with pytest.raises(KeyboardInterrupt), around():
            struck_twice(reached)
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    finally:
        signal.signal(signal.SIGINT, before)
    assert reached == [True]


def test_between_many_runs_handlers_are_called_at_once_and_set_once(monkeypatch: pytest.MonkeyPatch) -> None:
    came: list[int] = []
    before = signal.signal(signal.SIGINT, lambda number, frame: came.append(number))
    own = signal.getsignal(signal.SIGINT)
    try:
        with often_uninterrupted():
            with monkeypatch.context() as patched:
                patched.delattr(signal, "signal")
                struck_twice([])
            assert came == [signal.SIGINT]  # the first one's, once the block had ended
            os.kill(os.getpid(), signal.SIGINT)
            assert came == [signal.SIGINT] * 2
        assert signal.getsignal(signal.SIGINT) is own
    finally:
        signal.signal(signal.SIGINT, before)


def test_a_signal_that_strikes_as_others_are_held_back_leaves_their_handlers(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Python calls handlers of what has come already when one is set; Ctrl-C was without any effect from then on."""
    usual = signal.signal
    before = usual(signal.SIGTERM, lambda number, frame: None)

    def struck(number: signal.Signals, handler: Any) -> Any:
        if number == signal.SIGTERM:
            monkeypatch.undo()
            raise KeyboardInterrupt
        return usual(number, handler)

    try:
        monkeypatch.setattr(signal, "signal", struck)
        with pytest.raises(KeyboardInterrupt), uninterrupted():
            pytest.fail("the signal was lost")
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    finally:
        usual(signal.SIGTERM, before)


def test_what_is_ignored_stays_ignored_and_other_threads_are_left_alone() -> None:
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with uninterrupted():
            os.kill(os.getpid(), signal.SIGINT)
            assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGINT, before)
    seen = []

    def inside() -> None:
        with uninterrupted():
            seen.append(signal.getsignal(signal.SIGINT))

    thread = threading.Thread(target=inside)
    thread.start()
    thread.join()
    assert seen == [before]


def test_ctrl_c_while_compiled_code_is_loaded_leaves_nothing_half_loaded(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def struck(loader: SourceFileLoader, module: ModuleType) -> None:
        raise KeyboardInterrupt

    composed = compose(registry.block("sensor"))
    name = load_compiled(composed).__name__
    monkeypatch.delitem(sys.modules, name)
    with monkeypatch.context() as patched:
        patched.setattr(SourceFileLoader, "exec_module", struck)
        with pytest.raises(KeyboardInterrupt):
            load_compiled(composed)
    assert hasattr(CompiledBlock(composed).module, "begin")


def struck_again_within_compiled_code(first: signal.Signals, reached: list[str]) -> None:
    os.kill(os.getpid(), first)
    reached.append("goes on")
    with uninterrupted():
        os.kill(os.getpid(), signal.SIGTERM)
        reached.append("inside")
    reached.append("never")


@pytest.mark.parametrize("first", [signal.SIGINT, signal.SIGTERM])
def test_the_first_signal_asks_and_the_second_ends_once_compiled_code_has(first: signal.Signals) -> None:
    before = [signal.getsignal(s) for s in (signal.SIGINT, signal.SIGTERM)]
    asked: list[bool] = []
    reached: list[str] = []

    def stop() -> bool:
        asked.append(True)
        return len(asked) == 1

    with pytest.raises(KeyboardInterrupt), stoppable(stop):
        struck_again_within_compiled_code(first, reached)
    assert reached == ["goes on", "inside"]
    assert len(asked) == 2
    assert [signal.getsignal(s) for s in (signal.SIGINT, signal.SIGTERM)] == before


TERMINATED = """
import tempfile, time
import typer
from cosim import cli
def stuck():
    with tempfile.TemporaryDirectory() as folder:
        print(folder, flush=True)
        time.sleep(60)
cli.make_app = lambda: app
app = typer.Typer(cls=cli._Group)
app.command()(stuck)
app.command("other")(lambda: None)
cli.main(["stuck"])
"""


def test_sigterm_ends_a_command_in_order() -> None:
    process = subprocess.Popen(
        [sys.executable, "-c", TERMINATED], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    folder = Path(process.stdout.readline().strip())
    assert folder.is_dir()
    process.terminate()
    _, said = process.communicate(timeout=600)
    assert (process.returncode, said) == (130, "error: interrupted\n")
    assert not folder.exists()


def test_a_signal_within_an_import_waits_for_its_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "struck_module.py").write_text(
        "import os, signal\nos.kill(os.getpid(), signal.SIGINT)\nos.kill(os.getpid(), signal.SIGTERM)\nwhole = True\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    before = [signal.getsignal(s) for s in (signal.SIGINT, signal.SIGTERM)]
    came: list[int] = []
    with pytest.raises(KeyboardInterrupt), ended_in_order(came):
        time.sleep(10.0 * importlib.import_module("struck_module").whole)
    assert came
    assert [signal.getsignal(s) for s in (signal.SIGINT, signal.SIGTERM)] == before


def test_an_end_of_file_is_no_ctrl_c() -> None:
    """Typer takes one for the other: what another process no longer said was "interrupted"."""
    ending = typer.Typer(cls=cli._Group)

    @ending.command()
    def first() -> None:
        raise EOFError("unexpected EOF")

    @ending.command()
    def second() -> None:
        return

    with pytest.raises(RuntimeError, match="unexpected EOF"):
        ending(["first"], standalone_mode=False)


DROPPED = """
import os, signal, sys, time, weakref
from cosim.interrupts import ended_in_order
class Thing: pass
thing = Thing()
held = weakref.ref(thing, lambda _: os.kill(os.getpid(), signal.SIGTERM) or time.sleep(0.5))
try:
    with ended_in_order():
        del thing
        time.sleep(30.0)
    print("went on")
except KeyboardInterrupt:
    print("ended")
"""


def test_a_signal_within_a_callback_whose_errors_python_drops_strikes_after_it() -> None:
    done = subprocess.run(
        [sys.executable, "-c", DROPPED], capture_output=True, text=True, timeout=60, check=False
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "ended\n", "")


SCRATCH = """
import os, signal, sys, tempfile
from cosim.interrupts import ended_in_order
from cosim.ssp.archive import scratch_folder
made, removed = tempfile.mkdtemp, tempfile.TemporaryDirectory._rmtree.__func__
def struck_mkdtemp(*words):
    folder = made(*words)
    os.kill(os.getpid(), signal.SIGTERM)
    return folder
def struck_rmtree(cls, name, **options):
    os.kill(os.getpid(), signal.SIGTERM)
    removed(cls, name, **options)
try:
    with ended_in_order():
        if sys.argv[1] == "made":
            tempfile.mkdtemp = struck_mkdtemp
        folder, _ = scratch_folder()
        tempfile.TemporaryDirectory._rmtree = classmethod(struck_rmtree)
        folder.cleanup()
except KeyboardInterrupt:
    print("ended")
"""


@pytest.mark.parametrize("when", ["made", "removed"])
def test_no_signal_leaves_a_temporary_folder_behind(when: str, tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-c", SCRATCH, when],
        capture_output=True, text=True, timeout=60, check=False, env=os.environ | {"TMPDIR": str(tmp_path)},
    )  # fmt: skip
    assert (done.returncode, done.stdout, done.stderr) == (0, "ended\n", "")
    assert list(tmp_path.iterdir()) == []


MADE = """
import os, signal, tempfile, time
from cosim.interrupts import ended_in_order
plain = os.open
def opened(*arguments):
    handle = plain(*arguments)
    os.open = plain
    os.kill(os.getpid(), signal.SIGTERM)
    return handle
with ended_in_order():
    os.open = opened
    try:
        tempfile.gettempdir()
        time.sleep(60.0)
    except KeyboardInterrupt:
        print("ended")
"""


def test_python_leaves_no_file_of_its_search_for_the_temporary_folder(tmp_path: Path) -> None:
    """It tries the folder with a file of eight letters; a signal before that is taken away left it there."""
    environment = os.environ | {"TMPDIR": str(tmp_path)}
    done = subprocess.run(
        [sys.executable, "-c", MADE], env=environment, capture_output=True, text=True, check=False
    )
    assert done.stdout.strip() == "ended", done.stderr
    assert not list(tmp_path.iterdir())
