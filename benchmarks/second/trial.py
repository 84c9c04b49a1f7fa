"""One log of the second simulator from end to end: CSV, the command, its answer held against the truth."""

import json
import math
import os
import subprocess
import sys
import tempfile
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.second.cases import FLAWS, Case
from benchmarks.second.machine import Machine, run
from benchmarks.second.out_of_library import FAULTS, judged_out_of_library
from benchmarks.second.record import NOISE, SEEN_BY, Sensing, command, eccentric, write
from cosim.compare.metrics import rms
from cosim.units import base_factor

PROGRAM = (sys.executable, "-m", "cosim")  # the ablation puts another in its place
ANGULAR = ("phi_r", "theta_g")


def played(case: Case) -> tuple[NDArray[np.float64], Sensing, np.random.Generator]:
    """The command (n,) of a case, how it is logged, and the generator that draws the noise."""
    rng = np.random.default_rng([case.seed, 5])
    sensing = Sensing(**case.sensing)
    return command(case.command, case.duration, case.amplitude, sensing.rate, rng), sensing, rng


def make(case: Case, folder: Path) -> list[str]:
    """Write the log of `case` into `folder`; the arguments of `cosim diagnose`."""
    u, sensing, rng = played(case)
    return write(folder, u, run(u, Machine(**case.machine)), sensing, rng)


def shown(case: Case) -> dict[str, float]:
    """Effect -> largest rms, over the signals that are logged, of what it changes, in standard deviations of their noise.

    Nothing for the sensors' flaws that the library knows: steps and lost packets change the noise itself.
    """
    u, sensing, _ = played(case)
    true, found = run(u, Machine(**case.machine)), {}
    for name in case.hidden:
        if (FLAWS.get(name) or FAULTS[name]).sensing:
            if name in FAULTS:
                error = eccentric(true["angle"], sensing)
                found[name] = rms(error - error.mean()) / (sensing.noise * NOISE["slew"])
            continue
        set_here = {*case.hidden[name], *case.forms[name]}
        other = run(u, Machine(**{k: v for k, v in case.machine.items() if k not in set_here}))
        found[name] = max(
            rms(true[s] - other[s]) / (sensing.noise * NOISE[c])
            for s, c in SEEN_BY.items()
            if c in sensing.columns
        )
    return found


def diagnose(arguments: list[str], folder: Path) -> tuple[dict[str, Any], str]:
    """What ``cosim diagnose --json`` prints, and what it says on stderr."""
    done = subprocess.run(
        [*PROGRAM, "diagnose", *arguments, "--out", str(folder / "out"), "--json"],
        capture_output=True,
        text=True,
        env=os.environ | {"OPENBLAS_NUM_THREADS": "1"},
        check=False,
    )
    try:
        return json.loads(done.stdout), done.stderr
    except json.JSONDecodeError:
        return {"error": f"exit code {done.returncode}: {done.stderr[-2000:]}"}, done.stderr


def off(case: Case, answer: dict[str, Any]) -> dict[str, list[float]]:
    """Parameter -> estimate, truth, error by half the interval's width, for effects in the library's own form."""
    found = {}
    for cause in answer["causes"]:
        name = cause["effect"]
        if name not in case.hidden or case.forms[name]:
            continue
        for own, value in case.hidden[name].items():
            told = cause["parameters"].get(FLAWS[name].names.get(own, own))
            if told is None or told.get("ci95") is None:
                continue
            factor = base_factor(told["unit"])
            low, high = (factor * bound for bound in told["ci95"])
            error = factor * told["value"] - value
            if own in ANGULAR:
                error = math.remainder(error, math.tau)
            half = 0.5 * (high - low)
            found[f"{name}.{own}"] = [factor * told["value"], value, error / half if half > 0.0 else math.inf]
    return found


def judged(case: Case, answer: dict[str, Any]) -> str:
    """In a word: exact, rest (exact, and something unexplained), alike, extra, missed, unexplained or wrong.

    Of a cause that the library lacks what `judged_out_of_library` says.
    """
    if case.hidden.keys() <= FAULTS.keys() and case.hidden:
        return judged_out_of_library(case, answer)
    named = [c["effect"] for c in answer["causes"]]
    reported = {n for c in answer["causes"] for n in (c["effect"], *c["indistinguishable_from"])}
    hidden = set(case.hidden)
    if set(named) == hidden:
        return "rest" if answer["unexplained"] else "exact"
    if not named and answer["unexplained"]:
        return "unexplained"
    if len(named) <= len(hidden) and hidden <= reported:
        return "alike"
    if hidden < set(named):
        return "extra"
    return "missed" if set(named) < hidden else "wrong"


def run_case(case: Case, keep: Path | None = None) -> dict[str, Any]:
    """The case with its outcome, as plain data; with `keep` its files stay there."""
    with tempfile.TemporaryDirectory() as name:
        folder = keep / f"seed{case.seed}" if keep else Path(name)
        answer, _ = diagnose(make(case, folder), folder)
    row: dict[str, Any] = {"case": asdict(case), "shown": shown(case)}
    if "error" in answer:
        return row | {"error": answer["error"]}
    return row | {
        "judged": judged(case, answer),
        "verdict": answer["verdict"],
        "causes": [
            {
                "effect": c["effect"],
                "alike": c["indistinguishable_from"],
                "parameters": {n: p["value"] for n, p in c["parameters"].items()},
            }
            for c in answer["causes"]
        ],
        "unexplained": [f"{r['block']}: {r['what']}" for r in answer["unexplained"]],
        "off": off(case, answer),
    }
