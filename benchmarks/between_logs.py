"""Do intervals between logs hold? ``python benchmarks/between_logs.py LOG LOG LOG --mapping M --effects NAME NAME``.

Each log is held out in turn: the parameters are fitted to the others together, and `next_ci95` says where the estimate
from another log of the machine lies. Then they are fitted to the log held out alone, and it is counted how often its
estimates lie there. Real refits on both sides, to the free run, as the diagnosis makes them of a machine with one block.
"""

import argparse
import sys
from collections.abc import Callable
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from rich.console import Console
from rich.table import Table
from threadpoolctl import threadpool_limits

from cosim.diagnosis.fitting.chain import task_for
from cosim.diagnosis.fitting.fit import Fit
from cosim.diagnosis.fitting.trials import tried
from cosim.diagnosis.held_out.between import Between, over_logs
from cosim.diagnosis.held_out.free_run import onward, refitted
from cosim.diagnosis.hypotheses.naming import nominal
from cosim.diagnosis.model.choice import machine_of
from cosim.diagnosis.model.groups import Group, merged
from cosim.diagnosis.pipeline.diagnose import prepare
from cosim.diagnosis.record.record import Record, each_left_out, joined
from cosim.diagnosis.residuals.cross_validation import repetitions
from cosim.diagnosis.residuals.finding import Finding, relearned
from cosim.diagnosis.thresholds import GUESSED_TRUST
from cosim.logs import load_log
from fmus.contract import Effect


def estimator(group: Group) -> Callable[..., Fit]:
    """How the diagnosis estimates in such a group."""
    return onward if group.drifts else refitted


def fitted(record: Record, group: Group, effects: tuple[Effect, ...]) -> tuple[Finding, Fit]:
    """Noise and parameters from a record, with these causes, the first ones first."""
    task = task_for(group, record, [])
    null = nominal(task, record, GUESSED_TRUST)
    chosen = null
    for count in range(len(effects)):  # one by one, as a search finds them
        chosen = tried(task, effects[: count + 1], GUESSED_TRUST, chosen.fit)
        if relearned(task, record, chosen.fit):
            chosen = tried(task, effects[: count + 1], GUESSED_TRUST, chosen.fit)
    finding = Finding(task, null, chosen, free=True)
    return finding, estimator(group)(finding, effects, GUESSED_TRUST, chosen.fit)


def between(record: Record, group: Group, effects: tuple[Effect, ...]) -> dict[str, Between]:
    """What the logs of a record say of the next one."""
    finding, best = fitted(record, group, effects)

    def off(name: str) -> float:
        return 0.0 if name in group.trusted else finding.task.model.nominal(name)

    return over_logs(best, repetitions(finding.task, group.drifts), off)


def main() -> None:
    """Hold each log out in turn."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("logs", type=Path, nargs="+")
    parser.add_argument("--mapping", type=Path, required=True)
    parser.add_argument("--effects", nargs="+", required=True)
    asked = parser.parse_args()
    logs = [load_log(file, asked.mapping) for file in asked.logs]
    machine = machine_of(None, logs[0], asked.mapping)
    record = joined([prepare(log, machine) for log in logs])
    (group,) = merged(machine.groups, record.signals)
    known = {e.name: e for e in group.effects()}
    effects = tuple(known[name] for name in asked.effects)
    table = Table("held out", "parameter", "its own, SI", "from the others, 95 % of the next log", "holds")
    inside = total = 0
    with threadpool_limits(1):
        for log, (others, held) in zip(logs, each_left_out(record), strict=True):
            told = between(others, group, effects)
            own = fitted(held, group, effects)[1]
            for name, item in told.items():
                low, high = item.next_ci95
                holds = low <= own.values[name] <= high
                inside, total = inside + holds, total + 1
                table.add_row(
                    log.name,
                    name,
                    f"{own.values[name]:.4g} +- {1.96 * own.deviations.get(name, 0.0):.2g}",
                    f"{item.value:.4g} ({low:.4g} to {high:.4g})",
                    "yes" if holds else "no",
                )
    Console(width=140).print(table)
    print(f"{inside} of {total} estimates from a log held out lie where the others say")


if __name__ == "__main__":
    main()
