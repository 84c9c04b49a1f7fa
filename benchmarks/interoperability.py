"""Which client runs which kind of our FMUs: ``python benchmarks/interoperability.py [--out FILE] [--json FILE]``.

Takes the closed packages that are built (``python build_fmus.py``, with --native for the second kind) and runs each,
unchanged, in every client; each run is a process of its own, so that a crash is a failure and not an end. What a client
gives is compared with the same blocks in plain Python under that client's own scheme. Writes docs/interoperability.md.
"""

import argparse
import importlib.util
import json
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests" / "clients"))
sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from jacobi import SCHEMES, read_parts, simulate

from benchmarks.engines import MODULES, run_engine
from benchmarks.interoperability_page import BUILD, CLIENTS, KINDS, TOLERANCE, H, Row, page
from benchmarks.plain_host import TIMEOUT, EndError, compiled_host, libpython, run_host
from benchmarks.runner import machine
from benchmarks.single_fmus import fmusim, tried
from cosim.errors import ModelError
from cosim.export import ExportedModel, prepare
from cosim.paths import build_folder
from cosim.ssp.build import SYSTEMS
from cosim.ssp.read import read_system

Array = NDArray[np.float64]
TOP = Path(__file__).resolve().parent.parent
STEPS = 2000
SIGNALS = {
    "full_order": (
        "dcv.spool",
        "continuity.p_load",
        "mechanical.theta",
        "sensor.slew",
        "observer.slew_estimate",
    ),
    "physical": (
        "dcv.spool",
        "continuity.p_load",
        "mechanical.theta",
        "sensor.slew",
        "observer.slew_estimate",
    ),
    "simplified": ("dead_zone.demand", "simplified.theta", "sensor.slew", "observer.slew_estimate"),
}


def gauss_seidel(
    package: Path, model: ExportedModel, steps: int, h: float, signals: Sequence[str]
) -> dict[str, Array]:
    """The blocks in plain Python under our own scheme: each signal of shape (steps + 1,), the first at initialisation."""
    parts, _ = read_parts(package)
    wires = model.system.wires
    held: dict[object, float] = {}

    def feed(name: str, starting: bool) -> None:
        for wire in wires:
            if wire.target.component == name:
                now = parts[wire.source.component].outputs[wire.source.variable]
                value = held[wire] if wire in model.late and not starting else now
                parts[name].inputs[wire.target.variable] = value

    for part in parts.values():
        part.begin()
    for _ in range(3):  # to the fixed point, which the one loop of `physical` reaches at the second sweep
        for name in model.order:
            feed(name, True)
            parts[name].begin()
    for part in parts.values():
        part.c = part.equations.coefficients(part.p, h)
    places = [signal.partition(".")[::2] for signal in signals]
    table = np.empty((steps + 1, len(places)))
    table[0] = [parts[a].outputs[b] for a, b in places]
    for k in range(steps):
        held = {w: parts[w.source.component].outputs[w.source.variable] for w in model.late}
        for name in model.order:
            feed(name, False)
            parts[name].step(k * h, h)
        table[k + 1] = [parts[a].outputs[b] for a, b in places]
    return dict(zip(signals, table.T, strict=True))


class Trials:
    """Everything needed to try clients on packages; `host` is None without a C compiler."""

    def __init__(self, packages: Mapping[str, Mapping[str, Path]], scratch: Path, steps: int = STEPS) -> None:
        self.packages, self.steps = packages, steps
        self.host, self.host3 = compiled_host(scratch), compiled_host(scratch, 3)
        self.expected: dict[tuple[str, str, str | None], dict[str, Array]] = {}

    def row(self, kind: str, client: str) -> Row:
        """Try one client on every package of a kind."""
        row = Row(kind, client)
        why = self.unavailable(client)
        if why:
            row.reasons.append(why)
            return row
        row.loads = row.runs = row.agrees = row.ends = True
        for system, package in self.packages[kind].items():
            self.attempt(row, system, package)
        return row

    def unavailable(self, client: str) -> str:
        """Why a client cannot be tried here; empty if it can."""
        module = MODULES.get(client)
        if module is not None and importlib.util.find_spec(module) is None:
            return f"{module} is not installed"
        if client.startswith("host") and self.host is None:
            return "there is no C compiler, or this is not Linux"
        if client == "host+python" and libpython() is None:
            return "this Python has no shared library"
        return ""

    def attempt(self, row: Row, system: str, package: Path) -> None:
        """Load, run and compare one package."""
        signals = SIGNALS[system]
        found: Mapping[str, Array] = {}
        for steps in (1, self.steps):
            try:
                found = self.run(row.client, package, steps, signals)
            except EndError as error:
                found, row.ends = error.found, False
                if steps > 1:
                    row.reasons.append(f"{system}: {short(error)}")
            except (RuntimeError, subprocess.TimeoutExpired) as error:
                row.loads = row.loads and steps > 1
                row.runs = row.agrees = row.ends = False
                row.reasons.append(f"{system}: {short(error)}")
                return
        expected = self.reference(row.kind, row.client, system)
        first = len(expected[signals[0]]) - len(found[signals[0]])
        worst = max(
            float(np.max(np.abs(found[s] - expected[s][first:])) / (np.ptp(expected[s]) or 1.0))
            for s in signals
        )
        row.difference = worst if row.difference is None else max(row.difference, worst)
        if not worst <= TOLERANCE:  # NaN is no agreement either
            row.agrees = False
            row.reasons.append(f"{system}: differs by {worst:.2g} of a signal's range")

    def run(self, client: str, package: Path, steps: int, signals: Sequence[str]) -> Mapping[str, Array]:
        """Run a package in a process of its own."""
        if not client.startswith("host"):
            return run_engine(client, package, steps=steps, h=H, signals=signals, timeout=TIMEOUT)[0]
        with read_system(package) as system:
            third = {c.fmu.version for c in system.components.values()} == {"3.0"}
            host = self.host3 if third else self.host
            assert host is not None
            preload = libpython() if client == "host+python" else None
            return run_host(host, prepare(system), steps, H, signals, preload)

    def reference(self, kind: str, client: str, system: str) -> dict[str, Array]:
        """What the equations give under the client's scheme."""
        scheme = SCHEMES.get(client)
        key = (kind, system, client if scheme else None)
        if key not in self.expected:
            package, signals = self.packages[kind][system], SIGNALS[system]
            if scheme is None:
                with read_system(package) as read:
                    self.expected[key] = gauss_seidel(package, prepare(read), self.steps, H, signals)
            else:
                self.expected[key] = simulate(package, self.steps, H, signals, **scheme)
        return self.expected[key]


def short(error: Exception) -> str:
    """The telling line of what a process wrote, without folders of this machine."""
    lines = [line.strip() for line in str(error).replace("\x00", "").splitlines() if line.strip()]
    marks = ("rror", "xception: ", "undefined", "ended with")
    telling = [line for line in lines if any(mark in line for mark in marks)]
    text = (telling or lines or [type(error).__name__])[-1]
    words = [word.rsplit("/", 1)[-1] if word.count("/") > 1 else word for word in text.split()]
    return " ".join(words)[:200]


def built(folder: Path) -> dict[str, dict[str, Path]]:
    """The closed packages of each kind that is built.

    Raises:
        ModelError: none is.
    """
    found = {
        kind: {
            name: folder / sub / f"{name}.ssp" for name in SYSTEMS if (folder / sub / f"{name}.ssp").is_file()
        }
        for kind, sub in KINDS.items()
    }
    found = {kind: packages for kind, packages in found.items() if packages}
    if not found:
        raise ModelError(f"no packages are built in '{folder}': run `{BUILD['pythonfmu']}` first")
    return found


VALIDATE = """
import io, sys, zipfile
from fmpy.validation import validate_fmu
with zipfile.ZipFile(sys.argv[1]) as package:
    names = [n for n in package.namelist() if n.endswith(".fmu")]
    problems = [f"{n}: {p}" for n in names for p in validate_fmu(io.BytesIO(package.read(n)))]
print(len(names))
print("\\n".join(problems))
"""


def validated(packages: Mapping[str, Path]) -> tuple[int, list[str]]:
    """How many FMUs fmpy has validated, and what it says against them."""
    count, problems = 0, []
    for system, package in packages.items():
        words = [sys.executable, "-c", VALIDATE, str(package)]
        done = subprocess.run(words, capture_output=True, text=True, timeout=TIMEOUT, check=False)
        lines = done.stdout.splitlines()
        if done.returncode != 0 or not lines:
            problems.append(f"{system}: {short(RuntimeError(done.stderr))}")
            continue
        count += int(lines[0])
        problems += [f"{system}: {line}" for line in lines[1:] if line]
    return count, problems


def checked(folder: Path) -> tuple[int, list[str]] | None:
    """How many FMUs fmutool has checked, and what it says against them; None if it is not installed."""
    if importlib.util.find_spec(MODULES["fmucontainer"]) is None:
        return None
    count, problems = 0, []
    for file in sorted(folder.glob("*.fmu")):
        words = [sys.executable, "-c", CHECK, "-input", str(file), "-check"]
        done = subprocess.run(words, capture_output=True, text=True, timeout=TIMEOUT, check=False)
        lines = f"{done.stdout}\n{done.stderr}".splitlines()
        count += 1
        problems += [
            f"{file.stem}: {line}" for line in lines if line.startswith(("ERROR", "WARNING", "Traceback"))
        ]
        if not any("seems to be compliant" in line for line in lines):
            problems.append(f"{file.stem}: it is not called compliant")
    return count, problems


CHECK = "from fmu_manipulation_toolbox.cli.fmutool import fmutool; fmutool()"


def main() -> int:
    """Try everything that is built, show the table, and write the page."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--out", type=Path, default=TOP / "docs" / "interoperability.md", help="the page to write"
    )
    parser.add_argument("--json", type=Path, help="write the figures to this file too")
    parser.add_argument("--steps", type=int, default=STEPS, help="steps of 1 ms")
    parser.add_argument(
        "--only", nargs="+", choices=list(CLIENTS), default=list(CLIENTS), help="these clients only"
    )
    options = parser.parse_args()
    packages = built(build_folder())
    with tempfile.TemporaryDirectory(prefix="interoperability_") as scratch:
        trials = Trials(packages, Path(scratch), options.steps)
        rows = []
        for kind in packages:
            for client in options.only:
                rows.append(trials.row(kind, client))
                print(f"{kind} {client}: {asdict(rows[-1])}", file=sys.stderr, flush=True)
    validations = {kind: validated(found) for kind, found in packages.items()}
    program = fmusim()
    native = {kind: build_folder() / KINDS[kind] / ".." / "fmus" for kind in packages if kind != "pythonfmu"}
    singles = [tried(kind, folder, program) for kind, folder in native.items()] if program else []
    checks = {kind: checked(build_folder() / KINDS[kind] / ".." / "fmus") for kind in packages}
    text = page(rows, validations, options.steps, singles, checks)
    options.out.write_text(text, encoding="utf-8")
    print(text)
    if options.json:
        figures = {"machine": machine(), "tolerance": TOLERANCE, "rows": [asdict(row) for row in rows]}
        options.json.write_text(json.dumps(figures, indent=2) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
