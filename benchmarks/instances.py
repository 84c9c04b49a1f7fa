"""What a process keeps for every instance of a Python FMU that it ever made.

    python benchmarks/instances.py [--fmu FILE.fmu] [--count 10000] [--json]

Each instance is made, and freed before the next. Growth counts from the hundredth instance on, when what is loaded
once is loaded.
"""

import argparse
import gc
import json
import tempfile
import time
from pathlib import Path

import psutil

from cosim.master import Runner
from cosim.ssp.read import read_system
from fmus.build import build_fmu, composed_block

FIRST = 100  # instances that do not count
MOST_MEMORY = 100.0  # MiB for 10 000 instances


def growth(fmu: Path, count: int) -> dict[str, float]:
    """Memory [MiB] that `count` instances leave behind, and the time for each [ms]."""
    process = psutil.Process()
    with read_system(fmu) as system:
        for k in range(FIRST + count):
            if k == FIRST:
                gc.collect()
                before, begun = process.memory_info().rss, time.perf_counter()
            with Runner(system):
                pass
    spent = time.perf_counter() - begun
    gc.collect()
    grown = (process.memory_info().rss - before) / 2**20
    return {
        "instances": count,
        "grown_MiB": grown,
        "kB_each": grown * 1024.0 / count,
        "ms_each": 1e3 * spent / count,
    }


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--fmu", type=Path, help="default: our mechanics")
    parser.add_argument("--count", type=int, default=10_000)
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        fmu = arguments.fmu or build_fmu(composed_block("mechanical"), Path(scratch, "mechanical.fmu"))
        found = growth(fmu, arguments.count)
    if arguments.json:
        print(json.dumps(found))
        return
    print(
        f"{found['instances']} instances: {found['grown_MiB']:.1f} MiB kept, {found['kB_each']:.2f} kB each; "
        f"{found['ms_each']:.1f} ms each (limit: {MOST_MEMORY:g} MiB for 10 000)"
    )


if __name__ == "__main__":
    main()
