"""Children forked from a process that has loaded the loop: fresh, watched and ended as if each had been started alone."""

import os
import signal
import time
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest

from cosim.errors import SimulationError
from cosim.master import Limits, Runner, apart, compiled
from cosim.master.template import AVAILABLE, Template

pytestmark = pytest.mark.skipif(not AVAILABLE, reason="Linux only")

# where it is asked: process id of the FMU's process and of that one's parent, and numbers that should be new each time
ASKED = """
        self.declare(pid=(Real, C.output, V.continuous, 0.0), parent=(Real, C.output, V.continuous, 0.0),
                     drawn=(Real, C.output, V.continuous, 0.0), plain=(Real, C.output, V.continuous, 0.0),
                     named=(Real, C.output, V.continuous, 0.0))

    def do_step(self, t, h):
        import os, random
        import numpy as np
        self.pid, self.parent = float(os.getpid()), float(os.getppid())
        self.drawn, self.plain = float(np.random.random()), random.random()
        self.named = float(os.environ.get("ASKED_OF", "0"))
        return True
"""


@pytest.fixture(scope="module")
def asked(toys: Any) -> Path:
    """An FMU of a stranger that says where it runs."""
    import toy_fmus

    toy_fmus.BODIES["asked"] = ASKED
    return toys.fmu("asked")


def last(path: Path) -> dict[str, float]:
    """The last row of a short run."""
    with Runner(path, apart=True) as runner:
        found = runner.run(0.02, 0.01)
    return {name.rpartition(".")[2]: float(values[-1]) for name, values in found.signals.items()}


def test_children_are_fresh_forks_of_one_process_that_is_not_ours(asked: Path) -> None:
    first, second = last(asked), last(asked)
    assert first["pid"] != second["pid"]
    assert first["parent"] == second["parent"]
    assert first["parent"] not in (os.getpid(), first["pid"])
    assert first["drawn"] != second["drawn"]
    assert first["plain"] != second["plain"]


def test_the_environment_is_the_one_of_now(asked: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = last(asked)
    monkeypatch.setenv("ASKED_OF", "7")
    after = last(asked)
    assert (before["named"], after["named"]) == (0.0, 7.0)
    assert before["parent"] == after["parent"]


def test_what_a_process_reads_once_makes_another_template(
    asked: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with Runner(asked, apart=True) as running:
        running.run(0.02, 0.01)
        (old,) = apart._templates
        monkeypatch.setenv("LD_LIBRARY_PATH", os.environ.get("LD_LIBRARY_PATH", "") + ":/nowhere")
        assert last(asked)["parent"] != old.pid
        assert len(running.run(0.02, 0.01).time) == 3  # its children go on
        assert psutil.pid_exists(old.pid)
    assert not psutil.pid_exists(old.pid)
    assert len(apart._templates) == 1


def test_a_template_that_is_gone_takes_its_children_and_another_is_made(asked: Path) -> None:
    with Runner(asked, apart=True) as runner:
        runner.run(0.02, 0.01)
        (template,) = apart._templates
        os.kill(template.pid, signal.SIGKILL)
        until = time.monotonic() + 60.0
        while psutil.pid_exists(runner._host._process.pid):
            assert time.monotonic() < until
            time.sleep(0.01)
        with pytest.raises(SimulationError, match="SIGKILL"):
            runner.run(0.02, 0.01)
        assert len(runner.run(0.02, 0.01).time) == 3
    assert apart._templates[0] is not template


def test_a_child_is_gone_when_it_is_closed(asked: Path) -> None:
    with Runner(asked, apart=True) as runner:
        runner.run(0.02, 0.01)
        (template,) = apart._templates
        pid = runner._host._process.pid
        assert psutil.Process(pid).ppid() == template.pid
        assert os.getpgid(pid) == pid
    until = time.monotonic() + 60.0
    while psutil.pid_exists(pid):  # no zombie either
        assert time.monotonic() < until
        time.sleep(0.01)
    assert psutil.Process(template.pid).children() == []


def test_without_a_template_the_numbers_are_the_same(toys: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    def run() -> tuple[np.ndarray, bool]:
        with Runner(toys.fmu("wave"), apart=True) as runner:
            found = runner.run(0.1, 0.01)
            return np.array(list(found.signals.values())), isinstance(runner._host._process, apart.Forked)

    forked, was_forked = run()
    with monkeypatch.context() as patch:
        patch.setattr(apart, "AVAILABLE", False)
        alone, is_forked = run()
    assert (was_forked, is_forked) == (True, False)
    assert np.array_equal(forked, alone)
    with monkeypatch.context() as patch:  # as where the environment is too long for a request
        patch.setattr(Template, "fork", lambda *_: (_ for _ in ()).throw(OSError("too long")))
        assert run()[1] is False


def test_memory_counts_from_what_the_template_has(toys: Any) -> None:
    """What all children share is no memory of the FMU's, however much of it a child touches."""
    with Runner(toys.fmu("wave"), apart=True, limits=Limits(memory=16.0)) as runner:
        assert len(runner.run(0.1, 0.01).time) == 11


def test_the_loop_that_is_loaded_is_the_one_that_runs(toys: Any) -> None:
    """Whatever is recorded: a second one would be compiled in the child, whose memory counts."""
    compiled.load()
    known = list(compiled.advance.signatures)
    with Runner(toys.ssp({"w": "wave", "l": "lag"}, ["w.y -> l.u"])) as runner:
        for record in (["w.y"], ["w.y", "l.y"]):
            runner.run(0.1, 0.01, record=record)
    assert compiled.advance.signatures == known
