"""The report of a diagnosis of any system: one HTML file, in the look of the drive's."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from cosim.anysystem.answer import column_scale, driver_unit, entry_of, judged_signals, unit_at
from cosim.anysystem.extend import loop_of
from cosim.anysystem.model import place as placed
from cosim.anysystem.pipeline import AnyDiagnosis
from cosim.anysystem.search import errors, extended
from cosim.diagnosis.answer.schema import Answer, Unexplained
from cosim.errors import MissingExtraError
from cosim.files import write_text
from cosim.plots import thinned
from cosim.report.page import REPORT, alone, interval, need_extra, render, versions
from cosim.report.picture import Layer, Panel, Picture
from cosim.report.plain import Link, advice, plain
from cosim.report.screen import better, in_words, place, wrong
from cosim.report.words import CAPTIONS, axis

MOST_SIGNALS = 3  # that are written beside a part

TEXTS = {
    "parameter": "A parameter of the model has another value.",
    "port.gain": "The signal is multiplied by a factor.",
    "port.offset": "Something constant is added to the signal.",
    "port.delay": "The signal comes late.",
    "port.lag": "The signal follows as a first-order lag.",
    "port.saturation": "The signal stops at limits.",
    "port.dead_zone": "The signal is zero between two limits, and smaller by them beyond.",
    "port.play": "The signal follows with play: half its width to either side.",
    "port.rate_limit": "The signal moves no faster than a limit.",
    "port.quantisation": "The reading comes in steps.",
    "port.dropout": "Samples of the reading are stale.",
    "port.drift": "The reading drifts.",
    "port.friction": "Dry friction takes its level off the signal, against the motion.",
}


def write_page(found: AnyDiagnosis, answer: Answer, folder: Path) -> Path | None:
    """Write `report.html`; None where the extra that draws it is missing.

    Args:
        found: the diagnosis.
        answer: the same in the contract's form.
        folder: where it goes.
    """
    try:
        need_extra()
    except MissingExtraError:
        return None
    pictures = [picture(found, k) for k in range(len(found.segments))]
    lost = [lacking(found, rest, k) for k, rest in enumerate(answer.unexplained)]
    drawn = [p for p in pictures if p.panels]
    first = found.segments[0]
    sections: dict[str, Any] = {
        "answer": answer,
        "foreign": True,
        "not_exercised": answer.not_exercised,
        "helpful_signals": answer.helpful_signals,
        "clean": False,
        "log_name": ", ".join(log.source.name for log in found.logs),
        "told": [
            ("Finding", " ".join(f"{line.rstrip('.')}." for line in wrong(answer)) or "Nothing is wrong."),
            *(("What it explains", plain(line)) for line in better(answer)),
        ],
        "advice": advice(answer),
        "chain": chain(found, answer),
        "doubts": [
            f"This log cannot tell {place(c)} from {' or '.join(in_words(other) for other in c.indistinguishable_from)}."
            for c in answer.causes
            if c.indistinguishable_from
        ],
        "duration": f"{sum(s.count * s.h for s in found.segments):.4g}",
        "rate": f"{1.0 / np.median(np.diff(found.logs[0].time)):.4g}",
        "signals": drawn,
        "quiet_signals": [],
        "quiet_signal_names": "",
        "quiet_residual_names": "",
        "nominal": [(name, *interval(p)) for name, p in answer.nominal.items()],
        "calibrated": alone(answer),
        "drive": [],
        "drive_rows": [],
        "shares": [],
        "residuals": [],
        "quiet_residuals": [],
        "causes": [
            {
                "cause": cause,
                "title": place(cause),
                "how": f"it sits at {cause.component}.{cause.connector}"
                + (f" ({cause.where})" if cause.where else "")
                + (f", against the motion of {loop.moved}" if (loop := loop_of(found, *where)) else ""),
                "text": TEXTS.get(cause.effect, ""),
                "looks": "",
                "source": "",
                "parameters": [(n, "", p, interval(p)) for n, p in cause.parameters.items()],
                "pictures": [],
                "toggle": "",
            }
            for where, cause in zip(found.causes(), answer.causes, strict=True)
        ],
        "rests": [{"rest": rest, "pictures": p} for rest, p in zip(answer.unexplained, lost, strict=True)],
        "command": [],
        "files": [(log.source.name, "", log.sha256) for log in found.logs],
        "versions": {k: v for k, v in answer.made.items() if not k.endswith((".csv", ".toml"))},
        "page_versions": versions(),
        "gains": answer.gain,
        "plain": {} if answer.gain else answer.signals,
        "seed": "",
        "window": f"{first.count * first.h / 30.0:.3g}",
        "windows": int(np.unique(np.concatenate([s.windows[~s.fitted] for s in found.segments])).size),
    }
    file = folder / REPORT
    write_text(file, render(sections, [*drawn, *(p for own in lost for p in own)]))
    return file


def lacking(found: AnyDiagnosis, rest: Unexplained, k: int) -> list[Picture]:
    """The function of one signal that would explain what is left, where there is one."""
    lost = rest.missing
    if lost is None or lost.depends_on is None:
        return []
    x, y = np.array(lost.points, dtype=np.float64).T
    entry, of = entry_of(lost.enters_at[0]), lost.depends_on
    layers = [Layer("line", "piecewise linear, at quantiles of the data", "plain", x, y)]
    return [
        Picture(
            f"rest-{k}-0",
            f"What is missing at {entry.port} against {of}",
            axis(of, driver_unit(found, of)[0]),
            [Panel(axis(f"missing at {entry.port}", unit_at(found, entry)[0]), layers)],
            CAPTIONS["free_form"].partition(". ")[0].format(driver=of) + ".",
        )
    ]


def chain(found: AnyDiagnosis, answer: Answer) -> list[Link]:
    """The parts of a system in the order of its signals, with what drives each and its share of the error.

    Nothing of a system that is judged as one part.
    """
    groups = [g for g in found.groups if g.name in found.findings or g.name in answer.not_judged]
    if len(groups) < 2:
        return []
    links = []
    for group in groups:
        drives, makes = some(d.signal for d in group.drives), some(signal for signal, _ in group.judged)
        finding = found.findings.get(group.name)
        if finding is None:
            links.append(Link(group.name, drives, makes, None, False, ""))
            continue
        share = sum(r.share for r in answer.localisation if {*r.block.split("+")} <= {*group.components})
        own = [k for k, (name, _) in enumerate(found.causes(), 1) if name == group.name]
        target = f"cause-{own[0]}" if own else "rest" if finding.unexplained else "signals"
        within = not (finding.named or finding.unexplained)
        links.append(Link(group.name, drives, makes, share, within, target))
    return links


def some(signals: Iterable[str]) -> str:
    """The first of some signals, each once."""
    names = list(dict.fromkeys(signals))
    more = len(names) - MOST_SIGNALS
    return ", ".join(names[:MOST_SIGNALS]) + (f" and {more} more" if more > 0 else "")


def picture(found: AnyDiagnosis, k: int) -> Picture:
    """One log: each judged signal as measured and as the model has it, without and with the causes."""
    segment = found.segments[k]
    time = segment.start + segment.h * np.arange(segment.count, dtype=np.float64)
    panels = []
    for finding, connector in judged_signals(found):
        model = finding.model
        own = next((i for i in model.judging(connector) if model.segments[i].number == k), None)
        if own is None:
            continue
        segment, name = model.segments[own], placed(connector, own)
        unit, factor, offset = column_scale(found, connector)
        measured = np.where(segment.known(connector), (segment.signals[connector] - offset) / factor, np.nan)
        layers = [Layer("line", "measured", "measured", *thinned(time, measured))]
        before = errors(finding, finding.null.fit.values)[name] / factor
        layers.append(Layer("line", "model", "nominal", *thinned(time, measured - before)))
        if finding.named:
            after = errors(finding, extended(finding, finding.chosen))[name] / factor
            layers.append(Layer("line", "with the causes", "extended", *thinned(time, measured - after)))
        panels.append(Panel(f"{connector} [{unit}]", layers))
    held = np.flatnonzero(np.diff(np.concatenate([[0], (~segment.fitted).astype(int), [0]])))
    spans = [(float(time[a]), float(time[b - 1])) for a, b in zip(held[::2], held[1::2], strict=True)]
    return Picture(
        f"signals-{k}",
        f"Measured and simulated, {found.logs[k].source.name}",
        "time [s]",
        panels,
        "Each part is driven by what was measured at its inputs. Shaded: held out from fitting.",
        shaded=spans,
    )
