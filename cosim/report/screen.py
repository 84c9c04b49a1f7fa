"""A diagnosis on the screen: the answer in a few lines of words with numbers, tables only where they are asked for."""

import re
from collections.abc import Iterator
from itertools import groupby
from operator import itemgetter
from pathlib import Path

from cosim.console import stdout_console, table, typed
from cosim.diagnosis.answer.schema import ITSELF, ONE_WAY, Answer, NamedCause, Parameter
from cosim.diagnosis.verdict import FREE_CURVE
from cosim.errors import CosimError
from cosim.lexicon import speaking
from cosim.report.drive import SLOPE, by_side
from cosim.report.folder import lexicon_of
from cosim.report.material import Material
from cosim.report.names import kind_of_motion
from cosim.report.words import (
    NAMES,
    Quantity,
    block_name,
    called,
    down_to_noise,
    few,
    in_own_words,
    limits_met,
    listed,
    nominal_of,
    odd_sentence,
    span_of,
    telling,
    the,
    two_digits,
    unit_text,
    with_signals,
    without_tracker,
    words_of,
)
from cosim.ssp.read import read_system

REPORT = "report.html"
MOST_FITTED = 6  # parameters in a line
MOST_NAMES = 3  # names in a line; the rest are counted
_WORD = re.compile(r"\b[a-z_]+\.[a-z_]+\b")


def known_as(effect: str) -> str:
    """An effect by the name people know, with its identifier: "dry friction (mechanical.coulomb_friction)"."""
    return f"{called(effect)} ({effect})" if effect in NAMES else effect


def in_words(text: str) -> str:
    """A sentence in which every identifier of an effect has its name before it, and signals go by their names."""
    return with_signals(_WORD.sub(lambda found: known_as(found[0]), text))


def show(result: Answer, out: Path, verbose: bool = False, driven: str = "") -> None:
    """Print the answer for people.

    Args:
        result: the diagnosis.
        out: its folder.
        verbose: the tables too, before the answer.
        driven: options of `cosim simulate` with which the log drives the extended model, a blank before each.
    """
    output = stdout_console()
    if verbose:
        with speaking(lexicon_of(result)):
            for found in tables(result):
                output.print(found)
    for line in lines(result, out, driven):
        output.print(line, markup=False, soft_wrap=True)


def lines(result: Answer, out: Path, driven: str = "") -> list[str]:
    """The answer, a line for each question: what is wrong, how sure, how much better, where the report is, what next."""
    with speaking(lexicon_of(result)):
        return _lines(result, out, driven)


def _lines(result: Answer, out: Path, driven: str) -> list[str]:
    kind = "synthetic log" if result.synthetic else "measured log"
    head = f"verdict: {result.verdict.replace('_', ' ')} ({kind}, model {result.model})"
    told = [
        head,
        *wrong(result),
        *fitted(result),
        *drive(result),
        *sure(result),
        *better(result),
        *not_judged(result),
    ]
    told += [f"Note: {with_signals(text)}" for text in result.advice]
    told = [head, *(kind_of_motion(line) for line in told[1:])]
    if (out / REPORT).is_file():
        told.append(f"Report: {out / REPORT}")
    else:
        told.append(f"Results: {out / 'diagnosis.json'}")
    told.append(f"Next: {next_step(result, out, driven)}")
    return told


def wrong(result: Answer) -> Iterator[str]:
    """What is wrong, a line for each cause and each rest."""
    for label in result.data:
        yield f"Wrong: the log contradicts its own labels: {label.finding}. {sentence(label.remedy)}"
    for cause in result.causes:
        yield f"Cause: {place(cause)}: {sizes(cause, result)}"
    for rest in result.unexplained:
        yield (
            f"Unexplained: {block_name(rest.block)}: {with_signals(rest.what)}; no effect of the library "
            f"explains it ({two_digits(rest.residual_rms)} {unit_text(rest.unit)})".replace(" )", ")")
        )
    for item in result.refused:
        asked = "; ".join(asked_for(name, number) for name, number in item.parameters.items())
        yield f"Refused: {in_words(item.effect)}{f' ({asked})' if asked else ''}: {in_words(item.why)}"
    if result.at_rest:
        yield "Nothing was exercised: the command asks for no motion and none is measured, so no effect is named or excluded"
    elif result.verdict == "adequate":
        judged = listed(list(dict.fromkeys(block_name(w.block) for w in result.localisation)) or ["model"])
        head = "Nothing was found in the time allowed" if hasty(result) else "Nothing is wrong"
        yield (
            f"{head}: in {judged}, what the simulation leaves is no more than noise and the tolerance of the "
            "nominal parameters allow"
        )
    if result.verdict == "interrupted":
        why = result.interrupted or "a block could not be judged"
        yield f"Interrupted ({why}): what is said here was found until then"


def asked_for(name: str, item: Parameter) -> str:
    """A number of a cause that was refused."""
    size = Quantity(item, item.instead_of)
    return f"{size} instead of {size.nominal}" if item.instead_of is not None else f"{name} = {size}"


def hasty(result: Answer) -> bool:
    """True if the time allowed was over before everything was tried."""
    return any("; not tried: " in text for text in result.warnings)


def place(cause: NamedCause) -> str:
    """A cause by name, and where it sits in a system of any FMUs."""
    if cause.parameter:
        return f"{called(cause.effect)}, {cause.component}.{cause.parameter}"
    name = known_as(cause.effect)
    if cause.component and cause.connector:
        where = f" ({cause.where})" if cause.where else ""
        return f"{name} at {cause.component}.{cause.connector}{where}"
    return name


def sizes(cause: NamedCause, result: Answer) -> str:
    """The numbers of a cause with their intervals, and the nominal value where one differs from nothing."""
    material = Material(result, 0.0, {}, {})
    several = len(cause.parameters) > 1 or cause.top_speed
    if several and not cause.component and (own := in_own_words(cause, material)):
        return f"{own[1]}; intervals of 95 %"
    found = []
    for name in limits_met(cause, material):
        nominal = nominal_of(cause, name, material)
        item = cause.parameters[name]
        size = Quantity(item, nominal if item.instead_of is None else item.instead_of)
        alone = len(cause.parameters) == 1 and (not cause.component or cause.parameter)
        label = "" if alone else f"{name} = "
        # where the report names the nominal value, it says something
        told = nominal is not None and f"{{{name}.nominal}}" in words_of(cause)[1]
        instead = f" instead of {size.nominal}" if told or item.instead_of is not None else ""
        found.append(f"{label}{size}, {size.interval}{instead}")
    return "; ".join(found) + " (95 %)"


def fitted(result: Answer) -> Iterator[str]:
    """What the log asks for of an FMU's parameters that were fitted or are trusted, and of which it tells nothing."""
    what = "Fitted" if result.calibrated else "Also in the extended model"
    own = {n: p for n, p in result.nominal.items() if p.instead_of is not None}
    still = [n for n, p in own.items() if p.instead_of is None or p.ci95[0] <= p.instead_of <= p.ci95[1]]
    sizes = {n: Quantity(p, p.instead_of) for n, p in own.items() if n not in still}
    told = [f"{n} {size} instead of {size.nominal}, {size.interval}" for n, size in sizes.items()]
    if told:
        yield f"{what}: {'; '.join(told[:MOST_FITTED])}{_more(told, MOST_FITTED)} (95 %)"
    if still and result.calibrated:
        names = f"{listed(still[:MOST_FITTED])}{_more(still, MOST_FITTED)}"
        yield f"Fitted too, but not told from what the model has: {names}"
    for signal, gain in result.calibrated.items():
        before, after = two_digits(gain.rmse_stated), two_digits(gain.rmse_fitted)
        changes = f"changes from {before} to {after}" if after != before else f"stays at {before}"
        if gain.ci95_of_ratio[1] < 1.0:
            changes = f"falls from {before} to {after}"
        unit = f" {unit_text(gain.unit)}".rstrip()
        yield f"Fitted numbers alone: error of {the(signal)} on data not used for fitting {changes}{unit}"


def drive(result: Answer) -> Iterator[str]:
    """What a person would read off the drive's static curve, which needs no model; nothing that may be none."""
    told = []
    for words, sides in groupby(by_side(Material(result, 0.0, {}, {}), sure=True), key=itemgetter(0)):
        numbers = [(value, ends, unit) for _, _, value, ends, unit, _ in sides]
        if words != SLOPE:
            sizes = " and ".join(f"{value} ({ends})" for value, ends, _ in numbers)
            told.append(f"{words} {sizes} {numbers[0][2]}".rstrip())
    if told and result.causes:
        yield f"Drive by itself, without a model: {'; '.join(told)} (95 %)"


def sure(result: Answer) -> Iterator[str]:
    """How sure each name is: what the log cannot tell it from, and the next best explanation."""
    for cause in result.causes:
        alike = cause.indistinguishable_from
        told = []
        if alike:
            told.append(
                f"this log cannot tell it from {listed([in_words(a) for a in alike[:MOST_NAMES]])}{_more(alike)}"
            )
        behind = next((r for r in cause.rivals if r.effect not in alike), None)
        if behind is not None:
            told.append(f"next best is {in_words(behind.effect)}, which {_clause(behind.why_not)}")
        if not told:
            told.append("no other effect of the library comes near")
        own = f"{cause.component}.{cause.parameter}" if cause.parameter else called(cause.effect)
        name = f" of {own}" if len(result.causes) > 1 else ""
        yield f"How sure{name}: {'; '.join(told)}"
    never = not_shown(result)
    if result.verdict == "adequate" and never and not result.at_rest:
        shown = listed([in_words(e) for e in never[:MOST_NAMES]])
        yield f"How sure: this log would not surely have shown {shown}{_more(never)}"


def not_shown(result: Answer) -> list[str]:
    """Effects that the log could not have shown; without a tracker nobody expects to hear of its faults."""
    return [effect for effect in result.not_exercised if not effect.startswith("tracker.")]


def _clause(why: str) -> str:
    """A reason as it goes behind "which"."""
    return why if why.startswith(("explains", "is ", "was ", "gains", "does ")) else f"is {why}"


def _more(names: list[str], most: int = MOST_NAMES) -> str:
    return f" and {len(names) - most} more" if len(names) > most else ""


def better(result: Answer) -> Iterator[str]:
    """How much the extended model gains on data not used for fitting, in the signal that gains most.

    Where nothing is named the error is said too: a linear model may leave less.
    """
    signal = telling(result)
    if signal is None or not (result.causes or result.verdict == "unexplained"):
        return
    gain = result.gain[signal]
    unit = f" {unit_text(gain.unit)}".rstrip()
    text = f"error of {the(signal)} on data not used for fitting{span_of(gain)} "
    before, after = two_digits(gain.rmse_before), two_digits(gain.rmse_after)
    falls = after != before and gain.rmse_after < gain.rmse_before
    text += f"falls from {before} to {after}{unit}" if falls else f"stays at {before}{unit}"
    noise = f"{two_digits(gain.noise_floor)}{unit}"
    near = down_to_noise(result, gain)
    text += f", the sensor's noise ({noise})" if near else f"; the sensor's noise is {noise}"
    if result.extended is not None and result.extended.in_place:
        text += "; a linear model stands in the place of the blocks, which lack its dynamics"
    elif signal in result.linear:
        linear = result.linear[signal]
        text += f"; a linear model leaves {two_digits(linear.rmse)}{unit}"
        curve = any(FREE_CURVE in rest.what for rest in result.unexplained)
        if result.verdict != "explained" and linear.ahead and not curve:
            text += ": linear dynamics are missing"
    yield f"{'Better' if falls else 'Not better'}: {text}"
    if sentence := odd_sentence(gain):
        yield sentence


def not_judged(result: Answer) -> Iterator[str]:
    """Blocks that could not be judged, in one line."""
    if result.not_judged:
        found = [f"{block_name(name)} ({why})" for name, why in result.not_judged.items()]
        yield f"Not judged: {'; '.join(found)}"


def next_step(result: Answer, out: Path, driven: str = "") -> str:
    """What to do next, as a sentence; `driven` as in `show`."""
    if result.data:
        return "correct the label (in the header or a mapping) and diagnose again"
    if result.verdict == "interrupted":
        return "run it again for the rest"
    if (result.unexplained or result.verdict == "adequate") and hasty(result):
        return "run it again with more time (--budget): not everything was tried"
    if any(ONE_WAY in note or ITSELF in note for note in result.advice):
        return "correct the mapping as noted, and diagnose again: what is named rests on it"
    proposed = result.next_experiment
    if proposed is not None:
        shape, length = (proposed.excitation.get(name, "") for name in ("shape", "duration_s"))
        what = f"{shape}, {length:.3g} s" if isinstance(length, float) else f"{shape}"
        told = f"{proposed.file} ({what})" if proposed.file else what
        return f"drive the machine with {told}: it {in_words(proposed.why)}"
    if result.verdict == "adequate":
        return "use the model as it is"
    if result.extended is not None and result.extended.in_place and not result.advice:
        return f"cosim simulate {typed(result.extended.ssp)}{driven} runs the linear model"
    if result.advice and not result.causes:
        return "correct the mapping or record again as noted, and diagnose again"
    if result.extended is not None and result.causes:
        return f"cosim simulate {typed(result.extended.ssp)}{driven} runs the extended model"
    helpful = further_signals(result)
    if helpful:
        return f"log more: {in_words(few(helpful[0], MOST_NAMES))}"
    return (
        f"look at what is left over in {out / REPORT}; a longer log, or one with more signals, may tell more"
    )


def further_signals(result: Answer) -> list[str]:
    """What further signals would show; of a machine that is not the crane nobody has a tracker."""
    lines = [without_tracker(text) if result.words.blocks else text for text in result.helpful_signals]
    return [line for line in lines if line]


def driven_by(result: Answer, log: Path, mapping: Path | None) -> str:
    """Options with which a log drives the extended model; none where it has no inputs, as one that holds its stimulus."""
    if result.extended is None or result.interrupted:
        return ""
    try:
        with read_system(Path(result.extended.ssp)) as system:
            if not system.inputs:
                return ""
    except CosimError:  # it was not written, which a warning says
        return ""
    return f" --input {typed(log)}" + (f" --mapping {typed(mapping)}" if mapping is not None else "")


def sentence(text: str) -> str:
    """A clause as a sentence of its own, without the full stop."""
    return text[:1].upper() + text[1:].rstrip(".")


def tables(result: Answer) -> Iterator[object]:
    """What lies behind the answer: errors of signals and blocks, rivals, what the signals can tell apart."""
    if result.localisation:
        yield table(
            "Blocks, each driven by what was measured",
            ["block", "signal", "share of error %", "residual", "noise", "unit"],
            [
                (x.block, x.signal, f"{100.0 * x.share:.0f}", x.residual_rms, x.noise_floor, x.unit)
                for x in result.localisation
            ],
        )
    if result.gain:
        yield table(
            f"Error on {result.held_out}, before and after",
            ["signal", "before", "after", "linear model", "noise", "unit"],
            [
                (
                    s,
                    f"{g.rmse_before:.4g}",
                    f"{g.rmse_after:.4g}",
                    f"{result.linear[s].rmse:.4g}" if s in result.linear else "",
                    f"{g.noise_floor:.4g}",
                    g.unit,
                )
                for s, g in result.gain.items()
            ],
        )
    rivals = [(c.effect, r.effect, r.why_not) for c in result.causes for r in c.rivals]
    if rivals:
        yield table("Other explanations", ["cause", "rival", "why not"], rivals)
    if result.isolability:
        yield table(
            "What each residual can show",
            ["residual", "effects"],
            [(", ".join(x.residual), ", ".join(x.effects)) for x in result.isolability],
        )
    if helpful := further_signals(result):
        yield table("Further signals", ["what they would add"], [(in_words(text),) for text in helpful])
    if never := not_shown(result):
        yield table("Not shown by this log", ["effect"], [(known_as(e),) for e in never])
