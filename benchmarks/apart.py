"""What it costs that FMUs of others run in a child process: the same native FMUs inside the tool's process and apart.

    python benchmarks/apart.py [--seconds 10,100,1000] [--repeat 5] [--json]

Our full-order system with native FMUs, 1 ms steps; needs a C compiler. `loop` is the loop alone; `run` one more run of a
Runner that is open; `first` the first run of a new one, with the start of the child. Medians; a ratio is apart to inside.
"""

import argparse
import json
import statistics
import tempfile
import time
from pathlib import Path

import numpy as np

from cosim.master import Runner
from cosim.native.package import swapped
from cosim.paths import ssp_folder
from cosim.ssp.write import write_ssp

STEP = 1e-3  # s


def command(seconds: float) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """A slow sine as valve command."""
    time_ = np.arange(0.0, seconds + 0.1, 0.01)
    return {"u": (time_, 0.6 * np.sin(0.7 * time_))}


def figures(package: Path, seconds: float, apart: bool, repeat: int) -> dict[str, float]:
    """Medians [s] of loop, run and first run."""
    loops, runs, firsts = [], [], []
    inputs = command(seconds)
    for _ in range(repeat):
        begun = time.perf_counter()
        with Runner(package, apart=apart) as runner:
            runner.run(seconds, STEP, inputs=inputs)
            firsts.append(time.perf_counter() - begun)
            begun = time.perf_counter()
            result = runner.run(seconds, STEP, inputs=inputs)
            runs.append(time.perf_counter() - begun)
            loops.append(result.wall_time)
    names = ("loop", "run", "first")
    return {
        name: statistics.median(values) for name, values in zip(names, (loops, runs, firsts), strict=True)
    }


def same(package: Path) -> bool:
    """Whether both give the same numbers bit for bit."""
    with Runner(package, apart=False) as inside, Runner(package, apart=True) as outside:
        one, two = (runner.run(10.0, STEP, inputs=command(10.0)) for runner in (inside, outside))
    return all(np.array_equal(one[name], two[name]) for name in one)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seconds", default="10,100,1000", help="simulated time of the runs")
    parser.add_argument("--repeat", type=int, default=5)
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    rows = []
    with tempfile.TemporaryDirectory() as scratch:
        python = write_ssp(ssp_folder() / "full_order.ssd", Path(scratch, "full_order.ssp"), open=True)
        package = swapped(python, Path(scratch, "native.ssp"))
        equal = same(package)
        for seconds in map(float, arguments.seconds.split(",")):
            inside, apart = (figures(package, seconds, where, arguments.repeat) for where in (False, True))
            ratio = {name: apart[name] / inside[name] for name in inside}
            rows.append({"seconds": seconds, "inside": inside, "apart": apart, "ratio": ratio})
    if arguments.json:
        print(json.dumps({"same_numbers": equal, "rows": rows}))
        return
    print(f"same numbers bit for bit: {equal}")
    print(f"{'simulated':>10} {'':>8} {'loop':>10} {'run':>10} {'first':>10}")
    for row in rows:
        for name in ("inside", "apart", "ratio"):
            found = row[name]
            assert isinstance(found, dict)
            cells = " ".join(f"{found[k]:10.4f}" for k in ("loop", "run", "first"))
            print(f"{row['seconds']:8g} s {name:>8} {cells}")


if __name__ == "__main__":
    main()
