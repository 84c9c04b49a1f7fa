"""How late the link's loops are at 1 kHz: ``python -m benchmarks.live [--seconds 600] [--load 0,2] [--real-time]``.

Runs the two ends of `cosim live` against each other over the loopback, with so many busy processes beside them, and prints
lateness and datagrams of each end. Then the parts: the loop's clock alone with and without each of its means.
"""

import argparse
import contextlib
import gc
import json
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
from cosim.live.pace import SPIN, Lateness, Pace, steady

SHOWN = ("p50", "p99", "p99.9", "worst")


def free_ports() -> list[int]:
    """Two ports that nobody listens on."""
    with socket.socket(type=socket.SOCK_DGRAM) as a, socket.socket(type=socket.SOCK_DGRAM) as b:
        for one in (a, b):
            one.bind(("127.0.0.1", 0))
        return [one.getsockname()[1] for one in (a, b)]


def both_ends(seconds: float, folder: Path, options: list[str]) -> dict[str, dict[str, Any]]:
    """Runs controller and crane; returns the account of each."""
    ports = free_ports()
    start = [sys.executable, "-m", "cosim", "live", "--json", "--duration", f"{seconds} s", *options]
    master = [*start, "--listen", str(ports[0]), "--peer", f"127.0.0.1:{ports[1]}", "--out", str(folder / "m.csv"),
              "--excitation", "steps"]  # fmt: skip
    crane = [*start, "--crane", "--listen", str(ports[1]), "--peer", f"127.0.0.1:{ports[0]}"]
    running = {
        name: subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
        for name, words in (("controller", master), ("crane", crane))
    }
    found = {}
    for name, process in running.items():
        out, _ = process.communicate()
        if process.returncode:
            raise SystemExit(f"the {name} ended with {process.returncode}: {out}")
        found[name] = json.loads(out)
    return found


def clock_alone(seconds: float, *, spin: float, steadied: bool) -> tuple[Lateness, float]:
    """The loop's clock without anything to do; returns lateness and the share of a processor that it takes."""
    lateness = Lateness()
    with steady() if steadied else contextlib.nullcontext():
        pace, process = Pace(spin=spin), psutil.Process()
        cpu, wall = process.cpu_times(), time.perf_counter()
        for _ in range(round(1000 * seconds)):
            lateness.add(pace.wait())
            kept: list[Any] = []
            kept.append(kept)  # garbage for the collector, as a loop that is not careful makes it
            pace.next()
        after = process.cpu_times()
        used = (after.user + after.system - cpu.user - cpu.system) / (time.perf_counter() - wall)
    gc.collect()
    return lateness, used


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
    options = parser.parse_args()
    print(f"{platform.system()} {platform.release()}, Python {platform.python_version()}, {psutil.cpu_count()} processors,"
          f" load average before {psutil.getloadavg()[0]:.2f}")  # fmt: skip
    print(f"{'lateness [ms]':28}" + "".join(f"{name:>9}" for name in SHOWN))
    for number in map(int, options.load.split(",")):
        with tempfile.TemporaryDirectory() as folder, load(number):
            found = both_ends(options.seconds, Path(folder), ["--real-time"] if options.real_time else [])
        for name, facts in found.items():
            counts, memory = facts["datagrams"], facts["memory"]
            grown = (memory["last"] - memory["first"]) / 1024
            print(
                f"{f'{name}, {number} busy':28}{figures(facts['lateness'])}  overrun {facts['overrun']},"
                f" lost {counts['lost']}, late {counts['late']} of {facts['slots']}; memory {grown:+.0f} KiB"
            )
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
