"""Commands ended at random moments: ``python benchmarks/kills.py [--kills 200] [--late 0.75] [--only NAMES] [--json]``.

Each command first runs to its end twice, into two folders and with another number (the old and the new result). Then it is
begun again over a copy of the old result, and ended by SIGKILL and SIGTERM in turn: every other time at any moment of its
duration, else a moment after its folder has changed for the n-th time. The moments are stratified: each n-th part of the
duration has one.

Most moments lie before the first file is written, and such a kill shows little. So a share `--late` of the kills goes to
forks of a command that stands at its first write (`first_write.py`), over the rest of its duration. `--late 0` makes all
of them processes of their own, as `build`, `batch` and `calibrate` always are: they work in threads and in further
processes, or hold FMUs open whose threads no fork has.

Every file must be the old or the new one, byte for byte where two
runs of the command agree byte for byte, else whole (JSON that can be parsed, pages and pictures with their end, tables and
archives that can be read). No traceback, no internal error, and after SIGTERM no temporary files.

A batch is begun again until it has been ended `ROUNDS` times, then runs to its end: cube, table and journal must be those of
a batch that nobody ended, byte for byte but for times, workers and memory. Every other batch is begun with `--fresh` over
the one before.

A signal that comes when the command has ended already shows nothing: it is not counted, and another is sent in its place.
"""

import argparse
import contextlib
import hashlib
import json
import math
import os
import random
import resource
import select
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

from benchmarks.first_write import READY
from cosim.files import is_left_over

TOP = Path(__file__).resolve().parent.parent
ROUNDS = 4
TOO_LATE = 4  # tries for each kill
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
        forks: it can go on in a fork: no threads, no further processes, no open FMUs.
    """

    old: list[str]
    new: list[str]
    inherits: bool = False
    forks: bool = True


@dataclass
class Row:
    """What came of one command."""

    kills: int = 0
    late: int = 0  # of them in forks, from the first write on
    early: int = 0  # besides: it had ended before the signal came
    old: int = 0  # files
    new: int = 0
    timed: int = 0  # whole, of the kind that differs between two runs
    partial: int = 0  # whole, of a diagnosis that says that it was interrupted
    left_over: int = 0  # files beside, which the killed writer meant to rename
    wrong: list[str] = field(default_factory=list)


def commands(log: Path, systems: Path) -> dict[str, Command]:
    """The commands that write, and `rig`."""
    model = str(systems / "simplified.ssp")
    simulate = ["simulate", model, "--stop-time", "2 s", "--out", "{out}/result.csv"]
    batch = ["batch", "--model", model, "--sweep", "simplified.a=2:4:12 1/s", "--stop-time", "0.5 s"]
    batch += ["--workers", "2", "--out", "{out}"]
    compare = ["compare", str(log), "--model", "simplified", "--calibrate", "--out", "{out}"]
    rig = ["rig", "--excitation", "steps", "--duration", "5 s", "--out", "{out}/log.csv"]
    diagnose = ["diagnose", str(log), "--model", "simplified", "--out", "{out}"]
    build = ["build", "--out", "{out}"]
    played = [*build, "--with-stimulus", str(log)]
    return {
        "simulate": Command(simulate, [*simulate, "--set", "simplified.a=2.5 1/s"]),
        "build": Command(played, build, forks=False),
        "batch": Command(batch, batch, forks=False),
        "diagnose": Command([*diagnose, "--tolerance", "0.02"], diagnose),
        "calibrate": Command(compare, [*compare, "--set", "simplified.theta_max=1.2 rad"], forks=False),
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


class Fork:
    """A command's fork, with what of a process is asked for here."""

    def __init__(self, template: "Template", said: Path) -> None:
        self.template, self.said = template, said
        self.pid = int(template.asked(str(said)))
        self.returncode: int | None = None

    def poll(self) -> int | None:
        """How it ended; None while it runs."""
        if self.returncode is None and select.select([self.template.process.stdout], [], [], 0.0)[0]:
            self.returncode = int(self.template.answer())
        return self.returncode

    def send_signal(self, how: int) -> None:
        """A signal, if it still runs."""
        with contextlib.suppress(ProcessLookupError):
            os.kill(self.pid, how)

    def communicate(self, timeout: float) -> tuple[None, bytes]:
        """Waits for its end; returns what it said."""
        if self.poll() is None:
            select.select([self.template.process.stdout], [], [], timeout)
        if self.poll() is None:
            self.send_signal(signal.SIGKILL)
            raise TimeoutError("a fork that a signal did not end")
        return None, self.said.read_bytes()


class Template:
    """A command that stands at its first write."""

    def __init__(self, words: list[str], out: Path, scratch: Path) -> None:
        place = [word.replace("{out}", str(out)) for word in words]
        script = str(Path(__file__).with_name("first_write.py"))
        self.process = subprocess.Popen(
            [sys.executable, script, str(out), *place],
            cwd=scratch.parent,
            env=os.environ | {"PYTHONPATH": str(TOP), "TMPDIR": str(scratch)},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            bufsize=0,
        )
        assert self.answer() == READY

    def answer(self) -> str:
        """The next line."""
        line = self.process.stdout.readline()  # type: ignore[union-attr]
        assert line, "the command ended before it wrote anything"
        return line.decode().strip()

    def asked(self, line: str) -> str:
        """The answer to a line."""
        self.process.stdin.write(f"{line}\n".encode())  # type: ignore[union-attr]
        return self.answer()

    def close(self) -> None:
        """Let it end."""
        self.process.stdin.close()  # type: ignore[union-attr]
        self.process.wait()
        self.process.stdout.close()  # type: ignore[union-attr]


Process = "subprocess.Popen[bytes] | Fork"


@dataclass
class Moments:
    """When processes are ended, stratified.

    Attributes:
        lasts: how long they run [s].
        changes: how often their folder changes.
        count: how many are ended.
        begin: the first moment, a part of the duration.
        drawn: how many were drawn already.
    """

    lasts: float
    changes: int
    count: int
    begin: float
    drawn: int = 0

    def end(self, process: Process, out: Path, how: int, chance: random.Random) -> bytes:
        """Ends a process at the next moment; returns what it said."""
        drawn = self.drawn % self.count  # what came too late is drawn again
        place = (drawn // 2 * 2 + chance.uniform(0.0, 2.0)) / self.count  # two of each kind and signal
        by_time = drawn // 2 % 2 == 0
        self.drawn += 1
        if by_time:
            time.sleep((self.begin + (1.0 - self.begin) * place) * self.lasts)
        else:
            watched(process, out, 1 + int(place * self.changes), 2.0 * self.lasts)
            time.sleep(10.0 ** chance.uniform(*AFTER_CHANGE))
        process.send_signal(how)
        _, said = process.communicate(timeout=LONGEST)
        return said


def watched(process: Process, out: Path, most: float, longest: float) -> int:
    """Waits until a folder has changed so often, or the process has ended; returns how often it has."""
    seen, before, until = 0, _stamps(out), time.monotonic() + longest
    while seen < most and time.monotonic() < until:
        over = process.poll() is not None
        now = _stamps(out)
        seen, before = seen + (now != before), now
        if over:
            break
        time.sleep(0.001)
    return seen


def measured(process: Process, out: Path) -> tuple[float, int]:
    """Duration [s] of a process, and how often its folder changes."""
    begun = time.monotonic()
    changes = watched(process, out, math.inf, LONGEST)
    _, said = process.communicate(timeout=LONGEST)
    if process.returncode:
        raise RuntimeError(f"{process.returncode}\n{said.decode()}")
    return time.monotonic() - begun, changes


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


def manners(process: Process, said: bytes, how: int, scratch: Path) -> list[str]:
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


def counted(row: Row, process: Process, answered: bool = False) -> None:
    """Counts a kill, or one that came too late; a diagnosis may end well because it was told to end."""
    if process.returncode == 0 and not answered:
        row.early += 1
    else:
        row.kills += 1


def files(name: str, command: Command, kills: int, late: float, folder: Path, chance: random.Random) -> Row:
    """Ends a command that writes files."""
    old, new, again, out, scratch = (folder / n for n in ("old", "new", "again", "out", "scratch"))
    run(command.old, old, scratch)
    for target in (new, again):
        if command.inherits:
            shutil.copytree(old, target)
        run(command.new, target, scratch)
    before, after, second = digests(old), digests(new), digests(again)
    if "report" not in name:
        shutil.rmtree(again)
        run(command.old, again, scratch)
        first = digests(again)
    else:
        first = before
    timed = {n for n in after if second.get(n) != after[n]} | {n for n in before if first.get(n) != before[n]}
    row = Row(late=round(late * kills) if command.forks else 0)

    def judged(process: Process, moments: Moments) -> None:
        how = signal.SIGTERM if moments.drawn % 2 else signal.SIGKILL
        said = moments.end(process, out, how, chance)
        found, stopped = digests(out), _interrupted(out)
        counted(row, process, stopped)
        row.wrong += manners(process, said, how, scratch)
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

    def laid_out(temporary: Path | None = None) -> None:
        for each in (out, scratch):
            shutil.rmtree(each, ignore_errors=True)
        shutil.copytree(old, out)
        if temporary is not None:
            shutil.copytree(temporary, scratch, symlinks=True)

    def processes(count: int) -> None:
        laid_out()
        moments = Moments(*measured(started(command.new, out, scratch), out), count, 0.05)
        while row.kills < count and moments.drawn < TOO_LATE * count:
            laid_out()
            judged(started(command.new, out, scratch), moments)

    def forks(count: int) -> None:
        laid_out()
        scratch.mkdir(exist_ok=True)
        template, temporary, words = (
            Template(command.new, out, scratch),
            folder / "temporary",
            folder / "words",
        )
        shutil.copytree(
            scratch, temporary, symlinks=True
        )  # a fork that ends in order takes away what it finds
        laid_out(temporary)
        moments = Moments(*measured(Fork(template, words), out), count, 0.0)
        before = row.kills
        while row.kills < before + count and moments.drawn < TOO_LATE * count:
            laid_out(temporary)
            judged(Fork(template, words), moments)
        template.close()

    if kills > row.late:
        processes(kills - row.late)
    if row.late:
        forks(row.late)
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
    """Its journal, in the order of the runs, without those; a run that was done twice is there twice."""
    rows = [json.loads(line) for line in (folder / "journal.jsonl").read_text().splitlines()]
    kept = [{n: v for n, v in row.items() if n not in FALLING} for row in rows]
    return sorted(json.dumps(row) for row in sorted(kept, key=lambda row: row["run"]))


def batches(command: Command, kills: int, folder: Path, chance: random.Random) -> Row:
    """Ends batches, goes on with each, and holds the result against one that nobody ended."""
    whole, out, scratch = folder / "whole", folder / "out", folder / "scratch"
    whole.mkdir()
    moments = Moments(*measured(started(command.new, whole, scratch), whole), kills, 0.05)
    cube = digests(whole / "signals.zarr")
    row = Row()
    anew = False  # every other batch throws away the one before, which is whole
    while row.kills < kills and moments.drawn < TOO_LATE * kills:
        if not anew:
            shutil.rmtree(out, ignore_errors=True)
            out.mkdir()
        for k in range(min(ROUNDS, kills - row.kills)):
            shutil.rmtree(scratch, ignore_errors=True)
            how = signal.SIGTERM if moments.drawn % 2 else signal.SIGKILL
            words = [*command.new, "--fresh"] if anew and k == 0 else command.new
            process = started(words, out, scratch)
            said = moments.end(process, out, how, chance)
            counted(row, process)
            row.wrong += manners(process, said, how, scratch)
            # half a line of the journal is done again
            tops = [f for f in out.iterdir() if f.is_file() and f.suffix != ".jsonl" and not is_left_over(f)]
            row.wrong += [f"{item.name} is not whole" for item in tops if not is_whole(item)]
            if process.returncode == 0:
                break  # nothing is left to be ended
        anew = not anew
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
    parser.add_argument("--late", type=float, default=0.75, help="share of the kills from the first write on")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", help="commands, with commas between them")
    parser.add_argument("--json", action="store_true")
    asked = parser.parse_args()
    rows: dict[str, Row] = {}
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        log, scratch = folder / "log.csv", folder / "scratch"
        hidden = ["--hide", "mechanical.coulomb_friction:tau_c=300 N.m", "--seed", "3"]
        run(
            ["rig", "--excitation", "steps", "--duration", "6 s", *hidden, "--out", str(log)],
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
            if name == "batch":
                row = batches(every[name], count, place_of_it, chance)
            else:
                row = files(name, every[name], count, asked.late, place_of_it, chance)
            rows[name] = row
            if not asked.json:
                kinds = {"old": row.old, "new": row.new, "new but for times": row.timed}
                kinds |= {"of interrupted diagnoses": row.partial, "left over": row.left_over}
                tally = ", ".join(f"{count} {kind}" for kind, count in kinds.items() if count)
                when = f"{row.late} from the first write on; {row.early} more came too late"
                print(
                    f"{name}: {row.kills} kills ({when}), files: {tally}; {len(row.wrong)} wrong",
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
