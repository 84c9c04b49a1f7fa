"""Each FMU by itself in FMPy and in fmusim, as part of the table of clients (`benchmarks/interoperability.py`).

fmusim is the simulator that the Reference-FMUs of the Modelica Association had until July 2026, in C with a reader of
descriptions of its own. No package has it: build it, and name it in FMUSIM or put it on the path. Both get the same inputs,
record the same outputs and, in model exchange, solve by the same explicit Euler steps.
"""

import os
import shutil
import subprocess
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
STEPS, H = 500, 1e-3
INTERFACES = {"cs": "CoSimulation", "me": "ModelExchange"}


@dataclass
class Single:
    """What fmusim does with the FMUs of one kind.

    Attributes:
        kind: of FMU, a key of `interoperability_page.KINDS`.
        runs: interface -> how many FMUs it ran.
        difference: interface -> the largest difference from FMPy, of a signal's range.
        messages: what it wrote, or how it failed.
    """

    kind: str
    runs: dict[str, int] = field(default_factory=dict)
    difference: dict[str, float] = field(default_factory=dict)
    messages: list[str] = field(default_factory=list)


def fmusim() -> str | None:
    """The program, or None if there is none."""
    return shutil.which(os.environ.get("FMUSIM", "fmusim"))


def tried(kind: str, folder: Path, program: str) -> Single:
    """Run every FMU of a folder in both."""
    found = Single(kind)
    for file in sorted(folder.glob("*.fmu")):
        description = fmpy.read_model_description(str(file), validate=False)
        for interface, name in INTERFACES.items():
            if getattr(description, name[0].lower() + name[1:]) is None:
                continue
            try:
                one, other = (
                    in_fmpy(file, description, name),
                    in_fmusim(file, description, interface, program),
                )
            except RuntimeError as error:
                found.messages.append(f"{file.stem}, {name}: {error}")
                continue
            found.runs[interface] = found.runs.get(interface, 0) + 1
            for signal, values in one.items():
                worst = float(np.max(np.abs(other[signal] - values))) / (float(np.ptp(values)) or 1.0)
                found.difference[interface] = max(found.difference.get(interface, 0.0), worst)
    return found


def inputs(description: Any) -> dict[str, Array]:
    """A sine within the bounds and the nominal size of each input, (STEPS + 1,)."""
    found = {}
    for variable in description.modelVariables:
        if variable.causality == "input":
            size = float(variable.nominal or 1.0)
            low, high = max(float(variable.min or -size), -size), min(float(variable.max or size), size)
            found[variable.name] = 0.5 * (low + high) + 0.2 * (high - low) * np.sin(
                7.0 * H * np.arange(STEPS + 1)
            )
    return found


def outputs(description: Any) -> list[str]:
    """Names of the outputs."""
    return [v.name for v in description.modelVariables if v.causality == "output"]


def behind(times: Array) -> NDArray[np.bool_]:
    """The last row of each time (n,): of an event both write what was before, too."""
    return np.append(np.diff(times) > 0.25 * H, True)


def in_fmpy(file: Path, description: Any, interface: str) -> dict[str, Array]:
    """Outputs over time by FMPy.

    Raises:
        RuntimeError: it gives no rows as asked for.
    """
    series = {"time": H * np.arange(STEPS + 1), **inputs(description)}
    table = np.array(list(zip(*series.values(), strict=True)), dtype=[(name, float) for name in series])
    rows = fmpy.simulate_fmu(
        str(file), fmi_type=interface, stop_time=STEPS * H, output_interval=H, step_size=H, solver="Euler",
        input=table if len(series) > 1 else None, output=outputs(description),
    )  # fmt: skip
    rows = rows[behind(rows["time"])]
    if len(rows) != STEPS + 1:
        raise RuntimeError(f"FMPy gives {len(rows)} rows")
    return {name: rows[name] for name in outputs(description)}


def in_fmusim(file: Path, description: Any, interface: str, program: str) -> Mapping[str, Array]:
    """Outputs over time by fmusim.

    Raises:
        RuntimeError: it failed, or wrote anything beside its results.
    """
    series = {"time": H * np.arange(STEPS + 1), **inputs(description)}
    with tempfile.TemporaryDirectory(prefix="fmusim_") as scratch:
        played, written = Path(scratch, "in.csv"), Path(scratch, "out.csv")
        words = [program, "--interface-type", interface, "--solver", "euler", "--stop-time", repr(STEPS * H)]
        words += ["--output-interval", repr(H), "--output-file", str(written)]
        if len(series) > 1:
            rows = [",".join(map(repr, map(float, row))) for row in zip(*series.values(), strict=True)]
            played.write_text("\n".join([",".join(series), *rows]) + "\n", encoding="utf-8")
            words += ["--input-file", str(played)]
        done = subprocess.run([*words, str(file)], cwd=scratch, capture_output=True, text=True, check=False)
        said = f"{done.stdout} {done.stderr}".strip()
        if done.returncode or said or not written.is_file():
            raise RuntimeError(f"fmusim ended with {done.returncode}: {said[:200]}")
        header = [
            name.strip('"') for name in written.read_text(encoding="utf-8").partition("\n")[0].split(",")
        ]
        table = np.loadtxt(written, delimiter=",", skiprows=1)
    table = table[behind(table[:, 0])]
    if table.shape != (STEPS + 1, len(header)):
        raise RuntimeError(f"fmusim gives {len(table)} rows")
    return {name: table[:, header.index(name)] for name in outputs(description)}


def told(singles: list[Single]) -> str:
    """The paragraph of the page."""
    if not singles:
        return "\n## Each FMU by itself\n\nfmusim was not at hand: built, and named in FMUSIM, it has its table here.\n"
    text = (
        f"\n## Each FMU by itself\n\nEvery native FMU alone in fmusim (Reference-FMUs, built from source) and in FMPy's\n"
        f"`simulate_fmu`: {STEPS} steps of 1 ms, a sine at each input, in model exchange explicit Euler steps in both. The\n"
        "numbers are the difference between the two, of a signal's range, at most.\n\n"
        "| FMU kind | co-simulation | | model exchange | | what fmusim wrote |\n|---|---|---|---|---|---|\n"
    )
    for single in singles:
        cells = [
            cell
            for interface in INTERFACES
            for cell in (
                f"{single.runs.get(interface, 0)} run",
                f"{single.difference.get(interface, float('nan')):.1e}",
            )
        ]
        text += f"| {single.kind} | {' | '.join(cells)} | {len(single.messages) or 'nothing'} |\n"
    return text + "".join(
        f"\n- {single.kind}: {message}" for single in singles for message in single.messages
    )
