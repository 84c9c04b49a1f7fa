"""How late the link's loops are at 1 kHz: ``python -m benchmarks.live [--seconds 600] [--load 0,2] [--real-time]``.

Runs the two ends of `cosim live` against each other over the loopback, with so many busy processes beside them, and prints
lateness and datagrams of each end, and the lateness of a process beside them that only waits. Then the parts: the loop's
clock alone with and without each of its means.
"""

import argparse
import contextlib
import gc
import json
import math
import platform
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import psutil

from benchmarks.load import load
from cosim.live.pace import SPIN, Lateness, Pace, priority, steady

SHOWN = ("p50", "p99", "p99.9", "worst")


def free_ports() -> list[int]:
    """Two ports that nobody listens on."""
    with socket.socket(type=socket.SOCK_DGRAM) as a, socket.socket(type=socket.SOCK_DGRAM) as b:
        for one in (a, b):
            one.bind(("127.0.0.1", 0))
        return [one.getsockname()[1] for one in (a, b)]


def both_ends(
    seconds: float, folder: Path, real_time: bool
) -> tuple[dict[str, dict[str, Any]], dict[str, Any]]:
    """Runs controller and crane; returns the account of each, and the lateness of a clock beside them."""
    options = ["--real-time"] if real_time else []
    ports = free_ports()
    start = [sys.executable, "-m", "cosim", "live", "--json", "--duration", f"{seconds} s", *options]
    master = [*start, "--listen", str(ports[0]), "--peer", f"127.0.0.1:{ports[1]}", "--out", str(folder / "m.csv"),
              "--excitation", "steps"]  # fmt: skip
    crane = [*start, "--crane", "--listen", str(ports[1]), "--peer", f"127.0.0.1:{ports[0]}"]
    running = {
        name: subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
        for name, words in (("controller", master), ("crane", crane))
    }
    # what stands still beside a process that does nothing else is the machine's, not the link's
    clock = [sys.executable, "-m", "benchmarks.live", "--clock", f"{seconds}", *options]
    beside = subprocess.Popen(clock, stdout=subprocess.PIPE, text=True, cwd=Path(__file__).parents[1])
    found = {}
    for name, process in running.items():
        out, _ = process.communicate()
        if process.returncode:
            raise SystemExit(f"the {name} ended with {process.returncode}: {out}")
        found[name] = json.loads(out)
    return found, json.loads(beside.communicate()[0])


def clock_alone(
    seconds: float, *, spin: float, steadied: bool, real_time: bool = False
) -> tuple[Lateness, float]:
    """The loop's clock without anything to do; returns lateness and the share of a processor that it takes."""
    lateness = Lateness()
    with steady() if steadied else contextlib.nullcontext(), priority(real_time):
        pace, process = Pace(spin=spin), psutil.Process()
        cpu, wall = process.cpu_times(), time.perf_counter()
        end = pace.due + seconds
        while pace.due < end:
            lateness.add(pace.wait())
            kept: list[Any] = []
            kept.append(kept)  # garbage for the collector, as a loop that is not careful makes it
            pace.next(1 + max(0, math.ceil(pace.behind())))
        after = process.cpu_times()
        used = (after.user + after.system - cpu.user - cpu.system) / (time.perf_counter() - wall)
    gc.collect()
    return lateness, used


def taken_by_host() -> float:
    """Seconds of all processors in which the host of a virtual machine ran something else; 0 where nobody counts them."""
    return float(getattr(psutil.cpu_times(), "steal", 0.0))


def figures(facts: dict[str, Any]) -> str:
    """The quantiles in ms, right-aligned."""
    return "".join(f"{1e3 * facts[name]:9.3f}" for name in SHOWN)


def main() -> None:
    """Measures and prints."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seconds", type=float, default=600.0, help="of each run of both ends")
    parser.add_argument(
        "--load", default=f"0,{psutil.cpu_count()}", help="busy processes beside them, one run each"
    )
    parser.add_argument("--real-time", action="store_true", help="ask for real-time priority")
    parser.add_argument(
        "--alone", type=float, default=20.0, help="seconds of each run of the clock alone; 0 for none"
    )
    parser.add_argument("--clock", type=float, default=0.0, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.clock > 0.0:
        lateness, _ = clock_alone(options.clock, spin=SPIN, steadied=True, real_time=options.real_time)
        print(json.dumps(lateness.facts()))
        return
    print(f"{platform.system()} {platform.release()}, Python {platform.python_version()}, {psutil.cpu_count()} processors,"
          f" load average before {psutil.getloadavg()[0]:.2f}")  # fmt: skip
    print(f"{'lateness [ms]':28}" + "".join(f"{name:>9}" for name in SHOWN))
    for number in map(int, options.load.split(",")):
        stolen = taken_by_host()
        with tempfile.TemporaryDirectory() as folder, load(number):
            found, clock = both_ends(options.seconds, Path(folder), options.real_time)
            of_minute, of_five, _ = psutil.getloadavg()
        stolen = taken_by_host() - stolen
        for name, facts in found.items():
            counts, memory = facts["datagrams"], facts["memory"]
            grown = (memory["last"] - memory["first"]) / 1024
            print(
                f"{f'{name}, {number} busy':28}{figures(facts['lateness'])}  overrun {facts['overrun']},"
                f" lost {counts['lost']}, late {counts['late']} of {facts['slots']}; memory {grown:+.0f} KiB"
            )
        print(f"{f'a clock beside, {number} busy':28}{figures(clock)}")
        # a machine that others share is part of the figures
        print(f"  load average at the end {of_minute:.1f}, of five minutes {of_five:.1f}; {stolen:.1f} s of the processors"
              " taken by the host", flush=True)  # fmt: skip
    if options.alone <= 0.0:
        return
    print(f"the clock alone, {options.alone:g} s each" + " " * 37 + "processor")
    for text, spin, steadied in (
        ("sleep only, as Python is", 0.0, False),
        ("and no collector, no slack", 0.0, True),
        (f"and {1e3 * SPIN:g} ms of looking", SPIN, True),
        ("1 ms of looking", 1e-3, True),
    ):
        lateness, used = clock_alone(options.alone, spin=spin, steadied=steadied)
        print(f"{text:28}{figures(lateness.facts())}  {100 * used:5.1f} %")


if __name__ == "__main__":
    main()
