"""No internal error, whatever the machine: ``python benchmarks/odd_machines.py --cases 100 --seed 1 [--budget 40s]``.

Each case is a synthetic log, or several, of a drive of its own: speed, angle, travel or flow, electric or hydraulic, with
a dead zone, a lag, a delay, directions that differ, friction, ends of its travel and rests of any length; sampled at 2 Hz
to 1 kHz, rounded, noisy or exact, driven both ways or one, by hand or in a place loop. `cosim init --machine` writes the
mapping as for a new user, and `cosim diagnose` runs from end to end, report included. A clear refusal (exit code 2 or 3)
is an answer, too. With ``--rows FILE`` each case is a line of JSON there as soon as it has ended, and one that is there is
not run again.
"""

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

TOP = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(TOP))

from benchmarks.odd_logs import counted, options_of  # noqa: E402

Array = NDArray[np.float64]

STEP = 1e-3  # s of the simulation
# what is measured -> its columns' heading and the value of full speed in it
MOTIONS = {
    "angular speed": ("w [rad/s]", 2.0),
    "revolutions": ("n [rpm]", 900.0),
    "angle": ("angle [deg]", 40.0),
    "travel": ("travel [cm]", 12.0),
    "flow": ("Q [l/min]", 60.0),
}
PLACES = ("angle", "travel")
ENDED = "ended by exit code"


@dataclass(frozen=True)
class Odd:
    """One case, as plain data; times in s, what has no unit as a share of full command or of full speed."""

    seed: int
    motion: str
    command: str
    logs: int
    held_out: bool
    calibrate: bool
    duration: float
    rate: float
    rest: float
    dead: float
    backward: float
    top: float
    delay: float
    lag: float
    friction: float
    stroke: float
    noise: float
    rounding: float
    scale: float


def drawn(count: int, seed: int) -> Iterator[Odd]:
    """The first cases of a seed."""
    rng = np.random.default_rng(seed)

    def some(share: float, low: float, high: float) -> float:
        """A value in a share of the cases, else 0."""
        return float(rng.uniform(low, high)) if rng.random() < share else 0.0

    for k in range(count):
        rate = float(np.exp(rng.uniform(np.log(2.0), np.log(1000.0))))
        longest = min(300.0, 30000.0 / rate)
        logs = int(rng.choice([1, 1, 2, 3]))
        yield Odd(
            seed=seed * 100000 + k,
            motion=str(rng.choice(list(MOTIONS))),
            command=str(rng.choice(["steps", "steps", "strokes", "sine", "one way", "loop"])),
            logs=logs,
            held_out=bool(logs > 1 and rng.random() < 0.5),
            calibrate=bool(rng.random() < 0.7),
            duration=float(np.exp(rng.uniform(np.log(4.0), np.log(longest)))),
            rate=rate,
            rest=float(rng.choice([0.0, 0.5, 0.9])),
            dead=some(0.5, 0.02, 0.5),
            backward=some(0.4, -0.5, 0.5),
            top=some(0.3, 0.5, 0.9),
            delay=some(0.4, 0.02, 0.4),
            lag=some(0.8, 0.02, 0.6),
            friction=some(0.3, 0.02, 0.2),
            stroke=some(0.3, 0.5, 2.0),
            noise=some(0.6, 1e-4, 0.05),
            rounding=some(0.4, 1e-4, 0.05),
            scale=float(rng.choice([1.0, 1.0, 100.0, 10.0])),
        )


def log_of(case: Odd, number: int) -> tuple[Array, Array, Array]:
    """Time (n,) s, command (n,) in its column's unit and reading (n,) of one log."""
    rng = np.random.default_rng([case.seed, number])
    count = int(case.duration / STEP)
    t = STEP * np.arange(count)
    held = max(1, int(rng.uniform(0.3, 3.0) / STEP))
    levels = rng.uniform(-1.0, 1.0, count // held + 1)
    levels[rng.random(levels.size) < case.rest] = 0.0
    wanted = np.repeat(levels, held)[:count]
    if case.command == "strokes":
        wanted = np.sign(wanted)
    elif case.command == "sine":
        wanted = np.sin(2.0 * np.pi * rng.uniform(0.05, 1.0) * t) * rng.uniform(0.2, 1.0)
    elif case.command == "one way":
        wanted = np.abs(wanted)
    late, kept = int(case.delay / STEP), np.exp(-STEP / max(case.lag, STEP))
    u, speed, place = np.zeros(count), np.zeros(count), np.zeros(count)
    v = x = 0.0
    for k in range(count):
        u[k] = np.clip(3.0 * (wanted[k] - x), -1.0, 1.0) if case.command == "loop" else wanted[k]
        e = u[k - late] if k >= late else 0.0
        e = np.sign(e) * max(abs(e) - case.dead, 0.0) / (1.0 - case.dead)
        e *= 1.0 + (case.backward if e < 0.0 else 0.0)
        e = float(np.clip(e, -case.top, case.top)) if case.top else e
        e = np.sign(e) * max(abs(e) - case.friction, 0.0)
        v = kept * v + (1.0 - kept) * e
        x += STEP * v
        if case.stroke and abs(x) > case.stroke:
            x, v = float(np.clip(x, -case.stroke, case.stroke)), 0.0
        speed[k], place[k] = v, x
    y = place if case.motion in PLACES else speed
    at = np.unique(
        np.minimum(np.round(np.arange(0.0, case.duration, 1.0 / case.rate) / STEP), count - 1).astype(int)
    )
    read = y[at] + rng.normal(0.0, 1.0, at.size) * case.noise
    if case.rounding:
        read = case.rounding * np.round(read / case.rounding)
    return t[at], case.scale * u[at], MOTIONS[case.motion][1] * read


def cosim(*arguments: str) -> subprocess.CompletedProcess[str]:
    """A command as a user types it."""
    return subprocess.run(
        [sys.executable, "-c", "from cosim.cli import main; main()", *arguments],
        capture_output=True,
        text=True,
        check=False,
        env=os.environ | {"PYTHONPATH": str(TOP)},
    )


def run_case(case: Odd, budget: str) -> dict[str, Any]:
    """The case with what came of it: a verdict, a refusal, or an internal error."""
    row: dict[str, Any] = {"case": asdict(case)}
    began = time.monotonic()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        files = []
        for number in range(case.logs):
            files.append(str(folder / f"run{number}.csv"))
            heading = f"time [s],command{' [%]' if case.scale == 100.0 else ''},{MOTIONS[case.motion][0]}"
            np.savetxt(
                files[-1], np.stack(log_of(case, number), axis=1), "%.9g", ",", header=heading, comments=""
            )
        made = cosim("init", "--machine", files[0], "--out", str(folder / "machine.toml"))
        if made.returncode:
            return row | ended(made)
        fitted, held = (files[:-1], files[-1:]) if case.held_out else (files, [])
        options = [
            *fitted,
            "--mapping",
            str(folder / "machine.toml"),
            "--budget",
            budget,
            "--out",
            str(folder / "out"),
        ]
        options += ["--held-out", held[0]] if held else []
        options += ["--calibrate"] if case.calibrate else []
        done = cosim("diagnose", *options, "--json")
        row["seconds"] = time.monotonic() - began
        if done.returncode:
            return row | ended(done)
        answer = json.loads(done.stdout)
        row["verdict"] = answer["verdict"]
        row["causes"] = [c["effect"] for c in answer["causes"]]
        row["failed"] = [
            n for n in (*answer["warnings"], *answer["not_judged"].values()) if "please report" in n
        ]
        # with no time left there is none, and a warning says how to make it
        said = any(n.startswith("the report was left out: the time") for n in answer["warnings"])
        row["report"] = said or (folder / "out" / "report.html").is_file()
    return row


def ended(done: subprocess.CompletedProcess[str]) -> dict[str, str]:
    """What an exit code and the last words of a command come to."""
    words = done.stderr.strip()[-1500:]
    if done.returncode in (2, 3) and "internal error" not in words:
        return {"refused": words}
    return {"error": f"{ENDED} {done.returncode}: {words}"}


def main() -> int:
    """Run the cases and count what came of them; 1 if one ended in an internal error."""
    parser = options_of(__doc__, 100)
    parser.add_argument("--budget", default="40s", help="of each diagnosis")
    options = parser.parse_args()
    pool = ThreadPoolExecutor(options.workers)
    return counted(
        drawn(options.cases, options.seed), partial(run_case, budget=options.budget), pool, options
    )


if __name__ == "__main__":
    sys.exit(main())
