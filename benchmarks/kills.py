"""Commands ended at random moments: ``python benchmarks/kills.py [--kills 200] [--seed 1] [--only NAMES] [--json]``.

Each command first runs to its end twice, into two folders and with another number (the old and the new result). Then it is
begun again over a copy of the old result, and ended by SIGKILL and SIGTERM in turn: every other time at any moment of its
duration, else a moment after its folder has changed. Every file must be the old or the new one, byte for byte where two
runs of the command agree byte for byte, else whole (JSON that can be parsed, pages and pictures with their end, tables and
archives that can be read). No traceback, no internal error, and after SIGTERM no temporary files.

A batch is begun again until it has been ended `ROUNDS` times, then runs to its end: cube, table and journal must be those of
a batch that nobody ended, byte for byte but for times, workers and memory.
"""

import argparse
import hashlib
import json
import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import zipfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from cosim.files import is_left_over

TOP = Path(__file__).resolve().parent.parent
ROUNDS = 4
AFTER_CHANGE = (-4.0, -1.0)  # powers of ten, s
LONGEST = 300.0  # s
FALLING = ("seconds", "worker", "resident")  # what differs between two batches that are the same
ENDS = {".html": b"</html>", ".png": b"IEND\xaeB`\x82", ".parquet": b"PAR1", ".csv": b"\n"}


@dataclass
class Command:
    """A command, its old and its new words; `{out}` is its folder.

    Attributes:
        old: words that make what lies there before.
        new: words that are ended.
        inherits: the new words read what the old ones left.
    """

    old: list[str]
    new: list[str]
    inherits: bool = False


@dataclass
class Row:
    """What came of one command."""

    kills: int = 0
    early: int = 0  # it had ended before
    old: int = 0  # files
    new: int = 0
    timed: int = 0  # whole, of the kind that differs between two runs
    partial: int = 0  # whole, of a diagnosis that says that it was interrupted
    left_over: int = 0  # files beside, which the killed writer meant to rename
    wrong: list[str] = field(default_factory=list)


def commands(log: Path, systems: Path) -> dict[str, Command]:
    """The commands of CONTRACT section 3 that write, and `rig`."""
    model = str(systems / "simplified.ssp")
    simulate = ["simulate", model, "--stop-time", "5 s", "--out", "{out}/result.csv"]
    batch = ["batch", "--model", model, "--sweep", "simplified.a=2:4:40 1/s", "--stop-time", "2 s"]
    batch += ["--workers", "2", "--out", "{out}"]
    compare = ["compare", str(log), "--model", "simplified", "--calibrate", "--out", "{out}"]
    rig = ["rig", "--excitation", "steps", "--duration", "20 s", "--out", "{out}/log.csv"]
    diagnose = ["diagnose", str(log), "--out", "{out}"]
    build = ["build", "--out", "{out}"]
    return {
        "simulate": Command(simulate, [*simulate, "--set", "simplified.a=2.5 1/s"]),
        "build": Command(build, [*build, "--native"] if shutil.which("gcc") else build),
        "batch": Command(batch, batch),
        "diagnose": Command([*diagnose, "--tolerance", "0.02"], diagnose),
        "calibrate": Command(compare, [*compare, "--set", "simplified.theta_max=1.2 rad"]),
        "report": Command(diagnose, ["report", "{out}", "--language", "de"], inherits=True),
        "rig": Command(rig, [*rig, "--seed", "2"]),
    }


def started(words: list[str], out: Path, scratch: Path) -> "subprocess.Popen[bytes]":
    """The command as a process, its temporary files in a folder of their own."""
    scratch.mkdir(exist_ok=True)
    line = [sys.executable, "-m", "cosim", *(word.replace("{out}", str(out)) for word in words)]
    environment = os.environ | {"PYTHONPATH": str(TOP), "TMPDIR": str(scratch)}
    return subprocess.Popen(
        line, cwd=scratch.parent, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )


def run(words: list[str], out: Path, scratch: Path) -> float:
    """The command to its end; returns its duration [s].

    Raises:
        RuntimeError: it failed.
    """
    begun = time.monotonic()
    process = started(words, out, scratch)
    _, said = process.communicate(timeout=LONGEST)
    if process.returncode:
        raise RuntimeError(f"{' '.join(words)}: {process.returncode}\n{said.decode()}")
    return time.monotonic() - begun


def digests(folder: Path) -> dict[str, str]:
    """File -> SHA-256; what a killed writer left beside is not among them."""
    return {
        str(item.relative_to(folder)): hashlib.sha256(item.read_bytes()).hexdigest()
        for item in sorted(folder.rglob("*"))
        if item.is_file() and not is_left_over(item)
    }


def is_whole(path: Path) -> bool:
    """Whether a file can be read to its end."""
    content = path.read_bytes()
    if path.suffix in (".fmu", ".ssp"):
        with zipfile.ZipFile(path) as archive:
            return archive.testzip() is None
    if path.suffix in (".json", ".ssv"):
        try:
            json.loads(content) if path.suffix == ".json" else content.index(b"</")
        except ValueError:
            return False
        return True
    return content.rstrip(b"\n" if path.suffix != ".csv" else b"").endswith(ENDS.get(path.suffix, b""))


def ended(
    process: "subprocess.Popen[bytes]", out: Path, lasts: float, how: int, chance: random.Random
) -> bytes:
    """Ends the process at a moment; returns what it said."""
    if chance.random() < 0.5:
        time.sleep(chance.uniform(0.05, 1.0) * lasts)
    else:
        before, until = _stamps(out), time.monotonic() + lasts
        while _stamps(out) == before and process.poll() is None and time.monotonic() < until:
            time.sleep(0.001)
        time.sleep(10.0 ** chance.uniform(*AFTER_CHANGE))
    process.send_signal(how)
    _, said = process.communicate(timeout=LONGEST)
    return said


def _stamps(folder: Path) -> set[tuple[str, int]]:
    """Names and times of what lies in a folder, whatever goes meanwhile."""
    found = set()
    for top, folders, files in os.walk(folder):
        for name in (*folders, *files):
            try:
                found.add((f"{top}/{name}", Path(top, name).stat().st_mtime_ns))
            except OSError:
                continue
    return found


def manners(process: "subprocess.Popen[bytes]", said: bytes, how: int, scratch: Path) -> list[str]:
    """What is wrong with how a process ended."""
    text = said.decode(errors="replace")
    found = [f"says {word}" for word in ("Traceback", "internal error", "Exception ignored") if word in text]
    if process.returncode not in (0, -how, 130, 143):
        found.append(f"ends with {process.returncode}")
    found = [f"{each}: {text[-1500:]}" for each in found]
    if how == signal.SIGTERM:
        left = [item.name for item in scratch.iterdir()]
        found += [f"leaves {left} in the temporary folder"] if left else []
    return found


def files(name: str, command: Command, kills: int, folder: Path, chance: random.Random) -> Row:
    """Ends a command that writes files."""
    old, new, again, out, scratch = (folder / n for n in ("old", "new", "again", "out", "scratch"))
    run(command.old, old, scratch)
    for target in (new, again):
        if command.inherits:
            shutil.copytree(old, target)
        lasts = run(command.new, target, scratch)
    before, after, second = digests(old), digests(new), digests(again)
    if "report" not in name:
        shutil.rmtree(again)
        run(command.old, again, scratch)
        first = digests(again)
    else:
        first = before
    timed = {n for n in after if second.get(n) != after[n]} | {n for n in before if first.get(n) != before[n]}
    row = Row()
    for k in range(kills):
        how = signal.SIGTERM if k % 2 else signal.SIGKILL
        for each in (out, scratch):
            shutil.rmtree(each, ignore_errors=True)
        shutil.copytree(old, out)
        process = started(command.new, out, scratch)
        said = ended(process, out, lasts, how, chance)
        row.kills += 1
        row.early += process.returncode == 0
        row.wrong += manners(process, said, how, scratch)
        found, stopped = digests(out), _interrupted(out)
        for item, digest in found.items():
            kind = "old" if digest == before.get(item) else "new" if digest == after.get(item) else ""
            if not kind and (stopped or item in timed) and is_whole(out / item):
                kind = "partial" if stopped else "timed"
            if kind:
                setattr(row, kind, getattr(row, kind) + 1)
            else:
                row.wrong.append(f"{item} is neither old nor new")
        # what the new run does not write may be taken away before it, what both write is always there
        gone = [item for item in before if item in after and item not in found]
        row.wrong += [f"{item} is gone" for item in gone if not stopped]
        row.left_over += sum(is_left_over(item) for item in out.rglob("*"))
    return row


def _interrupted(folder: Path) -> bool:
    """Whether the diagnosis in a folder says of itself that it was ended before all was judged."""
    answer = folder / "diagnosis.json"
    return answer.exists() and bool(json.loads(answer.read_text())["interrupted"])


def table(folder: Path) -> Any:
    """The runs of a batch without what differs between two batches."""
    import pandas as pd

    frame = pd.read_parquet(folder / "runs.parquet")
    return frame.drop(columns=[c for c in frame if c.split(" ")[0] in FALLING])


def journal(folder: Path) -> list[str]:
    """Its journal, in the order of the runs, without those."""
    rows = [json.loads(line) for line in (folder / "journal.jsonl").read_text().splitlines()]
    assert len({row["run"] for row in rows}) == len(rows), "a run was done twice"
    kept = [{n: v for n, v in row.items() if n not in FALLING} for row in rows]
    return sorted(json.dumps(row) for row in sorted(kept, key=lambda row: row["run"]))


def batches(command: Command, kills: int, folder: Path, chance: random.Random) -> Row:
    """Ends batches, goes on with each, and holds the result against one that nobody ended."""
    whole, out, scratch = folder / "whole", folder / "out", folder / "scratch"
    lasts = run(command.new, whole, scratch)
    cube = digests(whole / "signals.zarr")
    row = Row()
    while row.kills < kills:
        shutil.rmtree(out, ignore_errors=True)
        out.mkdir()
        for _ in range(min(ROUNDS, kills - row.kills)):
            shutil.rmtree(scratch, ignore_errors=True)
            how = signal.SIGTERM if row.kills % 2 else signal.SIGKILL
            process = started(command.new, out, scratch)
            said = ended(process, out, lasts, how, chance)
            row.kills += 1
            row.early += process.returncode == 0
            row.wrong += manners(process, said, how, scratch)
        run(command.new, out, scratch)
        found = digests(out / "signals.zarr")
        row.wrong += [f"signals.zarr/{n} differs" for n in {*cube, *found} if cube.get(n) != found.get(n)]
        row.new += sum(cube.get(n) == digest for n, digest in found.items())
        if not table(out).equals(table(whole)):
            row.wrong.append("runs.parquet differs")
        if journal(out) != journal(whole):
            row.wrong.append("journal.jsonl differs")
        if (out / "batch.json").read_text() != (whole / "batch.json").read_text().replace(
            str(whole), str(out)
        ):
            row.wrong.append("batch.json differs")
        row.left_over += sum(is_left_over(item) for item in out.rglob("*"))
    return row


def main() -> int:
    """Run what is asked for and print it."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--kills", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", help="commands, with commas between them")
    parser.add_argument("--json", action="store_true")
    asked = parser.parse_args()
    rows: dict[str, Row] = {}
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        log, scratch = folder / "log.csv", folder / "scratch"
        hidden = ["--hide", "mechanical.coulomb_friction:tau_c=100 N.m", "--seed", "3"]
        run(
            ["rig", "--excitation", "multisine", "--duration", "8 s", *hidden, "--out", str(log)],
            log,
            scratch,
        )
        run(["build", "--out", str(folder / "build")], folder, scratch)
        every = commands(log, folder / "build" / "ssp")
        names = asked.only.split(",") if asked.only else list(every)
        for k, name in enumerate(names):
            count = asked.kills // len(names) + (k < asked.kills % len(names))
            place_of_it = folder / f"of_{name}"
            place_of_it.mkdir()
            chance = random.Random(f"{asked.seed} {name}")
            made = batches if name == "batch" else lambda *words, name=name: files(name, *words)
            rows[name] = row = made(every[name], count, place_of_it, chance)
            if not asked.json:
                kinds = {"old": row.old, "new": row.new, "new but for times": row.timed}
                kinds |= {"of interrupted diagnoses": row.partial, "left over": row.left_over}
                counted = ", ".join(f"{count} {kind}" for kind, count in kinds.items() if count)
                print(
                    f"{name}: {row.kills} kills ({row.early} too late), files: {counted}; {len(row.wrong)} wrong",
                    flush=True,
                )
                for text in dict.fromkeys(row.wrong):
                    print(f"    {text}", flush=True)
    seconds = sum(resource.getrusage(resource.RUSAGE_CHILDREN)[:2])
    if asked.json:
        print(json.dumps({"seconds": seconds, **{name: vars(row) for name, row in rows.items()}}))
    else:
        print(f"{sum(row.kills for row in rows.values())} kills in {seconds:.0f} s of processor time")
    return 1 if any(row.wrong for row in rows.values()) else 0


if __name__ == "__main__":
    sys.exit(main())
