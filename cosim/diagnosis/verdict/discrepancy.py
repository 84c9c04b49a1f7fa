"""How far the law of a named cause may be off, and what the blocks behind make of it.

A real hysteresis is no single play and a real leak no laminar one. What is left of the cause in its own signal may be lost
in the noise there, and yet stand out where it is integrated: friction of a few N m was named for it. So what a block
delivers is corrected by what free functions find in its residual, as far as they can be trusted; their rest is discrepancy.
"""

import numpy as np
from numpy.typing import NDArray

from cosim.compare.metrics import rms
from cosim.diagnosis.fitting.chain import Known, in_any_form
from cosim.diagnosis.record.record import Record
from cosim.diagnosis.residuals.finding import Finding, bases_of
from cosim.diagnosis.thresholds import LAW_KNOWN_TO
from cosim.diagnosis.verdict.upstream import alternatives

Array = NDArray[np.float64]

LEAST_DIRECTION = 1e-3  # of the largest: what a direction of the discrepancy must move to count


def understood(finding: Finding, record: Record, tolerance: float) -> Known:
    """A group as it is handed on to the one behind it."""
    task, chosen = finding.task, finding.chosen
    lacking, discrepancies = discrepancy_of_law(finding, record)
    return Known(
        task.model,
        in_any_form(task, chosen, tolerance),
        chosen.effects,
        chosen.price,
        alternatives(finding),
        lacking,
        discrepancies,
    )


def discrepancy_of_law(finding: Finding, record: Record) -> tuple[Array | None, list[Array]]:
    """Correction (n,) of a group's first signal and its changes (n,) one deviation along each discrepancy of the laws.

    Ridge regression of the residual on all free functions, each within LAW_KNOWN_TO of what the causes explain.

    Args:
        finding: what was found in the group; nothing, or causes of laws that have one form only, leave no discrepancy.
        record: the log.
    """
    chosen, task = finding.chosen, finding.task
    if all(e.sole_form for e in chosen.effects):
        return None, []
    signal = task.model.group.observed[0]
    silent = {s: np.zeros_like(r) for s, r in chosen.fit.residuals.items()}
    bases = bases_of(task, record, chosen.fit)[signal]
    trusted = LAW_KNOWN_TO * finding.before[signal].rms  # the size that each has at most
    listed = (column for basis in bases for column in basis.columns())
    # single precision: there are dozens of them, as long as the log
    columns = np.array([(c * (trusted / size)).astype(np.float32) for c in listed if (size := rms(c)) > 0.0])
    if not columns.size:
        return None, []
    white = np.array([task.white(silent | {signal: column}) for column in columns])
    precision = white @ white.T + np.eye(len(columns))
    mean = np.linalg.solve(precision, white @ task.white(silent | {signal: chosen.fit.residuals[signal]}))
    # directions that move the signal most, each by one standard deviation
    root = np.linalg.inv(np.linalg.cholesky(precision)).T
    values, vectors = np.linalg.eigh(root.T @ (columns @ columns.T) @ root)
    kept = vectors[:, values > LEAST_DIRECTION**2 * values[-1]]
    return mean @ columns, list((root @ kept).T @ columns)
