"""Ours against every peer in one run: ``python benchmarks/peers.py [--quick] [--page FILE] [--growth FILE]``.

Runs `runner.py` (one simulation: fmpy simulate_ssp, ecos, libcosim), `batch.py` (a sweep: FMPy with Dask), `fit.py` (a fit:
scipy around fmpy) and `native.py` (the limit: a C loop of the same equations) one after the other on this machine, and
puts the ratios into one table. ``--page`` writes it as Markdown, ``--growth`` adds what `growth.py --json` has written.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from benchmarks.runner import machine

TOP = Path(__file__).resolve().parent.parent
# part: options, and those of a quick look
PARTS: dict[str, tuple[list[str], list[str]]] = {
    "runner": (["--duration", "60", "--repeat", "3"], ["--duration", "5", "--repeat", "1"]),
    "batch": (
        ["--runs", "40", "--stop", "5", "--repeat", "3", "--growth"],
        ["--runs", "4", "--stop", "1", "--repeat", "1"],
    ),
    "fit": (["--duration", "10", "--repeat", "3"], ["--duration", "5", "--repeat", "1"]),
    "native": (["--duration", "10", "--repeat", "5"], ["--duration", "2", "--repeat", "1"]),
}
HEADS = ("task", "way", "s", "x real time", "ratio to ours")
GROWTH = {
    "compare": ("seconds", "`cosim compare --out`: length of the log, s"),
    "diagnose": ("seconds", "`cosim diagnose --out`: length of the log, s"),
    "candidates": ("candidates", "`cosim diagnose` of 60 s: candidates"),
    "blocks": ("blocks", "`cosim diagnose` of 60 s: blocks that the log's signals let judge"),
}
REASONS = """\
The program alone takes {:.0f} MiB. Logs are synthetic, 1000 rows a second, with every signal of a log; each point is a
process of its own, memory that of the largest process. Straight lines, but for two bends on purpose: a log of more than
two million rows keeps its simulated signals in a file, so memory of a comparison grows by the log alone (and by the
scores of one signal at a time) from there on; a diagnosis fits the most telling five minutes of a longer log and checks
the rest by the compiled twin. Candidates cost little where a score test of their sensitivities rules them out; blocks
cost what their candidates do."""
Row = tuple[str, str, float, float | None, float | None]


def measured(part: str, quick: bool) -> Any:
    """Figures of one part, run as the command that it is.

    Raises:
        SystemExit: it failed.
    """
    print(f"{part} ...", file=sys.stderr, flush=True)
    with tempfile.TemporaryDirectory(prefix="peers_") as scratch:
        file = Path(scratch, "figures.json")
        command = [sys.executable, str(TOP / "benchmarks" / f"{part}.py"), *PARTS[part][quick], "--json"]
        done = subprocess.run([*command, str(file)], cwd=TOP, capture_output=True, text=True, check=False)
        if done.returncode:
            raise SystemExit(f"{part} failed: {done.stderr[-2000:]}")
        return json.loads(file.read_text(encoding="utf-8"))


def rows_of(figures: dict[str, Any]) -> list[Row]:
    """One row a way: a simulation, two sweeps, a fit, and the limit."""
    run, batch, fit, native = (figures[part] for part in PARTS)
    task = f"full order, {run['duration']:g} s at 1 ms"
    rows: list[Row] = [
        (task, r["label"], r["seconds"], r["times_real_time"], r["ratio"]) for r in run["rows"]
    ]
    ours = next(r["way"] for r in native["rows"])  # Python FMUs in our runner
    for r in native["rows"]:
        if r["way"] != ours:
            seconds = r["microseconds_per_step"] * 1e-3 * run["duration"]
            rows.append(
                (f"{task} (CPU)", r["way"], seconds, r["times_real_time"], 1.0 / r["times_python_fmus"])
            )
    for r in batch["rows"]:
        title = f"{r['what']}, sweep of {batch['runs']} runs of {batch['stop']:g} s (CPU)"
        pace = batch["runs"] * batch["stop"] / r["cpu_seconds"]
        rows.append((title, r["way"], r["cpu_seconds"], pace, r["ratio"]))
    own = next(r["seconds"] for r in fit if r["way"] == "FMUs, our runner")
    rows += [("fit of three parameters (CPU)", r["way"], r["seconds"], None, r["seconds"] / own) for r in fit]
    return rows


def markdown(heads: Sequence[str], rows: Sequence[Sequence[object]]) -> list[str]:
    """A table."""
    lines = ["| " + " | ".join(heads) + " |", "|" + "---|" * len(heads)]
    for row in rows:
        cells = ["" if x is None else f"{x:.3g}" if isinstance(x, float) else str(x) for x in row]
        lines.append("| " + " | ".join(cells) + " |")
    return lines


def page(rows: list[Row], growth: dict[str, Any] | None, batch: dict[str, Any]) -> str:
    """Two sections of docs/scores.md."""
    about = machine()
    lines = [
        "### Beside other programs, in full",
        "",
        f"Written by `python benchmarks/peers.py` on {datetime.now(UTC):%Y-%m-%d}: {about['processor']}, {about['cores']}"
        f" cores shared with other work, Python {about['python']}. Ratios hold on other machines; seconds do not.",
        "",
        "The same package, sweep or fit in every row of a task, the ways interleaved. Ratio 1 is ours with Python FMUs; a",
        "larger ratio is slower. CPU: time computed, and the ratio is to our Python FMUs in the same measure. A sweep",
        "counts the whole command: `cosim batch` also writes cube, table and picture, which outweighs few short runs",
        "([batch.md](batch.md)).",
        "",
        *markdown(HEADS, rows),
    ]
    if growth:
        lines += ["", "### How cost grows", "", REASONS.format(growth["program"]["peak_MiB"])]
        for name, (of, title) in GROWTH.items():
            if growth.get(name):
                heads = (title, "wall s", "CPU s", "peak MiB")
                cells = [
                    (f"{r[of]:g}", r["wall_s"], r["cpu_s"], f"{r['peak_MiB']:.0f}") for r in growth[name]
                ]
                lines += ["", *markdown(heads, cells)]
    for engine in ("fmu", "compiled"):
        if found := batch.get(f"growth_{engine}"):
            heads = (
                f"`cosim batch --engine {engine}`, full order, {batch['stop']:g} s: runs",
                "wall s",
                "worker MiB",
            )
            cells = [(f"{r['runs']:g}", r["seconds"], f"{r['largest_worker_mib']:.0f}") for r in found]
            lines += ["", *markdown(heads, cells)]
    return "\n".join(lines) + "\n"


def main() -> int:
    """Measure, print, write."""
    from cosim.console import stdout_console, table

    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--quick", action="store_true", help="a minute, to see that every part runs")
    parser.add_argument("--page", type=Path, help="write the tables here, as Markdown")
    parser.add_argument("--growth", type=Path, help="figures that growth.py --json has written, for the page")
    parser.add_argument("--json", type=Path, help="write the figures to this file too")
    options = parser.parse_args()
    figures = {part: measured(part, options.quick) for part in PARTS}
    rows = rows_of(figures)
    cells = [[x if x is not None else "" for x in row] for row in rows]
    stdout_console().print(table("Ours and the peers", HEADS, cells))
    if options.page:
        growth = json.loads(options.growth.read_text(encoding="utf-8")) if options.growth else None
        options.page.write_text(page(rows, growth, figures["batch"]), encoding="utf-8")
    if options.json:
        options.json.write_text(json.dumps(figures, indent=2) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
