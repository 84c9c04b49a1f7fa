"""What a person would say: numbers with units, names of effects, and the verdict in a sentence."""

import math
import re
import tomllib
from pathlib import Path
from string import Formatter

import numpy as np

from cosim.diagnosis.answer.schema import Answer, LogGain, NamedCause, Parameter, SignalGain
from cosim.errors import UsageError
from cosim.lexicon import current
from cosim.machines.table import FULL_COMMAND
from cosim.report.material import Material, component_of
from cosim.report.names import (
    BLOCK_NAMES,
    ONE_RATE_ON,
    QUANTITIES,
    SIGNAL_NAMES,
    kind_of_motion,
)
from cosim.units import is_speed
from fmus import registry

NOISY = 1.1  # times the sensor's noise within which an error is called the noise
FEW_LOGS = 3  # held out, from which on one of them may be odd
ODD = 3.0  # times the error in the others, from which on a log is

_PHRASES = tomllib.loads((Path(__file__).parent / "phrases.toml").read_text(encoding="utf-8"))
PHRASES: dict[str, list[str]] = _PHRASES["effects"]  # effect -> what the simulation gets wrong, and how
PHYSICAL: dict[str, list[str]] = _PHRASES[
    "physical"
]  # the same, of parameters that only the physical hydraulics have
SPEEDS: dict[str, list[str]] = _PHRASES[
    "speeds"
]  # the same by the drive's top speeds, where the spool is not known
NAMES: dict[str, str] = _PHRASES["names"]  # effect -> what people call it
FORMS: dict[str, str] = _PHRASES["forms"]  # parameter of another form of a law -> what it adds to that
CAPTIONS: dict[str, str] = _PHRASES["captions"]


def unit_text(unit: str) -> str:
    """A unit as people write it: ``kg.m2`` becomes ``kg m²``; nothing for ``1``."""
    if unit in ("1", ""):
        return ""
    text = unit.replace(".", " ")
    for digit, raised in (("2", "²"), ("3", "³")):
        text = text.replace(digit, raised)
    return text


def axis(name: str, unit: str) -> str:
    """Label of an axis: name and unit."""
    return f"{kind_of_motion(name)} [{unit_text(unit) or '1'}]"


def number(value: float, spread: float = 0.0) -> str:
    """A number to the digits that its spread leaves, or with four significant ones without a spread.

    The spread keeps two digits below 3.55 and one above, as the Particle Data Group rounds.
    """
    if not math.isfinite(value):
        return "unknown"
    if abs(value) >= 1e6 or (0.0 < abs(value) < 1e-4 and not spread >= 1e-4):
        return f"{value:.4g}"
    if not (spread > 0.0 and math.isfinite(spread)):
        return f"{value:.4g}" if abs(value) < 1e4 else f"{float(f'{value:.4g}'):.0f}"
    power = math.floor(math.log10(spread))
    decimals = min(max((1 if spread < 3.55 * 10.0**power else 0) - power, 0), 6)
    text = f"{value:.{decimals}f}"
    return text if float(text) else text.removeprefix("-")


NOT_MET = "none that the log meets"
SMALL = 0.1  # m or m/s, below which a length or a speed is shown in mm


def readable(parameter: Parameter) -> tuple[str, float]:
    """The unit in which people read a parameter, and the factor to it: small lengths in mm, parts in per cent."""
    if parameter.unit == FULL_COMMAND:
        return f"% of {FULL_COMMAND}", 100.0
    if parameter.unit in ("m", "m/s") and abs(parameter.value) < SMALL:
        return f"m{parameter.unit}", 1000.0
    return parameter.unit, 1.0


class Quantity:
    """One estimate as a phrase prints it; `unit` is that of its numbers."""

    def __init__(self, parameter: Parameter, nominal: float | None) -> None:
        self.unit, self._scale = readable(parameter)
        self._value = parameter.value * self._scale
        self._low, self._high = (end * self._scale for end in parameter.ci95)
        self._spread = 0.5 * (self._high - self._low)
        self._nominal = nominal

    def __str__(self) -> str:
        return self._with_unit(self.value)

    def __format__(self, spec: str) -> str:
        return str(self)

    def _with_unit(self, text: str) -> str:
        return f"{text} {unit_text(self.unit)}".rstrip()

    @property
    def value(self) -> str:
        """The estimate, without unit."""
        return number(self._value, self._spread)

    @property
    def interval(self) -> str:
        """The 95 % interval, without unit."""
        return f"{number(self._low, self._spread)} to {number(self._high, self._spread)}"

    @property
    def nominal(self) -> str:
        """The nominal value with unit."""
        if self._nominal is None:
            return "its nominal value"
        return self._with_unit(f"{self._nominal * self._scale:.4g}")


def effect_name(effect: str) -> str:
    """An effect as people call it: ``mechanical.coulomb_friction`` is "Coulomb friction"."""
    # of any system: names of the model stay as they are
    name, place, where = effect.partition(".")[2].partition(" at ")
    name = name.replace("_", " ") + place + where
    for proper in ("coulomb", "stribeck"):
        name = name.replace(proper, proper.capitalize())
    return name


def effect_in_block(effect: str) -> str:
    """An effect by the name that people know, or one without with its block: "snow load (mechanics)"."""
    if effect in NAMES:
        return called(effect)
    block = effect.partition(".")[0]
    if block.startswith("parameter "):
        return effect
    if block == "port":
        return effect_name(effect)  # of any system: the words say where it is
    return f"{effect_name(effect)} ({block_name(block)})"


def prose(text: str) -> str:
    """A sentence with the effects and signals in it called as people call them."""
    for name in registry.effects():
        text = text.replace(name, effect_in_block(name))
    return with_signals(text)


# a signal by its identifier, and not the word of everyday ("the spool's speed", "slew sensor") or a part of a longer name
_SIGNAL = re.compile(
    r"(?<![\w.])(?<!the )(slew_external|slew|spool|p_load|p_supply|p_a|p_b)(?![\w.'])"
    r"(?! (?:sensor|angle|speed|position|drive))"
)


def with_signals(text: str) -> str:
    """A sentence with its signals, and what something depends on, called as people call them: "slew speed" for omega."""
    return _SIGNAL.sub(
        lambda found: signal_name(found[1]),
        _DEPENDS.sub(
            lambda found: f"{'the ' if _RATE.fullmatch(found[1]) else ''}{quantity(found[1])[0]}",
            _MISSING.sub(lambda lacking: kind_of_motion(lacking[0]), text),
        ),
    )


CHANGING = ", changing with "  # of a law that is not the same everywhere

_MISSING = re.compile(r"(?<=a missing )torque(?= that depends on)")

RATE = "_rate"  # of what changes in time
_RATE = re.compile(rf"(?!(?:{'|'.join(map(re.escape, QUANTITIES))})$)\w+{RATE}")
_NAMED = "|".join((*map(re.escape, sorted(QUANTITIES, key=len, reverse=True)), _RATE.pattern))
_DEPENDS = re.compile(rf"(?:(?<=that depends on )|(?<={CHANGING}))({_NAMED})(?= explains|,)")


def without_tracker(text: str) -> str:
    """A list of effects without those of a tracker, where there was none; empty if nothing is left of it."""
    head, colon, rest = text.partition(": ")
    left = [item for item in rest.split(", ") if not item.startswith("tracker.")]
    return f"{head}{colon}{', '.join(left)}" if left else ""


def few(text: str, most: int = 5) -> str:
    """A sentence that ends in a list, ``x would show: a, b, c``, with no more than the first of a long one."""
    head, colon, rest = text.partition(": ")
    items = rest.split(", ")
    if len(items) <= most + 1:
        return text
    return f"{head}{colon}{', '.join(items[:most])} and {len(items) - most} more"


def fit_text(percent: float) -> str:
    """A best fit in percent, without a minus sign before a zero."""
    return "unknown" if not math.isfinite(percent) else f"{percent if abs(percent) >= 0.05 else 0.0:.1f} %"


def at_start(text: str) -> str:
    """A text at the start of a title: no more than its first letter changes, for a port is called A."""
    return text[:1].upper() + text[1:]


def signal_name(signal: str) -> str:
    """A signal as people call it."""
    own = current().signals.get(signal)
    return own.text if own else kind_of_motion(SIGNAL_NAMES.get(signal, signal))


def the(signal: str) -> str:
    """A signal within a sentence: "the slew angle"; one that has no name but its own stands alone, as "valve.y"."""
    name = signal_name(signal)
    return name if name == signal else f"the {name}"


def shows_speed(signal: str) -> bool:
    """Whether a signal of this machine is a speed or a flow, and no angle or place."""
    own = current().signals.get(signal)
    try:
        return own is not None and is_speed(own.unit)
    except UsageError:  # a unit of the machine's own
        return False


def two_digits(value: float) -> str:
    """A number with two significant digits, and without an exponent where people write none: 250, not 2.5e+02."""
    text = f"{value:.2g}"
    return f"{float(text):.0f}" if "e+" in text and abs(value) < 1e6 else text


def block_name(block: str) -> str:
    """A block as people call it; of several that are judged as one, all of them."""
    own = current().blocks
    return own.get(block) or " + ".join(own.get(n) or BLOCK_NAMES.get(n, n) for n in block.split("+"))


def quantity(of: str) -> tuple[str, str, float]:
    """What something depends on, in words; the unit in which it is shown, and the factor from SI to it."""
    lexicon = current()
    if of in lexicon.signals:
        return signal_name(of), *lexicon.signal(of)
    if of == "omega" and "speed" in lexicon.signals:  # as the machine measures it
        return kind_of_motion(QUANTITIES[of][0]), *lexicon.signal("speed")
    driver, changing, by = of.partition(CHANGING)
    if changing:
        text, unit, scale = quantity(driver)
        return f"{text}{changing}{quantity(by)[0]}", unit, scale
    if of not in QUANTITIES and (signal := of.removesuffix(RATE)) in (*lexicon.signals, *SIGNAL_NAMES):
        unit, scale = lexicon.signal(signal)
        if of == signal:
            return signal_name(signal), unit, scale
        return f"rate of change of {the(signal)}", f"{unit}/s", scale
    text, si, unit = QUANTITIES.get(of, (of, "1", "1"))
    if lexicon.holds:
        si = ONE_RATE_ON.get(si, si)
    return kind_of_motion(text), *lexicon.quantity(si, unit)


def lacking(what: str) -> tuple[str, str, float]:
    """What is missing, as `quantity` tells it: never a signal of the machine, which may be called torque as well."""
    text, si, unit = QUANTITIES.get(what, (what, "1", "1"))
    return kind_of_motion(text), *current().quantity(si, unit)


def called(effect: str) -> str:
    """An effect by the name that people know, on the machine at hand; its identifier where it has none."""
    return kind_of_motion(NAMES.get(effect, effect))


def listed(items: list[str]) -> str:
    """``a, b and c``."""
    return items[0] if len(items) == 1 else f"{', '.join(items[:-1])} and {items[-1]}"


def phrase(cause: NamedCause, material: Material) -> tuple[str, str]:
    """(what is wrong, how) of a cause; for an effect without words of its own, its parameters."""
    if own := in_own_words(cause, material):
        return own
    met = limits_met(cause, material)
    quantities = {n: Quantity(cause.parameters[n], nominal_of(cause, n, material)) for n in met}
    sizes = listed([f"{n} = {q} ({q.interval})" for n, q in quantities.items()])
    return f"the {effect_name(cause.effect)}", f"{effect_in_block(cause.effect)} with {sizes} is missing"


def in_own_words(cause: NamedCause, material: Material) -> tuple[str, str] | None:
    """(what is wrong, how) in an effect's own words; None where it has none for what the log tells."""
    met = limits_met(cause, material)
    if speeds := by_speed(cause, met):
        return speeds
    noun, how = words_of(cause)
    quantities = {n: Quantity(cause.parameters[n], nominal_of(cause, n, material)) for n in met}
    if not noun or len(met) < len(cause.parameters) or not named_in(how) <= quantities.keys():
        return None
    how += "".join(text for name, text in FORMS.items() if name in quantities)
    return kind_of_motion(noun), kind_of_motion(how.format(**quantities))


def words_of(cause: NamedCause) -> tuple[str, str]:
    """(what is wrong, how) with the parameters in braces, by the parameters that a cause has; empty texts for none."""
    noun, how = PHRASES.get(cause.effect, ("", ""))
    if not named_in(how) <= set(cause.parameters) and cause.effect in PHYSICAL:
        noun, how = PHYSICAL[cause.effect]
    return noun, how


def by_speed(cause: NamedCause, met: list[str]) -> tuple[str, str] | None:
    """(what is wrong, how) by the speeds at which a limit holds the drive; None where these are not what the log tells."""
    if cause.effect not in SPEEDS or not cause.top_speed.keys() >= set(met):
        return None
    noun, both, one = SPEEDS[cause.effect]
    told = [Quantity(cause.top_speed[n], None) for n in sorted(met, reverse=True)]
    return noun, (both if len(told) > 1 else one).format(*told)


def named_in(text: str) -> set[str]:
    """Parameters that a phrase names: of two limits a log may tell one only."""
    return {field.partition(".")[0] for _, field, _, _ in Formatter().parse(text) if field}


def limits_met(cause: NamedCause, material: Material) -> list[str]:
    """Parameters of a cause but the limits of which the log says nothing: they stand where they were, out of reach."""
    effect = registry.effects().get(cause.effect)
    found = []
    for name, item in cause.parameters.items():
        nominal = nominal_of(cause, name, material)
        free = effect.free.get(name) if effect else None
        away = nominal is not None and math.isclose(item.value, nominal, rel_tol=1e-6)
        if free is None or not free.limits or not away:
            found.append(name)
    return found or list(cause.parameters)


def nominal_of(cause: NamedCause, name: str, material: Material) -> float | None:
    """Nominal value of one of a cause's parameters, in the parameter's unit; None where nothing of ours declares it."""
    try:
        full = f"{component_of(cause)}.{name}"
        return material.nominal(full) / _scale(cause, name, cause.parameters[name])
    except (KeyError, ModuleNotFoundError):
        return None


def _scale(cause: NamedCause, name: str, parameter: Parameter) -> float:
    """Factor from the parameter's display unit to SI."""
    effect = registry.effects()[cause.effect]
    own = effect.parameters.get(name)
    return current().to_si(parameter.unit, (own or registry.parameter(effect.component, name)).unit)


def telling(answer: Answer) -> str | None:
    """The signal in which the extension gains most, counted in noise; None if there is none."""
    if not answer.gain:
        return None

    def fall(signal: str) -> float:
        gain = answer.gain[signal]
        found = (gain.rmse_before - gain.rmse_after) / max(gain.noise_floor, 1e-300)
        return found if math.isfinite(found) else -math.inf

    return max(answer.gain, key=fall)


def by_error(answer: Answer, names: list[str]) -> list[str]:
    """Signals, the one whose nominal error is largest in units of its noise first; among equals the last in the drive."""

    def error(signal: str) -> float:
        item = answer.signals.get(signal)
        return item.rmse / item.noise_floor if item and item.noise_floor > 0.0 else 0.0

    return sorted(names, key=lambda name: (-round(error(name), 1), -names.index(name)))


def down_to_noise(answer: Answer, gain: SignalGain) -> bool:
    """Whether an error has come down to the sensor's noise; of what stays unexplained that may only seem so."""
    return answer.verdict != "unexplained" and gain.rmse_after <= NOISY * gain.noise_floor


def gain_clause(answer: Answer) -> str:
    """How much the extension gains, as a clause; empty if no FMUs were run."""
    signal = telling(answer)
    if signal is None:
        return ""
    gain = answer.gain[signal]
    unit = unit_text(gain.unit)
    before, after = two_digits(gain.rmse_before), two_digits(gain.rmse_after)
    noise = f"{two_digits(gain.noise_floor)} {unit}"
    if gain.rmse_after >= gain.rmse_before:
        return f"; the error of {the(signal)} on data not used for fitting stays at {before} {unit}"
    end = "which is the sensor's noise" if down_to_noise(answer, gain) else f"against a noise of {noise}"
    return (
        f"the error of {the(signal)} on data not used for fitting{span_of(gain)} falls from "
        f"{before} to {after} {unit}, {end}"
    )


def odd_log(gain: SignalGain) -> LogGain | None:
    """The held-out log that holds most of what is left by itself, if there are several and there is such a one."""
    worst = max(gain.per_log, key=lambda log: log.rmse_after, default=None)
    if worst is None or len(gain.per_log) < FEW_LOGS or worst.rmse_after <= NOISY * gain.noise_floor:
        return None
    return worst if worst.rmse_after > ODD * of_others(gain, worst) else None


def odd_sentence(gain: SignalGain) -> str:
    """Where most of what is left is, if one held-out log holds it; else empty."""
    odd = odd_log(gain)
    if odd is None:
        return ""
    unit = f" {unit_text(gain.unit)}".rstrip()
    error, rest = two_digits(odd.rmse_after), two_digits(of_others(gain, odd))
    return (
        f"Most of what is left is in {odd.log}: {error}{unit}, against {rest}{unit} in the other "
        f"{len(gain.per_log) - 1} held-out logs"
    )


def of_others(gain: SignalGain, one: LogGain) -> float:
    """Root mean square of the error that is left in the other held-out logs."""
    return float(np.sqrt(np.mean([log.rmse_after**2 for log in gain.per_log if log is not one])))


def span_of(gain: SignalGain) -> str:
    """Over how long a prediction its error is, where that is not the whole log."""
    return "" if gain.horizon is None else f", predicted over {gain.horizon:.2g} s at a time,"


def reported(answer: Answer, wrong: list[tuple[str, str]]) -> str:
    """What is wrong, and what the extension gains: one sentence for one cause, one for each of several."""
    gain = gain_clause(answer)
    if len(wrong) == 1:
        ((noun, how),) = wrong
        return f"The simulation gets {noun} wrong: {how}{f'; with it {gain}' if gain else ''}."
    each = " ".join(f"{noun[0].upper()}{noun[1:]}: {how}." for noun, how in wrong)
    return (
        f"The simulation gets {len(wrong)} things wrong. {each}{f' With all of them {gain}.' if gain else ''}"
    )


def sentence(material: Material) -> str:
    """The verdict as a person would say it."""
    answer = material.answer
    blocks = listed(sorted({block_name(r.block) for r in answer.unexplained}) or ["model"])
    if answer.verdict == "adequate":
        judged = listed([block_name(name) for name in material.parts] or ["model"])
        return (
            f"The simulation agrees with the log: in {judged}, what is left is no more than noise and the tolerance "
            "of the nominal parameters allow."
        )
    if answer.data:
        told_of = "; ".join(f"{d.finding}: {d.remedy}" for d in answer.data)
        return f"The data contradict their labels, so no cause was looked for. {told_of}."
    if answer.verdict == "interrupted":
        judged = listed([block_name(name) for name in material.parts] or ["no block"])
        if not answer.causes:
            return f"The diagnosis was interrupted. Judged until then: {judged}; no cause was named."
        return f"The diagnosis was interrupted. Judged until then: {judged}. " + reported(
            answer, [phrase(c, material) for c in answer.causes]
        )
    if not answer.causes:
        return (
            f"The simulation gets something wrong in the {blocks}, and no effect of the library explains it."
        )
    text = reported(answer, [phrase(c, material) for c in answer.causes])
    if answer.verdict == "partly_explained":
        text += f" Something else in the {blocks} stays unexplained."
    return text


def doubts(answer: Answer) -> list[str]:
    """One sentence for each cause that the log cannot tell from others."""
    found = []
    for cause in answer.causes:
        if cause.indistinguishable_from:
            others = listed([effect_in_block(e) for e in cause.indistinguishable_from])
            found.append(f"This log cannot tell {effect_in_block(cause.effect)} from {others}.")
    return found
