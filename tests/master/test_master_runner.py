"""What a caller can ask of the Runner, and what it answers when the request or the FMU is bad."""

import csv
import gc
import itertools
import signal
import subprocess
import sys
import threading
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cosim.errors import ModelError, SimulationError, UsageError
from cosim.interrupts import ended_in_order
from cosim.master import Runner, engine, time_grid
from cosim.master.engine import EngineName
from cosim.master.instance import _unsettled
from cosim.master.runner import usually_held
from cosim.results import Result
from cosim.ssp import read_fmu
from fmus.build import build_fmu, composed_block

TOP = Path(__file__).resolve().parents[2]


@given(
    steps=st.integers(1, 100_000),
    h=st.sampled_from([1e-3, 0.1, 1 / 3, 7e-4, 2.0]),
    start=st.sampled_from([0.0, 1.5, -3.0]),
)
def test_the_grid_is_computed_not_accumulated_and_ends_at_the_stop_time(
    steps: int, h: float, start: float
) -> None:
    stop = start + steps * h
    grid, whole, notes = time_grid(start, stop, h, partial=False)
    assert (len(grid), whole, notes) == (steps + 1, steps, [])
    assert grid[-1] == stop
    k = steps // 2
    assert grid[k] == start + k * h


def test_a_stop_time_off_the_grid_is_refused_or_reached_by_a_shorter_step(toys: Any) -> None:
    with pytest.raises(UsageError, match=r"stop at 0\.9 s or 1\.2 s"):
        time_grid(0.0, 1.0, 0.3, partial=False)
    with Runner(toys.fmu("wave")) as runner:
        result = runner.run(1.0, 0.3, partial_step=True)
    assert result.time[-1] == 1.0
    assert len(result.time) == 5
    assert result["wave.y"][-1] == pytest.approx(np.sin(1.0), rel=1e-12)
    assert any("last step is 0.1 s" in note for note in result.notes)


@pytest.mark.parametrize(
    ("stop", "step"), [(0.0, 0.1), (-1.0, 0.1), (1.0, 0.0), (1.0, -0.1), (float("nan"), 0.1)]
)
def test_impossible_times_are_refused(stop: float, step: float) -> None:
    with pytest.raises(UsageError, match="cannot simulate"):
        time_grid(0.0, stop, step, partial=False)


def test_runs_do_not_see_each_other(toys: Any) -> None:
    with Runner(toys.ssp({"l": "lag", "i": "integrator"}, ["l.y -> i.u"])) as runner:
        first = runner.run(1.0, 0.1, inputs={"l.u": 1.0})
        other = runner.run(1.0, 0.1, inputs={"l.u": 1.0}, parameters={"l.T": 0.1, "i.start": 5.0})
        again = runner.run(1.0, 0.1, inputs={"l.u": 1.0})
    assert other["i.y"][0] == 5.0
    assert not np.array_equal(first["l.y"], other["l.y"])
    for name in first:
        assert np.array_equal(first[name], again[name])


def own_memory() -> int:
    """Bytes that this process has taken, without the pages of files, which come and go as the system likes (Linux)."""
    status = Path("/proc/self/status")
    lines = status.read_text(encoding="utf-8").splitlines() if status.is_file() else []
    taken = [1024 * int(line.split()[1]) for line in lines if line.startswith("RssAnon:")]
    return taken[0] if taken else int(psutil.Process().memory_info().rss)


def test_memory_stays_flat_over_many_runs(toys: Any) -> None:
    def run(times: int) -> int:
        for _ in range(times):
            runner.run(0.2, 0.01)
        gc.collect()
        return own_memory()

    with Runner(toys.ssp({"w": "wave", "l": "lag"}, ["w.y -> l.u"])) as runner:
        run(200)
        taken = [run(200) for _ in range(6)]
    # a leak grows in every window; what the system gives at once (pages made huge, a thread of another test) in one
    grown = sorted(after - before for before, after in itertools.pairwise(taken))
    assert grown[2] < (2 << 20) // 5, grown  # a fresh instance each run costs some 9 MB in each


def test_all_types_can_be_set_and_wrong_ones_are_refused(toys: Any) -> None:
    with Runner(toys.fmu("gain")) as runner:
        settings = {"gain.n": 3, "gain.on": True, "gain.label": "fancy", "gain.k": 2.0, "gain.u": 1.0}
        assert runner.run(1.0, 0.5, parameters=settings)["gain.y"][-1] == 6.0
        assert runner.run(1.0, 0.5, parameters={**settings, "gain.on": False})["gain.y"][-1] == 0.0
        for name, value, message in [
            ("gain.n", 2.5, "Integer"), ("gain.on", "yes", "Boolean"), ("gain.label", 1.0, "String"),
            ("gain.k", "two", "Real"), ("gain.k", float("nan"), "finite"), ("gain.y", 1.0, "cannot be set"),
            ("gain.kk", 1.0, r"no 'gain\.kk' to set \(closest: 'gain\.k'"),
        ]:  # fmt: skip
            with pytest.raises(UsageError, match=message):
                runner.run(1.0, 0.5, parameters={name: value})


def test_a_refused_value_shows_the_words_of_the_fmu_that_refused_it(toys: Any) -> None:
    path = toys.ssp({"a": "grumbler", "b": "gain"}, ["a.y -> b.u"])
    with (
        Runner(path) as runner,
        pytest.raises(SimulationError, match=r"'a' refuses limit = -1\.0: .*not be negative"),
    ):
        runner.run(1.0, 0.1, parameters={"a.limit": -1.0})


@pytest.mark.parametrize("engine", ["compiled", "python"])
def test_a_failing_step_names_component_time_status_and_reason(toys: Any, engine: Any) -> None:
    with Runner(toys.ssp({"w": "wave", "a": "grumbler"}, ["w.y -> a.u"])) as runner:
        discard = r"'a' failed in fmi2DoStep at t = 0\.5 s \(status Discard\): the grumbler will not go on"
        fatal = r"'a' failed in fmi2DoStep at t = 0\.3 s \(status Fatal\): .*the grumbler fell over"
        forgot = r"\(status Discard\); the FMU logged nothing: so .* 'return True', or that takes no steps of 0\.1 s"
        for name, at, message in (
            ("a.refuse_at", 0.45, discard),
            ("a.raise_at", 0.25, fatal),
            ("a.forget_at", 0.35, forgot),
        ):
            with pytest.raises(SimulationError, match=f"(?s){message}"):
                runner.run(1.0, 0.1, parameters={name: at}, engine=engine)
            assert runner.run(1.0, 0.1, engine=engine)["a.y"][-1] == pytest.approx(1.0)


def test_a_result_that_is_not_finite_is_an_error_that_names_the_component_and_keeps_what_was_before(
    toys: Any,
) -> None:
    settings = {"l.start": 1e308, "l.T": -0.5}
    with Runner(toys.ssp({"w": "wave", "l": "lag"}, ["w.y -> l.u"])) as runner:
        with pytest.raises(
            SimulationError, match=r"component 'l': 'l\.y' is not a finite number from t = "
        ) as caught:
            runner.run(1.0, 0.1, parameters=settings)
        again = runner.run(1.0, 0.1)
    partial = caught.value.partial
    assert not partial.complete
    assert 1 < len(partial.time) < 11
    assert np.isfinite(partial["l.y"]).all()
    assert partial["l.y"][-1] > 1e308
    assert np.array_equal(partial["w.y"], again["w.y"][: len(partial.time)])
    assert f"t = {partial.time[-1] + 0.1:.9g} s" in str(caught.value)
    assert again.complete, "the next run is not harmed"


@pytest.mark.parametrize(
    ("series", "message"),
    [
        (([0.0, 1.0], [0.0, float("nan")]), "not finite at sample 1"),
        (([0.0, 0.5, 0.5, 1.0], [0, 1, 2, 3]), r"does not increase from sample 1 \(0\.5 s\)"),
        (([0.0, 0.5], [0, 1]), "ends at 0.5 s, before the stop time"),
        (([0.2, 1.0], [0, 1]), "begins at 0.2 s"),
        (([0.0, 1.0], [0, 1, 2]), "equally long"),
        (float("inf"), "finite"),
    ],
)
def test_bad_series_are_refused(toys: Any, series: Any, message: str) -> None:
    with Runner(toys.fmu("lag")) as runner, pytest.raises(UsageError, match=message):
        runner.run(1.0, 0.1, inputs={"u": series}, hold=())


def test_a_held_series_may_end_one_interval_early(toys: Any) -> None:
    t = np.arange(10) * 0.1
    with Runner(toys.fmu("gain")) as runner:
        result = runner.run(1.0, 0.1, inputs={"u": (t, t)}, hold=("u",))
    assert result["gain.y"][-1] == pytest.approx(2 * 0.9)


def test_what_others_call_u_is_no_valve_command(toys: Any) -> None:
    """Our models hold their `u` over a step; an input of others acts by its declaration, whatever it is called."""
    t = np.arange(11) * 0.1
    with Runner(toys.fmu("gain")) as runner:
        assert usually_held(runner.system) == ()
        result = runner.run(1.0, 0.1, inputs={"u": (t, t)})
        assert result["gain.y"][1:] == pytest.approx(2 * t[1:]), "its value at the end of the step"
        held = runner.run(1.0, 0.1, inputs={"u": (t, t)}, hold=("u",))
        assert held["gain.y"][1:] == pytest.approx(2 * t[:-1])
    with read_fmu(build_fmu(composed_block("dead_zone"), toys.folder / "dead_zone.fmu")) as ours:
        assert usually_held(ours) == ("u",)


def test_unknown_and_doubled_inputs_are_refused(toys: Any) -> None:
    with Runner(toys.fmu("gain")) as runner:
        with pytest.raises(UsageError, match=r"no input 'v' that takes numbers"):
            runner.run(1.0, 0.1, inputs={"v": 1.0})
        with pytest.raises(UsageError, match="driven twice"):
            runner.run(1.0, 0.1, inputs={"u": 1.0, "gain.u": 1.0})
        with pytest.raises(UsageError, match="hold names 'x'"):
            runner.run(1.0, 0.1, inputs={"u": 1.0}, hold=("x",))


def test_what_to_record_is_chosen_by_name(toys: Any) -> None:
    with Runner(toys.ssp({"w": "wave", "l": "lag"}, ["w.y -> l.u", "l.y -> out"])) as runner:
        result = runner.run(1.0, 0.1, record=["out", "l.y", "l.u", "l.T"])
        assert list(result) == ["out", "l.y", "l.u", "l.T"]
        assert np.array_equal(result["out"], result["l.y"])
        assert set(result["l.T"]) == {0.5}
        everything = runner.run(1.0, 0.1)
        assert np.array_equal(everything["w.y"], result["l.u"])
        assert np.array_equal(everything["out"], result["out"])  # by the name of the system output too
        with pytest.raises(UsageError, match=r"no variable 'l\.yy' to record \(closest: 'l\.y'"):
            runner.run(1.0, 0.1, record=["l.yy"])
        with pytest.raises(UsageError, match="was not recorded"):
            everything["l.z"]


def test_progress_comes_every_thousand_steps(toys: Any) -> None:
    seen: list[float] = []
    with Runner(toys.fmu("wave")) as runner:
        runner.run(2.5, 1e-3, progress=seen.append)
    assert seen == pytest.approx([1.0, 2.0, 2.5])


def test_sigterm_that_is_a_ctrl_c_ends_the_run_between_two_calls(toys: Any) -> None:
    """Raised within the Python of an FMU it was a fatal error of the FMU."""
    with ended_in_order(), Runner(toys.fmu("wave")) as runner:
        threading.Timer(0.3, signal.raise_signal, (signal.SIGTERM,)).start()
        with pytest.raises(KeyboardInterrupt):
            runner.run(3000.0, 1e-3)
        assert len(runner.run(1.0, 0.1).time) == 11
    with Runner(toys.fmu("wave")) as runner:  # a job in the background ignores Ctrl-C, and goes on
        before = signal.signal(signal.SIGINT, signal.SIG_IGN)
        try:
            result = runner.run(10.0, 1e-3, progress=lambda t: signal.raise_signal(signal.SIGINT))
        finally:
            signal.signal(signal.SIGINT, before)
        assert len(result.time) == 10_001


@pytest.mark.parametrize("engine", ["compiled", "python"])
def test_ctrl_c_ends_the_run_and_leaves_the_runner_usable(toys: Any, engine: Any) -> None:
    with Runner(toys.fmu("wave")) as runner:
        handler = signal.getsignal(signal.SIGINT)
        with pytest.raises(KeyboardInterrupt):
            runner.run(10.0, 1e-3, engine=engine, progress=lambda t: signal.raise_signal(signal.SIGINT))
        assert signal.getsignal(signal.SIGINT) is handler
        assert len(runner.run(1.0, 0.1, engine=engine).time) == 11


def test_two_modules_of_one_name_do_not_run_each_other_s_code(
    toys: Any, build_toy: Any, tmp_path: Path
) -> None:
    other = build_toy("affine", tmp_path, name="toy_gain")
    with (
        Runner(toys.fmu("gain")),
        pytest.raises(ModelError, match=r"another FMU of this process .* 'toy_gain'"),
    ):
        Runner(other)


def test_a_closed_runner_says_so_and_has_cleaned_up(toys: Any) -> None:
    runner = Runner(toys.fmu("wave"))
    folder = runner.system.components["wave"].fmu.folder
    assert folder.exists()
    runner.close()
    runner.close()
    assert not folder.exists()
    with pytest.raises(UsageError, match="closed"):
        runner.run(1.0, 0.1)


def test_a_process_that_ran_fmus_ends_cleanly(toys: Any) -> None:
    """pythonfmu 0.7.0 releases memory twice at exit, which aborts every third process or so; the Runner prevents it."""
    before = len(_unsettled)
    with Runner(toys.fmu("wave")):
        assert len(_unsettled) == before + 1
    assert len(_unsettled) == before
    code = (
        "import sys; from cosim.master import Runner; r = Runner(sys.argv[1]); r.run(0.1, 0.01); "
        "r2 = Runner(sys.argv[1]); r2.run(0.1, 0.01)"  # neither is closed
    )
    for _ in range(3):
        done = subprocess.run(
            [sys.executable, "-c", code, str(toys.fmu("wave"))], cwd=TOP, capture_output=True, check=False
        )
        assert (done.returncode, done.stderr) == (0, b"")


@pytest.mark.parametrize("suffix", [".csv", ".parquet", ".mat"])
def test_results_are_written_and_read_back_exactly(toys: Any, tmp_path: Path, suffix: str) -> None:
    import pandas as pd
    from scipy.io import loadmat

    with Runner(toys.ssp({"w": "wave", "g": "gain"}, ["w.y -> g.u"])) as runner:
        result: Result = runner.run(1.0, 0.01)
    path = result.write(tmp_path / "deep" / f"out{suffix}")
    if suffix == ".mat":
        found = loadmat(path, simplify_cells=True)
        heads = [f"{n} [{u}]" for n, u in zip(found["names"], found["units"], strict=True)]
        table = dict(zip(heads, found["data"].T, strict=True))
    else:
        if suffix == ".csv":
            head, *rows = csv.reader(path.read_text(encoding="utf-8").splitlines())
            frame = pd.DataFrame([[float(cell) for cell in row] for row in rows], columns=head)
        else:
            frame = pd.read_parquet(path)
        table = {name: frame[name].to_numpy() for name in frame}
    assert list(table) == ["time [s]", "w.y [1]", "g.y [m]"]
    for name, values in result.columns().items():
        assert np.array_equal(table[name], values), name
    with pytest.raises(UsageError, match="none of them"):
        result.write(tmp_path / "out.xlsx")


@pytest.mark.parametrize("name", ["compiled", "python"])
def test_pieces_are_the_run_bit_by_bit(toys: Any, monkeypatch: pytest.MonkeyPatch, name: EngineName) -> None:
    stamps = np.linspace(0.0, 3.0, 37)
    options: dict[str, Any] = {
        "inputs": {"l.u": (stamps, np.sin(5.0 * stamps)), "h.u": (stamps, np.cos(9.0 * stamps))},
        "hold": ["h.u"],
        "record": ["l.y", "h.y", "i.y", "l.u", "h.u"],
        "partial_step": True,
        "engine": name,
    }
    package = toys.ssp({"l": "lag", "h": "lag", "i": "integrator"}, ["l.y -> i.u"])
    seen: list[float] = []
    with Runner(package) as runner:
        whole = runner.run(2.505, 0.01, **options)
        monkeypatch.setattr(engine, "PIECE", 7)
        pieces: dict[str, list[Any]] = {y: [] for y in whole}

        def take(first: int, piece: Mapping[str, Any]) -> None:
            for y, values in piece.items():
                assert first == sum(map(len, pieces[y]))
                pieces[y].append(values)

        streamed = runner.run(2.505, 0.01, sink=take, progress=seen.append, **options)
        kept = runner.run(2.505, 0.01, **options)
    assert streamed.signals == {}
    assert streamed.units == whole.units
    for y in whole:
        assert len(pieces[y]) == 37  # 36 for 250 steps, one for the shorter last one
        assert np.concatenate(pieces[y]).tobytes() == whole[y].tobytes() == kept[y].tobytes()
    assert seen[-1] == pytest.approx(2.505)
    assert seen == sorted(seen)


def test_integers_and_booleans_are_signals_too_held_over_each_step(toys: Any) -> None:
    time = 0.1 * np.arange(31)
    gear, on = np.where(time < 1.0, 1.0, 3.0), np.where(time < 2.0, 1.0, 0.0)
    names = ["gearbox.y", "gearbox.shown", "gearbox.moves", "gearbox.gear"]
    results = []
    for way in ("compiled", "python"):
        with Runner(toys.fmu("gearbox")) as runner:
            inputs = {"u": 1.0, "gear": (time, gear), "gearbox.on": (time, on)}
            results.append(runner.run(3.0, 0.1, inputs=inputs, record=names, engine=way))
            assert set(runner.run(0.2, 0.1).signals) == {"gearbox.y", "gearbox.shown", "gearbox.moves"}
    found, again = results
    for name in names:
        assert np.array_equal(found[name], again[name])
    y = np.zeros(time.size)
    for k in range(30):
        y[k + 1] = y[k] + (1.0 - np.exp(-0.5)) * (gear[k] * on[k] - y[k])
    np.testing.assert_allclose(found["gearbox.y"], y, rtol=1e-12)
    assert np.array_equal(found["gearbox.shown"][1:], gear[:-1])
    assert np.array_equal(found["gearbox.moves"][1:], (y[1:] > 0.5).astype(float))


def test_a_whole_number_can_drive_a_real_input(toys: Any) -> None:
    """easySSP connects a counter so, its connector declared as Real: nothing is lost on the way."""
    boxes = {"a": "gearbox", "g": "gain"}
    time = 0.1 * np.arange(11)
    gear = np.where(time < 0.45, 1.0, 3.0)
    results = []
    for way in ("compiled", "python"):
        wires = ["gear -> a.gear", "a.shown -> g.u"]
        with Runner(toys.ssp(boxes, wires, kinds={"a.shown": "output"})) as runner:
            result = runner.run(
                1.0, 0.1, inputs={"gear": (time, gear)}, record=["a.shown", "g.u", "g.y"], engine=way
            )
        assert any("hands a whole number on as a Real" in note for note in result.notes)
        results.append(result)
    for result in results:
        assert set(result["a.shown"]) == {0.0, 1.0, 3.0}
        assert np.array_equal(result["g.u"], result["a.shown"])
        # what is discrete is handed over at the start of the next step
        assert np.array_equal(result["g.y"][1:], 2.0 * result["a.shown"][:-1])


def test_a_boolean_output_can_drive_a_boolean_input_but_no_real_one(toys: Any) -> None:
    kinds = {"a.moves": "output"}
    boxes = {"a": "gearbox", "b": "gearbox"}
    wires = ["u -> a.u", "u -> b.u", "a.moves -> b.on"]
    plain = toys.ssp(boxes, wires, kinds=kinds)
    with zipfile.ZipFile(plain) as archive:
        entries = {n: archive.read(n) for n in archive.namelist()}
    text = entries["SystemStructure.ssd"].decode()
    for name in ("moves", "on"):
        head, _, tail = text.partition(f'<ssd:Connector name="{name}"')
        text = head + f'<ssd:Connector name="{name}"' + tail.replace("<ssc:Real/>", "<ssc:Boolean/>", 1)
    target = plain.with_name("clutch.ssp")
    with zipfile.ZipFile(target, "w") as archive:
        for name, content in entries.items():
            archive.writestr(name, text if name == "SystemStructure.ssd" else content)
    with Runner(target) as runner:
        result = runner.run(2.0, 0.1, inputs={"u": 1.0}, record=["a.y", "a.moves", "b.y", "b.on"])
    assert np.array_equal(result["b.on"], result["a.moves"])
    first = int(np.argmax(result["a.moves"] > 0.0))
    assert 0 < first < 10
    assert np.all(result["b.y"][: first + 1] == 0.0)  # handed over at the start of the next step
    assert result["b.y"][first + 1] > 0.0
    with (
        pytest.raises(ModelError, match="joins the types Boolean and Real"),
        Runner(toys.ssp(boxes, ["a.moves -> b.u"], kinds=kinds)),
    ):
        pass
