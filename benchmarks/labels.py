"""Whether wrong labels are told, and right ones left alone: ``python benchmarks/labels.py --wrong 200 --right 300``.

Wrong: a fresh synthetic log, clean or with a fault, in which one label is false (unit, percent, sign, exchanged columns, a
signal that never moves, the clock, a wrapped angle). Right: logs of the blind suite of every kind. Nothing is run beyond the
check of the labels.
"""

import argparse
import json
import sys
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from scipy.stats import binomtest

from benchmarks.blind.cases import cases
from cosim.diagnosis.labels import Contradiction
from cosim.diagnosis.model.machine import our_machine
from cosim.diagnosis.pipeline.diagnose import labelled
from cosim.diagnosis.thresholds import NOMINAL_TRUST
from cosim.logs import Log
from cosim.rig import make_log
from cosim.rig.write import as_log
from cosim.signals import SIGNALS
from cosim.units import factor

Wrong = Callable[[Log, np.random.Generator], Log]


def changed(log: Log, **signals: np.ndarray) -> Log:
    """The log with other signals."""
    return replace(log, signals=log.signals | signals)


def times(name: str, by: float) -> Wrong:
    """A signal, or both ports, larger by a factor."""
    names = ("p_a", "p_b") if name == "ports" else (name,)
    return lambda log, rng: changed(log, **{n: by * log.signals[n] for n in names})


def stuck(name: str) -> Wrong:
    """A signal that never moves."""
    return lambda log, rng: changed(log, **{name: np.full(len(log), log.signals[name][0])})


def exchanged(one: str, other: str) -> Wrong:
    """Two columns exchanged, the numbers as they stand in the file."""

    def made(log: Log, rng: np.random.Generator) -> Log:
        units = {n: factor(log.display[n], SIGNALS[n].si) for n in (one, other)}
        numbers = {n: log.signals[n] / units[n] for n in units}
        return changed(log, **{one: numbers[other] * units[one], other: numbers[one] * units[other]})

    return made


def clocked(by: float) -> Wrong:
    """A clock that counts in another unit."""
    return lambda log, rng: replace(log, time=by * log.time)


def wrapped(log: Log, rng: np.random.Generator) -> Log:
    """An angle that turns on and on, read within a turn."""
    turned = log.signals["slew"] + 2.0 * np.pi * 3.0 * np.arange(len(log)) / len(log)
    return changed(log, slew=np.mod(turned, 2.0 * np.pi))


def saturating(name: str) -> Wrong:
    """A reading that ends at two thirds of its reach on either side."""

    def made(log: Log, rng: np.random.Generator) -> Log:
        values = log.signals[name]
        middle, reach = float(np.mean(values)), float(np.max(np.abs(values - np.mean(values))))
        return changed(log, **{name: np.clip(values, middle - 0.66 * reach, middle + 0.66 * reach)})

    return made


def of_another(log: Log, rng: np.random.Generator) -> Log:
    """A machine whose spool travels further, whose pressures are lower and which turns faster, or the other way round."""
    by = rng.uniform(4.0, 8.0, 3)
    way = rng.choice([1.0, -1.0])
    spool, pressure, slew = by[0] ** way, by[1] ** -way, by[2] ** way
    ports = {n: pressure * log.signals[n] for n in ("p_a", "p_b", "p_supply") if n in log.signals}
    own = {"spool": spool * log.signals["spool"], "slew": slew * log.signals["slew"]}
    return changed(log, **ports, **own)


# mistake -> how it is made, and the signal that must be named
MISTAKES: dict[str, tuple[Wrong, set[str]]] = {
    "deg labelled rad": (times("slew", 180.0 / np.pi), {"slew"}),
    "rad labelled deg": (times("slew", np.pi / 180.0), {"slew"}),
    "psi labelled bar": (times("ports", 14.5038), {"p_a"}),
    "bar labelled psi": (times("ports", 1.0 / 14.5038), {"p_a"}),
    "Pa labelled bar": (times("ports", 1e5), {"p_a"}),
    "mm labelled m": (times("spool", 1e3), {"spool"}),
    "percent labelled 1": (times("u", 100.0), {"u"}),
    "1 labelled percent": (times("u", 0.01), {"u"}),
    "u reversed": (times("u", -1.0), {"u"}),
    "spool reversed": (times("spool", -1.0), {"spool"}),
    "slew reversed": (times("slew", -1.0), {"slew"}),
    "ports exchanged": (exchanged("p_a", "p_b"), {"p_a"}),
    "port and supply exchanged": (exchanged("p_a", "p_supply"), {"p_a"}),
    "spool and slew exchanged": (exchanged("spool", "slew"), {"spool"}),
    "u and spool exchanged": (exchanged("u", "spool"), {"u"}),
    "port and slew exchanged": (exchanged("p_a", "slew"), {"p_a"}),
    "slew never moves": (stuck("slew"), {"slew"}),
    "spool never moves": (stuck("spool"), {"spool"}),
    "port never moves": (stuck("p_b"), {"p_b"}),
    "ms labelled s": (clocked(1e3), {"time"}),
    "s labelled ms": (clocked(1e-3), {"time"}),
    "wrapped": (wrapped, {"slew"}),
    "spool saturates": (saturating("spool"), {"spool"}),
    "port saturates": (saturating("p_a"), {"p_a"}),
    "another machine": (of_another, {"all"}),
}


def said(log: Log, model: str = "full_order") -> list[Contradiction]:
    """What is said of a log's labels."""
    return labelled(log, our_machine(model), NOMINAL_TRUST)[2]


def main() -> int:
    """Count both kinds and print them, the wrong answers one by one."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--wrong", type=int, default=200)
    parser.add_argument("--right", type=int, default=300)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--model", default="full_order")
    parser.add_argument("--duration", type=float, default=30.0, help="of each log, s")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    listed = cases(10**9, options.seed, options.duration)
    rng = np.random.default_rng(options.seed)
    counts: Counter[str] = Counter()
    for k in range(options.wrong):
        name = list(MISTAKES)[k % len(MISTAKES)]
        make, signals = MISTAKES[name]
        told = said(make(as_log(make_log(**next(listed).recipe())), rng), options.model)
        right = bool(told) and {t.signal for t in told} <= signals
        counts["wrong labels told"] += right
        if not right:
            print(f"{name}: {[t.finding for t in told]}", file=sys.stderr)
    for _ in range(options.right):
        case = next(listed)
        told = said(as_log(make_log(**case.recipe())), options.model)
        counts["right labels left alone"] += not told
        if told:
            print(
                f"{case.kind} {case.size} {list(case.hidden)}: {[t.finding for t in told]}", file=sys.stderr
            )
    rows = {}
    for name, count in (("wrong labels told", options.wrong), ("right labels left alone", options.right)):
        if count:
            low, high = binomtest(counts[name], count).proportion_ci(0.95, "wilson")
            rows[name] = {"hits": counts[name], "of": count, "low": float(low), "high": float(high)}
    if options.json:
        print(json.dumps(rows))
    else:
        for name, row in rows.items():
            print(f"{name}: {row['hits']} of {row['of']} ({row['low']:.1%} .. {row['high']:.1%})")
    return 0


if __name__ == "__main__":
    sys.exit(main())
