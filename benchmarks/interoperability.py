"""Which client runs which kind of our FMUs: ``python benchmarks/interoperability.py [--out FILE] [--json FILE]``.

Takes the closed packages that are built (``python build_fmus.py``, with --native for the second kind) and runs each,
unchanged, in every client; each run is a process of its own, so that a crash is a failure and not an end. What a client
gives is compared with the same blocks in plain Python under that client's own scheme. Writes docs/interoperability.md.
"""

import argparse
import importlib.util
import json
import platform
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests" / "clients"))
sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from jacobi import FIRST_INPUT_ZERO, read_parts, simulate

from benchmarks.engines import environment, run_engine
from benchmarks.runner import machine
from cosim.errors import ModelError
from cosim.export import ExportedModel, prepare
from cosim.paths import build_folder
from cosim.ssp.build import SYSTEMS
from cosim.ssp.read import read_system

Array = NDArray[np.float64]
TOP = Path(__file__).resolve().parent.parent
H = 1e-3
STEPS = 2000
TOLERANCE = 1e-9
"""Of a signal's range: the operations are the same but for the clock and C's own exp and tanh."""
TIMEOUT = 120.0
KINDS = {"pythonfmu": "ssp", "native": "native/ssp"}
BUILD = {"pythonfmu": "python build_fmus.py", "native": "python build_fmus.py --native"}
CLIENTS = {
    "cosim": "cosim.master.Runner",
    "fmpy": "fmpy, simulate_ssp",
    "ecos": "ecos",
    "libcosim": "libcosim",
    "host": "plain C host",
    "host+python": "plain C host, libpython preloaded",
}
MODULES = {"fmpy": "fmpy", "ecos": "ecospy", "libcosim": "libcosimpy"}
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


@dataclass
class Row:
    """What one client does with one kind of FMU, over all systems.

    Attributes:
        kind, client: keys of `KINDS` and `CLIENTS`.
        loads, runs, agrees: yes or no, or None where it was not tried.
        ends: whether every process also ended cleanly, or None.
        difference: largest difference relative to a signal's range, or None.
        reasons: what the client said where it failed, or why it was not tried.
    """

    kind: str
    client: str
    loads: bool | None = None
    runs: bool | None = None
    agrees: bool | None = None
    ends: bool | None = None
    difference: float | None = None
    reasons: list[str] = field(default_factory=list)


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


class EndError(RuntimeError):
    """A process gave all its results and then crashed; `found` holds them."""

    def __init__(self, message: str, found: dict[str, Array]) -> None:
        super().__init__(message)
        self.found = found


def run_host(
    host: Path, model: ExportedModel, steps: int, h: float, signals: Sequence[str], preload: Path | None
) -> dict[str, Array]:
    """Run a system in the plain C host; each signal of shape (steps + 1,).

    Raises:
        EndError: the process crashed after its last row.
        RuntimeError: it failed before; the message holds what it wrote.
    """
    with tempfile.TemporaryDirectory(prefix="host_") as scratch:
        plan = Path(scratch, "plan.txt")
        plan.write_text(_plan(model, signals), encoding="utf-8")
        variables = dict(environment())
        if preload is not None:
            variables |= {"LD_PRELOAD": str(preload), "PYTHONPATH": sysconfig.get_paths()["purelib"]}
        words = [str(host), str(plan), str(steps), repr(h)]
        done = subprocess.run(
            words, env=variables, cwd=scratch, capture_output=True, text=True, timeout=TIMEOUT, check=False
        )
    lines = done.stdout.splitlines()
    message = f"ended with {done.returncode}: {done.stderr[-2000:]}"
    if len(lines) != steps + 1:
        raise RuntimeError(message)
    rows = np.array([line.split() for line in lines], dtype=float)
    found = {"time": rows[:, 0], **dict(zip(signals, rows[:, 1:].T, strict=True))}
    if done.returncode != 0:
        raise EndError(f"all results are there, then the process {message}", found)
    return found


def _plan(model: ExportedModel, signals: Sequence[str]) -> str:
    system = model.system
    place = {name: k for k, name in enumerate(model.order)}
    lines = []
    for name in model.order:
        component = system.components[name]
        fmu = component.fmu
        library = fmu.folder / "binaries" / "linux64" / f"{fmu.identifier}.so"
        lines.append(f"component {name} {library} file://{fmu.folder}/resources {fmu.guid}")
        for key, value in component.starts.items():
            declared = fmu.variables[key]
            lines.append(f"{declared.kind.lower()} {declared.reference} {value!r}")
    for wire in system.wires:
        ends = (wire.source, wire.target)
        numbers = " ".join(f"{place[p.component]} {system.variable(p).reference}" for p in ends)
        lines.append(f"wire {numbers} {int(wire in model.late)}")
    for signal in signals:
        owner, _, port = signal.partition(".")
        lines.append(f"output {place[owner]} {system.components[owner].fmu.variables[port].reference}")
    return "\n".join(lines) + "\n"


class Trials:
    """Everything needed to try clients on packages; `host` is None without a C compiler."""

    def __init__(self, packages: Mapping[str, Mapping[str, Path]], scratch: Path, steps: int = STEPS) -> None:
        self.packages, self.steps = packages, steps
        self.host = compiled_host(scratch)
        self.expected: dict[tuple[str, str, bool | None], dict[str, Array]] = {}

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
        assert self.host is not None
        with read_system(package) as system:
            preload = libpython() if client == "host+python" else None
            return run_host(self.host, prepare(system), steps, H, signals, preload)

    def reference(self, kind: str, client: str, system: str) -> dict[str, Array]:
        """What the equations give under the client's scheme."""
        zero = FIRST_INPUT_ZERO.get(client)
        key = (kind, system, zero)
        if key not in self.expected:
            package, signals = self.packages[kind][system], SIGNALS[system]
            if zero is None:
                with read_system(package) as read:
                    self.expected[key] = gauss_seidel(package, prepare(read), self.steps, H, signals)
            else:
                self.expected[key] = simulate(package, self.steps, H, signals, first_input_zero=zero)
        return self.expected[key]


def short(error: Exception) -> str:
    """The telling line of what a process wrote, without folders of this machine."""
    lines = [line.strip() for line in str(error).replace("\x00", "").splitlines() if line.strip()]
    telling = [line for line in lines if "rror" in line or "undefined" in line or "ended with" in line]
    text = (telling or lines or [type(error).__name__])[-1]
    words = [word.rsplit("/", 1)[-1] if word.count("/") > 1 else word for word in text.split()]
    return " ".join(words)[:200]


def libpython() -> Path | None:
    """The shared library of this Python, or None if it has none."""
    variables = sysconfig.get_config_vars()
    library = Path(variables.get("LIBDIR") or "", variables.get("INSTSONAME") or "")
    return library if library.is_file() and ".so" in library.name else None


def compiled_host(folder: Path) -> Path | None:
    """The plain C host, compiled, or None where that is not possible."""
    compiler = shutil.which("cc")
    if compiler is None or not sys.platform.startswith("linux"):
        return None
    host = folder / "host"
    source = Path(__file__).with_name("host.c")
    subprocess.run([compiler, "-std=gnu99", "-O1", "-o", str(host), str(source), "-ldl"], check=True)
    return host


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


INTRODUCTION = """# Which tools run our components

Made by `python benchmarks/interoperability.py`; do not edit by hand. Every cell is a run on the machine named below.

- Kinds: `pythonfmu` are the FMUs of `python build_fmus.py`, which need a Python on the host; `native` those of
  `python build_fmus.py --native`, the same equations in C, which need none.
- Packages: the closed systems {systems}, unchanged, each run for {seconds:g} s at 1 ms.
- loads: the package is read, its FMUs are instantiated and make one step. runs: all {steps} steps.
- agrees: every compared signal is within {tolerance:g} of its range of the same blocks computed in plain Python under
  the client's own scheme (fmpy, ecos and libcosim delay every wire by one step; ours and the C host do not).
- ends: every process ended without a crash after its last result.
- Each run is a process of its own; a crash or a time-out of {timeout:g} s counts as a failure.
"""

NOT_RUN = """
## Not run here

There is no MATLAB, no Modelica tool and no Windows at hand. [Export](export.md) says what was checked in their stead.

- Simulink: `cosim export-simulink` writes a script; it was run in Octave against a stand-in for Simulink.
- OpenModelica and Dymola: `cosim export-modelica` writes a package; its C functions were run event by event.
- Windows: the FMUs of the kind `pythonfmu` hold win64 binaries.
"""


def page(rows: Sequence[Row], validations: Mapping[str, tuple[int, list[str]]], steps: int) -> str:
    """docs/interoperability.md."""
    text = INTRODUCTION.format(
        systems=", ".join(f"`{name}`" for name in SYSTEMS),
        seconds=steps * H, steps=steps, tolerance=TOLERANCE, timeout=TIMEOUT,
    )  # fmt: skip
    text += "\n| FMU kind | client | loads | runs | agrees | ends | largest difference |\n|---|---|---|---|---|---|---|\n"
    for row in rows:
        answers = [
            {True: "yes", False: "**no**", None: "not tried"}[a]
            for a in (row.loads, row.runs, row.agrees, row.ends)
        ]
        difference = "" if row.difference is None else f"{row.difference:.1e}"
        text += f"| {row.kind} | {CLIENTS[row.client]} | {' | '.join(answers)} | {difference} |\n"
    reasons = [f"- {row.kind}, {CLIENTS[row.client]}: {reason}" for row in rows for reason in row.reasons]
    if reasons:
        text += "\nWhat the failures said, and why something was not tried:\n\n" + "\n".join(reasons) + "\n"
    missing = [kind for kind in KINDS if kind not in validations]
    text += "".join(f"\nThe kind `{kind}` was not built: `{BUILD[kind]}`.\n" for kind in missing)
    text += "\nFMPy's `validate_fmu`:\n\n"
    for kind, (count, problems) in validations.items():
        text += f"- {kind}: {count} FMUs in the packages, {len(problems)} problems\n"
        text += "".join(f"  - {problem}\n" for problem in problems)
    if any(row.client == "host" and row.kind == "pythonfmu" and not row.loads for row in rows):
        text += (
            "\nA host that is not Python, Simulink and OpenModelica among them, finds Python's symbols only\n"
            "if its shared library is loaded first; `cosim doctor` names the file. Native FMUs need nothing of the kind.\n"
        )
    text += NOT_RUN
    facts = machine() | {"system": " ".join([platform.system(), *platform.libc_ver()])}
    text += "\nMachine: " + ", ".join(f"{name} {value}" for name, value in facts.items()) + ".\n"
    return text


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
    text = page(rows, validations, options.steps)
    options.out.write_text(text, encoding="utf-8")
    print(text)
    if options.json:
        figures = {"machine": machine(), "tolerance": TOLERANCE, "rows": [asdict(row) for row in rows]}
        options.json.write_text(json.dumps(figures, indent=2) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
