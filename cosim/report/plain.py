"""The report's first screen for people who run the machine: three sentences, what to check, the chain of blocks."""

import re
import tomllib
from dataclasses import dataclass
from pathlib import Path

from cosim.diagnosis.answer.schema import Answer
from cosim.lexicon import current
from cosim.report.material import Material, Part
from cosim.report.names import kind_of_motion
from cosim.report.screen import better
from cosim.report.words import (
    NOISY,
    block_name,
    called,
    listed,
    phrase,
    sentence,
    signal_name,
)

_ADVICE = tomllib.loads((Path(__file__).parent / "advice.toml").read_text(encoding="utf-8"))
ADVICE: dict[str, list[str]] = _ADVICE["effects"]  # effect -> what to check on the machine
MOTOR: dict[str, list[str]] = _ADVICE["motor"]  # the same where a motor drives it
# the same where it is not the crane, whose parts have other names
OF_OTHERS: dict[str, list[str]] = _ADVICE["other_machines"]
_VERDICTS: dict[str, list[str]] = _ADVICE["verdict"]
_NAME = re.compile(r" \((?:[a-z_]+\.)+[a-z_]+\)")  # an identifier behind the name that people know


@dataclass(frozen=True)
class Link:
    """A block in the chain.

    Attributes:
        block: name that people know.
        drive: the signals that drive it, and that it makes; empty where it was not judged.
        makes: see `drive`.
        share: of the error that is systematic, 0 to 1; None where it was not judged.
        within: nothing beyond noise is left.
        target: where on the page its evidence is, or empty.
    """

    block: str
    drive: str
    makes: str
    share: float | None
    within: bool
    target: str


def three_sentences(material: Material) -> list[tuple[str, str]]:
    """(question, answer): what is wrong, how sure that is, what it is worth to know it."""
    answer = material.answer
    if not answer.causes or answer.verdict == "interrupted":
        return [("Finding", sentence(material))]
    wrong = [phrase(cause, material) for cause in answer.causes]
    names = listed([called(c.effect) for c in answer.causes])
    if len(wrong) == 1:
        found = f"The simulation gets {wrong[0][0]} wrong: {wrong[0][1]}."
    else:
        found = f"The machine shows {len(wrong)} things that the model does not have: {names}."
    if answer.verdict == "partly_explained":
        left = listed(sorted({block_name(r.block) for r in answer.unexplained}) or ["model"])
        found += f" Something else in the {left} stays unexplained."
    told = [("What is wrong", kind_of_motion(found)), ("How sure", _sure(answer))]
    gain = next((plain(text) for text in better(answer)), "")
    return [*told, ("What it explains", gain)] if gain else told


def _sure(answer: Answer) -> str:
    """Whether another explanation is left, in a sentence."""
    named = {cause.effect for cause in answer.causes}
    told = []
    for cause in answer.causes:
        alike = sorted(called(o) for o in cause.indistinguishable_from if o not in named)
        if alike:
            it = "it" if len(answer.causes) == 1 else called(cause.effect)
            told.append(f"This log cannot tell {it} from {listed(alike)}")
    if told:
        end = "; the run proposed below would" if answer.next_experiment is not None else ""
        return " ".join(f"{text}." for text in [*told[:-1], f"{told[-1]}{end}"])
    as_well = sorted({called(r.effect) for r in answer.refused if r.instead in named})
    if as_well:
        return (
            f"Explanations that fit the log as well predict data that were left out worse: {listed(as_well)}."
        )
    if any(cause.rivals for cause in answer.causes):
        return "Every other explanation that was tried fits the log clearly worse."
    return "No other effect of the library comes near."


def plain(line: str) -> str:
    """A line of the screen without its label and identifiers, as a sentence."""
    text = _NAME.sub("", line.partition(": ")[2])
    return f"{text[0].upper()}{text[1:].rstrip('.')}."


def advice(answer: Answer) -> list[tuple[str, list[str]]]:
    """(name of a cause or of what it cannot be told from, what to check), the likeliest first."""
    if answer.data:
        return [("The log", _VERDICTS["implausible_data"])]
    if answer.verdict == "adequate":
        return [("The machine", _VERDICTS["adequate"])]
    names = [cause.effect for cause in answer.causes]
    # of any system an effect has its place behind it
    names += [other.partition(" at ")[0] for cause in answer.causes for other in cause.indistinguishable_from]
    known = ADVICE | OF_OTHERS if current().blocks else ADVICE
    if current().electric:
        known = known | MOTOR
    found = [
        (_title(name), [kind_of_motion(text) for text in known[name]])
        for name in dict.fromkeys(names)
        if name in known
    ]
    if found:
        return found
    return [("The machine", _VERDICTS["other" if answer.next_experiment is None else "other_with_run"])]


def _title(effect: str) -> str:
    name = called(effect)
    return f"{name[0].upper()}{name[1:]}"


def chain(material: Material) -> list[Link]:
    """The blocks in the order in which the command passes them, then those that were not judged."""
    return [_link(material, part) for part in ordered(list(material.parts.values()))] + [
        Link(block_name(name), "", "", None, False, "") for name in material.answer.not_judged
    ]


def ordered(parts: list[Part]) -> list[Part]:
    """Parts, each behind the one that makes what drives it; where they form a loop, as they came."""
    left, found = list(parts), list[Part]()
    while left:
        made = {signal for part in left for signal in part.noise}
        free = [part for part in left if part.drive not in made - set(part.noise)] or left[:1]
        found += free
        left = [part for part in left if part not in free]
    return found


def _link(material: Material, part: Part) -> Link:
    rows = [row for row in material.answer.localisation if row.block == part.name]
    causes = [k for k, cause in enumerate(material.answer.causes, 1) if cause.block == part.name]
    target = f"cause-{causes[0]}" if causes else f"residual-{part.name}-{next(iter(part.noise), '')}"
    return Link(
        block_name(part.name),
        signal_name(part.drive),
        listed([signal_name(signal) for signal in part.noise]) if part.noise else "",
        sum(row.share for row in rows),
        all(row.residual_rms <= NOISY * row.noise_floor for row in rows),
        target,
    )


def quiet_signals(answer: Answer) -> set[str]:
    """Signals whose error is no more than their noise: they stay folded, all but the motion where all are."""
    quiet = [name for name, s in answer.signals.items() if s.rmse <= NOISY * s.noise_floor]
    if len(quiet) == len(answer.signals):
        shown = "slew" if "slew" in quiet else quiet[-1] if quiet else ""
        quiet = [name for name in quiet if name != shown]
    return set(quiet)


def quiet_blocks(answer: Answer) -> set[tuple[str, str]]:
    """(block, signal) whose residual is no more than its noise."""
    return {(r.block, r.signal) for r in answer.localisation if r.residual_rms <= NOISY * r.noise_floor}
