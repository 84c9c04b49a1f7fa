"""Things done to an FMU in a process of its own, because a defect would end the process.

``python fmu_scenarios.py refuse <folder>`` commits every bad use of the table below, each with an instance of its own, and
prints one JSON object by name: status, messages, status of the next step, and whether the values are still readable.
"""

import json
import math
import shutil
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from fmu_raw import OK, Instance

BAD_USE: dict[str, Callable[[Instance], int]] = {}


def bad(function: Callable[[Instance], int]) -> Callable[[Instance], int]:
    """Add to the table. The function uses the instance badly; a name with `early` gets it before initialisation."""
    BAD_USE[function.__name__] = function
    return function


def set_real(slave: Instance, name: str, value: float) -> int:
    return slave.status(slave.fmu.setReal, [slave.vr[name]], [value])


def number(value: float) -> Callable[[Instance], int]:
    return lambda s: set_real(s, s.inputs[0], value)


BAD_USE["nan"] = number(math.nan)
BAD_USE["infinite"] = number(math.inf)
BAD_USE["minus_infinite"] = number(-math.inf)
BAD_USE["out_of_range"] = number(1e11)
NEED_AN_INPUT = tuple(BAD_USE.values())
BAD_USE["zero_step"] = lambda s: s.step(0.01, 0.0)
BAD_USE["negative_step"] = lambda s: s.step(0.01, -1e-3)
BAD_USE["nan_step"] = lambda s: s.step(0.01, math.nan)
BAD_USE["infinite_step"] = lambda s: s.step(0.01, math.inf)


@bad
def parameter_after_initialisation(s: Instance) -> int:
    return set_real(s, parameter(s), 1.0)


@bad
def output_set(s: Instance) -> int:
    return set_real(s, s.outputs[0], 0.0)


@bad
def unknown_reference_set(s: Instance) -> int:
    return s.status(s.fmu.setReal, [999], [0.0])


@bad
def unknown_reference_read(s: Instance) -> int:
    return s.status(s.fmu.getReal, [999])


@bad
def real_set_as_integer(s: Instance) -> int:
    return s.status(s.fmu.setInteger, [0], [1])


@bad
def real_read_as_integer(s: Instance) -> int:
    return s.status(s.fmu.getInteger, [0])


@bad
def boolean_set(s: Instance) -> int:
    return s.status(s.fmu.setBoolean, [0], [True])


@bad
def boolean_read(s: Instance) -> int:
    return s.status(s.fmu.getBoolean, [0])


@bad
def string_set(s: Instance) -> int:
    return s.status(s.fmu.setString, [0], ["x"])


@bad
def string_read(s: Instance) -> int:
    return s.status(s.fmu.getString, [0])


@bad
def early_out_of_range(s: Instance) -> int:
    return set_real(s, parameter(s), 1e11)


@bad
def early_nan(s: Instance) -> int:
    return set_real(s, parameter(s), math.nan)


@bad
def early_step(s: Instance) -> int:
    return s.step(0.0)


@bad
def early_exit(s: Instance) -> int:
    return s.status(s.fmu.exitInitializationMode)


@bad
def early_bad_start_time(s: Instance) -> int:
    return s.status(lambda: s.fmu.setupExperiment(startTime=math.nan))


@bad
def enter_again(s: Instance) -> int:
    return s.status(s.fmu.enterInitializationMode)


@bad
def exit_again(s: Instance) -> int:
    return s.status(s.fmu.exitInitializationMode)


@bad
def setup_again(s: Instance) -> int:
    return s.status(lambda: s.fmu.setupExperiment(startTime=0.0))


@bad
def step_after_end(s: Instance) -> int:
    s.fmu.terminate()
    return s.step(0.01)


def damaged(change: Callable[[dict], object]) -> Callable[[Instance], int]:
    """Restore a state after changing it."""

    def use(s: Instance) -> int:
        state = json.loads(s.state_bytes())
        state = change(state) or state
        return s.status(s.restore_bytes, json.dumps(state).encode())

    return use


BAD_USE["state_garbage"] = lambda s: s.status(s.restore_bytes, b"\x00\xff not a state")
BAD_USE["state_empty"] = lambda s: s.status(s.restore_bytes, b"")
BAD_USE["state_deep"] = lambda s: s.status(s.restore_bytes, b"[" * 200_000)
BAD_USE["state_of_another_type"] = damaged(lambda state: [1, 2, 3])
BAD_USE["state_of_another_model"] = damaged(lambda state: state.update(model="another_0123456789ab"))
BAD_USE["state_short"] = damaged(lambda state: state.update(values=state["values"][:-1]))
BAD_USE["state_without_values"] = damaged(lambda state: state.pop("values") and None)
BAD_USE["state_nan"] = damaged(lambda state: state.update(x=[math.nan] * len(state["x"])))
BAD_USE["state_text"] = damaged(lambda state: state.update(x=["a"] * len(state["x"])))
BAD_USE["state_mode"] = damaged(lambda state: state.update(mode="asleep"))
BAD_USE["state_step"] = damaged(lambda state: state.update(h=0.0))


def parameter(s: Instance) -> str:
    """The first Real parameter."""
    return next(n for n, c in s.causality.items() if c == "parameter" and s.type[n] == "Real")


def refuse(folder: str) -> None:
    """Every bad use, one after the other; the process must survive them all."""
    report = {}
    for name, use in BAD_USE.items():
        s = Instance(Path(folder), name)
        if use in NEED_AN_INPUT and not s.inputs:
            continue
        if not name.startswith("early"):
            s.initialise()
            assert s.step(0.0) == OK
        before = s.get(*s.outputs)
        status = use(s)
        messages = list(s.messages)
        report[name] = {
            "status": status,
            "messages": messages,
            "next": [s.step(0.01), s.step(0.011)],
            "kept": s.get(*s.outputs) == before,
        }
        s.fmu.reset()
        report[name]["after_reset"] = s.initialise().step(0.0)
        s.close()
    print(json.dumps(report))


def many(count: str) -> None:
    """Instantiate again and again; prints how many and the last output."""
    from fmpy import extract

    from fmus.build import build_fmu, composed_block

    with tempfile.TemporaryDirectory() as folder:
        fmu = build_fmu(composed_block("dcv"), Path(folder, "dcv.fmu"))
        unpacked = Path(extract(str(fmu), str(Path(folder, "unpacked"))))
        for _ in range(int(count)):
            s = Instance(unpacked).initialise()
            last = s.play([[0.0]])[0][0]
            s.close()
    print(count, last)


def resume(folder: str, exchange: str) -> None:
    """Go on from a state that another process saved."""
    import numpy as np

    s = Instance(Path(folder))
    s.restore_bytes(Path(exchange, "state").read_bytes())
    np.save(Path(exchange, "found.npy"), s.play(np.load(Path(exchange, "rows.npy")), first=50))
    s.close()


def leave(how: str, *folders: str) -> None:
    """End the process with instances that are `open`, `closed`, or whose files are `deleted` under them."""
    instances = [Instance(Path(folder)).initialise() for folder in folders]
    for s in instances:
        assert s.step(0.0) == OK
        if how == "closed":
            s.close()
    if how == "deleted":
        for folder in folders:
            shutil.rmtree(folder)
    print("done")


def resets(folder: str, count: str) -> None:
    """Run and reset again and again; prints by how many KiB the second half grew, and how often the table was read."""
    import psutil

    s = Instance(Path(folder))
    sizes = []
    for _ in range(int(count)):
        s.initialise()
        assert s.step(0.0) == OK
        s.fmu.reset()
        sizes.append(psutil.Process().memory_info().rss / 1024)
    module = next(m for n, m in sys.modules.items() if n.startswith("stimulus_"))
    print(sizes[-1] - sizes[len(sizes) // 2], module.BaseSlave.read_column.cache_info().misses)


if __name__ == "__main__":
    {"refuse": refuse, "many": many, "continue": resume, "leave": leave, "resets": resets}[sys.argv[1]](
        *sys.argv[2:]
    )
