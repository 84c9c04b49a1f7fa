"""Several structures side by side, as the rows of Tables 4.2 to 4.4, and the choice among them.

The choice is not by fit, which never falls with more poles. A candidate needs the lowest BIC (Schwarz, 1978) on the fitting
part, counted over the independent samples that its residual is worth; and where a simpler one predicts the held-out part
as well, the simpler one is taken.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cosim.errors import CosimError, DataError
from cosim.identify.data import Record
from cosim.identify.spectrum import effective_samples
from cosim.identify.transfer_function import Structure, TransferFunction, fit_records, held_out_fit

HELD_OUT = 0.3  # of each log, its end
AS_GOOD = 0.05  # points of best fit % by which a simpler candidate may predict worse
NEAR = 6.0  # of BIC: strong evidence (Kass and Raftery, 1995)


@dataclass(frozen=True)
class Candidate:
    """One row of the table.

    Attributes:
        name: TF1, TF2, ...
        structure: poles, zeros, integrators, delay.
        model: fitted to the whole of the logs.
        best_fit: % over all of them, by that model.
        fitting: % on the fitting part, by a model of that part alone.
        held_out: % on the part that this one did not see.
        bic: on the fitting part; smaller is better.
        determined: no pole's interval is as wide as the pole.
    """

    name: str
    structure: Structure
    model: TransferFunction
    best_fit: float
    fitting: float
    held_out: float
    bic: float
    determined: bool


@dataclass(frozen=True)
class Choice:
    """The candidates, the chosen one and why."""

    candidates: list[Candidate]
    chosen: Candidate
    why: str
    failed: dict[str, str]


def divided(records: Sequence[Record], share: float = HELD_OUT) -> tuple[list[Record], list[Record]]:
    """The first part of each record for fitting, the rest held out."""
    cuts = [round(r.input.size * (1.0 - share)) for r in records]
    fitting = [r.part(0, cut) for r, cut in zip(records, cuts, strict=True)]
    return fitting, [r.part(cut, r.input.size) for r, cut in zip(records, cuts, strict=True)]


def compare_structures(
    records: Sequence[Record], structures: Sequence[Structure], *, highest: float = 40.0
) -> Choice:
    """Fit every structure and choose one.

    Args:
        records: all logs.
        structures: the candidates.
        highest: frequency [Hz] beyond which nothing is used.

    Raises:
        DataError: none of them can be fitted, or none is determined by the data.
    """
    fitting, unseen = divided(records)
    done: list[tuple[str, Structure, TransferFunction, TransferFunction]] = []
    failed: dict[str, str] = {}
    named = [(f"TF{k}", structure) for k, structure in enumerate(structures, 1)]
    for name, structure in sorted(named, key=lambda item: item[1].size):
        try:
            part = fit_records(fitting, structure, highest=highest, simpler=[row[2] for row in done])
            whole = fit_records(records, structure, highest=highest, start=part.fit.theta)
            done.append((name, structure, part, whole))
        except (CosimError, np.linalg.LinAlgError, ValueError) as error:
            failed[f"{name} ({structure})"] = str(error)
    if not done:
        raise DataError(next(iter(failed.values())))
    done.sort(key=lambda row: [name for name, _ in named].index(row[0]))
    worth = _worth([part for _, _, part, _ in done])
    rows = [
        Candidate(
            name,
            structure,
            whole,
            whole.best_fit,
            part.best_fit,
            held_out_fit(part, unseen),
            bic(part, worth),
            whole.determined,
        )
        for name, structure, part, whole in done
    ]
    chosen, why = choose(rows)
    return Choice(rows, chosen, why, failed)


def choose(rows: Sequence[Candidate]) -> tuple[Candidate, str]:
    """The candidate to use, and a sentence that says why.

    Raises:
        DataError: the data determine none of them.
    """
    usable = [row for row in rows if row.determined]
    if not usable:
        rows[0].model.check_known()
    best = min(usable, key=lambda row: row.bic)
    top = max(row.held_out for row in usable)
    simpler = sorted(
        (r for r in usable if r.structure.size < best.structure.size), key=lambda r: r.structure.size
    )
    for row in simpler:
        if row.held_out >= top - AS_GOOD:
            return (
                row,
                f"predicts the held-out part as well as any with the fewest free numbers ({row.structure.size})",
            )
    if best.held_out < top - AS_GOOD:
        top_row = max(usable, key=lambda row: row.held_out)
        if top_row.bic <= best.bic + NEAR:
            return top_row, "predicts the held-out part best, with a BIC as good as the lowest"
    return (
        best,
        "lowest BIC over the independent samples, and no simpler one predicts the held-out part as well",
    )


def _worth(models: Sequence[TransferFunction]) -> float:
    """Independent samples of the residual of the one that explains most: one count for all, so that their BIC compare."""
    best = max(models, key=lambda m: m.best_fit)
    residuals = [e[r.keep] for e, r in zip(best.fit.residuals, best.records, strict=True)]
    return float(sum(effective_samples(e) for e in residuals))


def bic(model: TransferFunction, worth: float) -> float:
    """``n ln(mean square residual) + k ln n`` over n independent samples and k free numbers."""
    residual = np.concatenate([e[r.keep] for e, r in zip(model.fit.residuals, model.records, strict=True)])
    spread = max(float(np.mean(residual**2)), np.finfo(float).tiny)
    return float(worth * np.log(spread) + model.structure.size * np.log(max(worth, 2.0)))
