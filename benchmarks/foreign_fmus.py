"""FMUs of other people and exporters: ``python benchmarks/foreign_fmus.py FOLDER...``.

Every FMI 2.0 co-simulation FMU with a library for this machine that lies below the folders is run by fmpy, in a process
of its own, and by our master; then each fault of `benchmarks.systems.foreign` whose FMUs are there is hidden in a log that
fmpy makes, and diagnosed. ``--get`` brings the FMUs that Python packages carry; nothing of them is in this repository.
"""

import argparse
import json
import subprocess
import sys
import time
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from lxml import etree

from benchmarks.systems import foreign, foreign_systems
from cosim.errors import CosimError
from cosim.master import Runner
from cosim.ssp import check_fmu
from cosim.ssp.read import read_system

PACKAGES = ("gemseo-fmu==3.1.1", "crane-fmu==0.2.0")
FMPY_LIMIT = 60.0  # s for a run of fmpy
POINTS = 1000
LONGEST_RUN = 20.0  # s

FMPY = """
import sys, json, numpy as np
from fmpy import simulate_fmu
path, stop, step, target, *names = sys.argv[1:]
stop, step = float(stop), float(step)
found = simulate_fmu(path, start_time=0.0, stop_time=stop, step_size=step, output_interval=step, output=names,
    fmi_type="CoSimulation", validate=False)
np.savez(target, **{f"s{k}": np.asarray(found[n], dtype=float) for k, n in enumerate(names)}, time=found["time"])
"""


@dataclass
class Known:
    """What the description of an FMU says."""

    path: Path
    tool: str
    stop: float
    step: float
    outputs: list[str]


def get(folder: Path) -> None:
    """Download the packages and unpack their FMUs for Linux."""
    folder.mkdir(parents=True, exist_ok=True)
    command = [sys.executable, "-m", "pip", "download", "--quiet", "--no-deps", "--dest", str(folder)]
    subprocess.run([*command, *PACKAGES], check=True)
    for wheel in sorted(folder.glob("*.whl")):
        with zipfile.ZipFile(wheel) as archive:
            for name in archive.namelist():
                if name.endswith(".fmu") and "/win32/" not in name:
                    target = folder / wheel.name.partition("-")[0] / Path(name).name
                    target.parent.mkdir(exist_ok=True)
                    target.write_bytes(archive.read(name))


def known(path: Path) -> Known | None:
    """The FMU if it is of FMI 2.0, for co-simulation, with a library for 64-bit Linux."""
    try:
        with zipfile.ZipFile(path) as archive:
            root = etree.fromstring(archive.read("modelDescription.xml"))
            node = root.find("CoSimulation")
            libraries = [n for n in archive.namelist() if n.startswith("binaries/linux64/")]
    except (zipfile.BadZipFile, KeyError, etree.XMLSyntaxError):
        return None
    if root.get("fmiVersion") != "2.0" or node is None or not libraries:
        return None
    default = root.find("DefaultExperiment")
    stop = min(float((default is not None and default.get("stopTime")) or 1.0), LONGEST_RUN)
    step = max(float((default is not None and default.get("stepSize")) or 0.01), stop / (2 * POINTS))
    outputs = [
        v.get("name")
        for v in root.iter("ScalarVariable")
        if v.get("causality") == "output" and v.find("Real") is not None
    ]
    return Known(path, root.get("generationTool") or "?", step * round(stop / step), step, outputs)


def by_fmpy(item: Known, scratch: Path) -> dict[str, np.ndarray] | str:
    """Outputs at every step, or why there are none."""
    target = scratch / "fmpy.npz"
    target.unlink(missing_ok=True)
    command = [
        sys.executable,
        "-c",
        FMPY,
        str(item.path.resolve()),
        repr(item.stop),
        repr(item.step),
        str(target),
    ]
    try:
        done = subprocess.run(
            [*command, *item.outputs],
            capture_output=True,
            text=True,
            timeout=FMPY_LIMIT,
            cwd=scratch,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return f"takes longer than {FMPY_LIMIT:g} s"
    if not target.is_file():
        return (done.stderr.strip().splitlines() or [f"ends with code {done.returncode}"])[-1]
    with np.load(target) as found:
        return {n: found[f"s{k}"] for k, n in enumerate(item.outputs)}


def by_us(item: Known) -> dict[str, np.ndarray] | str:
    """The same by our master."""
    try:
        with read_system(item.path) as system, Runner(system) as runner:
            (name,) = system.components
            found = runner.run(item.stop, item.step, record=[f"{name}.{o}" for o in item.outputs])
            return {o: np.asarray(found.signals[f"{name}.{o}"]) for o in item.outputs}
    except CosimError as error:
        return f"{type(error).__name__}: {error}"


def difference(one: dict[str, np.ndarray], other: dict[str, np.ndarray]) -> float:
    """Largest difference at the first to the last stamp, over the signal's reach; NaN equals NaN."""
    worst = 0.0
    for name, series in one.items():
        count = min(series.size, other[name].size)
        a, b = series[:count], other[name][:count]
        both = np.isfinite(a) & np.isfinite(b)
        if (np.isfinite(a) != np.isfinite(b)).any():
            return float("inf")
        if both.any():
            reach = max(float(np.ptp(a[both])), 1e-6 * float(np.abs(a[both]).max()), 1e-12)
            worst = max(worst, float(np.max(np.abs(a[both] - b[both]))) / reach)
    return worst


def lost(series: dict[str, np.ndarray]) -> bool:
    """Whether every output ends as no number."""
    return all(not np.isfinite(values[-1]) for values in series.values())


def compare_runs(paths: list[Path], scratch: Path) -> None:
    """Run each FMU by fmpy and by us, and print where they part."""
    for path in paths:
        item = known(path)
        if item is None:
            continue
        theirs, ours = by_fmpy(item, scratch), by_us(item)
        try:
            problems = check_fmu(path)
            bad = sum(p.severity == "error" for p in problems)
            validated = f"{bad} errors, {len(problems) - bad} warnings"
        except CosimError as error:
            validated = f"{type(error).__name__}: {error}"
        if isinstance(theirs, str):
            said = f"fmpy: {theirs[:150]}; ours: {ours[:200] if isinstance(ours, str) else 'runs'}"
        elif isinstance(ours, str) and "not a finite number" in ours and lost(theirs):
            said = f"not finite in both: {ours}"
        elif isinstance(ours, str):
            said = f"RUNS IN FMPY ONLY: {ours}"
        else:
            off = difference(theirs, ours)
            said = f"{'alike' if off < 1e-6 else 'DIFFERS'}: {off:.1e} of {len(item.outputs)} outputs"
        print(f"{path.parent.name}/{path.name} [{item.tool}] {said}; validate: {validated}", flush=True)


def found_below(folders: list[Path]) -> Iterator[Path]:
    """FMUs in order."""
    for folder in folders:
        yield from sorted(p for p in folder.rglob("*") if p.suffix.lower() == ".fmu")


def wired(seeds: range, paths: list[Path], scratch: Path) -> None:
    """Draw a system of several FMUs for each seed, diagnose it, and count what is right."""
    right: list[bool] = []
    for seed in seeds:
        case = foreign_systems.draw(seed, paths)
        told = foreign.run(case, paths, scratch, seed) if case else None
        if case is None or told is None:
            print(f"{seed}: its FMUs are not there, or nothing drawn shows", flush=True)
            continue
        right.append(told["ok"])
        print(f"{case.name}: {told['line']}", flush=True)
    print(f"right: {sum(right)} of {len(right)}")


def main() -> None:
    """Get, run, diagnose."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folders", nargs="*", type=Path)
    parser.add_argument("--get", type=Path, metavar="FOLDER", help="bring the FMUs of Python packages here")
    parser.add_argument("--scratch", type=Path, default=Path("foreign_scratch"))
    parser.add_argument("--only", choices=("runs", "faults"))
    parser.add_argument("--case", help="faults whose name holds this")
    parser.add_argument(
        "--systems", type=int, nargs=2, metavar=("SEED", "COUNT"), help="systems of several FMUs instead"
    )
    parser.add_argument("--rows", type=Path, help="a JSON line for each diagnosis")
    options = parser.parse_args()
    if options.get:
        get(options.get)
    options.scratch.mkdir(parents=True, exist_ok=True)
    scratch = options.scratch.resolve()
    paths = list(found_below([*options.folders, *([options.get] if options.get else [])]))
    if options.systems:
        wired(range(options.systems[0], sum(options.systems)), paths, scratch)
        return
    if options.only != "faults":
        compare_runs(paths, scratch)
    if options.only != "runs":
        rows = []
        for case in foreign.CASES:
            if options.case and options.case not in case.name:
                continue
            begun = time.perf_counter()
            try:
                told = foreign.run(case, paths, scratch)
            except RuntimeError as error:
                print(f"{case.name}: no log: {str(error).strip().splitlines()[-1]}", flush=True)
                continue
            if told is None:
                print(f"{case.name}: its FMUs are not there", flush=True)
                continue
            rows.append(told)
            print(f"{case.name} [{time.perf_counter() - begun:.0f} s]: {told['line']}", flush=True)
            if options.rows:
                with options.rows.open("a") as file:
                    file.write(json.dumps(told) + "\n")
        print(
            "\n| FMU | hidden | answer | time |\n|---|---|---|---|", *(told["row"] for told in rows), sep="\n"
        )
        print(f"right: {sum(told['ok'] for told in rows)} of {len(rows)}")


if __name__ == "__main__":
    main()
