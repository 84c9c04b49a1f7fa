"""FMUs of strangers cannot take the tool down: each death, hang and hunger ends in exit code 4 with the component's name."""

import json
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import bad_fmus
import numpy as np
import pandas as pd
import psutil
import pytest
import toy_fmus

from cosim import trust
from cosim.errors import SimulationError, UsageError
from cosim.master import Limits, Runner, apart, engine

TOP = Path(__file__).resolve().parents[2]
needs_compiler = pytest.mark.skipif(
    bad_fmus.COMPILER is None or not sys.platform.startswith("linux"), reason="needs Linux and a C compiler"
)
LIMITS = Limits(memory=200.0)  # a machine that is held up shall not look like an FMU that hangs
HANGS = Limits(stall=3.0, memory=200.0)


@pytest.fixture(scope="session")
def bad(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """Builds a bad FMU once."""
    folder, built = tmp_path_factory.mktemp("bad"), {}

    def get(mischief: str) -> Path:
        if mischief not in built:
            built[mischief] = bad_fmus.build(mischief, folder)
        return built[mischief]

    return get


@pytest.fixture(scope="session")
def system(bad: Any, toys: Any, tmp_path_factory: pytest.TempPathFactory) -> Any:
    """A package of a bad component between two good ones."""

    def get(mischief: str) -> Path:
        path = tmp_path_factory.mktemp("systems") / f"{mischief}.ssp"
        fmus = {"wave": toys.fmu("wave"), "bad": bad(mischief), "gain": toys.fmu("gain")}
        parts = {"first": "wave", "stranger": "bad", "last": "gain"}
        description = toy_fmus.ssd(parts, ["first.y -> stranger.u", "stranger.y -> last.u"])
        return toy_fmus.pack(path, description, fmus)

    return get


def simulate(*words: object, **more: str) -> "subprocess.CompletedProcess[str]":
    command = [sys.executable, "-m", "cosim", "simulate", *map(str, words)]
    env = {**os.environ, **more}
    return subprocess.run(command, cwd=TOP, env=env, capture_output=True, text=True, check=False, timeout=600)


DEATHS = {
    "EXIT": r"ended its process \(exit code 0\)",
    "ABORT": "SIGABRT",
    "SEGV": "SIGSEGV",
    "BUS": "SIGBUS",
    "LOOP": "did not come back within 3 s",
    "HOG": "took more than 200 MiB of memory",
    "NEGATIVE": r"status -1",
    "UNKNOWN": r"status 77",
    "SAYS": r"exit code 7.*: no licence for 3 seats",
}


@needs_compiler
@pytest.mark.parametrize("mischief", DEATHS)
def test_what_a_stranger_does_is_an_error_that_names_it_and_keeps_what_was_reached(
    system: Any, mischief: str
) -> None:
    with Runner(system(mischief), limits=HANGS if mischief == "LOOP" else LIMITS) as runner:
        assert runner.apart
        with pytest.raises(SimulationError, match=f"component 'stranger' .*{DEATHS[mischief]}") as caught:
            runner.run(1.0, 0.01)
        assert "t = 0.5 s" in str(caught.value)
        partial = caught.value.partial
        assert partial is not None
        assert not partial.complete
        assert partial.time[-1] == pytest.approx(0.5)
        assert np.allclose(partial["stranger.y"], np.arange(51) * 0.01)
        assert partial["last.y"].shape == (51,)
        assert any("incomplete, up to t = 0.5 s" in note for note in partial.notes)
        if mischief == "EXIT":  # it runs again, in a new child
            assert len(runner.run(0.5, 0.01).time) == 51


@needs_compiler
@pytest.mark.parametrize(
    ("mischief", "where"),
    [
        ("AT_LOAD", "while its library was loaded"),
        ("AT_INSTANTIATE", "in fmi2Instantiate"),
        ("AT_INITIALISE", "in fmi2EnterInitializationMode"),
        ("AT_END", "in fmi2Terminate"),
    ],
)
def test_a_death_outside_the_loop_says_where(system: Any, mischief: str, where: str) -> None:
    with (
        pytest.raises(SimulationError, match=f"'stranger' .*{where}") as caught,
        Runner(system(mischief), limits=LIMITS) as runner,
    ):
        runner.run(1.0, 0.01)
    partial = caught.value.partial
    assert (partial is not None) == (mischief == "AT_END")
    assert partial is None or not partial.complete


@needs_compiler
def test_the_copy_that_an_fmu_makes_of_its_process_answers_nothing(system: Any) -> None:
    with Runner(system("FORKS"), limits=LIMITS) as runner:
        for _ in range(3):
            result = runner.run(1.0, 0.01)
            assert result.complete
            assert np.allclose(result["stranger.y"], result.time)


@needs_compiler
def test_a_process_that_dies_after_its_steps_leaves_them(system: Any) -> None:
    with (
        Runner(system("CLOSES"), limits=LIMITS) as runner,
        pytest.raises(SimulationError, match=r"stranger.*between their calls") as caught,
    ):
        runner.run(1.0, 0.01)
    partial = caught.value.partial
    assert partial is not None
    assert not partial.complete
    assert partial.time[-1] >= 0.99 - 1e-9
    assert np.allclose(partial["stranger.y"], partial.time)


@needs_compiler
def test_what_a_stranger_says_is_cut_and_moves_no_cursor(system: Any) -> None:
    with Runner(system("SHOUTS"), limits=LIMITS) as runner, pytest.raises(SimulationError) as caught:
        runner.run(1.0, 0.01)
    text = str(caught.value)
    assert "\N{REPLACEMENT CHARACTER}[2Jxxx" in text
    assert "\033" not in text
    assert len(text) < 10_000
    assert text.endswith("x ...")


@needs_compiler
def test_a_stranger_s_numbers_are_those_of_the_same_fmu_in_this_process(system: Any, toys: Any) -> None:
    path = system("NONE")
    with Runner(path, apart=False) as inside, Runner(path) as outside:
        assert (inside.apart, outside.apart) == (False, True)
        for name in ("compiled", "python"):
            one, two = (r.run(1.005, 0.01, partial_step=True, engine=name) for r in (inside, outside))
            assert list(one) == list(two)
            for y in one:
                assert one[y].tobytes() == two[y].tobytes()
    # an FMU in this process puts its folder on the search path, which is no business of the child's
    with Runner(toys.fmu("wave")) as here, Runner(toys.fmu("wave"), apart=True) as there:
        assert (here.apart, there.apart) == (False, True)
        assert here.run(1.0, 0.1)["wave.y"].tobytes() == there.run(1.0, 0.1)["wave.y"].tobytes()


@needs_compiler
def test_pieces_come_out_of_the_child_whole(toys: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    stamps = np.linspace(0.0, 1.0, 11)
    options: Any = {"inputs": {"u": (stamps, np.sin(stamps))}, "hold": ()}
    monkeypatch.setattr(engine, "PIECE", 100_000)
    with Runner(toys.fmu("gain"), apart=True) as runner:
        whole = runner.run(150.0 / 150.0, 1.0 / 150_000, **options)
        seen: list[int] = []
        runner.run(
            1.0, 1.0 / 150_000, sink=lambda first, piece: seen.extend((first, len(piece["u"]))), **options
        )
    assert np.allclose(whole["gain.y"], 2.0 * np.interp(whole.time, stamps, np.sin(stamps)), atol=1e-12)
    assert seen == [0, 100_001, 100_001, 50_000]


@needs_compiler
def test_progress_of_a_stranger_s_run_ends_with_the_run(toys: Any) -> None:
    seen: list[float] = []
    with Runner(toys.fmu("wave"), apart=True) as runner:
        runner.run(0.5, 0.01, progress=seen.append)  # shorter than the time between two looks at the child
    assert seen[-1] == pytest.approx(0.5)
    assert seen == sorted(seen)


@needs_compiler
def test_what_a_stranger_prints_is_no_answer(system: Any) -> None:
    done = simulate(system("CHATTER"), "--json")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["steps"] == 100
    assert '"piece": 0' in done.stderr


@needs_compiler
@pytest.mark.parametrize("many", [False, True])
def test_of_many_runs_only_the_first_prints(system: Any, capfd: Any, many: bool) -> None:
    with Runner(system("CHATTER"), limits=LIMITS, many=many) as runner:
        runner.run(1.0, 0.01)
        first = capfd.readouterr()
        runner.run(1.0, 0.01)
        again = capfd.readouterr()
    assert '"piece": 0' in first.err
    assert ('"piece": 0' in again.err) is not many
    assert first.out == again.out == ""


@needs_compiler
def test_the_command_ends_with_4_and_writes_what_was_reached(system: Any, tmp_path: Path) -> None:
    out = tmp_path / "out.csv"
    done = simulate(system("HOG"), "--out", out, "--json", "--memory", "200 MiB")
    assert done.returncode == 4, done.stderr
    found = json.loads(done.stdout)
    assert found["exit_code"] == 4
    assert "component 'stranger'" in found["error"]
    assert found["partial"]["complete"] is False
    assert found["partial"]["stop_time"] == pytest.approx(0.5)
    assert not out.exists()  # it would look like a result
    frame = pd.read_csv(tmp_path / "out.partial.csv")
    assert frame["stranger.y [m]"].iloc[-1] == pytest.approx(0.5)
    assert found["partial"]["path"].endswith("out.partial.csv")
    assert "out.partial.csv" in done.stderr


@needs_compiler
def test_stall_is_an_option_and_an_environment_variable(system: Any) -> None:
    for words, env in ((["--stall", "500 ms"], {}), ([], {"COSIM_STALL": "0.5"})):
        done = simulate(system("LOOP"), *words, **env)
        assert done.returncode == 4, done.stderr
        assert "did not come back within 0.5 s" in done.stderr


@needs_compiler
def test_one_that_fills_the_memory_and_takes_long_for_it_has_filled_the_memory(bad: Any) -> None:
    with Runner(bad("NONE"), limits=LIMITS) as runner:
        child: Any = runner._host
        child._allowed = 0.0
        with pytest.raises(apart._DeathError, match="MiB of memory"):
            child._watch(1e9)


# an interrupt may come just when psutil has opened a file of the child: Python closes it, with a warning
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@needs_compiler
def test_ctrl_c_ends_a_child_that_hangs_and_leaves_none(bad: Any) -> None:
    before = {p.pid for p in psutil.Process().children(recursive=True)}
    with Runner(bad("LOOP")) as runner:
        threading.Timer(1.5, signal.raise_signal, (signal.SIGINT,)).start()
        begun = time.monotonic()
        with pytest.raises(KeyboardInterrupt):
            runner.run(1.0, 0.01)
        assert time.monotonic() - begun < 10.0
        assert len(runner.run(0.5, 0.01).time) == 51  # a new child
    before |= {template.pid for template in apart._templates}  # begun with the first child, and kept
    left = [p for p in psutil.Process().children(recursive=True) if p.pid not in before]
    # who has ended is a zombie until the template hears that we need it no more
    assert psutil.wait_procs(left, timeout=600.0)[1] == []


@needs_compiler
def test_a_child_ends_with_its_parent(bad: Any) -> None:
    code = (
        "import sys; from pathlib import Path; from cosim.master import Runner; r = Runner(Path(sys.argv[1])); "
        "print(r._host._process.pid, flush=True); r.run(1.0, 0.01)"
    )
    command = [sys.executable, "-c", code, str(bad("LOOP"))]
    with subprocess.Popen(command, cwd=TOP, stdout=subprocess.PIPE, text=True) as parent:
        assert parent.stdout is not None
        child = psutil.Process(int(parent.stdout.readline()))
        time.sleep(0.5)
        parent.kill()
    gone, alive = psutil.wait_procs([child], timeout=600.0)
    assert (len(gone), alive) == (1, [])


@needs_compiler
def test_a_changed_byte_makes_an_fmu_a_stranger(toys: Any, tmp_path: Path) -> None:
    source = toys.fmu("wave")
    assert trust.is_ours(source)
    assert trust.is_ours(source.read_bytes())
    copy = tmp_path / "copy.fmu"
    copy.write_bytes(source.read_bytes() + b"\0")
    assert not trust.is_ours(copy)


@pytest.mark.parametrize(
    ("stall", "memory"), [(0.0, 100.0), (-1.0, 100.0), (float("nan"), 100.0), (1.0, 1.0)]
)
def test_limits_that_are_none_are_refused(stall: float, memory: float) -> None:
    with pytest.raises(UsageError, match="limit"):
        Limits(stall, memory)


def test_limits_come_from_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COSIM_STALL", "7")
    assert Limits.usual() == Limits(7.0)
    monkeypatch.setenv("COSIM_STALL", "soon")
    with pytest.raises(UsageError, match="COSIM_STALL=soon is no number"):
        Limits.usual()
