"""No internal error, whatever the log: ``python benchmarks/odd_logs.py --cases 500 --seed 1 [--json]``.

Each case is a synthetic log of the rig, sampled again at a random rate (1 Hz to 5 kHz) with jitter, of random length, with
signals left out, and other outputs of the blocks judged by a mapping (spool speed, slew speed, the angle before the sensor).
It is diagnosed from end to end, report included, as the command does. A clear refusal (exit code 2 or 3) is an answer, too.
With ``--rows FILE`` each case is a line of JSON there as soon as it has ended, and one that is there is not run again.
"""

import argparse
import json
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor, ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from cosim.errors import CosimError
from cosim.logs import load_log
from cosim.report.deliver import diagnose_into
from cosim.rig import EFFECTS, make_log
from cosim.rig.write import as_log

Array = NDArray[np.float64]


class Numbered(Protocol):
    """A case that its seed tells from the others."""

    @property
    def seed(self) -> int:
        """By which it was drawn."""


Case = TypeVar("Case", bound=Numbered)

MODELS = ("full_order", "full_order", "simplified")
EXCITATIONS = ("mixed", "steps", "small_steps", "multisine", "sweep")
# output of a block -> unit of its column; it is judged in the place of the signal of that block
JUDGED = {
    "full_order": {"dcv.spool_rate": "m/s", "mechanical.omega": "rad/s", "mechanical.theta": "rad", "": ""},
    "simplified": {"simplified.omega": "rad/s", "simplified.theta": "rad", "": ""},
}
REPLACED = {"dcv": "spool", "mechanical": "slew", "simplified": "slew"}
OPTIONAL = ("spool", "p_supply", "p_a", "p_b", "slew")
CHEAP = 3  # candidates that a case has at most, so that hundreds fit into an hour


@dataclass(frozen=True)
class Odd:
    """One case, as plain data."""

    seed: int
    model: str
    excitation: str
    duration: float
    rate: float
    jitter: float
    signals: tuple[str, ...]
    judged: str
    calibrate: bool
    rounded: bool
    constant: str


def drawn(count: int, seed: int) -> Iterator[Odd]:
    """The first cases of a seed."""
    rng = np.random.default_rng(seed)
    for k in range(count):
        model = str(rng.choice(MODELS))
        rate = float(np.exp(rng.uniform(np.log(1.0), np.log(5000.0))))
        # some thousands of samples at most: the suite asks whether it ends, not how long it takes
        longest = min(180.0, 30000.0 / rate)
        present = tuple(n for n in OPTIONAL if rng.random() < 0.75)
        yield Odd(
            seed * 100000 + k,
            model,
            str(rng.choice(EXCITATIONS)),
            float(np.exp(rng.uniform(np.log(min(max(0.5, 50.0 / rate), longest)), np.log(longest)))),
            rate,
            float(rng.choice([0.0, 0.0, 0.1, 0.4])),
            present,
            str(rng.choice(list(JUDGED[model]))),
            bool(rng.random() < 0.4),
            bool(rng.random() < 0.2),
            str(rng.choice(["", "", "", "", "", *OPTIONAL, "u"])),
        )


def columns(case: Odd) -> tuple[dict[str, Array], dict[str, str]]:
    """Columns of the log with their headers' units, and column -> output of a block that it stands for."""
    rng = np.random.default_rng(case.seed)
    effect = str(rng.choice(list(EFFECTS)))
    run = make_log(case.excitation, max(round(case.duration, 3), 21.0), [effect], seed=case.seed)
    log = as_log(run)
    steps = np.full(max(2, int(case.duration * case.rate)), 1.0 / case.rate)
    time = np.cumsum(steps * (1.0 + case.jitter * rng.uniform(-1.0, 1.0, steps.size)))
    time = time[time < log.time[-1]] - time[0]
    found = {"time [s]": time}
    spoken = {"u": "1", "spool": "m", "p_supply": "Pa", "p_a": "Pa", "p_b": "Pa", "slew": "rad"}
    for name in ("u", *case.signals):
        values = log.signals[name][np.searchsorted(log.time, time, "right") - 1]
        if case.rounded and name != "u":
            step = 0.02 * max(float(np.ptp(values)), 1e-9)
            values = step * np.round(values / step)
        if case.constant == name:
            values = np.full_like(values, values[0])
        found[f"{name} [{spoken[name]}]"] = values
    stands: dict[str, str] = {}
    if case.judged:
        component, _, output = case.judged.partition(".")
        base = log.signals[REPLACED[component]]
        truth = np.gradient(base, log.time) if output in ("omega", "spool_rate") else base
        unit = JUDGED[case.model][case.judged]
        found[f"other [{unit}]"] = np.interp(time, log.time, truth)
        stands["other"] = case.judged
        if output in ("omega", "spool_rate"):
            found.pop(f"{REPLACED[component]} [{spoken[REPLACED[component]]}]", None)
    return found, stands


def run_case(case: Odd) -> dict[str, Any]:
    """The case with what came of it: a verdict, a refusal, or an internal error with its traceback."""
    row: dict[str, Any] = {"case": asdict(case)}
    began = time.process_time()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        try:
            values, stands = columns(case)
            file, mapping = folder / "log.csv", folder / "map.toml"
            rows = np.stack(list(values.values()), axis=1)
            np.savetxt(file, rows, "%.9g", ",", header=",".join(values), comments="")
            mapping.write_text(toml(case, values, stands), encoding="utf-8")
            log = load_log(file, mapping)
            answer = diagnose_into(folder / "out", log, None, None, 0.01, case.calibrate, mapping)
            row["verdict"] = answer.verdict
            row["seconds"] = time.process_time() - began
            row["failed"] = [
                n for n in (*answer.warnings, *answer.not_judged.values()) if "please report" in n
            ]
            row["report"] = (folder / "out" / "report.html").is_file()
        except CosimError as error:
            row["refused" if error.exit_code in (2, 3) else "error"] = str(error)
        except Exception:
            row["error"] = traceback.format_exc()
    return row


def toml(case: Odd, values: dict[str, Array], stands: dict[str, str]) -> str:
    """The mapping of a case: few candidates, so that it is cheap."""
    from cosim.diagnosis.model.groups import MODELS as GROUPS

    rng = np.random.default_rng(case.seed + 1)
    effects = sorted({e.name for g in GROUPS[case.model] for e in g.effects()})
    kept = {str(n) for n in rng.choice(effects, CHEAP, replace=False)}
    lines = [f'model = "{case.model}"', "[time]", 'column = "time [s]"', 'unit = "s"']
    for header in list(values)[1:]:
        name, _, unit = header.partition(" [")
        lines += [f"[signals.{name}]", f'column = "{header}"', f'unit = "{unit[:-1]}"']
    lines += ["[diagnose]", f"exclude = {json.dumps([n for n in effects if n not in kept])}", "causes = 1"]
    if stands:
        lines += ["[compare.signals]", *(f'{n} = {{ variable = "{v}" }}' for n, v in stands.items())]
    return "\n".join(lines) + "\n"


def wrong(row: dict[str, Any]) -> object:
    """What must not be in a case's outcome: an internal error, or no report; nothing for nearly every case."""
    return row.get("error") or row.get("failed") or ("" if row.get("report", True) else "no report")


def stored(file: Path) -> list[dict[str, Any]]:
    """The outcomes of an earlier run; a line that was cut off is left out."""
    rows = []
    for line in file.read_text(encoding="utf-8").splitlines() if file.is_file() else ():
        try:
            rows.append(json.loads(line))
        except json.JSONDecodeError:
            continue
    return rows


def options_of(text: str | None, cases: int) -> argparse.ArgumentParser:
    """What such a benchmark is asked: how many cases, of which seed, by how many workers, and where its rows go."""
    parser = argparse.ArgumentParser(description=text, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=cases)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--rows", type=Path, help="JSON lines, one a case; what is there is not run again")
    parser.add_argument("--json", action="store_true")
    return parser


def counted(
    cases: Iterable[Case], run: Callable[[Case], dict[str, Any]], pool: Executor, options: argparse.Namespace
) -> int:
    """Run the cases and print what came of them; 1 if one ended in an internal error."""
    rows = stored(options.rows) if options.rows is not None else []
    done = {row["case"]["seed"] for row in rows}
    with pool:
        for future in as_completed([pool.submit(run, c) for c in cases if c.seed not in done]):
            row = future.result()
            rows.append(row)
            if options.rows is not None:
                with options.rows.open("a", encoding="utf-8") as file:
                    file.write("\n" + json.dumps(row))
            if bad := wrong(row):
                print(json.dumps(row["case"]), bad, file=sys.stderr, flush=True)
    counts = Counter("error" if "error" in r else r.get("verdict", "refused") for r in rows)
    errors = [row for row in rows if wrong(row)]
    if options.json:
        print(json.dumps({"counts": counts, "internal": len(errors), "errors": errors}))
    else:
        print(
            ", ".join(f"{n} {k}" for k, n in counts.most_common()), f"; {len(errors)} with an internal error"
        )
    return 1 if errors else 0


def main() -> int:
    """Run the cases and count what came of them; 1 if one ended in an internal error."""
    options = options_of(__doc__, 500).parse_args()
    pool = ProcessPoolExecutor(options.workers)
    return counted(drawn(options.cases, options.seed), run_case, pool, options)


if __name__ == "__main__":
    sys.exit(main())
